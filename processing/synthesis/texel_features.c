#include "texel_features.h"

#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <string.h>

#include "base/data_error.h"

#define SPARE   8                        /* additional columns of Ω (oversampling) */
#define WIDE    (TEXEL_FEATURES + SPARE) /* number of columns of Ω */
#define ROWS    256                      /* number of texels of a block */
#define SEED    0x74657874u
#define LEAST   1e-3 /* components with less than this share of the variance are left out */
#define COLOURS 3

/* The matrix A of texel_features.h. It is processed in blocks of columns: one block for each view
 * of the BTF, and one for the MDF. */
struct columns {
    const struct btf_matrix *btf;
    int n_texels, n_views, a_view; /* a_view: number of columns of a view */
    /* n_texels × n_depths: depths, scaled, without their means; NULL if there is no MDF */
    float *depths;
    int n_depths;
    float *means;  /* n_views × a_view: means of the columns */
    float *omega;  /* Ω: (n_views × a_view + n_depths) × WIDE */
    float *y;      /* Y: n_texels × WIDE */
    double *parts; /* for each block of columns, the sum of the squares of its values */
    GMutex lock;
    GError *error; /* the first error */
};

struct texel_features *texel_features_new(int width, int height, int n, double texel_mm) {
    struct texel_features *features = g_new0(struct texel_features, 1);
    features->width = width;
    features->height = height;
    features->n = n;
    features->texel_mm = texel_mm;
    features->values = g_new0(float, (gsize)n *(gsize)width *(gsize)height);
    return features;
}

void texel_features_free(struct texel_features *features) {
    if (!features)
        return;
    g_free(features->values);
    g_free(features);
}

static void columns_clear(struct columns *c) {
    g_free(c->depths);
    g_free(c->means);
    g_free(c->omega);
    g_free(c->y);
    g_free(c->parts);
    g_mutex_clear(&c->lock);
}

/* Gives the rows first … first + n − 1 of a view's columns, without the means of the columns: n ×
 * a_view in ret. */
static gboolean columns_rows(struct columns *c, int view, int first, int n, float *buffer,
                             float *ret) {
    gsize stride = 0;
    GError *error = NULL;
    const float *rows = btf_matrix_rows(c->btf, view, first, n, buffer, &stride, &error);
    const float *means = c->means + (gsize)view * (gsize)c->a_view;
    if (!rows) {
        g_mutex_lock(&c->lock);
        if (!c->error)
            c->error = g_steal_pointer(&error);
        g_mutex_unlock(&c->lock);
        g_clear_error(&error);
        return FALSE;
    }
    for (int i = 0; i < n; i++)
        for (int k = 0; k < c->a_view; k++)
            ret[(gsize)i * (gsize)c->a_view + (gsize)k] =
                rows[stride * (gsize)i + (gsize)k] - means[k];
    return TRUE;
}

/* Computes the means of a view's columns, and the sum of the squares of the columns without these
 * means. */
static void columns_mean(int view, gpointer data) {
    struct columns *c = data;
    const gsize wide = (gsize)c->a_view;
    g_autofree float *buffer = g_new(float, ROWS *wide), *rows = g_new(float, ROWS *wide);
    g_autofree double *sums = g_new0(double, 2 * wide);
    for (int first = 0; first < c->n_texels; first += ROWS) {
        const int n = MIN(ROWS, c->n_texels - first);
        if (!columns_rows(c, view, first, n, buffer, rows))
            return;
        for (gsize i = 0; i < (gsize)n; i++)
            for (gsize k = 0; k < wide; k++) {
                sums[k] += rows[wide * i + k];
                sums[wide + k] += (double)rows[wide * i + k] * rows[wide * i + k];
            }
    }
    for (gsize k = 0; k < wide; k++) {
        c->means[(gsize)view * wide + k] = (float)(sums[k] / c->n_texels);
        c->parts[view] += sums[wide + k] - sums[k] * sums[k] / c->n_texels;
    }
}

