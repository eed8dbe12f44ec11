/*
 * Sampling by slices, after Filip et al. 2013 and Vávra and Filip 2017, as far as their abstracts
 * and first pages say how: for lights (and views) at fixed elevations the two azimuths span a
 * plane, which is measured along one-dimensional slices in two perpendicular directions, of
 * constant φ_l − φ_v (both turn together) and of constant φ_l + φ_v (they turn against each other),
 * more of them where the material needs it. In this rig the five cameras see each shot, so a slice
 * is of one elevation of the lights and of all elevations of the views.
 *
 * Begin: of each elevation the slice of constant φ_l − φ_v nearest to 180°, where highlights are.
 * Between the slices values ρ / cos θ_l are interpolated by radial functions |x − x'| and a
 * constant, x being (v, l, h) with the unit half vector h. (They compare radial and barycentric
 * functions; which coordinates they have is not in what was at hand.)
 *
 * Their rule for the next slice was not at hand either. Here it is the one where this
 * interpolation and the nearest measured value differ most, root of the mean square over its
 * missing values, of probes; of one elevation and kind at most one is added before differences are
 * computed again, and a quarter as many as are taken. Samples of a slice are the rig's directions,
 * all of them (theirs are adaptive along the slice as well). Price of moves, for which slices are
 * made, is not counted here.
 */
#include "prediction_parts.h"

#include <lapacke.h>
#include <math.h>
#include <string.h>

#include "bench.h"

#define MAX_PROBES 30 /* texels that the next slice is chosen by */
#define AXES       9

struct slice {
    int elevation, kind; /* kind 0: constant φ_l − φ_v; 1: constant φ_l + φ_v */
    double at_deg;
    int n_shots, n_room, *shots;
    double score;
};

static void prediction_radial_place(const struct prediction_scene *scene, int pair, double *ret) {
    const struct vec3 v = scene->view[pair / scene->n_lights];
    const struct vec3 l = scene->light[pair % scene->n_lights];
    const struct vec3 h = vec3_unit(vec3_add(v, l));
    const double all[AXES] = {v.x, v.y, v.z, l.x, l.y, l.z, h.x, h.y, h.z};
    memcpy(ret, all, sizeof all);
}

static double prediction_radial_distance(const double *a, const double *b) {
    double sum = 0;
    for (int i = 0; i < AXES; i++)
        sum += (a[i] - b[i]) * (a[i] - b[i]);
    return sqrt(sum);
}

/* With A_ij = |x_i − x_j| of the known places and 1 the constant, weights w of a missing place x
 * solve [A 1; 1ᵀ 0] (w, μ) = (|x − x_i|, 1). */
struct prediction_radial *prediction_radial_new(const struct prediction_scene *scene,
                                                const gboolean *taken) {
    struct prediction_radial *radial = g_new0(struct prediction_radial, 1);
    radial->scene = scene;
    radial->known = g_new(int, scene->n_pairs);
    radial->missing = g_new(int, scene->n_pairs);
    for (int p = 0; p < scene->n_pairs; p++)
        if (taken[scene->groups[p]])
            radial->known[radial->n_known++] = p;
        else
            radial->missing[radial->n_missing++] = p;
    const int m = radial->n_known, u = radial->n_missing, n = m + 1;
    g_autofree double *at = g_new(double, AXES *(gsize)scene->n_pairs);
    g_autofree double *a = g_new0(double, (gsize)n *(gsize)n);
    g_autofree double *b = g_new(double, (gsize)n *(gsize)MAX(u, 1));
    g_autofree lapack_int *pivots = g_new(lapack_int, n);
    radial->nearest = g_new0(int, MAX(u, 1));
    radial->weights = g_new(double, MAX((gsize)u * (gsize)m, 1));
    for (int p = 0; p < scene->n_pairs; p++)
        prediction_radial_place(scene, p, at + AXES * p);
    for (int i = 0; i < m; i++) {
        for (int j = 0; j < m; j++)
            a[(gsize)i * (gsize)n + (gsize)j] = prediction_radial_distance(
                at + AXES * radial->known[i], at + AXES * radial->known[j]);
        a[(gsize)i * (gsize)n + (gsize)m] = a[(gsize)m * (gsize)n + (gsize)i] = 1;
    }
    for (int k = 0; k < u; k++) {
        double *to = b + (gsize)k * (gsize)n;
        for (int i = 0; i < m; i++) {
            to[i] = prediction_radial_distance(at + AXES * radial->missing[k],
                                               at + AXES * radial->known[i]);
            if (to[i] < to[radial->nearest[k]])
                radial->nearest[k] = i;
        }
        to[m] = 1;
    }
    for (int k = 0; k < u; k++)
        radial->nearest[k] = radial->known[radial->nearest[k]];
    if (u > 0 && LAPACKE_dgesv(LAPACK_COL_MAJOR, n, u, a, n, pivots, b, n) != 0)
        bench_fail(1, "two pairs of directions of the session are the same");
    for (int k = 0; k < u; k++)
        memcpy(radial->weights + (gsize)k * (gsize)m, b + (gsize)k * (gsize)n,
               sizeof(double) * (gsize)m);
    return radial;
}

