/* The commands `mesorig queue …`, and what other commands say of the queue. */
#pragma once

#include "command/cli.h"
#include "command/link.h"

extern const struct command unattended_queue;

/* Of daemon/bus/bus_trial.c alone: the test shots before a session of the queue, from a request at
 * standard input to the chosen exposures at standard output. Exit code 3: a device has failed. */
extern const struct command unattended_try;

/* Adds the queue as the daemon shows it: values, and for people a few words or (list) all sessions,
 * a line each. */
void unattended_tell(Record *to, BusRig1 *rig, gboolean list);
