#include "preparer_private.h"

#include "base/program.h"
#include "bus_errors.h"

#include <gio/gio.h>
#include <signal.h>
#include <string.h>
#include <unistd.h>

#define GIB (G_GUINT64_CONSTANT(1) << 30)

const struct preparer_limits preparer_default_limits[PREPARER_TASKS] = {
    [PREPARER_CHECK] = {.cpu_s = 120, .wall_s = 300, .memory_bytes = 2 * GIB},
    [PREPARER_BEGIN] = {.cpu_s = 120, .wall_s = 300, .memory_bytes = 2 * GIB},
    [PREPARER_EXAMINE] = {.cpu_s = 3600, .wall_s = 7200, .memory_bytes = 2 * GIB},
};

static const char *const doing[PREPARER_TASKS] = {
    [PREPARER_CHECK] = "checking and planning the session",
    [PREPARER_BEGIN] = "planning and making the session",
    [PREPARER_EXAMINE] = "examining the session",
};

struct child {
    GSubprocess *process;
    enum preparer_task task;
    struct preparer_limits limits;
    guint deadline_id;
    gboolean late;
};

static void child_free(gpointer data) {
    struct child *child = data;
    g_clear_handle_id(&child->deadline_id, g_source_remove);
    g_clear_object(&child->process);
    g_free(child);
}

/* Returns the path of the running program mesorigd. If another program runs this code (a test),
 * returns the path of the installed mesorigd. /proc/self/exe still leads to the running program if
 * another version has replaced its file. */
static char *find_program(GError **error) {
    g_autofree char *self = g_file_read_link("/proc/self/exe", NULL);
    g_autofree char *name = self ? g_path_get_basename(self) : NULL;
    if (name && (g_str_equal(name, "mesorigd") || g_str_has_prefix(name, "mesorigd (deleted")))
        return g_strdup("/proc/self/exe");
    return program_find("mesorigd", error);
}

static GVariant *bytes_of(gconstpointer data, gsize size) {
    return g_variant_new_fixed_array(G_VARIANT_TYPE_BYTE, data, size, 1);
}

static GBytes *request_bytes(const struct preparer_request *request) {
    const struct devices *devices = request->devices;
    const char *calibration =
        request->calibration ? request->calibration : devices->calibration_path;
    g_autoptr(GVariant) variant = g_variant_ref_sink(
        g_variant_new(PREPARER_REQUEST, MESORIG_VERSION, (gint32)getpid(), (gint32)request->task,
                      request->limits.cpu_s, request->limits.memory_bytes,
                      bytes_of(&devices->geometry, sizeof devices->geometry),
                      bytes_of(&devices->timing, sizeof devices->timing), devices->text,
                      devices->path, calibration ? calibration : "", devices->calibration_days,
                      request->session_path ? request->session_path : "", request->directory,
                      request->session_text ? request->session_text : "",
                      request->calibration_text ? request->calibration_text : "",
                      request->chosen ? request->chosen : "",
                      bytes_of(request->caller, request->caller ? sizeof *request->caller : 0)));
    return g_variant_get_data_as_bytes(variant);
}

static void report_end(const struct child *child, GError **error) {
    const char *what = doing[child->task];
    const int signal = g_subprocess_get_if_signaled(child->process)
                           ? g_subprocess_get_term_sig(child->process)
                           : 0;
    g_autofree char *memory =
        g_format_size_full(child->limits.memory_bytes, G_FORMAT_SIZE_IEC_UNITS);
    if (child->late)
        g_set_error(
            error, BUS_ERROR, BUS_ERROR_LIMIT,
            "%s took longer than the limit of %u s: give a smaller session, or check that the "
            "disk with its files is not too slow",
            what, child->limits.wall_s);
    else if (signal == SIGXCPU)
        g_set_error(
            error, BUS_ERROR, BUS_ERROR_LIMIT,
            "%s took more than its limit of %u s of computing time: give a session with fewer "
            "directions",
            what, child->limits.cpu_s);
    else if (signal)
        g_set_error(error, BUS_ERROR, BUS_ERROR_LIMIT,
                    "%s ended by signal %d (%s): most likely it needed more than its limit of %s "
                    "of memory; "
                    "give a smaller session, or fewer directions",
                    what, signal, g_strsignal(signal), memory);
    else
        g_set_error(error, BUS_ERROR, BUS_ERROR_FAILED,
                    "%s failed without an answer (exit code %d): see mesorigd's messages", what,
                    g_subprocess_get_exit_status(child->process));
}

