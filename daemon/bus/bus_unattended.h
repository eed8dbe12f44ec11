/*
 * The queue of sessions (queue/queue.h) at work: captures one after the other while a rig is open
 * and free, and tells what happens to captures (the signal Milestone).
 *
 * Before a session, its prompt is shown until Continue; then a child, which is the program mesorig
 * as a client of this daemon, takes test shots and chooses exposures. A session that faults is
 * marked as stopped, and the next one begins. The queue is paused instead if the fault is the rig's
 * or if two sessions in a row have stopped, and after Abort and SafeState. When the queue is empty,
 * lamps and lasers are switched off and the axes are parked. Main loop's thread.
 */
#pragma once

#include "bus_private.h"

struct unattended *bus_unattended_new(Bus *bus);
void bus_unattended_free(struct unattended *unattended);

/* Takes the item. Returns its number; 0: error. */
guint bus_unattended_add(Bus *bus, struct queue_item *item, GError **error);

/* They do what the methods QueueRemove, QueueMove, QueuePause and QueueResume do. */
gboolean bus_unattended_remove(Bus *bus, guint number, GError **error);
gboolean bus_unattended_move(Bus *bus, guint number, guint place, GError **error);
gboolean bus_unattended_pause(Bus *bus, GError **error);
gboolean bus_unattended_resume(Bus *bus, GError **error);

/* Takes a Continue while nothing is captured: the user has done what the prompt asks for. FALSE:
 * there is no prompt. */
gboolean bus_unattended_answer(Bus *bus);

/* Error BUS_ERROR_FAILED: this daemon keeps no queue; BUS_ERROR_BUSY: a session of the queue is
 * about to begin. */
gboolean bus_unattended_need_queue(Bus *bus, GError **error);
gboolean bus_unattended_need_free(Bus *bus, GError **error);
gboolean bus_unattended_is_beginning(const Bus *bus);

/* To be called when something has changed for which the queue may wait. The queue then goes on from
 * the main loop. */
void bus_unattended_poke(Bus *bus);

/* To be called when a capture has begun, and when it has changed. */
void bus_unattended_begun(Bus *bus);
void bus_unattended_changed(Bus *bus, const struct capture_status *status);

/* Ends test shots and parking, and puts a session that has not begun back into the queue. why:
 * pauses the queue and shows this reason. NULL: the rig is being closed; the queue is not paused,
 * and a session under way waits again. */
void bus_unattended_stop(Bus *bus, const char *why);
