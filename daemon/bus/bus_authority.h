/*
 * Decides who may call which method on the system bus. The bus's policy file decides which users
 * may call the daemon at all. Polkit decides which methods each of these users may call
 * (etc/polkit). Polkit is asked before a call reaches its handler, and the main loop never waits
 * for it. Polkit is not asked about
 * - SafeState, which bus_latch.c answers,
 * - Renew,
 * - a SetLaser or SetLamp that switches off,
 * - calls from clients of --listen, who are the daemon's own user,
 * - calls on a session bus.
 * If polkit is not installed, only the bus's policy decides. Calls that give light, move or begin a
 * session are refused while the rig is held in its safe state (bus_latch.h). The struct is
 * owned by the Bus. All functions belong to the main loop's thread.
 */
#pragma once

#include "bus_caller.h"
#include "bus_latch.h"
#include "rig1-bus.h"

/* Returns the name of the polkit action for a method, for instance "org.mesorig.rig.capture".
 * Returns NULL if polkit is not asked about the method, and if there is no such method. *ret_known
 * says whether there is such a method; ret_known may be NULL. */
const char *bus_authority_action(const char *method, gboolean *ret_known);

struct bus_authority {
    GPtrArray *questions; /* of struct question: calls about which polkit has not answered yet; each
                             is freed by its last callback */
    struct bus_latch *latch; /* borrowed */
    gboolean asks;           /* TRUE on the system bus; FALSE if polkit is never asked */
};

void bus_authority_init(struct bus_authority *authority, struct bus_latch *latch,
                        const char *address);
/* Frees the list of questions. Call bus_authority_stop() first. */
void bus_authority_clear(struct bus_authority *authority);

/* Makes a skeleton that asks polkit about each call before its handler runs. authority is borrowed
 * until it is detached with NULL. */
BusRig1 *bus_authority_skeleton(void);
void bus_authority_attach(BusRig1 *skeleton, struct bus_authority *authority);

/* Ends the calls about which polkit has not answered yet, with BUS_ERROR_CANCELLED and the text
 * `why`. Returns TRUE if one of them was a Start or Resume. */
gboolean bus_authority_stop(struct bus_authority *authority, const char *why);

/* Returns the user who has called a method on the system bus. The invocation owns the result.
 * Returns NULL for a call about which polkit is not asked. Also returns NULL for the daemon's own
 * user and for root, who may do everything that the daemon can do. */
const struct bus_caller *bus_authority_caller(GDBusMethodInvocation *invocation);
