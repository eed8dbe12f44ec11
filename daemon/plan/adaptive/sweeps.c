#include "sweeps.h"

#include "selection/coverage_view.h"

#define MAX_MORE 2 /* maximum number of sweeps that join a round at each turntable angle */

/* The sweeps of one turntable angle, and the views that they show. */
struct group {
    GArray *shots; /* of int: indices of shots */
    /* bit i is set if sweep i of the group was done or skipped at the last sweeps_note_done() */
    guint64 done;
    GMutex mutex;                         /* guards the pointers in views */
    CoverageView *views[RIG_MAX_CAMERAS]; /* view of each camera; NULL before its first sweep */
    CoverageModel *models[RIG_MAX_CAMERAS];
};

struct Sweeps {
    Session *session;
    const struct session_conf *conf;
    const GPtrArray *shots;
    const struct rig *rig; /* calibrated */
    Readers *readers;
    GPtrArray *groups;
    GHashTable *group_of; /* maps the index of a shot + 1 (its id) to its struct group */
};

struct sweeps_job { /* a frame of a sweep to be examined */
    const Sweeps *sweeps;
    struct group *group;
    int camera, sweep;
    struct session_shot shot; /* copy of the shot; its note is NULL */
    struct input input;
};

static void free_group(gpointer data) {
    struct group *group = data;
    for (int c = 0; c < RIG_MAX_CAMERAS; c++) {
        coverage_view_free(group->views[c]);
        coverage_model_free(group->models[c]);
    }
    g_array_unref(group->shots);
    g_mutex_clear(&group->mutex);
    g_free(group);
}

static void free_job(gpointer data) {
    struct sweeps_job *job = data;
    input_clear(&job->input);
    g_free(job);
}

/* Adds a frame of a sweep to its view. Runs in a thread of the readers. */
static gboolean sweeps_read(gpointer data, GError **error) {
    struct sweeps_job *job = data;
    CoverageView **view = &job->group->views[job->camera];
    g_mutex_lock(&job->group->mutex);
    if (!*view)
        *view = coverage_view_new(job->sweeps->rig, job->camera, job->shot.turntable_deg,
                                  &job->sweeps->conf->grid);
    g_mutex_unlock(&job->group->mutex);
    return coverage_view_add(*view, job->sweep, &job->shot, &job->input, error);
}

static int sweeps_number(const Sweeps *sweeps, const struct group *group,
                         const struct session_shot *shot) {
    for (guint i = 0; i < group->shots->len; i++)
        if (sweeps->shots->pdata[g_array_index(group->shots, int, i)] == shot)
            return (int)i;
    return -1;
}

void sweeps_take(Sweeps *sweeps, const struct session_shot *shot,
                 const struct session_frame *frames, int n) {
    struct group *group = g_hash_table_lookup(sweeps->group_of, GINT_TO_POINTER((gint)shot->id));
    if (shot->kind != SHOT_SWEEP || !group)
        return;
    const int sweep = sweeps_number(sweeps, group, shot);
    for (int i = 0; i < n; i++) {
        const struct rig_camera *camera = &sweeps->rig->cameras[frames[i].camera];
        struct sweeps_job *job = g_new0(struct sweeps_job, 1);
        *job = (struct sweeps_job){.sweeps = sweeps,
                                   .group = group,
                                   .camera = frames[i].camera,
                                   .sweep = sweep,
                                   .shot = *shot,
                                   .input = {.path = session_file(sweeps->session, frames[i].path),
                                             .sha256 = g_strdup(frames[i].sha256),
                                             .shot = shot->id,
                                             .width = camera->width,
                                             .height = camera->height}};
        job->shot.note = NULL;
        readers_push(sweeps->readers, sweeps_read, free_job, job, frames[i].path);
    }
}

/* Returns the expected gain of a sweep: the share of the texels of a camera's view that the sweep
 * is expected to measure for the first time, averaged over the cameras of the sweep. */
static double sweeps_gain(const Sweeps *sweeps, const struct group *group, int sweep) {
    const struct session_shot *shot = sweeps->shots->pdata[g_array_index(group->shots, int, sweep)];
    double sum = 0;
    for (int c = 0; c < sweeps->rig->n_cameras; c++)
        if (camera_set_has(shot->cameras, c))
            sum += group->views[c] ? coverage_view_expects(group->views[c], group->models[c], sweep)
                                   : coverage_model_lights(group->models[c], 0, 0, sweep);
    return sum / MAX(camera_set_count(shot->cameras), 1);
}

