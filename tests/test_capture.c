/* Sessions of the small simulated rig, captured from beginning to end, with every fault it can
 * have. What is compared with is a session that nothing happened to. */
#include <glib/gstdio.h>
#include <math.h>
#include <signal.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "daemon/capture.h"
#include "processing/exr.h"

#define SMALL SOURCE_DIR "/tests/small/"

/* What is changed in the small rig's files: lines put below a section's head, keys given a new
 * value. */
struct change {
    const char *head; /* "[lamps bank]" */
    const char *line; /* "key = value" */
};

struct run {
    char *directory; /* of this test */
    char *session;
    struct devices *devices;
    struct session_conf conf;
    Capture *capture;
    GString *told; /* events, a line each */
    int n_told, n_changed;
    gint64 changed_us, least_gap_us;
};

static char *top; /* everything is made in here */
static int n_made;

static void remove_tree(const char *path) {
    GDir *dir = g_file_test(path, G_FILE_TEST_IS_SYMLINK) ? NULL : g_dir_open(path, 0, NULL);
    const char *name;
    while (dir && (name = g_dir_read_name(dir))) {
        g_autofree char *child = g_build_filename(path, name, NULL);
        remove_tree(child);
    }
    if (dir)
        g_dir_close(dir);
    g_remove(path);
}

static char *changed_text(const char *name, const struct change *changes) {
    g_autofree char *path = g_strconcat(SMALL, name, NULL);
    char *text;
    g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
    for (const struct change *change = changes; change && change->head; change++) {
        gboolean fault = g_str_has_prefix(change->line, "fault_"); /* devices have those */
        if (!strstr(text, change->head) || (fault && !g_str_equal(name, "rig.conf")))
            continue;
        /* A key that stands in the section already is replaced, so none is there twice. */
        g_autofree char *key = g_strndup(change->line, strcspn(change->line, " ="));
        GString *to = g_string_new(NULL);
        gboolean inside = FALSE;
        g_auto(GStrv) lines = g_strsplit(text, "\n", -1);
        for (char **line = lines; *line; line++) {
            g_autofree char *its = g_strndup(*line, strcspn(*line, " ="));
            if (**line == '[')
                inside = g_str_equal(*line, change->head);
            if (!inside || !g_str_equal(its, key))
                g_string_append_printf(to, "%s\n", *line);
            if (**line == '[' && inside)
                g_string_append_printf(to, "%s\n", change->line);
        }
        g_free(text);
        text = g_string_free(to, FALSE);
    }
    return text;
}

static void write_small(const char *directory, const char *name, const struct change *changes) {
    g_autofree char *text = changed_text(name, changes);
    g_autofree char *path = g_build_filename(directory, name, NULL);
    g_assert_true(g_file_set_contents(path, text, -1, NULL));
}

static void open_devices(struct run *run) {
    g_autoptr(GError) error = NULL;
    g_autofree char *rig = g_build_filename(run->directory, "rig.conf", NULL);
    run->devices = devices_open(rig, &error);
    g_assert_no_error(error);
}

static void change_rig(struct run *run, const struct change *changes) {
    devices_close(run->devices);
    write_small(run->directory, "rig.conf", changes);
    write_small(run->directory, "world.conf", changes);
    open_devices(run);
}

static struct run *run_new(const struct change *changes) {
    struct run *run = g_new0(struct run, 1);
    run->directory = g_strdup_printf("%s/%d", top, n_made++);
    run->session = g_build_filename(run->directory, "small.session", NULL);
    run->told = g_string_new(NULL);
    run->least_gap_us = G_MAXINT64;
    g_mkdir(run->directory, 0777);
    write_small(run->directory, "rig.conf", changes);
    write_small(run->directory, "world.conf", changes);
    write_small(run->directory, "session.conf", changes);
    open_devices(run);
    g_autoptr(GError) error = NULL;
    g_autofree char *conf = g_build_filename(run->directory, "session.conf", NULL);
    g_assert_true(session_conf_load(&run->conf, conf, &error));
    g_assert_no_error(error);
    return run;
}

static void run_free(struct run *run) {
    capture_free(run->capture);
    devices_close(run->devices);
    session_conf_clear(&run->conf);
    remove_tree(run->directory);
    g_free(run->directory);
    g_free(run->session);
    g_string_free(run->told, TRUE);
    g_free(run);
}

static void on_changed(Capture *capture, gpointer data) {
    struct run *run = data;
    gint64 now = g_get_monotonic_time();
    if (run->n_changed++ > 0)
        run->least_gap_us = MIN(run->least_gap_us, now - run->changed_us);
    run->changed_us = now;
}

