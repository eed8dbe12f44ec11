#include "lpca_pack_private.h"

#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <string.h>

#include "exr/exr_half.h"

#define COLOURS 3
/* added to the number of steps of a value before that number is rounded down. ROUND is less than ½,
 * because small values are more often noise, and 0 takes less space */
#define ROUND 0.38

/* The axes of struct lpca_packed, made orthonormal again after their rounding to half floats. */
struct rotations {
    float *views, *lights;
    float colours[9];
};

struct lpca_packer {
    struct lpca *lpca; /* copy of the local PCA that is packed */
    int n_threads;
    struct lpca_packed axes; /* the axes and the scales; the members tables and maps are NULL */
    struct rotations rotations;
    float *tables, *maps; /* the rotated tables and the transformed weights, not yet rounded */
};

struct lpca_packed *lpca_packed_new(void) {
    return g_new0(struct lpca_packed, 1);
}

static void clear(struct lpca_packed *packed) {
    g_free(packed->views);
    g_free(packed->lights);
    g_free(packed->scales);
    g_free(packed->tables);
    g_free(packed->maps);
}

void lpca_packed_free(struct lpca_packed *packed) {
    if (!packed)
        return;
    clear(packed);
    g_free(packed);
}

float *lpca_cosines(int n) {
    float *ret = g_new(float, (gsize)n *(gsize)n);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            ret[i * n + j] =
                (float)(sqrt((i > 0 ? 2.0 : 1.0) / n) * cos(G_PI * i * (2 * j + 1) / (2.0 * n)));
    return ret;
}

static int n_tables(const struct lpca *lpca) {
    return lpca->n_clusters * (lpca->n_components + 1);
}

static gsize dimensions(const struct lpca *lpca) {
    return btf_layout_values(&lpca->layout);
}

/* Returns the scale S of each table (lpca_pack.h), which is the weight of the table's errors. S is
 * √(Σ_x w_i(x)²) over the texels x of the cluster. For a mean, S is the square root of the number
 * of these texels. g_free() */
static float *find_scales(const struct lpca *lpca) {
    const int c = lpca->n_components, tables = c + 1, texels = btf_layout_texels(&lpca->layout);
    g_autofree double *sums = g_new0(double, n_tables(lpca));
    float *scales = g_new(float, n_tables(lpca));
    for (int x = 0; x < texels; x++) {
        double *of = sums + (gsize)lpca->clusters[x] * (gsize)tables;
        const float *w = lpca->weights + (gsize)x * (gsize)c;
        of[0] += 1;
        for (int i = 0; i < c; i++)
            of[i + 1] += (double)w[i] * w[i];
    }
    for (int i = 0; i < n_tables(lpca); i++)
        scales[i] = sums[i] > 0 ? (float)sqrt(sums[i]) : 1;
    return scales;
}

/* If split is TRUE, converts an array in the order view, light, colour to the order view, colour,
 * light. If split is FALSE, does the reverse. */
static void move_colours(const float *from, int views, int lights, gboolean split, float *to) {
    for (int v = 0; v < views; v++)
        for (int l = 0; l < lights; l++)
            for (int c = 0; c < COLOURS; c++) {
                const int joined = (v * lights + l) * COLOURS + c;
                const int apart = (v * COLOURS + c) * lights + l;
                to[split ? apart : joined] = from[split ? joined : apart];
            }
}

/* Sums of T Tᵀ over all tables S_i E_i, where T is the table unfolded with views, lights or colours
 * as rows. The eigenvectors of the sums are the axes (Tucker). */
struct scatter {
    float *views, *lights;
    double colours[9];
};

