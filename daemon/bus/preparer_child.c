#include "preparer_private.h"

#include "capture/capture.h"
#include "capture/capture_calibration.h"
#include "plan/report.h"

#include <gio/gunixinputstream.h>
#include <gio/gunixoutputstream.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

#define NICE 10

struct prepare_work {
    gint32 parent, task;
    guint32 cpu_s;
    guint64 memory_bytes;
    struct devices devices; /* geometry, timing and texts of the rig; no device is open */
    char *text, *path, *calibration, *session_path, *directory, *session_text, *calibration_text;
    char *chosen;
    struct bus_caller caller;
    gboolean has_caller;
};

static gboolean take_bytes(GVariant *bytes, gpointer to, gsize size) {
    if (g_variant_get_size(bytes) != size)
        return FALSE;
    memcpy(to, g_variant_get_data(bytes), size);
    return TRUE;
}

/* Reads the request from standard input. Returns FALSE if the request cannot be read or comes from
 * a daemon of another version. */
static gboolean read_request(struct prepare_work *work) {
    g_autoptr(GInputStream) from = g_unix_input_stream_new(STDIN_FILENO, FALSE);
    g_autoptr(GOutputStream) to = g_memory_output_stream_new_resizable();
    const char *version;
    g_autoptr(GVariant) geometry = NULL, timing = NULL, caller = NULL;
    if (g_output_stream_splice(to, from, G_OUTPUT_STREAM_SPLICE_CLOSE_TARGET, NULL, NULL) < 0)
        return FALSE;
    g_autoptr(GBytes) bytes = g_memory_output_stream_steal_as_bytes(G_MEMORY_OUTPUT_STREAM(to));
    g_autoptr(GVariant) request = g_variant_ref_sink(
        g_variant_new_from_bytes(G_VARIANT_TYPE(PREPARER_REQUEST_TYPE), bytes, FALSE));
    if (!g_variant_is_normal_form(request))
        return FALSE;
    g_variant_get(request, "(&siiut@ay@ay^ay^ay^ayd^ay^ay^ay^ay^ay@ay)", &version, &work->parent,
                  &work->task, &work->cpu_s, &work->memory_bytes, &geometry, &timing, &work->text,
                  &work->path, &work->calibration, &work->devices.calibration_days,
                  &work->session_path, &work->directory, &work->session_text,
                  &work->calibration_text, &work->chosen, &caller);
    work->has_caller = g_variant_get_size(caller) > 0;
    work->devices.text = work->text;
    work->devices.path = work->path;
    work->devices.calibration_path = *work->calibration ? work->calibration : NULL;
    work->devices.calibration_text = *work->calibration_text ? work->calibration_text : NULL;
    return strcmp(version, MESORIG_VERSION) == 0 &&
           (!work->has_caller || take_bytes(caller, &work->caller, sizeof work->caller)) &&
           take_bytes(geometry, &work->devices.geometry, sizeof work->devices.geometry) &&
           take_bytes(timing, &work->devices.timing, sizeof work->devices.timing);
}

/* Sets a soft limit of this process, and a hard limit that is 5 s higher. When the process exceeds
 * the soft limit of CPU time, the kernel sends SIGXCPU, and the daemon reports that. At the hard
 * limit the kernel sends SIGKILL, which would not show the reason. */
static gboolean limit(int resource, guint64 value) {
    const struct rlimit rlimit = {value, resource == RLIMIT_CPU ? value + 5 : value};
    return setrlimit(resource, &rlimit) == 0;
}

/* Limits the address space of this process to its present size plus bytes. In a build with the
 * address sanitizer there is no limit, because the sanitizer reserves terabytes of address
 * space. */
static gboolean limit_memory(guint64 bytes) {
#ifdef __SANITIZE_ADDRESS__
    return bytes > 0;
#else
    g_autofree char *text = NULL;
    g_file_get_contents("/proc/self/statm", &text, NULL, NULL);
    const guint64 pages = text ? g_ascii_strtoull(text, NULL, 10) : 0;
    return limit(RLIMIT_AS, pages * (guint64)sysconf(_SC_PAGESIZE) + bytes);
#endif
}

/* Does the task of the request. Returns a floating result, or NULL with an error. */
static GVariant *do_work(const struct prepare_work *work, GError **error) {
    const struct devices *devices = &work->devices;
    g_auto(SessionConf) conf = {0};
    if (work->has_caller && *work->directory &&
        !bus_caller_may_write(&work->caller, work->directory, error))
        return NULL;
    if (work->task == PREPARER_EXAMINE) {
        g_autofree char *warning = NULL;
        if (!capture_examine(devices, work->directory, &warning, error))
            return NULL;
        return g_variant_new_string(warning ? warning : "");
    }
    if (!(*work->session_text
              ? session_conf_parse(&conf, work->session_text, work->session_path, error)
              : session_conf_load(&conf, work->session_path, error)))
        return NULL;
    if (work->task == PREPARER_BEGIN)
        return session_conf_choose(&conf, work->chosen, error) &&
                       capture_create(devices, &conf, work->directory, error)
                   ? g_variant_new_string("")
                   : NULL;
    g_autoptr(Plan) plan = *work->directory
                               ? capture_validate(devices, &conf, work->directory, error)
                               : plan_build(&conf, &devices->geometry, &devices->timing, error);
    if (!plan || !*work->directory)
        return plan ? report_plan(&conf, plan) : NULL;
    g_autoptr(GPtrArray) warnings = NULL;
    g_autoptr(Calibration) calibration = capture_calibration(devices, &warnings, error);
    return calibration ? report_plan(&conf, plan) : NULL;
}

int preparer_child(void) {
    struct prepare_work work = {0};
    g_autoptr(GError) error = NULL;
    close_range(STDERR_FILENO + 1, ~0U, 0);
    /* a copy of standard output, for the answer; libraries must not print into it */
    const int fd = dup(STDOUT_FILENO);
    setpriority(PRIO_PROCESS, 0, NICE);
    /* The child is killed when its parent ends (PR_SET_PDEATHSIG). Its time and its memory are
     * limited. */
    gboolean ok = fd >= 0 && dup2(STDERR_FILENO, STDOUT_FILENO) >= 0 && read_request(&work) &&
                  prctl(PR_SET_PDEATHSIG, SIGKILL) == 0 && getppid() == work.parent &&
                  limit(RLIMIT_CORE, 0) && limit(RLIMIT_CPU, work.cpu_s) &&
                  limit_memory(work.memory_bytes);
    if (ok) {
        GVariant *result = do_work(&work, &error);
        g_autofree char *message = g_utf8_make_valid(error ? error->message : "", -1);
        g_autoptr(GVariant) answer = g_variant_ref_sink(g_variant_new(
            PREPARER_ANSWER, error ? g_quark_to_string(error->domain) : "", error ? error->code : 0,
            message, result ? result : g_variant_new_string("")));
        g_autoptr(GOutputStream) to = g_unix_output_stream_new(fd, FALSE);
        ok = g_output_stream_write_all(to, g_variant_get_data(answer), g_variant_get_size(answer),
                                       NULL, NULL, NULL);
    } else {
        g_printerr("mesorigd: --prepare is an internal option, with which mesorigd starts itself: "
                   "leave it out\n");
    }
    g_free(work.text);
    g_free(work.path);
    g_free(work.calibration);
    g_free(work.session_path);
    g_free(work.chosen);
    g_free(work.directory);
    g_free(work.session_text);
    g_free(work.calibration_text);
    return ok ? 0 : 1;
}
