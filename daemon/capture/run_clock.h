/* The clock of a session: the seconds of the rig's clock during which the session was captured, in
 * all of its runs. The clock stands while the session is paused. Owned by struct capture_session,
 * which also saves its value. The capture starts and stops it, other files only read it. Main
 * loop's thread. */
#pragma once

#include "drivers/clock.h"

struct run_clock {
    Clock *clock;    /* of the rig; borrowed */
    double base_s;   /* value of the session's clock at since_us, or while it is stopped */
    gint64 since_us; /* time of the rig's clock; −1 while the session's clock is stopped */
};

void run_clock_start(struct run_clock *clock);
void run_clock_stop(struct run_clock *clock);

/* Return the value now, and the value at a time of the rig's clock. */
double run_clock_now_s(const struct run_clock *clock);
double run_clock_at_s(const struct run_clock *clock, gint64 at_us);
