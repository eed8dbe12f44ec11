#include "shell_ray.h"

#include <math.h>

#define STEP      1.0 /* length of a step, in voxels along the texture or in layers */
#define MIN_STEPS 4
#define MAX_STEPS 4000
#define MIN_GROWN 0.25 /* limits of the change of a tile's size along a ray, as a factor */
#define MAX_GROWN 4.0
/* where the component of a ray along the normal is a divisor, it is at least this */
#define MIN_SLOPE 0.01

/* The state of a ray that is marched. The foot of the ray is the point of the mesh that is nearest
 * to it. The frame of tangent, bitangent and normal moves with the foot. */
struct ray {
    const struct shell_surface *surface;
    double along[2];    /* direction of the ray in the tangent plane */
    double down;        /* component of the direction towards greater depth */
    double depth;       /* below the mesh, in the unit of the surface */
    double foot[2];     /* vector on the mesh from the point where the ray entered to the foot */
    double u, v;        /* of the foot, in tiles */
    double step_mm;     /* length of the last step in the flat sample */
    double size_mm[2];  /* of a tile of the sample */
    double unit_per_mm; /* size of a millimetre of the sample along the normal, where the ray
                           entered */
};

static void bend(const double b[3], const double x[2], double ret[2]) {
    ret[0] = b[0] * x[0] + b[1] * x[1];
    ret[1] = b[1] * x[0] + b[2] * x[1];
}

/* Computes the velocity of the foot of a ray that moves with velocity w parallel to the tangent
 * plane: (1 − depth · B)⁻¹ w, with the second fundamental form B (parallel surfaces). */
static void foot_velocity(const double b[3], const double w[2], double depth, double ret[2]) {
    const double trace = b[0] + b[2];
    const double det = 1.0 - depth * trace + depth * depth * (b[0] * b[2] - b[1] * b[1]);
    double bw[2];
    bend(b, w, bw);
    for (int k = 0; k < 2; k++)
        ret[k] = det > 0.05 ? ((1.0 - depth * trace) * w[k] + depth * bw[k]) / det : w[k];
}

/* Computes the size of a tile at the foot, relative to its size where the ray entered. */
static void grown_at(const double stretch[4], const double foot[2], double ret[2]) {
    for (int k = 0; k < 2; k++) {
        const double grown = 1.0 + stretch[2 * k] * foot[0] + stretch[2 * k + 1] * foot[1];
        ret[k] = CLAMP(grown, MIN_GROWN, MAX_GROWN);
    }
}

/* Advances the ray by dt, by the midpoint rule. The frame turns along the way: about an axis in the
 * tangent plane because of B, and about the normal because the lines of the texture bend. The
 * direction in the frame changes accordingly. */
static void march(struct ray *r, double dt) {
    const struct shell_surface *s = r->surface;
    double foot[2], turn[2], along[2], middle[2], grown[2];
    foot_velocity(s->bend, r->along, r->depth, foot);
    bend(s->bend, foot, turn);
    for (int k = 0; k < 2; k++)
        along[k] = r->along[k] + 0.5 * dt * r->down * turn[k];
    const double down = r->down - 0.5 * dt * (r->along[0] * turn[0] + r->along[1] * turn[1]);
    foot_velocity(s->bend, along, r->depth + 0.5 * dt * r->down, foot);
    for (int k = 0; k < 2; k++)
        middle[k] = r->foot[k] + 0.5 * dt * foot[k];
    grown_at(s->stretch, middle, grown);
    const double way[2] = {dt * foot[0] / (s->tile[0] * grown[0]),
                           dt * foot[1] / (s->tile[1] * grown[1])};
    const double down_mm = dt * down / (r->unit_per_mm * sqrt(grown[0] * grown[1]));
    bend(s->bend, foot, turn);
    r->u += way[0];
    r->v -= way[1];
    r->depth += dt * down;
    r->step_mm = sqrt(pow(way[0] * r->size_mm[0], 2.0) + pow(way[1] * r->size_mm[1], 2.0) +
                      down_mm * down_mm);
    const double about =
        dt * (foot[1] * s->stretch[2] / grown[1] - foot[0] * s->stretch[1] / grown[0]);
    const double next[2] = {r->along[0] + dt * down * turn[0], r->along[1] + dt * down * turn[1]};
    const double x = next[0] + about * next[1], y = next[1] - about * next[0];
    const double z = r->down - dt * (along[0] * turn[0] + along[1] * turn[1]);
    const double length = sqrt(x * x + y * y + z * z);
    r->along[0] = x / length;
    r->along[1] = y / length;
    r->down = z / length;
    for (int k = 0; k < 2; k++)
        r->foot[k] += dt * foot[k];
}

static double depth_mm(const struct ray *r) {
    double grown[2];
    grown_at(r->surface->stretch, r->foot, grown);
    return r->depth / (r->unit_per_mm * sqrt(grown[0] * grown[1]));
}

/* Returns the distance after which a ray is at depth d below a mesh of normal curvature k, or
 * INFINITY if the ray never is. slope is the cosine of the angle between ray and normal where the
 * ray enters. */
