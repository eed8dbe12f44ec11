#include "bus_trial.h"

#include "base/program.h"
#include "bus_errors.h"

#include <gio/gio.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

/* Time limit of the child process in seconds, in case it hangs. Every single wait in the child has
 * a shorter deadline. */
#define TRIAL_S 1800
#define PREFIX  "mesorig: "
/* The exit code of “mesorig queue try” when a device has failed. */
#define EXIT_RIG 3

struct bus_trial {
    BusTrialFunc func;
    gpointer data;
    GSubprocess *process;
    GCancellable *cancellable;
    guint deadline_id;
};

/* Returns the child's messages, without the program's name before each line. */
static char *strip_said(const char *text) {
    g_auto(GStrv) lines = g_strsplit(text ? text : "", "\n", -1);
    g_autoptr(GString) to = g_string_new(NULL);
    for (char **line = lines; *line; line++) {
        const char *own = *line + (g_str_has_prefix(*line, PREFIX) ? strlen(PREFIX) : 0);
        if (*own)
            g_string_append_printf(to, "%s%s", to->len ? "\n" : "", own);
    }
    return g_utf8_make_valid(to->str, -1);
}

static void on_trial_end(GObject *source, GAsyncResult *result, gpointer data) {
    g_autofree char *chosen = NULL, *text = NULL;
    g_autoptr(GError) error = NULL;
    const gboolean heard =
        g_subprocess_communicate_utf8_finish(G_SUBPROCESS(source), result, &chosen, &text, &error);
    if (g_error_matches(error, G_IO_ERROR, G_IO_ERROR_CANCELLED))
        return; /* the trial no longer exists */
    struct bus_trial *trial = data;
    const gboolean late = trial->deadline_id == 0; /* on_trial_deadline() has ended it */
    const gboolean exited = heard && g_subprocess_get_if_exited(trial->process);
    const int code = exited ? g_subprocess_get_exit_status(trial->process) : -1;
    g_autofree char *said = strip_said(text);
    if (code != 0 && !*said) {
        g_free(said);
        said = late
                   ? g_strdup_printf("“mesorig queue try”, which takes the test shots, did not end "
                                     "within %d s",
                                     TRIAL_S)
                   : g_strdup_printf("“mesorig queue try”, which takes the test shots, ended "
                                     "without a message%s%s",
                                     error ? ": " : "", error ? error->message : "");
    }
    trial->func(chosen ? chosen : "", said,
                code == 0          ? BUS_TRIAL_DONE
                : code == EXIT_RIG ? BUS_TRIAL_RIG
                                   : BUS_TRIAL_SESSION,
                trial->data);
}

static gboolean on_trial_deadline(gpointer data) {
    struct bus_trial *trial = data;
    trial->deadline_id = 0;
    g_subprocess_force_exit(trial->process);
    return G_SOURCE_REMOVE;
}

/* Returns the request in the form that cli/captures/queue_try.c reads. Free it with
 * g_free(). */
static char *trial_request(const struct queue_item *item) {
    g_autoptr(GKeyFile) request = g_key_file_new();
    g_key_file_set_string(request, "try", "session", item->session_path);
    g_key_file_set_string(request, "try", "session_text", item->session_text);
    g_key_file_set_string(request, "try", "calibration", item->calibration);
    g_key_file_set_string(request, "try", "calibration_text", item->calibration_text);
    g_key_file_set_string(request, "try", "chosen", item->chosen);
    g_key_file_set_boolean(request, "try", "yes", item->yes);
    return g_key_file_to_data(request, NULL, NULL);
}

/* Returns a descriptor of an unnamed file that contains the text, positioned at its beginning.
 * Returns −1 if there is no memory.
 *
 * The text is not written to a pipe. If the program ended before it had read all of the text,
 * writing to the pipe would fail, and the answer of the program would be lost. */
static int trial_input(const char *text) {
    const int fd = memfd_create("mesorig-trial", MFD_CLOEXEC);
    const int copy = fd >= 0 ? dup(fd) : -1;
    FILE *file = copy >= 0 ? fdopen(copy, "w") : NULL;
    const gboolean written = file && fputs(text, file) >= 0 && fflush(file) == 0;
    if (file)
        fclose(file);
    else if (copy >= 0)
        close(copy);
    if (written && lseek(fd, 0, SEEK_SET) == 0)
        return fd;
    if (fd >= 0)
        close(fd);
    return -1;
}

struct bus_trial *bus_trial_start(const char *address, const struct queue_item *item,
                                  BusTrialFunc func, gpointer data, GError **error) {
    const gboolean on_bus = g_str_equal(address, "system") || g_str_equal(address, "session");
    g_autofree char *program = program_find("mesorig", error);
    if (!program)
        return NULL;
    g_autofree char *text = trial_request(item);
    const int input = trial_input(text);
    if (input < 0) {
        g_set_error(error, BUS_ERROR, BUS_ERROR_LIMIT,
                    "mesorigd has no memory for the input of “%s queue try”: end other programs on "
                    "its computer",
                    program);
        return NULL;
    }
    g_autoptr(GSubprocessLauncher) launcher =
        g_subprocess_launcher_new(G_SUBPROCESS_FLAGS_STDOUT_PIPE | G_SUBPROCESS_FLAGS_STDERR_PIPE);
    g_subprocess_launcher_take_stdin_fd(launcher, input);
    GSubprocess *process = g_subprocess_launcher_spawn(
        launcher, error, program, "queue", "try", on_bus ? "--bus" : "--address", address, NULL);
    if (!process)
        return NULL;
    struct bus_trial *trial = g_new0(struct bus_trial, 1);
    trial->func = func;
    trial->data = data;
    trial->process = process;
    trial->cancellable = g_cancellable_new();
    trial->deadline_id = g_timeout_add_seconds(TRIAL_S, on_trial_deadline, trial);
    g_subprocess_communicate_utf8_async(process, NULL, trial->cancellable, on_trial_end, trial);
    return trial;
}

void bus_trial_free(struct bus_trial *trial) {
    if (!trial)
        return;
    g_cancellable_cancel(trial->cancellable);
    g_subprocess_force_exit(trial->process);
    g_clear_handle_id(&trial->deadline_id, g_source_remove);
    g_object_unref(trial->cancellable);
    g_object_unref(trial->process);
    g_free(trial);
}
