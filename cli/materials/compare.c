/* compare: computes the difference of two forms of a material, or the errors of every codec. */
#include "base/data_error.h"
#include "base/plural.h"
#include "btf/btf_sigma.h"
#include "codecs/codecs.h"
#include "common/cli.h"
#include "common/plot.h"
#include "common/work.h"
#include "compare_lights.h"
#include "compare_methods.h"
#include "curve.h"
#include "formats/compare_pictures.h"
#include "materials.h"

#include <math.h>

#define WORST 5 /* number of worst views and lights in the text */

static char *plot_option, *curve_option, *leave_out_option, *method_option;
static int seed_option = 1;

struct compare {
    const char *a, *b;
    OutputFile *plot; /* NULL if none */
    /* results */
    Material *of_a, *of_b;
    struct comparison *comparison;
    double evaluation_ns; /* time of one evaluation of B in ns; NAN if B cannot be evaluated */
    struct left_out left_out;
    /* the directions that were left out when the points of the curve were measured */
    struct held_out held;
    struct codec_geometry *geometry;
    GArray *points;
};

static gboolean draw(const struct compare *compare, GError **error) {
    const char *path = output_file_path(compare->plot, error);
    return path && output_file_end(compare->plot,
                                   plot_comparison(path, material_info(compare->of_a),
                                                   material_info(compare->of_b),
                                                   compare->comparison, error),
                                   error);
}

/* Returns the number of bytes of the BTF without the directions that were left out. */
static double seen_bytes(const struct compare *compare) {
    const struct btf_layout *layout = material_info(compare->of_a)->layout;
    const double views = (double)layout->views.n, lights = (double)layout->lights.n;
    return (double)material_info(compare->of_a)->bytes * (views - compare->held.n_views) / views *
           (lights - compare->held.n_lights) / lights;
}

static gboolean draw_curve(const struct compare *compare, const char *name, GError **error) {
    const char *path = output_file_path(compare->plot, error);
    const char *text = compare->held.n_views || compare->held.n_lights
                           ? "relative RMS error at directions that were left out"
                           : "relative RMS error of all values";
    return path && output_file_end(compare->plot,
                                   plot_curve(path, name, text, seen_bytes(compare),
                                              &g_array_index(compare->points, struct plot_point, 0),
                                              (int)compare->points->len, error),
                                   error);
}

static gboolean work_compare(const struct work *work, gpointer data, GError **error) {
    struct compare *compare = data;
    compare->of_a = material_open(compare->a, work, error);
    compare->of_b = compare->of_a ? material_open(compare->b, work, error) : NULL;
    if (!compare->of_b)
        return FALSE;
    compare->comparison = compare_materials(compare->of_a, compare->of_b, work, error);
    /* compare_evaluation_ns() fails if B has directions below the horizon. Such a material can be
     * compared at its directions, but not evaluated between them. The time is then left out
     * (NAN). */
    if (compare->comparison && !compare_evaluation_ns(compare->of_b, &compare->evaluation_ns, NULL))
        compare->evaluation_ns = NAN;
    return compare->comparison && (!compare->plot || draw(compare, error));
}

static gboolean work_curve(const struct work *work, gpointer data, GError **error) {
    struct compare *compare = data;
    compare->of_a = material_open(compare->a, work, error);
    if (!compare->of_a)
        return FALSE;
    const struct btf_matrix *btf = material_btf(compare->of_a);
    if (!btf) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "%s: --curve needs the BTF of a session: give a session directory that "
                    "“mesorig process” has processed",
                    compare->a);
        return FALSE;
    }
    if (!left_out_draw(&compare->left_out, compare->a, &btf->layout, &compare->held, error))
        return FALSE;
    compare->geometry = codec_geometry_read(btf, error);
    if (!compare->geometry)
        return FALSE;
    compare->held.geometry = compare->geometry;
    const gboolean some = compare->held.n_views || compare->held.n_lights;
    compare->points = curve_measure(btf, some ? &compare->held : NULL, work, error);
    return compare->points && draw_curve(compare, btf->name, error);
}

static void add_sums(Record *to, const struct compare_sums *sums) {
    record_add(to, "%g{error} %g{luminance_error} %g{delta_e} %g{psnr_db}", sums->error,
               sums->luminance_error, sums->delta_e, sums->psnr_db);
}

