#include "lobes_private.h"

#include <lapacke.h>
#include <math.h>
#include <string.h>

#include "base/data_error.h"
#include "base/direction.h"
#include "btf/btf_checkpoint.h"
#include "exr/exr_half.h"

#define COLOURS    3
#define POLYNOMIAL 6
#define BLOCK      16 /* texels fitted by a thread at a time */

static const char *const names[LOBES_MODELS] = {"fields", "ptm", "lafortune", "ward", "ashikhmin"};

const char *lobes_model_name(enum lobes_model model) {
    return names[model];
}

gboolean lobes_model_parse(const char *name, enum lobes_model *ret) {
    for (int i = 0; i < LOBES_MODELS; i++)
        if (g_strcmp0(name, names[i]) == 0) {
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

/* Everything a computation holds; threads only read it, and write what is their texels'. */
struct run {
    const struct btf_matrix *btf;
    const struct lobes_options *options;
    struct lobes *lobes;
    struct lobes_fit fit;
    struct lobes_start *start;
    float *views, *lights;
    float *polynomial;   /* POLYNOMIAL × n_lights: pseudo-inverse */
    int n_blocks, *done; /* of each block of texels whether it is */
};

static float *lobes_directions(const float *theta_deg, const float *phi_deg, int n) {
    float *ret = g_new(float, 3 * n);
    for (int i = 0; i < n; i++)
        direction_from_deg(theta_deg[i], phi_deg[i], ret + (gsize)(3 * i));
    return ret;
}

static void basis(const float *light, double ret[POLYNOMIAL]) {
    const double x = light[0], y = light[1];
    const double values[POLYNOMIAL] = {x * x, y * y, x * y, x, y, 1};
    memcpy(ret, values, sizeof values);
}

/* The least squares of shortest length where lights are too few or lie badly. there may be NULL. */
static void solve_polynomial(const float *lights, int n, const float *row, double *columns,
                             int n_columns) {
    g_autofree double *a = g_new(double, n *POLYNOMIAL);
    double singular[POLYNOMIAL];
    int rank;
    for (int i = 0; i < n; i++) {
        basis(lights + (gsize)(3 * i), a + (gsize)(i * POLYNOMIAL));
        for (int k = 0; row && isnan(row[i]) && k < POLYNOMIAL; k++)
            a[i * POLYNOMIAL + k] = 0;
    }
    LAPACKE_dgelsd(LAPACK_ROW_MAJOR, n, POLYNOMIAL, n_columns, a, POLYNOMIAL, columns, n_columns,
                   singular, 1e-6, &rank);
}

static float *pseudo_inverse(const float *lights, int n) {
    const int rows = MAX(n, POLYNOMIAL);
    g_autofree double *columns = g_new0(double, rows *n);
    float *ret = g_new(float, POLYNOMIAL *n);
    for (int i = 0; i < n; i++)
        columns[i * n + i] = 1;
    solve_polynomial(lights, n, NULL, columns, n);
    for (int i = 0; i < POLYNOMIAL * n; i++)
        ret[i] = (float)columns[i];
    return ret;
}

static void fit_polynomial(const struct run *run, const float *row, float *ret) {
    const int n = run->btf->layout.lights.n;
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

/* A value counts where all of its colours are there. */
static gboolean lobes_is_there(const float *rgb) {
    return !isnan(rgb[0]) && !isnan(rgb[1]) && !isnan(rgb[2]);
}

/* Luminance of a row, and the colour that Y is multiplied by: Σ RGB / Σ Y. */
static void lobes_split(const float *rgb, int n, float *ret_row, float ret_colour[3]) {
    double sums[COLOURS] = {0}, all = 0;
    for (int i = 0; i < n; i++) {
        const float *value = rgb + (gsize)i * COLOURS;
        const gboolean there = lobes_is_there(value);
        ret_row[i] = there ? rgb_luminance(value) : NAN;
        for (int c = 0; there && c < COLOURS; c++)
            sums[c] += value[c];
        all += there ? ret_row[i] : 0;
    }
    for (int c = 0; c < COLOURS; c++)
        ret_colour[c] = all > 0 ? (float)CLAMP(sums[c] / all, 0, 1000) : 1;
}

/* Several starts; the best end counts. */
static void fit_rows(const struct run *run, const float *rows, int n, float *ret) {
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

/* From g, log N to X Y Z N. */
static void store_lobe(const float *p, float *ret) {
    const float size = sqrtf(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
    const float n = CLAMP(expf(p[3]), LOBES_MIN_EXPONENT, LOBES_MAX_EXPONENT);
    for (int i = 0; i < 3; i++)
        ret[i] = size > 0 ? p[i] / size * powf(size, 1 / n) : 0;
    ret[3] = n;
}

static void store_facet(const float *p, float *ret) {
    const float size = sqrtf(p[0] * p[0] + p[1] * p[1] + 1), c = cosf(p[2]), s = sinf(p[2]);
    const float rise = p[0] * c + p[1] * s, along = sqrtf(1 + rise * rise);
    const float values[14] = {p[5],      p[5],         p[5],         p[6],      p[6],
                              p[6],      -p[0] / size, -p[1] / size, 1 / size,  c / along,
                              s / along, rise / along, expf(p[3]),   expf(p[4])};
    memcpy(ret, values, sizeof values);
}

/* colour: 3, or NULL for models that have it in their values. */
static void lobes_store(const struct run *run, const float *colour, const float *p, float *ret) {
    const int k = run->lobes->n_lobes;
    if (run->lobes->model == LOBES_WARD || run->lobes->model == LOBES_ASHIKHMIN) {
        store_facet(p, ret);
        return;
    }
    memcpy(ret, colour, sizeof(float) * COLOURS);
    ret += COLOURS;
    if (run->lobes->model == LOBES_PTM) {
        memcpy(ret, p, sizeof(float) * POLYNOMIAL);
        return;
    }
    if (run->lobes->model == LOBES_LAFORTUNE)
        *ret++ = p[4 * k];
    for (int i = 0; i < k; i++)
        store_lobe(p + (gsize)(4 * i), ret + (gsize)(4 * i));
}

/* Diffuse and specular colours of a texel by linear least squares, its shape being given. */
static void colour_facet(const struct run *run, int texel, float *values) {
    const struct btf_matrix *btf = run->btf;
    const float *rgb =
        btf->values + (gsize)texel * (gsize)(btf->layout.views.n * btf->layout.lights.n) * COLOURS;
    double m[3] = {1e-9, 0, 1e-9}, b[COLOURS][2] = {{0}};
    for (int i = 0; i < 6; i++)
        values[i] = i < 3 ? 1 : 0;
    for (gsize i = 0; i < btf->layout.views.n * btf->layout.lights.n; i++) {
        float both[3], lambert[3];
        const float *view = run->views + (gsize)(i / btf->layout.lights.n * 3);
        const float *light = run->lights + (gsize)(i % btf->layout.lights.n * 3);
        if (!lobes_is_there(rgb + (gsize)i * COLOURS))
            continue;
        values[3] = 0;
        lobes_evaluate(run->lobes, 0, texel, view, light, lambert);
        values[3] = 1;
        lobes_evaluate(run->lobes, 0, texel, view, light, both);
        const double d = lambert[0], s = both[0] - lambert[0];
        m[0] += d * d, m[1] += d * s, m[2] += s * s;
        for (int c = 0; c < COLOURS; c++) {
            b[c][0] += d * rgb[(gsize)i * COLOURS + (gsize)c];
            b[c][1] += s * rgb[(gsize)i * COLOURS + (gsize)c];
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

static void fit_texels(const struct run *run, int block) {
    struct lobes *lobes = run->lobes;
    const int texels = btf_layout_texels(&lobes->layout), first = block * BLOCK;
    const int slices = lobes->n_slices, rows_here = MIN(BLOCK, texels - first) * slices;
    const gsize samples = (gsize)run->fit.n_views * (gsize)run->fit.n_lights;
    const gsize parameters =
        lobes->model == LOBES_PTM ? POLYNOMIAL : (gsize)lobes_fit_parameters(&run->fit);
    const float *rgb = run->btf->values + (gsize)first * (gsize)slices * samples * COLOURS;
    g_autofree float *rows = g_new0(float, (gsize)rows_here *samples);
    g_autofree float *colours = g_new0(float, rows_here *COLOURS);
    g_autofree float *found = g_new0(float, (gsize)rows_here *parameters);
    for (gsize i = 0; i < (gsize)rows_here; i++)
        lobes_split(rgb + i * samples * COLOURS, (int)samples, rows + i * samples,
                    colours + i * COLOURS);
    for (gsize i = 0; lobes->model == LOBES_PTM && i < (gsize)rows_here; i++)
        fit_polynomial(run, rows + i * samples, found + i * parameters);
    if (lobes->model != LOBES_PTM)
        fit_rows(run, rows, rows_here, found);
    for (gsize i = 0; i < (gsize)rows_here; i++) {
        const gsize at = i % (gsize)slices * (gsize)texels + (gsize)first + i / (gsize)slices;
        lobes_store(run, colours + i * COLOURS, found + i * parameters,
                    lobes->values + at * (gsize)lobes->n_values);
    }
    if (lobes->model == LOBES_WARD || lobes->model == LOBES_ASHIKHMIN)
        for (int texel = first; texel < first + rows_here; texel++)
            colour_facet(run, texel, lobes->values + (gsize)texel * (gsize)lobes->n_values);
}

static void fit_block(int block, gpointer data) {
    const struct run *run = data;
    if (g_atomic_int_get(&run->done[block]))
        return;
    fit_texels(run, block);
    g_atomic_int_set(&run->done[block], 1);
}

static void lobes_to_halves(struct lobes *lobes) {
    const gsize n = (gsize)(lobes_bytes(lobes) / 2);
    g_autofree guint16 *halves = g_new(guint16, n);
    exr_half_from_floats(halves, lobes->values, n);
    exr_half_to_floats(lobes->values, halves, n);
}

static int count_values(enum lobes_model model, int k) {
    switch (model) {
    case LOBES_FIELDS:
        return COLOURS + 4 * k;
    case LOBES_PTM:
        return COLOURS + POLYNOMIAL;
    case LOBES_LAFORTUNE:
        return COLOURS + 1 + 4 * k;
    default:
        return 14;
    }
}

static struct lobes *lobes_new(const struct btf_matrix *btf, const struct lobes_options *options) {
    struct lobes *lobes = g_new0(struct lobes, 1);
    const gboolean views = options->model == LOBES_FIELDS || options->model == LOBES_PTM;
    const gboolean k = options->model == LOBES_FIELDS || options->model == LOBES_LAFORTUNE;
    *lobes = (struct lobes){
        .model = options->model,
        .name = g_strdup(btf->name),
        .layout = btf_layout_copy(&btf->layout),
        .n_lobes = !k                 ? 0
                   : options->n_lobes ? options->n_lobes
                                      : 2,
        .n_slices = views ? btf->layout.views.n : 1,
    };
    lobes->n_values = count_values(lobes->model, lobes->n_lobes);
    lobes->values = g_new0(float, lobes_bytes(lobes) / 2);
    return lobes;
}

static gboolean data_error(GError **error, const char *what) {
    g_set_error_literal(error, DATA_ERROR, DATA_ERROR_INVALID, what);
    return FALSE;
}

static gboolean lobes_check(const struct btf_matrix *btf, const struct lobes_options *options,
                            GError **error) {
    const gint64 texels = btf_layout_texels(&btf->layout);
    const gint64 values = btf_layout_values(&btf->layout);
    if (texels < 1 || values < 1 || texels > G_MAXINT / 64 || values > G_MAXINT / 64)
        return data_error(error, "the BTF has no texels, views or lights, or far too many");
    if ((guint)options->model >= LOBES_MODELS || options->n_lobes < 0 ||
        options->n_lobes > LOBES_MAX_LOBES)
        return data_error(error, "there is no such model, or not with so many lobes: 1 to 3");
    for (gint64 i = 0; i < texels * values; i++)
        if (isinf(btf->values[i])) {
            g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                        "view %d, texel (%d, %d) is infinite; make that view's BTF again",
                        (int)(i % values / COLOURS / btf->layout.lights.n),
                        (int)(i / values % btf->layout.width),
                        (int)(i / values / btf->layout.width));
            return FALSE;
        }
    return TRUE;
}

/* What the file has becomes the run's; and from now on the run's is kept. */
static void lobes_keep(struct run *run) {
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

static void lobes_tell_and_save(const struct work_progress *progress, gpointer data) {
    const struct lobes_options *options = data;
    if (options->work.progress)
        options->work.progress(progress, options->work.data);
    if (options->checkpoint)
        checkpoint_save_if_due(options->checkpoint);
}

static gboolean fit_blocks(struct run *run, GError **error) {
    Checkpoint *checkpoint = run->options->checkpoint;
    struct work work = run->options->work;
    work.progress = lobes_tell_and_save;
    work.data = (gpointer)run->options;
    run->n_blocks = (btf_layout_texels(&run->lobes->layout) + BLOCK - 1) / BLOCK;
    run->done = g_new0(int, run->n_blocks);
    if (checkpoint)
        lobes_keep(run);
    const gboolean ok = work_parallel(&work, "fit", run->n_blocks, fit_block, run, error);
    if (checkpoint && !ok)
        checkpoint_save(checkpoint);
    if (checkpoint) {
        checkpoint_drop(checkpoint, "blocks");
        checkpoint_drop(checkpoint, "values");
    }
    g_free(run->done);
    return ok;
}

static gboolean lobes_fit_all(struct run *run, GError **error) {
    run->fit = (struct lobes_fit){run->lobes->model,
                                  run->lobes->n_lobes,
                                  run->lobes->n_slices > 1 ? 1 : run->btf->layout.views.n,
                                  run->btf->layout.lights.n,
                                  run->views,
                                  run->lights};
    run->start = lobes_start_new(&run->fit);
    run->polynomial = pseudo_inverse(run->lights, run->btf->layout.lights.n);
    const gboolean ok = fit_blocks(run, error);
    if (ok) {
        run->lobes->exact_error = lobes_error(run->lobes, run->btf, run->options->work.n_threads);
        lobes_to_halves(run->lobes);
        lobes_error(run->lobes, run->btf, run->options->work.n_threads);
    }
    lobes_start_free(run->start);
    g_free(run->polynomial);
    return ok;
}

struct lobes *lobes_compute(const struct btf_matrix *btf, const struct lobes_options *options,
                            GError **error) {
    if (!lobes_check(btf, options, error))
        return NULL;
    struct run run = {btf, options, lobes_new(btf, options)};
    run.views = lobes_directions(btf->layout.views.theta_deg, btf->layout.views.phi_deg,
                                 btf->layout.views.n);
    run.lights = lobes_directions(btf->layout.lights.theta_deg, btf->layout.lights.phi_deg,
                                  btf->layout.lights.n);
    if (!lobes_fit_all(&run, error))
        g_clear_pointer(&run.lobes, lobes_free);
    g_free(run.views);
    g_free(run.lights);
    return run.lobes;
}
