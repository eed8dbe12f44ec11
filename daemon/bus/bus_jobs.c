#include "bus_authority.h"
#include "bus_errors.h"
#include "bus_options.h"
#include "bus_private.h"
#include "bus_safety.h"
#include "bus_unattended.h"
#include "plan/report.h"
#include "queue.h"

#include <string.h>

#include "base/input_file.h"

/* Largest size of a configuration file, in bytes. */
#define MAX_TEXT (1 << 20)

/* Largest number of sessions that are checked at the same time, for all clients. */
#define MAX_CHECKS 4

struct bus_job {
    Bus *bus;                          /* NULL if the job was stopped */
    GDBusMethodInvocation *invocation; /* NULL if it was answered, or if there is none */
    BusBegun begun;                    /* instead of a call, for a session of the queue */
    struct queue_item *item;           /* session to be added to the queue; NULL if there is none */
    GCancellable *cancellable;
    enum preparer_task task;
    char *directory;
    gboolean process;
};

static void fail(Bus *bus, struct bus_job *job, GError *error) {
    if (job->invocation) {
        g_dbus_method_invocation_take_error(g_steal_pointer(&job->invocation),
                                            bus_errors_wrap(error));
        return;
    }
    job->begun(bus, error);
    g_error_free(error);
}

/* Stops a job. The job is freed when its child has ended. */
static void stop(Bus *bus, struct bus_job *job, const char *why) {
    g_ptr_array_remove(bus->jobs, job);
    job->bus = NULL;
    g_cancellable_cancel(job->cancellable);
    fail(bus, job, g_error_new_literal(BUS_ERROR, BUS_ERROR_CANCELLED, why));
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
        stop(bus, job, why);
    return job != NULL;
}

void bus_jobs_stop_all(Bus *bus, const char *why) {
    while (bus->jobs->len > 0)
        stop(bus, bus->jobs->pdata[0], why);
}

void bus_jobs_stop_client(Bus *bus, GDBusConnection *connection) {
    for (guint i = bus->jobs->len; i-- > 0;) {
        struct bus_job *job = bus->jobs->pdata[i];
        if (job->invocation &&
            g_dbus_method_invocation_get_connection(job->invocation) == connection)
            stop(bus, job, "the client has disconnected");
    }
}

/* Takes the values from the plan that the queue shows. */
static void answer_adding(struct bus_job *job, GVariant *report, GError *error) {
    struct queue_item *item = g_steal_pointer(&job->item);
    guint number = 0;
    const char *name = "", *prompt = "";
    if (report) {
        g_variant_lookup(report, "session", "&s", &name);
        g_variant_lookup(report, "prompt", "&s", &prompt);
        g_variant_lookup(report, "predicted_s", "d", &item->predicted_s);
        g_variant_lookup(report, "bytes", "t", &item->bytes);
        g_free(item->name);
        item->name = g_strdup(name);
        g_free(item->prompt);
        item->prompt = g_strdup(prompt);
        number = bus_unattended_add(job->bus, item, &error);
    } else {
        queue_item_free(item);
    }
    if (number == 0) {
        fail(job->bus, job, error);
        return;
    }
    g_dbus_interface_skeleton_flush(G_DBUS_INTERFACE_SKELETON(job->bus->object));
    bus_rig1_complete_queue_add(job->bus->object, g_steal_pointer(&job->invocation), number,
                                report);
}

/* Answers Validate. For an invalid session the answer lists the mistakes. An invalid call is an
 * error. */
static void answer_check(struct bus_job *job, GVariant *report, GError *error) {
    if (job->item) {
        answer_adding(job, report, error);
        return;
    }
    if (!report && error->domain == BUS_ERROR) {
        fail(job->bus, job, error);
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
        fail(job->bus, job, error);
        return;
    }
    g_dbus_interface_skeleton_flush(G_DBUS_INTERFACE_SKELETON(job->bus->object));
    if (job->begun)
        job->begun(job->bus, NULL);
    else if (resumed)
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
    queue_item_free(job->item);
    g_free(job->directory);
    g_free(job);
}

/* Starts a job. invocation is NULL for a session of the queue, whose caller is in the request. */
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
    if (invocation)
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
        if (job->task != PREPARER_CHECK || !job->invocation)
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

/* Refuses to read a file for another user, because the daemon may have more or fewer rights than
 * its caller. The caller has to send the text of the file. */
static gboolean check_readable(GDBusMethodInvocation *invocation, const char *path,
                               const char *text, const char *option, GError **error) {
    if (!path || text || !bus_authority_caller(invocation))
        return TRUE;
    g_set_error(error, BUS_ERROR, BUS_ERROR_DENIED,
                "%s: mesorigd does not read files for another user: give the text of the file in "
                "the option %s",
                path, option);
    return FALSE;
}

