/*
 * This module makes the samples that lie on the turntable. A sample is a triangle mesh with a
 * material at every vertex. The mesh is made from parameters and a seed, or loaded from a file.
 * Positions are in millimetres in the sample frame: x and y are from −size/2 to +size/2, and z = 0
 * is the turntable's top.
 */
#pragma once

#include "base/options.h"

#include <png.h>

/* A vertex with its material: a diffuse albedo, and a layer of gloss (Ward's anisotropic lobe in
 * the bounded form). `gloss` is the albedo of this layer. `along` and `across` are its roughness in
 * the direction of the tangent t, and perpendicular to t. */
struct vertex {
    float p[3], n[3], t[3];
    float albedo[3];
    float gloss, along, across;
    float spare; /* padding, because the ray tracer may read a little beyond p of the last vertex */
};

struct mesh {
    GArray *vertices;  /* of struct vertex */
    GArray *triangles; /* of guint32[3], counter-clockwise seen from outside */
};

enum sample_kind {
    SAMPLE_FLAT,
    SAMPLE_WEAVE,
    SAMPLE_BRUSHED,
    SAMPLE_BRICK,
    SAMPLE_PEANUTS,
    SAMPLE_RIDGES,
    SAMPLE_PICTURE,
    SAMPLE_OBJ,
    SAMPLE_POLES,
    SAMPLE_BALLS,
    SAMPLE_PLATE,
    SAMPLE_GRASS,
    SAMPLE_BLUEPIPE,
    SAMPLE_BLOCK,
    SAMPLE_MAIL,
};

struct sample_options {
    int kind;
    int seed;
    double width_mm, height_mm; /* along x and y */
    double base_mm, relief_mm, top_mm, period_mm;
    int grid;
    int repeats; /* number of equal pieces in x and in y; 1 for kinds that cannot be divided */
    struct option_doubles albedo, albedo2; /* empty, one value, or three */
    double gloss, along, across;           /* −1 for the value of the kind */
    gboolean smooth;
    double tilt_deg, tilt_towards_deg, turn_deg; /* pose of a plate; see sample_plate.c */
    struct option_doubles offset_mm;             /* empty, or x and y */
    struct option_doubles places_mm; /* x, y, and height or radius of each post or ball */
    double radius_mm;
    char *path, *albedo_path;
};

extern const struct option sample_option_table[];

/* Makes or loads the sample of a section. Returns NULL if there are mistakes. A mistake names the
 * file and line of the section. If a file could not be loaded, it names this file and the place in
 * it. */
struct mesh *sample_new(const struct config_section *section, const struct sample_options *options,
                        Mistakes *mistakes);
void sample_free(struct mesh *mesh); /* NULL is ignored */

/* The following functions are for the kinds of samples. */
struct mesh *sample_mesh_new(void);
guint32 sample_add_vertex(struct mesh *mesh, const struct vertex *vertex);
void sample_add_triangle(struct mesh *mesh, guint32 a, guint32 b, guint32 c);
/* Adds two triangles. The corners are counter-clockwise. */
void sample_add_quad(struct mesh *mesh, guint32 a, guint32 b, guint32 c, guint32 d);
/* Adds the quads between n + 1 rings of vertices, each ring with the next. A ring has `around`
 * vertices. The vertices have consecutive indices, ring by ring, beginning with `first`. If flip is
 * FALSE, the outward normal is (direction around a ring) × (direction from ring to ring). If flip
 * is TRUE, it is the opposite. */
void sample_join_rings(struct mesh *mesh, guint32 first, guint32 n, guint32 around, gboolean flip);
/* Returns the number of periods with which length_mm is divided into periods closest to period_mm.
 * The number is a multiple of unit, and at least unit. */
int sample_count(double length_mm, double period_mm, int unit);
/* Computes the normals of the vertices from first_vertex on. A normal is the mean of the normals of
 * the triangles at the vertex, weighted by their areas. Only triangles from first_triangle on
 * count. */
void sample_smooth_normals(struct mesh *mesh, guint first_vertex, guint first_triangle);
/* Sets `to` to the R, G and B of an option. One given value is used for all three. If no value is
 * given, `to` becomes r, g, b. */
void sample_set_rgb(float to[3], const struct option_doubles *given, float r, float g, float b);
/* Sets the gloss of a vertex from the options. gloss, along and across are the values of the kind
 * of sample. Such a value is used if the option of this name is not set: a gloss below 0, or a
 * roughness that is 0 or less. */
void sample_set_gloss(struct vertex *to, const struct sample_options *options, double gloss,
                      double along, double across);
/* Sets the error that libpng cannot read the picture at path. Frees image. Always returns FALSE. */
gboolean sample_picture_error(png_image *image, const char *path, GError **error);

/* Adds a surface z(x, y) with walls down to the turntable. The surface has a grid of nx × ny cells
 * over the size in the options. The function `relief` is called for each vertex of the grid, with
 * p[0] and p[1] set. It sets p[2], the albedo and the gloss of the vertex. */
typedef void (*SampleRelief)(struct vertex *vertex, gconstpointer data);
void sample_add_relief(struct mesh *mesh, const struct sample_options *options, int nx, int ny,
                       SampleRelief relief, gconstpointer data);

/* Adds a round post from the turntable up to z_mm, with a matt face of the given albedo and black
 * sides. */
void sample_add_post(struct mesh *mesh, double x_mm, double y_mm, double z_mm, double radius_mm,
                     const float albedo[3]);

struct mesh *sample_weave(const struct sample_options *options);
struct mesh *sample_peanuts(const struct sample_options *options);
struct mesh *sample_grass(const struct sample_options *options);
struct mesh *sample_bluepipe(const struct sample_options *options);
struct mesh *sample_block(const struct sample_options *options);
struct mesh *sample_mail(const struct sample_options *options);
struct mesh *sample_relief(const struct sample_options *options); /* flat, brushed, brick, ridges */
struct mesh *sample_picture(const struct sample_options *options, GError **error);
struct mesh *sample_targets(const struct sample_options *options); /* poles, balls */
struct mesh *sample_obj(const struct sample_options *options, GError **error);
struct mesh *sample_plate(const struct sample_options *options, GError **error);

/* Returns a hash of x. All random numbers of the simulated world come from this hash. */
static inline guint64 sample_hash(guint64 x) {
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
    return x ^ (x >> 31);
}

struct sample_random {
    guint64 state;
};

static inline double sample_uniform(struct sample_random *random) { /* returns a number in [0, 1) */
    random->state += 0x9e3779b97f4a7c15u;
    return (double)(sample_hash(random->state) >> 11) * 0x1p-53;
}

/* Returns an approximately normal deviate with variance 1. Its absolute value is at most 6. */
static inline double sample_deviate(struct sample_random *random) {
    double sum = -6;
    for (int i = 0; i < 12; i++)
        sum += sample_uniform(random);
    return sum;
}

/* Returns smooth noise from −1 to 1 on a grid with cells of size 1. The noise repeats after
 * period_x cells in x and period_y cells in y. */
double sample_noise(double x, double y, int period_x, int period_y, guint64 seed);
