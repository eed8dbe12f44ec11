/*
 * The latch of the safe state. SafeState sets the latch, and Release ends it. While it is set,
 * every call that switches on, moves or begins a session is refused. GDBus's thread sets the latch
 * before the main loop sees the call SafeState. A call that has arrived earlier and has not begun
 * yet is therefore refused too.
 *
 * SafeState is answered within a quarter of a second. A device that has not answered by then is
 * reported as "commanded only". If the main loop is busy, a thread of the latch answers.
 */
#pragma once

#include "bus_rig.h"

/* Makes a latch for this rig, which is borrowed. After a SafeState, make_safe is called in the main
 * loop, even if no rig is open. make_safe is not called in two cases: if the devices are still
 * obeying an earlier SafeState, and if the rig is being closed. The latch holds a reference to
 * itself until bus_latch_close(). */
struct bus_latch *bus_latch_new(struct bus_rig *rig, void (*make_safe)(gpointer data),
                                gpointer data);

/* Ends the latch's thread, answers all waiting SafeState calls with BUS_ERROR_CANCELLED, and
 * releases the latch's reference to itself. Belongs to the main loop's thread. */
void bus_latch_close(struct bus_latch *latch);

struct bus_latch *bus_latch_ref(struct bus_latch *latch);
void bus_latch_unref(gpointer latch);

/* If the message is a call of SafeState, takes ownership of it, sets the latch and returns TRUE.
 * Otherwise returns FALSE, after marking the message with the number of SafeState calls that have
 * arrived before it. Called in GDBus's thread. */
gboolean bus_latch_take(struct bus_latch *latch, GDBusConnection *connection,
                        GDBusMessage *message);

/* Returns whether the latch is set. Any thread may call this function. */
gboolean bus_latch_is_set(struct bus_latch *latch);

/* Returns TRUE if the latch is not set. Otherwise returns FALSE with BUS_ERROR_LATCHED. Any thread
 * may call this function. */
gboolean bus_latch_need_released(struct bus_latch *latch, GError **error);

/* Returns whether a call may begin. The error is BUS_ERROR_LATCHED if the latch is set. The error
 * is BUS_ERROR_CANCELLED if the latch is not set, but a SafeState and a Release have arrived after
 * the call. Any thread may call this function. */
gboolean bus_latch_allows(struct bus_latch *latch, GDBusMethodInvocation *invocation,
                          GError **error);

/* Ends the latch. The error is BUS_ERROR_LATCHED if a SafeState came after this call. Belongs to
 * the main loop's thread. */
gboolean bus_latch_release(struct bus_latch *latch, GDBusMethodInvocation *invocation,
                           GError **error);
