/* compare: the difference between two forms of a material, or the errors of every codec. */
#include "base/data_error.h"
#include "btf/btf_sigma.h"
#include "codecs/codecs.h"
#include "common/cli.h"
#include "common/plot.h"
#include "common/work.h"
#include "curve.h"
#include "formats/compare_pictures.h"
#include "materials.h"

#include <math.h>

#define WORST  5  /* number of worst views and lights in the text */
#define SERIES 24 /* maximum length of a model's name */
#define LABEL  14 /* maximum length of the label of a size */

static char *plot_option, *curve_option;

struct compare {
    const char *a, *b;
    OutputFile *plot; /* NULL if none */
    /* found */
    Material *of_a, *of_b;
    struct comparison *comparison;
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

static gboolean draw_curve(const struct compare *compare, const char *name, GError **error) {
    const char *path = output_file_path(compare->plot, error);
    return path &&
           output_file_end(compare->plot,
                           plot_curve(path, name, (double)material_info(compare->of_a)->bytes,
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
                    "%s: --curve needs a session directory with a BTF", compare->a);
        return FALSE;
    }
    compare->points = curve_measure(btf, work, error);
    return compare->points && draw_curve(compare, btf->name, error);
}

static void add_sums(Record *to, const struct compare_sums *sums) {
    record_double(to, "error", sums->error);
    record_double(to, "luminance_error", sums->luminance_error);
    record_double(to, "delta_e", sums->delta_e);
}

static int by_error(gconstpointer a, gconstpointer b, gpointer data) {
    const struct compare_sums *sums = data;
    const double x = sums[*(const int *)a].error, y = sums[*(const int *)b].error;
    return (x < y) - (x > y);
}

/* Adds all of them to the record. The text names the worst and the best. */
static void tell_directions(Record *to, const char *what, const float *theta_deg,
                            const float *phi_deg, struct compare_sums *sums, int n) {
    g_autofree char *key = g_strconcat(what, "s", NULL);
    g_autofree int *order = g_new(int, n);
    record_begin_list(to, key);
    for (int i = 0; i < n; i++) {
        order[i] = i;
        record_begin(to, NULL);
        record_double(to, "theta_deg", (double)theta_deg[i]);
        record_double(to, "phi_deg", (double)phi_deg[i]);
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
            record_say(to, "%8d %6.1f° %6.1f° %8.2f %% %11.4f %6.2f\n", at, (double)theta_deg[at],
                       (double)phi_deg[at], 100 * sums[at].error, sums[at].luminance_error,
                       sums[at].delta_e);
    }
}

/* Reports the difference that the error bars predict, √(Σ σ_A² + Σ σ_B²) / ‖A‖, and its share of
 * the squared difference. B has error bars only if it is also a session. */
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
    record_double(to, "sigma", sqrt(share));
    record_double(to, "sigma_part", part);
    if (known > 0)
        record_say(to,
                   "error bars %.3f %% RMS of R, G, B%s: they explain %.0f %% of the difference's "
                   "square\n",
                   100 * sqrt(share), known < lights ? " where known" : "", 100 * MIN(part, 1));
    else
        record_say(to, "error bars not known\n");
}

