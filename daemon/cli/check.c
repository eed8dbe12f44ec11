/* check: whether what was measured can be: energy, reciprocity, views that agree on the surface. */
#include "check.h"
#include "base/data_error.h"
#include "cli.h"
#include "mdf/mdf_views.h"
#include "session/session.h"
#include "work.h"

struct check {
    const char *path, *plot;
    int texel;
    /* found */
    struct btf_matrix *btf;
    struct energy *energy;
    gboolean has_mdf;
    struct mdf_views_sums mdf;
};

static gboolean check_btf(struct check *check, const struct work *work, GError **error) {
    check->btf = btf_matrix_read_within(G_GINT64_CONSTANT(1) << 30, check->path, work, error);
    if (!check->btf)
        return FALSE;
    check->energy = energy_compute(check->btf, check->texel, error);
    return check->energy &&
           (!check->plot || plot_energy(check->plot, check->btf, check->energy, error));
}

static gboolean cli_check_work(const struct work *work, gpointer data, GError **error) {
    struct check *check = data;
    g_autofree char *btf = g_build_filename(check->path, "products", "btf", NULL);
    g_autofree char *mdf = g_build_filename(check->path, "products", "mdf.exr", NULL);
    gboolean has_btf = g_file_test(btf, G_FILE_TEST_IS_DIR);
    check->has_mdf = g_file_test(mdf, G_FILE_TEST_IS_REGULAR);
    if (!has_btf && !check->has_mdf) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INCOMPLETE,
                    "%s: there is neither products/btf nor products/mdf.exr; `mesorig process %s` "
                    "makes them",
                    check->path, check->path);
        return FALSE;
    }
    if (has_btf && !check_btf(check, work, error))
        return FALSE;
    return !check->has_mdf ||
           (session_check_product(mdf, error) && mdf_views_check(mdf, &check->mdf, error));
}

static void cli_check_add_double(GVariantBuilder *to, const char *name, double value) {
    g_variant_builder_add(to, "{sv}", name, g_variant_new_double(value));
}

static void cli_check_add_int(GVariantBuilder *to, const char *name, gint64 value) {
    g_variant_builder_add(to, "{sv}", name, g_variant_new_int64(value));
}

static void add_series(GVariantBuilder *to, const char *name, const double *values, int n) {
    g_variant_builder_add(
        to, "{sv}", name,
        g_variant_new_fixed_array(G_VARIANT_TYPE_DOUBLE, values, (gsize)n, sizeof *values));
}

static void cli_check_tell_json(const struct check *check) {
    const struct energy *e = check->energy;
    GVariantBuilder builder;
    g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
    if (e) {
        cli_check_add_int(&builder, "holes", check->btf->holes);
        cli_check_add_int(&builder, "lower_bounds", check->btf->bounds);
        cli_check_add_int(&builder, "shorter_exposures", check->btf->shorter);
        cli_check_add_int(&builder, "predicted", check->btf->predicted);
        add_series(&builder, "e_r", e->e_r, e->n_views);
        add_series(&builder, "e_i", e->e_i, e->n_lights);
        cli_check_add_int(&builder, "texel", e->texel);
        add_series(&builder, "texel_e_r", e->texel_e_r, e->n_views);
        add_series(&builder, "texel_e_i", e->texel_e_i, e->n_lights);
        add_series(&builder, "albedo", e->albedo, e->n_lights);
        cli_check_add_double(&builder, "largest_albedo", e->largest_albedo);
        cli_check_add_int(&builder, "reciprocal_pairs", e->pairs);
        cli_check_add_double(&builder, "asymmetry", e->asymmetry);
        cli_check_add_double(&builder, "texel_asymmetry", e->texel_asymmetry);
    }
    if (check->has_mdf) {
        cli_check_add_int(&builder, "mdf_views", check->mdf.n_views);
        cli_check_add_int(&builder, "mdf_texels", check->mdf.texels);
        cli_check_add_int(&builder, "mdf_seen", check->mdf.seen);
        cli_check_add_int(&builder, "mdf_confirmed", check->mdf.confirmed);
        cli_check_add_int(&builder, "mdf_refuted", check->mdf.refuted);
        cli_check_add_int(&builder, "mdf_unknown", check->mdf.unknown);
        cli_check_add_double(&builder, "mdf_denied_share", check->mdf.denied_share);
        cli_check_add_int(&builder, "line_sweeps", check->mdf.lines.sweeps);
        cli_check_add_int(&builder, "lines_found", check->mdf.lines.found);
        cli_check_add_int(&builder, "lines_disagree", check->mdf.lines.disagree);
    }
    cli_print_json(g_variant_builder_end(&builder));
}

