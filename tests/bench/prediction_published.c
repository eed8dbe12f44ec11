/*
 * interpolated: every so manieth light of each turntable angle; ρ / cos θ_l of a view interpolated
 * between its lights by distance in the disc of directions (inverse squares of the four nearest).
 *
 * low rank: the matrix of (texel, colour, view) × light, of ρ / cos θ_l, is completed by one of
 * rank RANK (alternating least squares; the ridge grows with the number of values: Zhou et al.
 * 2008).
 */
#include "prediction_parts.h"

#include <math.h>
#include <string.h>

#include "btf/btf_matrix.h"

#define RANK    6
#define ALS     12   /* rounds of the completion */
#define RIDGE   0.02 /* of the mean squares, a value */
#define NEAREST 4

void prediction_regular(const struct prediction_scene *scene, int part, gboolean *taken) {
    for (int s = 0; s < scene->n_shots; s++)
        taken[s] = (scene->source[s] + 7 * scene->angle[s]) % part == 0;
}

void prediction_interpolate(const struct prediction_scene *scene, const gboolean *taken,
                            float *values) {
    for (int v = 0; v < scene->n_views; v++)
        for (int l = 0; l < scene->n_lights; l++) {
            const int pair = v * scene->n_lights + l;
            double nearest[NEAREST], sum = 0, all[3] = {0};
            int of[NEAREST], n = 0;
            if (taken[scene->groups[pair]])
                continue;
            for (int k = 0; k < scene->n_lights; k++) {
                const double d = hypot(scene->light[k].x - scene->light[l].x,
                                       scene->light[k].y - scene->light[l].y);
                int at = n;
                if (!taken[scene->groups[v * scene->n_lights + k]])
                    continue;
                while (at > 0 && nearest[at - 1] > d)
                    at--;
                if (at == NEAREST)
                    continue;
                for (int i = MIN(n, NEAREST - 1); i > at; i--) {
                    nearest[i] = nearest[i - 1];
                    of[i] = of[i - 1];
                }
                nearest[at] = d;
                of[at] = k;
                n = MIN(n + 1, NEAREST);
            }
            for (int i = 0; i < n; i++) {
                const double w = 1 / (nearest[i] * nearest[i] + 1e-9);
                sum += w;
                for (int c = 0; c < 3; c++)
                    all[c] += w * (double)values[c * scene->n_pairs + v * scene->n_lights + of[i]] /
                              scene->light[of[i]].z;
            }
            for (int c = 0; c < 3; c++)
                values[c * scene->n_pairs + pair] =
                    (float)(n > 0 ? all[c] / sum * scene->light[l].z : 0);
        }
}

/* Solves the normal equations a x = b of RANK unknowns (Cholesky); a and b are overwritten. */
static void prediction_complete_solve(double a[RANK][RANK], double *b) {
    for (int i = 0; i < RANK; i++) {
        for (int j = 0; j <= i; j++) {
            for (int k = 0; k < j; k++)
                a[i][j] -= a[i][k] * a[j][k];
            a[i][j] = i == j ? sqrt(fmax(a[i][i], 1e-30)) : a[i][j] / a[j][j];
        }
        for (int k = 0; k < i; k++)
            b[i] -= a[i][k] * b[k];
        b[i] /= a[i][i];
    }
    for (int i = RANK - 1; i >= 0; i--) {
        for (int k = i + 1; k < RANK; k++)
            b[i] -= a[k][i] * b[k];
        b[i] /= a[i][i];
    }
}