static int by_error(gconstpointer a, gconstpointer b, gpointer data) {
    const struct compare_sums *sums = data;
    const double x = sums[*(const int *)a].error, y = sums[*(const int *)b].error;
    return (x < y) - (x > y);
}

/* Adds the errors of all views or lights to the record. If there are more than 2 · WORST, the text
 * lists only the WORST largest errors and the smallest one. */
static void tell_directions(Record *to, const char *what, const float *theta_deg,
                            const float *phi_deg, struct compare_sums *sums, int n) {
    g_autofree char *key = g_strconcat(what, "s", NULL);
    g_autofree int *order = g_new(int, n);
    record_begin_list(to, key);
    for (int i = 0; i < n; i++) {
        order[i] = i;
        record_begin(to, NULL);
        record_add(to, "%g{theta_deg} %g{phi_deg}", (double)theta_deg[i], (double)phi_deg[i]);
        add_sums(to, &sums[i]);
        record_end(to);
    }
    record_end(to);
    g_qsort_with_data(order, n, sizeof *order, by_error, sums);
    record_say(to, "\n%-8s %7s %7s %10s %11s %6s\n", what, "theta", "phi", "error", "luminance",
               "ΔE");
    for (int i = 0; i < n; i++) {
        const int at = order[i];
        if (i == WORST && n > 2 * WORST)
            record_say(to, "     …\n");
        if (i < WORST || i >= n - 1 || n <= 2 * WORST)
            record_say(to, "%8d %6.1f° %6.1f° %8.2f{:%%} %11.4f %6.2f\n", at, (double)theta_deg[at],
                       (double)phi_deg[at], sums[at].error, sums[at].luminance_error,
                       sums[at].delta_e);
    }
}

static double bytes_per_texel(const struct material_info *info) {
    return (double)info->bytes / (double)btf_layout_texels(info->layout);
}

/* Reports the picture metrics of the literature: PSNR, SSIM and FLIP. */
static void tell_pictures(Record *to, const struct comparison *c) {
    record_say(to, "PSNR       %.2f{psnr_db} dB of all values, clipped to white, as sRGB\n",
               c->all.psnr_db);
    record_int(to, "pictures", c->n_pictures);
    record_say_if(to, !isnan(c->ssim), "SSIM       %.4f{ssim} on average of %d %s\n", c->ssim,
                  PLURAL(c->n_pictures, "picture"));
    record_say(to, "FLIP       %.4f{flip} on average of %d %s\n", c->flip,
               PLURAL(c->n_pictures, "picture"));
}

/* Reports the difference that the error bars σ predict, √(Σ σ_A² + Σ σ_B²) / ‖A‖, and which part of
 * the squared difference this explains. B has error bars only if B is a session. */
static void tell_sigma(Record *to, const struct compare *compare) {
    const struct material_info *infos[] = {material_info(compare->of_a),
                                           material_info(compare->of_b)};
    const Material *const materials[] = {compare->of_a, compare->of_b};
    double share = 0;
    int known = 0, lights = 0;
    for (gsize i = 0; i < G_N_ELEMENTS(materials); i++) {
        const struct btf_matrix *btf = material_btf(materials[i]);
        struct btf_sigma_sums sigma = {0};
        if (btf && btf->directory)
            btf_sigma_sum(btf->directory, &sigma);
        known += sigma.known;
        lights += (int)(btf ? infos[i]->layout->views.n * infos[i]->layout->lights.n : 0);
        share += sigma.share;
    }
    const double error = compare->comparison->all.error;
    const double part = error > 0 ? share / (error * error) : 0;
    record_int(to, "sigma_known", known);
    record_say_if(to, known > 0,
                  "error bars %.3f{sigma:%%} RMS of R, G, B%s: they explain %.0f{:%%} of the "
                  "difference's square\n",
                  sqrt(share), known < lights ? " where known" : "", MIN(part, 1));
    record_double(to, "sigma_part", part);
    if (known == 0)
        record_say(to, "error bars not known\n");
}

