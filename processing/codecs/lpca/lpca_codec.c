#include "lpca_codec.h"

#include "base/data_error.h"
#include "btf/direction_grid.h"
#include "lpca_choose.h"
#include "lpca_evaluate.h"
#include "lpca_levels.h"
#include "lpca_pack.h"
#include "lpca_resample.h"

#include <math.h>

#define CLUSTERS       32
#define COMPONENTS     8
#define MAX_ROUNDING   4 /* maximum number of attempts to reach an error after rounding */
#define CURVE_CLUSTERS 64
#define CURVE_MAX      16 /* maximum number of components of a curve */
/* coarsest step of the packed models of a curve, relative to lpca_mean_size() */
#define COARSEST         4.0
#define FINEST           (1.0 / 32) /* finest step, in the same unit */
#define TEXELS_A_CLUSTER 16         /* minimum number of texels per cluster of a curve */

struct lpca_codec_options {
    int clusters, components; /* 0 if not given */
    int grid;                 /* n of a grid of n × n directions; 0 for the measured directions */
    int quantise;             /* enum lpca_quantise */
    int colours;              /* enum lpca_colours */
    double error;             /* 0 if not given */
    gint64 size;              /* maximum number of bytes of the result; 0 if not limited */
    gboolean mips;
};

static const char *const lpca_codec_quantise[] = {"float",        "half",   "8bit",
                                                  "8bit-weights", "packed", NULL};
static const char *const lpca_codec_colours[] = {"rgb", "log", NULL};

static const struct option lpca_codec_table[] = {
    {.name = "clusters",
     .type = OPTION_INT,
     .min = 1,
     .max = LPCA_MAX_CLUSTERS,
     .offset = offsetof(struct lpca_codec_options, clusters),
     .help = "number of clusters of texels (32 if not given)"},
    {.name = "components",
     .type = OPTION_INT,
     .min = 1,
     .max = LPCA_MAX_PACKED,
     .offset = offsetof(struct lpca_codec_options, components),
     .help = "number of eigen-BRDFs of a cluster (8 if not given, more than 64 only if packed); "
             "with --error or --size the maximum"},
    {.name = "error",
     .type = OPTION_SHARE,
     .offset = offsetof(struct lpca_codec_options, error),
     .help = "find the smallest model whose error over the whole BTF is at most this; chooses the "
             "components and, without -k, the clusters"},
    {.name = "size",
     .type = OPTION_BYTES,
     .offset = offsetof(struct lpca_codec_options, size),
     .help =
         "find the numbers of clusters and components with the smallest error within this size"},
    {.name = "mips",
     .type = OPTION_BOOL,
     .offset = offsetof(struct lpca_codec_options, mips),
     .help = "also write mip levels, each compressed separately"},
    {.name = "grid",
     .type = OPTION_INT,
     .min = DIRECTION_GRID_MIN,
     .max = DIRECTION_GRID_MAX,
     .offset = offsetof(struct lpca_codec_options, grid),
     .help = "store eigen-BRDFs on a grid of N × N directions; 12 is a good value"},
    {.name = "quantise",
     .type = OPTION_CHOICE,
     .fallback = "half",
     .choices = lpca_codec_quantise,
     .offset = offsetof(struct lpca_codec_options, quantise),
     .help = "format of the numbers in the file. 8bit applies only to eigen-BRDFs. packed (with "
             "--error or --size) is smallest, and is unpacked for drawing"},
    {.name = "colours",
     .type = OPTION_CHOICE,
     .fallback = "rgb",
     .choices = lpca_codec_colours,
     .offset = offsetof(struct lpca_codec_options, colours),
     .help = "colours that are compressed: R, G, B, or the logarithm of luminance and chroma"},
    {NULL},
};

