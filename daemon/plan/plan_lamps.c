/* Chooses the shots of lamps that come first ([lights] sampling = adaptive). They are a sparse set,
 * spread over all pairs of directions. The set depends only on the rig and the session's
 * directions, so that it is the same for every material.
 *
 * The distance of two pairs of a view v and a light l is d² = |v − v'|² + |l − l'|², of unit
 * vectors in the sample's frame. Shots are added one after the other. The next shot is the one
 * with the largest reduction, per second of its time, of the sum of d² from every pair to the
 * nearest pair that is taken (the greedy solution of the k-medoids problem). A longer list
 * therefore begins with the shots of a shorter one. */
#include "plan_private.h"

#include <math.h>
#include <string.h>

#define RAD(deg) ((deg) * (G_PI / 180))
/* Maximum number of pairs over which distances are summed. If there are more pairs, every step-th
 * one is used. */
#define MAX_TARGETS 4096
#define FARTHEST    16.0f /* d² before any shot is taken; the maximum between two pairs is 8 */

struct spread {
    const struct rig *rig;
    const struct session_shot *const *shots;
    int n_shots;
    /* of struct vec3: unit vectors in the sample's frame; a view belongs to a turntable angle and
     * a camera */
    GArray *views, *lights;
    /* n_shots × cameras: index of the view; −1 if the camera takes no picture in the shot */
    int *view_of;
    float *view_d2, *light_d2;
    /* The targets, which are at most MAX_TARGETS of the pairs. Those of view v, in order of their
     * lights, are first_of[v] … first_of[v + 1] − 1. */
    int *first_of, *light_of;
    float *nearest; /* for each target: d² to the nearest pair that is taken */
    float *widest;  /* for each view: the maximum of nearest over its targets */
};

static gboolean plan_lamps_wanted(const struct session_shot *shot) {
    return shot->kind == SHOT_LAMP && shot->state != SHOT_SKIPPED;
}

static float *distances(const GArray *directions) {
    const guint n = directions->len;
    float *d2 = g_new(float, (gsize)n *n + 1);
    for (guint i = 0; i < n; i++)
        for (guint k = 0; k < n; k++) {
            const struct vec3 between = vec3_sub(g_array_index(directions, struct vec3, i),
                                                 g_array_index(directions, struct vec3, k));
            d2[i * n + k] = (float)vec3_dot(between, between);
        }
    return d2;
}

static int plan_lamps_view(struct spread *s, GHashTable *known, const struct session_shot *shot,
                           int camera) {
    const gint64 key = llround(shot->turntable_deg * UDEG) * RIG_MAX_CAMERAS + camera;
    int at = GPOINTER_TO_INT(g_hash_table_lookup(known, &key)) - 1;
    if (at < 0) {
        const struct vec3 eye = rig_camera_centre_mm(&s->rig->cameras[camera]);
        const struct vec3 view = rig_turn(vec3_unit(eye), -RAD(shot->turntable_deg));
        at = (int)s->views->len;
        g_array_append_val(s->views, view);
        g_hash_table_insert(known, g_memdup2(&key, sizeof key), GINT_TO_POINTER(at + 1));
    }
    return at;
}

/* Adds the directions of all views and lights of the shots. The direction of a light is that of the
 * first shot with this light. In other shots it differs at most by the shift of the arc. */
static void add_directions(struct spread *s) {
    g_autoptr(GHashTable) known = g_hash_table_new_full(g_int64_hash, g_int64_equal, g_free, NULL);
    s->view_of = g_new0(int, (gsize)s->n_shots *(gsize)s->rig->n_cameras + 1);
    for (int i = 0; i < s->n_shots; i++) {
        const struct session_shot *shot = s->shots[i];
        for (int c = 0; c < s->rig->n_cameras; c++)
            s->view_of[i * s->rig->n_cameras + c] =
                plan_lamps_wanted(shot) && camera_set_has(shot->cameras, c)
                    ? plan_lamps_view(s, known, shot, c)
                    : -1;
        if (!plan_lamps_wanted(shot))
            continue;
        if ((int)s->lights->len <= shot->source)
            g_array_set_size(s->lights, (guint)shot->source + 1);
        struct vec3 *light = &g_array_index(s->lights, struct vec3, shot->source);
        if (vec3_length(*light) > 0)
            continue;
        const struct vec3 lamp_mm =
            rig_lamp_position_mm(&s->rig->arc, &s->rig->lamps[shot->device], RAD(shot->arc_deg));
        *light = rig_turn(vec3_unit(lamp_mm), -RAD(shot->turntable_deg));
    }
}

