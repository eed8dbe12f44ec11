#include "compress.h"
#include "base/data_error.h"
#include "btf/btf_checkpoint.h"
#include "btf/direction_grid.h"

#include "base/file_lock.h"
#include "base/new_file.h"
#include "command/cli.h"
#include "command/work.h"
#include "eigenmaps/eigenmaps.h"
#include "exr/exr.h"
#include "lobes/lobes_levels.h"
#include "lpca/lpca.h"
#include "lpca/lpca_choose.h"
#include "lpca/lpca_levels.h"
#include "lpca/lpca_pack.h"
#include "lpca/lpca_resample.h"
#include "mdf_codecs/mdf_factors.h"
#include "plan/report.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>
#include <unistd.h>

#define CLUSTERS      32
#define COMPONENTS    8
#define MOST_ROUNDING 4 /* times that rounding may ask for another component */

/* How often rounding has asked for another error, and for which; it is kept as it is. */
struct rounding {
    gint64 times;
    double target;
};

struct compress {
    const char *path;
    gboolean eigenmaps, lobes;
    enum lobes_model model;   /* of lobes */
    int clusters, components; /* 0: not asked for */
    double target;            /* 0: none */
    enum lpca_quantise quantise;
    enum lpca_colours colours;
    int grid;      /* 0: measured directions */
    gint64 size;   /* 0: any */
    gint64 memory; /* 0: any */
    gboolean mips;
    const char *output;  /* NULL: products/lpca.exr */
    const char *made_by; /* what session_add_product_file() is told */
    Checkpoint *checkpoint;
    struct rounding rounding;
    /* found */
    char *written;
    int texels, views, lights, used_clusters, used_components, levels;
    gint64 holes, bounds, raw_bytes, bytes, file_bytes;
    double exact_error, error, luminance_error;
};

static gboolean cli_compress_check_output(const char *output, GError **error) {
    g_autofree char *folder = g_path_get_dirname(output);
    if (g_access(folder, W_OK) == 0)
        return TRUE;
    g_set_error(error, EXR_ERROR, EXR_ERROR_IO, "%s: files cannot be written into that folder",
                folder);
    return FALSE;
}

static struct lpca *compute_exact(const struct compress *compress, const struct btf_matrix *btf,
                                  const struct lpca_options *options, GError **error) {
    const struct lpca_wish wish = {options->target, compress->size, options->n_components,
                                   compress->quantise, compress->grid};
    if (compress->clusters == 0 && (compress->size > 0 || compress->target > 0))
        return lpca_choose(btf, options, &wish, error);
    return lpca_compute(btf, options, error);
}

/* Put on a grid, if asked for, and rounded; its errors before and after. */
static struct lpca *compute_rounded(struct compress *compress, const struct btf_matrix *btf,
                                    const struct lpca_options *options, GError **error) {
    struct lpca *lpca = compute_exact(compress, btf, options, error);
    if (!lpca)
        return NULL;
    compress->exact_error = lpca->error;
    if (compress->grid > 0) {
        struct lpca *resampled = lpca_resample(lpca, compress->grid, error);
        lpca_free(lpca);
        lpca = resampled;
    }
    if (!lpca)
        return NULL;
    lpca_quantise(lpca, compress->quantise);
    compress->error =
        compress->grid > 0 ? lpca_resample_error(lpca, btf, 0) : lpca_error(lpca, btf, 0);
    return lpca;
}

