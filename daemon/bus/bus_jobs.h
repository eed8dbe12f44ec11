/*
 * Work on sessions that child processes do (preparer.h) for calls and for the queue. Owned by the
 * Bus. All functions belong to the main loop's thread.
 */
#pragma once

#include "bus_rig.h"
#include "preparer.h"

struct bus_jobs {
    struct bus_rig *rig; /* borrowed */
    GPtrArray *list; /* of struct bus_job: jobs that are not answered yet; each is freed when its
                        child has ended */
    struct preparer_limits limits[PREPARER_TASKS];
};

void bus_jobs_init(struct bus_jobs *jobs, struct bus_rig *rig);
void bus_jobs_clear(struct bus_jobs *jobs);

/* Called once, with the result of the child, or with NULL and an error if the job failed or was
 * stopped. invocation is the call of the job. The function takes ownership of invocation and
 * error, but not of result. */
typedef void (*BusJobDone)(GDBusMethodInvocation *invocation, GVariant *result, GError *error,
                           gpointer data);

/* Starts a job. invocation is NULL for a session of the queue; the user is then named by caller of
 * the request. The job sets devices and limits of the request. free_data is called after done and
 * may be NULL. */
void bus_jobs_start(struct bus_jobs *jobs, struct preparer_request *request,
                    GDBusMethodInvocation *invocation, BusJobDone done, gpointer data,
                    GDestroyNotify free_data);

/* Returns whether a session may be checked for this call. The error is BUS_ERROR_BUSY if the client
 * already has a session checked, or if too many sessions are being checked. */
gboolean bus_jobs_may_check(const struct bus_jobs *jobs, GDBusMethodInvocation *invocation,
                            GError **error);

/* Returns the session directory of a Start or Resume that has not been answered yet, or of a
 * session of the queue that is about to begin, or NULL. There is at most one of them. */
const char *bus_jobs_beginning(const struct bus_jobs *jobs);

/* Returns whether nothing is captured and no session is about to begin. The error is
 * BUS_ERROR_BUSY. */
gboolean bus_jobs_need_free(const struct bus_jobs *jobs, GError **error);

/* Each function answers calls with BUS_ERROR_CANCELLED and kills the children that work for these
 * calls. bus_jobs_stop_begin() ends a Start or Resume, or the beginning of a session of the queue,
 * and returns FALSE if there is none. bus_jobs_stop_all() ends all calls. bus_jobs_stop_client()
 * ends the calls of a client that has disconnected. */
gboolean bus_jobs_stop_begin(struct bus_jobs *jobs, const char *why);
void bus_jobs_stop_all(struct bus_jobs *jobs, const char *why);
void bus_jobs_stop_client(struct bus_jobs *jobs, GDBusConnection *connection);
