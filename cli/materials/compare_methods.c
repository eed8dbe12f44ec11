#include "compare_methods.h"

#include "base/data_error.h"
#include "base/plural.h"
#include "codecs/codec/held_out.h"
#include "common/work.h"

#include <math.h>
#include <string.h>

#define SHARE    10 /* one of so many directions is left out by default */
#define MIN_KEPT 3

/* Errors of one codec. */
struct method_errors {
    const char *name;
    double bytes_per_texel, seen, evaluation_ns;
    struct comparison *comparison;
};

struct methods {
    const struct compare_methods_asked *asked;
    struct held_out held;
    struct btf_matrix *btf;
    GArray *found; /* of struct method_errors */
};

gboolean compare_methods_parse(const char *text, int *ret_views, int *ret_lights) {
    const char *equals = strchr(text, '=');
    const gboolean views = !equals || g_str_has_prefix(text, "views=");
    const gboolean lights = !equals || g_str_has_prefix(text, "lights=");
    guint64 n;
    if (!(views || lights) ||
        !g_ascii_string_to_unsigned(equals ? equals + 1 : text, 10, 1, G_MAXINT, &n, NULL))
        return FALSE;
    *ret_views = views ? (int)n : 0;
    *ret_lights = lights ? (int)n : 0;
    return TRUE;
}

/* Returns the number of directions to leave out of n. */
static int number(int asked, gsize n) {
    if (asked >= 0)
        return asked;
    return n > MIN_KEPT ? (int)((n + SHARE - 1) / SHARE) : 0;
}

static gboolean draw(struct methods *methods, GError **error) {
    const struct btf_layout *layout = &methods->btf->layout;
    const int views = number(methods->asked->views, layout->views.n);
    const int lights = number(methods->asked->lights, layout->lights.n);
    if (views > 0 || lights > 0)
        return held_out_draw(layout, views, lights, methods->asked->seed, &methods->held, error);
    g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                "%s: it has %d %s and %d %s, of which none can be left out; compare it with a "
                "compressed file",
                methods->asked->path, PLURAL((int)layout->views.n, "view"),
                PLURAL((int)layout->lights.n, "light"));
    return FALSE;
}

/* Adds the errors of a model of the BTF without the directions. */
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
    const struct codec_job job = {.btf = rest, .options = options, .work = work};
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
    if (!methods->btf || !draw(methods, error))
        return FALSE;
    struct btf_matrix *rest = held_out_rest(methods->btf, &methods->held);
    gboolean ok = measure(methods, &material_btf_codec, rest, 0, work, error);
    for (gsize i = 0; ok && codecs[i]; i++)
        if (!only || codecs[i] == only)
            ok = encode(methods, codecs[i], rest, work, error);
    btf_matrix_free(rest);
    return ok;
}

static void tell_left_out(Record *to, const char *key, const struct direction_list *list,
                          const int *indices, int n) {
    record_begin_list(to, key);
    for (int i = 0; i < n; i++) {
        record_begin(to, NULL);
        record_add(to, "%d{index} %g{theta_deg} %g{phi_deg}", indices[i],
                   (double)list->theta_deg[indices[i]], (double)list->phi_deg[indices[i]]);
        record_end(to);
    }
    record_end(to);
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
    const struct held_out *held = &methods->held;
    const struct comparison *first =
        g_array_index(methods->found, struct method_errors, 0).comparison;
    const int pairs = first->n_views * first->n_lights;
    record_say(to, "%s{session}: %d{views} views × %d{lights} lights, ", methods->asked->path,
               (int)layout->views.n, (int)layout->lights.n);
    record_say(to, "of which %d %s and %d %s were left out (seed %u{seed})\n",
               PLURAL(held->n_views, "view"), PLURAL(held->n_lights, "light"),
               methods->asked->seed);
    record_say(
        to,
        "Errors are those at %d{pairs} %s of a view and a light that no method has seen. SSIM "
        "and FLIP\nare means over %d{pictures} %s.\n",
        PLURAL(pairs, "pair"), PLURAL(first->n_pictures, "picture"));
    record_say(to, "\n%-12s %11s  %8s  %8s  %7s  %6s  %6s %6s %6s\n", "method", "bytes/texel",
               "error", "seen", "PSNR/dB", "SSIM", "FLIP", "ΔE", "ns");
    tell_left_out(to, "left_out_views", &layout->views, held->views, held->n_views);
    tell_left_out(to, "left_out_lights", &layout->lights, held->lights, held->n_lights);
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
    btf_matrix_free(methods.btf);
    return ok;
}
