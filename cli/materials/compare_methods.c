#include "compare_methods.h"

#include "base/plural.h"
#include "common/work.h"

#include <math.h>

/* Errors of one codec. */
struct method_errors {
    const char *name;
    double bytes_per_texel, seen, evaluation_ns;
    struct comparison *comparison;
};

struct methods {
    const struct compare_methods_asked *asked;
    struct held_out held;
    /* `geometry` is that of btf. rest_geometry is that of btf without the directions that are left
     * out. */
    struct codec_geometry *geometry, *rest_geometry;
    struct btf_matrix *btf;
    GArray *found; /* of struct method_errors */
};

/* Adds the errors of a model at the directions that were left out. `seen` is the error of the model
 * at all other directions. */
static gboolean measure(struct methods *methods, const struct codec *codec, gconstpointer model,
                        double seen, const struct work *work, GError **error) {
    g_autoptr(Material) material = material_borrow(codec->name, codec, model);
    const struct material_info *info = material_info(material);
    struct method_errors errors = {
        .name = codec->name,
        .bytes_per_texel = (double)info->bytes / (double)btf_layout_texels(info->layout),
        .seen = seen,
    };
    if (!compare_evaluation_ns(material, &errors.evaluation_ns, error))
        return FALSE;
    errors.comparison = held_out_compare(methods->btf, &methods->held, material, work, error);
    if (errors.comparison)
        g_array_append_val(methods->found, errors);
    return errors.comparison != NULL;
}

static gboolean encode(struct methods *methods, const struct codec *codec,
                       const struct btf_matrix *rest, const struct work *work, GError **error) {
    g_autofree gpointer options = g_malloc0(MAX(codec->options_size, 1));
    options_defaults(codec->options, options);
    const struct codec_job job = {
        .btf = rest, .options = options, .work = work, .geometry = methods->rest_geometry};
    struct codec_result result = {0};
    const gboolean ok = codec->encode(codec, &job, &result, error) &&
                        measure(methods, codec, result.levels->pdata[0], result.error, work, error);
    if (!ok)
        g_prefix_error(error, "%s: ", codec->name);
    g_clear_pointer(&result.levels, g_ptr_array_unref);
    options_clear(codec->options, options);
    return ok;
}

static gboolean work_methods(const struct work *work, gpointer data, GError **error) {
    struct methods *methods = data;
    const struct codec *only = methods->asked->codec;
    methods->btf = btf_matrix_read(methods->asked->path, work, error);
    if (!methods->btf || !left_out_draw(&methods->asked->left_out, methods->asked->path,
                                        &methods->btf->layout, &methods->held, error))
        return FALSE;
    methods->geometry = codec_geometry_read(methods->btf, error);
    if (!methods->geometry)
        return FALSE;
    methods->rest_geometry = held_out_rest_geometry(methods->geometry, &methods->held);
    methods->held.geometry = methods->geometry;
    struct btf_matrix *rest = held_out_rest(methods->btf, &methods->held);
    gboolean ok = measure(methods, &material_btf_codec, rest, 0, work, error);
    if (!ok)
        g_prefix_error(error, "%s: ", methods->asked->path);
    for (gsize i = 0; ok && codecs[i]; i++)
        if (!only || codecs[i] == only)
            ok = encode(methods, codecs[i], rest, work, error);
    btf_matrix_free(rest);
    return ok;
}

static void tell_method(Record *to, const struct method_errors *errors) {
    const struct comparison *c = errors->comparison;
    record_begin(to, NULL);
    record_say(to, "%-12s{method} %11.1f{bytes_per_texel}  %6.2f{error:%%}  %6.2f{seen:%%}",
               errors->name, errors->bytes_per_texel, c->all.error, errors->seen);
    record_say(to, "  %7.2f{psnr_db} ", c->all.psnr_db);
    record_say_if(to, !isnan(c->ssim), " %6.4f{ssim}", c->ssim);
    if (isnan(c->ssim))
        record_say(to, " %6s", "–");
    record_say(to, "  %6.4f{flip} %6.2f{delta_e} %6.0f{evaluation_ns}\n", c->flip, c->all.delta_e,
               errors->evaluation_ns);
    record_add(to, "%g{luminance_error} %g{largest}", c->all.luminance_error, c->largest);
    record_end(to);
}

static void tell(Record *to, const struct methods *methods) {
    const struct btf_layout *layout = &methods->btf->layout;
    const struct comparison *first =
        g_array_index(methods->found, struct method_errors, 0).comparison;
    record_say(to, "%s{session}: %d{views} %s × %d{lights} %s\n", methods->asked->path,
               PLURAL((int)layout->views.n, "view"), PLURAL((int)layout->lights.n, "light"));
    left_out_tell(to, &methods->asked->left_out, layout, &methods->held);
    record_say(to, "SSIM and FLIP are means over %d{pictures} %s.\n",
               PLURAL(first->n_pictures, "picture"));
    record_say(to, "\n%-12s %11s  %8s  %8s  %7s  %6s  %6s %6s %6s\n", "method", "bytes/texel",
               "error", "seen", "PSNR/dB", "SSIM", "FLIP", "ΔE", "ns");
    record_begin_list(to, "methods");
    for (guint i = 0; i < methods->found->len; i++)
        tell_method(to, &g_array_index(methods->found, struct method_errors, i));
    record_end(to);
}

gboolean compare_methods(const struct compare_methods_asked *asked, Record *to, GError **error) {
    struct methods methods = {.asked = asked,
                              .found = g_array_new(FALSE, FALSE, sizeof(struct method_errors))};
    const gboolean ok = cli_work_run(work_methods, &methods, NULL, error);
    if (ok)
        tell(to, &methods);
    for (guint i = 0; i < methods.found->len; i++)
        comparison_free(g_array_index(methods.found, struct method_errors, i).comparison);
    g_array_unref(methods.found);
    held_out_clear(&methods.held);
    codec_geometry_free(methods.geometry);
    codec_geometry_free(methods.rest_geometry);
    btf_matrix_free(methods.btf);
    return ok;
}