static void on_event(Capture *capture, const char *level, const char *source, const char *message,
                     gpointer data) {
    struct run *run = data;
    run->n_told++;
    g_string_append_printf(run->told, "%s %s: %s\n", level, source, message);
}

static struct capture_callbacks callbacks_of(struct run *run) {
    return (struct capture_callbacks){on_changed, on_event, run};
}

static void start(struct run *run) {
    g_autoptr(GError) error = NULL;
    struct capture_callbacks callbacks = callbacks_of(run);
    run->capture = capture_start(run->devices, &run->conf, run->session, &callbacks, &error);
    g_assert_no_error(error);
}

static void resume(struct run *run) {
    g_autoptr(GError) error = NULL;
    struct capture_callbacks callbacks = callbacks_of(run);
    g_clear_pointer(&run->capture, capture_free);
    run->capture = capture_resume(run->devices, run->session, &callbacks, &error);
    g_assert_no_error(error);
}

static void cont(struct run *run) {
    g_autoptr(GError) error = NULL;
    g_assert_true(capture_continue(run->capture, &error));
    g_assert_no_error(error);
}

static struct capture_status status_of(struct run *run) {
    struct capture_status status;
    capture_get_status(run->capture, &status);
    return status;
}

static gboolean too_late(gpointer data) {
    g_error("nothing more happens; told so far:\n%s", ((struct run *)data)->told->str);
    return G_SOURCE_REMOVE;
}

/* Until it rests, or has taken that many frames (0: any number). */
static enum capture_state run_until(struct run *run, gint64 frames) {
    guint guard = g_timeout_add_seconds(120, too_late, run);
    struct capture_status status = status_of(run);
    while (status.state < CAPTURE_PAUSED && (frames == 0 || status.frames < frames)) {
        g_main_context_iteration(NULL, TRUE);
        status = status_of(run);
    }
    g_source_remove(guard);
    return status.state;
}

static void run_to_end(struct run *run) {
    if (run_until(run, 0) != CAPTURE_DONE)
        g_error("not done: %s", status_of(run).reason);
    g_clear_pointer(&run->capture, capture_free);
}

static void run_to_pause(struct run *run, const char *reason) {
    g_assert_cmpint(run_until(run, 0), ==, CAPTURE_PAUSED);
    if (!strstr(status_of(run).reason, reason))
        g_error("paused for \"%s\", not \"%s\"", status_of(run).reason, reason);
    /* The pause is told, and in words that say what to do. */
    g_assert_nonnull(strstr(run->told->str, status_of(run).reason));
}

static void count_down(gpointer data) {
    (*(int *)data)--;
}

static void pass_time(struct run *run, int seconds) {
    int left = 1;
    clock_call_in(run->devices->clock, (gint64)seconds * G_USEC_PER_SEC, count_down, &left);
    while (left > 0)
        g_main_context_iteration(NULL, TRUE);
}

static void check_safe(struct run *run) {
    pass_time(run, 5); /* axes do not stop at once */
    for (int i = 0; i < run->devices->geometry.n_lamps; i++)
        g_assert_false(lamps_is_on(run->devices->lamps[i].bank, run->devices->lamps[i].index));
    for (int i = 0; i < run->devices->geometry.n_lasers; i++)
        g_assert_false(laser_is_on(run->devices->lasers[i]));
    g_assert_false(axis_is_moving(run->devices->turntable));
    g_assert_false(axis_is_moving(run->devices->arc));
}

static GPtrArray *frames_in(const char *session_path) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(session_path, SESSION_READ, &error);
    g_assert_no_error(error);
    GPtrArray *frames = session_frames(session, &error);
    g_assert_no_error(error);
    return frames;
}

static void check_same_part(const char *path, const struct exr_part *a, const struct exr_part *b) {
    g_assert_cmpstr(a->name, ==, b->name);
    g_assert_cmpint(a->n_channels, ==, b->n_channels);
    gsize bytes = (gsize)a->width * a->height * sizeof(float);
    for (int c = 0; c < a->n_channels; c++) {
        if (memcmp(a->planes[c], b->planes[c], bytes) != 0)
            g_error("%s: channel %s differs from an undisturbed session's", path, a->channels[c]);
    }
}

static void check_same_file(const char *a_session, const char *b_session, const char *relative) {
    g_autoptr(GError) error = NULL;
    g_autofree char *a_path = g_build_filename(a_session, relative, NULL);
    g_autofree char *b_path = g_build_filename(b_session, relative, NULL);
    struct exr_file *a = exr_read(a_path, &error);
    g_assert_no_error(error);
    struct exr_file *b = exr_read(b_path, &error);
    g_assert_no_error(error);
    g_assert_cmpint(a->parts->len, ==, b->parts->len);
    for (guint i = 0; i < a->parts->len; i++)
        check_same_part(a_path, a->parts->pdata[i], b->parts->pdata[i]);
    exr_file_free(a);
    exr_file_free(b);
}

