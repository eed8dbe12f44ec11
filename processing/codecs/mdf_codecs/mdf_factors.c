#include "mdf_factors.h"

#include "base/data_error.h"
#include "base/plural.h"

#include <cblas.h>
#include <gio/gio.h>
#include <lapacke.h>
#include <math.h>
#include <string.h>

#define MAX_MAP 255
/* If there are unseen texels, the factors are computed this many times (rounds). Before each round
 * but the first, the unseen texels get depths from the factors of the round before. */
#define ROUNDS 6
/* minimum of an eigenvalue, relative to the largest eigenvalue; smaller eigenvalues count as 0 */
#define LEAST 1e-9
#define WIDER 1.25 /* factor between the numbers of maps that are tried on the way to a target */

void mdf_factors_free(struct mdf_factors *factors) {
    if (!factors)
        return;
    g_free(factors->theta_deg);
    g_free(factors->phi_deg);
    g_free(factors->weights);
    g_free(factors->maps);
    g_free(factors);
}

/* The rows D (views × texels, minus the mean of each view) and their SVD. The SVD is computed from
 * the Gram matrix D Dᵀ = Vᵀ diag (λ) V. The maps are V D. Row i of the maps has the squared norm
 * λ_i, and ‖D‖² = Σ λ_i. */
struct factoring {
    const struct mdf_table *table;
    int n_measured, n_views, n_texels;
    float *rows;    /* n_views × n_texels, minus the mean of each view */
    double *means;  /* n_views: mean depth of each view */
    double *values; /* n_views: eigenvalues, descending */
    float *vectors; /* n_views × n_views: eigenvectors of the Gram matrix, one per row */
};

/* Finds the eigenvalues and eigenvectors of the Gram matrix. */
static gboolean solve(struct factoring *f, GError **error) {
    const int v = f->n_views;
    g_autofree float *gram = g_new0(float, (gsize)v *(gsize)v);
    g_autofree double *wide = g_new(double, (gsize)v *(gsize)v);
    g_autofree double *values = g_new0(double, v);
    cblas_ssyrk(CblasColMajor, CblasUpper, CblasTrans, v, f->n_texels, 1, f->rows, f->n_texels, 0,
                gram, v);
    for (gsize i = 0; i < (gsize)v * (gsize)v; i++)
        wide[i] = gram[i];
    const int info = LAPACKE_dsyev(LAPACK_COL_MAJOR, 'V', 'U', v, wide, v, values);
    if (info != 0) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "the MDF of %d views cannot be factored (the LAPACK function dsyev returned "
                    "%d); check the MDF for extremely large distances",
                    v, info);
        return FALSE;
    }
    for (int i = 0; i < v; i++) {
        f->values[i] = MAX(values[v - 1 - i], 0);
        for (int j = 0; j < v; j++)
            f->vectors[(gsize)i * (gsize)v + (gsize)j] =
                (float)wide[(gsize)(v - 1 - i) * (gsize)v + (gsize)j];
    }
    return TRUE;
}

/* Returns how many of the first n factors have an eigenvalue above rounding errors, but at least
 * 1. */
static int useful(const struct factoring *f, int n) {
    while (n > 1 && !(f->values[n - 1] > LEAST * f->values[0]))
        n--;
    return n;
}

/* Returns the first n rows of V D: n × n_texels. g_free() */
static float *project(const struct factoring *f, int n) {
    float *maps = g_new(float, (gsize)n *(gsize)f->n_texels);
    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, n, f->n_texels, f->n_views, 1,
                f->vectors, f->n_views, f->rows, f->n_texels, 0, maps, f->n_texels);
    return maps;
}

/* Gives unseen texels of measured views the depths of the first n factors: d(x, v) = Σ_i V_i(v)
 * M_i(x). */
static void impute(struct factoring *f, int n) {
    const gsize texels = (gsize)f->n_texels;
    g_autofree float *maps = project(f, n);
    for (int v = 0; v < f->n_measured; v++)
        for (gsize x = 0; x < texels; x++) {
            double sum = 0;
            if (f->table->seen[(gsize)v * texels + x])
                continue;
            for (gsize i = 0; i < (gsize)n; i++)
                sum += (double)f->vectors[i * (gsize)f->n_views + (gsize)v] * maps[i * texels + x];
            f->rows[(gsize)v * texels + x] = (float)sum;
        }
}

/* Subtracts the mean of each row and finds the eigenvectors. If some texels are unseen, repeats
 * both steps, for ROUNDS rounds in all. Each round but the first gives the unseen texels depths
 * from the factors of the round before. */