/* Returns a sentence that says how options contradict each other, or NULL if they do not. */
static const char *check(gconstpointer options, gint64 memory) {
    const struct lpca_codec_options *asked = options;
    if (asked->size > 0 && asked->clusters > 0)
        return "--size chooses the clusters: leave out -k";
    if (asked->colours == LPCA_LOG && asked->grid > 0)
        return "--grid needs --colours=rgb";
    if (memory > 0 && asked->mips)
        return "--mips takes the whole BTF into memory: leave out --memory";
    if (asked->quantise != LPCA_PACKED)
        return NULL;
    if ((asked->error > 0) == (asked->size > 0))
        return "--quantise=packed needs either --error or --size";
    if (asked->clusters > 0 || asked->grid > 0 || asked->mips || asked->colours == LPCA_LOG)
        return "--quantise=packed cannot be combined with -k, --grid, --mips or --colours=log";
    return NULL;
}

/* The attempts to reach an error after rounding. times is the number of attempts that have failed.
 * target is the error before rounding at which the next attempt aims. The checkpoint saves this
 * struct. */
struct rounding {
    gint64 times;
    double target;
};

/* Computes a local PCA with the clusters and components of the options, or as many as the requested
 * error or size needs. Resamples the local PCA to a grid if requested, and rounds it. Sets
 * ret->exact_error, the error before resampling and rounding, and ret->error, the error after
 * both. */
static struct lpca *rounded(const struct lpca_codec_options *asked, const struct btf_matrix *btf,
                            const struct lpca_options *options, struct codec_result *ret,
                            GError **error) {
    const struct lpca_target target = {options->target, asked->size, options->n_components,
                                       (enum lpca_quantise)asked->quantise, asked->grid};
    const gboolean choose = asked->clusters == 0 && (asked->size > 0 || asked->error > 0);
    g_autoptr(Lpca) lpca =
        choose ? lpca_choose(btf, options, &target, error) : lpca_compute(btf, options, error);
    if (!lpca)
        return NULL;
    ret->exact_error = lpca->error;
    if (asked->grid > 0) {
        g_autoptr(Lpca) exact = g_steal_pointer(&lpca);
        lpca = lpca_resample(exact, asked->grid, error);
        if (!lpca)
            return NULL;
    }
    lpca_quantise(lpca, (enum lpca_quantise)asked->quantise);
    ret->error = asked->grid > 0 ? lpca_resample_error(lpca, btf, 0) : lpca_error(lpca, btf, 0);
    return g_steal_pointer(&lpca);
}

/* Computes a local PCA whose error after rounding is at most asked->error. The squares of errors
 * add. If an attempt fails, the square that rounding has added is therefore subtracted for the next
 * attempt, which aims at e² = asked->error² − (e_rounded² − e_exact²). The checkpoint saves the
 * local variable `rounding`, and a later call continues from it. */
static struct lpca *compute(const struct lpca_codec_options *asked, const struct btf_matrix *btf,
                            struct lpca_options *options, struct codec_result *ret,
                            GError **error) {
    Checkpoint *checkpoint = options->checkpoint;
    struct rounding rounding = {0, options->target};
    const struct rounding *found =
        checkpoint ? checkpoint_get(checkpoint, "rounding", sizeof rounding) : NULL;
    struct lpca *lpca = NULL;
    gboolean ok = TRUE, reached = FALSE;
    if (found)
        rounding = *found;
    if (checkpoint)
        checkpoint_keep(checkpoint, "rounding", &rounding, sizeof rounding);
    while (rounding.times < MAX_ROUNDING) {
        options->target = rounding.target;
        lpca = rounded(asked, btf, options, ret, error);
        ok = lpca != NULL;
        reached = ok && (asked->error <= 0 || ret->error <= asked->error);
        if (!ok || reached)
            break;
        g_clear_pointer(&lpca, lpca_free);
        const double added = ret->error * ret->error - ret->exact_error * ret->exact_error;
        const double left = asked->error * asked->error - added;
        if (left <= 0)
            break;
        rounding.target = MIN(sqrt(left), ret->exact_error) * (1 - 1e-6);
        rounding.times++;
    }
    if (checkpoint)
        checkpoint_drop(checkpoint, "rounding");
    if (ok && !reached)
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "an error of %.3g %% is not reached: it is %.3g %% before and %.3g %% after "
                    "%srounding; use a finer --quantise%s, or more clusters",
                    100 * asked->error, 100 * ret->exact_error, 100 * ret->error,
                    asked->grid ? "resampling to the grid and " : "",
                    asked->grid ? ", a larger --grid" : "");
    return lpca;
}