/* A session that nothing happens to, made once. */
static const char *undisturbed(void) {
    static char *path;
    if (path)
        return path;
    struct run *run = run_new(NULL);
    start(run);
    run_to_end(run);
    path = g_build_filename(top, "undisturbed.session", NULL);
    g_assert_cmpint(g_rename(run->session, path), ==, 0);
    run_free(run);
    return path;
}

/* Every frame is there and is, to the bit, what it should be. */
static void check_same(struct run *run) {
    g_autoptr(GPtrArray) expected = frames_in(undisturbed());
    g_autoptr(GPtrArray) frames = frames_in(run->session);
    g_assert_cmpint(frames->len, ==, expected->len);
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *a = expected->pdata[i], *b = frames->pdata[i];
        g_assert_cmpint(a->shot, ==, b->shot);
        g_assert_cmpint(a->camera, ==, b->camera);
        g_assert_cmpstr(a->path, ==, b->path);
        check_same_file(undisturbed(), run->session, a->path);
    }
}

static int bits_in(guint32 mask) {
    int n = 0;
    for (; mask; mask &= mask - 1)
        n++;
    return n;
}

static void check_whole(const char *path) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(path, SESSION_CAPTURE, &error);
    g_assert_no_error(error);
    int lost = -1, expected = 0;
    g_assert_true(session_verify(session, TRUE, &lost, &error));
    g_assert_cmpint(lost, ==, 0);
    g_autoptr(GPtrArray) shots = session_shots(session, &error);
    g_autoptr(GPtrArray) frames = session_frames(session, &error);
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        g_assert_cmpint(shot->state, !=, SHOT_PLANNED);
        if (shot->state == SHOT_DONE)
            expected += bits_in(shot->cameras);
    }
    g_assert_cmpint(frames->len, ==, expected);
    g_autofree char *state = session_value(session, "state");
    g_assert_cmpstr(state, ==, "done");
}

static void test_whole(void) {
    struct run *run = run_new(NULL);
    g_autoptr(GError) error = NULL;
    struct plan *plan = capture_validate(run->devices, &run->conf, run->session, &error);
    g_assert_no_error(error);
    start(run);
    while (status_of(run).state == CAPTURE_HOMING)
        g_main_context_iteration(NULL, TRUE);
    /* Homed: both axes stand at 0, and the plan's time begins in its first pose. */
    double begun_s = status_of(run).elapsed_s, predicted_s = status_of(run).left_s;
    g_assert_cmpfloat(predicted_s, >=, plan->predicted_s);
    g_assert_cmpint(run_until(run, 0), ==, CAPTURE_DONE);
    struct capture_status status = status_of(run);
    g_assert_cmpint(status.shots, ==, plan->session.n_shots);
    g_assert_cmpint(status.shots_done, ==, status.shots);
    g_assert_cmpint(status.frames, ==, plan->n_frames);
    g_assert_cmpint(status.retakes, ==, 0);
    g_assert_cmpfloat(status.left_s, ==, 0);
    double took_s = status.elapsed_s - begun_s;
    g_test_message("took %.2f s, predicted %.2f s, lower bound %.2f s", took_s, predicted_s,
                   plan->lower_bound_s);
    g_assert_cmpfloat(fabs(took_s / predicted_s - 1), <, 0.02);
    g_assert_cmpfloat(took_s, >=, plan->lower_bound_s * (1 - 1e-6));
    g_assert_cmpint(run->least_gap_us, >=, 95000);
    const struct capture_thumbnail *thumbnail = capture_thumbnail(run->capture, 1);
    g_assert_nonnull(thumbnail);
    g_assert_cmpint(thumbnail->width, ==, 16);
    g_assert_null(capture_thumbnail(run->capture, 2));
    check_safe(run);
    g_clear_pointer(&run->capture, capture_free);
    check_whole(run->session);
    check_same(run);
    plan_free(plan);
    run_free(run);
}

