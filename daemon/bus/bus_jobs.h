/*
 * Work on sessions that is done by child processes (preparer.h), for calls and for the queue. The
 * struct is owned by the Bus. All functions belong to the main loop's thread.
 */
#pragma once

#include "bus_rig.h"
#include "preparer.h"

struct bus_jobs {
    struct bus_rig *rig; /* borrowed */
    /* Jobs that are not answered yet, as struct bus_job. A job is freed when its child has
     * ended. */
    GPtrArray *list;
    struct preparer_limits limits[PREPARER_TASKS];
};

void bus_jobs_init(struct bus_jobs *jobs, struct bus_rig *rig);
void bus_jobs_clear(struct bus_jobs *jobs);

/* Called once for each job. If the job has succeeded, result is that of the child. If the job has
 * failed or was stopped, result is NULL and error is set. invocation is the call of the job, or
 * NULL. The function takes ownership of invocation and error, but not of result. */
typedef void (*BusJobDone)(GDBusMethodInvocation *invocation, GVariant *result, GError *error,
                           gpointer data);

/* Starts a job. invocation is the call of the job. For a session of the queue, invocation is NULL,
 * and the member `caller` of the request names the user. bus_jobs_start() sets the members
 * `devices` and `limits` of the request. free_data is called after done, and may be NULL. */
void bus_jobs_start(struct bus_jobs *jobs, struct preparer_request *request,
                    GDBusMethodInvocation *invocation, BusJobDone done, gpointer data,
                    GDestroyNotify free_data);

/* Returns whether a session may now be checked for this call. The error is BUS_ERROR_BUSY if a
 * session of the same client is being checked, or if too many sessions are. */
gboolean bus_jobs_may_check(const struct bus_jobs *jobs, GDBusMethodInvocation *invocation,
                            GError **error);

/* Returns the directory of the session that is about to begin, or NULL if there is none. It is that
 * of a Start or Resume that has not been answered yet, or of a session of the queue. There is at
 * most one. */
const char *bus_jobs_beginning(const struct bus_jobs *jobs);

/* Returns whether nothing is captured and no session is about to begin. If not, the error is
 * BUS_ERROR_BUSY. */
gboolean bus_jobs_need_free(const struct bus_jobs *jobs, GError **error);

/* Each function answers calls with BUS_ERROR_CANCELLED and kills the children that work for these
 * calls:
 * - bus_jobs_stop_begin() ends a Start or Resume, or the beginning of a session of the queue. It
 *   returns FALSE if there is none.
 * - bus_jobs_stop_all() ends all calls.
 * - bus_jobs_stop_client() ends the calls of a client that has disconnected. */
gboolean bus_jobs_stop_begin(struct bus_jobs *jobs, const char *why);
void bus_jobs_stop_all(struct bus_jobs *jobs, const char *why);
void bus_jobs_stop_client(struct bus_jobs *jobs, GDBusConnection *connection);
