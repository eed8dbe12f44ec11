#include "adaptive.h"

#include <stdlib.h>
#include <string.h>

#include "base/data_error.h"
#include "coverage/coverage_view.h"

#define ROUND_KEY "lasers.round."
#define MOST_MORE 2 /* sweeps that join a round, at each turntable angle */
#define N_THREADS 2 /* that read files beside the capture */

/* The sweeps of one turntable angle, and the views that they show. */
struct group {
    GArray *shots;                        /* of int: numbers of shots */
    GMutex mutex;                         /* guards which views there are */
    CoverageView *views[RIG_MAX_CAMERAS]; /* NULL: nothing was taken of it */
    CoverageModel *models[RIG_MAX_CAMERAS];
};

struct adaptive_job { /* a file to be examined */
    struct group *group;
    int camera, sweep;
    struct session_shot shot; /* without its note */
    struct input input;
};

struct choice {
    GArray *shots; /* of int: numbers of shots that join */
    double known_pct, worst_pct;
    char *message;
    GError *error;
};

struct Adaptive {
    Session *session;
    const struct session_conf *conf;
    const GPtrArray *shots;
    struct rig rig; /* calibrated */
    Clock *clock;
    struct adaptive_hooks hooks;
    GPtrArray *groups;
    GHashTable *group_of; /* number of a shot + 1 → struct group */
    int *round_of;        /* of each shot: number + 1; 0: none */
    int n_rounds;
    gboolean over;
    GThreadPool *readers;
    GMutex mutex;
    GCond idle;
    int n_reading;         /* guarded by mutex */
    GError *error;         /* the first of a reader; guarded by mutex */
    guint64 *taken;        /* of each group, while a choice is made: sweeps that are done */
    GThread *thread;       /* while a choice is made */
    struct choice *choice; /* its result */
    GSource *wake;         /* when that is there */
    int stopped;           /* by adaptive_free(); atomic */
};

static void adaptive_free_group(gpointer data) {
    struct group *group = data;
    for (int c = 0; c < RIG_MAX_CAMERAS; c++) {
        coverage_view_free(group->views[c]);
        coverage_model_free(group->models[c]);
    }
    g_array_unref(group->shots);
    g_mutex_clear(&group->mutex);
    g_free(group);
}

static void adaptive_free_job(struct adaptive_job *job) {
    input_clear(&job->input);
    g_free(job);
}

/* A reader's thread. */
static void adaptive_read(gpointer data, gpointer adaptive_data) {
    struct adaptive_job *job = data;
    Adaptive *adaptive = adaptive_data;
    g_autoptr(GError) error = NULL;
    if (!g_atomic_int_get(&adaptive->stopped)) {
        CoverageView **view = &job->group->views[job->camera];
        g_mutex_lock(&job->group->mutex);
        if (!*view)
            *view = coverage_view_new(&adaptive->rig, job->camera, job->shot.turntable_deg,
                                      &adaptive->conf->grid);
        g_mutex_unlock(&job->group->mutex);
        coverage_view_add(*view, job->sweep, &job->shot, &job->input, &error);
    }
    adaptive_free_job(job);
    g_mutex_lock(&adaptive->mutex);
    if (error && !adaptive->error)
        adaptive->error = g_steal_pointer(&error);
    if (--adaptive->n_reading == 0)
        g_cond_broadcast(&adaptive->idle);
    g_mutex_unlock(&adaptive->mutex);
}

/* Any thread's but a reader's. */
static void adaptive_wait_for_readers(Adaptive *adaptive) {
    g_mutex_lock(&adaptive->mutex);
    while (adaptive->n_reading > 0)
        g_cond_wait(&adaptive->idle, &adaptive->mutex);
    g_mutex_unlock(&adaptive->mutex);
}

gboolean adaptive_is_chosen(const Adaptive *adaptive, const struct session_shot *shot) {
    return shot->kind != SHOT_SWEEP || adaptive->round_of[shot->id - 1] != 0;
}

gboolean adaptive_is_over(const Adaptive *adaptive) {
    return adaptive->over;
}

