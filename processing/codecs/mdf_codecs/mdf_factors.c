#include "mdf_factors.h"

#include "base/data_error.h"

#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <string.h>

#define MOST_MAP 255
#define ROUNDS   6    /* of what the factors say of unseen texels */
#define LEAST    1e-9 /* of the largest eigenvalue: below it there is nothing */
#define WIDER    1.25 /* maps tried at a time, as a factor, on the way to a target */

void mdf_factors_free(struct mdf_factors *factors) {
    if (!factors)
        return;
    g_free(factors->theta_deg);
    g_free(factors->phi_deg);
    g_free(factors->weights);
    g_free(factors->maps);
    g_free(factors);
}

/* What the factorisation works on. */
struct work {
    const struct mdf_table *table;
    int n_measured, n_views, n_texels;
    float *rows;    /* n_views × n_texels, less means */
    double *means;  /* n_views */
    double *values; /* n_views: eigenvalues, descending */
    float *vectors; /* n_views × n_views: those of the Gram matrix, one a row */
};

static gboolean is_seen(const struct mdf_table *table, int n_measured, int view, gsize texel) {
    const gsize n = (gsize)table->width * (gsize)table->height;
    return view >= n_measured || !table->seen || table->seen[(gsize)view * n + texel];
}

static void mdf_factors_centre(struct work *work) {
    const gsize n = (gsize)work->n_texels;
    for (int v = 0; v < work->n_views; v++) {
        float *row = work->rows + (gsize)v * n;
        double sum = 0;
        for (gsize i = 0; i < n; i++)
            sum += row[i];
        sum /= (double)n;
        work->means[v] += sum;
        for (gsize i = 0; i < n; i++)
            row[i] -= (float)sum;
    }
}

static gboolean mdf_factors_solve(struct work *work, GError **error) {
    const int v = work->n_views;
    g_autofree float *gram = g_new0(float, (gsize)v *(gsize)v);
    g_autofree double *wide = g_new(double, (gsize)v *(gsize)v);
    g_autofree double *values = g_new0(double, v);
    cblas_ssyrk(CblasColMajor, CblasUpper, CblasTrans, v, work->n_texels, 1, work->rows,
                work->n_texels, 0, gram, v);
    for (gsize i = 0; i < (gsize)v * (gsize)v; i++)
        wide[i] = gram[i];
    const int info = LAPACKE_dsyev(LAPACK_COL_MAJOR, 'V', 'U', v, wide, v, values);
    if (info != 0) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "the principal views of an MDF were not found (dsyev: %d)", info);
        return FALSE;
    }
    for (int i = 0; i < v; i++) {
        work->values[i] = MAX(values[v - 1 - i], 0);
        for (int j = 0; j < v; j++)
            work->vectors[(gsize)i * (gsize)v + (gsize)j] =
                (float)wide[(gsize)(v - 1 - i) * (gsize)v + (gsize)j];
    }
    return TRUE;
}

/* What of n is any use. */
static int useful(const struct work *work, int n) {
    while (n > 1 && !(work->values[n - 1] > LEAST * work->values[0]))
        n--;
    return n;
}

/* n × n_texels: products of the texels' columns with the first eigenvectors. */
static float *mdf_factors_project(const struct work *work, int n) {
    float *maps = g_new(float, (gsize)n *(gsize)work->n_texels);
    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, n, work->n_texels, work->n_views, 1,
                work->vectors, work->n_views, work->rows, work->n_texels, 0, maps, work->n_texels);
    return maps;
}

/* Unseen texels become what the first n factors make of them. */
static void impute(struct work *work, int n) {
    const struct mdf_table *table = work->table;
    const gsize texels = (gsize)work->n_texels;
    g_autofree float *maps = mdf_factors_project(work, n);
    for (int v = 0; v < work->n_measured; v++)
        for (gsize x = 0; x < texels; x++) {
            double sum = 0;
            if (is_seen(table, work->n_measured, v, x))
                continue;
            for (gsize i = 0; i < (gsize)n; i++)
                sum += (double)work->vectors[i * (gsize)work->n_views + (gsize)v] *
                       maps[i * texels + x];
            work->rows[(gsize)v * texels + x] = (float)sum;
        }
}

static gboolean has_holes(const struct work *work) {
    const gsize n = (gsize)work->n_measured * (gsize)work->n_texels;
    return work->table->seen && memchr(work->table->seen, 0, n) != NULL;
}

