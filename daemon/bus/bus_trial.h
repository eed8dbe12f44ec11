/* Test shots and the choice of exposures before a session of the queue. A child process, “mesorig
 * queue try”, takes these shots as a client of this daemon, as mesorig capture does for a user at
 * the rig. All functions belong to the main loop's thread. */
#pragma once

#include "queue.h"

struct bus_trial;

enum bus_trial_end {
    BUS_TRIAL_DONE,
    BUS_TRIAL_SESSION, /* a failure other than BUS_TRIAL_RIG: most often the session would fail, or
                          a file that it names is wrong */
    BUS_TRIAL_RIG,     /* a device has failed */
};

/* Called once, never from within bus_trial_start(). chosen contains the lines for
 * session_conf_choose(). said contains warnings, or the reason why the test shots failed. Both
 * may be empty, and both are valid only during the call. */
typedef void (*BusTrialFunc)(const char *chosen, const char *said, enum bus_trial_end end,
                             gpointer data);

/* Starts the child process for the session `item`. address is the argument of bus_new(). Returns
 * NULL with an error if the program mesorig is not found or cannot be started. */
struct bus_trial *bus_trial_start(const char *address, const struct queue_item *item,
                                  BusTrialFunc func, gpointer data, GError **error);

/* Ends the trial. If the program runs, it is killed. The daemon then switches off everything that
 * the program has switched on, as for every client that has disconnected. NULL is ignored. */
void bus_trial_free(struct bus_trial *trial);
