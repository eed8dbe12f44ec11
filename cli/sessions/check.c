/* check: checks whether a measurement is plausible. It compares energy, reciprocity, and whether
 * the views agree on the surface. */
#include "check.h"
#include "base/data_error.h"
#include "base/plural.h"
#include "btf/btf_sigma.h"
#include "capture/exposure_advice.h"
#include "common/cli.h"
#include "common/work.h"
#include "mdf/mdf_views.h"
#include "session/session.h"
#include "sessions.h"

#include <gio/gio.h>

static char *plot_option;

/* Returns whether the folder contains views. If a session has only sweeps, the folder exists
 * without views. */
static gboolean has_views(const char *folder) {
    g_autoptr(GDir) names = g_dir_open(folder, 0, NULL);
    const char *name;
    while (names && (name = g_dir_read_name(names)))
        if (g_str_has_prefix(name, "view_"))
            return TRUE;
    return FALSE;
}

static gboolean draw(const struct check *check, GError **error) {
    const char *path = output_file_path(check->plot, error);
    return path &&
           output_file_end(check->plot, plot_energy(path, check->btf, check->energy, error), error);
}

gboolean check_session(const struct work *work, gpointer data, GError **error) {
    struct check *check = data;
    g_autofree char *btf = g_build_filename(check->path, "products", "btf", NULL);
    g_autofree char *mdf = g_build_filename(check->path, "products", "mdf.exr", NULL);
    const gboolean has_btf = has_views(btf);
    check->has_mdf = g_file_test(mdf, G_FILE_TEST_IS_REGULAR);
    if (!has_btf && !check->has_mdf) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INCOMPLETE,
                    "%s: there is neither products/btf nor products/mdf.exr; `mesorig process %s` "
                    "makes them",
                    check->path, check->path);
        return FALSE;
    }
    g_autoptr(Session) session = session_open(check->path, SESSION_READ, error);
    if (!session)
        return FALSE;
    session_suspicions(session, check->suspicions);
    if (has_btf) {
        check->btf = btf_matrix_read_within(G_GINT64_CONSTANT(1) << 30, check->path, work, error);
        check->energy = check->btf ? energy_compute(check->btf, -1, error) : NULL;
        if (!check->energy || (check->plot && !draw(check, error)) ||
            !check_directions(check->btf, &check->directions, work, error) ||
            !check_suspect_btf(check->btf, check->energy, check->suspicions, error))
            return FALSE;
        const struct btf_layout *layout = &check->btf->layout;
        const gint64 all = btf_layout_texels(layout) * (gint64)(layout->views.n * layout->lights.n);
        check->exposures = exposure_advice(
            session, (double)(check->btf->shorter + check->btf->bounds) / (double)all);
    }
    prediction_product_read(session, &check->predicted);
    if (!check->has_mdf)
        return TRUE;
    struct session_grid grid;
    if (!session_check_product(mdf, error) || !mdf_views_check(mdf, &check->mdf, error) ||
        !session_grid(session, &grid, error))
        return FALSE;
    check_suspect_mdf(&check->mdf, &grid, check->suspicions);
    return TRUE;
}

void check_clear(struct check *check) {
    btf_matrix_free(check->btf);
    energy_free(check->energy);
    g_free(check->exposures);
    g_ptr_array_unref(check->suspicions);
}

static double percent(gint64 n, gint64 of) {
    return of > 0 ? 100 * (double)n / (double)of : 0;
}