/* The picture under each lamp is what the lamp's distance and angle say, within the sample's. */
static void test_radiance(void) {
    g_autofree char *path = NULL;
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(undisturbed(), SESSION_READ, &error);
    g_autoptr(GPtrArray) shots = session_shots(session, &error);
    g_autoptr(GPtrArray) lights = session_lights(session, &error);
    double mean[2] = {0};
    int n[2] = {0};
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        if (shot->kind != SHOT_LAMP || !(shot->cameras & 1))
            continue;
        g_autofree char *relative = session_frame_path(shot, "cam30");
        g_autofree char *file = session_file(session, relative);
        struct exr_part *part = exr_read_part(file, "radiance", &error);
        g_assert_no_error(error);
        mean[shot->device] += exr_part_plane(part, "Y")[16 * 32 + 16];
        n[shot->device]++;
        exr_part_free(part);
    }
    g_assert_cmpint(n[0], >, 0);
    g_assert_cmpint(n[1], >, 0);
    /* A matt sample at the aim of both lamps: cos 30° to cos 60°. */
    double ratio = mean[0] / n[0] / (mean[1] / n[1]);
    g_assert_cmpfloat_with_epsilon(ratio, sqrt(3), 0.1);
}

static void test_pause(void) {
    struct run *run = run_new(NULL);
    g_autoptr(GError) error = NULL;
    start(run);
    g_assert_false(capture_continue(run->capture, &error));
    g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_BUSY);
    capture_pause(run->capture); /* before anything moved */
    run_to_pause(run, "by the user");
    for (gint64 frames = 5; frames < 60; frames += 9) {
        cont(run);
        run_until(run, frames);
        int before = status_of(run).shots_done;
        capture_pause(run->capture);
        run_to_pause(run, "by the user");
        g_assert_cmpint(status_of(run).shots_done, >=, before);
        g_assert_null(strstr(run->told->str, "error"));
        check_safe(run);
    }
    cont(run);
    run_to_end(run);
    check_same(run);
    run_free(run);
}

static void test_abort(void) {
    struct run *run = run_new(NULL);
    g_autoptr(GError) error = NULL;
    start(run);
    run_until(run, 25);
    capture_abort(run->capture);
    g_assert_cmpint(status_of(run).state, ==, CAPTURE_ABORTED);
    check_safe(run);
    g_assert_false(capture_continue(run->capture, &error));
    g_assert_nonnull(strstr(error->message, "resume"));
    resume(run);
    run_to_end(run);
    check_same(run);
    resume(run); /* of what is done already */
    g_assert_cmpint(run_until(run, 0), ==, CAPTURE_DONE);
    g_assert_cmpint(status_of(run).frames, ==, 0);
    run_free(run);
}

/* Killed at any moment: a new process finds what was committed and takes the rest. */
static void test_resume(void) {
    struct run *run = run_new(NULL);
    start(run);
    gint64 frames = g_test_rand_int_range(1, 20);
    while (run_until(run, frames) < CAPTURE_PAUSED) {
        for (int i = g_test_rand_int_range(0, 30); i > 0; i--)
            g_main_context_iteration(NULL, FALSE);
        double before_s = status_of(run).elapsed_s;
        int done = status_of(run).shots_done;
        g_clear_pointer(&run->capture, capture_free);
        devices_close(run->devices);
        open_devices(run);
        resume(run);
        g_assert_cmpint(status_of(run).shots_done, ==, done);
        g_assert_cmpfloat_with_epsilon(status_of(run).elapsed_s, before_s, 1e-3);
        frames = g_test_rand_int_range(5, 60);
    }
    g_assert_cmpint(status_of(run).state, ==, CAPTURE_DONE);
    g_clear_pointer(&run->capture, capture_free);
    check_whole(run->session);
    check_same(run);
    run_free(run);
}

/* A frame's file that is gone is taken again; a dark frame's that cannot be read, too. */
static void test_lost_files(void) {
    struct run *run = run_new(NULL);
    start(run);
    run_to_end(run);
    g_autoptr(GPtrArray) frames = frames_in(run->session);
    const struct session_frame *dark = frames->pdata[0], *last = frames->pdata[frames->len - 1];
    g_autofree char *gone = g_build_filename(run->session, last->path, NULL);
    g_autofree char *spoilt = g_build_filename(run->session, dark->path, NULL);
    g_assert_cmpint(g_remove(gone), ==, 0);
    g_autofree char *zeros = g_malloc0((gsize)dark->bytes);
    g_assert_true(g_file_set_contents(spoilt, zeros, dark->bytes, NULL));
    resume(run);
    g_assert_cmpint(status_of(run).shots_done, ==, status_of(run).shots - 2);
    run_to_end(run);
    check_whole(run->session);
    check_same(run);
    run_free(run);
}

