/*
 * Materials that are analytic functions of texel, view and light. Pictures of them are compared
 * with rays, hit points and frames that are computed in doubles without the renderer's code. An
 * error of orientation anywhere changes the colour.
 */
#pragma once

#include "direction.h"
#include "exr/exr.h"
#include "gpu_fixture.h"
#include "scene/viewer.h"
#include "shapes/scene.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

#define DEG (G_PI / 180.0)
#define W   7 /* number of texels; it is odd, not a power of two, and the material is not square */
#define H   5

/* Returns s a + t b. */
struct vec3 view_fixture_mix(struct vec3 a, double s, struct vec3 b, double t);

/* The material of view_fixture_material(). LIGHT has red = 0.5 + 0.4 l_x and green = 0.5 + 0.4 l_y.
 * VIEW has red = 0.5 + 0.4 v_x and green = 0.5 + 0.4 v_y, where its terms 1 and 2 are the parts
 * with v. TEXEL has red and green that increase with the column and the row. WAVE has one period of
 * a sine and of a cosine over the tile. In all of these, blue is texel_code(). GREY is 0.5, and
 * COSINE is l_z. Terms 3 and 4 have the weight 0. */
enum kind { LIGHT, VIEW, TEXEL, GREY, COSINE, WAVE, N_KINDS };

double texel_code(int i, int j);
void fill_texel(enum kind kind, int term, struct vec3 l, int i, int j, float *ret);
struct eigenmaps *view_fixture_material(enum kind kind, int n_rings, int n_phi);
struct viewer_settings view_fixture_settings(void);

/* Returns the ray through the middle of a pixel. The camera is computed independently of the
 * renderer. */
struct vec3 view_fixture_ray(const struct viewer_settings *s, double radius, int width, int height,
                             int i, int j, struct vec3 *ret_eye);

struct hit {
    gboolean found;
    double u, v; /* one tile */
    struct vec3 t, b, n, to_eye;
};

/* Finds the first hit of a ray with the torus. Each step along the ray is as long as the distance
 * from the surface. */
struct hit view_fixture_hit_torus(struct vec3 eye, struct vec3 d);

struct check {
    enum kind kind;
    const struct viewer_settings *settings;
    const float *pixels;
    int width, height;
    double radius;
    struct hit (*find)(struct vec3 eye, struct vec3 d);
};

/* Compares every pixel whose value is certain, of which there must be at least at_least. Nearly all
 * texels must be correct. Other values must agree within the error of linear interpolation between
 * the directions of the material. */
void view_fixture_compare(const struct check *c, double tolerance, int at_least);
Viewer *view_fixture_view(enum kind kind, int n_rings, int n_phi, const struct mesh *mesh);

Viewer *view_fixture_plane(enum kind kind, int n_rings, int n_phi); /* on scene_plane() */

/* Returns float[height][width][4] from viewer_render_linear(), which must succeed. */
float *view_fixture_linear(Viewer *view, const struct viewer_settings *s, int width, int height);

/* Returns width × height × 3 bytes. */
guint8 *view_fixture_read_png(const char *path, int *ret_width, int *ret_height);

#define VIEWER BUILD_DIR "/bin/mesorig-view"
gboolean view_fixture_have_program(void); /* if FALSE, the caller returns and the test is skipped */

/* Writes a view of the BTF whose eigen-maps view_fixture_material() returns. Each view is one
 * file. */
void write_view(enum kind kind, const struct eigenmaps *m, int view, const char *dir);
char *view_fixture_write_btf(enum kind kind, int n_rings, int n_phi);
void remove_folder(const char *path);

/* Makes a session directory that only contains eigen-maps. */
char *view_fixture_write_session(void);
void view_fixture_remove_session(const char *dir, const char *const *pictures);
