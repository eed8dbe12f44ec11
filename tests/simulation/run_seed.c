#include "run_seed.h"

#include <errno.h>
#include <glib/gstdio.h>
#include <signal.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "bus_life.h"
#include "disk_model.h"
#include "lib/small_rig.h"
#include "life.h"
#include "store_check.h"

/* Attempts that an undisturbed daemon has to finish a session and its products. A damaged frame
 * takes two: processing finds it, and a resumed capture takes it again. */
#define LAST_ATTEMPTS 8

struct Reference {
    char *folder;
    struct store *stores[SCHEDULE_SESSIONS];
};

/* The sessions, as changes of the small rig's. */
static const struct {
    const char *what;
    struct change changes[8];
} sessions[SCHEDULE_SESSIONS] = {
    {"the small rig's session", {{0}}},
    {"one exposure, and a short one at each step of a sweep",
     {{"[capture]", "exposures_us = 16000"}, {"[capture]", "laser_short_us = 1000"}, {0}}},
    {"all exposures and all frames of the sweeps are kept",
     {{"[capture]", "keep_exposures = yes"}, {"[capture]", "keep_laser_frames = yes"}, {0}}},
    {"lamps and sweeps in rounds, until pictures and surface are known",
     {{"[lights]", "sampling = adaptive"},
      {"[lights]", "first = 1"},
      {"[lights]", "error_pct = 8"},
      {"[lasers]", "rings = 30:2; 60:2"},
      {"[lasers]", "stop = covered"},
      {"[lasers]", "first = 1"},
      {"[lasers]", "gain_pct = 1"},
      {0}}},
};

struct run {
    const struct store *reference; /* NULL: this is it */
    const char *folder;
    int session;
    char *scratch;
    struct scene *scene;
    DiskModel *model;
    GHashTable *damaged; /* paths of files that the simulation has damaged */
    struct seed_result *result;
    GString *said;
    int n_done; /* shots, after the last life */
    gboolean is_captured, is_processed;
};

static const struct life undisturbed = {.patience = 3};

static void run_make_folders(struct run *run, const char *name) {
    struct scene *scene = run->scene;
    g_autofree char *folder = g_build_filename(run->folder, name, NULL);
    g_autofree char *disk = g_build_filename(folder, "disk", NULL);
    run->scratch = g_build_filename(folder, "scratch", NULL);
    disk_remove_tree(folder);
    if (g_mkdir_with_parents(disk, 0777) != 0 || g_mkdir(run->scratch, 0777) != 0)
        g_error("simulate: %s: %s", folder, g_strerror(errno));
    g_strlcpy(scene->folder, folder, sizeof scene->folder);
    g_strlcpy(scene->disk.root, disk, sizeof scene->disk.root);
    g_snprintf(scene->session, sizeof scene->session, "%s/small.session", disk);
    small_rig_write(folder, "world.conf", NULL);
    small_rig_write(folder, "session.conf", sessions[run->session].changes);
    run->model = disk_model_new(disk);
}

static void run_write_rig(struct run *run, const struct life *life) {
    struct change changes[SCHEDULE_MAX_DEVICES + 1] = {0};
    for (int i = 0; i < life->n_devices; i++)
        changes[i] = (struct change){life->devices[i].section, life->devices[i].line};
    small_rig_write(run->scene->folder, "rig.conf", changes);
}

static void run_say(struct run *run, const char *text) {
    if (run->said)
        g_string_append(run->said, text);
}

/* A second daemon lives and ends while the first waits. */
static void run_second(struct run *run) {
    struct disk *disk = &run->scene->disk;
    const int n_faults = disk->n_faults;
    int status = 0;
    disk->n_faults = 0;
    const pid_t pid = fork();
    if (pid == 0)
        life_second(run->scene);
    waitpid(pid, &status, 0);
    disk->n_faults = n_faults;
    if (!WIFEXITED(status) || WEXITSTATUS(status) != 0)
        scene_break(run->scene, "one daemon",
                    WIFEXITED(status) && WEXITSTATUS(status) == 1
                        ? "a second daemon captures into the same session"
                        : "a second daemon is not told that the session is locked");
}

/* Waits for a life, and starts second daemons for it meanwhile. */
static int run_wait(struct run *run, pid_t pid, int asks, int answers) {
    char word;
    int status = 0;
    while (read(asks, &word, 1) == 1) {
        run_second(run);
        if (write(answers, &word, 1) != 1)
            break;
    }
    waitpid(pid, &status, 0);
    return status;
}