static void test_locked(void) {
    struct run *run = run_new(NULL);
    g_autoptr(GError) error = NULL;
    start(run);
    run_until(run, 10);
    g_assert_null(capture_resume(run->devices, run->session, NULL, &error));
    g_assert_error(error, SESSION_ERROR, SESSION_ERROR_LOCKED);
    g_clear_error(&error);
    g_assert_null(capture_start(run->devices, &run->conf, run->session, NULL, &error));
    g_assert_error(error, SESSION_ERROR, SESSION_ERROR_EXISTS);
    run_to_end(run);
    check_same(run);
    run_free(run);
}

/* The same from another process. */
static void test_locked_elsewhere(void) {
    struct run *run = run_new(NULL);
    g_autoptr(GError) error = NULL;
    start(run);
    run_until(run, 10);
    char *argv[] = {"/proc/self/exe", "--resume", run->directory, NULL};
    int status = -1;
    g_autofree char *out = NULL;
    g_assert_true(g_spawn_sync(NULL, argv, NULL, 0, NULL, NULL, &out, NULL, &status, &error));
    g_assert_no_error(error);
    g_assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 1);
    g_assert_nonnull(strstr(out, "locked"));
    run_free(run);
}

static int resume_in_child(const char *directory) {
    g_autofree char *rig = g_build_filename(directory, "rig.conf", NULL);
    g_autofree char *session = g_build_filename(directory, "small.session", NULL);
    g_autoptr(GError) error = NULL;
    struct devices *devices = devices_open(rig, &error);
    Capture *capture = devices ? capture_resume(devices, session, NULL, &error) : NULL;
    gboolean locked = g_error_matches(error, SESSION_ERROR, SESSION_ERROR_LOCKED);
    g_print("%s\n", locked ? "locked" : error ? error->message : "taken");
    capture_free(capture);
    devices_close(devices);
    return capture ? 0 : 1;
}

static void test_other_rig(void) {
    struct run *run = run_new(NULL);
    g_autoptr(GError) error = NULL;
    start(run);
    run_until(run, 10);
    g_clear_pointer(&run->capture, capture_free);
    change_rig(run, (const struct change[]){{"[rig]", "id = another"}, {0}});
    g_assert_null(capture_resume(run->devices, run->session, NULL, &error));
    g_assert_nonnull(strstr(error->message, "another"));
    g_assert_nonnull(strstr(error->message, "small"));
    g_clear_error(&error);
    change_rig(run, (const struct change[]){{"[camera cam60]", "width = 64"}, {0}});
    g_assert_null(capture_resume(run->devices, run->session, NULL, &error));
    g_assert_nonnull(strstr(error->message, "cam60"));
    change_rig(run, (const struct change[]){{"[camera cam30]", "distance_mm = 651"}, {0}});
    resume(run);
    g_assert_nonnull(strstr(run->told->str, "geometry"));
    run_free(run);
}

static void test_refused(void) {
    struct run *run = run_new(NULL);
    g_autoptr(GError) error = NULL;
    run->conf.exposures_us[1] = 70e6; /* more than any camera can */
    g_assert_null(capture_validate(run->devices, &run->conf, run->session, &error));
    g_assert_error(error, PLAN_ERROR, PLAN_ERROR_LIMITS);
    g_assert_false(g_file_test(run->session, G_FILE_TEST_EXISTS));
    g_clear_error(&error);
    g_assert_null(capture_resume(run->devices, run->session, NULL, &error));
    g_assert_nonnull(error);
    run_free(run);
}

/* A process may write no file beyond a kilobyte: no frame's file can be written, nor the database
 * much. */
static void test_disk_full(void) {
    struct run *run = run_new(NULL);
    struct rlimit before, none;
    start(run);
    run_until(run, 20);
    capture_pause(run->capture); /* so that it is a frame that does not fit first */
    run_to_pause(run, "by the user");
    cont(run);
    signal(SIGXFSZ, SIG_IGN);
    g_assert_cmpint(getrlimit(RLIMIT_FSIZE, &before), ==, 0);
    none = (struct rlimit){.rlim_cur = 1000, .rlim_max = before.rlim_max};
    g_assert_cmpint(setrlimit(RLIMIT_FSIZE, &none), ==, 0);
    g_assert_cmpint(run_until(run, 0), ==, CAPTURE_PAUSED);
    g_assert_cmpint(setrlimit(RLIMIT_FSIZE, &before), ==, 0);
    g_assert_nonnull(strstr(status_of(run).reason, "disk is full"));
    check_safe(run);
    cont(run);
    run_to_end(run);
    check_whole(run->session);
    check_same(run);
    run_free(run);
}

