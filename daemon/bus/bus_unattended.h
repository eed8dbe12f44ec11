/*
 * Captures the sessions of the queue (queue.h) one after the other while a rig is open and free.
 * Tells clients what happens to captures (the signal Milestone). The struct is owned by the Bus.
 * All functions belong to the main loop's thread.
 *
 * If a session has a prompt, the prompt is shown before the session until Continue. Then a child
 * process, the program mesorig as a client of this daemon, takes test shots and chooses exposures.
 *
 * After a fault of a session, the session is marked as stopped, and the next session begins. The
 * queue is paused in these cases:
 * - the rig has a fault,
 * - two sessions in a row have stopped,
 * - Abort or SafeState was called.
 *
 * When the queue is empty, lamps and lasers are switched off, and all axes are parked, except those
 * that sweep lasers.
 */
#pragma once

#include "bus_run.h"
#include "queue.h"

struct bus_unattended;

/* Borrows run, jobs, and everything that these two borrow. */
struct bus_unattended *bus_unattended_new(struct bus_run *run, struct bus_jobs *jobs);
void bus_unattended_free(struct bus_unattended *at);

/* Reads the queue from the file at path and keeps it there, as bus_keep_queue() says. */
void bus_unattended_keep(struct bus_unattended *at, const char *path);

/* Adds an item and takes ownership of it. Returns its number, or 0 with an error. */
guint bus_unattended_add(struct bus_unattended *at, struct queue_item *item, GError **error);

/* These functions do the same as the methods QueueRemove, QueueMove, QueuePause and QueueResume. */
gboolean bus_unattended_remove(struct bus_unattended *at, guint number, GError **error);
gboolean bus_unattended_move(struct bus_unattended *at, guint number, guint place, GError **error);
gboolean bus_unattended_pause(struct bus_unattended *at, GError **error);
gboolean bus_unattended_resume(struct bus_unattended *at, GError **error);

/* Handles the method Continue while nothing is captured. The user has then done what the prompt of
 * a session of the queue asks for, and the session begins. Returns FALSE if no session of the queue
 * waits for this, or if the rig is not free. */
gboolean bus_unattended_answer(struct bus_unattended *at);

/* Returns whether this daemon keeps a queue. If not, the error is BUS_ERROR_FAILED. */
gboolean bus_unattended_need_queue(struct bus_unattended *at, GError **error);
/* Returns FALSE with BUS_ERROR_BUSY if bus_unattended_is_beginning(), otherwise TRUE. */
gboolean bus_unattended_need_free(struct bus_unattended *at, GError **error);
/* Returns whether a session of the queue is about to begin, which means that its test shots are
 * being taken. */
gboolean bus_unattended_is_beginning(const struct bus_unattended *at);

/* Call this when a device has become free, the rig was opened or the safe state was released. The
 * main loop then begins the next session if possible. */
void bus_unattended_poke(struct bus_unattended *at);

/* Call this when a capture has begun. */
void bus_unattended_begun(struct bus_unattended *at);
/* Call this when the status of a capture has changed. */
void bus_unattended_changed(struct bus_unattended *at, const struct capture_status *status);

/* Ends test shots, and puts a session that has not begun back into the queue. Does nothing if there
 * is no queue.
 *
 * If why is not NULL and a session of the queue has not ended, the queue is paused for this reason.
 * If why is NULL, the rig is being closed. The queue is then not paused, and the session that is
 * being captured goes back into the queue to be resumed. */
void bus_unattended_stop(struct bus_unattended *at, const char *why);
