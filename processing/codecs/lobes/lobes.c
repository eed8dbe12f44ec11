#include "lobes_private.h"

#include <lapacke.h>
#include <math.h>
#include <string.h>

#include "base/data_error.h"
#include "base/direction.h"
#include "btf/btf_checkpoint.h"
#include "codecs/codec/texel_model.h"

#define COLOURS       3
#define POLYNOMIAL    6  /* number of coefficients of ptm */
#define FACET         14 /* number of values of a texel for ward and ashikhmin */
#define BLOCK         16 /* number of texels that a thread fits at a time */
#define DEFAULT_LOBES 2

const struct lobes_traits lobes_traits[LOBES_MODELS] = {
    [LOBES_FIELDS] = {"fields", .each_view = TRUE, .lobed = TRUE, .n_values = COLOURS},
    [LOBES_PTM] = {"ptm", .each_view = TRUE, .n_values = COLOURS + POLYNOMIAL},
    [LOBES_LAFORTUNE] = {"lafortune", .lobed = TRUE, .n_values = COLOURS + 1},
    [LOBES_WARD] = {"ward", .facet = TRUE, .n_values = FACET},
    [LOBES_ASHIKHMIN] = {"ashikhmin", .facet = TRUE, .n_values = FACET},
};

const char *lobes_model_name(enum lobes_model model) {
    return lobes_traits[model].name;
}

gboolean lobes_model_parse(const char *name, enum lobes_model *ret) {
    for (int i = 0; i < LOBES_MODELS; i++)
        if (g_strcmp0(name, lobes_traits[i].name) == 0) {
            *ret = (enum lobes_model)i;
            return TRUE;
        }
    return FALSE;
}

void lobes_free(struct lobes *lobes) {
    if (!lobes)
        return;
    g_free(lobes->name);
    btf_layout_clear(&lobes->layout);
    g_free(lobes->values);
    g_free(lobes);
}

gint64 lobes_bytes(const struct lobes *lobes) {
    return 2 * (gint64)lobes->n_slices * btf_layout_texels(&lobes->layout) * lobes->n_values;
}

/* The data of a computation. Each thread writes the values of its own texels to lobes->values, and
 * sets the elements of `done` for its blocks. */
struct lobes_run {
    const struct btf_matrix *btf;
    const struct lobes_options *options;
    struct lobes *lobes;
    struct lobes_fit fit;
    struct lobes_start *start;
    float *views, *lights; /* n_views × 3 and n_lights × 3, unit vectors */
    float *polynomial;     /* POLYNOMIAL × n_lights: A⁺ of pseudo_inverse() */
    /* done: for each block of texels, 1 if the block is fitted, otherwise 0 */
    int n_blocks, *done;
};

/* Finds the X of least norm that minimises ‖A X − B‖². A has the row (lx², ly², lx ly, lx, ly, 1)
 * for each light l, or zeros if the light's luminance in row is NaN. If row is NULL, no light is
 * left out. columns holds B (n × n_columns) before the call and X (POLYNOMIAL × n_columns) after
 * it, and has space for max(n, POLYNOMIAL) rows. */
static void solve_polynomial(const float *lights, int n, const float *row, double *columns,
                             int n_columns) {
    g_autofree double *a = g_new0(double, n *POLYNOMIAL);
    double singular[POLYNOMIAL];
    int rank;
    for (int i = 0; i < n; i++) {
        const double x = lights[3 * i], y = lights[3 * i + 1];
        const double basis[POLYNOMIAL] = {x * x, y * y, x * y, x, y, 1};
        if (!row || !isnan(row[i]))
            memcpy(a + (gsize)(i * POLYNOMIAL), basis, sizeof basis);
    }
    LAPACKE_dgelsd(LAPACK_ROW_MAJOR, n, POLYNOMIAL, n_columns, a, POLYNOMIAL, columns, n_columns,
                   singular, 1e-6, &rank);
}

/* Returns A⁺, the pseudo-inverse of the A of solve_polynomial(), by solving for the unit matrix:
 * POLYNOMIAL × n. g_free() */
static float *pseudo_inverse(const float *lights, int n) {
    g_autofree double *columns = g_new0(double, MAX(n, POLYNOMIAL) * n);
    float *ret = g_new(float, POLYNOMIAL *n);
    for (int i = 0; i < n; i++)
        columns[i * n + i] = 1;
    solve_polynomial(lights, n, NULL, columns, n);
    for (int i = 0; i < POLYNOMIAL * n; i++)
        ret[i] = (float)columns[i];
    return ret;
}

