#include "lobes_codec.h"

#include "base/data_error.h"
#include "codecs/codec/texel_model.h"
#include "lobes_levels.h"
#include "lobes_private.h"

struct lobes_codec_options {
    int components;
    double error;
    gboolean mips;
};

static const struct option lobes_codec_table[] = {
    {.name = "components",
     .type = OPTION_INT,
     .min = 1,
     .max = G_MAXDOUBLE,
     .offset = offsetof(struct lobes_codec_options, components),
     .help = "number of lobes of each texel for fields and lafortune: 1 to 3 (2 if not given)"},
    {.name = "error",
     .type = OPTION_SHARE,
     .offset = offsetof(struct lobes_codec_options, error),
     .help = "fail if the error of the whole BTF is larger"},
    {.name = "mips",
     .type = OPTION_BOOL,
     .offset = offsetof(struct lobes_codec_options, mips),
     .help = "also write mip levels, each fitted separately"},
    {NULL},
};

static gboolean check_error(const struct lobes *lobes, double target, GError **error) {
    if (target <= 0 || lobes->error <= target)
        return TRUE;
    g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                "an error of %.3g %% is not reached: %s has an error of %.3g %%; allow a larger "
                "error or use --method=lpca",
                100 * target, lobes_model_name(lobes->model), 100 * lobes->error);
    return FALSE;
}

static gboolean encode(const struct codec *codec, const struct codec_job *job,
                       struct codec_result *ret, GError **error) {
    const struct lobes_codec_options *asked = job->options;
    const struct lobes_options options = {.model = (enum lobes_model)codec->variant,
                                          .n_lobes = asked->components,
                                          .checkpoint = job->checkpoint,
                                          .work = *job->work};
    struct lobes *levels[LOBES_MAX_LEVELS] = {NULL};
    int n;
    if (asked->mips)
        n = lobes_compute_levels(job->btf, &options, levels, error);
    else
        n = (levels[0] = lobes_compute(job->btf, &options, error)) != NULL;
    if (n == 0)
        return FALSE;
    ret->levels = g_ptr_array_new_with_free_func((GDestroyNotify)lobes_free);
    for (int level = 0; level < n; level++)
        g_ptr_array_add(ret->levels, levels[level]);
    ret->components = levels[0]->n_lobes;
    ret->exact_error = levels[0]->exact_error;
    ret->error = levels[0]->error;
    ret->luminance_error = levels[0]->luminance_error;
    return check_error(levels[0], asked->error, error);
}

static char *describe(const struct codec *codec, const struct codec_result *result) {
    GString *text = g_string_new(codec->name);
    const int k = result->components;
    if (k > 0)
        g_string_append_printf(text, k == 1 ? " of %d lobe" : " of %d lobes", k);
    if (result->levels->len > 1)
        g_string_append_printf(text, ", %u mip levels", result->levels->len);
    g_string_append_printf(text, ", luminance off by %.4f on average", result->luminance_error);
    return g_string_free(text, FALSE);
}

static gboolean lobes_codec_write(const char *path, gpointer const *levels, int n_levels,
                                  GError **error) {
    return lobes_write_levels(path, (struct lobes *const *)levels, n_levels, error);
}

static gpointer lobes_codec_read(const char *path, GError **error) {
    return lobes_read(path, error);
}

static char *describe_file(const struct exr_file *file) {
    g_autofree char *rest = texel_model_describe_file(file);
    const char *kind = texel_model_kind(file);
    int lobes = 0;
    if (!rest)
        return NULL;
    exr_get_int(file->parts->pdata[0], "mesorig.lobes", &lobes, NULL);
    g_autofree char *of = lobes == 0
                              ? g_strdup("")
                              : g_strdup_printf(lobes == 1 ? " of %d lobe" : " of %d lobes", lobes);
    return g_strdup_printf("%s%s: %s", kind ? kind : "", of, rest);
}

static gint64 bytes(gconstpointer model) {
    return lobes_bytes(model);
}

static void reconstruct(gconstpointer model, int texel, float *ret) {
    lobes_reconstruct(model, texel, ret);
}

/* Adds the value of the formula, at least 0, of each texel, times its share. For a model of single
 * views this value is Σ_a g_a max(0, Y_a), where g_a are the weights of the query's views. */