/* What rounding adds (errors add in squares) is taken off the error that is to be reached. */
static struct lpca *cli_compress_compute(struct compress *compress, const struct btf_matrix *btf,
                                         struct lpca_options *options, GError **error) {
    struct rounding *rounding = &compress->rounding;
    const struct rounding *found = checkpoint_get(compress->checkpoint, "rounding", sizeof *found);
    *rounding = found ? *found : (struct rounding){0, options->target};
    checkpoint_keep(compress->checkpoint, "rounding", rounding, sizeof *rounding);
    for (; rounding->times < MOST_ROUNDING; rounding->times++) {
        options->target = rounding->target;
        struct lpca *lpca = compute_rounded(compress, btf, options, error);
        if (!lpca || compress->target <= 0 || compress->error <= compress->target)
            return lpca;
        lpca_free(lpca);
        const double added =
            compress->error * compress->error - compress->exact_error * compress->exact_error;
        const double left = compress->target * compress->target - added;
        if (left <= 0)
            break;
        rounding->target = MIN(sqrt(left), compress->exact_error) * (1 - 1e-6);
    }
    g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                "an error of %.3g %% is not reached: rounding%s makes %.3g %% of %.3g %%; quantise "
                "less or use more clusters",
                100 * compress->target, compress->grid ? " and the grid" : "",
                100 * compress->error, 100 * compress->exact_error);
    return NULL;
}

static const char *method_name(const struct compress *compress) {
    return compress->lobes       ? lobes_model_name(compress->model)
           : compress->eigenmaps ? "eigenmaps"
                                 : "lpca";
}

/* Of as many components as it takes, at most those that were asked for. */
static struct lpca *compute_packed(struct compress *compress, const struct btf_matrix *btf,
                                   struct lpca_options *options, GError **error) {
    const struct lpca_wish wish = {
        .error = compress->target, .bytes = compress->size, .n_components = compress->components};
    struct lpca *lpca = lpca_pack(btf, options, &wish, error);
    if (lpca)
        compress->exact_error = compress->error = lpca->error;
    return lpca;
}

/* Levels 1 and on, of as many clusters and components as level 0 if there are so many texels. */
static gboolean add_levels(struct compress *compress, const struct btf_matrix *btf,
                           const struct lpca_options *options, GPtrArray *levels, GError **error) {
    struct btf_matrix *half = btf_matrix_halved(btf);
    while (half && levels->len < LPCA_MAX_LEVELS) {
        struct compress fixed = *compress;
        struct lpca_options now = *options;
        fixed.clusters = now.n_clusters = MIN(compress->used_clusters, half->width * half->height);
        now.n_components = compress->used_components;
        fixed.target = now.target = 0;
        now.checkpoint = NULL; /* a third of the work in all */
        struct lpca *lpca = compute_rounded(&fixed, half, &now, error);
        struct btf_matrix *next = lpca ? btf_matrix_halved(half) : NULL;
        btf_matrix_free(half);
        if (!lpca)
            return FALSE;
        compress->bytes += lpca_bytes(lpca);
        g_ptr_array_add(levels, lpca);
        half = next;
    }
    btf_matrix_free(half);
    return TRUE;
}

static gboolean make_lpca(struct compress *compress, const struct btf_matrix *btf,
                          const struct work *work, GError **error) {
    struct lpca_options options = {
        .n_clusters = compress->clusters ? compress->clusters : MIN(CLUSTERS, compress->texels),
        .n_components = compress->components ? compress->components
                        : compress->target > 0 || compress->size > 0
                            ? MIN(LPCA_MAX_COMPONENTS, 3 * btf->n_views * btf->n_lights)
                            : MIN(COMPONENTS, 3 * btf->n_views * btf->n_lights),
        .target = compress->target,
        .colours = compress->colours,
        .work = *work,
        .checkpoint = compress->checkpoint,
    };
    if (compress->memory > 0) {
        const gint64 values =
            btf->values ? btf_matrix_bytes(btf->width, btf->height, btf->n_views, btf->n_lights)
                        : 0;
        options.memory = MAX(1, compress->memory - values);
    }
    struct lpca *lpca = (compress->quantise == LPCA_PACKED ? compute_packed : cli_compress_compute)(
        compress, btf, &options, error);
    if (!lpca)
        return FALSE;
    compress->used_clusters = lpca->n_clusters;
    compress->used_components = lpca->n_components;
    compress->bytes = lpca_bytes(lpca);
    g_autoptr(GPtrArray) levels = g_ptr_array_new_with_free_func((GDestroyNotify)lpca_free);
    g_ptr_array_add(levels, lpca);
    if (compress->mips && !add_levels(compress, btf, &options, levels, error))
        return FALSE;
    compress->levels = (int)levels->len;
    return lpca_write_levels(compress->written, (struct lpca *const *)(gpointer)levels->pdata,
                             compress->levels, error) &&
           session_add_product_file(compress->written, compress->made_by, error);
}