static int adaptive_sweep_of(const Adaptive *adaptive, const struct group *group,
                             const struct session_shot *shot) {
    for (guint i = 0; i < group->shots->len; i++)
        if (adaptive->shots->pdata[g_array_index(group->shots, int, i)] == shot)
            return (int)i;
    return -1;
}

void adaptive_take(Adaptive *adaptive, const struct session_shot *shot,
                   const struct session_frame *frames, int n) {
    struct group *group = g_hash_table_lookup(adaptive->group_of, GINT_TO_POINTER((gint)shot->id));
    if (shot->kind != SHOT_SWEEP || !group || adaptive->over)
        return;
    const int sweep = adaptive_sweep_of(adaptive, group, shot);
    for (int i = 0; i < n; i++) {
        const struct rig_camera *camera = &adaptive->rig.cameras[frames[i].camera];
        struct adaptive_job *job = g_new0(struct adaptive_job, 1);
        *job =
            (struct adaptive_job){.group = group,
                                  .camera = frames[i].camera,
                                  .sweep = sweep,
                                  .shot = *shot,
                                  .input = {.path = session_file(adaptive->session, frames[i].path),
                                            .sha256 = g_strdup(frames[i].sha256),
                                            .shot = shot->id,
                                            .width = camera->width,
                                            .height = camera->height}};
        job->shot.note = NULL;
        g_mutex_lock(&adaptive->mutex);
        adaptive->n_reading++;
        g_mutex_unlock(&adaptive->mutex);
        g_thread_pool_push(adaptive->readers, job, NULL);
        /* In lockstep nothing overlaps, neither readers with each other nor with what the main loop
         * writes: their calls to the disk come in the same order in each run. */
        if (clock_is_lockstep(adaptive->clock))
            adaptive_wait_for_readers(adaptive);
    }
}

/* The expected gain of a sweep: it makes a share of the texels of each camera's view known, and the
 * gain is the mean of these shares. */
static double adaptive_gain(const Adaptive *adaptive, const struct group *group, int sweep) {
    const struct session_shot *shot =
        adaptive->shots->pdata[g_array_index(group->shots, int, sweep)];
    double sum = 0;
    for (int c = 0; c < adaptive->rig.n_cameras; c++)
        if (shot->cameras & 1u << c)
            sum += group->views[c] ? coverage_view_expects(group->views[c], group->models[c], sweep)
                                   : coverage_model_lights(group->models[c], 0, 0, sweep);
    return sum / MAX(__builtin_popcount(shot->cameras), 1);
}

/* Adds the sweeps of a group that join the next round to ret. When one has joined, the gain of each
 * other sweep is lowered by the share by which the model lowers it. */
static void adaptive_choose_group(const Adaptive *adaptive, const struct group *group,
                                  guint64 chosen, GArray *ret) {
    const double least = adaptive->conf->laser_gain_pct / 100;
    guint64 joined = chosen;
    double gains[COVERAGE_MAX_SWEEPS];
    for (guint i = 0; i < group->shots->len; i++)
        gains[i] = chosen >> i & 1 ? 0 : adaptive_gain(adaptive, group, (int)i);
    for (int n = 0; n < MOST_MORE; n++) {
        double most = least;
        int best = -1;
        for (guint i = 0; i < group->shots->len; i++) {
            const int number = g_array_index(group->shots, int, i);
            const struct session_shot *shot = adaptive->shots->pdata[number];
            double before = 0, after = 0;
            if (joined >> i & 1)
                continue;
            for (int c = 0; c < adaptive->rig.n_cameras; c++)
                if (shot->cameras & 1u << c) {
                    before += coverage_model_adds(group->models[c], chosen, (int)i);
                    after += coverage_model_adds(group->models[c], joined, (int)i);
                }
            const double gain = before > 0 ? gains[i] * after / before : 0;
            if (gain >= most) {
                most = gain;
                best = (int)i;
            }
        }
        if (best < 0)
            return;
        joined |= (guint64)1 << best;
        const int number = g_array_index(group->shots, int, best);
        g_array_append_val(ret, number);
    }
}

