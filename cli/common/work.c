#include "work.h"

#include "cli.h"
#include "plan/report.h"
#include "progress.h"

#include <gio/gio.h>
#include <glib-unix.h>
#include <signal.h>
#include <time.h>

struct bar {
    Progress *progress;
    char *stage;
    int done, total;
    gint64 json_us, begun_us;
};

/* Returns the CPU time that the program has used in all its threads. */
static double cpu_s(void) {
    struct timespec now;
    return clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now) == 0
               ? (double)now.tv_sec + (double)now.tv_nsec / 1e9
               : 0;
}

static void bar_show(struct bar *bar, double left_s, gboolean now) {
    g_autofree char *left = left_s >= 0 ? report_duration(left_s) : NULL;
    g_autofree char *text = g_strdup_printf("%d/%d%s%s%s", bar->done, bar->total, left ? ", " : "",
                                            left ? left : "", left ? " left" : "");
    progress_show(bar->progress, (double)bar->done / bar->total, text, now);
}

/* Ends the bar. The line that stays on the terminal does not show the time left. */
static void bar_end(struct bar *bar) {
    if (bar->progress)
        bar_show(bar, -1, TRUE);
    g_clear_pointer(&bar->progress, progress_free);
    g_clear_pointer(&bar->stage, g_free);
}

static void on_progress(const struct work_progress *progress, gpointer data) {
    struct bar *bar = data;
    const gboolean next = g_strcmp0(progress->stage, bar->stage) != 0;
    /* The end of a stage is shown immediately. It is shown only once, because some work reports the
     * end again while the following work is running. */
    const gboolean ended =
        progress->done == progress->total && (next || progress->done != bar->done);
    if (cli_json) {
        const gint64 now_us = g_get_monotonic_time();
        g_free(bar->stage);
        bar->stage = g_strdup(progress->stage);
        bar->done = progress->done;
        if (!cli_streams || (!ended && now_us < bar->json_us + G_USEC_PER_SEC))
            return;
        bar->json_us = now_us;
        g_autoptr(Record) record = record_new();
        record_string(record, "stage", progress->stage);
        record_int(record, "done", progress->done);
        record_int(record, "total", progress->total);
        record_double(record, "left_s", progress->left_s);
        record_double(record, "real_s", (double)(now_us - bar->begun_us) / G_USEC_PER_SEC);
        record_double(record, "cpu_s", cpu_s());
        record_print(record, TRUE);
        return;
    }
    if (progress->total == 0)
        return; /* a stage with nothing to do */
    if (next) {
        bar_end(bar);
        g_autofree char *what = g_strdup_printf("%-9s", progress->stage);
        bar->progress = progress_new(what);
        bar->stage = g_strdup(progress->stage);
    }
    bar->done = progress->done;
    bar->total = progress->total;
    bar_show(bar, progress->left_s, ended);
}

/* Cancels the work. The work has no main loop, so a separate thread handles the signals. */
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

gboolean cli_work_run(CliWork func, gpointer data, double *ret_seconds, GError **error) {
    g_autoptr(GMainContext) context = g_main_context_new();
    g_autoptr(GMainLoop) loop = g_main_loop_new(context, FALSE);
    g_autoptr(GCancellable) cancellable = g_cancellable_new();
    const int numbers[] = {SIGINT, SIGTERM, SIGHUP};
    const gint64 begun_us = g_get_monotonic_time();
    struct bar bar = {.begun_us = begun_us};
    for (gsize i = 0; i < G_N_ELEMENTS(numbers); i++)
        attach(context, g_unix_signal_source_new(numbers[i]), on_signal, cancellable);
    GThread *thread = g_thread_new("signals", wait_for_signals, loop);
    const struct work work = {.progress = on_progress, .data = &bar, .cancellable = cancellable};
    const gboolean ok = func(&work, data, error);
    attach(context, g_idle_source_new(), quit_loop, loop);
    g_thread_join(thread);
    bar_end(&bar);
    if (ret_seconds)
        *ret_seconds = (double)(g_get_monotonic_time() - begun_us) / G_USEC_PER_SEC;
    return ok;
}

struct writing {
    OutputFile *to;
    CliWrite func;
    gpointer data;
};

static gboolean write_file(const struct work *work, gpointer data, GError **error) {
    const struct writing *writing = data;
    const char *path = output_file_path(writing->to, error);
    return path &&
           output_file_end(writing->to, writing->func(path, work, writing->data, error), error);
}

gboolean cli_work_write(OutputFile *to, CliWrite func, gpointer data, double *ret_seconds,
                        GError **error) {
    struct writing writing = {to, func, data};
    return cli_work_run(write_file, &writing, ret_seconds, error);
}
