#include "sample.h"

#include <math.h>

static void tone(struct vertex *to, double factor) {
    for (int k = 0; k < 3; k++)
        to->albedo[k] = (float)CLAMP(to->albedo[k] * factor, 0, 1);
}

/* Sets *ret_u and *ret_v to the position of a vertex within its piece of the sample, from 0 to 1. o
 * has the size of a piece. */
static void unit_place(const struct sample_options *o, const struct vertex *vertex, double *ret_u,
                       double *ret_v) {
    *ret_u = vertex->p[0] / o->width_mm + 0.5 * o->repeats;
    *ret_v = vertex->p[1] / o->height_mm + 0.5 * o->repeats;
    if (o->repeats > 1) {
        *ret_u -= floor(*ret_u);
        *ret_v -= floor(*ret_v);
    }
}

static void flat(struct vertex *vertex, gconstpointer data) {
    const struct sample_options *o = data;
    vertex->p[2] = (float)o->base_mm;
    sample_set_rgb(vertex->albedo, &o->albedo, 0.5f, 0.5f, 0.5f);
    sample_set_gloss(vertex, o, 0, 0.2, 0.2);
}

/* The sample has scratches along x. They consist of noise of three sizes. The noise is long in x
 * and short in y. A few scratches are deep. */
static void brushed(struct vertex *vertex, gconstpointer data) {
    const struct sample_options *o = data;
    double u, v;
    unit_place(o, vertex, &u, &v);
    guint64 seed = (guint64)o->seed * 97;
    double fine = sample_noise(u * 5, v * 200, 5, 200, seed);
    double middle = sample_noise(u * 3, v * 80, 3, 80, seed + 1);
    double broad = sample_noise(u * 2, v * 25, 2, 25, seed + 2);
    double deep = MAX(0, sample_noise(u * 4, v * 60, 4, 60, seed + 3) - 0.55);
    double h = 0.25 * fine + 0.3 * middle + 0.3 * broad - 1.2 * deep;
    vertex->p[2] = (float)(o->base_mm + o->relief_mm * CLAMP(0.5 + 0.4 * h, 0, 1));
    sample_set_rgb(vertex->albedo, &o->albedo, 0.11f, 0.105f, 0.10f);
    tone(vertex, 1 + 0.25 * fine - 0.8 * deep);
    sample_set_gloss(vertex, o, 0.45, 0.16, 0.42);
    vertex->gloss *= (float)(1 + 0.15 * middle - deep);
}

/* Finds the brick at a point of a wall in running bond. Returns a number of the brick, which is the
 * seed of its random values. Sets *ret_edge_mm to the distance of the point from the edge of the
 * brick. */
static guint64 find_brick(const struct sample_options *o, double u, double v, double *ret_edge_mm) {
    int courses = 2 * (int)MAX(1, rint(o->height_mm / o->period_mm / 2));
    int bricks = (int)MAX(1, rint(o->width_mm / o->period_mm / 2));
    double y = v * courses, x = u * bricks;
    int course = (int)floor(y);
    x += course % 2 ? 0.5 : 0;
    int brick = (int)floor(x);
    double to_x = (0.5 - fabs(x - brick - 0.5)) * o->width_mm / bricks;
    double to_y = (0.5 - fabs(y - course - 0.5)) * o->height_mm / courses;
    *ret_edge_mm = MIN(to_x, to_y);
    return (guint64)o->seed * 7919 + (guint64)(course % courses) * 131 + (guint64)(brick % bricks);
}

static void brick(struct vertex *vertex, gconstpointer data) {
    const struct sample_options *o = data;
    double u, v, edge;
    unit_place(o, vertex, &u, &v);
    guint64 seed = (guint64)o->seed * 31;
    double crumble = 0.22 * sample_noise(u * 60, v * 60, 60, 60, seed);
    struct sample_random random = {sample_hash(find_brick(o, u, v, &edge))};
    double inside = CLAMP((edge + crumble - 0.38) / 0.3, 0, 1);
    inside = inside * inside * (3 - 2 * inside);
    double tilt_x = sample_uniform(&random) - 0.5, bright = 0.7 + 0.5 * sample_uniform(&random);
    double rise = 0.86 + 0.14 * sample_uniform(&random), red = sample_uniform(&random);
    double grit = sample_noise(u * 110, v * 110, 110, 110, seed + 1);
    double lumps = sample_noise(u * 35, v * 35, 35, 35, seed + 2);
    double pit = MAX(0, sample_noise(u * 45, v * 45, 45, 45, seed + 3) - 0.6);
    double face = rise + 0.05 * lumps + 0.03 * grit + 0.1 * tilt_x * (u - 0.5) - 0.5 * pit;
    double joint = 0.16 + 0.07 * grit + 0.05 * lumps;
    vertex->p[2] = (float)(o->base_mm + o->relief_mm * 0.92 * (joint + (face - joint) * inside));
    float mortar[3];
    sample_set_rgb(vertex->albedo, &o->albedo, 0.56f, 0.20f, (float)(0.10 + 0.05 * red));
    sample_set_rgb(mortar, &o->albedo2, 0.48f, 0.46f, 0.42f);
    tone(vertex, bright * (1 + 0.18 * lumps + 0.12 * grit));
    for (int k = 0; k < 3; k++)
        vertex->albedo[k] =
            (float)(vertex->albedo[k] * inside + mortar[k] * (1 + 0.15 * grit) * (1 - inside));
    sample_set_gloss(vertex, o, 0, 0.4, 0.4);
}

/* The sample is corduroy, with round wales along y. The pile of the wales leans outwards. */
static void ridges(struct vertex *vertex, gconstpointer data) {
    const struct sample_options *o = data;
    double u, v;
    unit_place(o, vertex, &u, &v);
    int n = (int)MAX(1, rint(o->width_mm / o->period_mm));
    guint64 seed = (guint64)o->seed * 53;
    double sway = 0.05 * sample_noise(u * 3, v * 8, 3, 8, seed);
    double x = u * n + sway, across = x - floor(x) - 0.5;
    double round = pow(MAX(0, cos(G_PI * across)), 0.6);
    double pile = sample_noise(u * 4 * n, v * 120, 4 * n, 120, seed + 1);
    vertex->p[2] = (float)(o->base_mm + o->relief_mm * (0.93 * round + 0.035 * (pile + 1)));
    sample_set_rgb(vertex->albedo, &o->albedo, 0.36f, 0.13f, 0.07f);
    tone(vertex, (0.45 + 0.55 * round) * (1 + 0.2 * pile));
    sample_set_gloss(vertex, o, 0.04, 0.5, 0.25);
    vertex->t[0] = 0;
    vertex->t[1] = 1;
}

struct mesh *sample_relief(const struct sample_options *options) {
    SampleRelief relief = options->kind == SAMPLE_BRUSHED  ? brushed
                          : options->kind == SAMPLE_BRICK  ? brick
                          : options->kind == SAMPLE_RIDGES ? ridges
                                                           : flat;
    struct sample_options piece = *options;
    piece.width_mm /= options->repeats;
    piece.height_mm /= options->repeats;
    struct mesh *mesh = sample_mesh_new();
    sample_add_relief(mesh, options, options->grid, options->grid, relief, &piece);
    return mesh;
}