static void add_table(const struct lpca *lpca, const float *scales, int table, struct scatter *to) {
    const int v = lpca->layout.views.n, l = lpca->layout.lights.n;
    const float *values = lpca->brdfs + (gsize)table * dimensions(lpca);
    const float scale = scales[table] * scales[table];
    g_autofree float *split = g_new(float, dimensions(lpca));
    move_colours(values, v, l, TRUE, split);
    cblas_ssyrk(CblasRowMajor, CblasUpper, CblasNoTrans, v, l * COLOURS, scale, values, l * COLOURS,
                1, to->views, v);
    cblas_ssyrk(CblasRowMajor, CblasUpper, CblasTrans, l, v * COLOURS, scale, split, l, 1,
                to->lights, l);
    for (int pair = 0; pair < v * l; pair++)
        for (int i = 0; i < 9; i++)
            to->colours[i] += (double)scale * values[pair * COLOURS + i / COLOURS] *
                              values[pair * COLOURS + i % COLOURS];
}

/* Computes the eigenvectors of the symmetric matrix sums. Only the upper half of sums is given. Row
 * i of ret is the eigenvector with the i-th largest eigenvalue, rounded to half floats. If the
 * LAPACK function fails, the rows of ret are the unit vectors along the axes. */
static void principal(const float *sums, int n, float *ret) {
    g_autofree double *matrix = g_new(double, (gsize)n *(gsize)n), *values = g_new(double, n);
    for (int i = 0; i < n * n; i++)
        matrix[i] = sums[i];
    if (LAPACKE_dsyev(LAPACK_ROW_MAJOR, 'V', 'U', n, matrix, n, values) != 0)
        for (int i = 0; i < n * n; i++)
            matrix[i] = i % (n + 1) == 0;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            ret[i * n + j] = (float)matrix[j * n + n - 1 - i];
    g_autofree guint16 *halves = g_new(guint16, (gsize)n * (gsize)n);
    exr_half_from_floats(halves, ret, (gsize)n * (gsize)n);
    exr_half_to_floats(ret, halves, (gsize)n * (gsize)n);
}

/* Makes the rows orthonormal by Gram–Schmidt orthogonalisation, from the first row on. */
static void orthonormalise(float *rows, int n, int length) {
    for (int i = 0; i < n; i++) {
        float *row = rows + (gsize)i * (gsize)length;
        for (int j = 0; j < i; j++) {
            const float *other = rows + (gsize)j * (gsize)length;
            double product = 0;
            for (int k = 0; k < length; k++)
                product += (double)row[k] * other[k];
            for (int k = 0; k < length; k++)
                row[k] -= (float)product * other[k];
        }
        double norm = 0;
        for (int k = 0; k < length; k++)
            norm += (double)row[k] * row[k];
        for (int k = 0; norm > 0 && k < length; k++)
            row[k] = (float)(row[k] / sqrt(norm));
    }
}

static struct rotations make_rotations(const struct lpca_packed *packed, int n_views,
                                       int n_lights) {
    struct rotations rotations;
    rotations.views = g_memdup2(packed->views, sizeof(float) * (gsize)(packed->n_views * n_views));
    rotations.lights =
        g_memdup2(packed->lights, sizeof(float) * (gsize)(packed->n_lights * n_lights));
    memcpy(rotations.colours, packed->colours, sizeof rotations.colours);
    orthonormalise(rotations.views, packed->n_views, n_views);
    orthonormalise(rotations.lights, packed->n_lights, n_lights);
    orthonormalise(rotations.colours, COLOURS, COLOURS);
    return rotations;
}

static void clear_rotations(struct rotations *rotations) {
    g_free(rotations->views);
    g_free(rotations->lights);
}

static void find_axes(const struct lpca *lpca, struct lpca_packed *packed) {
    const int v = lpca->layout.views.n, l = lpca->layout.lights.n;
    struct scatter scatter = {g_new0(float, v *v), g_new0(float, l *l), {0}};
    float colours[9];
    packed->n_views = v;
    packed->n_lights = l;
    packed->views = g_new(float, v *v);
    packed->lights = g_new(float, l *l);
    for (int i = 0; i < n_tables(lpca); i++)
        add_table(lpca, packed->scales, i, &scatter);
    for (int i = 0; i < 9; i++)
        colours[i] = (float)scatter.colours[i];
    principal(scatter.views, v, packed->views);
    principal(scatter.lights, l, packed->lights);
    principal(colours, COLOURS, packed->colours);
    g_free(scatter.views);
    g_free(scatter.lights);
}

