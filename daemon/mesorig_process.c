#include "mesorig_process.h"

#include "mesorig_cli.h"
#include "mesorig_progress.h"
#include "processing/pipeline.h"
#include "report.h"

#include <glib-unix.h>
#include <signal.h>

struct work {
    Progress *progress;
    char *stage;
    gint64 begun_us, json_us;
};

static void print_json_progress(struct work *work, const struct pipeline_progress *progress) {
    const gint64 now_us = g_get_monotonic_time();
    GVariantBuilder builder;
    if (progress->done < progress->total && now_us < work->json_us + G_USEC_PER_SEC)
        return;
    work->json_us = now_us;
    g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&builder, "{sv}", "stage", g_variant_new_string(progress->stage));
    g_variant_builder_add(&builder, "{sv}", "done", g_variant_new_int32(progress->done));
    g_variant_builder_add(&builder, "{sv}", "total", g_variant_new_int32(progress->total));
    g_variant_builder_add(&builder, "{sv}", "left_s", g_variant_new_double(progress->left_s));
    cli_print_json(g_variant_builder_end(&builder));
}

static void on_progress(const struct pipeline_progress *progress, gpointer data) {
    struct work *work = data;
    if (cli_json) {
        print_json_progress(work, progress);
        return;
    }
    if (g_strcmp0(progress->stage, work->stage) != 0) {
        progress_free(work->progress);
        g_autofree char *what = g_strdup_printf("%-9s", progress->stage);
        work->progress = progress_new(what);
        g_free(work->stage);
        work->stage = g_strdup(progress->stage);
    }
    g_autoptr(GString) text = g_string_new(NULL);
    g_string_append_printf(text, "%d/%d", progress->done, progress->total);
    if (progress->left_s >= 0) {
        g_autofree char *left = report_duration(progress->left_s);
        g_string_append_printf(text, ", %s left", left);
    }
    const double fraction = progress->total > 0 ? (double)progress->done / progress->total : 0;
    progress_show(work->progress, fraction, text->str, progress->done == progress->total);
}

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

/* pipeline_run() has no main loop: the signals get a thread with one. */
static gboolean on_signal(gpointer cancellable) {
    g_cancellable_cancel(cancellable);
    return G_SOURCE_CONTINUE;
}

static gpointer wait_for_signals(gpointer loop) {
    g_main_loop_run(loop);
    return NULL;
}

static gboolean quit_loop(gpointer loop) {
    g_main_loop_quit(loop);
    return G_SOURCE_REMOVE;
}

static void attach(GMainContext *context, GSource *source, GSourceFunc func, gpointer data) {
    g_source_set_callback(source, func, data, NULL);
    g_source_attach(source, context);
    g_source_unref(source);
}

static gboolean run_pipeline(const char *directory, const struct pipeline_options *options,
                             struct pipeline_result *ret, GError **error) {
    g_autoptr(GMainContext) context = g_main_context_new();
    g_autoptr(GMainLoop) loop = g_main_loop_new(context, FALSE);
    const int numbers[] = {SIGINT, SIGTERM, SIGHUP};
    for (gsize i = 0; i < G_N_ELEMENTS(numbers); i++)
        attach(context, g_unix_signal_source_new(numbers[i]), on_signal, options->cancellable);
    GThread *thread = g_thread_new("signals", wait_for_signals, loop);
    const gboolean ok = pipeline_run(directory, options, ret, error);
    attach(context, g_idle_source_new(), quit_loop, loop);
    g_thread_join(thread);
    return ok;
}

int process_run(const char *directory, gboolean follow) {
    g_autoptr(GError) error = NULL;
    g_autoptr(GCancellable) cancellable = g_cancellable_new();
    struct work work = {.begun_us = g_get_monotonic_time()};
    const struct pipeline_options options = {
        .follow = follow,
        .n_eigenmaps = 4,
        .progress = on_progress,
        .data = &work,
        .cancellable = cancellable,
    };
    struct pipeline_result result = {0};
    const gboolean ok = run_pipeline(directory, &options, &result, &error);
    progress_free(work.progress);
    g_free(work.stage);
    if (!ok)
        return cli_fail(error);
    tell_result(&result, (double)(g_get_monotonic_time() - work.begun_us) / G_USEC_PER_SEC);
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
