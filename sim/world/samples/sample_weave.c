#include "sample.h"

#include <math.h>
#include <string.h>

/* The sample is a plain weave of twisted yarns. The yarns are tubes that pass over and under each
 * other. The warp runs along y, and the weft runs along x. The pattern repeats after two yarns. */

#define AROUND 24
#define PLIES  3

struct yarn {
    const struct sample_options *options;
    gboolean warp;
    int index; /* number of the yarn among the warps or wefts */
    double at_mm, length_mm, cross_pitch_mm;
    double middle_mm, swing_mm; /* mean height of the centre line, and amplitude of its waves */
    double half_width_mm, half_height_mm;
    float albedo[3];
    guint64 seed;
};

/* Returns the height of the centre line at s along the yarn. Warp i is over weft j if i + j is
 * even. */
static double centre_height(const struct yarn *yarn, double s) {
    double side = (yarn->index % 2 ? -1 : 1) * (yarn->warp ? 1 : -1);
    double phase = (s + yarn->length_mm / 2 - yarn->cross_pitch_mm / 2) / yarn->cross_pitch_mm;
    return yarn->middle_mm + yarn->swing_mm * side * cos(G_PI * phase);
}

/* Converts the coordinates (along, aside, up) relative to a yarn to x, y, z. */
static void place(const struct yarn *yarn, double along, double aside, double up, float to[3]) {
    to[0] = (float)(yarn->warp ? aside : along);
    to[1] = (float)(yarn->warp ? along : aside);
    to[2] = (float)up;
}

/* Computes a vertex of a yarn. Plies wind around the yarn, with deep and dark grooves between them.
 * The fibres follow the winding. They give the direction of the gloss. */
static void yarn_vertex(const struct yarn *yarn, double s, double turn, struct vertex *to) {
    double slope = (centre_height(yarn, s + 1e-3) - centre_height(yarn, s - 1e-3)) / 2e-3;
    double stretch = sqrt(1 + slope * slope);
    int windings = (int)MAX(1, rint(yarn->length_mm / 11));
    double wind = 2 * G_PI * windings * s / yarn->length_mm;
    double ply = cos(PLIES * (turn - wind)), groove = pow(0.5 - 0.5 * ply, 3);
    double fuzz = sample_noise(s * 2.5 + 40, turn * 2.2 + wind, (int)(yarn->length_mm * 2.5), 1000,
                               yarn->seed);
    double swell = sample_noise(s / 4, 0.5, (int)MAX(1, yarn->length_mm / 4), 1, yarn->seed + 1);
    double r = 1 - 0.11 * groove + 0.012 * fuzz + 0.025 * swell;
    double aside = yarn->half_width_mm * r * cos(turn), up = yarn->half_height_mm * r * sin(turn);
    double half = yarn->length_mm / 2, along = s - up * slope / stretch;
    place(yarn, CLAMP(along, -half, half), yarn->at_mm + aside,
          centre_height(yarn, s) + up / stretch, to->p);
    double rate = 2 * G_PI * windings / yarn->length_mm;
    place(yarn, 1, -yarn->half_width_mm * sin(turn) * rate,
          slope + yarn->half_height_mm * cos(turn) * rate, to->t);
    double tone = 1 - 0.45 * groove + 0.10 * fuzz + 0.05 * swell;
    for (int k = 0; k < 3; k++)
        to->albedo[k] = (float)CLAMP(yarn->albedo[k] * tone, 0, 1);
}

/* Closes one end of the tube of a yarn with triangles around the centre of this end. ring is the
 * first vertex of the tube's ring at this end. */