static void tell_comparison(Record *to, const struct compare *compare) {
    const struct material_info *a = material_info(compare->of_a), *b = material_info(compare->of_b);
    const struct comparison *c = compare->comparison;
    record_add(to, "%s{a} %s{b} %s{a_kind} %s{b_kind}", compare->a, compare->b, a->kind, b->kind);
    record_say(to, "A          %s, %s, %" G_GINT64_FORMAT "{a_bytes:size}, ", a->label, a->kind,
               a->bytes);
    record_say(to, "%.4g{a_bytes_per_texel} bytes per texel\n", bytes_per_texel(a));
    record_say(to, "B          %s, %s, %" G_GINT64_FORMAT "{b_bytes:size}, ", b->label, b->kind,
               b->bytes);
    record_say(to, "%.4g{b_bytes_per_texel} bytes per texel, 1:%.3g\n", bytes_per_texel(b),
               (double)a->bytes / (double)b->bytes);
    record_say_if(to, !isnan(compare->evaluation_ns),
                  "evaluation %.0f{evaluation_ns} ns of B on one thread\n", compare->evaluation_ns);
    record_say(to,
               "error      %.3f{error:%%} (RMS of R, G, B relative to A) at the measured "
               "directions\n",
               c->all.error);
    record_say(to, "luminance  off by %.5f{luminance_error} on average\n", c->all.luminance_error);
    record_say(to, "ΔE         %.3f{delta_e} on average (CIEDE2000, white is the diffuser)\n",
               c->all.delta_e);
    tell_pictures(to, c);
    record_say(to, "largest    %.4f{largest}\n", c->largest);
    tell_sigma(to, compare);
    tell_directions(to, "view", a->layout->views.theta_deg, a->layout->views.phi_deg, c->views,
                    c->n_views);
    tell_directions(to, "light", a->layout->lights.theta_deg, a->layout->lights.phi_deg, c->lights,
                    c->n_lights);
    if (compare->plot) {
        record_say(to, "\nplot       %s\n", plot_option);
        cli_tell_output(to, compare->plot);
    }
}

static void tell_curve(Record *to, const struct compare *compare) {
    const double raw = seen_bytes(compare);
    record_string(to, "plot", curve_option);
    left_out_tell(to, &compare->left_out, material_info(compare->of_a)->layout, &compare->held);
    record_begin_list(to, "points");
    for (guint i = 0; i < compare->points->len; i++) {
        const struct plot_point *point = &g_array_index(compare->points, struct plot_point, i);
        record_begin(to, NULL);
        record_say(to, "%s%-24s{series} %-14s{label} ", i == 0 ? "\n" : "", point->series,
                   point->label);
        record_double(to, "bytes", point->bytes);
        record_say(to, "1:%-8.4g{ratio} %7.3f{error:%%}\n", raw / point->bytes, point->error);
        record_end(to);
    }
    record_end(to);
    record_say(to, "plot %s\n", curve_option);
    cli_tell_output(to, compare->plot);
}

/* Compares two pictures, such as renderings of two materials. */
static int run_pictures(Record *to, const char *a, const char *b, GError **error) {
    struct picture_comparison found;
    if (!compare_pictures(a, b, &found, error))
        return CLI_FAILED;
    record_add(to, "%s{a} %s{b}", a, b);
    record_say(
        to,
        "ΔE         %.3f{delta_e} on average (CIEDE2000), %.3f{delta_e_different} where they "
        "differ: 95 %% below %.3f{delta_e_p95}, at most %.3f{delta_e_largest}\n"
        "           %.1f{different:%%} of %d × %d pixels differ\n",
        found.delta_e, found.delta_e_different, found.p95, found.largest, found.different,
        found.width, found.height);
    record_say(to, "PSNR       %.2f{psnr_db} dB\n", found.psnr_db);
    record_say_if(to, !isnan(found.ssim), "SSIM       %.4f{ssim}\n", found.ssim);
    record_say(to, "FLIP       %.4f{flip}\n", found.flip);
    record_say_if(to, !isnan(found.flip_hdr), "HDR-FLIP   %.4f{flip_hdr}\n", found.flip_hdr);
    return CLI_DONE;
}