/* Memory for columns is what maps leave. */
static gboolean eigenmaps_memory(const struct compress *compress, const struct btf_matrix *btf,
                                 int terms, gsize *ret, GError **error) {
    const gint64 column = btf_matrix_bytes(btf->width, btf->height, 1, btf->n_lights);
    const gint64 left = compress->memory - column * (compress->target > 0 ? 1 : terms);
    *ret = (gsize)MAX(left, 0);
    if (compress->memory == 0 || left >= column)
        return TRUE;
    g_autofree char *size = g_format_size((guint64)column);
    g_autofree char *given = g_format_size((guint64)compress->memory);
    g_set_error(
        error, DATA_ERROR, DATA_ERROR_INVALID,
        "%d eigen-maps of %d × %d texels and %d lights take %s of memory each, and one view "
        "as much, which is more than %s; allow more",
        terms, btf->width, btf->height, btf->n_lights, size, given);
    return FALSE;
}

static gboolean cli_compress_make_eigenmaps(struct compress *compress, const struct btf_matrix *btf,
                                            const struct work *work, GError **error) {
    const int terms = compress->components   ? compress->components
                      : compress->target > 0 ? btf->n_views
                                             : MIN(4, btf->n_views);
    struct eigenmaps_options options = {.target = compress->target};
    if (!eigenmaps_memory(compress, btf, terms, &options.memory, error))
        return FALSE;
    struct eigenmaps *maps =
        compress_eigenmaps(btf, terms, &options, work, &compress->error, error);
    if (!maps)
        return FALSE;
    compress->exact_error = compress->error;
    compress->used_components = maps->n_terms;
    compress->bytes = (gint64)maps->n_terms * (2 * 3 * (gint64)compress->texels * btf->n_lights +
                                               (gint64)sizeof(float) * btf->n_views);
    const gboolean ok = eigenmaps_write(compress->written, maps, error) &&
                        session_add_product_file(compress->written, compress->made_by, error);
    eigenmaps_free(maps);
    return ok;
}

/* Level 0 as the errors have it, and the bytes of all. */
static gboolean note_lobes(struct compress *compress, struct lobes *const *levels, int n,
                           GError **error) {
    const struct lobes *lobes = levels[0];
    compress->levels = n;
    compress->used_components = lobes->n_lobes;
    compress->exact_error = lobes->exact_error;
    compress->error = lobes->error;
    compress->luminance_error = lobes->luminance_error;
    for (int level = 0; level < n; level++)
        compress->bytes += lobes_bytes(levels[level]);
    if (compress->target <= 0 || lobes->error <= compress->target)
        return TRUE;
    g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                "an error of %.3g %% is not reached by %s (%.3g %%); use lpca",
                100 * compress->target, lobes_model_name(compress->model), 100 * lobes->error);
    return FALSE;
}

/* What lobes need is few numbers: with -c as many a texel as are asked for. */
static gboolean make_lobes(struct compress *compress, const struct btf_matrix *btf,
                           const struct work *work, GError **error) {
    const struct lobes_options options = {.model = compress->model,
                                          .n_lobes = compress->components,
                                          .checkpoint = compress->checkpoint,
                                          .work = *work};
    struct lobes *levels[LOBES_MAX_LEVELS] = {NULL};
    int n;
    if (compress->mips)
        n = lobes_compute_levels(btf, &options, levels, error);
    else
        n = (levels[0] = lobes_compute(btf, &options, error)) != NULL;
    const gboolean ok = n > 0 && note_lobes(compress, levels, n, error) &&
                        lobes_write_levels(compress->written, levels, n, error) &&
                        session_add_product_file(compress->written, compress->made_by, error);
    for (int level = 0; level < n; level++)
        lobes_free(levels[level]);
    return ok;
}