/* Multiplies each triple of colours by the 3 × 3 rotation. If back is TRUE, multiplies by the
 * transpose, which undoes the rotation. values is lines × 3 × n. */
static void rotate_colours(const float *rotation, gboolean back, int lines, int n, float *values) {
    for (int line = 0; line < lines; line++)
        for (int i = 0; i < n; i++) {
            float *at = values + (gsize)(line * COLOURS * n + i), old[COLOURS];
            for (int c = 0; c < COLOURS; c++)
                old[c] = at[c * n];
            for (int c = 0; c < COLOURS; c++) {
                at[c * n] = 0;
                for (int o = 0; o < COLOURS; o++)
                    at[c * n] += rotation[back ? o * COLOURS + c : c * COLOURS + o] * old[o];
            }
        }
}

/* Computes the core of a table E (views × lights × colours). Computes S V E with the axes V of
 * views first, then the products with the axes of lights, and then the products with the axes of
 * colours. */
static void rotate_table(int table, gpointer data) {
    const struct lpca_packer *packer = data;
    const struct lpca *lpca = packer->lpca;
    const int v = lpca->layout.views.n, l = lpca->layout.lights.n;
    const gsize d = dimensions(lpca);
    float *to = packer->tables + (gsize)table * d;
    g_autofree float *rotated = g_new(float, d), *split = g_new(float, d);
    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, v, l * COLOURS, v,
                packer->axes.scales[table], packer->rotations.views, v,
                lpca->brdfs + (gsize)table * d, l * COLOURS, 0, rotated, l * COLOURS);
    move_colours(rotated, v, l, TRUE, split);
    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasTrans, v * COLOURS, l, l, 1, split, l,
                packer->rotations.lights, l, 0, to, l);
    rotate_colours(packer->rotations.colours, FALSE, v, l, to);
}

/* Transforms a picture P (height × width) with the cosines R of its rows and C of its columns: R P
 * Cᵀ, or the inverse Rᵀ P C. */
static void transform_map(const float *rows, int height, const float *columns, int width,
                          gboolean forward, const float *from, float *to) {
    g_autofree float *half = g_new(float, (gsize)width *(gsize)height);
    const CBLAS_TRANSPOSE plain = CblasNoTrans, rotated = CblasTrans;
    cblas_sgemm(CblasRowMajor, forward ? plain : rotated, plain, height, width, height, 1, rows,
                height, from, width, 0, half, width);
    cblas_sgemm(CblasRowMajor, plain, forward ? rotated : plain, height, width, width, 1, half,
                width, columns, width, 0, to, width);
}

struct mapping {
    const struct lpca *lpca;
    const float *rows, *columns; /* cosines of rows and columns (lpca_cosines()) */
    float *maps;                 /* transformed weights: n_components × texels */
    gboolean forward;
};

/* Transforms the weights of one component to its map, or back. */
static void map_weights(int component, gpointer data) {
    const struct mapping *mapping = data;
    const struct lpca *lpca = mapping->lpca;
    const gsize n = btf_layout_texels(&lpca->layout), c = (gsize)lpca->n_components;
    float *map = mapping->maps + (gsize)component * n, *weights = lpca->weights + component;
    g_autofree float *picture = g_new(float, n);
    for (gsize x = 0; mapping->forward && x < n; x++)
        picture[x] = weights[x * c];
    transform_map(mapping->rows, lpca->layout.height, mapping->columns, lpca->layout.width,
                  mapping->forward, mapping->forward ? picture : map,
                  mapping->forward ? map : picture);
    for (gsize x = 0; !mapping->forward && x < n; x++)
        weights[x * c] = picture[x];
}

static void map_all(const struct lpca *lpca, float *maps, gboolean forward, int n_threads) {
    g_autofree float *rows = lpca_cosines(lpca->layout.height),
                     *columns = lpca_cosines(lpca->layout.width);
    struct mapping mapping = {lpca, rows, columns, maps, forward};
    work_for_each(n_threads, lpca->n_components, map_weights, &mapping);
}

