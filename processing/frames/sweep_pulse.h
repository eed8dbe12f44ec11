/*
 * Finds pulses in the samples of one pixel over time: private to sweep.h. Any thread.
 */
#pragma once

#include <glib.h>

/* A pixel's samples above its background, in order of time. The samples just before and after them
 * are included if they were recorded. */
struct sweep_samples {
    const int *frame;
    const float *value; /* DN above background */
    const float *gain;  /* factor that was applied to each value; NULL if none was */
    /* n: number of samples
     * first: first frame of the backgrounds
     * count: number of frames */
    int n, first, count;
    float full;   /* values from here on are saturated */
    float margin; /* values up to here do not belong to a line */
    /* DN: difference between the mean of the samples without a line and the background, which is
     * their minimum */
    float pedestal;
};

struct sweep_pulse {
    double time, width; /* frames; time < 0 if the maximum or a flank lies outside of the frames */
    double height;      /* DN: value of the brightest sample */
};

/* Finds the brightest pulse (ret_first) and the second brightest pulse (ret_second). Either result
 * may be NULL. Returns the number of pulses, 0 … 2. Between two pulses the signal falls below
 * VALLEY (sweep_pulse.c) of the fainter one. */
int sweep_pulse_find(const struct sweep_samples *samples, struct sweep_pulse *ret_first,
                     struct sweep_pulse *ret_second);
