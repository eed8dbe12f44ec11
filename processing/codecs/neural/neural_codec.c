#include "neural_codec.h"

#include "base/data_error.h"
#include "codecs/codec/codec_geometry.h"
#include "codecs/codec/texel_model.h"
#include "neural.h"

struct neural_codec_options {
    int components, samples, seed;
    double error;
    gboolean mips;
};

static const struct option neural_codec_table[] = {
    {.name = "components",
     .type = OPTION_INT,
     .min = 4,
     .max = NEURAL_MAX_CHANNELS,
     .fallback = "12",
     .offset = offsetof(struct neural_codec_options, components),
     .help = "number of channels of each texel: 4, 8, 12 or 16"},
    {.name = "samples",
     .type = OPTION_INT,
     .min = 1,
     .max = 1e6,
     .fallback = "3000",
     .offset = offsetof(struct neural_codec_options, samples),
     .help = "length of the training: values that are drawn for each texel; more take longer and "
             "have a smaller error"},
    {.name = "seed",
     .type = OPTION_INT,
     .min = 0,
     .max = G_MAXINT,
     .fallback = "1",
     .offset = offsetof(struct neural_codec_options, seed),
     .help = "any number; another number draws other values for the training"},
    {.name = "error",
     .type = OPTION_SHARE,
     .offset = offsetof(struct neural_codec_options, error),
     .help = "fail if the error of the whole BTF is larger"},
    {.name = "mips",
     .type = OPTION_BOOL,
     .offset = offsetof(struct neural_codec_options, mips),
     .help = "also write mip levels"},
    {NULL},
};

static const char *check(gconstpointer options, gint64 memory) {
    const struct neural_codec_options *asked = options;
    return asked->components % 4 != 0 ? "--components must be 4, 8, 12 or 16" : NULL;
}

static gboolean check_error(const struct neural *neural, double target, GError **error) {
    if (target <= 0 || neural->error <= target)
        return TRUE;
    g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                "an error of %.3g %% is not reached: the neural planes have an error of %.3g %%; "
                "allow a larger error, give more --samples, or use --method=lpca",
                100 * target, 100 * neural->error);
    return FALSE;
}

/* Makes the mip levels that the array lacks, from its last level on, and adds them to the array. */
static void add_levels(GPtrArray *levels) {
    struct neural *last = levels->pdata[levels->len - 1];
    while (levels->len < NEURAL_MAX_LEVELS && (last = neural_halved(last)) != NULL)
        g_ptr_array_add(levels, last);
}

static gboolean encode(const struct codec *codec, const struct codec_job *job,
                       struct codec_result *ret, GError **error) {
    const struct neural_codec_options *asked = job->options;
    struct neural_options options = {.n_channels = asked->components,
                                     .per_texel = asked->samples,
                                     .seed = (guint32)asked->seed,
                                     .work = *job->work,
                                     .checkpoint = job->checkpoint};
    g_autoptr(CodecGeometry) own = job->geometry ? NULL : codec_geometry_read(job->btf, error);
    options.geometry = job->geometry ? job->geometry : own;
    if (!options.geometry)
        return FALSE;
    struct neural *neural = neural_compute(job->btf, &options, error);
    if (!neural)
        return FALSE;
    ret->levels = g_ptr_array_new_with_free_func((GDestroyNotify)neural_free);
    ret->components = neural->n_channels;
    ret->error = neural->error;
    ret->exact_error = neural->exact_error;
    ret->luminance_error = neural->luminance_error;
    g_ptr_array_add(ret->levels, neural);
    if (asked->mips)
        add_levels(ret->levels);
    return check_error(neural, asked->error, error);
}

static char *describe(const struct codec *codec, const struct codec_result *result) {
    const struct neural *neural = result->levels->pdata[0];
    GString *text = g_string_new(NULL);
    g_string_append_printf(text, "%s planes of %d channels, %s", codec->name, result->components,
                           neural->height_scale.step > 0 ? "with relief" : "flat");
    if (result->levels->len > 1)
        g_string_append_printf(text, ", %u mip levels", result->levels->len);
    g_string_append_printf(text, ", luminance off by %.4f on average", result->luminance_error);
    return g_string_free(text, FALSE);
}

static gboolean neural_codec_write(const char *path, gpointer const *levels, int n_levels,
                                   GError **error) {
    return neural_write(path, (struct neural *const *)levels, n_levels, error);
}

static gpointer neural_codec_read(const char *path, GError **error) {
    return neural_read(path, error);
}

