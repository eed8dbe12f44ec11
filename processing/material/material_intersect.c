#include "material_private.h"

#include <math.h>
#include <string.h>

#define MIN_SLOPE 0.01 /* minimum slope of rays, as in renderer/shaders/relief.glsl */

/* D (x, y) is the depth of the ray below the reference plane for one view v. The distance is D /
 * v_z, and the surface is P (x, y) = (x, y, 0) − v D / v_z. Its normal is along ∂P/∂x × ∂P/∂y =
 * (D_x, D_y, 1 − (v_x D_x + v_y D_y) / v_z). The product of this vector with v is v_z, so that it
 * faces the eye. */
static void hit(const mesorig_material *m, const float *uv, struct vec3 v,
                struct mesorig_hit *ret) {
    double depth = 0, slope[2] = {0, 0}, width = 1, height = 1;
    const double down = MAX(v.z, MIN_SLOPE);
    const double view[3] = {v.x, v.y, v.z};
    if (m->relief) {
        depth = material_relief_depth(m->relief, uv[0], uv[1], view, slope);
        material_relief_size_mm(m->relief, &width, &height);
    }
    const double distance = depth / down;
    const struct vec3 normal =
        vec3_unit(vec3(slope[0], slope[1], 1 - (v.x * slope[0] + v.y * slope[1]) / down));
    *ret = (struct mesorig_hit){
        .hit = 1,
        .distance_mm = (float)distance,
        .uv = {(float)(uv[0] - distance * v.x / width), (float)(uv[1] + distance * v.y / height)},
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
