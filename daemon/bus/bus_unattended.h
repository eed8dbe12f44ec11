/*
 * Captures the sessions of the queue (queue/queue.h) one after the other while a rig is open and
 * free. Reports what happens to captures (the signal Milestone).
 *
 * Before a session, its prompt is shown until Continue. Then a child process takes test shots and
 * chooses exposures; the child is the program mesorig as a client of this daemon. A session that
 * faults is marked as stopped, and the next session begins. The queue is paused instead if the rig
 * has a fault or if two sessions in a row have stopped, and after Abort and SafeState. When the
 * queue is empty, lamps and lasers are switched off and the axes are parked. All functions belong
 * to the main loop's thread.
 */
#pragma once

#include "bus_private.h"

struct unattended *bus_unattended_new(Bus *bus);
void bus_unattended_free(struct unattended *unattended);

/* Adds an item and takes ownership of it. Returns its number, or 0 with an error. */
guint bus_unattended_add(Bus *bus, struct queue_item *item, GError **error);

/* These functions do the same as the methods QueueRemove, QueueMove, QueuePause and QueueResume. */
gboolean bus_unattended_remove(Bus *bus, guint number, GError **error);
gboolean bus_unattended_move(Bus *bus, guint number, guint place, GError **error);
gboolean bus_unattended_pause(Bus *bus, GError **error);
gboolean bus_unattended_resume(Bus *bus, GError **error);

/* Takes a Continue while nothing is captured: the user has done what the prompt asks for. Returns
 * FALSE if there is no prompt. */
gboolean bus_unattended_answer(Bus *bus);

/* Return whether this daemon keeps a queue (error BUS_ERROR_FAILED), and whether no session of the
 * queue is about to begin (error BUS_ERROR_BUSY). */
gboolean bus_unattended_need_queue(Bus *bus, GError **error);
gboolean bus_unattended_need_free(Bus *bus, GError **error);
gboolean bus_unattended_is_beginning(const Bus *bus);

/* Call it when something has changed for which the queue may be waiting. The queue continues from
 * the main loop. */
void bus_unattended_poke(Bus *bus);

/* Call these when a capture has begun, and when it has changed. */
void bus_unattended_begun(Bus *bus);
void bus_unattended_changed(Bus *bus, const struct capture_status *status);

/* Ends test shots and parking, and puts a session that has not begun back into the queue. If why is
 * not NULL, the queue is paused and shows this reason. If why is NULL, the rig is being closed: the
 * queue is not paused, and a session under way waits again. */
void bus_unattended_stop(Bus *bus, const char *why);
