/*
 * What a device of the simulated small rig says, for the tests of the device classes: the last
 * event, its error and its picture, and how many there were since anybody asked.
 */
#pragma once

#include "simulated.h"

struct heard {
    int n;
    int event;
    GError *error;
    Frame *frame;
    gint64 at_us;
    Clock *clock;
};

static inline void heard_clear(struct heard *heard) {
    g_clear_error(&heard->error);
    g_clear_pointer(&heard->frame, frame_unref);
}

static inline void hear(struct heard *heard, int event, const GError *error) {
    heard->n++;
    heard->event = event;
    heard->at_us = clock_now_us(heard->clock);
    g_clear_error(&heard->error);
    heard->error = error ? g_error_copy(error) : NULL;
}

/* Waits for the next event. */
static inline void next(struct heard *heard, int event) {
    conformance_wait(heard->clock, &heard->n, 1, 1000);
    g_assert_cmpint(heard->n, ==, 1);
    g_assert_cmpint(heard->event, ==, event);
    heard->n = 0;
}