struct lpca_packer *lpca_packer_new(const struct lpca *lpca, int n_threads) {
    g_return_val_if_fail(lpca->quantise == LPCA_FLOAT && lpca->colours == LPCA_RGB, NULL);
    struct lpca_packer *packer = g_new0(struct lpca_packer, 1);
    packer->lpca = lpca_truncated(lpca, lpca->n_components);
    packer->n_threads = n_threads;
    packer->axes.scales = find_scales(lpca);
    packer->tables = g_new(float, (gsize)n_tables(lpca) * dimensions(lpca));
    packer->maps = g_new(float, (gsize)lpca->n_components *btf_layout_texels(&lpca->layout));
    find_axes(lpca, &packer->axes);
    packer->rotations = make_rotations(&packer->axes, lpca->layout.views.n, lpca->layout.lights.n);
    work_for_each(n_threads, n_tables(lpca), rotate_table, packer);
    map_all(packer->lpca, packer->maps, TRUE, n_threads);
    return packer;
}

void lpca_packer_free(struct lpca_packer *packer) {
    if (!packer)
        return;
    clear(&packer->axes);
    clear_rotations(&packer->rotations);
    lpca_free(packer->lpca);
    g_free(packer->tables);
    g_free(packer->maps);
    g_free(packer);
}

/* Rounds a value v to a number of steps: returns sign (v) ⌊|v| / step + ROUND⌋, limited to ±1e9. */
static gint32 steps(float value, double step) {
    const double n = floor(fabs((double)value) / step + ROUND);
    return (gint32)copysign(MIN(n, 1e9), (double)value);
}

static gboolean is_used(const float *values, gsize n, double step) {
    for (gsize i = 0; i < n; i++)
        if (steps(values[i], step) != 0)
            return TRUE;
    return FALSE;
}

/* Returns the number of components that are kept, at least 1. All components after the last one
 * that is needed are left out. A component is needed if some of its weights, and some values of its
 * tables, do not round to 0. */
static int used_components(const struct lpca_packer *packer, double step) {
    const struct lpca *lpca = packer->lpca;
    const gsize n = btf_layout_texels(&lpca->layout), d = dimensions(lpca);
    for (int i = lpca->n_components; i > 1; i--)
        for (int k = 0; is_used(packer->maps + (gsize)(i - 1) * n, n, step) && k < lpca->n_clusters;
             k++)
            if (is_used(packer->tables + (gsize)(k * (lpca->n_components + 1) + i) * d, d, step))
                return i;
    return 1;
}

/* Gives the numbers of view axes and of light axes that are kept, at least 1 of each, if the first
 * `components` components are kept. On all axes that are left out, every number rounds to 0. */
static void used_axes(const struct lpca_packer *packer, int components, double step, int *ret_views,
                      int *ret_lights) {
    const struct lpca *lpca = packer->lpca;
    const int tables = lpca->n_components + 1;
    *ret_views = *ret_lights = 1;
    for (int i = 0; i < n_tables(lpca); i++) {
        const float *table = packer->tables + (gsize)i * dimensions(lpca);
        for (int j = 0; i % tables <= components && j < (int)dimensions(lpca); j++)
            if (steps(table[j], step) != 0) {
                *ret_views = MAX(*ret_views, j / (COLOURS * lpca->layout.lights.n) + 1);
                *ret_lights = MAX(*ret_lights, j % lpca->layout.lights.n + 1);
            }
    }
}

static void round_tables(const struct lpca_packer *packer, const struct lpca *to, double step) {
    const struct lpca *lpca = packer->lpca;
    struct lpca_packed *packed = to->packed;
    const int tables = to->n_components + 1, lines = packed->n_views * COLOURS;
    gint32 *at = packed->tables;
    for (int i = 0; i < n_tables(to); i++) {
        const int from = i / tables * (lpca->n_components + 1) + i % tables;
        const float *table = packer->tables + (gsize)from * dimensions(lpca);
        packed->scales[i] = packer->axes.scales[from];
        for (int line = 0; line < lines; line++)
            for (int l = 0; l < packed->n_lights; l++)
                *at++ = steps(table[line * lpca->layout.lights.n + l], step);
    }
}