/* Returns the options of the command. The help of --method names all codecs as its choices. */
static const GOptionEntry *entries(void) {
    static GOptionEntry table[] = {
        {"plot", 'p', 0, G_OPTION_ARG_FILENAME, &plot_option,
         "Draw the errors of views and lights (.svg or .png)", "FILE"},
        {"curve", 0, 0, G_OPTION_ARG_FILENAME, &curve_option,
         "Compress a session by every method in several sizes, and draw error against size (.svg "
         "or "
         ".png)",
         "FILE"},
        {"leave-out", 0, 0, G_OPTION_ARG_STRING, &leave_out_option,
         "With one session: number of views and of lights that no method sees (a tenth of each); "
         "views=N or lights=N leaves out only views or lights; each predicts each light of one "
         "view from the others",
         "N"},
        {"seed", 0, 0, G_OPTION_ARG_INT, &seed_option,
         "With one session: seed that draws the directions that are left out (1)", "N"},
        {"method", 'm', 0, G_OPTION_ARG_STRING, &method_option,
         "With one session: only this method (all)", NULL},
        {NULL},
    };
    g_autoptr(GString) names = g_string_new(codecs[0]->name);
    for (gsize i = 1; codecs[i]; i++)
        g_string_append_printf(names, "|%s", codecs[i]->name);
    for (GOptionEntry *entry = table; entry->long_name; entry++)
        if (entry->arg_data == &method_option)
            entry->arg_description = g_intern_string(names->str);
    return table;
}

/* Reports the errors of codecs at directions that were left out. */
static int run_methods(const struct call *call, const struct left_out *left_out, GError **error) {
    const struct compare_methods_asked asked = {call->arguments[0], *left_out,
                                                codecs_find(method_option)};
    if (method_option && !asked.codec)
        return cli_usage(call->command,
                         "there is no --method=%s; “mesorig compare --help” lists the methods",
                         method_option);
    return compare_methods(&asked, call->record, error) ? CLI_DONE : CLI_FAILED;
}

static int run(const struct call *call, GError **error) {
    const char *a = call->arguments[0], *b = call->arguments[1];
    if (curve_option && plot_option)
        return cli_usage(call->command, "give --curve or --plot, not both");
    if (curve_option && b)
        return cli_usage(call->command, "--curve is for one session: give only one");
    if (plot_option && !b)
        return cli_usage(call->command, "--plot draws the errors between two materials: give two");
    struct left_out left_out = {-1, -1, (guint32)seed_option};
    if (b && (leave_out_option || seed_option != 1))
        return cli_usage(call->command,
                         "--leave-out and --seed need one session, whose BTF is compressed without "
                         "some directions");
    if (method_option && b)
        return cli_usage(call->command, "--method is for one session: give only one");
    if (method_option && curve_option)
        return cli_usage(call->command, "give --method or --curve, not both");
    if (g_strcmp0(leave_out_option, "each") == 0) {
        if (method_option || curve_option || seed_option != 1)
            return cli_usage(call->command,
                             "--leave-out=each compares ways to predict a light, not methods of "
                             "compression: leave out --method, --curve and --seed");
        return compare_lights(a, call->record, error) ? CLI_DONE : CLI_FAILED;
    }
    if (leave_out_option && !left_out_parse(leave_out_option, &left_out))
        return cli_usage(call->command,
                         "--leave-out=%s: give a number, such as 4, views=4 or lights=4, or give "
                         "each",
                         leave_out_option);
    if (!b && !curve_option)
        return run_methods(call, &left_out, error);
    if (!curve_option && compare_is_picture(a) && compare_is_picture(b)) {
        if (plot_option)
            return cli_usage(call->command,
                             "--plot draws the errors of materials; leave it out for pictures");
        return run_pictures(call->record, a, b, error);
    }
    const char *drawn = curve_option ? curve_option : plot_option;
    g_autoptr(OutputFile) plot = NULL;
    if (drawn && !(plot = cli_output(drawn, "plot", error)))
        return CLI_FAILED;
    struct compare compare = {.a = a, .b = b, .plot = plot, .left_out = left_out};
    const gboolean ok =
        cli_work_run(curve_option ? work_curve : work_compare, &compare, NULL, error);
    if (ok)
        (curve_option ? tell_curve : tell_comparison)(call->record, &compare);
    material_free(compare.of_a);
    material_free(compare.of_b);
    comparison_free(compare.comparison);
    held_out_clear(&compare.held);
    codec_geometry_free(compare.geometry);
    curve_free(compare.points);
    return ok ? CLI_DONE : CLI_FAILED;
}

const struct command cli_compare = {
    .name = "compare",
    .arguments = "A B | DIR | DIR --curve FILE",
    .examples = "  mesorig compare weave.session\n"
                "  mesorig compare weave.session weave.session/products/lpca.exr\n"
                "  mesorig compare weave.session --curve curve.svg\n"
                "  mesorig compare coin.session --leave-out each\n",
    .help = "Compare two materials or pictures, or all methods of compression.",
    .list_options = entries,
    .writes = TRUE,
    .min = 1,
    .max = 2,
    .run = run};