/* Pictures that are refused or lost are taken again until they are good; nothing else changes. */
static void check_retakes(const struct change *changes, const char *told) {
    struct run *run = run_new(changes);
    start(run);
    g_assert_cmpint(run_until(run, 0), ==, CAPTURE_DONE);
    g_assert_cmpint(status_of(run).retakes, >, 5);
    g_assert_nonnull(strstr(run->told->str, told));
    g_assert_nonnull(strstr(run->told->str, "taken again"));
    /* Not each of them: at most one a camera and minute, and the rest at the end. */
    g_assert_cmpint(run->n_told, <, 3 + 2 * (2 + status_of(run).elapsed_s / 60));
    g_clear_pointer(&run->capture, capture_free);
    g_autoptr(GPtrArray) frames = frames_in(run->session);
    int retakes = 0;
    for (guint i = 0; i < frames->len; i++)
        retakes += ((const struct session_frame *)frames->pdata[i])->retakes;
    g_assert_cmpint(retakes, >, 5);
    check_whole(run->session);
    check_same(run);
    run_free(run);
}

static void test_stale_old(void) {
    check_retakes((const struct change[]){{"[camera cam30]", "fault_stale = 0.2"},
                                          {"[camera cam60]", "fault_stale = 0.05"},
                                          {"[capture]", "retries = 20"},
                                          {0}},
                  "seen before");
}

static void test_stale_relabelled(void) {
    check_retakes((const struct change[]){{"[camera cam30]", "fault_stale = 0.2"},
                                          {"[camera cam30]", "fault_stale_kind = relabelled"},
                                          {"[camera cam60]", "fault_stale = 0.1"},
                                          {"[camera cam60]", "fault_stale_kind = relabelled"},
                                          {"[camera cam60]", "fault_seed = 5"},
                                          {"[capture]", "retries = 20"},
                                          {0}},
                  "repeats");
}

static void test_lost(void) {
    check_retakes((const struct change[]){{"[camera cam60]", "fault_lost = 0.1"},
                                          {"[capture]", "retries = 20"},
                                          {0}},
                  "no picture");
}

static void test_slow(void) {
    struct run *run =
        run_new((const struct change[]){{"[camera cam30]", "fault_slow_ms = 300"}, {0}});
    start(run);
    g_assert_cmpint(run_until(run, 0), ==, CAPTURE_DONE);
    g_assert_cmpint(status_of(run).retakes, ==, 0);
    check_same(run);
    run_free(run);
}

/* Never in time: that ends, in words. */
static void test_too_slow(void) {
    struct run *run =
        run_new((const struct change[]){{"[camera cam30]", "fault_slow_ms = 60000"}, {0}});
    start(run);
    run_to_pause(run, "cam30");
    g_assert_nonnull(strstr(status_of(run).reason, "4 attempts"));
    g_assert_cmpint(status_of(run).retakes, ==, 3);
    check_safe(run);
    run_free(run);
}

/* A camera that comes back by itself is waited for. */
static void test_disconnect(void) {
    struct run *run =
        run_new((const struct change[]){{"[camera cam60]", "fault_disconnect_after = 30"}, {0}});
    start(run);
    run_to_end(run);
    g_assert_nonnull(strstr(run->told->str, "cam60"));
    check_same(run);
    run_free(run);
}

static void test_disconnect_for_long(void) {
    struct run *run =
        run_new((const struct change[]){{"[camera cam60]", "fault_disconnect_after = 30"},
                                        {"[camera cam60]", "fault_reconnect_s = 3000"},
                                        {0}});
    start(run);
    run_to_pause(run, "cam60");
    g_assert_nonnull(strstr(status_of(run).reason, "gone"));
    check_safe(run);
    double elapsed_s = status_of(run).elapsed_s;
    cont(run);
    run_to_pause(run, "cam60");
    pass_time(run, 3000);
    g_assert_cmpfloat(status_of(run).elapsed_s, <, elapsed_s + 100); /* pauses do not count */
    cont(run);
    run_to_end(run);
    check_same(run);
    run_free(run);
}

static void check_stall(const char *head, const char *kind, const char *line) {
    struct run *run = run_new((const struct change[]){{head, kind}, {head, line}, {0}});
    start(run);
    g_autofree char *name = g_strndup(head + 6, strlen(head) - 7);
    run_to_pause(run, name);
    check_safe(run);
    cont(run);
    run_to_end(run);
    check_same(run);
    run_free(run);
}

static void test_stall(void) {
    check_stall("[axis turntable]", "fault_stall_kind = reported", "fault_stall_at = 2");
    check_stall("[axis arc]", "fault_stall_kind = silent", "fault_stall_at = 2");
    check_stall("[axis sweep60]", "fault_stall_kind = reported", "fault_stall_at = 7");
    check_stall("[axis sweep30]", "fault_stall_kind = silent", "fault_stall_at = 9");
}

