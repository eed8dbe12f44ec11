/* The line between a simulated device and the computer, with the faults of real ones: a command
 * that is carried out and not answered, and after it a time in which nothing gets through. */
#pragma once

#include "base/options.h"
#include "drivers/clock.h"

struct sim_line {
    int fault_unheard;
    double fault_dead_s;
    int n_commands;
    gint64 dead_until_us; /* on the device's clock */
};

/* Rows of a driver's table; at: offset of its struct sim_line. */
/* clang-format off */
#define SIM_LINE_OPTIONS(at)                                                                       \
    {"fault_unheard", OPTION_INT, NULL, 0, G_MAXINT, "0", NULL,                                    \
     (at) + G_STRUCT_OFFSET(struct sim_line, fault_unheard),                                       \
     "Fault: the n-th command is carried out and its answer is lost; 0: none is"},                 \
    {"fault_dead_s", OPTION_DOUBLE, "s", 0, 1e9, "0", NULL,                                        \
     (at) + G_STRUCT_OFFSET(struct sim_line, fault_dead_s),                                        \
     "Fault: for how long, after the command of fault_unheard, the device answers nothing and "    \
     "does nothing"}
/* clang-format on */

enum sim_fate { SIM_HEARD, SIM_UNHEARD, SIM_DEAD };

/* What becomes of a command that is sent now. */
enum sim_fate sim_line_send(struct sim_line *line, const Clock *clock);
gboolean sim_line_is_dead(const struct sim_line *line, const Clock *clock);
