/* The commands `mesorig queue …`, and what other commands say of the queue. */
#pragma once

#include "command/cli.h"
#include "command/link.h"

extern const struct command unattended_queue;

/* Only daemon/bus/bus_trial.c runs this command: it takes the test shots before a session of the
 * queue, reads a request from standard input and prints the chosen exposures to standard output.
 * Exit code 3: a device has failed. */
extern const struct command unattended_try;

/* Adds the queue as the daemon shows it: values, and for people a few words or (list) all sessions,
 * a line each. */
void unattended_tell(Record *to, BusRig1 *rig, gboolean list);