/* Computes Y = A Ω for a block of rows. */
static void columns_times_omega(int block, gpointer data) {
    struct columns *c = data;
    const int first = block * ROWS, n = MIN(ROWS, c->n_texels - first);
    const gsize wide = (gsize)c->a_view;
    float *y = c->y + (gsize)first * WIDE;
    g_autofree float *buffer = g_new(float, ROWS *wide), *rows = g_new(float, ROWS *wide);
    memset(y, 0, sizeof(float) * WIDE * (gsize)n);
    for (int view = 0; view < c->n_views; view++) {
        if (!columns_rows(c, view, first, n, buffer, rows))
            return;
        cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, n, WIDE, c->a_view, 1, rows,
                    c->a_view, c->omega + (gsize)view * wide * WIDE, WIDE, 1, y, WIDE);
    }
    if (c->depths)
        cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, n, WIDE, c->n_depths, 1,
                    c->depths + (gsize)first * (gsize)c->n_depths, c->n_depths,
                    c->omega + (gsize)c->n_views * wide * WIDE, WIDE, 1, y, WIDE);
}

/* Computes Ω = Aᵀ Y for a block of columns of A, which are rows of Ω. */
static void columns_transposed(int block, gpointer data) {
    struct columns *c = data;
    const gsize wide = (gsize)c->a_view;
    float *to = c->omega + (gsize)block * wide * WIDE;
    if (block == c->n_views) {
        cblas_sgemm(CblasRowMajor, CblasTrans, CblasNoTrans, c->n_depths, WIDE, c->n_texels, 1,
                    c->depths, c->n_depths, c->y, WIDE, 0, to, WIDE);
        return;
    }
    g_autofree float *buffer = g_new(float, ROWS *wide), *rows = g_new(float, ROWS *wide);
    memset(to, 0, sizeof(float) * WIDE * wide);
    for (int first = 0; first < c->n_texels; first += ROWS) {
        const int n = MIN(ROWS, c->n_texels - first);
        if (!columns_rows(c, block, first, n, buffer, rows))
            return;
        cblas_sgemm(CblasRowMajor, CblasTrans, CblasNoTrans, c->a_view, WIDE, n, 1, rows, c->a_view,
                    c->y + (gsize)first * WIDE, WIDE, 1, to, WIDE);
    }
}

/* Subtracts the mean of each view from the depths, and scales the depths relative to the BTF.
 * squares is the sum of squares of the BTF. Returns the sum of squares of the scaled depths. If one
 * of the two sums is 0, returns 0, and the depths are not used. */
static double columns_take_depths(struct columns *c, const struct mdf_table *mdf, double squares) {
    const gsize n = (gsize)c->n_texels;
    double sum = 0;
    c->n_depths = mdf->n_views;
    c->depths = g_new0(float, n *(gsize)c->n_depths);
    for (gsize view = 0; view < (gsize)c->n_depths; view++) {
        double mean = 0;
        for (gsize i = 0; i < n; i++)
            mean += mdf->depth_mm[view * n + i] / (double)n;
        for (gsize i = 0; i < n; i++) {
            const double depth = mdf->depth_mm[view * n + i] - mean;
            c->depths[i * (gsize)c->n_depths + view] = (float)depth;
            sum += depth * depth;
        }
    }
    if (!(sum > 0) || !(squares > 0)) {
        g_clear_pointer(&c->depths, g_free);
        return c->n_depths = 0;
    }
    const double variance = sum / (double)n / c->n_depths;
    const double share = MIN(1, variance / (mdf->texel_mm * mdf->texel_mm));
    const float scale = (float)sqrt(share * squares / sum);
    for (gsize i = 0; i < n * (gsize)c->n_depths; i++)
        c->depths[i] *= scale;
    return share * squares;
}

static void columns_draw_signs(struct columns *c, gsize n_columns) {
    GRand *random = g_rand_new_with_seed(SEED);
    for (gsize i = 0; i < n_columns * WIDE; i++)
        c->omega[i] = g_rand_boolean(random) ? 1.0F : -1.0F;
    g_rand_free(random);
}

static void columns_orthogonalise(float *matrix, int rows) {
    float tau[WIDE];
    LAPACKE_sgeqrf(LAPACK_ROW_MAJOR, rows, WIDE, matrix, WIDE, tau);
    LAPACKE_sorgqr(LAPACK_ROW_MAJOR, rows, WIDE, WIDE, matrix, WIDE, tau);
}

