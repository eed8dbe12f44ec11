/*
 * The safe state as a latch. SafeState is taken in GDBus's thread, before the main loop sees the
 * call. From that moment on every call that switches on, moves or begins a session is refused, also
 * a call that arrived earlier and has not begun. The latch ends with Release.
 *
 * SafeState is answered within a quarter of a second. A device that has not answered by then is
 * "commanded only". If the main loop is busy, a thread of the latch answers.
 */
#pragma once

#include "bus_private.h"

/* bus is not owned. The latch has a reference for bus_latch_close(). */
struct bus_latch *bus_latch_new(Bus *bus);

/* Answers all calls that wait, because the bus is being closed. Main loop's thread. */
void bus_latch_close(struct bus_latch *latch);

struct bus_latch *bus_latch_ref(struct bus_latch *latch);
void bus_latch_unref(gpointer latch);

/* Takes a message if it is a SafeState, and owns the message then. Otherwise returns FALSE and
 * marks the message with the time of its arrival. GDBus's thread. */
gboolean bus_latch_take(struct bus_latch *latch, GDBusConnection *connection,
                        GDBusMessage *message);

/* Any thread. */
gboolean bus_latch_is_set(struct bus_latch *latch);

/* Error: BUS_ERROR_LATCHED. Any thread. */
gboolean bus_latch_need_released(struct bus_latch *latch, GError **error);

/* Whether a call may begin. Errors: BUS_ERROR_LATCHED; BUS_ERROR_CANCELLED if SafeState came after
 * the call, and Release since. Any thread. */
gboolean bus_latch_allows(struct bus_latch *latch, GDBusMethodInvocation *invocation,
                          GError **error);

/* Ends the latch. Error: BUS_ERROR_LATCHED if a SafeState came after this call. Main loop's
 * thread. */
gboolean bus_latch_release(struct bus_latch *latch, GDBusMethodInvocation *invocation,
                           GError **error);
