/* compare: the difference between two forms of a material, or the errors of every codec. */
#include "base/data_error.h"
#include "codecs/codecs.h"
#include "command/cli.h"
#include "command/work.h"
#include "curve.h"
#include "formats/compare_pictures.h"
#include "plan/report.h"
#include "plot.h"

#include <math.h>

#define WORST  5  /* views and lights that are told to people */
#define SERIES 24 /* characters of the longest name of a model */
#define LABEL  14 /* and of what tells its sizes apart */

struct compare {
    const char *a, *b, *plot, *curve;
    /* found */
    Material *of_a, *of_b;
    struct comparison *comparison;
    GArray *points;
};

static gboolean work_compare(const struct work *work, gpointer data, GError **error) {
    struct compare *compare = data;
    compare->of_a = material_open(compare->a, work, error);
    compare->of_b = compare->of_a ? material_open(compare->b, work, error) : NULL;
    if (!compare->of_b)
        return FALSE;
    compare->comparison = compare_materials(compare->of_a, compare->of_b, work, error);
    return compare->comparison &&
           (!compare->plot ||
            plot_comparison(compare->plot, material_info(compare->of_a),
                            material_info(compare->of_b), compare->comparison, error));
}

static gboolean work_curve(const struct work *work, gpointer data, GError **error) {
    struct compare *compare = data;
    compare->of_a = material_open(compare->a, work, error);
    if (!compare->of_a)
        return FALSE;
    const struct btf_matrix *btf = material_btf(compare->of_a);
    if (!btf) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "%s: a curve is made of a session with its BTF", compare->a);
        return FALSE;
    }
    compare->points = curve_measure(btf, work, error);
    return compare->points &&
           plot_curve(compare->curve, btf->name, (double)material_info(compare->of_a)->bytes,
                      &g_array_index(compare->points, struct plot_point, 0),
                      (int)compare->points->len, error);
}

static void cli_compare_add_double(GVariantBuilder *to, const char *name, double value) {
    g_variant_builder_add(to, "{sv}", name, g_variant_new_double(value));
}

static void cli_compare_add_sums(GVariantBuilder *to, const struct compare_sums *sums) {
    cli_compare_add_double(to, "error", sums->error);
    cli_compare_add_double(to, "luminance_error", sums->luminance_error);
    cli_compare_add_double(to, "delta_e", sums->delta_e);
}

static GVariant *directions_variant(const float *theta_deg, const float *phi_deg,
                                    const struct compare_sums *sums, int n) {
    GVariantBuilder list;
    g_variant_builder_init(&list, G_VARIANT_TYPE("aa{sv}"));
    for (int i = 0; i < n; i++) {
        g_variant_builder_open(&list, G_VARIANT_TYPE_VARDICT);
        cli_compare_add_double(&list, "theta_deg", theta_deg[i]);
        cli_compare_add_double(&list, "phi_deg", phi_deg[i]);
        cli_compare_add_sums(&list, &sums[i]);
        g_variant_builder_close(&list);
    }
    return g_variant_builder_end(&list);
}

static void cli_compare_tell_json(const struct compare *compare) {
    const struct material_info *a = material_info(compare->of_a), *b = material_info(compare->of_b);
    const struct comparison *c = compare->comparison;
    GVariantBuilder builder;
    g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&builder, "{sv}", "a", g_variant_new_string(compare->a));
    g_variant_builder_add(&builder, "{sv}", "b", g_variant_new_string(compare->b));
    g_variant_builder_add(&builder, "{sv}", "a_kind", g_variant_new_string(a->kind));
    g_variant_builder_add(&builder, "{sv}", "b_kind", g_variant_new_string(b->kind));
    g_variant_builder_add(&builder, "{sv}", "a_bytes", g_variant_new_int64(a->bytes));
    g_variant_builder_add(&builder, "{sv}", "b_bytes", g_variant_new_int64(b->bytes));
    cli_compare_add_sums(&builder, &c->all);
    cli_compare_add_double(&builder, "largest", c->largest);
    g_variant_builder_add(&builder, "{sv}", "views",
                          directions_variant(a->layout->views.theta_deg, a->layout->views.phi_deg,
                                             c->views, c->n_views));
    g_variant_builder_add(&builder, "{sv}", "lights",
                          directions_variant(a->layout->lights.theta_deg, a->layout->lights.phi_deg,
                                             c->lights, c->n_lights));
    cli_print_json(g_variant_builder_end(&builder));
}