/* Everything that the result depends on beside the BTF. */
static void begin_checkpoint(struct compress *compress, const struct btf_matrix *btf) {
    g_autofree char *path = g_strconcat(compress->written, ".checkpoint", NULL);
    g_autofree char *what =
        g_strdup_printf("%s %d × %d, error %.17g, %s, colours %d, grid %d, %" G_GINT64_FORMAT
                        " bytes in %" G_GINT64_FORMAT,
                        method_name(compress), compress->clusters, compress->components,
                        compress->target, lpca_quantise_name(compress->quantise), compress->colours,
                        compress->grid, compress->size, compress->memory);
    compress->checkpoint = checkpoint_new(path);
    btf_checkpoint_begin(compress->checkpoint, btf, what);
    if (checkpoint_note(compress->checkpoint))
        g_printerr("%s\n", checkpoint_note(compress->checkpoint));
}

static gboolean compress_btf(struct compress *compress, const struct work *work, GError **error) {
    /* What is left of the limit is for the work. */
    struct btf_matrix *btf =
        btf_matrix_read_within(compress->memory / 2, compress->path, work, error);
    if (!btf)
        return FALSE;
    compress->texels = btf->width * btf->height;
    compress->views = btf->n_views;
    compress->lights = btf->n_lights;
    compress->holes = btf->holes;
    compress->bounds = btf->bounds;
    compress->raw_bytes = (gint64)compress->texels * btf->n_views * btf->n_lights * 3 * 2;
    begin_checkpoint(compress, btf);
    const gboolean ok = (compress->lobes       ? make_lobes
                         : compress->eigenmaps ? cli_compress_make_eigenmaps
                                               : make_lpca)(compress, btf, work, error);
    if (ok)
        checkpoint_remove(compress->checkpoint);
    else if (!g_cancellable_is_cancelled(work->cancellable))
        checkpoint_discard(compress->checkpoint);
    else if (!compress->eigenmaps)
        g_prefix_error(error, "%s.checkpoint keeps what is done: ", compress->written);
    g_clear_pointer(&compress->checkpoint, checkpoint_free);
    btf_matrix_free(btf);
    GStatBuf status;
    if (ok && g_stat(compress->written, &status) == 0)
        compress->file_bytes = status.st_size;
    return ok;
}

/* Where to, if that can be written. */
static char *cli_compress_place(const struct compress *compress, GError **error) {
    if (compress->output)
        return cli_compress_check_output(compress->output, error) ? g_strdup(compress->output)
                                                                  : NULL;
    g_autofree char *directory = btf_matrix_session(compress->path);
    g_autofree char *name = g_strdup_printf("%s.exr", method_name(compress));
    g_autoptr(Session) session = session_open(directory, SESSION_PRODUCTS, error);
    return session ? g_build_filename(directory, "products", name, NULL) : NULL;
}

int compress_lock(const char *path, char **ret_lock, GError **error) {
    g_autofree char *folder = g_path_get_dirname(path), *name = g_path_get_basename(path);
    g_autofree char *prefix = g_strconcat(name, ".", NULL);
    *ret_lock = g_strconcat(path, ".lock", NULL);
    const int lock = file_lock_take(*ret_lock, path, error);
    if (lock >= 0)
        new_file_remove_left(folder, "", prefix);
    return lock;
}

static gboolean cli_compress_work(const struct work *work, gpointer data, GError **error) {
    struct compress *compress = data;
    g_autofree char *lock_path = NULL;
    compress->written = cli_compress_place(compress, error);
    const int lock = compress->written ? compress_lock(compress->written, &lock_path, error) : -1;
    const gboolean ok = lock >= 0 && compress_btf(compress, work, error);
    file_lock_give(lock, lock_path);
    return ok;
}

