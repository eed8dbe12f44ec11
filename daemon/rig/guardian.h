/*
 * A small process beside the daemon that makes the rig safe when the daemon cannot: when the daemon
 * has died without saying goodbye, or when its main loop hangs; then the guardian kills it. A timer
 * of the default main context sends it a heartbeat, in real time whatever the rig's clock. A time
 * in which the guardian itself was held up counts as half a second of silence, since a computer
 * that stands still holds the daemon up, too.
 */
#pragma once

#include "devices.h"

typedef struct Guardian Guardian;

/* Only devices that are not simulated need one. */
gboolean guardian_is_needed(const struct devices *devices);

/* Starts this program again with --guardian RIG. */
Guardian *guardian_start(const char *rig_path, GError **error);

/* busy: no light is on, nothing moves and the main loop is about to block, so silence until the
 * next heartbeat is not a hang. FALSE: silence is a hang again, from now on. NULL is ignored. */
void guardian_set_busy(Guardian *guardian, gboolean busy);

/* Ends the guardian. safe: the rig is safe; otherwise the guardian makes it safe. NULL is ignored.
 */
void guardian_end(Guardian *guardian, gboolean safe);

/* The guardian itself; its standard input is the daemon's heartbeat. Returns the exit code. */
int guardian_main(const char *rig_path);
