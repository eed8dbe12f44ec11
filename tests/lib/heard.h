/*
 * Records the events of a device of the simulated small rig, for the tests of the device classes:
 * the last event with its error and its picture, and the number of events since the last
 * heard_clear().
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

void heard_clear(struct heard *heard);
void heard_event(struct heard *heard, int event, const GError *error);

/* Waits for the next event. */
void heard_next(struct heard *heard, int event);
