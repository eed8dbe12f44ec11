#include "hsh.h"

#include <lapacke.h>
#include <math.h>
#include <string.h>

#include "base/data_error.h"
#include "codecs/codec/texel_model.h"

#define COLOURS 3
#define BLOCK   16   /* number of texels that a thread fits at a time */
#define RCOND   1e-3 /* singular values below this part of the largest one count as 0 */

void hsh_free(struct hsh *hsh) {
    if (!hsh)
        return;
    g_free(hsh->name);
    btf_layout_clear(&hsh->layout);
    g_free(hsh->values);
    g_free(hsh);
}

/* Returns the coefficients of a texel in a view: n_terms × COLOURS. */
static float *values_of(const struct hsh *hsh, int view, int texel) {
    const gsize texels = btf_layout_texels(&hsh->layout);
    return hsh->values +
           ((gsize)view * texels + (gsize)texel) * (gsize)hsh->n_terms * (gsize)COLOURS;
}

gint64 hsh_bytes(const struct hsh *hsh) {
    return 2 * (gint64)hsh->layout.views.n * btf_layout_texels(&hsh->layout) * hsh->n_terms *
           COLOURS;
}

/* Evaluates the table of hsh.h. The azimuth φ occurs only in u and v, which are 0 at the pole,
 * where φ is undefined. */
void hsh_basis(const float light[3], int n_terms, float *ret) {
    const double c = MIN(MAX((double)light[2], 0), 1), w = c - c * c, x = 2 * c - 1;
    const double scale = sqrt(c / (1 + c)), u = scale * light[0], v = scale * light[1];
    const double cos2 = u * u - v * v, sin2 = 2 * u * v; /* w cos 2φ, w sin 2φ */
    const double all[HSH_MAX_TERMS] = {
        sqrt(0.5 / G_PI),
        sqrt(6 / G_PI) * u,
        sqrt(1.5 / G_PI) * x,
        sqrt(6 / G_PI) * v,
        -sqrt(30 / G_PI) * cos2,
        sqrt(30 / G_PI) * x * u,
        sqrt(2.5 / G_PI) * (1 - 6 * w),
        sqrt(30 / G_PI) * x * v,
        -sqrt(30 / G_PI) * sin2,
        2 * sqrt(35 / G_PI) * u * (u * u - 3 * v * v),
        -sqrt(210 / G_PI) * x * cos2,
        2 * sqrt(21 / G_PI) * u * (1 - 5 * w),
        sqrt(3.5 / G_PI) * x * (1 - 10 * w),
        2 * sqrt(21 / G_PI) * v * (1 - 5 * w),
        -sqrt(210 / G_PI) * x * sin2,
        2 * sqrt(35 / G_PI) * v * (3 * u * u - v * v),
    };
    for (int i = 0; i < n_terms; i++)
        ret[i] = (float)all[i];
}

/* Returns H_i at each measured light: n_lights × n_terms. */
static float *hsh_design(const struct hsh *hsh) {
    const gsize k = (gsize)hsh->n_terms;
    g_autofree float *lights = direction_list_vectors(&hsh->layout.lights);
    float *ret = g_new0(float, hsh->layout.lights.n *k);
    for (gsize i = 0; i < hsh->layout.lights.n; i++)
        hsh_basis(lights + 3 * i, hsh->n_terms, ret + i * k);
    return ret;
}

/* Computes Σ_i c_i H_i (l). values is n_terms × COLOURS, basis is n_terms. */
static void sum(const float *values, const float *basis, int n_terms, float ret[COLOURS]) {
    ret[0] = ret[1] = ret[2] = 0;
    for (int i = 0; i < n_terms; i++)
        for (int c = 0; c < COLOURS; c++)
            ret[c] += values[COLOURS * i + c] * basis[i];
}

struct hsh_at_lights {
    const struct hsh *hsh;
    const float *design;
};

