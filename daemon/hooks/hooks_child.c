#include "hooks_child.h"

#include <errno.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#define KILL_S 3
#define CHUNK  4096
/* Seconds to wait for further output after the program has ended. A process that the program has
 * left behind may hold the pipe open. */
#define DRAIN_S 1

struct child {
    GTask *task;
    GSubprocess *process;
    GCancellable *reading;
    char *name;
    pid_t group;
    double time_limit_s;
    guint limit_id, kill_id, drain_id;
    gulong cancel_id;
    gboolean late, exited, drained;
    guint8 chunk[CHUNK];
    GString *line;
    gsize printed, dropped;
};

static void child_free(gpointer data) {
    struct child *child = data;
    g_clear_handle_id(&child->limit_id, g_source_remove);
    g_clear_handle_id(&child->kill_id, g_source_remove);
    g_clear_handle_id(&child->drain_id, g_source_remove);
    g_clear_object(&child->process);
    g_object_unref(child->reading);
    g_string_free(child->line, TRUE);
    g_free(child->name);
    g_free(child);
}

/* Sends a signal to the program and to all processes in its group. */
static void child_kill(const struct child *child, int signal) {
    if (child->group > 1)
        kill(-child->group, signal);
}

static void print_line(struct child *child) {
    g_autofree char *valid = g_utf8_make_valid(child->line->str, (gssize)child->line->len);
    if (child->line->len)
        g_message("%s: %s", child->name, valid);
    g_string_truncate(child->line, 0);
}

static void take_output(struct child *child, gsize n) {
    const gsize room = HOOKS_CHILD_MAX_OUTPUT - MIN(child->printed, HOOKS_CHILD_MAX_OUTPUT);
    const gsize taken = MIN(n, room);
    child->printed += taken;
    child->dropped += n - taken;
    for (gsize i = 0; i < taken; i++)
        if (child->chunk[i] == '\n')
            print_line(child);
        else
            g_string_append_c(child->line, (char)child->chunk[i]);
}

/* Runs between fork and exec. Makes a process group, so that the program and the processes that it
 * starts can be ended together. data is memory that is shared with the parent, for the number of
 * the group. The parent needs the number even after the program has ended, because the program may
 * have left processes behind. GSubprocess does not give the number of a program that has ended. */
static void prepare_child(gpointer data) {
    pid_t *group = data;
    setpgid(0, 0);
    *group = getpid();
    signal(SIGPIPE, SIG_DFL);
}

static void finish_if_done(struct child *child) {
    if (!child->exited || !child->drained)
        return;
    g_autoptr(GTask) task = g_steal_pointer(&child->task);
    print_line(child);
    if (child->dropped)
        g_message("%s: %" G_GSIZE_FORMAT " further bytes of its output were dropped", child->name,
                  child->dropped);
    if (child->cancel_id)
        g_cancellable_disconnect(g_task_get_cancellable(task), child->cancel_id);
    if (child->late)
        g_task_return_new_error(task, G_IO_ERROR, G_IO_ERROR_TIMED_OUT,
                                "%s took longer than its time limit of %g s, and was ended; "
                                "time_limit_s in hooks.conf sets the limit",
                                child->name, child->time_limit_s);
    else if (g_subprocess_get_if_signaled(child->process))
        g_task_return_new_error(
            task, G_IO_ERROR, G_IO_ERROR_FAILED,
            "%s ended by signal %d (%s); what it has printed is in the log above", child->name,
            g_subprocess_get_term_sig(child->process),
            g_strsignal(g_subprocess_get_term_sig(child->process)));
    else if (g_subprocess_get_exit_status(child->process) != 0)
        g_task_return_new_error(
            task, G_IO_ERROR, G_IO_ERROR_FAILED,
            "%s failed with exit code %d; what it has printed is in the log above", child->name,
            g_subprocess_get_exit_status(child->process));
    else
        g_task_return_boolean(task, TRUE);
}

static void on_output(GObject *source, GAsyncResult *result, gpointer data) {
    struct child *child = data;
    const gssize n = g_input_stream_read_finish(G_INPUT_STREAM(source), result, NULL);
    if (n > 0) {
        take_output(child, (gsize)n);
        g_input_stream_read_async(G_INPUT_STREAM(source), child->chunk, CHUNK, G_PRIORITY_DEFAULT,
                                  child->reading, on_output, child);
        return;
    }
    child->drained = TRUE;
    finish_if_done(child);
}

