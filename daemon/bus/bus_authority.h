/*
 * Who may call which method, on the system bus. The bus's policy file says who may call at all; of
 * those, polkit says who may do what (etc/polkit). It is asked before a call reaches its handler,
 * and the main loop never waits for it. SafeState is not asked for (bus_queue.c answers it); nor is
 * SetLaser that switches off, nor anything of clients of --listen, who are the daemon's own user,
 * or on a session bus. Where polkit is not installed the bus's policy decides alone. Main loop's
 * thread.
 */
#pragma once

#include "bus_private.h"

/* As polkit knows it, "org.mesorig.rig.capture". NULL: the method is not asked for. ret_known may
 * be NULL; FALSE: there is no such method. */
const char *bus_authority_action(const char *method, gboolean *ret_known);

/* A skeleton whose calls are asked for first; bus is its data "bus". */
BusRig1 *bus_authority_skeleton(void);

/* Ends with BUS_ERROR_CANCELLED the calls that are being asked for. TRUE: one of them would have
 * begun a capture. */
gboolean bus_authority_stop(Bus *bus, const char *why);

/* Who has called, on the system bus; NULL: the daemon's own user or root, who may do what it can.
 */
const struct bus_caller *bus_authority_caller(GDBusMethodInvocation *invocation);