static void cli_compress_tell_json(const struct compress *compress, double seconds) {
    GVariantBuilder builder;
    g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
    const struct {
        const char *name;
        gint64 value;
    } numbers[] = {
        {"texels", compress->texels},
        {"views", compress->views},
        {"lights", compress->lights},
        {"clusters", compress->used_clusters},
        {"components", compress->used_components},
        {"grid", compress->grid},
        {"levels", compress->levels},
        {"holes", compress->holes},
        {"lower_bounds", compress->bounds},
        {"btf_bytes", compress->raw_bytes},
        {"bytes", compress->bytes},
        {"file_bytes", compress->file_bytes},
    };
    g_variant_builder_add(&builder, "{sv}", "file", g_variant_new_string(compress->written));
    g_variant_builder_add(&builder, "{sv}", "method", g_variant_new_string(method_name(compress)));
    for (gsize i = 0; i < G_N_ELEMENTS(numbers); i++)
        g_variant_builder_add(&builder, "{sv}", numbers[i].name,
                              g_variant_new_int64(numbers[i].value));
    g_variant_builder_add(&builder, "{sv}", "exact_error",
                          g_variant_new_double(compress->exact_error));
    g_variant_builder_add(&builder, "{sv}", "error", g_variant_new_double(compress->error));
    if (compress->lobes)
        g_variant_builder_add(&builder, "{sv}", "luminance_error",
                              g_variant_new_double(compress->luminance_error));
    g_variant_builder_add(&builder, "{sv}", "real_s", g_variant_new_double(seconds));
    cli_print_json(g_variant_builder_end(&builder));
}

static char *cli_compress_describe(const struct compress *compress) {
    if (compress->eigenmaps)
        return g_strdup_printf("%d eigen-maps", compress->used_components);
    g_autofree char *levels =
        compress->levels > 1 ? g_strdup_printf(", %d mip levels", compress->levels) : g_strdup("");
    if (!compress->lobes) {
        const int k = compress->used_clusters, c = compress->used_components;
        g_autofree char *grid =
            compress->grid ? g_strdup_printf(" on a grid of %d", compress->grid) : g_strdup("");
        return g_strdup_printf("%d %s of %d %s%s%s", k, k == 1 ? "cluster" : "clusters", c,
                               c == 1 ? "component" : "components", grid, levels);
    }
    if (compress->used_components == 0)
        return g_strdup_printf("%s%s, luminance off by %.4f on average",
                               lobes_model_name(compress->model), levels,
                               compress->luminance_error);
    return g_strdup_printf("%s of %d %s%s, luminance off by %.4f on average",
                           lobes_model_name(compress->model), compress->used_components,
                           compress->used_components == 1 ? "lobe" : "lobes", levels,
                           compress->luminance_error);
}

static void cli_compress_tell(const struct compress *compress, double seconds) {
    if (cli_json) {
        cli_compress_tell_json(compress, seconds);
        return;
    }
    g_autofree char *time = report_duration(seconds);
    g_autofree char *what = cli_compress_describe(compress);
    g_autofree char *size = g_format_size((guint64)compress->bytes);
    g_autofree char *file = g_format_size((guint64)compress->file_bytes);
    if (compress->quantise == LPCA_PACKED)
        g_print("%s: done in %s: %s, error %.2f %%, %s on disk, 1:%.3g of the BTF in half floats; "
                "%s unpacked\n",
                compress->written, time, what, 100 * compress->error, file,
                (double)compress->raw_bytes / (double)compress->file_bytes, size);
    else
        g_print("%s: done in %s: %s, error %.2f %% (%.2f %% before %srounding), %s, 1:%.3g of the "
                "BTF in half floats; %s on disk\n",
                compress->written, time, what, 100 * compress->error, 100 * compress->exact_error,
                compress->grid ? "the grid and " : "", size,
                (double)compress->raw_bytes / (double)compress->bytes, file);
    if (compress->holes > 0)
        g_print("%" G_GINT64_FORMAT " of %" G_GINT64_FORMAT
                " values of the BTF are holes and were filled from what is around them\n",
                compress->holes, compress->raw_bytes / 6);
    if (compress->bounds > 0)
        g_print("%" G_GINT64_FORMAT " are lower bounds, since the camera was saturated, and were "
                "taken as they are\n",
                compress->bounds);
}