static gboolean prepare(struct factoring *f, int n_terms, GCancellable *cancellable,
                        GError **error) {
    const gsize views = (gsize)f->n_views, texels = (gsize)f->n_texels;
    const guint8 *seen = f->table->seen;
    const gboolean holes = seen && memchr(seen, 0, (gsize)f->n_measured * texels) != NULL;
    f->rows = g_memdup2(f->table->depth_mm, sizeof(float) * views * texels);
    f->means = g_new0(double, views);
    f->values = g_new0(double, views);
    f->vectors = g_new(float, views *views);
    for (int round = 0; round < (holes ? ROUNDS : 1); round++) {
        if (round > 0)
            impute(f, useful(f, MIN(n_terms, f->n_views)));
        for (gsize v = 0; v < views; v++) {
            float *row = f->rows + v * texels;
            double mean = 0;
            for (gsize x = 0; x < texels; x++)
                mean += row[x];
            mean /= (double)texels;
            f->means[v] += mean;
            for (gsize x = 0; x < texels; x++)
                row[x] -= (float)mean;
        }
        if (g_cancellable_set_error_if_cancelled(cancellable, error) || !solve(f, error))
            return FALSE;
    }
    return TRUE;
}

/* Fits the weights W of all views to the c rounded maps m by least squares. A has c + 1 rows: m /
 * 255 − ½ for each map, and a row of ones. Numbers of about 1 keep A Aᵀ well conditioned. D are the
 * depths minus the mean of each view, and W = D Aᵀ (A Aᵀ)⁻¹, with a small number added to the
 * diagonal of A Aᵀ. Then W is converted to the weights of m, which the file contains. */
static gboolean fit_weights(struct mdf_factors *factors, const struct factoring *f,
                            GError **error) {
    const int n = f->n_texels, c = factors->n_terms, m = c + 1;
    g_autofree float *maps = g_new(float, (gsize)m *(gsize)n), *gram = g_new0(float, m *m);
    g_autofree float *right = g_new(float, (gsize)f->n_views *(gsize)m);
    g_autofree double *a = g_new(double, m *m), *b = g_new(double, (gsize)f->n_views *(gsize)m);
    double trace = 0;
    for (gsize i = 0; i < (gsize)m * (gsize)n; i++)
        maps[i] = i < (gsize)c * (gsize)n ? (float)factors->maps[i] / MAX_MAP - 0.5F : 1;
    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasTrans, m, m, n, 1, maps, n, maps, n, 0, gram, m);
    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasTrans, f->n_views, m, n, 1, f->rows, n, maps, n,
                0, right, m);
    for (int i = 0; i < m * m; i++)
        a[i] = gram[i];
    for (int i = 0; i < m; i++)
        trace += a[i * (m + 1)];
    for (int i = 0; i < m; i++)
        a[i * (m + 1)] += 1e-9 * trace;
    for (int i = 0; i < f->n_views * m; i++)
        b[i] = right[i];
    const int info = LAPACKE_dposv(LAPACK_COL_MAJOR, 'U', m, f->n_views, a, m, b, m);
    if (info != 0) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "the weights of the %d maps of the MDF cannot be computed (the LAPACK function "
                    "dposv returned %d); check the MDF for extremely large distances, or compress "
                    "it to fewer maps",
                    c, info);
        return FALSE;
    }
    for (int v = 0; v < f->n_views; v++) {
        const double *from = b + (gsize)v * (gsize)m;
        float *to = factors->weights + (gsize)v * (gsize)m;
        double constant = from[c] + f->means[v];
        for (int i = 0; i < c; i++) {
            to[i + 1] = (float)(from[i] / MAX_MAP);
            constant -= 0.5 * from[i];
        }
        to[0] = (float)constant;
    }
    return TRUE;
}

/* Makes the first n_terms maps, each rounded to whole steps between its minimum and its maximum. */
static struct mdf_factors *factors_of(const struct factoring *f, int n_terms, GError **error) {
    const struct mdf_table *table = f->table;
    const gsize views = (gsize)f->n_views, texels = (gsize)f->n_texels;
    g_autoptr(MdfFactors) factors = g_new0(struct mdf_factors, 1);
    *factors = (struct mdf_factors){
        .width = table->width,
        .height = table->height,
        .n_views = f->n_views,
        .n_measured = f->n_measured,
        .n_terms = n_terms,
        .texel_mm = table->texel_mm,
        .deepest_mm = table->deepest_mm,
        .theta_deg = g_memdup2(table->theta_deg, sizeof(float) * views),
        .phi_deg = g_memdup2(table->phi_deg, sizeof(float) * views),
        .weights = g_new0(float, views *(gsize)(n_terms + 1)),
        .maps = g_new0(guint8, texels * (gsize)n_terms),
    };
    g_autofree float *maps = project(f, n_terms);
    for (gsize i = 0; i < (gsize)n_terms; i++) {
        const float *from = maps + i * texels;
        float least = from[0], most = from[0];
        for (gsize x = 0; x < texels; x++) {
            least = MIN(least, from[x]);
            most = MAX(most, from[x]);
        }
        for (gsize x = 0; x < texels; x++)
            factors->maps[i * texels + x] =
                most > least ? (guint8)lroundf((from[x] - least) / (most - least) * MAX_MAP) : 0;
    }
    if (!fit_weights(factors, f, error))
        return NULL;
    g_autoptr(MdfTable) is = mdf_factors_table(factors);
    factors->error_mm = mdf_table_difference(table, f->n_measured, is, NULL);
    return g_steal_pointer(&factors);
}