static void adaptive_free_choice(struct choice *choice) {
    if (!choice)
        return;
    g_array_unref(choice->shots);
    g_free(choice->message);
    g_clear_error(&choice->error);
    g_free(choice);
}

/* In a thread of its own, which reads nothing that the main loop may change meanwhile. */
static gpointer adaptive_work_out(gpointer data) {
    Adaptive *adaptive = data;
    struct choice *choice = g_new0(struct choice, 1);
    gint64 texels = 0, known = 0;
    double worst = 1;
    choice->shots = g_array_new(FALSE, FALSE, sizeof(int));
    adaptive_wait_for_readers(adaptive);
    g_mutex_lock(&adaptive->mutex);
    choice->error = g_steal_pointer(&adaptive->error);
    g_mutex_unlock(&adaptive->mutex);
    for (guint g = 0; g < adaptive->groups->len && !choice->error; g++) {
        const struct group *group = adaptive->groups->pdata[g];
        if (g_atomic_int_get(&adaptive->stopped))
            break;
        for (int c = 0; c < adaptive->rig.n_cameras; c++) {
            if (!group->views[c])
                continue;
            const struct coverage_sums sums = coverage_view_sum_up(group->views[c]);
            texels += sums.texels;
            known += sums.known;
            worst = MIN(worst, (double)sums.known / MAX(sums.texels, 1));
        }
        adaptive_choose_group(adaptive, group, adaptive->taken[g], choice->shots);
    }
    choice->known_pct = 100.0 * (double)known / (double)MAX(texels, 1);
    choice->worst_pct = 100 * worst;
    choice->message = g_strdup_printf("%.2f %% of what the cameras see of the reference plane is "
                                      "known after %d round%s of sweeps, %.1f %% in the worst view",
                                      choice->known_pct, adaptive->n_rounds,
                                      adaptive->n_rounds == 1 ? "" : "s", choice->worst_pct);
    adaptive->choice = choice;
    g_source_set_ready_time(adaptive->wake, 0);
    return NULL;
}

static gboolean adaptive_store(Adaptive *adaptive, const GArray *shots, GError **error) {
    g_autofree char *key = g_strdup_printf(ROUND_KEY "%d", adaptive->n_rounds + 1);
    g_autoptr(GString) text = g_string_new(NULL);
    for (guint i = 0; i < shots->len; i++)
        g_string_append_printf(text, "%s%d", i ? " " : "", g_array_index(shots, int, i) + 1);
    if (!session_set_value(adaptive->session, key, text->str, error))
        return FALSE;
    adaptive->n_rounds++;
    for (guint i = 0; i < shots->len; i++)
        adaptive->round_of[g_array_index(shots, int, i)] = adaptive->n_rounds;
    adaptive->over = shots->len == 0;
    return TRUE;
}

/* Marks the shots of no round as skipped. Their states may have been stored before a kill. */
static gboolean adaptive_leave_out(Adaptive *adaptive, GError **error) {
    g_autofree char *note =
        g_strdup_printf(ADAPTIVE_LEFT_OUT " expected to add less than %g %% to what its views know",
                        adaptive->conf->laser_gain_pct);
    for (guint i = 0; i < adaptive->shots->len; i++) {
        struct session_shot *shot = adaptive->shots->pdata[i];
        if (shot->state != SHOT_PLANNED || adaptive_is_chosen(adaptive, shot))
            continue;
        if (!session_commit_shot(adaptive->session, shot->id, SHOT_SKIPPED, NULL, 0, note, error))
            return FALSE;
        shot->state = SHOT_SKIPPED;
        g_free(shot->note);
        shot->note = g_strdup(note);
    }
    return TRUE;
}

static gboolean adaptive_say(Adaptive *adaptive, const char *key, double pct, GError **error) {
    char text[G_ASCII_DTOSTR_BUF_SIZE];
    return session_set_value(adaptive->session, key,
                             g_ascii_formatd(text, sizeof text, "%.3f", pct), error);
}