static void tell_energy(Record *to, const struct energy *e) {
    double least = G_MAXDOUBLE;
    for (int l = 0; l < e->n_lights; l++)
        least = MIN(least, e->albedo[l]);
    record_doubles(to, "e_r", e->e_r, e->n_views);
    record_doubles(to, "e_i", e->e_i, e->n_lights);
    record_int(to, "texel", e->texel);
    record_doubles(to, "texel_e_r", e->texel_e_r, e->n_views);
    record_doubles(to, "texel_e_i", e->texel_e_i, e->n_lights);
    record_doubles(to, "albedo", e->albedo, e->n_lights);
    record_say(to, "energy       %.3f … %.3f{largest_albedo} of a light's energy is reflected%s",
               least, e->largest_albedo, e->largest_albedo > 1 ? ": more than arrives" : "");
    if (e->n_views == 1)
        record_say(to, " (from one view, taken for all)\n");
    else
        record_say(to, " (views to %.0f°)\n", e->covered_deg);
    record_int(to, "reciprocal_pairs", e->pairs);
    record_say_if(
        to, e->pairs > 0,
        "reciprocity  %.2f{asymmetry:%%} RMS between B(v, l) / cos l and B(l, v) / cos v, "
        "of the mean over texels, %d pairs; %.2f{texel_asymmetry:%%} texel by texel\n",
        e->asymmetry, e->pairs, e->texel_asymmetry);
    record_say_if(to, e->pairs == 0, "reciprocity  no pair of directions was measured both ways\n");
}

static void tell_directions(Record *to, const struct check_directions *found) {
    if (found->views == 0 && found->lights == 0)
        return;
    record_say(
        to,
        "directions   %.2f{interpolation_error:%%} RMS error of %d %s and %d %s, interpolated "
        "from the others\n",
        found->error, PLURAL(found->views, "view"), PLURAL(found->lights, "light"));
    record_add(to, "%d{interpolated_views} %d{interpolated_lights}", found->views, found->lights);
}

static void tell_surface(Record *to, const struct mdf_views_sums *mdf) {
    record_add(to,
               "%d{mdf_views} %" G_GINT64_FORMAT "{mdf_texels} %" G_GINT64_FORMAT
               "{mdf_seen} %" G_GINT64_FORMAT "{mdf_confirmed} %" G_GINT64_FORMAT
               "{mdf_refuted} %" G_GINT64_FORMAT "{mdf_unknown}",
               mdf->n_views, mdf->texels, mdf->seen, mdf->confirmed, mdf->refuted, mdf->unknown);
    record_say(
        to,
        "surface      %.2f %% of what a view sees is confirmed by others, %.2f %% refuted, "
        "%.2f %% hidden from all of them; %.2f{mdf_denied_share:%%} of all answers of other views "
        "contradict the view\n",
        percent(mdf->confirmed, mdf->seen), percent(mdf->refuted, mdf->seen),
        percent(mdf->unknown, mdf->seen), mdf->denied_share);
    record_int(to, "line_sweeps", mdf->lines.sweeps);
    record_say_if(to, mdf->lines.found > 0,
                  "laser lines  seen next to the sample in %d{lines_found} of %d sweeps; "
                  "%d{lines_disagree} contradict the calibration, by %+.4f° at most\n",
                  mdf->lines.found, mdf->lines.sweeps, mdf->lines.disagree, mdf->lines.worst_deg);
    record_add(to, "%g{line_width} %g{line_scatter}", mdf->lines.width, mdf->lines.scatter);
    g_autofree char *warning = mdf_lines_warning(mdf->lines.width, mdf->lines.scatter);
    if (warning)
        record_say(to, "laser light  %s\n", warning);
}

/* Reports the error bars. too_long is advice to change the exposures that was printed before, or
 * NULL. After such advice, longer exposures are not suggested. */
static void tell_sigma(Record *to, const char *path, const char *too_long) {
    struct btf_sigma_sums sigma;
    btf_sigma_sum(path, &sigma);
    record_int(to, "sigma_known", sigma.known);
    record_say_if(to, sigma.known > 0,
                  "error bars   median σ %.4g{sigma_median}, %.2f{sigma_relative:%%} of a value\n",
                  sigma.median, sigma.relative);
    record_int(to, "sigma_large", sigma.large);
    record_double(to, "sigma_worst", sigma.worst);
    if (sigma.known == 0) {
        record_say(
            to, "error bars   not known: the noise of the session's cameras is not calibrated\n");
        return;
    }
    record_int(to, "sigma_worse", sigma.worse);
    /* If most pictures have large error bars, this is told without a warning, because it is so in
     * every session of a fine structure. */
    if (2 * sigma.large > sigma.known)
        record_say(to,
                   "  in %d of %d pictures σ is more than %.0f %% of the value at half of the "
                   "texels or more: %s reduce noise, more pixels per texel reduce the error at "
                   "edges\n",
                   sigma.large, sigma.known, 100 * BTF_SIGMA_LARGE,
                   too_long ? "other exposures (above)" : "longer exposures");
    if (sigma.worse > 0)
        record_say(to,
                   "  warning: in %d of %d pictures σ is more than twice what it is in most with "
                   "the same polar angles; in the worst of them, it is more than %.1f %% of the "
                   "value at half of the texels (view %.1f° %.1f°, light %.1f° %.1f°): look at the "
                   "exposures of these pictures and at that lamp\n",
                   sigma.worse, sigma.known, 100 * sigma.worse_relative, sigma.worse_view_theta_deg,
                   sigma.worse_view_phi_deg, sigma.worse_light_theta_deg,
                   sigma.worse_light_phi_deg);
}