static int cli_compare_by_error(gconstpointer a, gconstpointer b, gpointer data) {
    const struct compare_sums *sums = data;
    const double x = sums[*(const int *)a].error, y = sums[*(const int *)b].error;
    return (x < y) - (x > y);
}

static void tell_worst(const char *what, const float *theta_deg, const float *phi_deg,
                       struct compare_sums *sums, int n) {
    g_autofree int *order = g_new(int, n);
    for (int i = 0; i < n; i++)
        order[i] = i;
    g_qsort_with_data(order, n, sizeof *order, cli_compare_by_error, sums);
    g_print("\n%-8s %7s %7s %10s %11s %6s\n", what, "theta", "phi", "error", "luminance", "ΔE");
    for (int i = 0; i < n; i++) {
        const int at = order[i];
        if (i == WORST && n > 2 * WORST)
            g_print("     …\n");
        if (i < WORST || i >= n - 1 || n <= 2 * WORST)
            g_print("%8d %6.1f° %6.1f° %8.2f %% %11.4f %6.2f\n", at, (double)theta_deg[at],
                    (double)phi_deg[at], 100 * sums[at].error, sums[at].luminance_error,
                    sums[at].delta_e);
    }
}

static void cli_compare_tell(const struct compare *compare) {
    const struct material_info *a = material_info(compare->of_a), *b = material_info(compare->of_b);
    const struct comparison *c = compare->comparison;
    g_autofree char *size_a = g_format_size((guint64)a->bytes);
    g_autofree char *size_b = g_format_size((guint64)b->bytes);
    if (cli_json) {
        cli_compare_tell_json(compare);
        return;
    }
    g_print("A          %s, %s, %s\n", a->label, a->kind, size_a);
    g_print("B          %s, %s, %s, 1:%.3g\n", b->label, b->kind, size_b,
            (double)a->bytes / (double)b->bytes);
    g_print("error      %.3f %% (RMS of R, G, B relative to A)\n", 100 * c->all.error);
    g_print("luminance  off by %.5f on average\n", c->all.luminance_error);
    g_print("ΔE         %.3f on average (CIEDE2000, white is the diffuser)\n", c->all.delta_e);
    g_print("largest    %.4f\n", c->largest);
    tell_worst("view", a->layout->views.theta_deg, a->layout->views.phi_deg, c->views, c->n_views);
    tell_worst("light", a->layout->lights.theta_deg, a->layout->lights.phi_deg, c->lights,
               c->n_lights);
    if (compare->plot)
        g_print("\nplot       %s\n", compare->plot);
}

/* In columns of characters, not of bytes. */
static void tell_point(const struct plot_point *point, double raw, gboolean first) {
    const int series = SERIES - (int)g_utf8_strlen(point->series, -1);
    const int label = LABEL - (int)g_utf8_strlen(point->label, -1);
    g_print("%s%s%*s %s%*s 1:%-8.4g %7.3f %%\n", first ? "\n" : "", point->series, MAX(series, 0),
            "", point->label, MAX(label, 0), "", raw / point->bytes, 100 * point->error);
}

