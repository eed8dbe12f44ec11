/*
 * Decides who may call which method on the system bus. The bus's policy file decides which users
 * may call the daemon at all. Polkit decides which methods each of these users may call
 * (etc/polkit). Polkit is asked before a call reaches its handler, and the main loop never waits
 * for polkit's answer. Polkit is not asked about
 * - SafeState, which bus_latch.c answers,
 * - Renew,
 * - a SetLaser or SetLamp that switches off,
 * - calls from clients of --listen, who are the daemon's own user,
 * - calls on a session bus.
 *
 * If polkit is not installed, only the bus's policy decides. On every bus, calls that give light,
 * move or begin a session are refused while the safe state is latched (bus_latch.h). The struct is
 * owned by the Bus. All functions belong to the main loop's thread.
 */
#pragma once

#include "bus_caller.h"
#include "bus_latch.h"
#include "rig1-bus.h"

/* Returns the name of the polkit action for a method, such as "org.mesorig.rig.capture". Returns
 * NULL if polkit is not asked about the method, or if there is no such method. *ret_known is set to
 * whether there is such a method; ret_known may be NULL. */
const char *bus_authority_action(const char *method, gboolean *ret_known);

struct bus_authority {
    /* Calls about which polkit has not answered yet, as struct question. The last callback of a
     * question frees it. */
    GPtrArray *questions;
    struct bus_latch *latch; /* borrowed */
    gboolean asks;           /* TRUE on the system bus; FALSE if polkit is never asked */
};

void bus_authority_init(struct bus_authority *authority, struct bus_latch *latch,
                        const char *address);
/* Frees the list of questions. Call bus_authority_stop() first. */
void bus_authority_clear(struct bus_authority *authority);

/* Makes a skeleton that asks polkit about each call before the handler of the call runs.
 * bus_authority_attach() gives the skeleton its authority, which is borrowed until NULL is
 * attached. */
BusRig1 *bus_authority_skeleton(void);
void bus_authority_attach(BusRig1 *skeleton, struct bus_authority *authority);

/* Answers the calls about which polkit has not answered yet, with BUS_ERROR_CANCELLED and the text
 * `why`. Returns TRUE if one of them was a Start or Resume. */
gboolean bus_authority_stop(struct bus_authority *authority, const char *why);

/* Returns the user who has called a method on the system bus. The result is owned by the
 * invocation. Returns NULL for calls about which polkit is not asked, and for calls of root and of
 * the daemon's own user. These two users may do everything that the daemon can do. */
const struct bus_caller *bus_authority_caller(GDBusMethodInvocation *invocation);
