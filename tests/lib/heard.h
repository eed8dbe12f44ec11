/*
 * Records the events of a device of the simulated small rig, for the tests of the device classes:
 * the last event with its error and its picture, and the number of events since the last
 * heard_next().
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

/* Fixture of a test, with a virtual clock. */
void heard_begin(struct heard *heard, gconstpointer unused);
void heard_end(struct heard *heard, gconstpointer unused);

/* Drops the last error and the last picture. The number of events does not change. */
void heard_clear(struct heard *heard);
void heard_event(struct heard *heard, int event, const GError *error);

/* Waits for an event. Fails the test unless it is this event, and the only one since the last
 * heard_next(). */
void heard_next(struct heard *heard, int event);
