#include "sample.h"

#include <math.h>

/* The sample is peanuts in their shells, strewn over a tray. A peanut is a surface of revolution
 * with a waist. The peanuts lie on each other, so that some peanuts hide others. */

#define ALONG       28
#define AROUND      22
#define MAX_PEANUTS 110

struct peanut {
    const struct sample_options *options;
    double x, y, z, turn, tilt;
    double length_mm, radius_mm, waist, lean;
    float albedo[3];
    guint64 seed;
};

/* Returns the radius at s along the axis, with s from −1 to 1. The shape is a capsule with a waist.
 * One end is a little thicker. */
static double profile(const struct peanut *peanut, double s) {
    double end = sqrt(MAX(0, 1 - pow(fabs(s), 3.2)));
    double waist = 1 - peanut->waist * exp(-pow((s - peanut->lean) / 0.33, 2));
    return peanut->radius_mm * end * waist * (1 - 0.08 * s);
}

static void to_world(const struct peanut *peanut, const double local[3], float to[3],
                     double weight) {
    double ct = cos(peanut->tilt), st = sin(peanut->tilt);
    double c = cos(peanut->turn), s = sin(peanut->turn);
    double x = ct * local[0] - st * local[2], z = st * local[0] + ct * local[2];
    to[0] = (float)(c * x - s * local[1] + weight * peanut->x);
    to[1] = (float)(s * x + c * local[1] + weight * peanut->y);
    to[2] = (float)(z + weight * peanut->z);
}

static void shell_vertex(const struct peanut *peanut, int i, int k, struct vertex *to) {
    double s = -cos(G_PI * i / ALONG), turn = 2 * G_PI * k / AROUND;
    double ribs = 0.5 + 0.5 * cos(8 * turn), rings = 0.5 + 0.5 * cos(11 * s);
    double net = MAX(pow(ribs, 3), 0.8 * pow(rings, 4));
    double rough = sample_noise(s * 7 + 20, turn * 3, 100, 100, peanut->seed);
    double r = profile(peanut, s) * (0.94 + 0.06 * net + 0.02 * rough);
    double local[3] = {s * peanut->length_mm / 2, r * cos(turn), r * sin(turn)};
    const double axis[3] = {1, 0, 0};
    to_world(peanut, local, to->p, 1);
    to_world(peanut, axis, to->t, 0);
    for (int c = 0; c < 3; c++)
        to->albedo[c] = (float)CLAMP(peanut->albedo[c] * (0.72 + 0.3 * net + 0.15 * rough), 0, 1);
    sample_set_gloss(to, peanut->options, 0.03, 0.35, 0.35);
}

static void add_peanut(struct mesh *mesh, const struct peanut *peanut) {
    guint32 first = mesh->vertices->len;
    guint first_triangle = mesh->triangles->len;
    for (int i = 0; i <= ALONG; i++) {
        for (int k = 0; k < AROUND; k++) {
            struct vertex vertex = {0};
            shell_vertex(peanut, i, k, &vertex);
            sample_add_vertex(mesh, &vertex);
        }
    }
    for (guint32 i = 0; i < ALONG; i++)
        for (guint32 k = 0; k < AROUND; k++) {
            guint32 a = first + i * AROUND + k, b = first + i * AROUND + (k + 1) % AROUND;
            sample_add_triangle(mesh, a, b + AROUND, b);
            sample_add_triangle(mesh, a, a + AROUND, b + AROUND);
        }
    sample_smooth_normals(mesh, first, first_triangle);
}

static void tray(struct vertex *vertex, gconstpointer data) {
    const struct sample_options *o = data;
    double u = vertex->p[0] / o->width_mm + 0.5, v = vertex->p[1] / o->height_mm + 0.5;
    double grain = sample_noise(u * 3, v * 70, 3, 70, (guint64)o->seed + 5);
    vertex->p[2] = (float)o->base_mm;
    sample_set_rgb(vertex->albedo, &o->albedo2, 0.16f, 0.11f, 0.08f);
    for (int k = 0; k < 3; k++)
        vertex->albedo[k] *= (float)(1 + 0.25 * grain);
}

