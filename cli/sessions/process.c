#include "process.h"
#include "archive.h"
#include "base/data_error.h"
#include "base/plural.h"
#include "calibration/calibration.h"
#include "mdf/mdf_lines.h"
#include "pipeline/pipeline.h"
#include "sessions.h"

#include "common/cli.h"
#include "common/work.h"
#include "plan/report.h"
#include "rig/devices.h"

static void tell_lines(Record *to, const struct pipeline_result *result, gboolean calibrated) {
    if (result->line_sweeps == 0)
        return;
    if (result->lines_found == 0)
        record_say(to,
                   "laser planes: %s; no line was seen around the sample ([sample] flat_radius_mm "
                   "and flat_hole_mm give the face on which it is looked for)\n",
                   calibrated ? "by the calibration only"
                              : "nominal as in the rig file, because no laser is calibrated");
    else if (result->lines_disagree == 0)
        record_say(to,
                   "laser planes: lines around the sample in %d of %d sweeps agree with the "
                   "calibration, %.4f° RMS\n",
                   result->lines_found, result->line_sweeps, result->lines_rms_deg);
    else
        record_say(to,
                   "laser planes: in %d of %d sweeps with a line around the sample, the line "
                   "contradicts the calibration, by %+.3f° in laser position %d. The line was used "
                   "for these sweeps. Has a sweep slipped, or is the calibration old?\n",
                   result->lines_disagree, result->lines_found, result->lines_worst_deg,
                   result->line_worst_position);
    g_autofree char *warning = mdf_lines_warning(result->line_width, result->line_scatter);
    if (warning)
        record_say(to, "laser light: %s\n", warning);
}

static void tell_result(Record *to, const struct pipeline_result *result,
                        const struct calibration *calibration, double seconds) {
    record_say(to, "done in %g{:time}", seconds);
    record_say_if(to, result->n_views > 0, ": BTF of %d{views} %s × %d{lights} %s",
                  PLURAL(result->n_views, "view"), PLURAL(result->n_lights, "light"));
    record_add(to, "%d{predicted_pictures} %d{left_out_pictures}", result->n_predicted,
               result->n_left_out);
    if (result->n_left_out > 0)
        record_double(to, "prediction_error", result->prediction_error);
    record_add(to, "%d{mdf_views} %d{damaged_products} %g{eigenmaps_error}", result->n_mdf_views,
               result->n_damaged, result->eigenmaps_error);
    record_say_if(to, result->n_mdf_views > 0,
                  "%s MDF of %d %s with %.1f{mdf_coverage:%%} of the texels measured and "
                  "%.2f{mdf_predicted:%%} predicted by other views",
                  result->n_views > 0 ? "," : ":", PLURAL(result->n_mdf_views, "view"),
                  result->mdf_coverage, result->mdf_predicted);
    if (result->n_views > 0)
        record_say(
            to,
            ", eigen-maps with an error of %.2f{:%%} at the measured directions (mesorig compress "
            "makes closer files)",
            result->eigenmaps_error);
    record_say(to, "\n");
    record_add(to, "%d{line_sweeps} %d{lines_found} %d{lines_disagree}", result->line_sweeps,
               result->lines_found, result->lines_disagree);
    record_add(to,
               "%g{lines_rms_deg} %g{lines_worst_deg} %g{line_width} %g{line_scatter} %g{real_s}",
               result->lines_rms_deg, result->lines_worst_deg, result->line_width,
               result->line_scatter, seconds);
    if (result->n_damaged > 0)
        record_say(to, "%d %s damaged or gone, and %s been made again\n", result->n_damaged,
                   result->n_damaged == 1 ? "product was" : "products were",
                   result->n_damaged == 1 ? "has" : "have");
    const int n_pictures = result->n_views * result->n_lights;
    if (result->n_left_out > 0) {
        g_autofree char *some = result->n_used < n_pictures - result->n_left_out
                                    ? g_strdup_printf("%d of the", result->n_used)
                                    : NULL;
        record_say(to,
                   "%d of the BTF's %d pictures were left out by the capture: they were predicted "
                   "from %s others and marked, with an expected error of %.2f{:%%} of the BTF\n",
                   result->n_left_out, n_pictures, some ? some : "all", result->prediction_error);
    }
    if (result->n_predicted > result->n_left_out)
        record_say(to,
                   "%d of the BTF's %d pictures were left out by the plan: they were predicted "
                   "from the pictures of the lights around them, and marked\n",
                   result->n_predicted - result->n_left_out, n_pictures);
    tell_lines(to, result, calibration->parts[CALIBRATION_LASER].done);
}

/* Prints the calibration with which the products were made, and returns it. If told is TRUE, the
 * session's own calibration has already been printed. It is then printed again only if some
 * products may have been made with another one. Returns NULL with an error on failure. */
static struct calibration *tell_calibration(Record *to, const char *directory, gboolean told,
                                            GError **error) {
    g_autoptr(Session) session = session_open(directory, SESSION_READ, error);
    struct archive_calibration with = {0};
    struct calibration *calibration = session ? archive_calibration(session, &with, error) : NULL;
    record_say_if(to, !told || !with.own || with.mixed, "calibration: %s{calibration}\n",
                  with.said);
    archive_calibration_clear(&with);
    return calibration;
}

