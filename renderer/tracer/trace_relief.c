#include "trace_relief.h"

static struct vec3 local(const struct trace_hit *hit, struct vec3 d) {
    return vec3(vec3_dot(d, hit->x), vec3_dot(d, hit->y), vec3_dot(d, hit->z));
}

/* Returns whether a ray meets the relief in the half of its way that begins at `end`. half is the
 * length of this half. v is the unit vector along the ray, pointing out of the mesh, in the frame
 * of `end`. */
static gboolean meets_from(const struct trace_hit *end, struct vec3 v, double half) {
    const struct trace_surface *s = end->surface;
    const double u = end->texel.u * s->tiles, down = -end->texel.v * s->tiles;
    const float uv[2] = {(float)(u - floor(u)), (float)(down - floor(down))};
    const float view[3] = {(float)v.x, (float)v.y, (float)v.z}, limit = (float)half;
    float distance;
    return mesorig_material_march(s->material, 1, uv, view, &end->mesh, &limit, &distance) !=
               MESORIG_OK ||
           distance >= 0.0F;
}

/* The frame of `back` has z towards the inside of the mesh, because the ray comes from there. The
 * function turns this z outwards. */
gboolean trace_relief_meets(const struct trace_hit *front, const struct trace_hit *back,
                            struct vec3 direction) {
    const double way = vec3_length(vec3_sub(back->position, front->position));
    const struct vec3 v = local(front, vec3_scale(direction, -1.0));
    struct vec3 w = local(back, direction);
    w.z = -w.z;
    return !(way > 0.0) || !(v.z > 0.0) || !(w.z > 0.0) || meets_from(front, v, 0.5 * way) ||
           meets_from(back, w, 0.5 * way);
}