struct lpca *lpca_packer_round(const struct lpca_packer *packer, double step) {
    const struct lpca *lpca = packer->lpca;
    struct lpca *ret = lpca_truncated(lpca, used_components(packer, step));
    struct lpca_packed *packed = ret->packed = lpca_packed_new();
    const gsize n = (gsize)ret->n_components * btf_layout_texels(&lpca->layout);
    ret->quantise = LPCA_PACKED;
    packed->step = step;
    used_axes(packer, ret->n_components, step, &packed->n_views, &packed->n_lights);
    packed->views = g_memdup2(packer->axes.views,
                              sizeof(float) * (gsize)(packed->n_views * lpca->layout.views.n));
    packed->lights = g_memdup2(packer->axes.lights,
                               sizeof(float) * (gsize)(packed->n_lights * lpca->layout.lights.n));
    memcpy(packed->colours, packer->axes.colours, sizeof packed->colours);
    packed->scales = g_new(float, n_tables(ret));
    packed->tables = g_new0(gint32, (gsize)n_tables(ret) * (gsize)packed->n_views * COLOURS *
                                        (gsize)packed->n_lights);
    packed->maps = g_new0(gint32, n);
    round_tables(packer, ret, step);
    for (gsize i = 0; i < n; i++)
        packed->maps[i] = steps(packer->maps[i], step);
    lpca_unpack(ret, packer->n_threads);
    return ret;
}

struct unpacking {
    struct lpca *lpca;
    struct rotations rotations;
};

/* Computes a table of eigen-BRDFs from its rounded numbers and the stored axes: the inverse of
 * rotate_table(). */
static void unpack_table(int table, gpointer data) {
    const struct unpacking *unpacking = data;
    const struct rotations *rotations = &unpacking->rotations;
    const struct lpca *lpca = unpacking->lpca;
    const struct lpca_packed *packed = lpca->packed;
    const int v = lpca->layout.views.n, l = lpca->layout.lights.n, kept = packed->n_views;
    const gsize n = (gsize)kept * COLOURS * (gsize)packed->n_lights;
    const gint32 *from = packed->tables + (gsize)table * n;
    float *to = lpca->brdfs + (gsize)table * dimensions(lpca);
    g_autofree float *core = g_new(float, n), *split = g_new(float, (gsize)(kept * COLOURS * l));
    g_autofree float *joined = g_new(float, (gsize)(kept * COLOURS * l));
    for (gsize i = 0; i < n; i++)
        core[i] = (float)(from[i] * packed->step / packed->scales[table]);
    rotate_colours(rotations->colours, TRUE, kept, packed->n_lights, core);
    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, kept * COLOURS, l, packed->n_lights, 1,
                core, packed->n_lights, rotations->lights, l, 0, split, l);
    move_colours(split, kept, l, FALSE, joined);
    cblas_sgemm(CblasRowMajor, CblasTrans, CblasNoTrans, v, l * COLOURS, kept, 1, rotations->views,
                v, joined, l * COLOURS, 0, to, l * COLOURS);
}

void lpca_unpack(struct lpca *lpca, int n_threads) {
    const gsize n = (gsize)lpca->n_components * btf_layout_texels(&lpca->layout);
    g_autofree float *maps = g_new(float, n);
    for (gsize i = 0; i < n; i++)
        maps[i] = (float)(lpca->packed->maps[i] * lpca->packed->step);
    map_all(lpca, maps, FALSE, n_threads);
    struct unpacking unpacking = {
        lpca, make_rotations(lpca->packed, lpca->layout.views.n, lpca->layout.lights.n)};
    work_for_each(n_threads, n_tables(lpca), unpack_table, &unpacking);
    clear_rotations(&unpacking.rotations);
}
