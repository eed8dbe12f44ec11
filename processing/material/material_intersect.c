#include "material_private.h"

#include <math.h>
#include <string.h>

#define MIN_SLOPE 0.01 /* lower bound of z of a view in divisions, as in shell_ray.c */

static void hit(const mesorig_material *m, const float *uv, struct vec3 v,
                struct mesorig_hit *ret) {
    double depth = 0, width = 1, height = 1;
    struct vec3 normal = vec3(0, 0, 1);
    if (m->relief) {
        depth = material_relief_depth(m->relief, (double)uv[0], (double)uv[1], v, &normal);
        material_relief_size_mm(m->relief, &width, &height);
    }
    const double distance = depth / MAX(v.z, MIN_SLOPE);
    *ret = (struct mesorig_hit){
        .hit = 1,
        .distance_mm = (float)distance,
        .uv = {(float)((double)uv[0] - distance * v.x / width),
               (float)((double)uv[1] + distance * v.y / height)},
        .normal = {(float)normal.x, (float)normal.y, (float)normal.z},
    };
}

int mesorig_material_intersect(const mesorig_material *m, size_t n, const float *uv,
                               const float *view, struct mesorig_hit *ret) {
    if (!m || (n > 0 && (!uv || !view || !ret)))
        return MESORIG_ERROR_ARGUMENT;
    for (size_t k = 0; k < n; k++) {
        const struct vec3 v = vec3(view[3 * k], view[3 * k + 1], view[3 * k + 2]);
        const double length = vec3_length(v);
        memset(&ret[k], 0, sizeof ret[k]);
        if (isfinite(uv[2 * k]) && isfinite(uv[2 * k + 1]) && isfinite(length) && v.z > 0)
            hit(m, uv + 2 * k, vec3_scale(v, 1 / length), &ret[k]);
    }
    return MESORIG_OK;
}

static float march(const struct mdf_shell *shell, const float *uv, struct vec3 v,
                   const struct mesorig_surface *s, double limit) {
    const struct shell_surface surface = {
        .tile = {(double)s->tile[0], (double)s->tile[1]},
        .bend = {(double)s->bend[0], (double)s->bend[1], (double)s->bend[2]},
        .stretch = {(double)s->stretch[0], (double)s->stretch[1], (double)s->stretch[2],
                    (double)s->stretch[3]},
    };
    struct shell_hit hit;
    return shell_ray_march(shell, &surface, (double)uv[0], (double)uv[1],
                           (const double[]){v.x, v.y, v.z}, limit, &hit)
               ? (float)hit.distance
               : -1.0F;
}

int mesorig_material_march(const mesorig_material *m, size_t n, const float *uv, const float *view,
                           const struct mesorig_surface *surface, const float *limit,
                           float *ret_distance) {
    if (!m || (n > 0 && (!uv || !view || !surface || !ret_distance)))
        return MESORIG_ERROR_ARGUMENT;
    const struct mdf_shell *shell = m->relief ? material_relief_shell(m->relief) : NULL;
    for (size_t k = 0; k < n; k++) {
        const struct vec3 v =
            vec3((double)view[3 * k], (double)view[3 * k + 1], (double)view[3 * k + 2]);
        const double length = vec3_length(v);
        const gboolean valid = isfinite(uv[2 * k]) && isfinite(uv[2 * k + 1]) && isfinite(length) &&
                               v.z > 0 && surface[k].tile[0] > 0 && surface[k].tile[1] > 0;
        const double end = limit ? (double)limit[k] : INFINITY;
        ret_distance[k] =
            !valid  ? -1.0F
            : shell ? march(shell, uv + 2 * k, vec3_scale(v, 1 / length), &surface[k], end)
                    : 0.0F;
    }
    return MESORIG_OK;
}
