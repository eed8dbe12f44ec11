#include "hsh_codec.h"

#include "codecs/codec/texel_model.h"
#include "hsh.h"

struct hsh_codec_options {
    int terms; /* index into hsh_codec_terms */
};

static const int hsh_codec_terms[] = {4, 9, 16};
static const char *const hsh_codec_choices[] = {"4", "9", "16", NULL};

static const struct option hsh_codec_table[] = {
    {.name = "terms",
     .type = OPTION_CHOICE,
     .choices = hsh_codec_choices,
     .fallback = "9",
     .offset = offsetof(struct hsh_codec_options, terms),
     .help = "number of terms of each view, texel and colour"},
    {NULL},
};

static gboolean encode(const struct codec *codec, const struct codec_job *job,
                       struct codec_result *ret, GError **error) {
    const struct hsh_codec_options *asked = job->options;
    const struct hsh_options options = {.n_terms = hsh_codec_terms[asked->terms],
                                        .work = *job->work};
    struct hsh *hsh = hsh_compute(job->btf, &options, error);
    if (!hsh)
        return FALSE;
    ret->levels = g_ptr_array_new_with_free_func((GDestroyNotify)hsh_free);
    g_ptr_array_add(ret->levels, hsh);
    ret->components = hsh->n_terms;
    ret->error = hsh->error;
    ret->exact_error = hsh->exact_error;
    ret->luminance_error = hsh->luminance_error;
    return TRUE;
}

static char *describe(const struct codec *codec, const struct codec_result *result) {
    return g_strdup_printf("%s of %d terms, luminance off by %.4f on average", codec->name,
                           result->components, result->luminance_error);
}

static gboolean hsh_codec_write(const char *path, gpointer const *levels, int n_levels,
                                GError **error) {
    return hsh_write(path, levels[0], error);
}

static gpointer hsh_codec_read(const char *path, GError **error) {
    return hsh_read(path, error);
}

static char *describe_file(const struct exr_file *file) {
    g_autofree char *rest = exr_file_part(file, "term0") ? texel_model_describe_file(file) : NULL;
    int terms = 0;
    if (!rest)
        return NULL;
    exr_get_int(file->parts->pdata[0], "mesorig.terms", &terms, NULL);
    return g_strdup_printf("hemispherical harmonics of %d terms: %s", terms, rest);
}

static gint64 bytes(gconstpointer model) {
    return hsh_bytes(model);
}

static void reconstruct(gconstpointer model, int texel, float *ret) {
    hsh_reconstruct(model, texel, ret);
}

/* Adds Σ_a g_a max(0, f_a(x, l)) for each texel x, times its share. g_a is the weight of view a of
 * the query. f_a is the sum f of hsh.h in view a, which may be negative between the measured
 * lights. */
static void evaluate(gconstpointer model, const struct codec_query *query,
                     const struct codec_texels *texels, float ret[3]) {
    const struct hsh *hsh = model;
    const gsize row = (gsize)hsh->n_terms * 3, n = btf_layout_texels(&hsh->layout);
    float basis[HSH_MAX_TERMS];
    hsh_basis(query->light, hsh->n_terms, basis);
    for (int k = 0; k < texels->n; k++)
        for (int a = 0; a < query->n_views; a++) {
            const float *values =
                hsh->values + ((gsize)query->views[a] * n + (gsize)texels->index[k]) * row;
            float sum[3] = {0};
            for (int i = 0; i < hsh->n_terms; i++)
                for (int c = 0; c < 3; c++)
                    sum[c] += basis[i] * values[3 * i + c];
            for (int c = 0; c < 3; c++)
                ret[c] += texels->share[k] * query->view_weights[a] * MAX(sum[c], 0);
        }
}

static gboolean curve(const struct codec *codec, const struct codec_job *job, CodecPoint tell,
                      gpointer data, GError **error) {
    const struct btf_matrix *btf = job->btf;
    const struct work *work = job->work;
    gboolean ok = TRUE;
    for (gsize i = 0; ok && i < G_N_ELEMENTS(hsh_codec_terms); i++) {
        const struct hsh_options options = {.n_terms = hsh_codec_terms[i], .work = *work};
        struct hsh *hsh = hsh_compute(btf, &options, error);
        ok = hsh && tell(codec,
                         &(struct codec_point){
                             .series = codec->title,
                             .label = g_strdup_printf("%d terms", options.n_terms),
                             .bytes = hsh_bytes(hsh),
                             .error = hsh->error,
                             .model = hsh,
                         },
                         data, error);
        hsh_free(hsh);
    }
    return ok;
}

const struct codec hsh_codec = {
    .name = "hsh",
    .title = "hemispherical harmonics",
    .help = "hemispherical harmonics, fitted to each texel and view (Gautron et al. 2004)",
    .options = hsh_codec_table,
    .options_size = sizeof(struct hsh_codec_options),
    .encode = encode,
    .describe = describe,
    .write = hsh_codec_write,
    .read = hsh_codec_read,
    .describe_file = describe_file,
    .free = (GDestroyNotify)hsh_free,
    .layout = G_STRUCT_OFFSET(struct hsh, layout),
    .bytes = bytes,
    .reconstruct = reconstruct,
    .evaluate = evaluate,
    .error = G_STRUCT_OFFSET(struct hsh, error),
    .curve = curve,
};