static double distance_to_depth(double d, double slope, double k) {
    const double c = 2.0 * d - k * d * d, root = slope * slope - k * c;
    return root >= 0.0 && k * d < 1.0 ? c / (slope + sqrt(root)) : INFINITY;
}

double shell_ray_value(const struct mdf_shell *s, double u, double v, double deep_mm,
                       double ret_gradient[3]) {
    const double x = (u - floor(u)) * s->width - 0.5, y = (v - floor(v)) * s->height - 0.5;
    const double z = CLAMP(deep_mm / s->depth_mm * s->depth - 0.5, 0.0, s->depth - 1.0);
    const double left = floor(x), above = floor(y);
    const int layer = MIN((int)z, MAX(s->depth - 2, 0));
    const double p[3] = {x - left, y - above, z - layer};
    const int columns[2] = {((int)left + s->width) % s->width, ((int)left + 1) % s->width};
    const int rows[2] = {((int)above + s->height) % s->height, ((int)above + 1) % s->height};
    double sum = 0.0, slope[3] = {0};
    for (int k = 0; k < 8; k++) {
        const int corner[3] = {k & 1, k >> 1 & 1, k >> 2};
        const gsize l = (gsize)MIN(layer + corner[2], s->depth - 1);
        const double g =
            s->values[(l * s->height + rows[corner[1]]) * s->width + columns[corner[0]]] / 255.0;
        double share[3];
        for (int c = 0; c < 3; c++)
            share[c] = corner[c] ? p[c] : 1.0 - p[c];
        sum += g * share[0] * share[1] * share[2];
        slope[0] += g * (corner[0] ? 1.0 : -1.0) * share[1] * share[2];
        slope[1] += g * (corner[1] ? 1.0 : -1.0) * share[0] * share[2];
        slope[2] += g * (corner[2] ? 1.0 : -1.0) * share[0] * share[1];
    }
    ret_gradient[0] = slope[0] * s->width / s->width_mm;
    ret_gradient[1] = -slope[1] * s->height / s->height_mm;
    ret_gradient[2] = -slope[2] * s->depth / s->depth_mm;
    return sum;
}

gboolean shell_ray_march(const struct mdf_shell *shell, const struct shell_surface *surface,
                         double u, double v, const double view[3], double limit,
                         struct shell_hit *ret) {
    struct ray r = {.surface = surface,
                    .along = {-view[0], -view[1]},
                    .down = MAX(view[2], MIN_SLOPE),
                    .u = u,
                    .v = v,
                    .size_mm = {shell->width_mm, shell->height_mm}};
    r.unit_per_mm = sqrt(surface->tile[0] / r.size_mm[0] * surface->tile[1] / r.size_mm[1]);
    const double across2 = view[0] * view[0] + view[1] * view[1];
    double bent[2];
    bend(surface->bend, view, bent);
    const double k = (bent[0] * view[0] + bent[1] * view[1]) / MAX(across2, 1e-12);
    const double deepest = shell->depth_mm * r.unit_per_mm;
    const double base = distance_to_depth(deepest, r.down, k);
    /* A ray that never reaches the base leaves the mesh again at the distance 2 down / k. */
    const double last = MIN(isfinite(base) ? base : 2.0 * r.down / k, limit);
    const double from = distance_to_depth(shell->top_mm * r.unit_per_mm, r.down, k);
    if (!(from < last) || !isfinite(last))
        return FALSE;
    const double voxels = MAX(MAX(fabs(view[0]) * shell->width / surface->tile[0],
                                  fabs(view[1]) * shell->height / surface->tile[1]),
                              r.down * shell->depth / deepest);
    const int n = (int)CLAMP(ceil(voxels * (last - from) / STEP), MIN_STEPS, MAX_STEPS);
    const double dt = (last - from) / n;
    double sum = 0.0, gradient[3];
    for (int i = 0; i < n; i++) {
        const double go = i == 0 ? from + 0.5 * dt : dt; /* to the middle of step i */
        march(&r, go);
        const double depth = depth_mm(&r), g = shell_ray_value(shell, r.u, r.v, depth, gradient);
        const double more = shell->most_per_mm * g * g * g * g * r.step_mm * dt / go;
        const gboolean at_base = depth >= shell->depth_mm;
        if (sum + more >= G_LN2 || at_base) {
            /* the ray is at the middle of the step; moves it forward or back to the hit */
            const double share = at_base ? 0.5 : (G_LN2 - sum) / more;
            march(&r, (share - 0.5) * dt);
            *ret = (struct shell_hit){from + dt * (i + share),
                                      depth_mm(&r),
                                      r.u,
                                      r.v,
                                      {-r.along[0], -r.along[1], r.down}};
            return TRUE;
        }
        sum += more;
    }
    if (!(last < limit) && limit < base)
        return FALSE;
    if (!isfinite(base))
        return FALSE;
    march(&r, 0.5 * dt);
    *ret = (struct shell_hit){last, depth_mm(&r), r.u, r.v, {-r.along[0], -r.along[1], r.down}};
    return TRUE;
}
