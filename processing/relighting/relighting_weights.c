#include "relighting_private.h"

#include <lapacke.h>
#include <math.h>
#include <string.h>

#include "codecs/hsh/hsh.h"
#include "formats/rti/rti.h"

#define MIN_PIVOT 1e-9 /* minimum of a pivot, relative to the largest diagonal element of Aᵀ A */
/* minimum of 1 − H_jj; below it, only light j determines one of the terms */
#define MIN_REST 1e-6

static void terms_of(const struct relighting_model *model, struct vec3 light, float *ret) {
    const float l[3] = {(float)light.x, (float)light.y, (float)light.z};
    if (model->basis == RELIGHTING_PTM)
        rti_ptm_basis(l, ret);
    else
        hsh_basis(l, model->n_terms, ret);
}

/* Computes w_ij = H_ij / (1 − H_jj) with H = B Bᵀ, B = A L⁻ᵀ and Aᵀ A = L Lᵀ. a is A (n × k), and
 * receives B. */
static gboolean press(const struct relighting_model *model, const struct vec3 *lights, int n,
                      double *ret, int *ret_light) {
    const int k = model->basis == RELIGHTING_PTM ? RTI_PTM_TERMS : model->n_terms;
    g_autofree double *b = g_new(double, (gsize)n *(gsize)k);
    double l[HSH_MAX_TERMS][HSH_MAX_TERMS] = {{0}}, largest = 0;
    for (int i = 0; i < n; i++) {
        float terms[HSH_MAX_TERMS];
        terms_of(model, lights[i], terms);
        for (int t = 0; t < k; t++)
            b[i * k + t] = (double)terms[t];
    }
    for (int r = 0; r < k; r++)
        for (int c = 0; c <= r; c++)
            for (int i = 0; i < n; i++)
                l[r][c] += b[i * k + r] * b[i * k + c];
    for (int t = 0; t < k; t++)
        largest = fmax(largest, l[t][t]);
    *ret_light = -1;
    for (int r = 0; r < k; r++)
        for (int c = 0; c <= r; c++) {
            for (int t = 0; t < c; t++)
                l[r][c] -= l[r][t] * l[c][t];
            if (r != c)
                l[r][c] /= l[c][c];
            else if (l[r][r] > MIN_PIVOT * largest)
                l[r][r] = sqrt(l[r][r]);
            else
                return FALSE;
        }
    for (int i = 0; i < n; i++)
        for (int t = 0; t < k; t++) {
            for (int s = 0; s < t; s++)
                b[i * k + t] -= l[t][s] * b[i * k + s];
            b[i * k + t] /= l[t][t];
        }
    for (int j = 0; j < n; j++) {
        double *column = ret + (gsize)j * (gsize)n;
        for (int i = 0; i < n; i++) {
            column[i] = 0;
            for (int t = 0; t < k; t++)
                column[i] += b[i * k + t] * b[j * k + t];
        }
        const double rest = 1 - column[j];
        if (!(rest > MIN_REST)) {
            *ret_light = j;
            return FALSE;
        }
        for (int i = 0; i < n; i++)
            column[i] = i == j ? 0 : column[i] / rest;
    }
    return TRUE;
}

/* e_ij is divided by the e of the nearest light, so that the sum of all e is at least 1. */
static void gaussians(double sigma, const struct vec3 *lights, int n, double *ret) {
    for (int j = 0; j < n; j++) {
        double *column = ret + (gsize)j * (gsize)n, nearest = INFINITY, sum = 0;
        for (int i = 0; i < n; i++) {
            const struct vec3 off = vec3_sub(lights[i], lights[j]);
            column[i] = vec3_dot(off, off);
            nearest = i == j ? nearest : fmin(nearest, column[i]);
        }
        for (int i = 0; i < n; i++) {
            column[i] = i == j ? 0 : exp((nearest - column[i]) / (sigma * sigma));
            sum += column[i];
        }
        for (int i = 0; i < n; i++)
            column[i] /= sum;
    }
}

gboolean relighting_weights(const struct relighting_fit *fit, struct vec3 view,
                            const struct vec3 *lights, int n, double *ret_weights, int *ret_light) {
    *ret_light = -1;
    switch (fit->model->basis) {
    case RELIGHTING_PTM:
    case RELIGHTING_HSH:
        return press(fit->model, lights, n, ret_weights, ret_light);
    case RELIGHTING_RBF:
        gaussians(fit->sigma, lights, n, ret_weights);
        return TRUE;
    case RELIGHTING_KRIGING:
        return prediction_left_out_weights(fit->prediction, view, lights, n, ret_weights);
    }
    return FALSE;
}
