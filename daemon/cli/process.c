#include "process.h"
#include "base/data_error.h"
#include "pipeline/pipeline.h"

#include "calibration/calibration.h"
#include "cli.h"
#include "plan/report.h"
#include "rig/devices.h"
#include "session/session.h"
#include "work.h"

static void tell_lines(const struct pipeline_result *result) {
    if (result->line_sweeps == 0)
        return;
    if (result->lines_found == 0)
        g_print("laser planes: by the calibration alone; no line was seen beside the sample "
                "([sample] flat_radius_mm and flat_hole_mm say where one could be)\n");
    else if (result->lines_disagree == 0)
        g_print("laser planes: lines beside the sample in %d of %d sweeps agree with the "
                "calibration, %.4f° RMS\n",
                result->lines_found, result->line_sweeps, result->lines_rms_deg);
    else
        g_print("laser planes: in %d of %d sweeps with a line beside the sample it contradicts the "
                "calibration, by %+.3f° in laser position %d; where they differ the line was "
                "believed. Has a sweep slipped, or is the calibration old?\n",
                result->lines_disagree, result->lines_found, result->lines_worst_deg,
                result->line_worst_position);
}

static void tell_result(const struct pipeline_result *result, double seconds) {
    if (cli_json) {
        GVariantBuilder builder;
        g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
        g_variant_builder_add(&builder, "{sv}", "views", g_variant_new_int32(result->n_views));
        g_variant_builder_add(&builder, "{sv}", "lights", g_variant_new_int32(result->n_lights));
        g_variant_builder_add(&builder, "{sv}", "predicted_pictures",
                              g_variant_new_int32(result->n_predicted));
        g_variant_builder_add(&builder, "{sv}", "mdf_views",
                              g_variant_new_int32(result->n_mdf_views));
        g_variant_builder_add(&builder, "{sv}", "damaged_products",
                              g_variant_new_int32(result->n_damaged));
        g_variant_builder_add(&builder, "{sv}", "eigenmaps_error",
                              g_variant_new_double(result->eigenmaps_error));
        g_variant_builder_add(&builder, "{sv}", "mdf_coverage",
                              g_variant_new_double(result->mdf_coverage));
        g_variant_builder_add(&builder, "{sv}", "mdf_predicted",
                              g_variant_new_double(result->mdf_predicted));
        g_variant_builder_add(&builder, "{sv}", "line_sweeps",
                              g_variant_new_int32(result->line_sweeps));
        g_variant_builder_add(&builder, "{sv}", "lines_found",
                              g_variant_new_int32(result->lines_found));
        g_variant_builder_add(&builder, "{sv}", "lines_disagree",
                              g_variant_new_int32(result->lines_disagree));
        g_variant_builder_add(&builder, "{sv}", "lines_rms_deg",
                              g_variant_new_double(result->lines_rms_deg));
        g_variant_builder_add(&builder, "{sv}", "lines_worst_deg",
                              g_variant_new_double(result->lines_worst_deg));
        g_variant_builder_add(&builder, "{sv}", "real_s", g_variant_new_double(seconds));
        cli_print_json(g_variant_builder_end(&builder));
        return;
    }
    g_autofree char *time = report_duration(seconds);
    g_print("done in %s: BTF of %d views × %d lights, MDF of %d views with %.1f %% of the texels "
            "measured and %.2f %% predicted by other views, eigen-maps with an error of %.2f %%\n",
            time, result->n_views, result->n_lights, result->n_mdf_views,
            100 * result->mdf_coverage, 100 * result->mdf_predicted, 100 * result->eigenmaps_error);
    if (result->n_damaged > 0)
        g_print("%d %s damaged or gone, and %s been made again\n", result->n_damaged,
                result->n_damaged == 1 ? "product was" : "products were",
                result->n_damaged == 1 ? "has" : "have");
    if (result->n_predicted > 0)
        g_print(
            "%d of the BTF's %d pictures were left out by the plan: made of those of the lights "
            "around them, and marked\n",
            result->n_predicted, result->n_views * result->n_lights);
    tell_lines(result);
}

struct process {
    const char *directory;
    char *calibration; /* text; NULL: the session's own */
    gboolean follow;
    struct pipeline_result result;
};

static gboolean run_pipeline(const struct work *work, gpointer data, GError **error) {
    struct process *process = data;
    g_autoptr(Session) session = session_open(process->directory, SESSION_READ, error);
    g_autofree char *imported = session ? session_value(session, "imported") : NULL;
    if (imported)
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "%s: it was imported from %s as a finished BTF; there is nothing to process",
                    process->directory, imported);
    if (!session || imported)
        return FALSE;
    g_clear_pointer(&session, session_close);
    const struct pipeline_options options = {
        .follow = process->follow,
        .n_eigenmaps = 4,
        .calibration = process->calibration,
        .work = *work,
    };
    return pipeline_run(process->directory, &options, &process->result, error);
}

static int run_process(struct process *process) {
    g_autoptr(GError) error = NULL;
    double seconds = 0;
    if (!cli_work_run(run_pipeline, process, &seconds, &error))
        return cli_fail(error);
    tell_result(&process->result, seconds);
    return CLI_DONE;
}

int process_run(const char *directory, gboolean follow) {
    struct process process = {.directory = directory, .follow = follow};
    return run_process(&process);
}

/* The geometry and light of the rig file that the session was captured with. */
static char *nominal_text(const char *directory, GError **error) {
    g_autoptr(Session) session = session_open(directory, SESSION_READ, error);
    g_autofree char *conf = session ? session_text(session, "rig.conf", error) : NULL;
    g_autofree char *path = session ? session_file(session, "session.db (rig.conf)") : NULL;
    struct rig rig;
    return conf && devices_parse_geometry(conf, path, &rig, error) ? rig_to_text(&rig) : NULL;
}

static char *read_text(const char *path, GError **error) {
    g_autoptr(Calibration) calibration = calibration_read(path, error);
    return calibration ? calibration_to_text(calibration) : NULL;
}

static gboolean follow_option;
static char *calibration_option;
static const GOptionEntry entries[] = {
    {"follow", 'f', 0, G_OPTION_ARG_NONE, &follow_option, "Wait for frames until the capture ends",
     NULL},
    {"calibration", 'c', 0, G_OPTION_ARG_FILENAME, &calibration_option,
     "Process with this calibration, not the one it was captured with; “nominal”: with none",
     "FILE"},
    {NULL},
};

static int cli_process_run(const struct command *command, int argc, char **argv) {
    if (!cli_parse(command, entries, FALSE, &argc, &argv, 1, 1))
        return CLI_USAGE;
    struct process process = {.directory = argv[1], .follow = follow_option};
    if (calibration_option) {
        g_autoptr(GError) error = NULL;
        process.calibration = g_str_equal(calibration_option, "nominal")
                                  ? nominal_text(argv[1], &error)
                                  : read_text(calibration_option, &error);
        if (!process.calibration)
            return cli_fail(error);
    }
    const int code = run_process(&process);
    g_free(process.calibration);
    return code;
}

const struct command cli_process = {.name = "process",
                                    .arguments = "DIR",
                                    .help = "Make BTF, MDF and eigen-maps of a session.",
                                    .run_arguments = cli_process_run};