static gboolean mdf_factors_prepare(struct work *work, int n_terms, GCancellable *cancellable,
                                    GError **error) {
    const gsize v = (gsize)work->n_views, n = v * (gsize)work->n_texels;
    const int rounds = has_holes(work) ? ROUNDS : 1;
    work->rows = g_memdup2(work->table->depth_mm, sizeof(float) * n);
    work->means = g_new0(double, v);
    work->values = g_new0(double, v);
    work->vectors = g_new(float, v *v);
    for (int round = 0; round < rounds; round++) {
        if (round > 0)
            impute(work, useful(work, MIN(n_terms, work->n_views)));
        mdf_factors_centre(work);
        if (g_cancellable_set_error_if_cancelled(cancellable, error) ||
            !mdf_factors_solve(work, error))
            return FALSE;
    }
    return TRUE;
}

/* Each map to whole steps between its least and its largest value. */
static void round_maps(struct mdf_factors *factors, const float *maps) {
    const gsize n = (gsize)factors->width * (gsize)factors->height;
    for (int i = 0; i < factors->n_terms; i++) {
        const float *from = maps + (gsize)i * n;
        float least = from[0], most = from[0];
        for (gsize x = 0; x < n; x++) {
            least = MIN(least, from[x]);
            most = MAX(most, from[x]);
        }
        for (gsize x = 0; x < n; x++)
            factors->maps[(gsize)i * n + x] =
                most > least ? (guint8)lroundf((from[x] - least) / (most - least) * MOST_MAP) : 0;
    }
}

/* Steps of all maps as numbers about 1, the constant last. */
static float *widened(const struct mdf_factors *factors) {
    const gsize n = (gsize)factors->width * (gsize)factors->height, c = (gsize)factors->n_terms;
    float *ret = g_new(float, (c + 1) * n);
    for (gsize i = 0; i < c * n; i++)
        ret[i] = (float)factors->maps[i] / MOST_MAP - 0.5F;
    for (gsize x = 0; x < n; x++)
        ret[c * n + x] = 1;
    return ret;
}

/* Least squares of all views on the rounded maps. */
static gboolean fit_weights(struct mdf_factors *factors, const struct work *work, GError **error) {
    const int n = work->n_texels, c = factors->n_terms, m = c + 1;
    g_autofree float *maps = widened(factors), *gram = g_new0(float, m *m);
    g_autofree float *right = g_new(float, (gsize)work->n_views *(gsize)m);
    g_autofree double *a = g_new(double, m *m), *b = g_new(double, (gsize)work->n_views *(gsize)m);
    double trace = 0;
    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasTrans, m, m, n, 1, maps, n, maps, n, 0, gram, m);
    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasTrans, work->n_views, m, n, 1, work->rows, n,
                maps, n, 0, right, m);
    for (int i = 0; i < m * m; i++)
        a[i] = gram[i];
    for (int i = 0; i < m; i++)
        trace += a[i * (m + 1)];
    for (int i = 0; i < m; i++)
        a[i * (m + 1)] += 1e-9 * trace;
    for (int i = 0; i < work->n_views * m; i++)
        b[i] = right[i];
    const int info = LAPACKE_dposv(LAPACK_COL_MAJOR, 'U', m, work->n_views, a, m, b, m);
    if (info != 0) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "the weights of an MDF's maps were not found (dposv: %d)", info);
        return FALSE;
    }
    for (int v = 0; v < work->n_views; v++) {
        const double *from = b + (gsize)v * (gsize)m;
        float *to = factors->weights + (gsize)v * (gsize)m;
        double constant = from[c] + work->means[v];
        for (int i = 0; i < c; i++) {
            to[i + 1] = (float)(from[i] / MOST_MAP);
            constant -= 0.5 * from[i];
        }
        to[0] = (float)constant;
    }
    return TRUE;
}

