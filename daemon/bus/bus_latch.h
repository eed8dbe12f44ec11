/*
 * The latch of the safe state. SafeState sets it, and Release ends it. GDBus's thread takes the
 * call SafeState before the main loop sees the call. From that moment on, every call that switches
 * on, moves or begins a session is refused. This includes a call that arrived earlier and has not
 * begun.
 *
 * SafeState is answered within a quarter of a second. A device that has not answered by then is
 * reported as "commanded only". If the main loop is busy, a thread of the latch answers.
 */
#pragma once

#include "bus_rig.h"

/* Makes a latch for this rig, which is borrowed. After a SafeState, make_safe is called in the main
 * loop, also if no rig is open. It is not called if the devices are still obeying an earlier
 * SafeState, or if the rig is being closed. The latch holds a reference to itself until
 * bus_latch_close(). */
struct bus_latch *bus_latch_new(struct bus_rig *rig, void (*make_safe)(gpointer data),
                                gpointer data);

/* Answers all SafeState calls that wait with BUS_ERROR_CANCELLED, ends the latch's thread and
 * releases the latch's own reference. Belongs to the main loop's thread. */
void bus_latch_close(struct bus_latch *latch);

struct bus_latch *bus_latch_ref(struct bus_latch *latch);
void bus_latch_unref(gpointer latch);

/* If the message is a SafeState, takes ownership of it and returns TRUE. Otherwise marks the
 * message with the number of SafeState calls that have arrived before it, and returns FALSE. Called
 * in GDBus's thread. */
gboolean bus_latch_take(struct bus_latch *latch, GDBusConnection *connection,
                        GDBusMessage *message);

/* Returns whether the latch is set. Any thread may call it. */
gboolean bus_latch_is_set(struct bus_latch *latch);

/* Returns whether the latch is not set. The error is BUS_ERROR_LATCHED. Any thread may call it. */
gboolean bus_latch_need_released(struct bus_latch *latch, GError **error);

/* Returns whether a call may begin. The error is BUS_ERROR_LATCHED if the latch is set, and
 * BUS_ERROR_CANCELLED if SafeState arrived after the call, and Release has ended the latch since
 * then. Any thread may call it. */
gboolean bus_latch_allows(struct bus_latch *latch, GDBusMethodInvocation *invocation,
                          GError **error);

/* Ends the latch. The error is BUS_ERROR_LATCHED if a SafeState came after this call. Belongs to
 * the main loop's thread. */
gboolean bus_latch_release(struct bus_latch *latch, GDBusMethodInvocation *invocation,
                           GError **error);