static gboolean adaptive_on_wake(gpointer data) {
    Adaptive *adaptive = data;
    g_autoptr(GError) error = NULL;
    Clock *clock = adaptive->clock;
    g_source_set_ready_time(adaptive->wake, -1);
    if (!adaptive->thread)
        return G_SOURCE_CONTINUE;
    g_thread_join(g_steal_pointer(&adaptive->thread));
    struct choice *choice = g_steal_pointer(&adaptive->choice);
    error = g_steal_pointer(&choice->error);
    const guint n = choice->shots->len;
    const gboolean good = !error &&
                          adaptive_say(adaptive, ADAPTIVE_KNOWN_PCT, choice->known_pct, &error) &&
                          adaptive_say(adaptive, ADAPTIVE_WORST_PCT, choice->worst_pct, &error) &&
                          adaptive_store(adaptive, choice->shots, &error) &&
                          (n > 0 || adaptive_leave_out(adaptive, &error));
    /* The hook may free the object. */
    adaptive->hooks.chosen(good ? (int)n : 0, choice->message, error, adaptive->hooks.data);
    clock_release(clock);
    adaptive_free_choice(choice);
    return G_SOURCE_CONTINUE;
}

static gboolean adaptive_dispatch(GSource *source, GSourceFunc func, gpointer data) {
    return func(data);
}

void adaptive_choose(Adaptive *adaptive) {
    g_return_if_fail(!adaptive->thread && !adaptive->over);
    for (guint g = 0; g < adaptive->groups->len; g++) {
        const struct group *group = adaptive->groups->pdata[g];
        adaptive->taken[g] = 0;
        for (guint i = 0; i < group->shots->len; i++) {
            const struct session_shot *shot =
                adaptive->shots->pdata[g_array_index(group->shots, int, i)];
            if (shot->state != SHOT_PLANNED)
                adaptive->taken[g] |= (guint64)1 << i;
        }
    }
    clock_hold(adaptive->clock);
    adaptive->thread = g_thread_new("sweeps", adaptive_work_out, adaptive);
}

/* Fills round_of with the shots of a stored round: numbers from 1, with spaces between them. */
static gboolean adaptive_load_round(Adaptive *adaptive, const char *text, GError **error) {
    g_auto(GStrv) words = g_strsplit(text, " ", -1);
    adaptive->n_rounds++;
    adaptive->over = !*text;
    for (char **word = words; *text && *word; word++) {
        guint64 number;
        if (!g_ascii_string_to_unsigned(*word, 10, 1, adaptive->shots->len, &number, NULL))
            return data_error_fail(session_path(adaptive->session), 0, error,
                                   "its value " ROUND_KEY "%d names the shot “%s”; it has shots 1 "
                                   "to %u",
                                   adaptive->n_rounds, *word, adaptive->shots->len);
        adaptive->round_of[number - 1] = adaptive->n_rounds;
    }
    return TRUE;
}

/* The rounds that are stored; the first is chosen if there is none. */
static gboolean adaptive_load(Adaptive *adaptive, const struct rig *nominal, GError **error) {
    const guint n = adaptive->shots->len;
    while (!adaptive->over) {
        g_autofree char *key = g_strdup_printf(ROUND_KEY "%d", adaptive->n_rounds + 1);
        g_autofree char *text = NULL;
        /* A round that cannot be read is not one that was never chosen. */
        if (!session_read_value(adaptive->session, key, &text, error))
            return FALSE;
        if (!text)
            break;
        if (!adaptive_load_round(adaptive, text, error))
            return FALSE;
    }
    if (adaptive->over)
        return adaptive_leave_out(adaptive, error);
    if (adaptive->n_rounds > 0)
        return TRUE;
    g_autofree gboolean *first = g_new(gboolean, n + 1);
    g_autoptr(GArray) chosen = g_array_new(FALSE, FALSE, sizeof(int));
    plan_first_sweeps(adaptive->conf, nominal,
                      (const struct session_shot *const *)adaptive->shots->pdata, (int)n, first);
    for (int i = 0; i < (int)n; i++) {
        const struct session_shot *shot = adaptive->shots->pdata[i];
        if (first[i] && shot->kind == SHOT_SWEEP && shot->state != SHOT_SKIPPED)
            g_array_append_val(chosen, i);
    }
    return adaptive_store(adaptive, chosen, error);
}