static void test_dead_lamp(void) {
    struct run *run = run_new((const struct change[]){
        {"[lamps bank]", "fault_dead = lamp60"}, {"[lamps bank]", "fault_dead_after = 2"}, {0}});
    start(run);
    run_to_pause(run, "lamp lamp60 gives no light");
    check_safe(run);
    cont(run);
    run_to_pause(run, "lamp lamp60 gives no light");
    g_clear_pointer(&run->capture, capture_free);
    change_rig(run, NULL); /* a new lamp */
    resume(run);
    run_to_end(run);
    check_same(run);
    run_free(run);
}

static int occurrences(const char *text, const char *of) {
    int n = 0;
    for (const char *at = text; (at = strstr(at, of)); at++)
        n++;
    return n;
}

static void test_laser_stays_on(void) {
    struct run *run =
        run_new((const struct change[]){{"[laser laser30]", "fault_stays_on = yes"}, {0}});
    start(run);
    run_to_pause(run, "laser laser30 stays on");
    g_clear_pointer(&run->capture, capture_free);
    change_rig(run, NULL);
    resume(run);
    run_to_end(run);
    check_same(run);
    run_free(run);
}

/* A laser that does not answer when it is told to go off: said again as often as it happens, and
 * gone on with only when it is dark. */
static void test_deaf_laser(void) {
    struct run *run = run_new((const struct change[]){{"[laser laser30]", "fault_deaf = 5"}, {0}});
    start(run);
    run_to_pause(run, "THE RIG COULD NOT BE MADE SAFE: laser laser30");
    g_assert_nonnull(strstr(status_of(run).reason, "cut its power by hand"));
    g_assert_cmpint(occurrences(run->told->str, "error laser30: THE RIG"), ==, 1);
    pass_time(run, 10); /* the rig was made safe, or was it? */
    g_assert_true(laser_is_on(run->devices->lasers[0]));
    cont(run); /* it still is: told to go off twice a time */
    run_to_pause(run, "THE RIG COULD NOT BE MADE SAFE: laser laser30");
    g_assert_cmpint(occurrences(run->told->str, "error laser30: THE RIG"), ==, 2);
    pass_time(run, 10);
    cont(run);
    run_to_pause(run, "THE RIG COULD NOT BE MADE SAFE: laser laser30");
    pass_time(run, 10);
    check_safe(run);
    cont(run);
    run_to_end(run);
    check_same(run);
    run_free(run);
}

static void check_interlock(double after_s) {
    g_autofree char *after = g_strdup_printf("open_after_s = %g", after_s);
    g_autoptr(GError) error = NULL;
    struct run *run = run_new((const struct change[]){
        {"[interlock door]", after}, {"[interlock door]", "open_for_s = 30"}, {0}});
    start(run);
    run_to_pause(run, "interlock door is open");
    check_safe(run);
    g_assert_false(capture_continue(run->capture, &error));
    g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_INTERLOCK);
    g_assert_cmpint(status_of(run).state, ==, CAPTURE_PAUSED);
    pass_time(run, 31);
    cont(run);
    run_to_end(run);
    check_same(run);
    run_free(run);
}

static void test_interlock(void) {
    check_interlock(1); /* while homing */
    for (int i = 0; i < 3; i++)
        check_interlock(g_test_rand_double_range(3, 22));
}

/* Frames of a sweep are kept on request; the frames' pixels are those the analysis is made of. */
static void test_keep_laser_frames(void) {
    struct run *run =
        run_new((const struct change[]){{"[capture]", "keep_laser_frames = yes"}, {0}});
    start(run);
    run_to_end(run);
    check_same(run);
    g_autoptr(GPtrArray) frames = frames_in(run->session);
    int n = 0;
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        if (!g_str_has_prefix(frame->path, "laser/"))
            continue;
        g_autofree char *stem = g_strndup(frame->path, strlen(frame->path) - 4);
        g_autofree char *last = g_build_filename(run->session, stem, "0011.exr", NULL);
        g_assert_true(g_file_test(last, G_FILE_TEST_EXISTS));
        n++;
    }
    g_assert_cmpint(n, >, 0);
    run_free(run);
}

static struct exr_part *radiance_of(const char *path, const struct session_shot *shot) {
    g_autoptr(GError) error = NULL;
    g_autofree char *relative = session_frame_path(shot, "cam30");
    g_autofree char *file = g_build_filename(path, relative, NULL);
    struct exr_part *part = exr_read_part(file, "radiance", &error);
    g_assert_no_error(error);
    return part;
}

