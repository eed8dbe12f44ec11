/* Takes test shots and chooses exposures before a session of the queue. This is done by a child
 * process, “mesorig queue try”, which is a client of this daemon. It does what mesorig capture does
 * for a user at the rig. All functions belong to the main loop's thread. */
#pragma once

#include "queue.h"

struct bus_trial;

enum bus_trial_end {
    BUS_TRIAL_DONE,
    /* Any other failure than BUS_TRIAL_RIG. Most often the session would fail, or a file that it
     * names is wrong. */
    BUS_TRIAL_SESSION,
    BUS_TRIAL_RIG, /* a device has failed */
};

/* Called once, but never from within bus_trial_start(). chosen has the lines for
 * session_conf_choose(). said has warnings, or the reason why the test shots failed. Each of the
 * two texts may be empty. They are valid only during the call. */
typedef void (*BusTrialFunc)(const char *chosen, const char *said, enum bus_trial_end end,
                             gpointer data);

/* Starts the child process for the session `item`. address is the address that bus_new() has got.
 * Returns NULL with an error if the program mesorig is not found or cannot be started. */
struct bus_trial *bus_trial_start(const char *address, const struct queue_item *item,
                                  BusTrialFunc func, gpointer data, GError **error);

/* Ends the trial, and kills the program if it is still running. The daemon then switches off
 * everything that the program has switched on, as for every client that disconnects. NULL is
 * ignored. */
void bus_trial_free(struct bus_trial *trial);