/* Finds the smallest number of maps that reaches the target. Begins with the number that the
 * eigenvalues predict. The sum of squared errors before rounding is rest, the sum of λ_i over the
 * maps that are left out. Rounding adds errors, so that more maps may be needed. */
static struct mdf_factors *search(const struct factoring *f, int most, double target_mm,
                                  GCancellable *cancellable, GError **error) {
    const double all = (double)f->n_views * f->n_texels;
    double rest = 0;
    int n = most;
    for (int i = 0; i < f->n_views; i++)
        rest += i < most ? 0 : f->values[i];
    while (n > 1 && rest + f->values[n - 1] <= target_mm * target_mm * all)
        rest += f->values[--n];
    for (;; n = MIN(most, (int)(n * WIDER) + 1)) {
        g_autoptr(MdfFactors) factors = factors_of(f, n, error);
        if (!factors || g_cancellable_set_error_if_cancelled(cancellable, error))
            return NULL;
        if (factors->error_mm <= target_mm)
            return g_steal_pointer(&factors);
        if (n < most)
            continue;
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "an error of %.3g texels is not reached: with %d %s of distances it is %.3g; "
                    "allow a larger error, or more maps if --components limits them",
                    target_mm / factors->texel_mm, PLURAL(n, "map"),
                    factors->error_mm / factors->texel_mm);
        return NULL;
    }
}

struct mdf_factors *mdf_factors_compute(const struct mdf_table *table, int n_measured, int n_terms,
                                        double target_mm, GCancellable *cancellable,
                                        GError **error) {
    struct mdf_factors *factors = NULL;
    const char *what = NULL;
    if (n_terms < 1 || n_terms > MDF_FACTORS_MAX_TERMS)
        what = "the number of maps must be from 1 to 32";
    else if (table->n_views < 1 || table->n_views > MDF_FACTORS_MAX_VIEWS)
        what = "the number of views must be from 1 to 4096";
    else if (n_measured < 1 || n_measured > table->n_views)
        what = "the number of measured views must be from 1 to the number of views";
    if (what) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "the MDF cannot be compressed to %d maps for %d views: %s", n_terms,
                    table->n_views, what);
        return NULL;
    }
    struct factoring f = {.table = table,
                          .n_measured = n_measured,
                          .n_views = table->n_views,
                          .n_texels = table->width * table->height};
    if (prepare(&f, n_terms, cancellable, error)) {
        const int most = useful(&f, MIN(n_terms, f.n_views));
        factors = target_mm > 0 ? search(&f, most, target_mm, cancellable, error)
                                : factors_of(&f, most, error);
    }
    g_free(f.rows);
    g_free(f.means);
    g_free(f.values);
    g_free(f.vectors);
    return factors;
}

/* Computes depth(x, v) = W_0(v) + Σ_i W_i(v) M_i(x), clamped to 0 … deepest_mm. */
struct mdf_table *mdf_factors_table(const struct mdf_factors *factors) {
    const gsize n = (gsize)factors->width * (gsize)factors->height, c = (gsize)factors->n_terms;
    struct mdf_table *table =
        mdf_table_new(factors->width, factors->height, factors->n_views, factors->texel_mm,
                      factors->theta_deg, factors->phi_deg);
    table->n_measured = factors->n_measured;
    table->deepest_mm = factors->deepest_mm;
    for (gsize v = 0; v < (gsize)factors->n_views; v++) {
        const float *w = factors->weights + v * (c + 1);
        float *to = table->depth_mm + v * n;
        for (gsize x = 0; x < n; x++)
            to[x] = w[0];
        for (gsize i = 0; i < c; i++)
            for (gsize x = 0; x < n; x++)
                to[x] += w[i + 1] * factors->maps[i * n + x];
        for (gsize x = 0; x < n; x++)
            to[x] = CLAMP(to[x], 0, (float)factors->deepest_mm);
    }
    return table;
}

/* The maps have c values of 8 bits per texel, the weights c + 1 floats per view. */
gint64 mdf_factors_bytes(const struct mdf_factors *factors) {
    return (gint64)factors->n_terms * factors->width * factors->height +
           (gint64)sizeof(float) * (factors->n_terms + 1) * factors->n_views;
}
