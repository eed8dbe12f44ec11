#include "sample.h"

#include <math.h>
#include <string.h>

/* The sample has square blocks of different heights on a floor, with upright walls, narrow gaps and
 * bevelled edges. */

#define GAP   0.07 /* half the width of a gap, as a share of the period */
#define BEVEL 0.05 /* width of the bevel, as a share of the period */
#define CUTS  5    /* a face has CUTS² cells, because bounced light is only computed at vertices */

/* Adds a flat face. The corners are counter-clockwise seen from outside. */
static void add_face(struct mesh *mesh, const double corners[4][3], const struct vertex *like) {
    guint32 first = mesh->vertices->len;
    guint first_triangle = mesh->triangles->len;
    for (int j = 0; j <= CUTS; j++)
        for (int i = 0; i <= CUTS; i++) {
            struct vertex vertex = *like;
            double s = (double)i / CUTS, t = (double)j / CUTS;
            for (int k = 0; k < 3; k++) {
                double low = (1 - s) * corners[0][k] + s * corners[1][k];
                double high = (1 - s) * corners[3][k] + s * corners[2][k];
                vertex.p[k] = (float)((1 - t) * low + t * high);
                vertex.t[k] = (float)(corners[1][k] - corners[0][k]);
            }
            sample_add_vertex(mesh, &vertex);
        }
    for (guint32 j = 0; j < CUTS; j++)
        for (guint32 i = 0; i < CUTS; i++) {
            guint32 a = first + j * (CUTS + 1) + i;
            sample_add_quad(mesh, a, a + 1, a + CUTS + 2, a + CUTS + 1);
        }
    sample_smooth_normals(mesh, first, first_triangle);
}

/* Adds a block. middle is its middle in x and y. half is half its width in x and y. z[0] is the
 * height of the floor, and z[1] the height of the top. */
static void add_block(struct mesh *mesh, const double middle[2], const double half[2],
                      const double z[2], double bevel, const struct vertex *like) {
    static const int sides[4][2] = {{-1, -1}, {1, -1}, {1, 1}, {-1, 1}};
    /* Three rings of corners, each counter-clockwise: the foot of the walls, the upper edge of the
     * walls, and the edge of the top. */
    double ring[3][4][3];
    for (int c = 0; c < 4; c++)
        for (int r = 0; r < 3; r++) {
            for (int k = 0; k < 2; k++)
                ring[r][c][k] = middle[k] + sides[c][k] * (half[k] - (r == 2 ? bevel : 0));
            ring[r][c][2] = r == 0 ? z[0] : z[1] - (r == 1 ? bevel : 0);
        }
    add_face(mesh, (const double(*)[3])ring[2], like);
    for (int c = 0; c < 4; c++)
        for (int r = 0; r < 2; r++) {
            double corners[4][3];
            memcpy(corners[0], ring[r][c], sizeof corners[0]);
            memcpy(corners[1], ring[r][(c + 1) % 4], sizeof corners[1]);
            memcpy(corners[2], ring[r + 1][(c + 1) % 4], sizeof corners[2]);
            memcpy(corners[3], ring[r + 1][c], sizeof corners[3]);
            add_face(mesh, (const double(*)[3])corners, like);
        }
}

static void block_floor(struct vertex *vertex, gconstpointer data) {
    const struct sample_options *o = data;
    vertex->p[2] = (float)o->base_mm;
    sample_set_rgb(vertex->albedo, &o->albedo2, 0.12f, 0.11f, 0.10f);
}

struct mesh *sample_block(const struct sample_options *options) {
    const struct sample_options *o = options;
    struct mesh *mesh = sample_mesh_new();
    sample_add_relief(mesh, o, 96, 96, block_floor, o);
    int n_x = sample_count(o->width_mm / o->repeats, o->period_mm, 1);
    int n_y = sample_count(o->height_mm / o->repeats, o->period_mm, 1);
    double pitch[2] = {o->width_mm / o->repeats / n_x, o->height_mm / o->repeats / n_y};
    double half[2] = {pitch[0] * (0.5 - GAP), pitch[1] * (0.5 - GAP)};
    for (int block = 0; block < n_x * n_y * o->repeats * o->repeats; block++) {
        int i = block % (n_x * o->repeats), j = block / (n_x * o->repeats);
        struct sample_random random = {
            sample_hash((guint64)o->seed * 2713 + (guint64)(j % n_y * n_x + i % n_x))};
        double rise = o->relief_mm * (0.4 + 0.6 * sample_uniform(&random));
        const double middle[2] = {(i + 0.5) * pitch[0] - o->width_mm / 2,
                                  (j + 0.5) * pitch[1] - o->height_mm / 2};
        struct vertex like = {0};
        double tone = 0.7 + 0.45 * sample_uniform(&random), warm = sample_uniform(&random);
        sample_set_rgb(like.albedo, &o->albedo, 0.56f, (float)(0.34 + 0.16 * warm),
                       (float)(0.18 + 0.22 * warm));
        for (int k = 0; k < 3; k++)
            like.albedo[k] = (float)MIN(1, like.albedo[k] * tone);
        sample_set_gloss(&like, o, 0.02, 0.35, 0.35);
        add_block(mesh, middle, half, (const double[2]){o->base_mm, o->base_mm + rise},
                  MIN(BEVEL * MIN(pitch[0], pitch[1]), rise / 2), &like);
    }
    return mesh;
}
