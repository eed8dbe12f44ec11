#include "bus_authority.h"
#include "bus_errors.h"
#include "bus_private.h"
#include "plan/report.h"

#include <string.h>

/* Sessions that are checked at once, for all clients. */
#define MAX_CHECKS 4

struct bus_job {
    Bus *bus;                          /* NULL: stopped */
    GDBusMethodInvocation *invocation; /* NULL: answered */
    GCancellable *cancellable;
    enum preparer_task task;
    char *directory;
    gboolean process;
};

static void bus_jobs_fail(struct bus_job *job, GError *error) {
    g_dbus_method_invocation_take_error(g_steal_pointer(&job->invocation), bus_errors_wrap(error));
}

/* It is freed when its child has ended. */
static void bus_jobs_stop(Bus *bus, struct bus_job *job, const char *why) {
    g_ptr_array_remove(bus->jobs, job);
    job->bus = NULL;
    bus_jobs_fail(job, g_error_new_literal(BUS_ERROR, BUS_ERROR_CANCELLED, why));
    g_cancellable_cancel(job->cancellable);
}

static struct bus_job *find_beginning(Bus *bus) {
    for (guint i = 0; i < bus->jobs->len; i++) {
        struct bus_job *job = bus->jobs->pdata[i];
        if (job->task != PREPARER_CHECK)
            return job;
    }
    return NULL;
}

const char *bus_jobs_beginning(Bus *bus) {
    const struct bus_job *job = find_beginning(bus);
    return job ? job->directory : NULL;
}

gboolean bus_jobs_stop_begin(Bus *bus, const char *why) {
    struct bus_job *job = find_beginning(bus);
    if (job)
        bus_jobs_stop(bus, job, why);
    return job != NULL;
}

void bus_jobs_stop_all(Bus *bus, const char *why) {
    while (bus->jobs->len > 0)
        bus_jobs_stop(bus, bus->jobs->pdata[0], why);
}

void bus_jobs_stop_client(Bus *bus, GDBusConnection *connection) {
    for (guint i = bus->jobs->len; i-- > 0;) {
        struct bus_job *job = bus->jobs->pdata[i];
        if (g_dbus_method_invocation_get_connection(job->invocation) == connection)
            bus_jobs_stop(bus, job, "the client has gone");
    }
}

/* An invalid session is an answer; an invalid call is an error. */
static void answer_check(struct bus_job *job, GVariant *report, GError *error) {
    if (!report && error->domain == BUS_ERROR) {
        bus_jobs_fail(job, error);
        return;
    }
    g_autofree char *text = report ? report_text(report) : g_strdup(error->message);
    bus_rig1_complete_validate(job->bus->object, g_steal_pointer(&job->invocation), report != NULL,
                               text, report ? report : g_variant_new("a{sv}", NULL));
    g_clear_error(&error);
}

/* Emits property changes before the call is answered. */
static void answer_beginning(struct bus_job *job, GVariant *result, GError *error) {
    const gboolean resumed = job->task == PREPARER_EXAMINE;
    const char *warning = result ? g_variant_get_string(result, NULL) : "";
    if (!result || !bus_begin(job->bus, job->directory, resumed, *warning ? warning : NULL,
                              job->process, &error)) {
        bus_jobs_fail(job, error);
        return;
    }
    g_dbus_interface_skeleton_flush(G_DBUS_INTERFACE_SKELETON(job->bus->object));
    if (resumed)
        bus_rig1_complete_resume(job->bus->object, g_steal_pointer(&job->invocation));
    else
        bus_rig1_complete_start(job->bus->object, g_steal_pointer(&job->invocation));
}

static void on_prepared(GObject *source, GAsyncResult *result, gpointer data) {
    struct bus_job *job = data;
    GError *error = NULL;
    g_autoptr(GVariant) prepared = preparer_finish(result, &error);
    if (job->bus) {
        g_ptr_array_remove(job->bus->jobs, job);
        (job->task == PREPARER_CHECK ? answer_check : answer_beginning)(job, prepared, error);
    } else {
        g_clear_error(&error);
    }
    g_object_unref(job->cancellable);
    g_free(job->directory);
    g_free(job);
}

static struct bus_job *start_job(Bus *bus, GDBusMethodInvocation *invocation,
                                 struct preparer_request *request) {
    struct bus_job *job = g_new0(struct bus_job, 1);
    job->bus = bus;
    job->invocation = invocation;
    job->cancellable = g_cancellable_new();
    job->task = request->task;
    job->directory = g_strdup(request->directory);
    g_ptr_array_add(bus->jobs, job);
    request->devices = bus->devices;
    request->caller = bus_authority_caller(invocation);
    request->limits = bus->limits[request->task];
    preparer_run(request, job->cancellable, on_prepared, job);
    return job;
}

static gboolean may_check(Bus *bus, GDBusMethodInvocation *invocation, GError **error) {
    GDBusConnection *connection = g_dbus_method_invocation_get_connection(invocation);
    const char *sender = g_dbus_method_invocation_get_sender(invocation);
    int n = 0;
    gboolean own = FALSE;
    for (guint i = 0; i < bus->jobs->len; i++) {
        const struct bus_job *job = bus->jobs->pdata[i];
        if (job->task != PREPARER_CHECK)
            continue;
        n++;
        own |= g_dbus_method_invocation_get_connection(job->invocation) == connection &&
               g_strcmp0(g_dbus_method_invocation_get_sender(job->invocation), sender) == 0;
    }
    if (!own && n < MAX_CHECKS)
        return TRUE;
    g_set_error(error, BUS_ERROR, BUS_ERROR_BUSY,
                own ? "a session is being checked for you: wait for its answer"
                    : "%d sessions are being checked for others: try again when one is done",
                n);
    return FALSE;
}

