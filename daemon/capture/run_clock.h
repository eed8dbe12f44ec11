/* The clock of a session. It counts the seconds of the rig's clock during which the session was
 * captured, over all runs of the session. The clock stands while the session is paused. The struct
 * is owned by struct capture_session, which also saves the value. Only the capture starts and stops
 * the clock. All functions belong to the main loop's thread. */
#pragma once

#include "drivers/clock.h"

struct run_clock {
    Clock *clock; /* the rig's clock; borrowed */
    /* value of the session's clock when it was last started or, while it is stopped, now */
    double base_s;
    /* Time of the rig's clock at which the session's clock was last started; −1 while the session's
     * clock is stopped. */
    gint64 since_us;
};

void run_clock_start(struct run_clock *clock);
void run_clock_stop(struct run_clock *clock);

/* Return the value of the session's clock in seconds. run_clock_now_s() returns the present value.
 * run_clock_at_s() returns the value at the time at_us of the rig's clock. */
double run_clock_now_s(const struct run_clock *clock);
double run_clock_at_s(const struct run_clock *clock, gint64 at_us);