static void tell(Record *to, const struct check *check) {
    const struct btf_matrix *btf = check->btf;
    if (check->energy) {
        const gint64 all =
            btf_layout_texels(&btf->layout) * btf->layout.views.n * btf->layout.lights.n;
        record_add(to,
                   "%" G_GINT64_FORMAT "{holes} %" G_GINT64_FORMAT
                   "{lower_bounds} %" G_GINT64_FORMAT "{shorter_exposures} %" G_GINT64_FORMAT
                   "{predicted}",
                   btf->holes, btf->bounds, btf->shorter, btf->predicted);
        tell_energy(to, check->energy);
        tell_directions(to, &check->directions);
        record_say(
            to,
            "flags        %.3g %% of the values are holes, %.3g %% lower bounds (saturated), "
            "%.3g %% only from shorter exposures, %.3g %% not taken: predicted from the pictures "
            "of other lights\n",
            percent(btf->holes, all), percent(btf->bounds, all), percent(btf->shorter, all),
            percent(btf->predicted, all));
        if (check->predicted.left_out > 0)
            record_say(
                to,
                "predicted    %d{left_out_pictures} of %d pictures, left out by the capture; "
                "expected error %.2f{prediction_error:%%} of the BTF\n",
                check->predicted.left_out, check->predicted.pictures, check->predicted.error);
        record_say_if(to, check->exposures != NULL, "exposures    %s{exposures}\n",
                      check->exposures);
        tell_sigma(to, check->path, check->exposures);
    }
    if (check->has_mdf)
        tell_surface(to, &check->mdf);
    record_say_strings(to, "suspicions", "suspect      ", check->suspicions);
    if (check->plot && check->energy) {
        record_say(to, "plot         %s\n", plot_option);
        cli_tell_output(to, check->plot);
    }
}

static gboolean strict;
static const GOptionEntry entries[] = {
    {"plot", 'p', 0, G_OPTION_ARG_FILENAME, &plot_option,
     "Draw the reflected energy by view and by light (.svg or .png)", "FILE"},
    {"strict", 0, 0, G_OPTION_ARG_NONE, &strict, "Exit with code 1 if something is suspect", NULL},
    {NULL},
};

static int run(const struct call *call, GError **error) {
    struct check check = {.path = call->arguments[0],
                          .suspicions = g_ptr_array_new_with_free_func(g_free)};
    g_autoptr(OutputFile) plot = plot_option ? cli_output(plot_option, "plot", error) : NULL;
    check.plot = plot;
    const gboolean ok = (!plot_option || plot) && cli_work_run(check_session, &check, NULL, error);
    const gboolean suspect = check.suspicions->len > 0;
    if (ok)
        tell(call->record, &check);
    check_clear(&check);
    return ok && !(strict && suspect) ? CLI_DONE : CLI_FAILED;
}

const struct command cli_check = {
    .name = "check",
    .arguments = "DIR",
    .examples = "  mesorig check weave.session --plot energy.svg\n"
                "  mesorig check weave.session --strict && mesorig compress weave.session\n",
    .help = "Check whether the BTF and MDF of a session are plausible. Looks at energy, "
            "reciprocity, and the agreement of views.",
    .options = entries,
    .writes = TRUE,
    .min = 1,
    .max = 1,
    .run = run};