/* Packs with as many components as the target needs, but at most the requested number. */
static struct lpca *pack(const struct lpca_codec_options *asked, const struct btf_matrix *btf,
                         struct lpca_options *options, struct codec_result *ret, GError **error) {
    const struct lpca_target target = {
        .error = asked->error, .bytes = asked->size, .n_components = asked->components};
    struct lpca *lpca = lpca_pack(btf, options, &target, error);
    if (lpca)
        ret->exact_error = ret->error = lpca->error;
    return lpca;
}

/* Adds the levels from 1 on to ret->levels. They have as many clusters and components as level 0,
 * but at most one cluster per texel. The checkpoint does not save them, because they take only
 * about a third of the work of level 0. */
static gboolean add_levels(const struct lpca_codec_options *asked, const struct btf_matrix *btf,
                           const struct lpca_options *options, struct codec_result *ret,
                           GError **error) {
    struct btf_matrix *half = btf_matrix_halved(btf);
    while (half && ret->levels->len < LPCA_MAX_LEVELS) {
        struct lpca_codec_options fixed = *asked;
        struct lpca_options now = *options;
        struct codec_result ignored = {0};
        fixed.clusters = now.n_clusters = MIN(ret->clusters, btf_layout_texels(&half->layout));
        now.n_components = ret->components;
        fixed.error = now.target = 0;
        now.checkpoint = NULL;
        struct lpca *lpca = rounded(&fixed, half, &now, &ignored, error);
        struct btf_matrix *next = lpca ? btf_matrix_halved(half) : NULL;
        btf_matrix_free(half);
        if (!lpca)
            return FALSE;
        g_ptr_array_add(ret->levels, lpca);
        half = next;
    }
    btf_matrix_free(half);
    return TRUE;
}

static void lpca_codec_free(gpointer model) {
    lpca_free(model);
}

/* Computes, packs or chooses a local PCA according to the options. Without --components, --error
 * and --size the local PCA has COMPONENTS components. The values of the BTF, if they are in memory,
 * count towards job->memory. */
static gboolean encode(const struct codec *codec G_GNUC_UNUSED, const struct codec_job *job,
                       struct codec_result *ret, GError **error) {
    const struct lpca_codec_options *asked = job->options;
    const struct btf_matrix *btf = job->btf;
    const int values = 3 * btf->layout.views.n * btf->layout.lights.n;
    const int most = asked->error > 0 || asked->size > 0 ? LPCA_MAX_COMPONENTS : COMPONENTS;
    struct lpca_options options = {
        .n_clusters =
            asked->clusters ? asked->clusters : (int)MIN(CLUSTERS, btf_layout_texels(&btf->layout)),
        .n_components = asked->components ? asked->components : MIN(most, values),
        .target = asked->error,
        .colours = (enum lpca_colours)asked->colours,
        .work = *job->work,
        .checkpoint = job->checkpoint,
    };
    if (job->memory > 0) {
        const gint64 held = btf->values ? btf_matrix_bytes(&btf->layout) : 0;
        options.memory = MAX(1, job->memory - held);
    }
    ret->packed = asked->quantise == LPCA_PACKED;
    ret->luminance_error = -1;
    struct lpca *lpca = (ret->packed ? pack : compute)(asked, btf, &options, ret, error);
    if (!lpca)
        return FALSE;
    ret->levels = g_ptr_array_new_with_free_func(lpca_codec_free);
    g_ptr_array_add(ret->levels, lpca);
    ret->clusters = lpca->n_clusters;
    ret->components = lpca->n_components;
    ret->grid = asked->grid;
    return !asked->mips || add_levels(asked, btf, &options, ret, error);
}