/* Every step-th pair is a target. */
static void add_targets(struct spread *s) {
    const guint n_views = s->views->len, n_lights = s->lights->len;
    const gsize n = (gsize)s->n_shots * (gsize)s->rig->n_cameras;
    g_autofree gboolean *is_target = g_new0(gboolean, (gsize)n_views * n_lights + 1);
    int pairs = 0, k = 0, n_targets = 0;
    for (gsize i = 0; i < n; i++)
        pairs += s->view_of[i] >= 0;
    const int step = MAX(1, (pairs + MAX_TARGETS - 1) / MAX_TARGETS);
    for (gsize i = 0; i < n; i++)
        if (s->view_of[i] >= 0 && k++ % step == 0)
            is_target[(gsize)s->view_of[i] * n_lights +
                      (gsize)s->shots[i / (gsize)s->rig->n_cameras]->source] = TRUE;
    s->first_of = g_new0(int, n_views + 1);
    s->light_of = g_new(int, pairs / step + 1);
    s->nearest = g_new(float, pairs / step + 1);
    s->widest = g_new0(float, n_views + 1);
    for (guint v = 0; v < n_views; v++) {
        for (guint l = 0; l < n_lights; l++)
            if (is_target[(gsize)v * n_lights + l]) {
                s->light_of[n_targets] = (int)l;
                s->nearest[n_targets++] = s->widest[v] = FARTHEST;
            }
        s->first_of[v + 1] = n_targets;
    }
}

static void clear(struct spread *s) {
    g_array_unref(s->views);
    g_array_unref(s->lights);
    g_free(s->view_of);
    g_free(s->view_d2);
    g_free(s->light_d2);
    g_free(s->first_of);
    g_free(s->light_of);
    g_free(s->nearest);
    g_free(s->widest);
}

/* Returns the amount by which taking a pair reduces the sum of d² over the targets. */
static double pair_gain(const struct spread *s, int view, int light) {
    const guint n_views = s->views->len, n_lights = s->lights->len;
    const float *to_light = s->light_d2 + (gsize)light * n_lights;
    double sum = 0;
    for (guint v = 0; v < n_views; v++) {
        const float to_view = s->view_d2[(gsize)view * n_views + v];
        float row = 0;
        if (to_view >= s->widest[v])
            continue;
        for (int t = s->first_of[v]; t < s->first_of[v + 1]; t++)
            row += MAX(s->nearest[t] - to_view - to_light[s->light_of[t]], 0.0f);
        sum += (double)row;
    }
    return sum;
}

static void take_pair(struct spread *s, int view, int light) {
    const guint n_views = s->views->len, n_lights = s->lights->len;
    const float *to_light = s->light_d2 + (gsize)light * n_lights;
    for (guint v = 0; v < n_views; v++) {
        const float to_view = s->view_d2[(gsize)view * n_views + v];
        s->widest[v] = 0;
        for (int t = s->first_of[v]; t < s->first_of[v + 1]; t++) {
            s->nearest[t] = MIN(s->nearest[t], to_view + to_light[s->light_of[t]]);
            s->widest[v] = MAX(s->widest[v], s->nearest[t]);
        }
    }
}

static double gain(const struct spread *s, int shot) {
    const int *views = s->view_of + (gsize)shot * (gsize)s->rig->n_cameras;
    double sum = 0;
    for (int c = 0; c < s->rig->n_cameras; c++)
        if (views[c] >= 0)
            sum += pair_gain(s, views[c], s->shots[shot]->source);
    return sum;
}

static void take(struct spread *s, int shot) {
    const int *views = s->view_of + (gsize)shot * (gsize)s->rig->n_cameras;
    for (int c = 0; c < s->rig->n_cameras; c++)
        if (views[c] >= 0)
            take_pair(s, views[c], s->shots[shot]->source);
}

static gboolean same_pose(const struct session_shot *a, const struct session_shot *b) {
    return llround(a->turntable_deg * UDEG) == llround(b->turntable_deg * UDEG) &&
           llround(a->arc_deg * UDEG) == llround(b->arc_deg * UDEG);
}

void plan_lamp_prices_s(const struct session_conf *conf, const struct rig *rig,
                        const struct rig_timing *timing, const struct session_shot *const *shots,
                        int n, double *ret_s) {
    g_autoptr(GArray) poses = g_array_new(FALSE, FALSE, sizeof(int)); /* one shot of each pose */
    g_autofree int *pose_of = g_new0(int, n + 1);
    for (int i = 0; i < n; i++) {
        pose_of[i] = -1;
        for (guint p = 0; p < poses->len && plan_lamps_wanted(shots[i]) && pose_of[i] < 0; p++)
            if (same_pose(shots[g_array_index(poses, int, p)], shots[i]))
                pose_of[i] = (int)p;
        if (pose_of[i] < 0 && plan_lamps_wanted(shots[i])) {
            pose_of[i] = (int)poses->len;
            g_array_append_val(poses, i);
        }
    }
    g_autofree double *move_s = g_new0(double, poses->len + 1);
    for (guint p = 0; p < poses->len; p++) {
        move_s[p] = poses->len > 1 ? G_MAXDOUBLE : 0;
        for (guint q = 0; q < poses->len; q++)
            if (q != p)
                move_s[p] = MIN(move_s[p], plan_shots_move_s(shots[g_array_index(poses, int, q)],
                                                             shots[g_array_index(poses, int, p)],
                                                             rig, timing));
    }
    for (int i = 0; i < n; i++)
        ret_s[i] = pose_of[i] < 0
                       ? 0
                       : plan_shot_s(shots[i], conf, timing) +
                             MAX(plan_lead_s(NULL, shots[i], rig, timing), move_s[pose_of[i]]);
}