static void judge_status(struct scene *scene, int status) {
    if (WIFSIGNALED(status) && WTERMSIG(status) == SIGALRM)
        scene_break(scene, "ends", "the daemon hangs");
    else if (WIFSIGNALED(status) && WTERMSIG(status) != SIGKILL)
        scene_break(scene, "does not crash", "the daemon ended with signal %d (%s)",
                    WTERMSIG(status), g_strsignal(WTERMSIG(status)));
    else if (WIFEXITED(status) && WEXITSTATUS(status) != 0)
        scene_break(scene, "does not crash", "the daemon ended with status %d",
                    WEXITSTATUS(status));
}

static void run_fork(struct run *run, const struct life *life, gboolean captures) {
    struct scene *scene = run->scene;
    int asks[2], answers[2];
    if (pipe(asks) != 0 || pipe(answers) != 0)
        g_error("simulate: no pipe: %s", g_strerror(errno));
    scene->asks = asks[1];
    scene->answers = answers[0];
    const pid_t pid = fork();
    if (pid < 0)
        g_error("simulate: no process: %s", g_strerror(errno));
    if (pid == 0) {
        close(asks[0]);
        close(answers[1]);
        if (captures)
            life_capture(scene, life);
        life_process(scene);
    }
    close(asks[1]);
    close(answers[0]);
    const int status = run_wait(run, pid, asks[0], answers[1]);
    close(asks[0]);
    close(answers[1]);
    judge_status(scene, status);
    run->result->kills += WIFSIGNALED(status) && !scene->disk.cut;
}

/* What nothing in the schedule explains must not have happened. */
static void run_check_end(struct run *run, const struct life *life, const struct store *store,
                          gboolean exists, gboolean captures) {
    struct scene *scene = run->scene;
    const gboolean disk_failed = scene->disk.n_failed > 0;
    if (!exists && (scene->begun || run->n_done >= 0))
        scene_break(scene, "nothing is lost", "the session is gone");
    if (!exists)
        return;
    if (captures && store->done < scene->shots_done)
        scene_break(scene, "nothing is lost", "the database has %d done shots, the daemon said %d",
                    store->done, scene->shots_done);
    if (!disk_failed && scene->end == LIFE_REFUSED && g_hash_table_size(run->damaged) == 0)
        scene_break(scene, "goes on", "a session is refused for nothing: %s", scene->message);
    if (!disk_failed && scene->end == LIFE_PAUSED &&
        (g_strcmp0(store->state, "paused") != 0 || g_strcmp0(store->reason, scene->message) != 0))
        scene_break(scene, "stops are told",
                    "it paused for \"%s\", but the session says %s, \"%s\"", scene->message,
                    store->state, store->reason);
    if (!disk_failed && scene->end == LIFE_DONE && g_strcmp0(store->state, "done") != 0)
        scene_break(scene, "stops are told", "it is done, but the session says %s", store->state);
    if (!disk_failed && scene->end == LIFE_FAILED && g_hash_table_size(run->damaged) == 0)
        scene_break(scene, "goes on", "products are refused for nothing: %s", scene->message);
}

static void run_cut(struct run *run, const struct life *life) {
    g_autoptr(GRand) random = g_rand_new_with_seed(life->cut_seed);
    g_autofree char *misplaced = disk_model_cut(run->model, life->cut, life->misplaces, random);
    run->result->cuts++;
    if (!misplaced)
        return;
    run->result->misplaced++;
    const char *session = strstr(misplaced, ".session/");
    disk_say(&run->scene->disk, "a write of %s lay elsewhere", misplaced);
    g_hash_table_add(run->damaged, g_strdup(session ? session + strlen(".session/") : misplaced));
}

static void run_rot(struct run *run, const struct store *store, const struct life *life) {
    g_autoptr(GRand) random = g_rand_new_with_seed(life->cut_seed + 1);
    g_autoptr(GList) paths =
        g_list_sort(g_hash_table_get_keys(store->frames), (GCompareFunc)strcmp);
    const guint n = g_list_length(paths);
    if (n == 0)
        return;
    const char *path = g_list_nth_data(paths, (guint)g_rand_int_range(random, 0, (gint32)n));
    g_autofree char *below = g_build_filename("small.session", path, NULL);
    disk_model_rot(run->model, below, random);
    g_hash_table_add(run->damaged, g_strdup(path));
    disk_say(&run->scene->disk, "a bit of %s rots", path);
    run->result->rotten++;
}

