/* Test shots and the choice of exposures before a session of the queue. The program mesorig
 * (“mesorig queue try”) makes them as a client of this daemon, as mesorig capture does for somebody
 * who sits at the rig. Main loop's thread. */
#pragma once

#include "bus_private.h"

struct bus_trial;

enum bus_trial_end {
    BUS_TRIAL_DONE,
    BUS_TRIAL_SESSION, /* this session would be spoilt, or a file that it names is wrong */
    BUS_TRIAL_RIG,     /* a device has failed */
};

/* Called once, never from within bus_trial_start(). chosen: lines for session_conf_choose(). said:
 * warnings, or why the test shots have failed. */
typedef void (*BusTrialFunc)(Bus *bus, char *chosen, char *said, enum bus_trial_end end);

struct bus_trial *bus_trial_start(Bus *bus, const struct queue_item *item, BusTrialFunc func,
                                  GError **error);

/* Kills the program if it runs. The daemon then switches off what the program has switched on, as
 * it does for every client that has gone. NULL is ignored. */
void bus_trial_free(struct bus_trial *trial);