static char *method_option, *error_option, *size_option, *quantise_option, *output_option,
    *colours_option, *memory_option;
static int clusters_option, components_option, grid_option;
static gboolean mips_option;
static const GOptionEntry entries[] = {
    {"method", 'm', 0, G_OPTION_ARG_STRING, &method_option,
     "Local PCA (the default); eigen-maps, which need -o; a model fitted to each texel; or the "
     "distances (MDF), which need -o: as few maps, or each view",
     "lpca|eigenmaps|fields|ptm|lafortune|ward|ashikhmin|mdf|mdf-views"},
    {"model", 0, 0, G_OPTION_ARG_STRING, &method_option, "The same as --method", "METHOD"},
    {"clusters", 'k', 0, G_OPTION_ARG_INT, &clusters_option,
     "Clusters of texels: 1 … 1024, 32 if not given", "K"},
    {"components", 'c', 0, G_OPTION_ARG_INT, &components_option,
     "Eigen-BRDFs of a cluster: 1 … 64, 8 if not given; eigen-maps: 4; maps of an mdf: 1 … 32, 8; "
     "with --error at most; lobes of fields and lafortune: 1 … 3, 2 if not given",
     "C"},
    {"error", 'e', 0, G_OPTION_ARG_STRING, &error_option,
     "As small as reaches this error of the whole: components, and clusters unless -k says them; "
     "of an mdf in texels",
     "2%"},
    {"size", 's', 0, G_OPTION_ARG_STRING, &size_option,
     "The best clusters and components that take no more than this", "20MB"},
    {"mips", 0, 0, G_OPTION_ARG_NONE, &mips_option,
     "Mip levels too, each compressed anew; of local PCAs and models of a texel", NULL},
    {"grid", 'g', 0, G_OPTION_ARG_INT, &grid_option,
     "Eigen-BRDFs on a grid of directions with so many samples each way: 4 … 24, 12 is good", "N"},
    {"quantise", 'q', 0, G_OPTION_ARG_STRING, &quantise_option,
     "Numbers in the file; half if not given; 8bit is of eigen-BRDFs alone; packed, with --error "
     "or --size, is smallest, and unpacked to be drawn; mdf-views: half, 8bit, 4bit (default)",
     "float|half|8bit|8bit-weights|packed|4bit"},
    {"colours", 0, 0, G_OPTION_ARG_STRING, &colours_option,
     "What is compressed: colours as they are, or the logarithm of luminance and chroma",
     "rgb|log"},
    {"memory", 0, 0, G_OPTION_ARG_STRING, &memory_option,
     "Take no more than this: a BTF that is larger stays in a temporary file", "512MB"},
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output_option,
     "Write this file, not products/lpca.exr of the session", "FILE"},
    {NULL},
};

static gboolean parse_error(const char *text, double *ret) {
    char *end;
    *ret = g_ascii_strtod(text, &end);
    if (*end == '%') {
        *ret /= 100;
        end++;
    }
    return end != text && *end == '\0' && *ret > 0 && *ret < 1;
}

/* Thousands, as g_format_size() prints them. */
static gboolean cli_compress_parse_size(const char *text, gint64 *ret) {
    static const char *const units[] = {"", "B", "kB", "KB", "MB", "GB"};
    static const double factors[] = {1, 1, 1e3, 1e3, 1e6, 1e9};
    char *end;
    const double value = g_ascii_strtod(text, &end);
    while (*end == ' ')
        end++;
    for (gsize i = 0; end != text && i < G_N_ELEMENTS(units); i++)
        if (g_str_equal(end, units[i]) && value * factors[i] >= 1 && value * factors[i] < 1e15) {
            *ret = (gint64)(value * factors[i]);
            return TRUE;
        }
    return FALSE;
}