static gboolean on_drain(gpointer data) {
    struct child *child = data;
    child->drain_id = 0;
    g_cancellable_cancel(child->reading);
    return G_SOURCE_REMOVE;
}

static void on_exit_of_child(GObject *source, GAsyncResult *result, gpointer data) {
    struct child *child = data;
    g_subprocess_wait_finish(G_SUBPROCESS(source), result, NULL);
    child_kill(child, SIGKILL); /* ends the processes that the program has left behind */
    child->exited = TRUE;
    g_clear_handle_id(&child->limit_id, g_source_remove);
    g_clear_handle_id(&child->kill_id, g_source_remove);
    child->drain_id = g_timeout_add_seconds(DRAIN_S, on_drain, child);
    finish_if_done(child);
}

static gboolean on_kill(gpointer data) {
    struct child *child = data;
    child->kill_id = 0;
    child_kill(child, SIGKILL);
    g_subprocess_force_exit(child->process);
    return G_SOURCE_REMOVE;
}

static gboolean on_limit(gpointer data) {
    struct child *child = data;
    child->limit_id = 0;
    child->late = TRUE;
    child_kill(child, SIGTERM);
    child->kill_id = g_timeout_add_seconds(KILL_S, on_kill, child);
    return G_SOURCE_REMOVE;
}

static void on_cancelled(GCancellable *cancellable, gpointer data) {
    struct child *child = data;
    child_kill(child, SIGKILL);
    g_subprocess_force_exit(child->process);
}

static void on_input_written(GObject *source, GAsyncResult *result, gpointer data) {
    g_output_stream_write_all_finish(G_OUTPUT_STREAM(source), result, NULL, NULL);
    g_output_stream_close_async(G_OUTPUT_STREAM(source), G_PRIORITY_DEFAULT, NULL, NULL, NULL);
    g_free(data);
}

void hooks_child_run(const char *const *argv, const char *const *environ, const char *input,
                     double time_limit_s, GCancellable *cancellable, GAsyncReadyCallback callback,
                     gpointer data) {
    GTask *task = g_task_new(NULL, cancellable, callback, data);
    g_autoptr(GSubprocessLauncher) launcher =
        g_subprocess_launcher_new(G_SUBPROCESS_FLAGS_STDIN_PIPE | G_SUBPROCESS_FLAGS_STDOUT_PIPE |
                                  G_SUBPROCESS_FLAGS_STDERR_MERGE);
    GError *error = NULL;
    if (environ)
        g_subprocess_launcher_set_environ(launcher, (char **)environ);
    pid_t *group =
        mmap(NULL, sizeof *group, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (group == MAP_FAILED) {
        g_task_return_new_error(task, G_IO_ERROR, (int)g_io_error_from_errno(errno),
                                "%s cannot be started: %s; end other programs on this computer",
                                argv[0], g_strerror(errno));
        g_object_unref(task);
        return;
    }
    g_subprocess_launcher_set_child_setup(launcher, prepare_child, group, NULL);
    g_autoptr(GSubprocess) process = g_subprocess_launcher_spawnv(launcher, argv, &error);
    const pid_t child_group = *group;
    munmap(group, sizeof *group);
    if (!process) {
        g_task_return_error(task, error);
        g_object_unref(task);
        return;
    }
    struct child *child = g_new0(struct child, 1);
    child->task = task;
    child->process = g_object_ref(process);
    child->reading = g_cancellable_new();
    child->name = g_path_get_basename(argv[0]);
    child->group = child_group;
    child->time_limit_s = time_limit_s;
    child->line = g_string_new(NULL);
    g_task_set_task_data(task, child, child_free);
    child->limit_id = g_timeout_add((guint)(time_limit_s * 1000), on_limit, child);
    char *own_input = g_strdup(input);
    g_output_stream_write_all_async(g_subprocess_get_stdin_pipe(process), own_input,
                                    strlen(own_input), G_PRIORITY_DEFAULT, child->reading,
                                    on_input_written, own_input);
    g_input_stream_read_async(g_subprocess_get_stdout_pipe(process), child->chunk, CHUNK,
                              G_PRIORITY_DEFAULT, child->reading, on_output, child);
    g_subprocess_wait_async(process, NULL, on_exit_of_child, child);
    if (cancellable)
        child->cancel_id =
            g_cancellable_connect(cancellable, G_CALLBACK(on_cancelled), child, NULL);
}

gboolean hooks_child_finish(GAsyncResult *result, GError **error) {
    return g_task_propagate_boolean(G_TASK(result), error);
}
