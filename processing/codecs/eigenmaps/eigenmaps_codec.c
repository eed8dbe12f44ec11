#include "eigenmaps_codec.h"
#include "base/plural.h"

#include "base/data_error.h"

#include <gio/gio.h>
#include <math.h>
#include <string.h>

#define TERMS     4  /* number of terms without --components and --error */
#define CURVE_MAX 16 /* maximum number of terms of a curve */
/* number of texels that give_column() copies at a time. The values to which it writes then stay in
 * the cache */
#define ROWS ((gsize)64)

struct columns {
    const struct btf_matrix *btf;
    const struct work *work;
    gint64 begun_us;
    int asked; /* number of calls of give_column(), for the progress */
};

static gboolean give_column(int view, float *ret_column, gpointer data, GError **error) {
    struct columns *columns = data;
    const struct btf_matrix *btf = columns->btf;
    const gsize texels = btf_layout_texels(&btf->layout), n = 3 * btf->layout.lights.n;
    columns->asked++;
    if (!work_tell(columns->work, "eigenmaps", MIN(columns->asked, btf->layout.views.n),
                   btf->layout.views.n, columns->begun_us, error))
        return FALSE;
    g_autofree float *buffer = btf->values ? NULL : g_new(float, ROWS *n);
    for (gsize first = 0; first < texels; first += ROWS) {
        const gsize rows = MIN(ROWS, texels - first);
        gsize stride;
        const float *values =
            btf_matrix_rows(btf, view, (int)first, (int)rows, buffer, &stride, error);
        if (!values)
            return FALSE;
        for (gsize row = 0; row < rows; row++)
            for (gsize i = 0; i < n; i++)
                ret_column[(i / 3 * texels + first + row) * 3 + i % 3] = values[row * stride + i];
    }
    return TRUE;
}

/* Gives the values of n texels of a view from the BTF's scratch file. */
static gboolean give_texels(int view, gsize first, gsize n, float *ret, gpointer data,
                            GError **error) {
    const struct columns *columns = data;
    const struct btf_matrix *btf = columns->btf;
    const gsize values = 3 * btf->layout.lights.n;
    g_autofree float *buffer = btf->values ? NULL : g_new(float, ROWS *values);
    if (g_cancellable_set_error_if_cancelled(columns->work ? columns->work->cancellable : NULL,
                                             error))
        return FALSE;
    for (gsize done = 0; done < n; done += ROWS) {
        const gsize rows = MIN(ROWS, n - done);
        gsize stride;
        const float *from =
            btf_matrix_rows(btf, view, (int)(first + done), (int)rows, buffer, &stride, error);
        if (!from)
            return FALSE;
        for (gsize row = 0; row < rows; row++)
            for (gsize i = 0; i < values; i++)
                ret[(i / 3 * n + done + row) * 3 + i % 3] = from[row * stride + i];
    }
    return TRUE;
}

struct eigenmaps *eigenmaps_of_matrix(const struct btf_matrix *btf, int n_terms,
                                      const struct eigenmaps_options *options,
                                      const struct work *work, double *ret_error, GError **error) {
    struct columns columns = {.btf = btf, .work = work, .begun_us = g_get_monotonic_time()};
    struct eigenmaps_options own = *options;
    own.part = give_texels;
    struct eigenmaps *maps = g_new0(struct eigenmaps, 1);
    maps->name = g_strdup(btf->name);
    maps->layout = btf_layout_copy(&btf->layout);
    maps->n_terms = n_terms;
    if (!eigenmaps_compute_with(maps, &own, give_column, &columns, ret_error, error))
        g_clear_pointer(&maps, eigenmaps_free);
    return maps;
}

struct eigenmaps_codec_options {
    int components;
    double error;
};

static const struct option eigenmaps_codec_table[] = {
    {.name = "components",
     .type = OPTION_INT,
     .min = 1,
     .max = G_MAXDOUBLE,
     .offset = offsetof(struct eigenmaps_codec_options, components),
     .help = "number of eigen-maps (4 if not given); with --error the maximum"},
    {.name = "error",
     .type = OPTION_SHARE,
     .offset = offsetof(struct eigenmaps_codec_options, error),
     .help = "find the smallest number of eigen-maps that reaches this error over the whole BTF"},
    {NULL},
};

/* Sets the limit of memory in options. It is job->memory, less the bytes of all maps, or of one map
 * if has_target. If job->memory is 0, options->memory becomes 0, the default.
 *
 * If the limit is too small for one column next to the maps, the maps are kept in a file, and half
 * of job->memory is for blocks. Fails if job->memory is too small for one column. */
