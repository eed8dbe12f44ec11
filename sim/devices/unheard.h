/*
 * A fault of simulated devices that imitates a line that fails. The answer to one command is lost.
 * For a time after this, the device may be dead: it neither obeys nor answers.
 */
#pragma once

#include "drivers/device.h"

/* Time in µs after which the driver reports that a command was not answered. */
#define SIM_UNHEARD_US 500000

struct sim_unheard {
    int nth;       /* number of the command whose answer is lost, counted from 1; 0: none */
    double dead_s; /* time in s after this command in which the device neither obeys nor answers */
    int n_commands;
    gint64 dead_until_us; /* end of the time dead_s, on the rig's clock */
};

/* The rows of a driver's table of options that set a struct sim_unheard. `at` is the offset of the
 * struct sim_unheard in the driver's struct. */
/* clang-format off */
#define SIM_UNHEARD(at, field) ((at) + G_STRUCT_OFFSET(struct sim_unheard, field))
#define SIM_UNHEARD_OPTIONS(at)                                                                    \
    {"fault_unheard", OPTION_INT, NULL, 0, G_MAXINT, "0", NULL, SIM_UNHEARD(at, nth),              \
     "Fault: the n-th command is carried out, but its answer is lost; 0: no answer is lost"},      \
    {"fault_dead_s", OPTION_DOUBLE, "s", 0, 86400, "0", NULL, SIM_UNHEARD(at, dead_s),             \
     "Fault: time after fault_unheard in which the device neither obeys nor answers"}
/* clang-format on */

/* Returns whether the device carries out a command that reaches it now. Sets *ret_answers to
 * whether the device answers the command. */
gboolean sim_unheard_obeys(struct sim_unheard *fault, const Clock *clock, gboolean *ret_answers);
gboolean sim_unheard_is_dead(const struct sim_unheard *fault, const Clock *clock);
/* Returns the error of a command that was not answered. */
GError *sim_unheard_error(const struct device *device);