/* One life and what must be so after it. FALSE: an invariant is broken. */
static gboolean run_life(struct run *run, const struct life *life) {
    struct scene *scene = run->scene;
    struct disk *disk = &scene->disk;
    const gboolean captures = !run->is_captured;
    scene->end = LIFE_KILLED;
    scene->begun = FALSE;
    scene->shots_done = 0;
    *scene->message = '\0';
    memset(disk->calls, 0, sizeof disk->calls);
    memcpy(disk->faults, life->disk, sizeof disk->faults);
    disk->n_faults = life->n_disk;
    disk->ended_us = 0;
    disk->cut = disk->full = FALSE;
    run->result->lives++;
    run_write_rig(run, life);
    run_fork(run, life, captures);
    disk_say(disk, "after %d calls to the disk, %s", disk->calls[DISK_ANY],
             disk->cut                   ? "the power failed"
             : scene->end == LIFE_KILLED ? "the daemon was killed"
                                         : "it ended");
    disk_model_read(run->model, disk);
    g_autofree char *missed = disk_model_check(run->model);
    if (missed)
        scene_break(scene, "the simulation sees every call", "%s", missed);
    if (disk->cut)
        run_cut(run, life);
    struct store *store = store_new();
    const gboolean exists = store_check(scene, run->reference, run->damaged, run->scratch, store);
    run_check_end(run, life, store, exists, captures);
    if (life->rots && exists && !*scene->violation)
        run_rot(run, store, life);
    if (exists) {
        run->n_done = store->done;
        run->is_captured = store->planned == 0;
    }
    run->is_processed = scene->end == LIFE_PROCESSED;
    if (scene->end == LIFE_FAILED)
        run->is_captured = FALSE; /* it says what to do: resume */
    store_free(store);
    run->result->failed_calls += disk->n_failed;
    disk->n_failed = 0;
    run_say(run, disk->said);
    memset(disk->said, 0, disk->n_said);
    disk->n_said = 0;
    return !*scene->violation;
}

/* Products and, of a session whose sweeps come in rounds, the rounds are those of the undisturbed
 * run. */
static void run_check_last(struct run *run) {
    struct store *store = store_new();
    store_check(run->scene, run->reference, run->damaged, run->scratch, store);
    if (g_strcmp0(store->rounds, run->reference->rounds) != 0)
        scene_break(run->scene, "products are the same",
                    "the rounds of sweeps are “%s”, in an undisturbed run “%s”", store->rounds,
                    run->reference->rounds);
    store_free(store);
    store_check_products(run->scene, run->reference);
}

/* Until everything is there; nothing goes wrong any more. */
static gboolean run_last(struct run *run) {
    run_say(run, "last lives: nothing happens\n");
    run->is_processed = FALSE;
    for (int i = 0; i < LAST_ATTEMPTS && !run->is_processed; i++)
        if (!run_life(run, &undisturbed))
            return FALSE;
    if (!run->is_processed)
        scene_break(run->scene, "goes on",
                    "%d undisturbed lives have not finished it; the last: %s", LAST_ATTEMPTS,
                    run->scene->message);
    else if (run->reference)
        run_check_last(run);
    else
        store_check_exposures(run->scene, run->scratch);
    run_say(run, run->scene->disk.said);
    return !*run->scene->violation;
}

static void run_begin(struct run *run, const char *name) {
    run->scene = scene_new();
    run->damaged = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, NULL);
    run->n_done = -1;
    run_make_folders(run, name);
}

static void run_finish(struct run *run) {
    struct seed_result *result = run->result;
    result->ok = !*run->scene->violation;
    result->digest ^= run->scene->disk.digest;
    g_strlcpy(result->violation, run->scene->violation, sizeof result->violation);
    disk_model_free(run->model);
    g_hash_table_unref(run->damaged);
    disk_remove_tree(run->scene->folder);
    scene_free(run->scene);
    g_free(run->scratch);
}

/* An undisturbed run; what is broken in it, or NULL. */
static char *reference_run(const char *folder, int session, struct store *store) {
    struct seed_result result = {0};
    struct run run = {.folder = folder, .session = session, .result = &result};
    run_begin(&run, "reference");
    if (run_last(&run)) {
        store_check(run.scene, NULL, run.damaged, run.scratch, store);
        store_read_products(run.scene, store);
    }
    run_finish(&run);
    return result.ok ? NULL : g_strdup(result.violation);
}