static gboolean limit_memory(const struct codec_job *job, gboolean has_target, int terms,
                             struct eigenmaps_options *options, char **ret_folder, GError **error) {
    const struct btf_matrix *btf = job->btf;
    const gint64 column = btf_matrix_bytes(&btf->layout) / btf->layout.views.n;
    const gint64 left = job->memory - column * (has_target ? 1 : terms);
    options->memory = (gsize)MAX(left, 0);
    if (job->memory == 0 || left >= column)
        return TRUE;
    options->memory = (gsize)job->memory / 2;
    options->folder = *ret_folder = btf->directory
                                        ? g_build_filename(btf->directory, "products", NULL)
                                        : g_strdup(g_get_tmp_dir());
    if (job->memory >= column)
        return TRUE;
    g_autofree char *given = g_format_size((guint64)job->memory);
    g_autofree char *least = g_format_size((guint64)column);
    g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                "--memory gives %s, which is too little for one view of %zu × %zu texels and %zu "
                "lights; allow at least %s",
                given, btf->layout.width, btf->layout.height, btf->layout.lights.n, least);
    return FALSE;
}

/* Computes eigen-maps, and their errors before and after rounding. If only the rounding makes the
 * error larger than requested, a second attempt aims at a smaller error before rounding. */
static struct eigenmaps *compute(const struct codec_job *job, int terms,
                                 struct eigenmaps_options *options, struct codec_result *ret,
                                 GError **error) {
    const double asked = options->target;
    double left = asked * asked;
    for (int times = 0; times < 2 && (times == 0 || left > 0); times++) {
        options->target = sqrt(left);
        struct eigenmaps *maps =
            eigenmaps_of_matrix(job->btf, terms, options, job->work, &ret->exact_error, error);
        if (!maps)
            return NULL;
        ret->error = eigenmaps_rounded_error(maps, ret->exact_error);
        if (asked <= 0 || ret->error <= asked)
            return maps;
        eigenmaps_free(maps);
        const double exact = ret->exact_error * ret->exact_error;
        left = (asked * asked - (ret->error * ret->error - exact)) * (1 - 1e-6);
    }
    g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                "an error of %.3g %% is not reached: the eigen-maps have an error of %.3g %%, "
                "which rounding them to half floats increases to %.3g %%; allow a larger error",
                100 * asked, 100 * ret->exact_error, 100 * ret->error);
    return NULL;
}

static gboolean encode(const struct codec *codec G_GNUC_UNUSED, const struct codec_job *job,
                       struct codec_result *ret, GError **error) {
    const struct eigenmaps_codec_options *asked = job->options;
    const int n_views = job->btf->layout.views.n;
    const int terms = asked->components  ? asked->components
                      : asked->error > 0 ? n_views
                                         : MIN(TERMS, n_views);
    struct eigenmaps_options options = {.target = asked->error};
    g_autofree char *folder = NULL;
    if (!limit_memory(job, asked->error > 0, terms, &options, &folder, error))
        return FALSE;
    struct eigenmaps *maps = compute(job, terms, &options, ret, error);
    if (!maps)
        return FALSE;
    ret->levels = g_ptr_array_new_with_free_func((GDestroyNotify)eigenmaps_free);
    g_ptr_array_add(ret->levels, maps);
    ret->components = maps->n_terms;
    ret->luminance_error = -1;
    return TRUE;
}

static char *describe(const struct codec *codec G_GNUC_UNUSED, const struct codec_result *result) {
    return g_strdup_printf("%d %s", PLURAL(result->components, "eigen-map"));
}

static gboolean eigenmaps_codec_write(const char *path, gpointer const *levels,
                                      int n_levels G_GNUC_UNUSED, GError **error) {
    return eigenmaps_write(path, levels[0], error);
}

static gpointer eigenmaps_codec_read(const char *path, GError **error) {
    return eigenmaps_read(path, error);
}

static char *describe_file(const struct exr_file *file) {
    const struct exr_part *weights = exr_file_part(file, "weights");
    const struct exr_part *lights = exr_file_part(file, "lights");
    const struct exr_part *map = exr_file_part(file, "E000_light_0000");
    if (!weights || !lights || !map)
        return NULL;
    return g_strdup_printf("eigen-maps: %d %s of %d %s × %d %s, %d × %d texels",
                           PLURAL(weights->height, "term"), PLURAL(weights->width, "view"),
                           PLURAL(lights->width, "light"), map->width, map->height);
}