/* Computes the coefficients C = A⁺ Y from one row of luminance Y (n_lights). If the row has a NaN,
 * solves a separate problem without the lights that are NaN. */
static void fit_polynomial(const struct lobes_run *run, const float *row, float *ret) {
    const int n = run->fit.n_lights;
    gboolean whole = TRUE;
    for (int i = 0; whole && i < n; i++)
        whole = !isnan(row[i]);
    if (whole) {
        for (int k = 0; k < POLYNOMIAL; k++) {
            ret[k] = 0;
            for (int i = 0; i < n; i++)
                ret[k] += run->polynomial[k * n + i] * row[i];
        }
        return;
    }
    g_autofree double *column = g_new0(double, MAX(n, POLYNOMIAL));
    for (int i = 0; i < n; i++)
        column[i] = isnan(row[i]) ? 0 : row[i];
    solve_polynomial(run->lights, n, row, column, 1);
    for (int k = 0; k < POLYNOMIAL; k++)
        ret[k] = (float)column[k];
}

/* Returns whether none of the three colours is NaN. */
static gboolean is_there(const float *rgb) {
    return !isnan(rgb[0]) && !isnan(rgb[1]) && !isnan(rgb[2]);
}

/* Splits n values R, G, B into their luminances Y (NaN if a colour is NaN) and one colour, Σ RGB /
 * Σ Y. The product of Y and this colour stands for R, G, B. The colour is white if Σ Y is not above
 * 0. */
static void split(const float *rgb, gsize n, float *ret_row, float ret_colour[3]) {
    double sums[COLOURS] = {0}, all = 0;
    for (gsize i = 0; i < n; i++, rgb += COLOURS) {
        const gboolean there = is_there(rgb);
        ret_row[i] = there ? rgb_luminance(rgb) : NAN;
        for (int c = 0; there && c < COLOURS; c++)
            sums[c] += rgb[c];
        all += there ? ret_row[i] : 0;
    }
    for (int c = 0; c < COLOURS; c++)
        ret_colour[c] = all > 0 ? (float)CLAMP(sums[c] / all, 0, 1000) : 1;
}

/* Fits each of n rows (luminances of split()) from several starts, and keeps the parameters with
 * the smallest cost. ret is n × lobes_fit_parameters(). */
static void fit_from_starts(const struct lobes_run *run, const float *rows, int n, float *ret) {
    const int parameters = lobes_fit_parameters(&run->fit);
    g_autofree float *costs = g_new(float, 2 * n), *other = g_new(float, n *parameters);
    lobes_start_rows(run->start, 0, rows, n, ret);
    lobes_fit_rows(&run->fit, rows, n, ret, costs);
    for (int variant = 1; variant < lobes_start_variants(&run->fit); variant++) {
        lobes_start_rows(run->start, variant, rows, n, other);
        lobes_fit_rows(&run->fit, rows, n, other, costs + n);
        for (int i = 0; i < n; i++) {
            if (!(costs[n + i] < costs[i]))
                continue;
            costs[i] = costs[n + i];
            memcpy(ret + (gsize)(i * parameters), other + (gsize)(i * parameters),
                   sizeof(float) * (gsize)parameters);
        }
    }
}

/* Converts the parameters of a fit (lobes_private.h) to the values of lobes.h. colour is R, G, B.
 * The colours of microfacet models are in their parameters instead. */
