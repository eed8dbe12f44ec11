/* The clock of a session: the seconds of the rig's clock during which the session was captured, in
 * all of its runs. The clock stands while the session is paused. Owned by struct capture_session,
 * which also saves its value. The capture starts and stops it, other files only read it. Main
 * loop's thread. */
#pragma once

#include "drivers/clock.h"

struct run_clock {
    Clock *clock;  /* the rig's clock; borrowed */
    double base_s; /* value of the session's clock at since_us, or while it is stopped */
    /* time of the rig's clock when the session's clock was started; −1 while the session's clock
     * is stopped */
    gint64 since_us;
};

void run_clock_start(struct run_clock *clock);
void run_clock_stop(struct run_clock *clock);

/* Return the value of the session's clock in seconds: now, and at the time at_us of the rig's
 * clock. */
double run_clock_now_s(const struct run_clock *clock);
double run_clock_at_s(const struct run_clock *clock, gint64 at_us);