/* The same radiance in both pictures; noise and black level aside. */
static void check_same_radiance(const char *a_path, const char *b_path,
                                const struct session_shot *shot) {
    struct exr_part *a = radiance_of(a_path, shot), *b = radiance_of(b_path, shot);
    double sums[2] = {0};
    for (int i = 0; i < a->width * a->height; i++) {
        sums[0] += exr_part_plane(a, "Y")[i];
        sums[1] += exr_part_plane(b, "Y")[i];
    }
    g_assert_cmpfloat_with_epsilon(sums[0] / sums[1], 1, 0.02);
    exr_part_free(a);
    exr_part_free(b);
}

/* A bracket far too long: each picture is taken again with shorter exposures until it holds, and
 * says the same as one that was well exposed at once. */
static void test_too_bright(void) {
    struct run *run = run_new((const struct change[]){{"[capture]", "exposures_us = 100000"}, {0}});
    start(run);
    run_to_end(run);
    g_assert_nonnull(strstr(run->told->str, "taken again at 25000 µs"));
    g_assert_null(strstr(run->told->str, "saturated in the shortest exposure"));
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(run->session, SESSION_READ, &error);
    g_autoptr(GPtrArray) shots = session_shots(session, &error);
    int shorter = 0;
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        if (shot->kind != SHOT_LAMP || !(shot->cameras & 1))
            continue;
        struct exr_part *part = radiance_of(run->session, shot);
        const char *exposures = NULL;
        g_assert_true(exr_get_string(part, "mesorig.exposures_us", &exposures, NULL));
        shorter += !g_str_equal(exposures, "100000");
        exr_part_free(part);
        check_same_radiance(run->session, undisturbed(), shot);
    }
    g_assert_cmpint(shorter, >, 0);
    run_free(run);
}

/* Where retaking is not wanted, the picture is kept, and told of. */
static void test_saturated(void) {
    struct run *run = run_new(
        (const struct change[]){{"[capture]", "exposures_us = 400000\nsaturated_pct = 100"}, {0}});
    start(run);
    run_to_end(run);
    g_assert_nonnull(strstr(run->told->str, "saturated in the shortest exposure"));
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(run->session, SESSION_READ, &error);
    g_autoptr(GPtrArray) shots = session_shots(session, &error);
    int noted = 0;
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        noted += shot->note && strstr(shot->note, "saturated: cam30");
    }
    g_assert_cmpint(noted, >, 0);
    run_free(run);
}

int main(int argc, char **argv) {
    if (argc == 3 && g_str_equal(argv[1], "--resume"))
        return resume_in_child(argv[2]);
    g_test_init(&argc, &argv, NULL);
    top = g_dir_make_tmp("mesorig-capture-XXXXXX", NULL);
    g_test_add_func("/capture/whole", test_whole);
    g_test_add_func("/capture/radiance", test_radiance);
    g_test_add_func("/capture/pause", test_pause);
    g_test_add_func("/capture/abort", test_abort);
    g_test_add_func("/capture/resume", test_resume);
    g_test_add_func("/capture/lost-files", test_lost_files);
    g_test_add_func("/capture/locked", test_locked);
    g_test_add_func("/capture/locked-elsewhere", test_locked_elsewhere);
    g_test_add_func("/capture/other-rig", test_other_rig);
    g_test_add_func("/capture/refused", test_refused);
    g_test_add_func("/capture/disk-full", test_disk_full);
    g_test_add_func("/capture/keep-laser-frames", test_keep_laser_frames);
    g_test_add_func("/capture/too-bright", test_too_bright);
    g_test_add_func("/capture/saturated", test_saturated);
    g_test_add_func("/fault/stale-old", test_stale_old);
    g_test_add_func("/fault/stale-relabelled", test_stale_relabelled);
    g_test_add_func("/fault/lost", test_lost);
    g_test_add_func("/fault/slow", test_slow);
    g_test_add_func("/fault/too-slow", test_too_slow);
    g_test_add_func("/fault/disconnect", test_disconnect);
    g_test_add_func("/fault/disconnect-for-long", test_disconnect_for_long);
    g_test_add_func("/fault/stall", test_stall);
    g_test_add_func("/fault/dead-lamp", test_dead_lamp);
    g_test_add_func("/fault/laser-stays-on", test_laser_stays_on);
    g_test_add_func("/fault/deaf-laser", test_deaf_laser);
    g_test_add_func("/fault/interlock", test_interlock);
    int result = g_test_run();
    remove_tree(top);
    g_free(top);
    return result;
}
