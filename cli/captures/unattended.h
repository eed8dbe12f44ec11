/* The commands `mesorig queue …`, and the description of the queue for other commands. */
#pragma once

#include "common/cli.h"
#include "common/link.h"

extern const struct command unattended_queue;

/* Takes the test shots before a session of the queue. Only daemon/bus/bus_trial.c runs this
 * command. It reads a request from standard input and prints the chosen exposures to standard
 * output. Exit code 3 means that a device has failed. */
extern const struct command unattended_try;

/* Adds the state of the queue in the daemon: values, and a text for people. If list is TRUE, the
 * text has one line for each session; otherwise it has a few words. */
void unattended_tell(Record *to, BusRig1 *rig, gboolean list);