/* Counts 2 bytes for each value of the maps and 4 for each weight. */
static gint64 bytes(gconstpointer model) {
    const struct eigenmaps *maps = model;
    const gint64 values = 3 * btf_layout_texels(&maps->layout) * maps->layout.lights.n;
    return maps->n_terms * (2 * values + (gint64)sizeof(float) * maps->layout.views.n);
}

/* Computes B(v, l) = Σ_i W_i(v) E_i(x, l) of a texel x. The maps are term × light × texel × RGB. */
static void reconstruct(gconstpointer model, int texel, float *ret) {
    const struct eigenmaps *maps = model;
    const gsize texels = btf_layout_texels(&maps->layout), n_lights = maps->layout.lights.n;
    memset(ret, 0, sizeof(float) * maps->layout.views.n * n_lights * 3);
    for (gsize term = 0; term < (gsize)maps->n_terms; term++)
        for (gsize view = 0; view < maps->layout.views.n; view++) {
            const float weight = maps->weights[term * maps->layout.views.n + view];
            for (gsize light = 0; light < n_lights; light++) {
                const float *map =
                    maps->maps + ((term * n_lights + light) * texels + (gsize)texel) * 3;
                float *to = ret + (view * n_lights + light) * 3;
                for (int c = 0; c < 3; c++)
                    to[c] += weight * map[c];
            }
        }
}

/* Adds Σ_i (Σ_a g_a W_i(v_a)) Σ_b h_b E_i(x, l_b) for each texel x, times its share. v_a and l_b
 * are the views and lights of the query. g_a and h_b are their weights. */
static void evaluate(gconstpointer model, const struct codec_query *query,
                     const struct codec_texels *texels, float ret[3]) {
    const struct eigenmaps *maps = model;
    const gsize n = btf_layout_texels(&maps->layout), n_lights = maps->layout.lights.n;
    for (gsize term = 0; term < (gsize)maps->n_terms; term++) {
        float sum[3] = {0}, weight = 0;
        for (int a = 0; a < query->n_views; a++)
            weight += query->view_weights[a] *
                      maps->weights[term * maps->layout.views.n + (gsize)query->views[a]];
        for (int b = 0; b < query->n_lights; b++) {
            const float *map = maps->maps + (term * n_lights + (gsize)query->lights[b]) * n * 3;
            for (int k = 0; k < texels->n; k++)
                for (int c = 0; c < 3; c++)
                    sum[c] += query->light_weights[b] * texels->share[k] *
                              map[(gsize)texels->index[k] * 3 + (gsize)c];
        }
        for (int c = 0; c < 3; c++)
            ret[c] += weight * sum[c];
    }
}

/* Reports models of 1, 2, 4, … maps. The maps are sorted by the variance that they explain, so that
 * leaving out the last ones gives the best model with fewer maps. */
static gboolean curve(const struct codec *codec, const struct codec_job *job, CodecPoint tell,
                      gpointer data, GError **error) {
    const struct btf_matrix *btf = job->btf;
    const struct work *work = job->work;
    const int most = MIN(CURVE_MAX, btf->layout.views.n);
    const struct eigenmaps_options options = {0};
    double ignored;
    struct eigenmaps *maps = eigenmaps_of_matrix(btf, most, &options, work, &ignored, error);
    gboolean ok = maps != NULL;
    for (int n = 1; ok && n <= most; n *= 2) {
        maps->n_terms = n;
        ok = tell(codec,
                  &(struct codec_point){
                      .series = codec->title,
                      .label = g_strdup_printf(n > 1 ? "%d terms" : "%d term", n),
                      .bytes = bytes(maps),
                      .error = -1,
                      .model = maps,
                  },
                  data, error);
    }
    eigenmaps_free(maps);
    return ok;
}

const struct codec eigenmaps_codec = {
    .name = "eigenmaps",
    .title = "eigen-maps",
    .help = "eigen-maps: a few maps that all views share (Wang et al. 2005)",
    .options = eigenmaps_codec_table,
    .options_size = sizeof(struct eigenmaps_codec_options),
    .bounded = TRUE,
    .from_process = TRUE,
    .encode = encode,
    .describe = describe,
    .write = eigenmaps_codec_write,
    .read = eigenmaps_codec_read,
    .describe_file = describe_file,
    .free = (GDestroyNotify)eigenmaps_free,
    .layout = G_STRUCT_OFFSET(struct eigenmaps, layout),
    .bytes = bytes,
    .reconstruct = reconstruct,
    .evaluate = evaluate,
    .curve = curve,
};
