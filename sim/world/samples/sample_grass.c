#include "sample.h"

#include <math.h>

/* The sample is grass on soil. Tufts of blades rise from the soil and bend over. Most points of the
 * ground lie below a blade, so no height field describes the surface. A blade is a thin closed body
 * around a quadratic Bézier curve. */

#define ALONG  8  /* a blade has ALONG + 1 rings of vertices from root to tip */
#define AROUND 6  /* number of vertices of a ring */
#define BLADES 14 /* number of blades of a tuft */

struct blade {
    const struct sample_options *options;
    /* control points: `x` is the distance along the ground from the root, and `z` the height */
    double x[3], z[3];
    double root_mm[2], azimuth, half_width_mm;
    float albedo[3];
};

static double bezier(const double p[3], double s) {
    return (1 - s) * (1 - s) * p[0] + 2 * s * (1 - s) * p[1] + s * s * p[2];
}

static double bezier_slope(const double p[3], double s) {
    return 2 * (1 - s) * (p[1] - p[0]) + 2 * s * (p[2] - p[1]);
}

/* Computes a vertex of a ring. The ring lies in the plane of two directions: the level direction to
 * the side, and the normal of the upper face. */
static void blade_vertex(const struct blade *blade, double s, double turn, struct vertex *to) {
    double c = cos(blade->azimuth), d = sin(blade->azimuth);
    double dx = bezier_slope(blade->x, s), dz = bezier_slope(blade->z, s);
    double length = hypot(dx, dz), width = blade->half_width_mm * (1.02 - pow(s, 2.5));
    double aside = width * cos(turn), up = 0.3 * width * sin(turn);
    double ahead = bezier(blade->x, s) - up * dz / length;
    to->p[0] = (float)(blade->root_mm[0] + c * ahead - d * aside);
    to->p[1] = (float)(blade->root_mm[1] + d * ahead + c * aside);
    to->p[2] = (float)MAX(0, bezier(blade->z, s) + up * dx / length);
    to->t[0] = (float)(c * dx / length);
    to->t[1] = (float)(d * dx / length);
    to->t[2] = (float)(dz / length);
    for (int k = 0; k < 3; k++)
        to->albedo[k] = (float)CLAMP(blade->albedo[k] * (0.45 + 0.75 * s), 0, 1);
}

static void add_blade(struct mesh *mesh, const struct blade *blade) {
    guint32 first = mesh->vertices->len;
    guint first_triangle = mesh->triangles->len;
    for (int i = 0; i <= ALONG; i++)
        for (int k = 0; k < AROUND; k++) {
            struct vertex vertex = {0};
            sample_set_gloss(&vertex, blade->options, 0.03, 0.4, 0.3);
            blade_vertex(blade, (double)i / ALONG, 2 * G_PI * k / AROUND, &vertex);
            sample_add_vertex(mesh, &vertex);
        }
    sample_join_rings(mesh, first, ALONG, AROUND, FALSE);
    sample_smooth_normals(mesh, first, first_triangle);
}

/* Chooses the control points of a blade so that the blade is not higher than relief_mm. */
static void shape_blade(const struct sample_options *o, double spacing_mm,
                        struct sample_random *random, struct blade *to) {
    to->options = o;
    double height = 0.9 * o->relief_mm * (0.7 + 0.35 * sample_uniform(random));
    double reach = o->relief_mm * (0.3 + 0.8 * sample_uniform(random));
    double start = -0.1 * MIN(o->base_mm, o->relief_mm);
    to->x[0] = 0;
    to->x[1] = reach * (0.1 + 0.3 * sample_uniform(random));
    to->x[2] = reach;
    to->z[0] = o->base_mm + start;
    to->z[1] = o->base_mm + height;
    to->z[2] = o->base_mm + height * (0.35 + 0.45 * sample_uniform(random));
    to->azimuth = 2 * G_PI * sample_uniform(random);
    to->half_width_mm = 0.07 * spacing_mm * (0.7 + 0.5 * sample_uniform(random));
    double tone = 0.75 + 0.5 * sample_uniform(random), dry = sample_uniform(random);
    if (dry < 0.12)
        sample_set_rgb(to->albedo, &o->albedo, 0.52f, 0.46f, 0.20f);
    else
        sample_set_rgb(to->albedo, &o->albedo, (float)(0.14 + 0.14 * dry), 0.42f, 0.07f);
    for (int k = 0; k < 3; k++)
        to->albedo[k] = (float)MIN(1, to->albedo[k] * tone);
}

static void soil(struct vertex *vertex, gconstpointer data) {
    const struct sample_options *o = data;
    double u = (vertex->p[0] / o->width_mm + 0.5) * o->repeats;
    double v = (vertex->p[1] / o->height_mm + 0.5) * o->repeats;
    double lumps = sample_noise(u * 24, v * 24, 24, 24, (guint64)o->seed + 3);
    double grain = sample_noise(u * 60, v * 60, 60, 60, (guint64)o->seed + 4);
    vertex->p[2] = (float)(o->base_mm + o->relief_mm * (0.04 + 0.03 * lumps + 0.01 * grain));
    sample_set_rgb(vertex->albedo, &o->albedo2, 0.13f, 0.09f, 0.055f);
    for (int k = 0; k < 3; k++)
        vertex->albedo[k] = (float)CLAMP(vertex->albedo[k] * (1 + 0.3 * lumps + 0.3 * grain), 0, 1);
}

struct mesh *sample_grass(const struct sample_options *options) {
    const struct sample_options *o = options;
    struct mesh *mesh = sample_mesh_new();
    sample_add_relief(mesh, o, 96, 96, soil, o);
    int n_x = sample_count(o->width_mm / o->repeats, o->period_mm, 1);
    int n_y = sample_count(o->height_mm / o->repeats, o->period_mm, 1);
    double pitch_x = o->width_mm / o->repeats / n_x, pitch_y = o->height_mm / o->repeats / n_y;
    for (int tuft = 0; tuft < n_x * n_y * o->repeats * o->repeats; tuft++) {
        int i = tuft % (n_x * o->repeats), j = tuft / (n_x * o->repeats);
        struct sample_random random = {
            sample_hash((guint64)o->seed * 6271 + (guint64)(j % n_y * n_x + i % n_x))};
        for (int k = 0; k < BLADES; k++) {
            struct blade blade;
            double x = i + sample_uniform(&random), y = j + sample_uniform(&random);
            shape_blade(o, MIN(pitch_x, pitch_y), &random, &blade);
            blade.root_mm[0] = x * pitch_x - o->width_mm / 2;
            blade.root_mm[1] = y * pitch_y - o->height_mm / 2;
            add_blade(mesh, &blade);
        }
    }
    return mesh;
}