/* Reconstructs one texel. ret is n_views × n_lights × COLOURS. */
static void reconstruct_with(gconstpointer model, int texel, float *ret) {
    const struct hsh_at_lights *at = model;
    const struct hsh *hsh = at->hsh;
    for (gsize v = 0; v < hsh->layout.views.n; v++) {
        const float *values = values_of(hsh, (int)v, texel);
        for (gsize l = 0; l < hsh->layout.lights.n; l++, ret += COLOURS)
            sum(values, at->design + l * (gsize)hsh->n_terms, hsh->n_terms, ret);
    }
}

void hsh_reconstruct(const struct hsh *hsh, int texel, float *ret) {
    g_autofree float *design = hsh_design(hsh);
    reconstruct_with(&(struct hsh_at_lights){hsh, design}, texel, ret);
}

double hsh_error(struct hsh *hsh, const struct btf_matrix *btf, int n_threads) {
    g_autofree float *design = hsh_design(hsh);
    texel_model_errors(btf, reconstruct_with, &(struct hsh_at_lights){hsh, design}, n_threads,
                       &hsh->error, &hsh->luminance_error);
    return hsh->error;
}

/* The data of a fit. Threads only read this struct. Each thread writes the values of its own texels
 * to hsh->values. */
struct hsh_fit {
    const struct btf_matrix *btf;
    struct hsh *hsh;
    float *design; /* A, the basis H_i at each light: n_lights × n_terms */
    /* A⁺ᵀ, the transposed pseudo-inverse of A: n_lights × n_terms; used for texels with values
     * under all lights */
    float *inverse;
};

/* Finds the X of minimum norm that minimises ‖A X − B‖². Lights for which there[light] is FALSE are
 * left out: their rows of A are 0. If `there` is NULL, no light is left out. columns holds B
 * (n_lights × n_columns) before the call and X (n_terms × n_columns) after it, and has space for
 * max(n_lights, n_terms) rows. */
static void solve(const struct hsh_fit *fit, const gboolean *there, double *columns,
                  int n_columns) {
    const int n = fit->btf->layout.lights.n, k = fit->hsh->n_terms;
    g_autofree double *a = g_new(double, (gsize)n *(gsize)k);
    double singular[HSH_MAX_TERMS];
    int rank;
    for (int i = 0; i < n * k; i++)
        a[i] = there && !there[i / k] ? 0 : (double)fit->design[i];
    LAPACKE_dgelsd(LAPACK_ROW_MAJOR, n, k, n_columns, a, k, columns, n_columns, singular, RCOND,
                   &rank);
}

/* Returns A⁺ᵀ (n_lights × n_terms), the transposed pseudo-inverse of fit->design, by solving for
 * the unit matrix. g_free() */
static float *pseudo_inverse(const struct hsh_fit *fit) {
    const int n = fit->btf->layout.lights.n, k = fit->hsh->n_terms;
    g_autofree double *columns = g_new0(double, (gsize)MAX(n, k) * (gsize)n);
    float *ret = g_new(float, (gsize)n *(gsize)k);
    for (int i = 0; i < n; i++)
        columns[i * n + i] = 1;
    solve(fit, NULL, columns, n);
    for (int i = 0; i < n * k; i++)
        ret[i] = (float)columns[(gsize)(i % k) * (gsize)n + (gsize)(i / k)];
    return ret;
}

/* Fits one view of one texel that has values under all lights: c_i = Σ_l A⁺_il y_l, where y_l is a
 * colour of rgb (n_lights × COLOURS). */
static void fit_whole(const struct hsh_fit *fit, const float *rgb, float *ret) {
    const int k = fit->hsh->n_terms;
    float sums[COLOURS][HSH_MAX_TERMS] = {{0}};
    for (gsize l = 0; l < fit->btf->layout.lights.n; l++) {
        const float *row = fit->inverse + (gsize)l * (gsize)k;
        for (int c = 0; c < COLOURS; c++)
            for (int i = 0; i < k; i++)
                sums[c][i] += rgb[COLOURS * l + c] * row[i];
    }
    for (int i = 0; i < COLOURS * k; i++)
        ret[i] = sums[i % COLOURS][i / COLOURS];
}

