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

/* The fixture of a test, with a virtual clock. */
void heard_begin(struct heard *heard, gconstpointer unused);
void heard_end(struct heard *heard, gconstpointer unused);

void heard_clear(struct heard *heard);
void heard_event(struct heard *heard, int event, const GError *error);

/* Waits for the next event. */
void heard_next(struct heard *heard, int event);