/* Returns a text such as "32 clusters of 8 components on a grid of 12, 6 mip levels". */
static char *describe(const struct codec *codec G_GNUC_UNUSED, const struct codec_result *result) {
    const int k = result->clusters, c = result->components;
    GString *text = g_string_new(NULL);
    g_string_append_printf(text, "%d %s of %d %s", k, k == 1 ? "cluster" : "clusters", c,
                           c == 1 ? "component" : "components");
    if (result->grid > 0)
        g_string_append_printf(text, " on a grid of %d", result->grid);
    if (result->levels->len > 1)
        g_string_append_printf(text, ", %u mip levels", result->levels->len);
    return g_string_free(text, FALSE);
}

static gboolean lpca_codec_write(const char *path, gpointer const *levels, int n_levels,
                                 GError **error) {
    return lpca_write_levels(path, (struct lpca *const *)levels, n_levels, error);
}

static gpointer lpca_codec_read(const char *path, GError **error) {
    return lpca_read(path, error);
}

/* Describes a file of which only the headers were read: size, clusters × components, directions and
 * error. */
static char *describe_file(const struct exr_file *file) {
    const struct exr_part *clusters = exr_file_part(file, "clusters");
    const struct exr_part *scales = exr_file_part(file, "scales");
    const struct exr_part *views = exr_file_part(file, "views");
    const struct exr_part *lights = exr_file_part(file, "lights");
    const char *quantise = "", *colours = "rgb";
    double error = 0;
    int grid = 0;
    if (!clusters || !scales || !views || !lights)
        return NULL;
    exr_get_string(clusters, "mesorig.quantise", &quantise, NULL);
    exr_get_string(clusters, "mesorig.colours", &colours, NULL);
    exr_get_double(clusters, "mesorig.error", &error, NULL);
    exr_get_int(clusters, "mesorig.grid", &grid, NULL);
    int levels = 1; /* level 0, and the levels with a part "mip<n>.clusters" */
    for (gboolean more = TRUE; more; levels += more) {
        g_autofree char *name = g_strdup_printf("mip%d.clusters", levels);
        more = exr_file_part(file, name) != NULL;
    }
    GString *text = g_string_new(NULL);
    g_string_append_printf(text, "local PCA: %d × %d texels, clusters × components %d × %d in %s, ",
                           clusters->width, clusters->height, scales->width, scales->height - 1,
                           quantise);
    if (grid > 0)
        g_string_append_printf(text, "on a grid of %d", grid);
    else
        g_string_append_printf(text, "of %d views × %d lights", views->width, lights->width);
    g_string_append_printf(text, "%s, mip levels: %d; error %.2f %% at the measured directions",
                           g_str_equal(colours, "log") ? ", in log-luminance" : "", levels,
                           100 * error);
    return g_string_free(text, FALSE);
}

static gint64 bytes(gconstpointer model) {
    return lpca_bytes(model);
}

static void reconstruct(gconstpointer model, int texel, float *ret) {
    lpca_reconstruct(model, texel, ret);
}

static int lpca_codec_grid(gconstpointer model) {
    return ((const struct lpca *)model)->n_grid;
}

static GPtrArray *read_levels(const char *path, GError **error) {
    struct lpca *levels[LPCA_MAX_LEVELS] = {NULL};
    const int n = lpca_read_levels(path, levels, error);
    GPtrArray *ret = n ? g_ptr_array_new_with_free_func(lpca_codec_free) : NULL;
    for (int i = 0; i < n; i++)
        g_ptr_array_add(ret, levels[i]);
    return ret;
}

/* Reports one point of the curve for each way to round the local PCA. */
static gboolean tell_quantised(const struct lpca *lpca, int components,
                               const struct btf_matrix *btf, CodecPoint tell, gpointer data,
                               GError **error) {
    static const enum lpca_quantise kinds[] = {LPCA_HALF, LPCA_8BIT, LPCA_8BIT_WEIGHTS};
    static const char *const series[] = {"local PCA, halves", "local PCA, 8 bits",
                                         "local PCA, 8-bit weights"};
    gboolean ok = TRUE;
    for (gsize i = 0; ok && i < G_N_ELEMENTS(kinds); i++) {
        g_autoptr(Lpca) fewer = lpca_truncated(lpca, components);
        lpca_quantise(fewer, kinds[i]);
        ok = tell(&lpca_codec,
                  &(struct codec_point){
                      .series = series[i],
                      .label = g_strdup_printf("%d × %d", fewer->n_clusters, components),
                      .bytes = lpca_bytes(fewer),
                      .error = lpca_error(fewer, btf, 0),
                      .model = fewer,
                  },
                  data, error);
    }
    return ok;
}