/* A lobe of a peanut, taken as a ball. To find where peanuts touch, each peanut is taken as two
 * lobes. */
struct lobe {
    double x, y, z, r;
};

/* Returns the lowest z of the middle of a lobe at which the lobe lies above the tray and on the
 * earlier lobes. Lobes may overlap a little. */
static double resting_height(const GArray *lobes, double base, const struct lobe *lobe) {
    double z = base + lobe->r;
    for (guint i = 0; i < lobes->len; i++) {
        const struct lobe *other = &g_array_index(lobes, struct lobe, i);
        double dx = lobe->x - other->x, dy = lobe->y - other->y;
        double reach = 0.93 * (lobe->r + other->r), up2 = reach * reach - dx * dx - dy * dy;
        if (up2 > 0)
            z = MAX(z, other->z + sqrt(up2));
    }
    return z;
}

static void shape_peanut(const struct sample_options *o, struct sample_random *random,
                         struct peanut *to) {
    to->options = o;
    to->radius_mm = o->relief_mm / 3.2 * (0.82 + 0.3 * sample_uniform(random));
    to->length_mm = to->radius_mm * (4.3 + 0.9 * sample_uniform(random));
    to->waist = 0.18 + 0.17 * sample_uniform(random);
    to->lean = 0.3 * (sample_uniform(random) - 0.5);
    to->turn = 2 * G_PI * sample_uniform(random);
    double half = to->length_mm / 2 + 0.1;
    to->x = (sample_uniform(random) - 0.5) * MAX(0, o->width_mm - 2 * half);
    to->y = (sample_uniform(random) - 0.5) * MAX(0, o->height_mm - 2 * half);
    double tone = 0.75 + 0.4 * sample_uniform(random), warm = sample_uniform(random);
    sample_set_rgb(to->albedo, &o->albedo, 0.66f, 0.44f, (float)(0.19 + 0.08 * warm));
    for (int k = 0; k < 3; k++)
        to->albedo[k] = (float)MIN(1, to->albedo[k] * tone);
    to->seed = sample_hash(random->state);
}

/* Drops a peanut on the earlier peanuts. Sets its height and tilt, and appends its lobes. Returns
 * FALSE if the peanut would lie too high or too steeply. */
static gboolean drop_peanut(GArray *lobes, struct peanut *peanut) {
    const struct sample_options *o = peanut->options;
    double arm = 0.27 * peanut->length_mm;
    struct lobe pair[2];
    for (int i = 0; i < 2; i++) {
        double side = i ? arm : -arm;
        pair[i] = (struct lobe){peanut->x + side * cos(peanut->turn),
                                peanut->y + side * sin(peanut->turn), 0, peanut->radius_mm};
        pair[i].z = resting_height(lobes, o->base_mm, &pair[i]);
    }
    double rise = pair[1].z - pair[0].z;
    double top = MAX(pair[0].z, pair[1].z) + 1.1 * peanut->radius_mm + 0.2 * fabs(rise);
    if (fabs(rise) > 0.5 * arm || top > o->base_mm + o->relief_mm * 1.1)
        return FALSE;
    peanut->z = (pair[0].z + pair[1].z) / 2;
    peanut->tilt = asin(rise / (2 * arm));
    g_array_append_vals(lobes, pair, 2);
    return TRUE;
}

struct mesh *sample_peanuts(const struct sample_options *options) {
    struct mesh *mesh = sample_mesh_new();
    sample_add_relief(mesh, options, 96, 96, tray, options);
    struct sample_random random = {sample_hash((guint64)options->seed + 11)};
    g_autoptr(GArray) lobes = g_array_new(FALSE, FALSE, sizeof(struct lobe));
    for (int throw = 0; throw < 2500 && lobes->len < 2 * MAX_PEANUTS; throw ++) {
        struct peanut peanut = {0};
        shape_peanut(options, &random, &peanut);
        if (drop_peanut(lobes, &peanut))
            add_peanut(mesh, &peanut);
    }
    return mesh;
}