static char *describe_file(const struct exr_file *file) {
    g_autofree char *rest = exr_file_part(file, "heights") ? texel_model_describe_file(file) : NULL;
    int channels = 0;
    if (!rest)
        return NULL;
    exr_get_int(file->parts->pdata[0], "mesorig.channels", &channels, NULL);
    return g_strdup_printf("neural planes of %d channels: %s", channels, rest);
}

static gint64 bytes(gconstpointer model) {
    return neural_bytes(model);
}

static void reconstruct(gconstpointer model, int texel, float *ret) {
    neural_reconstruct(model, texel, ret);
}

static void evaluate(gconstpointer model, const struct codec_query *query,
                     const struct codec_texels *texels, float ret[3]) {
    const struct neural *neural = model;
    const int width = (int)neural->layout.width;
    struct neural_sample samples[CODEC_MAX_TEXELS];
    float colours[3 * CODEC_MAX_TEXELS];
    for (int k = 0; k < texels->n; k++) {
        const int row = texels->index[k] / width, column = texels->index[k] % width;
        samples[k] = (struct neural_sample){
            (float)column + 0.5F,
            (float)row + 0.5F,
            {query->view[0], query->view[1], query->view[2]},
            {query->light[0], query->light[1], query->light[2]},
        };
    }
    neural_evaluate(neural, samples, (gsize)texels->n, colours);
    for (int k = 0; k < texels->n; k++)
        for (int c = 0; c < 3; c++)
            ret[c] += texels->share[k] * colours[3 * k + c];
}

static void evaluate_point(gconstpointer model, const struct codec_query *query, double x, double y,
                           float share, float ret[3]) {
    const struct neural_sample sample = {(float)x,
                                         (float)y,
                                         {query->view[0], query->view[1], query->view[2]},
                                         {query->light[0], query->light[1], query->light[2]}};
    float colour[3];
    neural_evaluate_points(model, &sample, 1, colour);
    for (int c = 0; c < 3; c++)
        ret[c] += share * colour[c];
}

/* Reads the mip levels, and makes those that the file lacks, as the viewer does. */
static GPtrArray *read_levels(const char *path, GError **error) {
    struct neural *levels[NEURAL_MAX_LEVELS] = {NULL};
    const int n = neural_read_levels(path, levels, error);
    GPtrArray *ret = n ? g_ptr_array_new_with_free_func((GDestroyNotify)neural_free) : NULL;
    for (int i = 0; i < n; i++)
        g_ptr_array_add(ret, levels[i]);
    if (ret)
        add_levels(ret);
    return ret;
}

static gboolean curve(const struct codec *codec, const struct codec_job *job, CodecPoint tell,
                      gpointer data, GError **error) {
    const struct btf_matrix *btf = job->btf;
    const struct work *work = job->work;
    g_autoptr(CodecGeometry) own = job->geometry ? NULL : codec_geometry_read(btf, error);
    const struct codec_geometry *geometry = job->geometry ? job->geometry : own;
    gboolean ok = geometry != NULL;
    for (int n = 4; ok && n <= NEURAL_MAX_CHANNELS; n += 4) {
        const struct neural_options options = {
            .n_channels = n, .seed = 1, .work = *work, .geometry = geometry};
        struct neural *neural = neural_compute(btf, &options, error);
        ok = neural && tell(codec,
                            &(struct codec_point){
                                .series = codec->title,
                                .label = g_strdup_printf("%d channels", n),
                                .bytes = neural_bytes(neural),
                                .error = neural->error,
                                .model = neural,
                            },
                            data, error);
        neural_free(neural);
    }
    return ok;
}

const struct codec neural_codec = {
    .name = "neural",
    .title = "neural planes",
    .help = "planes of channels and a small network, with the relief of the MDF (Fan et al. 2023)",
    .options = neural_codec_table,
    .options_size = sizeof(struct neural_codec_options),
    .check = check,
    .resumable = TRUE,
    .geometric = TRUE,
    .encode = encode,
    .describe = describe,
    .write = neural_codec_write,
    .read = neural_codec_read,
    .describe_file = describe_file,
    .free = (GDestroyNotify)neural_free,
    .layout = G_STRUCT_OFFSET(struct neural, layout),
    .bytes = bytes,
    .reconstruct = reconstruct,
    .evaluate = evaluate,
    .error = G_STRUCT_OFFSET(struct neural, error),
    .read_levels = read_levels,
    .curve = curve,
    .evaluate_point = evaluate_point,
};
