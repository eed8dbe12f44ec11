#include "microfacet_formula.h"

#include <math.h>

#define MIN_VIEW 0.1
#define LEAST    1e-3

struct vec3 microfacet_half(struct vec3 h, struct vec3 n, enum method_rotation rotation) {
    const double z = vec3_dot(n, h), size = hypot(n.x, n.z);
    const struct vec3 approximate = {
        n.z * h.x - n.x * h.z,
        -n.x * n.y * h.x + (1 - n.y * n.y) * h.y - n.y * n.z * h.z,
        z,
    };
    if (rotation == METHOD_ROTATION_NONE)
        return (struct vec3){h.x, h.y, z};
    if (rotation == METHOD_ROTATION_APPROXIMATE)
        return approximate;
    if (size < 1e-6)
        return (struct vec3){h.x, -n.y * h.z, z};
    return (struct vec3){approximate.x / size, approximate.y / size, z};
}

static double shine(const struct microfacet *s, struct vec3 h, double nl, double nv, double hl) {
    const double u = s->rough[0], v = s->rough[1];
    if (s->model == MICROFACET_WARD)
        return sqrt(nl / nv) / (4 * u * v) *
               exp(-2 * (h.x * h.x / (u * u) + h.y * h.y / (v * v)) / (1 + fmax(h.z, 0)));
    const double flat = h.x * h.x + h.y * h.y;
    const double exponent = flat > 0 ? (u * h.x * h.x + v * h.y * h.y) / flat : 0;
    return sqrt((u + 1) * (v + 1)) / 8 * pow(fmax(h.z, LEAST), exponent) * nl /
           (fmax(hl, LEAST) * fmax(nl, nv));
}

void microfacet_evaluate(const struct microfacet *surface, struct vec3 n, struct vec3 view,
                         struct vec3 light, enum method_rotation rotation, double ret[3]) {
    const double nl = vec3_dot(n, light), nv = fmax(vec3_dot(n, view), MIN_VIEW);
    const struct vec3 sum = {view.x + light.x, view.y + light.y, view.z + light.z};
    const double length = fmax(sqrt(vec3_dot(sum, sum)), LEAST);
    const struct vec3 h = {sum.x / length, sum.y / length, sum.z / length};
    const gboolean lit = nl > 1e-4;
    const double part =
        lit ? shine(surface, microfacet_half(h, n, rotation), nl, nv, vec3_dot(h, light)) : 0;
    for (int c = 0; c < 3; c++)
        ret[c] = lit ? surface->diffuse[c] * nl + surface->specular[c] * part : 0;
}
