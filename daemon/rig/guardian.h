/*
 * A small process beside the daemon that makes the rig safe when the daemon cannot any more: when
 * it has died without saying goodbye, or when its main loop has hung, for which it is killed. It
 * hears a heartbeat from a timer of the default main context, in real time whatever the rig's
 * clock.
 */
#pragma once

#include "devices.h"

typedef struct Guardian Guardian;

/* Only devices that are not simulated need one. */
gboolean guardian_is_needed(const struct devices *devices);

/* Starts this program again with --guardian RIG. */
Guardian *guardian_start(const char *rig_path, GError **error);

/* busy: nothing shines or moves, and the main loop is about to be kept busy: until the next
 * heartbeat silence is no hang. FALSE: it is again, from now on. NULL is ignored. */
void guardian_set_busy(Guardian *guardian, gboolean busy);

/* safe: the rig is safe, it may go; or else it makes sure of that. NULL is ignored. */
void guardian_end(Guardian *guardian, gboolean safe);

/* The guardian itself; its standard input is the daemon's heartbeat. Returns the exit code. */
int guardian_main(const char *rig_path);
