#include "run_clock.h"

void run_clock_start(struct run_clock *clock) {
    clock->since_us = clock_now_us(clock->clock);
}

void run_clock_stop(struct run_clock *clock) {
    clock->base_s = run_clock_now_s(clock);
    clock->since_us = -1;
}

double run_clock_at_s(const struct run_clock *clock, gint64 at_us) {
    if (clock->since_us < 0)
        return clock->base_s;
    return clock->base_s + (at_us - clock->since_us) * 1e-6;
}

double run_clock_now_s(const struct run_clock *clock) {
    return run_clock_at_s(clock, clock_now_us(clock->clock));
}