static void tell_curve(const struct compare *compare) {
    const double raw = (double)material_info(compare->of_a)->bytes;
    GVariantBuilder builder, list;
    g_variant_builder_init(&list, G_VARIANT_TYPE("aa{sv}"));
    for (guint i = 0; i < compare->points->len; i++) {
        const struct plot_point *point = &g_array_index(compare->points, struct plot_point, i);
        g_variant_builder_open(&list, G_VARIANT_TYPE_VARDICT);
        g_variant_builder_add(&list, "{sv}", "series", g_variant_new_string(point->series));
        g_variant_builder_add(&list, "{sv}", "label", g_variant_new_string(point->label));
        cli_compare_add_double(&list, "bytes", point->bytes);
        cli_compare_add_double(&list, "ratio", raw / point->bytes);
        cli_compare_add_double(&list, "error", point->error);
        g_variant_builder_close(&list);
        if (!cli_json)
            tell_point(point, raw, i == 0);
    }
    g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&builder, "{sv}", "plot", g_variant_new_string(compare->curve));
    g_variant_builder_add(&builder, "{sv}", "points", g_variant_builder_end(&list));
    g_autoptr(GVariant) value = g_variant_ref_sink(g_variant_builder_end(&builder));
    if (cli_json)
        cli_print_json(value);
    else
        g_print("plot %s\n", compare->curve);
}

/* Renderings of two materials. */
static int run_pictures(const char *a, const char *b) {
    g_autoptr(GError) error = NULL;
    struct picture_comparison found;
    if (!compare_pictures(a, b, &found, &error))
        return cli_fail(error);
    if (cli_json) {
        GVariantBuilder builder;
        g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
        g_variant_builder_add(&builder, "{sv}", "a", g_variant_new_string(a));
        g_variant_builder_add(&builder, "{sv}", "b", g_variant_new_string(b));
        cli_compare_add_double(&builder, "delta_e", found.delta_e);
        cli_compare_add_double(&builder, "delta_e_different", found.delta_e_different);
        cli_compare_add_double(&builder, "delta_e_p95", found.p95);
        cli_compare_add_double(&builder, "delta_e_largest", found.largest);
        cli_compare_add_double(&builder, "different", found.different);
        cli_print_json(g_variant_builder_end(&builder));
        return CLI_DONE;
    }
    g_print("ΔE         %.3f on average (CIEDE2000), %.3f where they differ (%.1f %% of %d × "
            "%d pixels)\n",
            found.delta_e, found.delta_e_different, 100 * found.different, found.width,
            found.height);
    g_print("           there 95 %% below %.3f, %.3f at most\n", found.p95, found.largest);
    return CLI_DONE;
}

static char *plot_option, *curve_option;
static const GOptionEntry entries[] = {
    {"plot", 'p', 0, G_OPTION_ARG_FILENAME, &plot_option,
     "Draw errors of views and lights into this .svg or .png", "FILE"},
    {"curve", 'c', 0, G_OPTION_ARG_FILENAME, &curve_option,
     "Compress a session with every model and several sizes, and draw error against size", "FILE"},
    {NULL},
};

static int cli_compare_run(const struct command *command, int argc, char **argv) {
    g_autoptr(GError) error = NULL;
    double seconds = 0;
    if (!cli_parse(command, entries, FALSE, &argc, &argv, 1, 2))
        return CLI_USAGE;
    if (curve_option ? argc != 2 || plot_option : argc != 3)
        return cli_usage(command, "two materials are compared; --curve is of one session");
    if (!curve_option && compare_is_picture(argv[1]) && compare_is_picture(argv[2])) {
        if (plot_option)
            return cli_usage(command, "--plot is of materials, not of pictures");
        return run_pictures(argv[1], argv[2]);
    }
    struct compare compare = {argv[1], argv[2], plot_option, curve_option};
    const gboolean ok =
        cli_work_run(curve_option ? work_curve : work_compare, &compare, &seconds, &error);
    if (ok && curve_option)
        tell_curve(&compare);
    else if (ok)
        cli_compare_tell(&compare);
    material_free(compare.of_a);
    material_free(compare.of_b);
    comparison_free(compare.comparison);
    curve_free(compare.points);
    return ok ? CLI_DONE : cli_fail(error);
}

const struct command cli_compare = {.name = "compare",
                                    .arguments = "A B | DIR --curve FILE",
                                    .help = "Compare two materials, or all models of one.",
                                    .run_arguments = cli_compare_run};