static double percent(gint64 n, gint64 of) {
    return of > 0 ? 100 * (double)n / (double)of : 0;
}

static void tell_energy(const struct check *check) {
    const struct energy *e = check->energy;
    double least = G_MAXDOUBLE;
    for (int l = 0; l < e->n_lights; l++)
        least = MIN(least, e->albedo[l]);
    g_print("energy       %.3f … %.3f of a light's energy come back%s (views to %.0f°)\n", least,
            e->largest_albedo, e->largest_albedo > 1 ? ": more than there is" : "", e->covered_deg);
    if (e->pairs == 0)
        g_print("reciprocity  no light stood where a view was, and the other way round\n");
    else
        g_print("reciprocity  %.2f %% RMS between B(v, l) / cos l and B(l, v) / cos v, of the mean "
                "over texels, %d pairs; %.2f %% texel by texel\n",
                100 * e->asymmetry, e->pairs, 100 * e->texel_asymmetry);
}

/* Of the values of all texels, views and lights. */
static void cli_check_tell_marks(const struct btf_matrix *btf) {
    const gint64 all = (gint64)btf->width * btf->height * btf->n_views * btf->n_lights;
    g_print("marks        %.3g %% of the values are holes, %.3g %% lower bounds (saturated), %.3g "
            "%% from shorter exposures alone, %.3g %% not taken, made of other lights'\n",
            percent(btf->holes, all), percent(btf->bounds, all), percent(btf->shorter, all),
            percent(btf->predicted, all));
}

static void cli_check_tell(const struct check *check) {
    const struct mdf_views_sums *mdf = &check->mdf;
    if (cli_json) {
        cli_check_tell_json(check);
        return;
    }
    if (check->energy) {
        tell_energy(check);
        cli_check_tell_marks(check->btf);
    }
    if (check->has_mdf)
        g_print("surface      %.2f %% of what a view sees is confirmed by others, %.2f %% refuted, "
                "%.2f %% hidden from all of them; %.2f %% of their answers deny it\n",
                percent(mdf->confirmed, mdf->seen), percent(mdf->refuted, mdf->seen),
                percent(mdf->unknown, mdf->seen), 100 * mdf->denied_share);
    if (check->has_mdf && mdf->lines.found > 0)
        g_print("laser lines  seen beside the sample in %d of %d sweeps; %d contradict the "
                "calibration, by %+.4f° at most\n",
                mdf->lines.found, mdf->lines.sweeps, mdf->lines.disagree, mdf->lines.worst_deg);
    if (check->plot && check->energy)
        g_print("plot         %s\n", check->plot);
}

static char *plot_option;
static int texel_option = -1;
static const GOptionEntry entries[] = {
    {"plot", 'p', 0, G_OPTION_ARG_FILENAME, &plot_option,
     "Draw the energy of each view and light into this .svg or .png", "FILE"},
    {"texel", 't', 0, G_OPTION_ARG_INT, &texel_option,
     "The texel that is drawn, counted row by row (the middle)", "N"},
    {NULL},
};

static int cli_check_run(const struct command *command, int argc, char **argv) {
    g_autoptr(GError) error = NULL;
    double seconds = 0;
    if (!cli_parse(command, entries, FALSE, &argc, &argv, 1, 1))
        return CLI_USAGE;
    struct check check = {.path = argv[1], .plot = plot_option, .texel = texel_option};
    gboolean ok = cli_work_run(cli_check_work, &check, &seconds, &error);
    if (ok)
        cli_check_tell(&check);
    btf_matrix_free(check.btf);
    energy_free(check.energy);
    return ok ? CLI_DONE : cli_fail(error);
}

const struct command cli_check = {
    .name = "check",
    .arguments = "DIR",
    .help = "Tell whether a session's BTF and MDF can be: energy, reciprocity, agreement.",
    .run_arguments = cli_check_run};