/* The options that were given, in words that the same command understands. */
static char *arguments(void) {
    g_autofree char *output = output_option ? cli_absolute(output_option) : NULL;
    const struct {
        const char *name, *value;
    } texts[] = {{"method", method_option},   {"error", error_option},
                 {"size", size_option},       {"quantise", quantise_option},
                 {"colours", colours_option}, {"memory", memory_option},
                 {"output", output}};
    const struct {
        const char *name;
        int value;
    } numbers[] = {
        {"clusters", clusters_option}, {"components", components_option}, {"grid", grid_option}};
    GString *text = g_string_new("compress ");
    for (gsize i = 0; i < G_N_ELEMENTS(texts); i++) {
        g_autofree char *quoted = texts[i].value ? g_shell_quote(texts[i].value) : NULL;
        if (quoted)
            g_string_append_printf(text, "--%s=%s ", texts[i].name, quoted);
    }
    for (gsize i = 0; i < G_N_ELEMENTS(numbers); i++)
        if (numbers[i].value > 0)
            g_string_append_printf(text, "--%s=%d ", numbers[i].name, numbers[i].value);
    g_string_append(text, mips_option ? "--mips" : "");
    return g_strchomp(g_string_free(text, FALSE));
}

static int run_mdf(const struct command *command, const char *path, gboolean views) {
    static const char *const kinds[] = {"", "half", "8bit", "4bit"};
    g_autofree char *made_by = arguments();
    struct compress_mdf mdf = {.path = path, .output = output_option, .made_by = made_by};
    if (!output_option || clusters_option >= 0 || size_option || mips_option || grid_option ||
        colours_option || memory_option)
        return cli_usage(command, "of an MDF -c, --error or -q are asked, and -o FILE is needed");
    if (views ? components_option >= 0 || error_option : quantise_option != NULL)
        return cli_usage(command, "-c and --error are of mdf, which is in 8 bit; -q of mdf-views");
    if (components_option == 0 || components_option < -1 ||
        components_option > MDF_FACTORS_MAX_TERMS)
        return cli_usage(command, "an MDF has 1 to 32 maps");
    if (error_option && !parse_error(error_option, &mdf.target))
        return cli_usage(command, "--error is a share of a texel, like 5%% or 0.05");
    mdf.kind = views ? COMPRESS_MDF_4BIT : COMPRESS_MDF_MAPS;
    if (quantise_option) {
        mdf.kind = COMPRESS_MDF_HALF;
        while (mdf.kind <= COMPRESS_MDF_4BIT && strcmp(quantise_option, kinds[mdf.kind]) != 0)
            mdf.kind++;
    }
    if (mdf.kind > COMPRESS_MDF_4BIT)
        return cli_usage(command, "--quantise of mdf-views is half, 8bit or 4bit");
    mdf.terms = MAX(components_option, 0);
    return compress_mdf(&mdf);
}

static gboolean packed_makes_sense(const struct command *command, const struct compress *compress) {
    const char *what = NULL;
    if ((compress->target > 0) == (compress->size > 0))
        what = "--quantise=packed needs either --error or --size";
    else if (clusters_option > 0 || compress->grid > 0 || compress->mips ||
             compress->colours == LPCA_LOG)
        what = "--quantise=packed has one cluster, no grid, no mip levels, and colours as they are";
    if (what)
        cli_usage(command, "%s", what);
    return what == NULL;
}

