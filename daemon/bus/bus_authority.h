/*
 * Who may call which method, on the system bus. The bus's policy file says who may call at all, and
 * polkit which of these users may do what (etc/polkit). Polkit is asked before a call reaches its
 * handler, and the main loop never waits for it. It is not asked about SafeState (bus_latch.c
 * answers it), about Renew, about a SetLaser or SetLamp that switches off, about clients of
 * --listen, who are the daemon's own user, or about calls on a session bus. Where polkit is not
 * installed, the bus's policy decides. Calls that give light, move or begin a session are refused
 * while the rig is held in its safe state (bus_latch.h). Main loop's thread.
 */
#pragma once

#include "bus_private.h"

/* The name of the polkit action for a method, for instance "org.mesorig.rig.capture". NULL: polkit
 * is not asked about the method. ret_known (may be NULL) is set to FALSE if there is no such
 * method. */
const char *bus_authority_action(const char *method, gboolean *ret_known);

/* A skeleton that asks polkit about each call first; bus is its data "bus". */
BusRig1 *bus_authority_skeleton(void);

/* Ends the calls about which polkit has not answered yet, with BUS_ERROR_CANCELLED. TRUE: one of
 * them would have begun a capture. */
gboolean bus_authority_stop(Bus *bus, const char *why);

/* Who has called, on the system bus; NULL: the daemon's own user or root, who may do all that the
 * daemon can do. */
const struct bus_caller *bus_authority_caller(GDBusMethodInvocation *invocation);
