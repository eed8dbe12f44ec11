/* The commands `mesorig queue …`, and the description of the queue for other commands. */
#pragma once

#include "common/cli.h"
#include "common/link.h"

extern const struct command unattended_queue;

/* Takes the test shots before a session of the queue. Only daemon/bus/bus_trial.c runs this
 * command. The command reads a request from standard input, and prints the chosen exposures to
 * standard output. Its exit code is 3 if a device has failed. */
extern const struct command unattended_try;

/* Adds the state of the daemon's queue, as values and as a text for people. If list is TRUE, the
 * text has one line for each session; otherwise it has a few words. */
void unattended_tell(Record *to, BusRig1 *rig, gboolean list);