static int cli_compress_run(const struct command *command, int argc, char **argv) {
    struct compress compress = {.quantise = LPCA_HALF};
    g_autoptr(GError) error = NULL;
    double seconds = 0;
    clusters_option = components_option = -1;
    grid_option = 0;
    if (!cli_parse(command, entries, FALSE, &argc, &argv, 1, 1))
        return CLI_USAGE;
    const gboolean views = g_strcmp0(method_option, "mdf-views") == 0;
    if (views || g_strcmp0(method_option, "mdf") == 0)
        return run_mdf(command, argv[1], views);
    compress.eigenmaps = g_strcmp0(method_option, "eigenmaps") == 0;
    compress.lobes = lobes_model_parse(method_option, &compress.model);
    if (method_option && !compress.eigenmaps && !compress.lobes &&
        strcmp(method_option, "lpca") != 0)
        return cli_usage(command, "--method is lpca, eigenmaps, fields, ptm, lafortune, ward, "
                                  "ashikhmin, mdf or mdf-views");
    if (compress.lobes && (clusters_option > 0 || quantise_option))
        return cli_usage(command, "models of a texel are half floats without clusters");
    if (clusters_option == 0 || clusters_option < -1 || components_option == 0 ||
        components_option < -1)
        return cli_usage(command, "there is at least one cluster and one component");
    if (error_option && !parse_error(error_option, &compress.target))
        return cli_usage(command, "--error is a number like 2%% or 0.02");
    if (size_option && !cli_compress_parse_size(size_option, &compress.size))
        return cli_usage(command, "--size is a number like 20MB or 500kB");
    if (memory_option && !cli_compress_parse_size(memory_option, &compress.memory))
        return cli_usage(command, "--memory is a number like 512MB or 2GB");
    if (colours_option && strcmp(colours_option, "rgb") != 0 && strcmp(colours_option, "log") != 0)
        return cli_usage(command, "--colours is rgb or log");
    compress.colours = g_strcmp0(colours_option, "log") == 0 ? LPCA_LOG : LPCA_RGB;
    if (compress.size > 0 && clusters_option > 0)
        return cli_usage(command, "--size chooses the clusters: leave out -k");
    if (grid_option != 0 && (grid_option < DIRECTION_GRID_MIN || grid_option > DIRECTION_GRID_MAX))
        return cli_usage(command, "--grid is 4 to 24");
    if ((compress.lobes || compress.eigenmaps) &&
        (compress.size > 0 || grid_option > 0 || colours_option))
        return cli_usage(command, "--size, --grid and --colours are for local PCAs");
    if (compress.lobes && memory_option)
        return cli_usage(command, "--memory is for local PCAs and eigen-maps");
    if (compress.eigenmaps && mips_option)
        return cli_usage(command, "eigen-maps are linear: their mip levels are made to be drawn");
    if (compress.colours == LPCA_LOG && grid_option > 0)
        return cli_usage(command, "--grid is of colours as they are: leave out --colours=log");
    if (compress.memory > 0 && mips_option)
        return cli_usage(command, "--mips takes the whole BTF into memory: leave out --memory");
    compress.grid = grid_option;
    compress.mips = mips_option;
    if (quantise_option && !lpca_quantise_parse(quantise_option, &compress.quantise))
        return cli_usage(command, "--quantise is float, half, 8bit, 8bit-weights or packed");
    if (compress.quantise == LPCA_PACKED && !packed_makes_sense(command, &compress))
        return CLI_USAGE;
    if (compress.eigenmaps && (clusters_option > 0 || quantise_option || !output_option))
        return cli_usage(command, "eigen-maps are half floats without clusters, and need -o FILE");
    compress.path = argv[1];
    compress.clusters = MAX(clusters_option, 0);
    compress.components = MAX(components_option, 0);
    compress.output = output_option;
    g_autofree char *made_by = arguments();
    compress.made_by = made_by;
    const gboolean ok = cli_work_run(cli_compress_work, &compress, &seconds, &error);
    if (ok)
        cli_compress_tell(&compress, seconds);
    g_free(compress.written);
    return ok ? CLI_DONE : cli_fail(error);
}

const struct command cli_compress = {.name = "compress",
                                     .arguments = "DIR",
                                     .help = "Compress the BTF of a session, or its MDF.",
                                     .run_arguments = cli_compress_run};