/* Reports the points of packed models, which are one local PCA rounded with steps from COARSEST to
 * FINEST. */
static gboolean curve_packed(const struct btf_matrix *btf, const struct work *work, CodecPoint tell,
                             gpointer data, GError **error) {
    const gint64 texels = btf_layout_texels(&btf->layout);
    const gint64 values = 3 * (gint64)btf->layout.views.n * btf->layout.lights.n;
    const struct lpca_options options = {
        .n_clusters = 1,
        .n_components = (int)MIN(LPCA_MAX_PACKED, MIN(texels, values)),
        .to_pack = TRUE,
        .work = *work,
    };
    struct lpca *exact = lpca_compute(btf, &options, error);
    if (!exact)
        return FALSE;
    struct lpca_packer *packer = lpca_packer_new(exact, 0);
    const double mean = lpca_mean_size(exact);
    gboolean ok = TRUE;
    for (double step = COARSEST; ok && step >= FINEST; step /= 2) {
        g_autoptr(Lpca) lpca = lpca_packer_round(packer, mean > 0 ? step * mean : 1);
        struct codec_point point = {
            .series = "local PCA, packed",
            .bytes = lpca_packed_bytes(lpca, error),
        };
        const int n = lpca->n_components;
        ok = point.bytes > 0 && lpca_error_shared(lpca, btf, &options, error);
        if (ok) {
            point.label = g_strdup_printf(n > 1 ? "%d components" : "%d component", n);
            point.error = lpca->error;
            point.model = lpca;
            ok = tell(&lpca_codec, &point, data, error);
        }
    }
    lpca_packer_free(packer);
    lpca_free(exact);
    return ok;
}

/* Encodes with 1, 4, 16 and 64 clusters of 1, 2, 4, 8 and 16 components each, quantised in each
 * way. Numbers of clusters above 1 that leave fewer than TEXELS_A_CLUSTER texels per cluster are
 * left out. Then encodes packed models. */
static gboolean curve(const struct codec *codec G_GNUC_UNUSED, const struct codec_job *job,
                      CodecPoint tell, gpointer data, GError **error) {
    const struct btf_matrix *btf = job->btf;
    const struct work *work = job->work;
    const int most = btf_layout_texels(&btf->layout) / TEXELS_A_CLUSTER;
    const int values = 3 * btf->layout.views.n * btf->layout.lights.n;
    gboolean ok = TRUE;
    for (int k = 1; ok && k <= CURVE_CLUSTERS && (k == 1 || k <= most); k *= 4) {
        const struct lpca_options options = {
            .n_clusters = k, .n_components = MIN(CURVE_MAX, values), .work = *work};
        g_autoptr(Lpca) lpca = lpca_compute(btf, &options, error);
        ok = lpca != NULL;
        for (int c = 1; ok && c <= lpca->n_components; c *= 2)
            ok = tell_quantised(lpca, c, btf, tell, data, error);
    }
    return ok && curve_packed(btf, work, tell, data, error);
}

const struct codec lpca_codec = {
    .name = "lpca",
    .title = "local PCA",
    .help = "local PCA of the BRDFs of all texels (Schneider 2004)",
    .options = lpca_codec_table,
    .options_size = sizeof(struct lpca_codec_options),
    .check = check,
    .bounded = TRUE,
    .resumable = TRUE,
    .encode = encode,
    .describe = describe,
    .write = lpca_codec_write,
    .read = lpca_codec_read,
    .describe_file = describe_file,
    .free = lpca_codec_free,
    .layout = G_STRUCT_OFFSET(struct lpca, layout),
    .bytes = bytes,
    .reconstruct = reconstruct,
    .evaluate = lpca_evaluate,
    .grid = lpca_codec_grid,
    .error = G_STRUCT_OFFSET(struct lpca, error),
    .read_levels = read_levels,
    .curve = curve,
};