static void cli_compare_tell(Record *to, const struct compare *compare) {
    const struct material_info *a = material_info(compare->of_a), *b = material_info(compare->of_b);
    const struct comparison *c = compare->comparison;
    g_autofree char *size_a = g_format_size((guint64)a->bytes);
    g_autofree char *size_b = g_format_size((guint64)b->bytes);
    record_string(to, "a", compare->a);
    record_string(to, "b", compare->b);
    record_string(to, "a_kind", a->kind);
    record_string(to, "b_kind", b->kind);
    record_int(to, "a_bytes", a->bytes);
    record_int(to, "b_bytes", b->bytes);
    add_sums(to, &c->all);
    record_double(to, "largest", c->largest);
    record_say(to, "A          %s, %s, %s\n", a->label, a->kind, size_a);
    record_say(to, "B          %s, %s, %s, 1:%.3g\n", b->label, b->kind, size_b,
               (double)a->bytes / (double)b->bytes);
    record_say(to, "error      %.3f %% (RMS of R, G, B relative to A)\n", 100 * c->all.error);
    record_say(to, "luminance  off by %.5f on average\n", c->all.luminance_error);
    record_say(to, "ΔE         %.3f on average (CIEDE2000, white is the diffuser)\n",
               c->all.delta_e);
    record_say(to, "largest    %.4f\n", c->largest);
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
    const double raw = (double)material_info(compare->of_a)->bytes;
    record_string(to, "plot", curve_option);
    record_begin_list(to, "points");
    for (guint i = 0; i < compare->points->len; i++) {
        const struct plot_point *point = &g_array_index(compare->points, struct plot_point, i);
        /* The width counts characters, not bytes. */
        const int series = SERIES - (int)g_utf8_strlen(point->series, -1);
        const int label = LABEL - (int)g_utf8_strlen(point->label, -1);
        record_begin(to, NULL);
        record_string(to, "series", point->series);
        record_string(to, "label", point->label);
        record_double(to, "bytes", point->bytes);
        record_double(to, "ratio", raw / point->bytes);
        record_double(to, "error", point->error);
        record_end(to);
        record_say(to, "%s%s%*s %s%*s 1:%-8.4g %7.3f %%\n", i == 0 ? "\n" : "", point->series,
                   MAX(series, 0), "", point->label, MAX(label, 0), "", raw / point->bytes,
                   100 * point->error);
    }
    record_end(to);
    record_say(to, "plot %s\n", curve_option);
    cli_tell_output(to, compare->plot);
}

/* Compares renderings of two materials. */
static int run_pictures(Record *to, const char *a, const char *b, GError **error) {
    struct picture_comparison found;
    if (!compare_pictures(a, b, &found, error))
        return CLI_FAILED;
    record_string(to, "a", a);
    record_string(to, "b", b);
    record_double(to, "delta_e", found.delta_e);
    record_double(to, "delta_e_different", found.delta_e_different);
    record_double(to, "delta_e_p95", found.p95);
    record_double(to, "delta_e_largest", found.largest);
    record_double(to, "different", found.different);
    record_say(to,
               "ΔE         %.3f on average (CIEDE2000), %.3f where they differ (%.1f %% of %d × %d "
               "pixels)\n           there 95 %% below %.3f, %.3f at most\n",
               found.delta_e, found.delta_e_different, 100 * found.different, found.width,
               found.height, found.p95, found.largest);
    return CLI_DONE;
}

static const GOptionEntry entries[] = {
    {"plot", 'p', 0, G_OPTION_ARG_FILENAME, &plot_option,
     "Draw errors of views and lights into this .svg or .png", "FILE"},
    {"curve", 0, 0, G_OPTION_ARG_FILENAME, &curve_option,
     "Compress a session with every model and several sizes, and draw error against size", "FILE"},
    {NULL},
};

static int cli_compare_run(const struct call *call, GError **error) {
    const char *a = call->arguments[0], *b = call->arguments[1];
    if (curve_option ? b || plot_option : !b)
        return cli_usage(call->command,
                         "give two materials to compare, or one session with --curve FILE");
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
    struct compare compare = {a, b, plot};
    const gboolean ok =
        cli_work_run(curve_option ? work_curve : work_compare, &compare, NULL, error);
    if (ok)
        (curve_option ? tell_curve : cli_compare_tell)(call->record, &compare);
    material_free(compare.of_a);
    material_free(compare.of_b);
    comparison_free(compare.comparison);
    curve_free(compare.points);
    return ok ? CLI_DONE : CLI_FAILED;
}

const struct command cli_compare = {
    .name = "compare",
    .arguments = "A B | DIR --curve FILE",
    .examples = "  mesorig compare weave.session weave.session/products/lpca.exr\n"
                "  mesorig compare weave.session --curve curve.svg\n",
    .help = "Compare two materials, or all models of one.",
    .options = entries,
    .writes = TRUE,
    .min = 1,
    .max = 2,
    .run = cli_compare_run};
