/* Chooses the laser sweeps of the first round, and computes the number of steps of a sweep. */
#include "plan_private.h"

#include "mdf/mdf.h"

#include <math.h>

#define RAD(deg) ((deg) * (G_PI / 180))
/* turntable angles are compared in steps of 1/ANGLES_PER_DEG degrees */
#define ANGLES_PER_DEG   10000
#define FRAMES_PER_WIDTH 1.75 /* steps of a sweep per full width of the line */
#define MIN_STEPS        24
#define SHARPNESS        4 /* q = (w / max w)^SHARPNESS: see plan_sweep_model() */

static gint64 plan_sweeps_angle(const struct session_shot *shot) {
    const gint64 turn = (gint64)360 * ANGLES_PER_DEG;
    const gint64 angle = llround(remainder(shot->turntable_deg, 360) * ANGLES_PER_DEG);

    return (angle % turn + turn) % turn;
}

/* Sorts by turntable angle, then laser position, then cameras. The result does not depend on the
 * order of the shots. */
static int compare(gconstpointer a, gconstpointer b, gpointer data) {
    const struct session_shot *const *shots = data;
    const struct session_shot *s = shots[*(const int *)a], *t = shots[*(const int *)b];
    const gint64 x = plan_sweeps_angle(s), y = plan_sweeps_angle(t);

    if (x != y)
        return x < y ? -1 : 1;
    if (s->source != t->source)
        return s->source - t->source;
    return camera_set_compare(s->cameras, t->cameras);
}

GPtrArray *plan_sweep_groups(const struct session_shot *const *shots, int n) {
    GPtrArray *groups = g_ptr_array_new_with_free_func((GDestroyNotify)g_array_unref);
    g_autoptr(GArray) all = g_array_new(FALSE, FALSE, sizeof(int));
    GArray *group = NULL;

    for (int i = 0; i < n; i++)
        if (shots[i]->kind == SHOT_SWEEP)
            g_array_append_val(all, i);
    g_array_sort_with_data(all, compare, (gpointer)shots);
    for (guint i = 0; i < all->len; i++) {
        const int at = g_array_index(all, int, i);
        const int before = i > 0 ? g_array_index(all, int, i - 1) : -1;
        if (before < 0 || plan_sweeps_angle(shots[before]) != plan_sweeps_angle(shots[at])) {
            group = g_array_new(FALSE, FALSE, sizeof(int));
            g_ptr_array_add(groups, group);
        }
        if (group->len < COVERAGE_MAX_SWEEPS)
            g_array_append_val(group, at);
    }
    return groups;
}

CoverageModel *plan_sweep_model(const struct rig *rig, int camera,
                                const struct session_shot *const *shots, const GArray *group) {
    const struct vec3 eye = rig_camera_centre_mm(&rig->cameras[camera]);
    struct vec3 lasers[COVERAGE_MAX_SWEEPS];
    double quality[COVERAGE_MAX_SWEEPS], most = 0;

    for (guint i = 0; i < group->len; i++) {
        const struct session_shot *shot = shots[g_array_index(group, int, i)];
        const struct rig_laser *laser = &rig->lasers[shot->device];
        lasers[i] = vec3_unit(rig_laser_position_mm(&rig->arc, laser, RAD(shot->arc_deg)));
        quality[i] = mdf_weight(&rig->arc, laser, RAD(shot->arc_deg), eye);
        most = MAX(most, quality[i]);
    }
    for (guint i = 0; i < group->len; i++)
        quality[i] = most > 0 ? pow(quality[i] / most, SHARPNESS) : 1;
    return coverage_model_new(vec3_unit(eye), lasers, quality, (int)group->len);
}

/* Sets ret_first of the sweeps of one turntable angle that belong to the first round. Skipped
 * sweeps do not. */
static void choose(const struct session_conf *conf, const struct rig *rig,
                   const struct session_shot *const *shots, const GArray *group,
                   gboolean *ret_first) {
    CoverageModel *models[RIG_MAX_CAMERAS] = {0};
    guint64 taken = 0;

    for (guint i = 0; i < group->len; i++)
        for (int c = 0; c < rig->n_cameras; c++)
            if (!models[c] && camera_set_has(shots[g_array_index(group, int, i)]->cameras, c))
                models[c] = plan_sweep_model(rig, c, shots, group);
    for (int round = 0; round < conf->laser_first; round++) {
        double most = 0;
        int best = -1;
        for (guint i = 0; i < group->len; i++) {
            const struct session_shot *shot = shots[g_array_index(group, int, i)];
            double sum = 0;
            if (taken >> i & 1 || shot->state == SHOT_SKIPPED)
                continue;
            for (int c = 0; c < rig->n_cameras; c++)
                if (camera_set_has(shot->cameras, c))
                    sum += coverage_model_adds(models[c], taken, (int)i);
            if (sum > most) {
                most = sum;
                best = (int)i;
            }
        }
        if (best < 0)
            break;
        taken |= (guint64)1 << best;
        ret_first[g_array_index(group, int, best)] = TRUE;
    }
    for (int c = 0; c < rig->n_cameras; c++)
        coverage_model_free(models[c]);
}

void plan_first_sweeps(const struct session_conf *conf, const struct rig *rig,
                       const struct session_shot *const *shots, int n, gboolean *ret_first) {
    g_autoptr(GPtrArray) groups = NULL;

    for (int i = 0; i < n; i++)
        ret_first[i] = shots[i]->kind != SHOT_SWEEP || conf->laser_stop == STOP_ALL;
    if (conf->laser_stop == STOP_ALL)
        return;
    groups = plan_sweep_groups(shots, n);
    for (guint g = 0; g < groups->len; g++)
        choose(conf, rig, shots, groups->pdata[g], ret_first);
}

/* The line is line_mm wide at the origin, so that its width seen from the laser is the angle
 * line_mm / distance. Steps finer than this angle / FRAMES_PER_WIDTH give no more information. */
int plan_sweep_steps(const struct session_conf *conf, const struct rig_laser *laser,
                     double span_deg) {
    const double distance_mm = vec3_length(laser->position_mm);

    if (!(conf->laser_line_mm > 0) || !(distance_mm > 0))
        return conf->sweep_steps;
    const double step_rad = conf->laser_line_mm / distance_mm / FRAMES_PER_WIDTH;
    const double steps = ceil(RAD(span_deg) / step_rad) + 1;
    return (int)CLAMP(steps, MIN(MIN_STEPS, conf->sweep_steps), conf->sweep_steps);
}