Reference *reference_new(const char *folder, enum seed_lives lives, char **ret_broken) {
    Reference *reference = g_new0(Reference, 1);
    reference->folder = g_strdup(folder);
    *ret_broken = NULL;
    for (int i = 0; i < SCHEDULE_SESSIONS; i++) {
        reference->stores[i] = store_new();
        if (!*ret_broken && lives & LIVES_CAPTURE)
            *ret_broken = reference_run(folder, i, reference->stores[i]);
    }
    return reference;
}

void reference_free(Reference *reference) {
    if (!reference)
        return;
    for (int i = 0; i < SCHEDULE_SESSIONS; i++)
        store_free(reference->stores[i]);
    g_free(reference->folder);
    g_free(reference);
}

/* The life on the bus. Its files are all on the simulated disk, on which nothing fails. */
static void run_bus(const char *folder, const char *name, guint32 seed, GString *said,
                    struct seed_result *ret) {
    struct bus_schedule schedule;
    struct change changes[BUS_MAX_LINES + 2] = {{"[rig]", "clock = real"}};
    struct scene *scene = scene_new();
    g_autofree char *own = g_build_filename(folder, name, NULL);
    int status = 0;
    bus_schedule_make(&schedule, seed);
    for (int i = 0; i < schedule.n_lines; i++)
        changes[i + 1] = (struct change){schedule.lines[i].section, schedule.lines[i].line};
    if (g_mkdir(own, 0777) != 0)
        g_error("simulate: %s: %s", own, g_strerror(errno));
    g_strlcpy(scene->folder, own, sizeof scene->folder);
    g_strlcpy(scene->disk.root, own, sizeof scene->disk.root);
    g_snprintf(scene->session, sizeof scene->session, "%s/small.session", own);
    small_rig_write(own, "world.conf", NULL);
    small_rig_write(own, "rig.conf", changes);
    small_rig_write(own, "session.conf", NULL);
    if (said) {
        g_autofree char *plan = bus_schedule_describe(&schedule);
        g_string_append_printf(said, "life on the bus:\n%s", plan);
    }
    const pid_t pid = fork();
    if (pid < 0)
        g_error("simulate: no process: %s", g_strerror(errno));
    if (pid == 0)
        bus_life(scene, &schedule);
    waitpid(pid, &status, 0);
    judge_status(scene, status);
    if (said)
        g_string_append(said, scene->disk.said);
    ret->served++;
    ret->bus_calls += scene->bus_calls;
    ret->digest ^= scene->disk.digest;
    ret->ok = !*scene->violation;
    ret->life = 0;
    g_strlcpy(ret->violation, scene->violation, sizeof ret->violation);
    disk_remove_tree(own);
    scene_free(scene);
}

static void run_captures(const Reference *reference, const char *name, guint32 seed, int session,
                         GString *said, struct seed_result *ret) {
    struct schedule schedule;
    struct run run = {.folder = reference->folder, .result = ret, .said = said};
    gboolean ok = TRUE;
    schedule_make(&schedule, seed);
    run.session = session >= 0 ? session : schedule.session;
    run.reference = reference->stores[run.session];
    run_begin(&run, name);
    g_autofree char *what = g_strdup_printf("session: %s\n", sessions[run.session].what);
    run_say(&run, what);
    for (int i = 0; i < schedule.n_lives && ok; i++) {
        g_autofree char *plan = schedule_describe(&schedule.lives[i]);
        g_autofree char *head = g_strdup_printf("life %d:\n", i + 1);
        run_say(&run, head);
        run_say(&run, plan);
        ret->life = i + 1;
        ok = run_life(&run, &schedule.lives[i]);
    }
    if (ok) {
        ret->life = schedule.n_lives + 1;
        run_last(&run);
    }
    run_finish(&run);
}

void run_seed(const Reference *reference, guint32 seed, enum seed_lives lives, int session,
              GString *said, struct seed_result *ret) {
    g_autofree char *name = g_strdup_printf("seed-%u-%d", seed, (int)getpid());
    *ret = (struct seed_result){.seed = seed, .ok = TRUE};
    if (lives & LIVES_CAPTURE)
        run_captures(reference, name, seed, session, said, ret);
    if (ret->ok && lives & LIVES_BUS)
        run_bus(reference->folder, name, seed, said, ret);
}