gboolean bus_validate(Bus *bus, GDBusMethodInvocation *invocation, const char *session_path,
                      const char *directory, GVariant *options, GError **error) {
    g_auto(BusOptions) chosen = {0};
    if (!bus_need_rig(bus, error) || !bus_need_absolute(session_path, error) ||
        (*directory && !bus_need_absolute(directory, error)) ||
        !bus_options_read(options, &chosen, error) ||
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

/* Checks whether a call may replace the calibration of the rig file, for a session that begins
 * now. */
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
    g_auto(BusOptions) chosen = {0};
    const gboolean begins = session_path != NULL;
    if (!bus_need_rig(bus, error) || !bus_need_free(bus, error) || !bus_need_safe(bus, error) ||
        !bus_unattended_need_free(bus, error) || !bus_need_absolute(directory, error) ||
        !bus_options_read(options, &chosen, error) ||
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

/* Returns the text of a file, which the queue keeps. It is "" for the empty path. Returns NULL with
 * an error on failure. */
static char *kept_text(const char *path, const char *given, GError **error) {
    if (!path)
        return g_strdup("");
    g_autofree char *text = given ? g_strdup(given) : input_file_read_text(path, MAX_TEXT, error);
    if (text && !g_utf8_validate(text, -1, NULL)) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_DATA, "%s: is not UTF-8", path);
        return NULL;
    }
    return g_steal_pointer(&text);
}

gboolean bus_add_to_queue(Bus *bus, GDBusMethodInvocation *invocation, const char *session_path,
                          const char *directory, GVariant *options, GError **error) {
    const struct bus_caller *caller = bus_authority_caller(invocation);
    g_auto(BusOptions) chosen = {0};
    if (!bus_unattended_need_queue(bus, error) || !bus_need_rig(bus, error) ||
        !bus_need_absolute(session_path, error) || !bus_need_absolute(directory, error) ||
        !bus_options_read(options, &chosen, error) ||
        !check_calibration(chosen.calibration, chosen.calibration_text, TRUE, error) ||
        !check_readable(invocation, session_path, chosen.session_text, "session_text", error) ||
        !check_readable(invocation, chosen.calibration, chosen.calibration_text, "calibration_text",
                        error) ||
        !may_check(bus, invocation, error))
        return FALSE;
    g_autofree char *session_text = kept_text(session_path, chosen.session_text, error);
    g_autofree char *calibration_text =
        session_text ? kept_text(chosen.calibration, chosen.calibration_text, error) : NULL;
    if (!calibration_text)
        return FALSE;
    struct preparer_request request = {.task = PREPARER_CHECK,
                                       .session_path = session_path,
                                       .session_text = session_text,
                                       .directory = directory,
                                       .calibration = chosen.calibration,
                                       .calibration_text = calibration_text};
    struct bus_job *job = start_job(bus, invocation, &request);
    job->item = queue_item_new();
    const struct {
        char **to;
        const char *text;
    } texts[] = {{&job->item->session_path, session_path},
                 {&job->item->session_text, session_text},
                 {&job->item->directory, directory},
                 {&job->item->rig, bus->rig_path},
                 {&job->item->calibration, chosen.calibration ? chosen.calibration : ""},
                 {&job->item->calibration_text, calibration_text},
                 {&job->item->chosen, chosen.exposures ? chosen.exposures : ""}};
    for (gsize i = 0; i < G_N_ELEMENTS(texts); i++) {
        g_free(*texts[i].to);
        *texts[i].to = g_strdup(texts[i].text);
    }
    job->item->process = chosen.process;
    job->item->yes = chosen.yes;
    job->item->has_caller = caller != NULL;
    if (caller) {
        job->item->uid = caller->uid;
        g_array_append_vals(job->item->groups, caller->groups, (guint)caller->n_groups);
    }
    return TRUE;
}

void bus_start_queued(Bus *bus, const struct queue_item *item, gboolean resumes, BusBegun begun) {
    struct bus_caller caller = {.uid = item->uid};
    caller.n_groups = (int)MIN(item->groups->len, BUS_CALLER_GROUPS);
    for (int i = 0; i < caller.n_groups; i++)
        caller.groups[i] = g_array_index(item->groups, guint32, i);
    struct preparer_request request = {
        .task = resumes ? PREPARER_EXAMINE : PREPARER_BEGIN,
        .session_path = item->session_path,
        .session_text = item->session_text,
        .directory = item->directory,
        .calibration = *item->calibration && !resumes ? item->calibration : NULL,
        .calibration_text = resumes ? NULL : item->calibration_text,
        .chosen = *item->chosen ? item->chosen : NULL,
        .caller = item->has_caller ? &caller : NULL};
    struct bus_job *job = start_job(bus, NULL, &request);
    job->begun = begun;
    job->process = item->process;
}