static GVariant *read_answer(GBytes *bytes, GError **error) {
    g_autoptr(GVariant) answer =
        g_variant_ref_sink(g_variant_new_from_bytes(G_VARIANT_TYPE(PREPARER_ANSWER), bytes, FALSE));
    const char *domain, *message;
    gint32 code;
    g_autoptr(GVariant) result = NULL;
    g_variant_get(answer, "(&si&sv)", &domain, &code, &message, &result);
    if (!*domain)
        return g_steal_pointer(&result);
    g_set_error_literal(error, g_quark_from_string(domain), code, message);
    return NULL;
}

static void on_end(GObject *source, GAsyncResult *result, gpointer data) {
    g_autoptr(GTask) task = data;
    struct child *child = g_task_get_task_data(task);
    g_autoptr(GBytes) bytes = NULL;
    GError *error = NULL;
    g_clear_handle_id(&child->deadline_id, g_source_remove);
    const gboolean heard =
        g_subprocess_communicate_finish(G_SUBPROCESS(source), result, &bytes, NULL, &error);
    if (!heard)
        g_subprocess_force_exit(child->process);
    if (g_error_matches(error, G_IO_ERROR, G_IO_ERROR_CANCELLED)) {
        g_task_return_error(task, error);
        return;
    }
    /* This error may be a broken pipe, because the child has not read the whole request. The errors
     * below say more. */
    g_clear_error(&error);
    GVariant *answer = NULL;
    if (heard && g_subprocess_get_successful(child->process))
        answer = read_answer(bytes, &error);
    else if (heard)
        report_end(child, &error);
    else
        g_set_error(&error, BUS_ERROR, BUS_ERROR_FAILED,
                    "%s failed: mesorigd's child process did not read the request or gave no "
                    "answer; see mesorigd's messages, then try again",
                    doing[child->task]);
    if (answer)
        g_task_return_pointer(task, answer, (GDestroyNotify)g_variant_unref);
    else
        g_task_return_error(task, error);
}

static gboolean on_deadline(gpointer data) {
    struct child *child = data;
    child->deadline_id = 0;
    child->late = TRUE;
    g_subprocess_force_exit(child->process);
    return G_SOURCE_REMOVE;
}

void preparer_run(const struct preparer_request *request, GCancellable *cancellable,
                  GAsyncReadyCallback callback, gpointer data) {
    GTask *task = g_task_new(NULL, cancellable, callback, data);
    GError *error = NULL;
    /* The child inherits all descriptors and closes them itself. Otherwise GLib would close them in
     * a fork of this process, which takes long for a large process. */
    const GSubprocessFlags flags = G_SUBPROCESS_FLAGS_STDIN_PIPE | G_SUBPROCESS_FLAGS_STDOUT_PIPE |
                                   G_SUBPROCESS_FLAGS_INHERIT_FDS;
    g_autofree char *program = find_program(&error);
    g_autoptr(GSubprocess) process =
        program ? g_subprocess_new(flags, &error, program, "--prepare", NULL) : NULL;
    if (!process) {
        g_task_return_error(task, error);
        g_object_unref(task);
        return;
    }
    struct child *child = g_new0(struct child, 1);
    child->process = g_object_ref(process);
    child->task = request->task;
    child->limits = request->limits;
    child->deadline_id = g_timeout_add_seconds(child->limits.wall_s, on_deadline, child);
    g_task_set_task_data(task, child, child_free);
    g_autoptr(GBytes) bytes = request_bytes(request);
    g_subprocess_communicate_async(process, bytes, cancellable, on_end, task);
}

GVariant *preparer_finish(GAsyncResult *result, GError **error) {
    return g_task_propagate_pointer(G_TASK(result), error);
}
