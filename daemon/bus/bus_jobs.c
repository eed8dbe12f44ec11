#include "bus_jobs.h"

#include <gio/gio.h>
#include <string.h>

#include "bus_errors.h"

/* Maximum number of sessions that are checked at the same time, for all clients together. */
#define MAX_CHECKS 4

struct bus_job {
    struct bus_jobs *jobs; /* NULL if the job was stopped */
    /* NULL if the call has been answered, or if the job is for the queue */
    GDBusMethodInvocation *invocation;
    GCancellable *cancellable;
    enum preparer_task task;
    char *directory;
    BusJobDone done;
    gpointer data;
    GDestroyNotify free_data;
};

void bus_jobs_init(struct bus_jobs *jobs, struct bus_rig *rig) {
    jobs->rig = rig;
    jobs->list = g_ptr_array_new();
    memcpy(jobs->limits, preparer_default_limits, sizeof jobs->limits);
}

void bus_jobs_clear(struct bus_jobs *jobs) {
    g_ptr_array_unref(jobs->list);
}

static void take_off_list(struct bus_jobs *jobs, struct bus_job *job) {
    g_ptr_array_remove(jobs->list, job);
    job->jobs = NULL;
}

static void answer(struct bus_job *job, GVariant *result, GError *error) {
    job->done(g_steal_pointer(&job->invocation), result, error, job->data);
    if (job->free_data)
        job->free_data(job->data);
}

/* Stops a job and answers its call. The job is freed later, when its child has ended. */
static void stop(struct bus_jobs *jobs, struct bus_job *job, const char *why) {
    take_off_list(jobs, job);
    g_cancellable_cancel(job->cancellable);
    answer(job, NULL, g_error_new_literal(BUS_ERROR, BUS_ERROR_CANCELLED, why));
}

static struct bus_job *find_beginning(const struct bus_jobs *jobs) {
    for (guint i = 0; i < jobs->list->len; i++) {
        struct bus_job *job = jobs->list->pdata[i];
        if (job->task != PREPARER_CHECK)
            return job;
    }
    return NULL;
}

const char *bus_jobs_beginning(const struct bus_jobs *jobs) {
    const struct bus_job *job = find_beginning(jobs);
    return job ? job->directory : NULL;
}

gboolean bus_jobs_need_free(const struct bus_jobs *jobs, GError **error) {
    const char *captured = jobs->rig->captured, *beginning = bus_jobs_beginning(jobs);
    if (captured)
        g_set_error(error, BUS_ERROR, BUS_ERROR_BUSY,
                    "the session %s is being captured on this rig (state: %s): wait until it ends; "
                    "if it is your session, “mesorig abort %s” ends it",
                    captured, bus_rig1_get_state(jobs->rig->object), captured);
    else if (beginning)
        g_set_error(error, BUS_ERROR, BUS_ERROR_BUSY,
                    "the session %s is about to begin on this rig: wait until it ends; if it is "
                    "your session, “mesorig abort” ends it",
                    beginning);
    return !captured && !beginning;
}

gboolean bus_jobs_stop_begin(struct bus_jobs *jobs, const char *why) {
    struct bus_job *job = find_beginning(jobs);
    if (job)
        stop(jobs, job, why);
    return job != NULL;
}

void bus_jobs_stop_all(struct bus_jobs *jobs, const char *why) {
    while (jobs->list->len > 0)
        stop(jobs, jobs->list->pdata[0], why);
}

void bus_jobs_stop_client(struct bus_jobs *jobs, GDBusConnection *connection) {
    for (guint i = jobs->list->len; i-- > 0;) {
        struct bus_job *job = jobs->list->pdata[i];
        if (job->invocation &&
            g_dbus_method_invocation_get_connection(job->invocation) == connection)
            stop(jobs, job, "the client has disconnected");
    }
}

static void on_prepared(GObject *source, GAsyncResult *result, gpointer data) {
    struct bus_job *job = data;
    GError *error = NULL;
    g_autoptr(GVariant) prepared = preparer_finish(result, &error);
    if (job->jobs) {
        take_off_list(job->jobs, job);
        answer(job, prepared, error);
    } else {
        g_clear_error(&error);
    }
    g_object_unref(job->cancellable);
    g_free(job->directory);
    g_free(job);
}

void bus_jobs_start(struct bus_jobs *jobs, struct preparer_request *request,
                    GDBusMethodInvocation *invocation, BusJobDone done, gpointer data,
                    GDestroyNotify free_data) {
    struct bus_job *job = g_new(struct bus_job, 1);
    *job = (struct bus_job){.jobs = jobs,
                            .invocation = invocation,
                            .cancellable = g_cancellable_new(),
                            .task = request->task,
                            .directory = g_strdup(request->directory),
                            .done = done,
                            .data = data,
                            .free_data = free_data};
    g_ptr_array_add(jobs->list, job);
    request->devices = jobs->rig->devices;
    request->limits = jobs->limits[request->task];
    preparer_run(request, job->cancellable, on_prepared, job);
}

gboolean bus_jobs_may_check(const struct bus_jobs *jobs, GDBusMethodInvocation *invocation,
                            GError **error) {
    GDBusConnection *connection = g_dbus_method_invocation_get_connection(invocation);
    const char *sender = g_dbus_method_invocation_get_sender(invocation);
    int n = 0;
    gboolean own = FALSE;
    for (guint i = 0; i < jobs->list->len; i++) {
        const struct bus_job *job = jobs->list->pdata[i];
        if (job->task != PREPARER_CHECK || !job->invocation)
            continue;
        n++;
        own |= g_dbus_method_invocation_get_connection(job->invocation) == connection &&
               g_strcmp0(g_dbus_method_invocation_get_sender(job->invocation), sender) == 0;
    }
    if (!own && n < MAX_CHECKS)
        return TRUE;
    g_set_error(
        error, BUS_ERROR, BUS_ERROR_BUSY,
        own ? "an earlier call of yours is still checking a session: wait for its answer"
            : "%d sessions are being checked, which is the maximum: try again when one is done",
        n);
    return FALSE;
}
