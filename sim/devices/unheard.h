/*
 * A fault of simulated devices: the answer to one command is lost, and then the device may be dead
 * for a while, as on a line that fails.
 */
#pragma once

#include "drivers/device.h"

/* After a command that is not answered, its driver reports the time-out. */
#define SIM_UNHEARD_US 500000

struct sim_unheard {
    int nth; /* options */
    double dead_s;
    int n_commands;
    gint64 dead_until_us;
};

/* The options of a struct sim_unheard at an offset, for a driver's table. */
/* clang-format off */
#define SIM_UNHEARD(at, field) ((at) + G_STRUCT_OFFSET(struct sim_unheard, field))
#define SIM_UNHEARD_OPTIONS(at)                                                                    \
    {"fault_unheard", OPTION_INT, NULL, 0, G_MAXINT, "0", NULL, SIM_UNHEARD(at, nth),              \
     "Fault: the n-th command is carried out and its answer is lost; 0: none is"},                 \
    {"fault_dead_s", OPTION_DOUBLE, "s", 0, 86400, "0", NULL, SIM_UNHEARD(at, dead_s),             \
     "Fault: how long the device then neither obeys nor answers"}
/* clang-format on */

/* Whether a command that reaches the device now is carried out, and whether it is answered. */
gboolean sim_unheard_obeys(struct sim_unheard *fault, const Clock *clock, gboolean *ret_answers);
gboolean sim_unheard_is_dead(const struct sim_unheard *fault, const Clock *clock);
GError *sim_unheard_error(const struct device *device);
