#include "line.h"

gboolean sim_line_is_dead(const struct sim_line *line, const Clock *clock) {
    return clock_now_us(clock) < line->dead_until_us;
}

enum sim_fate sim_line_send(struct sim_line *line, const Clock *clock) {
    if (sim_line_is_dead(line, clock))
        return SIM_DEAD;
    if (++line->n_commands != line->fault_unheard)
        return SIM_HEARD;
    line->dead_until_us = clock_now_us(clock) + (gint64)(line->fault_dead_s * 1e6);
    return SIM_UNHEARD;
}
