#include "mesorig_process.h"

#include "mesorig_cli.h"
#include "mesorig_work.h"
#include "processing/session.h"
#include "report.h"

static void tell_result(const struct pipeline_result *result, double seconds) {
    if (cli_json) {
        GVariantBuilder builder;
        g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
        g_variant_builder_add(&builder, "{sv}", "views", g_variant_new_int32(result->n_views));
        g_variant_builder_add(&builder, "{sv}", "lights", g_variant_new_int32(result->n_lights));
        g_variant_builder_add(&builder, "{sv}", "mdf_views",
                              g_variant_new_int32(result->n_mdf_views));
        g_variant_builder_add(&builder, "{sv}", "eigenmaps_error",
                              g_variant_new_double(result->eigenmaps_error));
        g_variant_builder_add(&builder, "{sv}", "mdf_coverage",
                              g_variant_new_double(result->mdf_coverage));
        g_variant_builder_add(&builder, "{sv}", "real_s", g_variant_new_double(seconds));
        cli_print_json(g_variant_builder_end(&builder));
        return;
    }
    g_autofree char *time = report_duration(seconds);
    g_print("done in %s: BTF of %d views × %d lights, MDF of %d views with %.1f %% of the texels, "
            "eigen-maps with an error of %.2f %%\n",
            time, result->n_views, result->n_lights, result->n_mdf_views,
            100 * result->mdf_coverage, 100 * result->eigenmaps_error);
}

struct process {
    const char *directory;
    gboolean follow;
    struct pipeline_result result;
};

static gboolean run_pipeline(PipelineFunc progress, gpointer progress_data,
                             GCancellable *cancellable, gpointer data, GError **error) {
    struct process *process = data;
    g_autoptr(Session) session = session_open(process->directory, SESSION_READ, error);
    g_autofree char *imported = session ? session_value(session, "imported") : NULL;
    if (imported)
        g_set_error(error, PIPELINE_ERROR, PIPELINE_ERROR_DATA,
                    "%s: it was imported from %s as a finished BTF; there is nothing to process",
                    process->directory, imported);
    if (!session || imported)
        return FALSE;
    g_clear_pointer(&session, session_close);
    const struct pipeline_options options = {
        .follow = process->follow,
        .n_eigenmaps = 4,
        .progress = progress,
        .data = progress_data,
        .cancellable = cancellable,
    };
    return pipeline_run(process->directory, &options, &process->result, error);
}

int process_run(const char *directory, gboolean follow) {
    g_autoptr(GError) error = NULL;
    struct process process = {.directory = directory, .follow = follow};
    double seconds = 0;
    if (!work_run(run_pipeline, &process, &seconds, &error))
        return cli_fail(error);
    tell_result(&process.result, seconds);
    return CLI_DONE;
}

static gboolean follow_option;
static const GOptionEntry entries[] = {
    {"follow", 'f', 0, G_OPTION_ARG_NONE, &follow_option, "Wait for frames until the capture ends",
     NULL},
    {NULL},
};

static int run(const struct command *command, int argc, char **argv) {
    if (!cli_parse(command, entries, FALSE, &argc, &argv, 1, 1))
        return CLI_USAGE;
    return process_run(argv[1], follow_option);
}

const struct command cli_process = {"process", "DIR", "Make BTF, MDF and eigen-maps of a session.",
                                    run};