/* Fits one view of one texel to the lights for which there[light] is TRUE. Each call solves a
 * separate least-squares problem. */
static void fit_partial(const struct hsh_fit *fit, const float *rgb, const gboolean *there,
                        float *ret) {
    const int n = fit->btf->layout.lights.n, k = fit->hsh->n_terms;
    g_autofree double *columns = g_new0(double, (gsize)MAX(n, k) * COLOURS);
    for (int i = 0; i < n * COLOURS; i++)
        columns[i] = there[i / COLOURS] ? (double)rgb[i] : 0;
    solve(fit, there, columns, COLOURS);
    for (int i = 0; i < k * COLOURS; i++)
        ret[i] = (float)columns[i];
}

/* Fits the up to BLOCK texels of a block in all views. If a texel is NaN under some lights, the
 * texel is fitted to the other lights. */
static void fit_block(int block, gpointer data) {
    const struct hsh_fit *fit = data;
    const int n = fit->btf->layout.lights.n, views = fit->btf->layout.views.n;
    const int end = MIN((block + 1) * BLOCK, btf_layout_texels(&fit->btf->layout));
    const float *rgb =
        fit->btf->values + (gsize)block * BLOCK * (gsize)views * (gsize)n * (gsize)COLOURS;
    g_autofree gboolean *there = g_new(gboolean, n);
    work_use_one_blas_thread();
    for (int texel = block * BLOCK; texel < end; texel++)
        for (int view = 0; view < views; view++, rgb += (gsize)n * COLOURS) {
            float *to = values_of(fit->hsh, view, texel);
            gboolean whole = TRUE;
            for (int l = 0; l < n; l++) {
                const float *value = rgb + (gsize)l * COLOURS;
                there[l] = !isnan(value[0]) && !isnan(value[1]) && !isnan(value[2]);
                whole = whole && there[l];
            }
            if (whole)
                fit_whole(fit, rgb, to);
            else
                fit_partial(fit, rgb, there, to);
        }
}

struct hsh *hsh_compute(const struct btf_matrix *btf, const struct hsh_options *options,
                        GError **error) {
    const int n_terms = options->n_terms ? options->n_terms : HSH_DEFAULT_TERMS;
    if (n_terms != 4 && n_terms != 9 && n_terms != 16) {
        g_set_error(
            error, DATA_ERROR, DATA_ERROR_INVALID,
            "hemispherical harmonics have 4, 9 or 16 terms, not %d; give one of these numbers",
            n_terms);
        return NULL;
    }
    if (!texel_model_check(btf, error))
        return NULL;
    const int n_blocks = (int)((btf_layout_texels(&btf->layout) + BLOCK - 1) / BLOCK);
    struct hsh *hsh = g_new0(struct hsh, 1);
    hsh->name = g_strdup(btf->name);
    hsh->layout = btf_layout_copy(&btf->layout);
    hsh->n_terms = n_terms;
    hsh->values = g_new0(float, (gsize)(hsh_bytes(hsh) / 2));
    struct hsh_fit fit = {.btf = btf, .hsh = hsh};
    fit.design = hsh_design(hsh);
    fit.inverse = pseudo_inverse(&fit);
    if (work_parallel(&options->work, "fit", n_blocks, fit_block, &fit, error)) {
        hsh->exact_error = hsh_error(hsh, btf, options->work.n_threads);
        texel_model_to_halves(hsh->values, (gsize)(hsh_bytes(hsh) / 2));
        hsh_error(hsh, btf, options->work.n_threads);
    } else {
        g_clear_pointer(&hsh, hsh_free);
    }
    g_free(fit.design);
    g_free(fit.inverse);
    return hsh;
}