static void evaluate(gconstpointer model, const struct codec_query *query,
                     const struct codec_texels *texels, float ret[3]) {
    const struct lobes *lobes = model;
    const gboolean sliced = lobes_traits[lobes->model].each_view;
    for (int k = 0; k < texels->n; k++)
        for (int a = 0; a < (sliced ? query->n_views : 1); a++) {
            const float share = texels->share[k] * (sliced ? query->view_weights[a] : 1);
            float rgb[3];
            lobes_evaluate(lobes, sliced ? query->views[a] : 0, texels->index[k], query->view,
                           query->light, rgb);
            for (int c = 0; c < 3; c++)
                ret[c] += share * MAX(rgb[c], 0);
        }
}

static GPtrArray *read_levels(const char *path, GError **error) {
    struct lobes *levels[LOBES_MAX_LEVELS] = {NULL};
    const int n = lobes_read_levels(path, levels, error);
    GPtrArray *ret = n ? g_ptr_array_new_with_free_func((GDestroyNotify)lobes_free) : NULL;
    for (int i = 0; i < n; i++)
        g_ptr_array_add(ret, levels[i]);
    return ret;
}

static gboolean curve(const struct codec *codec, const struct codec_job *job, CodecPoint tell,
                      gpointer data, GError **error) {
    const struct btf_matrix *btf = job->btf;
    const struct work *work = job->work;
    const enum lobes_model model = (enum lobes_model)codec->variant;
    const int most = lobes_traits[model].lobed ? LOBES_MAX_LOBES : 1;
    gboolean ok = TRUE;
    for (int k = 1; ok && k <= most; k++) {
        const struct lobes_options options = {.model = model, .n_lobes = k, .work = *work};
        struct lobes *lobes = lobes_compute(btf, &options, error);
        ok = lobes &&
             tell(codec,
                  &(struct codec_point){
                      .series = codec->title,
                      .label = most == 1 ? g_strdup("")
                                         : g_strdup_printf(k > 1 ? "%d lobes" : "%d lobe", k),
                      .bytes = lobes_bytes(lobes),
                      .error = lobes->error,
                      .model = lobes,
                  },
                  data, error);
        lobes_free(lobes);
    }
    return ok;
}

#define LOBES_CODEC(MODEL, NAME, TITLE, HELP)                                                      \
    [MODEL] = {                                                                                    \
        .name = (NAME),                                                                            \
        .title = (TITLE),                                                                          \
        .help = (HELP),                                                                            \
        .variant = (MODEL),                                                                        \
        .options = lobes_codec_table,                                                              \
        .options_size = sizeof(struct lobes_codec_options),                                        \
        .resumable = TRUE,                                                                         \
        .encode = encode,                                                                          \
        .describe = describe,                                                                      \
        .write = lobes_codec_write,                                                                \
        .read = lobes_codec_read,                                                                  \
        .describe_file = describe_file,                                                            \
        .free = (GDestroyNotify)lobes_free,                                                        \
        .layout = G_STRUCT_OFFSET(struct lobes, layout),                                           \
        .bytes = bytes,                                                                            \
        .reconstruct = reconstruct,                                                                \
        .evaluate = evaluate,                                                                      \
        .error = G_STRUCT_OFFSET(struct lobes, error),                                             \
        .read_levels = read_levels,                                                                \
        .curve = curve,                                                                            \
    }

const struct codec lobes_codecs[LOBES_MODELS] = {
    LOBES_CODEC(LOBES_FIELDS, "fields", "reflectance fields",
                "reflectance fields, fitted to each texel and view (Meseth et al. 2003)"),
    LOBES_CODEC(LOBES_PTM, "ptm", "polynomials",
                "polynomial texture maps, fitted to each texel and view (Malzbender et al. 2001)"),
    LOBES_CODEC(LOBES_LAFORTUNE, "lafortune", "Lafortune",
                "cosine lobes, fitted to each texel (Lafortune et al. 1997)"),
    LOBES_CODEC(LOBES_WARD, "ward", "Ward",
                "an anisotropic highlight, fitted to each texel (Ward 1992)"),
    LOBES_CODEC(LOBES_ASHIKHMIN, "ashikhmin", "Ashikhmin–Shirley",
                "an anisotropic highlight, fitted to each texel (Ashikhmin and Shirley 2000)"),
};
