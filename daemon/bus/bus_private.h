/*
 * The Bus puts its parts together. Each part has its own header and uses only the parts to which it
 * gets a pointer:
 * - bus_rig.h: the rig, and who uses it
 * - bus_safety.h: the safety of the rig
 * - bus_latch.h: the safe state
 * - bus_queue.h: calls that wait
 * - bus_authority.h: who may call which method
 * - bus_jobs.h: calls whose work a child process does
 * - bus_hands.h: devices by hand
 * - bus_run.h: the session that is being captured
 * - bus_unattended.h: the queue of sessions
 *
 * Three files see the whole Bus: bus.c, bus_calls.c, which answers the methods of org.mesorig.Rig1,
 * and bus_sessions.c, which answers the methods about sessions. All functions belong to the main
 * loop's thread.
 */
#pragma once

#include "bus.h"
#include "bus_authority.h"
#include "bus_queue.h"
#include "bus_unattended.h"

struct Bus {
    BusRig1 *object;
    char *address;
    struct bus_rig rig;
    struct bus_latch *latch;
    struct bus_queue *queue;
    struct bus_authority authority;
    struct bus_jobs jobs;
    struct bus_hands hands;
    struct bus_run run;
    struct bus_unattended *unattended;
    BusFunc func;
    gpointer data;
    /* connection of the main client (bus_listen_client()); not owned, only compared */
    GDBusConnection *client;
    BusFunc client_gone;
    gpointer client_data;
};

/* Returns TRUE if a path is absolute, otherwise FALSE with BUS_ERROR_BAD_PATH. */
gboolean bus_need_absolute(const char *path, GError **error);

/* Returns whether the rig may be closed. A rig without a guardian, and a rig that has been made
 * safe (bus_rig.h, is_safe), may always be closed.
 *
 * For any other rig, ends all operations and waits until every device has confirmed that it is off
 * or stands still (bus_end(), which runs the main loop). If a device does not confirm, returns
 * FALSE with BUS_ERROR_BUSY. The rig then stays open, the queue of sessions is paused, and the
 * command to the device is repeated until the device confirms. */
gboolean bus_can_close(Bus *bus, GError **error);

/* Closes the rig. Does nothing if called from within bus_end(), which runs the main loop.
 *
 * If a device has not confirmed that it is off or stands still, the devices are not closed, and the
 * guardian continues to make them safe. Closing them would wait for their answers, and meanwhile
 * the guardian could not use the lines to the devices. In this case the program must end after this
 * call. */
void bus_close_rig(Bus *bus);

/* Each function does the work of a method in a child process, and answers the call when the child
 * has ended. bus_validate() does the work of Validate, bus_add_to_queue() that of QueueAdd, and
 * bus_start() that of Start or, if session_path is NULL, of Resume. If the call is refused
 * immediately, the function returns FALSE with an error, and its caller answers the call. */
gboolean bus_validate(Bus *bus, GDBusMethodInvocation *invocation, const char *session_path,
                      const char *directory, GVariant *options, GError **error);
gboolean bus_start(Bus *bus, GDBusMethodInvocation *invocation, const char *session_path,
                   const char *directory, GVariant *options, GError **error);
gboolean bus_add_to_queue(Bus *bus, GDBusMethodInvocation *invocation, const char *session_path,
                          const char *directory, GVariant *options, GError **error);

/* Connects the handlers of all methods except SafeState, which bus_latch.c answers. */
void bus_answer_calls(Bus *bus);