static void store(const struct lobes *lobes, const float *colour, const float *p, float *ret) {
    if (lobes_traits[lobes->model].facet) {
        const float size = sqrtf(p[0] * p[0] + p[1] * p[1] + 1), c = cosf(p[2]), s = sinf(p[2]);
        const float rise = p[0] * c + p[1] * s, along = sqrtf(1 + rise * rise);
        const float values[FACET] = {p[5],      p[5],         p[5],         p[6],      p[6],
                                     p[6],      -p[0] / size, -p[1] / size, 1 / size,  c / along,
                                     s / along, rise / along, expf(p[3]),   expf(p[4])};
        memcpy(ret, values, sizeof values);
        return;
    }
    memcpy(ret, colour, sizeof(float) * COLOURS);
    ret += COLOURS;
    if (lobes->model == LOBES_PTM)
        memcpy(ret, p, sizeof(float) * POLYNOMIAL);
    if (lobes->model == LOBES_LAFORTUNE)
        *ret++ = p[4 * lobes->n_lobes];
    /* p is g (3) and ln N of the lobe |g| ⟨g/|g| · x⟩^N; hence (X, Y, Z) = g/|g| · |g|^(1/N) */
    for (int k = 0; k < lobes->n_lobes; k++, p += 4, ret += 4) {
        const float size = sqrtf(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
        const float n = CLAMP(expf(p[3]), LOBES_MIN_EXPONENT, LOBES_MAX_EXPONENT);
        for (int i = 0; i < 3; i++)
            ret[i] = size > 0 ? p[i] / size * powf(size, 1 / n) : 0;
        ret[3] = n;
    }
}

/* Finds the diffuse colour D and the specular colour S of a texel by linear least squares for a
 * given shape. d is the model with diffuse 1 and specular 0, s is the model with diffuse 0 and
 * specular 1. Each colour minimises Σ (D d + S s − x)² over the measured values x of the texel. */
static void colour_facet(const struct lobes_run *run, int texel, float *values) {
    const gsize n_lights = run->btf->layout.lights.n, n = run->btf->layout.views.n * n_lights;
    const float *rgb = run->btf->values + (gsize)texel * n * COLOURS;
    double m[3] = {1e-9, 0, 1e-9}, b[COLOURS][2] = {{0}};
    for (int i = 0; i < 6; i++)
        values[i] = i < 3 ? 1 : 0;
    for (gsize i = 0; i < n; i++, rgb += COLOURS) {
        float both[3], lambert[3];
        const float *view = run->views + 3 * (i / n_lights);
        const float *light = run->lights + 3 * (i % n_lights);
        if (!is_there(rgb))
            continue;
        values[3] = 0;
        lobes_evaluate(run->lobes, 0, texel, view, light, lambert);
        values[3] = 1;
        lobes_evaluate(run->lobes, 0, texel, view, light, both);
        const double d = lambert[0], s = both[0] - lambert[0];
        m[0] += d * d, m[1] += d * s, m[2] += s * s;
        for (int c = 0; c < COLOURS; c++) {
            b[c][0] += d * rgb[c];
            b[c][1] += s * rgb[c];
        }
    }
    const double determinant = MAX(m[0] * m[2] - m[1] * m[1], 1e-12 * m[0] * m[2]);
    for (int c = 0; c < COLOURS; c++) {
        double d = (b[c][0] * m[2] - b[c][1] * m[1]) / determinant;
        double s = (b[c][1] * m[0] - b[c][0] * m[1]) / determinant;
        if (d < 0)
            d = 0, s = b[c][1] / m[2];
        else if (s < 0)
            s = 0, d = b[c][0] / m[0];
        values[c] = (float)CLAMP(d, 0, LOBES_MAX_PEAK);
        values[COLOURS + c] = (float)CLAMP(s, 0, LOBES_MAX_PEAK);
    }
}

/* Fits the texels of a block. Does nothing if the checkpoint has their values. The rows of a block
 * are in the order texel, slice. The values of lobes.h are in the order slice, texel. */
static void fit_block(int block, gpointer data) {
    const struct lobes_run *run = data;
    struct lobes *lobes = run->lobes;
    const gsize texels = btf_layout_texels(&lobes->layout), first = (gsize)block * BLOCK;
    const gsize slices = (gsize)lobes->n_slices, n_rows = MIN(BLOCK, texels - first) * slices;
    const gsize samples = (gsize)run->fit.n_views * (gsize)run->fit.n_lights;
    const gsize parameters =
        lobes->model == LOBES_PTM ? POLYNOMIAL : (gsize)lobes_fit_parameters(&run->fit);
    const float *rgb = run->btf->values + first * slices * samples * COLOURS;
    if (g_atomic_int_get(&run->done[block]))
        return;
    g_autofree float *rows = g_new0(float, n_rows *samples);
    g_autofree float *colours = g_new0(float, n_rows *COLOURS);
    g_autofree float *found = g_new0(float, n_rows *parameters);
    for (gsize i = 0; i < n_rows; i++)
        split(rgb + i * samples * COLOURS, samples, rows + i * samples, colours + i * COLOURS);
    for (gsize i = 0; lobes->model == LOBES_PTM && i < n_rows; i++)
        fit_polynomial(run, rows + i * samples, found + i * parameters);
    if (lobes->model != LOBES_PTM)
        fit_from_starts(run, rows, (int)n_rows, found);
    for (gsize i = 0; i < n_rows; i++) {
        const gsize at = i % slices * texels + first + i / slices;
        float *values = lobes->values + at * (gsize)lobes->n_values;
        store(lobes, colours + i * COLOURS, found + i * parameters, values);
        if (lobes_traits[lobes->model].facet)
            colour_facet(run, (int)at, values);
    }
    g_atomic_int_set(&run->done[block], 1);
}

/* Copies the arrays of an earlier run from the checkpoint, and registers the arrays that the
 * checkpoint saves. */
static void resume(struct lobes_run *run) {
    Checkpoint *checkpoint = run->options->checkpoint;
    const struct lobes *lobes = run->lobes;
    const gsize flags = sizeof(int) * (gsize)run->n_blocks;
    const gsize values = sizeof(float) * (gsize)(lobes_bytes(lobes) / 2);
    g_autofree char *what =
        g_strdup_printf("%s of %d", lobes_model_name(lobes->model), lobes->n_lobes);
    btf_checkpoint_begin(checkpoint, run->btf, what);
    const int *done = checkpoint_get(checkpoint, "blocks", flags);
    const float *found = checkpoint_get(checkpoint, "values", values);
    if (done && found) {
        memcpy(run->done, done, flags);
        memcpy(lobes->values, found, values);
    }
    checkpoint_keep_flags(checkpoint, "blocks", run->done, run->n_blocks);
    checkpoint_keep(checkpoint, "values", lobes->values, values);
}

static void report_and_save(const struct work_progress *progress, gpointer data) {
    const struct lobes_options *options = data;
    if (options->work.progress)
        options->work.progress(progress, options->work.data);
    if (options->checkpoint)
        checkpoint_save_if_due(options->checkpoint);
}

static gboolean fit_blocks(struct lobes_run *run, GError **error) {
    Checkpoint *checkpoint = run->options->checkpoint;
    struct work work = run->options->work;
    work.progress = report_and_save;
    work.data = (gpointer)run->options;
    if (checkpoint)
        resume(run);
    const gboolean ok = work_parallel(&work, "fit", run->n_blocks, fit_block, run, error);
    if (checkpoint && !ok)
        checkpoint_save(checkpoint);
    if (checkpoint) {
        checkpoint_drop(checkpoint, "blocks");
        checkpoint_drop(checkpoint, "values");
    }
    return ok;
}

struct lobes *lobes_compute(const struct btf_matrix *btf, const struct lobes_options *options,
                            GError **error) {
    const struct btf_layout *layout = &btf->layout;
    if ((guint)options->model >= LOBES_MODELS) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "there is no analytic model number %d; give LOBES_FIELDS, LOBES_PTM, "
                    "LOBES_LAFORTUNE, LOBES_WARD or LOBES_ASHIKHMIN",
                    (int)options->model);
        return NULL;
    }
    if (options->n_lobes < 0 || options->n_lobes > LOBES_MAX_LOBES) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "%s cannot have %d lobes; give 1 to %d lobes", lobes_model_name(options->model),
                    options->n_lobes, LOBES_MAX_LOBES);
        return NULL;
    }
    if (!texel_model_check(btf, error))
        return NULL;
    const struct lobes_traits *traits = &lobes_traits[options->model];
    struct lobes *lobes = g_new0(struct lobes, 1);
    lobes->model = options->model;
    lobes->name = g_strdup(btf->name);
    lobes->layout = btf_layout_copy(layout);
    lobes->n_lobes = traits->lobed ? (options->n_lobes ? options->n_lobes : DEFAULT_LOBES) : 0;
    lobes->n_slices = traits->each_view ? (int)layout->views.n : 1;
    lobes->n_values = traits->n_values + 4 * lobes->n_lobes;
    lobes->values = g_new0(float, lobes_bytes(lobes) / 2);
    g_autofree float *views = direction_list_vectors(&layout->views);
    g_autofree float *lights = direction_list_vectors(&layout->lights);
    g_autofree float *polynomial = pseudo_inverse(lights, (int)layout->lights.n);
    const int n_blocks = (int)((btf_layout_texels(layout) + BLOCK - 1) / BLOCK);
    g_autofree int *done = g_new0(int, n_blocks);
    const struct lobes_fit fit = {
        lobes->model,          lobes->n_lobes, lobes->n_slices > 1 ? 1 : (int)layout->views.n,
        (int)layout->lights.n, views,          lights};
    struct lobes_run run = {btf,   options, lobes,      fit,      lobes_start_new(&fit),
                            views, lights,  polynomial, n_blocks, done};
    if (fit_blocks(&run, error)) {
        lobes->exact_error = lobes_error(lobes, btf, options->work.n_threads);
        texel_model_to_halves(lobes->values, (gsize)(lobes_bytes(lobes) / 2));
        lobes_error(lobes, btf, options->work.n_threads);
    } else {
        g_clear_pointer(&lobes, lobes_free);
    }
    lobes_start_free(run.start);
    return lobes;
}