struct process {
    const char *directory;
    /* The calibration to use instead of that of the session: its text, and the path from which the
     * text is. Both are NULL if the session's calibration is used. */
    const char *calibration, *path;
    gboolean follow, lines_in_pictures, plain_merge, told;
    struct pipeline_result result;
    GPtrArray *causes; /* of char *: why little was measured */
};

static gboolean run_pipeline(const struct work *work, gpointer data, GError **error) {
    struct process *process = data;
    g_autoptr(Session) session = session_open(process->directory, SESSION_READ, error);
    g_autofree char *imported = session ? session_value(session, "imported") : NULL;
    if (imported)
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "%s: the session was imported from %s as a finished BTF, so there is nothing "
                    "to process",
                    process->directory, imported);
    if (!session || imported)
        return FALSE;
    g_clear_pointer(&session, session_close);
    const struct pipeline_options options = {
        .follow = process->follow,
        .n_eigenmaps = 4,
        .calibration = process->calibration,
        .calibration_path = process->path,
        .lines_in_pictures = process->lines_in_pictures,
        .plain_merge = process->plain_merge,
        .causes = process->causes,
        .work = *work,
    };
    return pipeline_run(process->directory, &options, &process->result, error);
}

static int run_process(struct process *process, Record *to, GError **error) {
    g_autoptr(GPtrArray) causes = process->causes = g_ptr_array_new_with_free_func(g_free);
    double seconds = 0;
    if (!cli_work_run(run_pipeline, process, &seconds, error))
        return CLI_FAILED;
    g_autoptr(Calibration) calibration =
        tell_calibration(to, process->directory, process->told, error);
    if (!calibration)
        return CLI_FAILED;
    tell_result(to, &process->result, calibration, seconds);
    record_say_strings(to, "causes", "", causes);
    return CLI_DONE;
}

int process_session(const char *directory, gboolean told, Record *to, GError **error) {
    struct process process = {.directory = directory, .told = told};
    return run_process(&process, to, error);
}

/* Returns the text of a calibration file. If path is “nominal”, returns the geometry and light of
 * the rig file with which the session was captured. */
static char *read_calibration(const char *directory, const char *path, GError **error) {
    if (!g_str_equal(path, "nominal")) {
        g_autoptr(Calibration) calibration = calibration_read(path, error);
        return calibration ? calibration_to_text(calibration) : NULL;
    }
    g_autoptr(Session) session = session_open(directory, SESSION_READ, error);
    g_autofree char *conf = session ? session_text(session, "rig.conf", error) : NULL;
    g_autofree char *name = session ? session_file(session, "session.db (rig.conf)") : NULL;
    struct rig rig;
    return conf && devices_parse_geometry(conf, name, &rig, error) ? rig_to_text(&rig) : NULL;
}

static gboolean follow_option;
static char *calibration_option, *lines_option, *merge_option;
static const GOptionEntry entries[] = {
    {"follow", 'f', 0, G_OPTION_ARG_NONE, &follow_option,
     "Process the frames of a capture until it ends", NULL},
    {"calibration", 'c', 0, G_OPTION_ARG_FILENAME, &calibration_option,
     "Use this calibration instead of that of the session; “nominal” uses the positions in the rig "
     "file",
     "FILE"},
    {"laser-lines", 0, 0, G_OPTION_ARG_STRING, &lines_option,
     "Find laser lines by the peak of each pixel, or in each picture for comparison, which needs "
     "keep_laser_frames in the session (peaks)",
     "peaks|pictures"},
    {"merge", 0, 0, G_OPTION_ARG_STRING, &merge_option,
     "Merge the laser positions without outliers, or by the plain mean for comparison (robust)",
     "robust|mean"},
    {NULL},
};

static int run(const struct call *call, GError **error) {
    const char *directory = call->arguments[0];
    const gboolean pictures = g_strcmp0(lines_option, "pictures") == 0;
    if (lines_option && !pictures && !g_str_equal(lines_option, "peaks"))
        return cli_usage(call->command,
                         "there is no --laser-lines=%s; choose from: peaks, pictures",
                         lines_option);
    const gboolean mean = g_strcmp0(merge_option, "mean") == 0;
    if (merge_option && !mean && !g_str_equal(merge_option, "robust"))
        return cli_usage(call->command, "there is no --merge=%s; choose from: robust, mean",
                         merge_option);
    g_autofree char *calibration =
        calibration_option ? read_calibration(directory, calibration_option, error) : NULL;
    if (calibration_option && !calibration)
        return CLI_FAILED;
    g_autofree char *path = !calibration_option || g_str_equal(calibration_option, "nominal")
                                ? g_strdup("nominal")
                                : g_canonicalize_filename(calibration_option, NULL);
    struct process process = {directory, calibration, path, follow_option, pictures, mean};
    return run_process(&process, call->record, error);
}

const struct command cli_process = {.name = "process",
                                    .arguments = "DIR",
                                    .examples =
                                        "  mesorig process weave.session\n"
                                        "  mesorig process weave.session -c better.calibration\n",
                                    .help = "Compute the BTF, the MDF and eigen-maps of a session.",
                                    .options = entries,
                                    .streams = TRUE,
                                    .min = 1,
                                    .max = 1,
                                    .run = run};