/* Adds the sweeps of a group that join the next round to ret: at most MAX_MORE sweeps, each with a
 * gain of at least [lasers] gain_pct. chosen has the bits of the sweeps that are done. After a
 * sweep has joined, the model lowers the gains of the other sweeps. */
static void choose_group(const Sweeps *sweeps, const struct group *group, guint64 chosen,
                         GArray *ret) {
    const double least = sweeps->conf->laser_gain_pct / 100;
    guint64 joined = chosen;
    double gains[COVERAGE_MAX_SWEEPS];
    for (guint i = 0; i < group->shots->len; i++)
        gains[i] = chosen >> i & 1 ? 0 : sweeps_gain(sweeps, group, (int)i);
    for (int n = 0; n < MAX_MORE; n++) {
        double most = least;
        int best = -1;
        for (guint i = 0; i < group->shots->len; i++) {
            const int number = g_array_index(group->shots, int, i);
            const struct session_shot *shot = sweeps->shots->pdata[number];
            double before = 0, after = 0;
            if (joined >> i & 1)
                continue;
            for (int c = 0; c < sweeps->rig->n_cameras; c++)
                if (camera_set_has(shot->cameras, c)) {
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

void sweeps_note_done(Sweeps *sweeps) {
    for (guint g = 0; g < sweeps->groups->len; g++) {
        struct group *group = sweeps->groups->pdata[g];
        group->done = 0;
        for (guint i = 0; i < group->shots->len; i++) {
            const struct session_shot *shot =
                sweeps->shots->pdata[g_array_index(group->shots, int, i)];
            if (shot->state != SHOT_PLANNED)
                group->done |= (guint64)1 << i;
        }
    }
}

struct sweeps_choice sweeps_choose(const Sweeps *sweeps) {
    struct sweeps_choice ret = {.shots = g_array_new(FALSE, FALSE, sizeof(int))};
    gint64 texels = 0, known = 0;
    double worst = 1;
    for (guint g = 0; g < sweeps->groups->len && !readers_stopped(sweeps->readers); g++) {
        const struct group *group = sweeps->groups->pdata[g];
        for (int c = 0; c < sweeps->rig->n_cameras; c++) {
            if (!group->views[c])
                continue;
            const struct coverage_sums sums = coverage_view_sum_up(group->views[c]);
            texels += sums.texels;
            known += sums.known;
            worst = MIN(worst, (double)sums.known / MAX(sums.texels, 1));
        }
        choose_group(sweeps, group, group->done, ret.shots);
    }
    ret.known_pct = 100.0 * (double)known / (double)MAX(texels, 1);
    ret.worst_pct = 100 * worst;
    return ret;
}

Sweeps *sweeps_new(Session *session, const struct session_conf *conf, const GPtrArray *all,
                   const struct rig *rig, Readers *readers) {
    const struct session_shot *const *shots = (const struct session_shot *const *)all->pdata;
    g_autoptr(GPtrArray) groups = plan_sweep_groups(shots, (int)all->len);
    Sweeps *sweeps = g_new0(Sweeps, 1);
    sweeps->session = session;
    sweeps->conf = conf;
    sweeps->shots = all;
    sweeps->rig = rig;
    sweeps->readers = readers;
    sweeps->groups = g_ptr_array_new_with_free_func(free_group);
    sweeps->group_of = g_hash_table_new(NULL, NULL);
    for (guint g = 0; g < groups->len; g++) {
        struct group *group = g_new0(struct group, 1);
        group->shots = g_array_ref(groups->pdata[g]);
        g_mutex_init(&group->mutex);
        g_ptr_array_add(sweeps->groups, group);
        for (guint i = 0; i < group->shots->len; i++) {
            const int number = g_array_index(group->shots, int, i);
            g_hash_table_insert(sweeps->group_of, GINT_TO_POINTER(number + 1), group);
            for (int c = 0; c < rig->n_cameras; c++)
                if (!group->models[c] && camera_set_has(shots[number]->cameras, c))
                    group->models[c] = plan_sweep_model(rig, c, shots, group->shots);
        }
    }
    return sweeps;
}

void sweeps_free(Sweeps *sweeps) {
    if (!sweeps)
        return;
    g_hash_table_unref(sweeps->group_of);
    g_ptr_array_unref(sweeps->groups);
    g_free(sweeps);
}