void prediction_radial_free(struct prediction_radial *radial) {
    if (!radial)
        return;
    g_free(radial->known);
    g_free(radial->missing);
    g_free(radial->weights);
    g_free(radial->nearest);
    g_free(radial);
}

/* ρ / cos θ_l of a missing pair, in a row of values of one colour. */
static double prediction_radial_value(const struct prediction_radial *radial, const double *known,
                                      int k) {
    const double *w = radial->weights + (gsize)k * (gsize)radial->n_known;
    double sum = 0;
    for (int i = 0; i < radial->n_known; i++)
        sum += w[i] * known[i];
    return sum;
}

static void prediction_radial_known(const struct prediction_radial *radial, const float *row,
                                    double *ret) {
    const struct prediction_scene *scene = radial->scene;
    for (int i = 0; i < radial->n_known; i++)
        ret[i] = (double)row[radial->known[i]] / scene->light[radial->known[i] % scene->n_lights].z;
}

void prediction_radial_fill(const struct prediction_radial *radial, float *values) {
    const struct prediction_scene *scene = radial->scene;
    g_autofree double *known = g_new(double, radial->n_known);
    for (int c = 0; c < 3; c++) {
        float *row = values + c * scene->n_pairs;
        prediction_radial_known(radial, row, known);
        for (int k = 0; k < radial->n_missing; k++) {
            const int pair = radial->missing[k];
            const double value = prediction_radial_value(radial, known, k);
            row[pair] = (float)fmax(value * scene->light[pair % scene->n_lights].z, 0);
        }
    }
}

static double slices_phi_deg(struct vec3 v) {
    return atan2(v.y, v.x) * 180 / G_PI;
}

static void slices_add(GArray *slices, int elevation, int kind, double at_deg, int shot) {
    struct slice *slice = NULL;
    at_deg = fmod(fmod(at_deg, 360) + 360, 360);
    for (guint i = 0; i < slices->len && !slice; i++) {
        struct slice *one = &g_array_index(slices, struct slice, i);
        const double off = fabs(one->at_deg - at_deg);
        if (one->elevation == elevation && one->kind == kind && fmin(off, 360 - off) < 0.5)
            slice = one;
    }
    if (!slice) {
        const struct slice one = {.elevation = elevation, .kind = kind, .at_deg = at_deg};
        g_array_append_val(slices, one);
        slice = &g_array_index(slices, struct slice, slices->len - 1);
    }
    if (slice->n_shots == slice->n_room)
        slice->shots = g_renew(int, slice->shots, slice->n_room = 2 * slice->n_room + 4);
    slice->shots[slice->n_shots++] = shot;
}

static GArray *slices_find(const struct prediction_scene *scene) {
    GArray *slices = g_array_new(FALSE, FALSE, sizeof(struct slice));
    for (int s = 0; s < scene->n_shots; s++) {
        const struct vec3 l = scene->light[scene->source[s]];
        const struct vec3 v = scene->view[scene->shots[s].pairs[0] / scene->n_lights];
        const int elevation = (int)lround(acos(fmin(l.z, 1)) * 180 / G_PI);
        const double light_deg = slices_phi_deg(l), view_deg = slices_phi_deg(v);
        slices_add(slices, elevation, 0, light_deg - view_deg, s);
        slices_add(slices, elevation, 1, light_deg + view_deg, s);
    }
    return slices;
}