typedef struct {
    gboolean process;
    char *calibration;                     /* path; NULL: what the rig file names */
    char *session_text, *calibration_text; /* of those files; NULL: they are to be read */
    char *exposures;                       /* session_conf_choose(); NULL: nothing is auto */
} JobOptions;

static void job_options_clear(JobOptions *options) {
    g_free(options->calibration);
    g_free(options->session_text);
    g_free(options->calibration_text);
    g_free(options->exposures);
}
G_DEFINE_AUTO_CLEANUP_CLEAR_FUNC(JobOptions, job_options_clear)

static gboolean bus_jobs_check_options(GVariant *options, JobOptions *ret, GError **error) {
    const struct {
        const char *key;
        char **text;
    } texts[] = {
        {"calibration", &ret->calibration},
        {"session_text", &ret->session_text},
        {"calibration_text", &ret->calibration_text},
        {"chosen", &ret->exposures},
    };
    GVariantIter iter;
    const char *key;
    g_autoptr(GVariant) value = NULL;
    g_variant_iter_init(&iter, options);
    while (g_variant_iter_next(&iter, "{&sv}", &key, &value)) {
        gboolean known = FALSE;
        if (strcmp(key, "process") == 0 && g_variant_is_of_type(value, G_VARIANT_TYPE_BOOLEAN)) {
            ret->process = g_variant_get_boolean(value);
            known = TRUE;
        }
        for (gsize i = 0; i < G_N_ELEMENTS(texts); i++)
            if (strcmp(key, texts[i].key) == 0 &&
                g_variant_is_of_type(value, G_VARIANT_TYPE_STRING)) {
                g_free(*texts[i].text);
                *texts[i].text = g_variant_dup_string(value, NULL);
                known = TRUE;
            }
        if (!known) {
            g_set_error(
                error, BUS_ERROR, BUS_ERROR_UNKNOWN,
                "the option %s does not exist or has the wrong type: give process "
                "(boolean), calibration, chosen, session_text or calibration_text (strings)",
                key);
            return FALSE;
        }
        g_clear_pointer(&value, g_variant_unref);
    }
    return TRUE;
}

/* The daemon may read more than its caller, and less: the caller reads it. */
static gboolean check_readable(GDBusMethodInvocation *invocation, const char *path,
                               const char *text, const char *option, GError **error) {
    if (!path || text || !bus_authority_caller(invocation))
        return TRUE;
    g_set_error(error, BUS_ERROR, BUS_ERROR_DENIED,
                "%s: mesorigd reads no file for another user: give its text in the option %s", path,
                option);
    return FALSE;
}

gboolean bus_validate(Bus *bus, GDBusMethodInvocation *invocation, const char *session_path,
                      const char *directory, GVariant *options, GError **error) {
    g_auto(JobOptions) chosen = {0};
    if (!bus_need_rig(bus, error) || !bus_need_absolute(session_path, error) ||
        (*directory && !bus_need_absolute(directory, error)) ||
        !bus_jobs_check_options(options, &chosen, error) ||
        !check_readable(invocation, session_path, chosen.session_text, "session_text", error) ||
        !may_check(bus, invocation, error))
        return FALSE;
    struct preparer_request request = {.task = PREPARER_CHECK,
                                       .session_path = session_path,
                                       .session_text = chosen.session_text,
                                       .directory = directory};
    start_job(bus, invocation, &request);
    return TRUE;
}

/* Replaces the calibration that the rig file names, for a session that begins now. */
static gboolean check_calibration(const char *path, const char *text, gboolean begins,
                                  GError **error) {
    if (!path)
        return TRUE;
    if (!begins) {
        g_set_error_literal(
            error, BUS_ERROR, BUS_ERROR_UNKNOWN,
            "a resumed session keeps the calibration with which it began; leave --calibration out");
        return FALSE;
    }
    if (!bus_need_absolute(path, error))
        return FALSE;
    if (text || g_file_test(path, G_FILE_TEST_EXISTS))
        return TRUE;
    g_set_error(error, G_FILE_ERROR, G_FILE_ERROR_NOENT, "%s: there is no such calibration", path);
    return FALSE;
}

gboolean bus_start(Bus *bus, GDBusMethodInvocation *invocation, const char *session_path,
                   const char *directory, GVariant *options, GError **error) {
    g_auto(JobOptions) chosen = {0};
    const gboolean begins = session_path != NULL;
    if (!bus_need_rig(bus, error) || !bus_need_free(bus, error) ||
        !bus_need_absolute(directory, error) || !bus_jobs_check_options(options, &chosen, error) ||
        !check_calibration(chosen.calibration, chosen.calibration_text, begins, error) ||
        (begins && !bus_need_absolute(session_path, error)) ||
        !check_readable(invocation, session_path, chosen.session_text, "session_text", error) ||
        !check_readable(invocation, chosen.calibration, chosen.calibration_text, "calibration_text",
                        error))
        return FALSE;
    struct preparer_request request = {.task = begins ? PREPARER_BEGIN : PREPARER_EXAMINE,
                                       .session_path = session_path,
                                       .session_text = chosen.session_text,
                                       .directory = directory,
                                       .calibration = chosen.calibration,
                                       .calibration_text = chosen.calibration_text,
                                       .chosen = chosen.exposures};
    struct bus_job *job = start_job(bus, invocation, &request);
    job->process = chosen.process;
    return TRUE;
}