/* Returns the time that a shot of a lamp takes directly after another one: with a stop or, if that
 * is quicker, in the same pass. */
static double after_s(const struct session_conf *conf, const struct rig *rig,
                      const struct rig_timing *timing, const struct session_shot *before,
                      const struct session_shot *shot) {
    const double standing_s =
        MAX(plan_lead_s(before, shot, rig, timing), plan_shots_move_s(before, shot, rig, timing));
    return MIN(plan_shot_s(shot, conf, timing) + standing_s,
               passes_after_s(before, shot, conf, rig, timing));
}

int plan_lamp_chain(const struct session_conf *conf, const struct rig *rig,
                    const struct rig_timing *timing, const struct session_shot *const *shots, int n,
                    int most, int *chain, double *ret_s) {
    int length = 1;
    *ret_s = 0;
    while (length < most) {
        double min_s = G_MAXDOUBLE;
        int best = -1;
        for (int i = 0; i < n; i++) {
            gboolean in = FALSE;
            for (int k = 0; k < length; k++)
                in |= chain[k] == i;
            const double s =
                in ? min_s : after_s(conf, rig, timing, shots[chain[length - 1]], shots[i]);
            if (s < min_s) {
                min_s = s;
                best = i;
            }
        }
        if (best < 0)
            break;
        chain[length++] = best;
        *ret_s += min_s;
    }
    return length;
}

/* Returns the shot with the largest ratio of gain to price, or the first of several such shots; −1
 * if no shot is left. Gains decrease with each shot that is taken (submodularity). A gain that was
 * computed earlier is therefore an upper bound, and only the largest bound is computed again
 * (Minoux 1978). */
static int plan_lamps_best(const struct spread *s, const gboolean *taken, const double *price_s,
                           double *gains) {
    int fresh = -1;
    for (;;) {
        double most = 0;
        int best = -1;
        for (int i = 0; i < s->n_shots; i++) {
            const double rate = gains[i] / MAX(price_s[i], 1e-6);
            if (!taken[i] && plan_lamps_wanted(s->shots[i]) && (best < 0 || rate > most)) {
                most = rate;
                best = i;
            }
        }
        if (best == fresh)
            return best;
        gains[best] = gain(s, best);
        fresh = best;
    }
}

/* Sets ret_first of up to `wanted` shots, one after the other. The next shot is always the one with
 * the largest ratio of gain to price. When a shot has been taken, the price of any other shot is at
 * most the time that it needs directly after that shot. */
static void choose(struct spread *s, const struct session_conf *conf,
                   const struct rig_timing *timing, int wanted, gboolean *ret_first) {
    g_autofree double *price_s = g_new(double, s->n_shots + 1);
    g_autofree double *gains = g_new0(double, s->n_shots + 1);
    plan_lamp_prices_s(conf, s->rig, timing, s->shots, s->n_shots, price_s);
    for (int i = 0; i < s->n_shots; i++)
        if (plan_lamps_wanted(s->shots[i]))
            gains[i] = gain(s, i);
    for (int n = 0; n < wanted; n++) {
        const int best = plan_lamps_best(s, ret_first, price_s, gains);
        if (best < 0)
            return;
        ret_first[best] = TRUE;
        take(s, best);
        for (int i = 0; i < s->n_shots; i++)
            if (plan_lamps_wanted(s->shots[i]))
                price_s[i] =
                    MIN(price_s[i], after_s(conf, s->rig, timing, s->shots[best], s->shots[i]));
    }
}

void plan_first_lamps(const struct session_conf *conf, const struct rig *rig,
                      const struct rig_timing *timing, const struct session_shot *const *shots,
                      int n, gboolean *ret_first) {
    struct spread s = {.rig = rig, .shots = shots, .n_shots = n};
    if (conf->light_sampling == SAMPLING_ALL)
        return;
    g_autoptr(GHashTable) turns = g_hash_table_new_full(g_int64_hash, g_int64_equal, g_free, NULL);
    for (int i = 0; i < n; i++) {
        const gint64 udeg = llround(shots[i]->turntable_deg * UDEG);
        if (shots[i]->kind != SHOT_LAMP)
            continue;
        ret_first[i] = FALSE;
        if (plan_lamps_wanted(shots[i]))
            g_hash_table_add(turns, g_memdup2(&udeg, sizeof udeg));
    }
    s.views = g_array_new(FALSE, TRUE, sizeof(struct vec3));
    s.lights = g_array_new(FALSE, TRUE, sizeof(struct vec3));
    add_directions(&s);
    s.view_d2 = distances(s.views);
    s.light_d2 = distances(s.lights);
    add_targets(&s);
    choose(&s, conf, timing, (int)g_hash_table_size(turns) * conf->light_first, ret_first);
    clear(&s);
}