/* Computes the components U Σ of QᵀA. On input, y has Q, and omega has AᵀQ. */
static struct texel_features *columns_components(const struct columns *c, gsize n_columns,
                                                 double squares) {
    double gram[WIDE * WIDE] = {0}, values[WIDE];
    for (gsize j = 0; j < n_columns; j++)
        for (gsize a = 0; a < WIDE; a++)
            for (gsize b = a; b < WIDE; b++)
                gram[a * WIDE + b] += (double)c->omega[j * WIDE + a] * c->omega[j * WIDE + b];
    if (LAPACKE_dsyev(LAPACK_ROW_MAJOR, 'V', 'U', WIDE, gram, WIDE, values) != 0)
        memset(values, 0, sizeof values);
    int n = 1;
    while (n < TEXEL_FEATURES && values[WIDE - 1 - n] > LEAST * squares)
        n++;
    struct texel_features *features = texel_features_new(
        (int)c->btf->layout.width, (int)c->btf->layout.height, n, c->btf->layout.texel_mm);
    double found = 0;
    for (int k = 0; k < n; k++)
        found += values[WIDE - 1 - k];
    features->explained = squares > 0 ? MIN(1, found / squares) : 1;
    for (gsize i = 0; i < (gsize)c->n_texels; i++)
        for (int k = 0; k < n; k++) {
            double sum = 0;
            for (gsize a = 0; a < WIDE; a++)
                sum += c->y[i * WIDE + a] * gram[a * WIDE + (gsize)(WIDE - 1 - k)];
            features->values[i * (gsize)n + (gsize)k] =
                (float)(sum * sqrt(fmax(values[WIDE - 1 - k], 0)));
        }
    return features;
}

static gboolean columns_iterate(struct columns *c, const struct work *work, GError **error) {
    const int blocks = (c->n_texels + ROWS - 1) / ROWS, wide = c->n_views + (c->depths ? 1 : 0);
    for (int step = 0; step < 2; step++) {
        if (!work_parallel(work, "components", blocks, columns_times_omega, c, error))
            return FALSE;
        columns_orthogonalise(c->y, c->n_texels);
        if (!work_parallel(work, "components", wide, columns_transposed, c, error))
            return FALSE;
    }
    return TRUE;
}

struct texel_features *texel_features_compute(const struct btf_matrix *btf,
                                              const struct mdf_table *mdf, const struct work *work,
                                              GError **error) {
    struct columns c = {.btf = btf,
                        .n_texels = (int)btf_layout_texels(&btf->layout),
                        .n_views = (int)btf->layout.views.n,
                        .a_view = COLOURS * (int)btf->layout.lights.n};
    if (mdf && ((gsize)mdf->width != btf->layout.width || (gsize)mdf->height != btf->layout.height))
        return data_error_set(btf->directory, 0, error,
                              "the MDF has %d × %d texels, but the BTF has %zu × %zu; process the "
                              "session again",
                              mdf->width, mdf->height, btf->layout.width, btf->layout.height),
               NULL;
    if (c.n_texels < WIDE)
        return data_error_set(btf->directory, 0, error,
                              "a sample of %d texels is too small; at least %d are needed",
                              c.n_texels, WIDE),
               NULL;
    struct texel_features *features = NULL;
    const gsize of_btf = (gsize)c.n_views * (gsize)c.a_view;
    g_mutex_init(&c.lock);
    c.means = g_new0(float, of_btf);
    c.parts = g_new0(double, (gsize)c.n_views);
    c.y = g_new0(float, (gsize)c.n_texels *WIDE);
    gboolean good = work_parallel(work, "components", c.n_views, columns_mean, &c, error);
    double squares = 0, relief = 0;
    for (int view = 0; view < c.n_views; view++)
        squares += c.parts[view];
    if (good && !c.error && mdf)
        relief = columns_take_depths(&c, mdf, squares);
    const gsize n_columns = of_btf + (gsize)c.n_depths;
    c.omega = g_new(float, n_columns *WIDE);
    columns_draw_signs(&c, n_columns);
    good = good && !c.error && columns_iterate(&c, work, error);
    if (good && !c.error) {
        features = columns_components(&c, n_columns, squares + relief);
        features->relief = squares + relief > 0 ? relief / (squares + relief) : 0;
    }
    if (c.error)
        g_propagate_error(error, c.error);
    columns_clear(&c);
    return features;
}

struct texel_features *texel_features_averaged(const struct texel_features *from, int side) {
    struct texel_features *to =
        texel_features_new(from->width, from->height, from->n, from->texel_mm);
    const float share = 1.0F / (float)(side * side);
    for (int y = 0; y + side <= from->height; y++)
        for (int x = 0; x + side <= from->width; x++) {
            float *sum = to->values + (texel_features_at(from, x, y) - from->values);
            for (int j = 0; j < side; j++)
                for (int i = 0; i < side; i++)
                    for (int k = 0; k < from->n; k++)
                        sum[k] += share * texel_features_at(from, x + i, y + j)[k];
        }
    return to;
}