static void adaptive_add_groups(Adaptive *adaptive) {
    const struct session_shot *const *shots =
        (const struct session_shot *const *)adaptive->shots->pdata;
    g_autoptr(GPtrArray) groups = plan_sweep_groups(shots, (int)adaptive->shots->len);
    for (guint g = 0; g < groups->len; g++) {
        struct group *group = g_new0(struct group, 1);
        group->shots = g_array_ref(groups->pdata[g]);
        g_mutex_init(&group->mutex);
        g_ptr_array_add(adaptive->groups, group);
        for (guint i = 0; i < group->shots->len; i++) {
            const int number = g_array_index(group->shots, int, i);
            g_hash_table_insert(adaptive->group_of, GINT_TO_POINTER(number + 1), group);
            for (int c = 0; c < adaptive->rig.n_cameras; c++)
                if (!group->models[c] && shots[number]->cameras & 1u << c)
                    group->models[c] = plan_sweep_model(&adaptive->rig, c, shots, group->shots);
        }
    }
    adaptive->taken = g_new0(guint64, adaptive->groups->len + 1);
}

/* Sweeps of earlier runs are examined from their files. */
static gboolean adaptive_take_done(Adaptive *adaptive, GError **error) {
    g_autoptr(GPtrArray) frames = session_frames(adaptive->session, error);
    if (!frames)
        return FALSE;
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        const struct session_shot *shot = adaptive->shots->pdata[frame->shot - 1];
        if (shot->state == SHOT_DONE)
            adaptive_take(adaptive, shot, frame, 1);
    }
    return TRUE;
}

Adaptive *adaptive_new(Session *session, const struct session_conf *conf, const GPtrArray *shots,
                       const struct rig *nominal, const struct rig *calibrated, Clock *clock,
                       const struct adaptive_hooks *hooks, GError **error) {
    static GSourceFuncs funcs = {.dispatch = adaptive_dispatch};
    Adaptive *adaptive = g_new0(Adaptive, 1);
    adaptive->session = session;
    adaptive->conf = conf;
    adaptive->shots = shots;
    adaptive->rig = *calibrated;
    adaptive->clock = clock;
    adaptive->hooks = *hooks;
    adaptive->groups = g_ptr_array_new_with_free_func(adaptive_free_group);
    adaptive->group_of = g_hash_table_new(NULL, NULL);
    adaptive->round_of = g_new0(int, shots->len + 1);
    g_mutex_init(&adaptive->mutex);
    g_cond_init(&adaptive->idle);
    adaptive->wake = g_source_new(&funcs, sizeof(GSource));
    g_source_set_callback(adaptive->wake, adaptive_on_wake, adaptive, NULL);
    g_source_attach(adaptive->wake, NULL);
    adaptive->readers = g_thread_pool_new(adaptive_read, adaptive, N_THREADS, FALSE, NULL);
    adaptive_add_groups(adaptive);
    if (!adaptive_load(adaptive, nominal, error) ||
        (!adaptive->over && !adaptive_take_done(adaptive, error)))
        g_clear_pointer(&adaptive, adaptive_free);
    return adaptive;
}

void adaptive_free(Adaptive *adaptive) {
    if (!adaptive)
        return;
    g_atomic_int_set(&adaptive->stopped, TRUE);
    g_thread_pool_free(adaptive->readers, FALSE, TRUE);
    if (adaptive->thread) {
        g_thread_join(adaptive->thread);
        clock_release(adaptive->clock);
    }
    adaptive_free_choice(adaptive->choice);
    g_source_destroy(adaptive->wake);
    g_source_unref(adaptive->wake);
    g_clear_error(&adaptive->error);
    g_hash_table_unref(adaptive->group_of);
    g_ptr_array_unref(adaptive->groups);
    g_free(adaptive->round_of);
    g_free(adaptive->taken);
    g_mutex_clear(&adaptive->mutex);
    g_cond_clear(&adaptive->idle);
    g_free(adaptive);
}
