#include "session_pairs.h"

#include <math.h>

#define RAD(deg) ((deg) * (G_PI / 180))

static struct vec3 *unit_vectors(const GPtrArray *directions) {
    struct vec3 *ret = g_new(struct vec3, directions->len + 1);
    for (guint i = 0; i < directions->len; i++) {
        const struct session_direction *direction = directions->pdata[i];
        ret[i] = rig_direction(RAD(direction->theta_deg), RAD(direction->phi_deg));
    }
    return ret;
}

static struct vec3 *camera_positions(const struct rig *rig, const GPtrArray *views) {
    struct vec3 *ret = g_new(struct vec3, views->len + 1);
    for (guint v = 0; v < views->len; v++) {
        const struct session_direction *view = views->pdata[v];
        ret[v] =
            rig_turn(rig_camera_centre_mm(&rig->cameras[view->device]), -RAD(view->turntable_deg));
    }
    return ret;
}

static struct vec3 *lamp_positions(const struct rig *rig, const struct vec3 *lights, int n,
                                   const GPtrArray *shots) {
    struct vec3 *ret = g_new(struct vec3, n + 1);
    for (int l = 0; l < n; l++) /* far away, if the light has no shot */
        ret[l] = vec3_scale(lights[l], 1e6);
    for (guint i = shots->len; i-- > 0;) {
        const struct session_shot *shot = shots->pdata[i];
        if (shot->kind == SHOT_LAMP)
            ret[shot->source] = rig_turn(
                rig_lamp_position_mm(&rig->arc, &rig->lamps[shot->device], RAD(shot->arc_deg)),
                -RAD(shot->turntable_deg));
    }
    return ret;
}

/* Sets pair_of and groups. */
static void find_pairs(struct session_pairs *pairs, int *groups, const GPtrArray *views,
                       const GPtrArray *shots) {
    const int n_pairs = session_pairs_n(pairs), n_cameras = pairs->n_cameras;
    pairs->pair_of = g_new(int, (shots->len + 1) * (guint)n_cameras);
    for (int pair = 0; pair < n_pairs; pair++)
        groups[pair] = -1 - pair;
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        for (int c = 0; c < n_cameras; c++) {
            int *pair = &pairs->pair_of[i * (guint)n_cameras + (guint)c];
            *pair = -1;
            for (guint v = 0; v < views->len && shot->kind == SHOT_LAMP; v++) {
                const struct session_direction *view = views->pdata[v];
                if (camera_set_has(shot->cameras, c) && view->device == c &&
                    fabs(remainder(view->turntable_deg - shot->turntable_deg, 360)) < 1e-6)
                    *pair = (int)v * pairs->all.n_lights + shot->source;
            }
            if (*pair >= 0 && shot->state != SHOT_SKIPPED)
                groups[*pair] = (int)i + 1;
        }
    }
}

struct session_pairs *session_pairs_new(const struct rig *rig, const GPtrArray *views,
                                        const GPtrArray *lights, const GPtrArray *shots) {
    struct session_pairs *pairs = g_new0(struct session_pairs, 1);
    const int n_views = (int)views->len, n_lights = (int)lights->len;
    int *groups = g_new(int, n_views *n_lights + 1);
    struct vec3 *of_lights = unit_vectors(lights);
    pairs->n_cameras = rig->n_cameras;
    pairs->all =
        (struct prediction_pairs){.n_views = n_views,
                                  .n_lights = n_lights,
                                  .views = unit_vectors(views),
                                  .lights = of_lights,
                                  .views_mm = camera_positions(rig, views),
                                  .lights_mm = lamp_positions(rig, of_lights, n_lights, shots),
                                  .groups = groups};
    find_pairs(pairs, groups, views, shots);
    return pairs;
}

void session_pairs_free(struct session_pairs *pairs) {
    if (!pairs)
        return;
    g_free((gpointer)pairs->all.views);
    g_free((gpointer)pairs->all.lights);
    g_free((gpointer)pairs->all.views_mm);
    g_free((gpointer)pairs->all.lights_mm);
    g_free((gpointer)pairs->all.groups);
    g_free(pairs->pair_of);
    g_free(pairs);
}

int session_pairs_of(const struct session_pairs *pairs, const struct session_shot *shot,
                     int camera) {
    return shot->kind == SHOT_LAMP && camera < pairs->n_cameras
               ? pairs->pair_of[(shot->id - 1) * pairs->n_cameras + camera]
               : -1;
}
