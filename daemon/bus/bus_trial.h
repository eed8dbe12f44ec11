/* Test shots before a session of the queue, and exposures that are chosen: the program mesorig
 * (“mesorig queue try”) takes them as a client of this daemon, as mesorig capture does for somebody
 * who sits before the rig. Main loop's thread. */
#pragma once

#include "bus_private.h"

struct bus_trial;

enum bus_trial_end {
    BUS_TRIAL_DONE,
    BUS_TRIAL_SESSION, /* this session would be spoilt, or a file that it names is wrong */
    BUS_TRIAL_RIG,     /* a device has failed */
};

/* Not from within bus_trial_start(). chosen: for session_conf_choose(). said: warnings, or why it
 * has failed. */
typedef void (*BusTrialFunc)(Bus *bus, char *chosen, char *said, enum bus_trial_end end);

struct bus_trial *bus_trial_start(Bus *bus, const struct queue_item *item, BusTrialFunc func,
                                  GError **error);

/* Kills it if it runs: what it has switched on goes off, for the client has gone. NULL is ignored.
 */
void bus_trial_free(struct bus_trial *trial);
