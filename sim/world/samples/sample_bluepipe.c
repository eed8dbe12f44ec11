#include "sample.h"

#include <math.h>

/* The sample has pipes in two layers on a dark floor. The lower pipes lie along x, and the upper
 * pipes lie along y. The pipes of a layer are one period apart. Where two lengths of pipe meet,
 * there is a sleeve. The pipes are hollow, and end at the sample's edge. Light and lines of sight
 * pass between and below the upper pipes. */

#define AROUND     28
#define PIPE       0.84 /* radius of a pipe, as a share of the radius of its sleeves */
#define RADIUS     0.36 /* radius of a sleeve, as a share of the period */
#define PER_SLEEVE 24   /* number of rings of vertices from one sleeve to the next */

struct pipe {
    const struct sample_options *options;
    gboolean upper;
    double at_mm, length_mm, axis_mm, radius_mm;
    /* `sleeves` is the number of sleeves along the pipe. `phase` is the phase of the first sleeve,
     * 0 … 1. */
    double sleeves, phase;
    float albedo[3];
};

/* Returns the radius at s, as a share of the sleeve's radius. s is from 0 to 1 along the pipe. The
 * profile has steps with round shoulders. Sets *ret_sleeve to 1 on a sleeve, to 0 beside it, and to
 * a value between 0 and 1 on a shoulder. */
static double pipe_profile(const struct pipe *pipe, double s, double *ret_sleeve) {
    double place = s * pipe->sleeves + pipe->phase;
    double off = fabs(place - floor(place) - 0.5);
    double on = CLAMP((0.14 - off) / 0.04 + 0.5, 0, 1);
    *ret_sleeve = on * on * (3 - 2 * on);
    return PIPE + (1 - PIPE) * *ret_sleeve;
}

static void pipe_vertex(const struct pipe *pipe, double s, double turn, struct vertex *to) {
    double sleeve, r = pipe->radius_mm * pipe_profile(pipe, s, &sleeve);
    double along = pipe->length_mm * (s - 0.5), aside = pipe->at_mm + r * cos(turn);
    to->p[0] = (float)(pipe->upper ? aside : along);
    to->p[1] = (float)(pipe->upper ? along : aside);
    to->p[2] = (float)(pipe->axis_mm + r * sin(turn));
    to->t[pipe->upper ? 1 : 0] = 1;
    sample_set_gloss(to, pipe->options, 0.05, 0.16, 0.16);
    for (int k = 0; k < 3; k++)
        to->albedo[k] = (float)(pipe->albedo[k] * (1 - 0.45 * sleeve));
}

static void add_pipe(struct mesh *mesh, const struct pipe *pipe) {
    guint32 first = mesh->vertices->len, rings = (guint32)(pipe->sleeves * PER_SLEEVE);
    guint first_triangle = mesh->triangles->len;
    for (guint32 i = 0; i <= rings; i++)
        for (int k = 0; k < AROUND; k++) {
            struct vertex vertex = {0};
            pipe_vertex(pipe, (double)i / rings, 2 * G_PI * k / AROUND, &vertex);
            sample_add_vertex(mesh, &vertex);
        }
    sample_join_rings(mesh, first, rings, AROUND, pipe->upper);
    sample_smooth_normals(mesh, first, first_triangle);
}

static void pipe_floor(struct vertex *vertex, gconstpointer data) {
    const struct sample_options *o = data;
    vertex->p[2] = (float)o->base_mm;
    sample_set_rgb(vertex->albedo, &o->albedo2, 0.10f, 0.10f, 0.11f);
}

static void add_layer(struct mesh *mesh, const struct sample_options *o, gboolean upper) {
    double across_mm = upper ? o->width_mm : o->height_mm;
    double length_mm = upper ? o->height_mm : o->width_mm;
    int n = sample_count(across_mm / o->repeats, o->period_mm, 1);
    int crossing = sample_count(length_mm / o->repeats, o->period_mm, 2);
    double pitch_mm = across_mm / o->repeats / n;
    for (int i = 0; i < n * o->repeats; i++) {
        struct sample_random random = {
            sample_hash((guint64)o->seed * 419 + (guint64)(i % n) * 2 + (guint64)upper)};
        struct pipe pipe = {.options = o, .upper = upper, .length_mm = length_mm};
        pipe.radius_mm = MIN(o->relief_mm / 4, RADIUS * pitch_mm);
        pipe.axis_mm = o->base_mm + (upper ? o->relief_mm - pipe.radius_mm : pipe.radius_mm);
        pipe.at_mm = (i + 0.5) * pitch_mm - across_mm / 2;
        const int pairs = crossing / 2;
        pipe.sleeves = pairs * o->repeats;
        pipe.phase = sample_uniform(&random);
        double tone = 0.75 + 0.4 * sample_uniform(&random), green = sample_uniform(&random);
        sample_set_rgb(pipe.albedo, &o->albedo, 0.05f, (float)(0.16 + 0.12 * green), 0.52f);
        for (int k = 0; k < 3; k++)
            pipe.albedo[k] = (float)MIN(1, pipe.albedo[k] * tone);
        add_pipe(mesh, &pipe);
    }
}

struct mesh *sample_bluepipe(const struct sample_options *options) {
    struct mesh *mesh = sample_mesh_new();
    sample_add_relief(mesh, options, 96, 96, pipe_floor, options);
    add_layer(mesh, options, FALSE);
    add_layer(mesh, options, TRUE);
    return mesh;
}