static void add_cap(struct mesh *mesh, const struct yarn *yarn, guint32 ring, gboolean start) {
    double s = start ? -yarn->length_mm / 2 : yarn->length_mm / 2;
    guint first_triangle = mesh->triangles->len;
    guint32 first = mesh->vertices->len;
    for (guint32 i = 0; i < AROUND; i++) {
        struct vertex copy = g_array_index(mesh->vertices, struct vertex, ring + i);
        sample_add_vertex(mesh, &copy);
    }
    struct vertex centre = g_array_index(mesh->vertices, struct vertex, ring);
    place(yarn, s, yarn->at_mm, centre_height(yarn, s), centre.p);
    guint32 middle = sample_add_vertex(mesh, &centre);
    gboolean flip = start != yarn->warp;
    for (guint32 i = 0; i < AROUND; i++) {
        guint32 a = first + i, b = first + (i + 1) % AROUND;
        sample_add_triangle(mesh, middle, flip ? b : a, flip ? a : b);
    }
    sample_smooth_normals(mesh, first, first_triangle);
}

static void add_yarn(struct mesh *mesh, const struct yarn *yarn) {
    int steps = (int)CLAMP(12 * yarn->length_mm / yarn->cross_pitch_mm, 8, 1000);
    guint32 first = mesh->vertices->len;
    guint first_triangle = mesh->triangles->len;
    for (int i = 0; i <= steps; i++) {
        for (int k = 0; k < AROUND; k++) {
            struct vertex vertex = {0};
            sample_set_gloss(&vertex, yarn->options, 0.05, 0.45, 0.2);
            double s = yarn->length_mm * ((double)i / steps - 0.5);
            yarn_vertex(yarn, s, 2 * G_PI * k / AROUND, &vertex);
            sample_add_vertex(mesh, &vertex);
        }
    }
    sample_join_rings(mesh, first, (guint32)steps, AROUND, yarn->warp);
    sample_smooth_normals(mesh, first, first_triangle);
    add_cap(mesh, yarn, first, TRUE);
    add_cap(mesh, yarn, first + (guint32)steps * AROUND, FALSE);
}

static void backing_relief(struct vertex *vertex, gconstpointer data) {
    vertex->p[2] = (float)((const struct sample_options *)data)->base_mm;
    for (int k = 0; k < 3; k++)
        vertex->albedo[k] = 0.05f;
}

static void add_yarns(struct mesh *mesh, const struct sample_options *o, gboolean warp) {
    int n_x = sample_count(o->width_mm, o->period_mm, 2),
        n_y = sample_count(o->height_mm, o->period_mm, 2);
    double pitch_x = o->width_mm / n_x, pitch_y = o->height_mm / n_y;
    /* The relief must contain the amplitude and half the thickness of a yarn, both above and below
     * its middle. */
    double thick = o->relief_mm / 4.3;
    int n = warp ? n_x : n_y;
    for (int i = 0; i < n; i++) {
        struct yarn yarn = {.options = o, .warp = warp, .index = i};
        double pitch_mm = warp ? pitch_x : pitch_y;
        yarn.cross_pitch_mm = warp ? pitch_y : pitch_x;
        yarn.length_mm = warp ? o->height_mm : o->width_mm;
        yarn.at_mm = (i + 0.5) * pitch_mm - (warp ? o->width_mm : o->height_mm) / 2;
        yarn.half_width_mm = 0.455 * pitch_mm;
        yarn.half_height_mm = thick;
        yarn.swing_mm = 1.08 * thick;
        yarn.middle_mm = o->base_mm + 0.03 * o->relief_mm + 2.15 * thick;
        yarn.seed = sample_hash((guint64)o->seed * 1000 + (guint64)i * 2 + (guint64)warp);
        if (warp)
            sample_set_rgb(yarn.albedo, &o->albedo, 0.74f, 0.60f, 0.38f);
        else
            sample_set_rgb(yarn.albedo, &o->albedo2, 0.06f, 0.22f, 0.42f);
        add_yarn(mesh, &yarn);
    }
}

struct mesh *sample_weave(const struct sample_options *options) {
    struct mesh *mesh = sample_mesh_new();
    sample_add_relief(mesh, options, 48, 48, backing_relief, options);
    add_yarns(mesh, options, TRUE);
    add_yarns(mesh, options, FALSE);
    return mesh;
}
