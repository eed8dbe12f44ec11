/*
 * Finds pulses in the samples of one pixel over time: private to sweep.h. Any thread.
 */
#pragma once

#include <glib.h>

/* A pixel's samples above its background in order of time, with those just before and after where
 * they are known. */
struct sweep_samples {
    const int *frame;
    const float *value;  /* DN above background */
    const float *gain;   /* factor that was applied to each; NULL: none */
    int n, first, count; /* first frame of the backgrounds; number of frames */
    float full;          /* values from here on are saturated */
    float margin;        /* values up to here do not belong to a line */
    float pedestal;      /* mean background in these values */
};

struct sweep_pulse {
    double time, width; /* frames; time < 0: the maximum is in the first or last frame */
    double height;      /* DN: its brightest sample */
};

/* Finds the brightest and the second brightest pulse; either may be NULL. Pulses are separate
 * where the signal falls below VALLEY (sweep_pulse.c) of the fainter one in between. Returns
 * their number, at most 2. */
int sweep_pulse_find(const struct sweep_samples *samples, struct sweep_pulse *ret_first,
                     struct sweep_pulse *ret_second);