static struct mdf_factors *mdf_factors_factors_of(const struct work *work, int n_terms,
                                                  GError **error) {
    const struct mdf_table *table = work->table;
    const gsize views = (gsize)work->n_views, texels = (gsize)work->n_texels;
    struct mdf_factors *factors = g_new0(struct mdf_factors, 1);
    *factors = (struct mdf_factors){
        .width = table->width,
        .height = table->height,
        .n_views = work->n_views,
        .n_measured = work->n_measured,
        .n_terms = n_terms,
        .texel_mm = table->texel_mm,
        .deepest_mm = table->deepest_mm,
        .theta_deg = g_memdup2(table->theta_deg, sizeof(float) * views),
        .phi_deg = g_memdup2(table->phi_deg, sizeof(float) * views),
        .weights = g_new0(float, views *(gsize)(n_terms + 1)),
        .maps = g_new0(guint8, texels * (gsize)n_terms),
    };
    g_autofree float *maps = mdf_factors_project(work, n_terms);
    round_maps(factors, maps);
    if (!fit_weights(factors, work, error)) {
        mdf_factors_free(factors);
        return NULL;
    }
    struct mdf_table *is = mdf_factors_table(factors);
    factors->error_mm = mdf_table_difference(table, work->n_measured, is, NULL);
    mdf_table_free(is);
    return factors;
}

static struct mdf_factors *mdf_factors_search(const struct work *work, int most, double target_mm,
                                              GCancellable *cancellable, GError **error) {
    const double all = (double)work->n_views * work->n_texels;
    double rest = 0;
    int n = most;
    for (int i = 0; i < work->n_views; i++)
        rest += i < most ? 0 : work->values[i];
    while (n > 1 && rest + work->values[n - 1] <= target_mm * target_mm * all)
        rest += work->values[--n];
    for (;; n = MIN(most, (int)(n * WIDER) + 1)) {
        struct mdf_factors *factors = mdf_factors_factors_of(work, n, error);
        if (!factors || g_cancellable_set_error_if_cancelled(cancellable, error)) {
            mdf_factors_free(factors);
            return NULL;
        }
        if (factors->error_mm <= target_mm)
            return factors;
        if (n == most)
            g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                        "an error of %.3g mm is not reached with %d maps of distances (%.3g mm); "
                        "allow more",
                        target_mm, n, factors->error_mm);
        mdf_factors_free(factors);
        if (n == most)
            return NULL;
    }
}

static gboolean mdf_factors_check(const struct mdf_table *table, int n_measured, int n_terms,
                                  GError **error) {
    const char *what = NULL;
    if (n_terms < 1 || n_terms > MDF_FACTORS_MAX_TERMS)
        what = "there can be 1 to 32 maps";
    else if (table->n_views < 1 || table->n_views > MDF_FACTORS_MAX_VIEWS)
        what = "there can be 1 to 4096 views";
    else if (n_measured < 1 || n_measured > table->n_views)
        what = "one view at least must have been measured";
    if (what)
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID, "%d maps of distances for %d views: %s",
                    n_terms, table->n_views, what);
    return what == NULL;
}

struct mdf_factors *mdf_factors_compute(const struct mdf_table *table, int n_measured, int n_terms,
                                        double target_mm, GCancellable *cancellable,
                                        GError **error) {
    struct mdf_factors *factors = NULL;
    if (!mdf_factors_check(table, n_measured, n_terms, error))
        return NULL;
    struct work work = {.table = table,
                        .n_measured = n_measured,
                        .n_views = table->n_views,
                        .n_texels = table->width * table->height};
    if (mdf_factors_prepare(&work, n_terms, cancellable, error)) {
        const int most = useful(&work, MIN(n_terms, work.n_views));
        factors = target_mm > 0 ? mdf_factors_search(&work, most, target_mm, cancellable, error)
                                : mdf_factors_factors_of(&work, most, error);
    }
    g_free(work.rows);
    g_free(work.means);
    g_free(work.values);
    g_free(work.vectors);
    return factors;
}

struct mdf_table *mdf_factors_table(const struct mdf_factors *factors) {
    const gsize n = (gsize)factors->width * (gsize)factors->height;
    const gsize views = (gsize)factors->n_views, c = (gsize)factors->n_terms;
    struct mdf_table *table = g_new0(struct mdf_table, 1);
    table->width = factors->width;
    table->height = factors->height;
    table->n_views = factors->n_views;
    table->texel_mm = factors->texel_mm;
    table->deepest_mm = factors->deepest_mm;
    table->theta_deg = g_memdup2(factors->theta_deg, sizeof(float) * views);
    table->phi_deg = g_memdup2(factors->phi_deg, sizeof(float) * views);
    table->depth_mm = g_new(float, views *n);
    for (gsize v = 0; v < views; v++) {
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

gint64 mdf_factors_bytes(const struct mdf_factors *factors) {
    return (gint64)factors->n_terms * factors->width * factors->height +
           (gint64)sizeof(float) * (factors->n_terms + 1) * factors->n_views;
}