/* Factors of a row of ρ / cos θ_l less its mean, which is returned. */
static double prediction_complete_row(const struct prediction_completion *job, const float *row,
                                      int view, double *ret) {
    double a[RANK][RANK] = {{0}}, mean = 0;
    int known = 0;
    memset(ret, 0, sizeof(double) * RANK);
    for (int l = 0; l < job->scene->n_lights; l++)
        if (job->taken[job->scene->groups[view * job->scene->n_lights + l]]) {
            known++;
            mean += (double)row[l] / job->scene->light[l].z;
        }
    mean /= MAX(known, 1);
    for (int i = 0; i < RANK; i++)
        a[i][i] = RIDGE * MAX(known, 1);
    for (int l = 0; l < job->scene->n_lights; l++) {
        const double *f = job->lights + RANK * l;
        if (!job->taken[job->scene->groups[view * job->scene->n_lights + l]])
            continue;
        for (int i = 0; i < RANK; i++) {
            ret[i] += f[i] * ((double)row[l] / job->scene->light[l].z - mean);
            for (int j = 0; j <= i; j++)
                a[i][j] += f[i] * f[j];
        }
    }
    prediction_complete_solve(a, ret);
    return mean;
}

void prediction_complete_fit(struct prediction_completion *job) {
    const struct prediction_scene *scene = job->scene;
    const int n_lights = scene->n_lights, n = MIN(PREDICTION_PROBES, scene->n_texels);
    g_autoptr(GRand) draw = g_rand_new_with_seed(1);
    g_autofree float *values = g_new(float, 3 * scene->n_pairs);
    g_autofree double *a = g_new(double, n_lights *RANK *RANK), *b = g_new(double, n_lights *RANK);
    g_autofree double *of_light = g_new(double, n_lights);
    job->lights = g_new(double, n_lights *RANK);
    for (int l = 0; l < n_lights; l++)
        for (int k = 0; k < RANK; k++)
            job->lights[l * RANK + k] = k == 0 ? 1 : 0.3 * (g_rand_double(draw) - 0.5);
    for (int round = 0; round < ALS; round++) {
        double squares = 0;
        gint64 count = 0;
        memset(of_light, 0, sizeof(double) * (gsize)n_lights);
        memset(a, 0, sizeof(double) * (gsize)(n_lights * RANK * RANK));
        memset(b, 0, sizeof(double) * (gsize)(n_lights * RANK));
        for (int i = 0; i < n; i++) {
            prediction_bench_texel(scene, prediction_bench_probe(scene, i), job->taken, values);
            for (int row = 0; row < 3 * scene->n_views; row++) {
                double x[RANK];
                const float *at = values + (gsize)row * (gsize)n_lights;
                const int view = row % scene->n_views;
                const double mean = prediction_complete_row(job, at, view, x);
                for (int l = 0; l < n_lights; l++) {
                    if (!job->taken[scene->groups[view * n_lights + l]])
                        continue;
                    const double value = (double)at[l] / scene->light[l].z - mean;
                    squares += value * value;
                    count++;
                    of_light[l]++;
                    for (int p = 0; p < RANK; p++) {
                        b[l * RANK + p] += x[p] * value;
                        for (int q = 0; q < RANK; q++)
                            a[(l * RANK + p) * RANK + q] += x[p] * x[q];
                    }
                }
            }
        }
        const double square = squares / (double)MAX(count, 1);
        for (int l = 0; l < n_lights; l++) {
            double m[RANK][RANK];
            memcpy(m, a + l * RANK * RANK, sizeof m);
            for (int p = 0; p < RANK; p++)
                m[p][p] += RIDGE * square * of_light[l] + 1e-12;
            memcpy(job->lights + l * RANK, b + l * RANK, sizeof(double) * RANK);
            prediction_complete_solve(m, job->lights + l * RANK);
        }
    }
}

void prediction_complete(const struct prediction_completion *job, float *values) {
    const struct prediction_scene *scene = job->scene;
    for (int row = 0; row < 3 * scene->n_views; row++) {
        float *at = values + (gsize)row * (gsize)scene->n_lights;
        double x[RANK];
        const double mean = prediction_complete_row(job, at, row % scene->n_views, x);
        for (int l = 0; l < scene->n_lights; l++) {
            double sum = mean;
            if (job->taken[scene->groups[row % scene->n_views * scene->n_lights + l]])
                continue;
            for (int k = 0; k < RANK; k++)
                sum += x[k] * job->lights[l * RANK + k];
            at[l] = (float)fmax(sum * scene->light[l].z, 0);
        }
    }
}
