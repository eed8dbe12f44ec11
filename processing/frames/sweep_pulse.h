/*
 * Pulses in what one pixel saw over time: private to sweep.h. Any thread.
 */
#pragma once

#include <glib.h>

/* A pixel's samples above its background, in order of time, and, where they are known, those just
 * before and after. */
struct sweep_samples {
    const int *frame;
    const float *value;  /* DN above background */
    const float *gain;   /* of each, what its DN were multiplied by; NULL: nothing */
    int n, first, count; /* first: frame that backgrounds begin with; count: frames there were */
    float full;          /* values from here on are saturated */
    float margin;        /* values up to here are not yet a line */
    float pedestal;      /* what background is, in these values */
};

struct sweep_pulse {
    double time,
        width;     /* frames; time < 0: it was at its brightest in that first or the last frame */
    double height; /* DN, its brightest sample */
};

/* The brightest pulse and the next: another one is told apart where it becomes less than VALLEY
 * (sweep_pulse.c) of the fainter in between. Either may be NULL. How many there are, 2 at most. */
int sweep_pulse_find(const struct sweep_samples *samples, struct sweep_pulse *ret_first,
                     struct sweep_pulse *ret_second);