static void slices_free(GArray *slices) {
    for (guint i = 0; i < slices->len; i++)
        g_free(g_array_index(slices, struct slice, i).shots);
    g_array_unref(slices);
}

/* Takes the shots of a slice until n are taken. */
static void slices_take(const struct slice *slice, int n, int *n_taken, gboolean *taken) {
    for (int i = 0; i < slice->n_shots && *n_taken < n; i++)
        if (!taken[slice->shots[i]]) {
            taken[slice->shots[i]] = TRUE;
            ++*n_taken;
        }
}

/* The mean square of what the interpolation and the nearest value differ by, of each shot. */
static void slices_differences(const struct prediction_scene *scene, const gboolean *taken,
                               double *ret_shots) {
    struct prediction_radial *radial = prediction_radial_new(scene, taken);
    const int n = MIN(MAX_PROBES, scene->n_texels);
    g_autofree float *values = g_new(float, 3 * scene->n_pairs);
    g_autofree double *known = g_new(double, radial->n_known);
    memset(ret_shots, 0, sizeof(double) * (gsize)scene->n_shots);
    for (int i = 0; i < n; i++) {
        prediction_bench_texel(scene, (int)((gint64)i * scene->n_texels / n), taken, values);
        for (int c = 0; c < 3; c++) {
            const float *row = values + c * scene->n_pairs;
            prediction_radial_known(radial, row, known);
            for (int k = 0; k < radial->n_missing; k++) {
                const int pair = radial->missing[k], near = radial->nearest[k];
                const double cosine = scene->light[pair % scene->n_lights].z;
                const double off =
                    cosine * (prediction_radial_value(radial, known, k) -
                              (double)row[near] / scene->light[near % scene->n_lights].z);
                ret_shots[scene->groups[pair]] += off * off;
            }
        }
    }
    prediction_radial_free(radial);
}

static struct slice *slices_best(GArray *slices) {
    struct slice *best = NULL;
    for (guint i = 0; i < slices->len; i++) {
        struct slice *slice = &g_array_index(slices, struct slice, i);
        if (slice->score > 0 && (!best || slice->score > best->score))
            best = slice;
    }
    return best;
}

static void slices_begin(GArray *slices, int n, int *n_taken, gboolean *taken) {
    for (guint i = 0; i < slices->len; i++) {
        struct slice *slice = &g_array_index(slices, struct slice, i);
        gboolean nearest = slice->kind == 0;
        for (guint k = 0; k < slices->len && nearest; k++) {
            const struct slice *other = &g_array_index(slices, struct slice, k);
            const double off = fabs(other->at_deg - 180) - fabs(slice->at_deg - 180);
            if (other->kind == 0 && other->elevation == slice->elevation &&
                (off < -1e-6 || (off < 1e-6 && k < i)))
                nearest = FALSE;
        }
        if (nearest)
            slices_take(slice, n, n_taken, taken);
    }
}

void prediction_slices_choose(const struct prediction_scene *scene, int n, gboolean *taken) {
    GArray *slices = slices_find(scene);
    g_autofree double *shots = g_new(double, scene->n_shots);
    int n_taken = 0;
    for (int s = 0; s < scene->n_shots; s++)
        n_taken += taken[s];
    if (n_taken == 0)
        slices_begin(slices, n, &n_taken, taken);
    while (n_taken < MIN(n, scene->n_shots)) {
        const int until = n_taken + n_taken / 4;
        slices_differences(scene, taken, shots);
        for (guint i = 0; i < slices->len; i++) {
            struct slice *slice = &g_array_index(slices, struct slice, i);
            int missing = 0;
            slice->score = 0;
            for (int k = 0; k < slice->n_shots; k++)
                if (!taken[slice->shots[k]]) {
                    slice->score += shots[slice->shots[k]];
                    missing++;
                }
            if (missing > 0)
                slice->score = slice->score / missing + G_MINDOUBLE;
        }
        do {
            struct slice *best = slices_best(slices);
            if (!best)
                break;
            slices_take(best, n, &n_taken, taken);
            for (guint i = 0; i < slices->len; i++) {
                struct slice *slice = &g_array_index(slices, struct slice, i);
                if (slice->elevation == best->elevation && slice->kind == best->kind &&
                    slice != best)
                    slice->score = 0;
            }
            best->score = 0;
        } while (n_taken < MIN(until, n));
    }
    slices_free(slices);
}
