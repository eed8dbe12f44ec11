#include "trace_relief.h"

#include <math.h>

#define CHORDS    3
#define MIN_SLOPE 0.01 /* smallest slope of rays, as in the library */

/* Returns whether the half of the ray at one end meets the relief. v is the unit vector along the
 * ray, pointing out of the mesh, in the frame of that end. way is the distance to the other end. A
 * chord lies below the parabola's arc, so a hit of the chord before its end is also a hit of the
 * ray. If the ray goes deeper than the whole relief, it meets the relief in any case. */
static gboolean meets_from(const struct trace_hit *end, struct vec3 v, double way) {
    const struct trace_surface *s = end->surface;
    const double slope = fmax(v.z, MIN_SLOPE), bend = 2.0 * slope / way;
    /* Lengths in the scene of one mm of the sample along x, y and z. */
    const double x_mm = end->unit[0] / s->tiles / s->relief.tile_mm[0];
    const double y_mm = end->unit[1] / s->tiles / s->relief.tile_mm[1];
    const double z_mm = sqrt(x_mm * y_mm), deepest = s->relief.deepest_mm * z_mm;
    const double root = slope * slope - 2.0 * bend * deepest;
    if (!(z_mm > 0.0) || root > 0.0)
        return TRUE;
    const double u = end->texel.u * s->tiles, down = -end->texel.v * s->tiles;
    const float uv[2] = {(float)(u - floor(u)), (float)(down - floor(down))};
    for (int k = 1; k <= CHORDS; k++) {
        const double reach = 0.5 * way * k / CHORDS, chord = slope - 0.5 * bend * reach;
        const struct vec3 q = vec3_unit(vec3(v.x / x_mm, v.y / y_mm, chord / z_mm));
        const float view[3] = {(float)q.x, (float)q.y, (float)q.z};
        struct mesorig_hit hit;
        if (mesorig_material_intersect(s->material, 1, uv, view, &hit) != MESORIG_OK || !hit.hit)
            return TRUE;
        const double depth = (double)hit.distance_mm * fmax(q.z, MIN_SLOPE) * z_mm;
        if (depth / chord <= reach)
            return TRUE;
    }
    return FALSE;
}

static struct vec3 local(const struct trace_hit *hit, struct vec3 d) {
    return vec3(vec3_dot(d, hit->x), vec3_dot(d, hit->y), vec3_dot(d, hit->z));
}

/* The frame of a back face points to the inside, from which the ray comes. Its z is turned
 * outwards. */
gboolean trace_relief_meets(const struct trace_hit *front, const struct trace_hit *back,
                            struct vec3 direction) {
    const double way = vec3_length(vec3_sub(back->position, front->position));
    const struct vec3 v = local(front, vec3_scale(direction, -1.0));
    struct vec3 w = local(back, direction);
    w.z = -w.z;
    return !(way > 0.0) || meets_from(front, v, way) || meets_from(back, w, way);
}
