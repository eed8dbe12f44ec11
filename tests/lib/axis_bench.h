/* An axis, opened on its own, and what it has reported: for tests that do more than the conformance
 * suite. An error that a test does not expect fails the test. */
#pragma once

#include "conformance/conformance.h"

struct axis_bench {
    Clock *clock;
    Axis *axis;
    int n; /* events since the last axis_bench_expect(), without AXIS_PASSING */
    enum axis_event last;
    GError *error; /* of the last event; NULL if it had none */
};

/* Opens an axis and listens to it. text is a section of a rig file, and keys are more lines of the
 * section. Takes over the clock. */
void axis_bench_begin(struct axis_bench *bench, const struct axis_driver *driver, Clock *clock,
                      const char *text, const char *keys);
void axis_bench_end(struct axis_bench *bench);

/* Waits until the axis has reported, as conformance_wait() with a limit of 60 s. Fails the test if
 * the last event is not `event`, or has an error. Only AXIS_FAULT may have an error. */
void axis_bench_expect(struct axis_bench *bench, enum axis_event event);

/* These two functions give the command, and wait until the axis has arrived. */
void axis_bench_home(struct axis_bench *bench);
void axis_bench_move(struct axis_bench *bench, double deg);

/* Waits until the driver knows that the axis stands. */
void axis_bench_wait_safe(struct axis_bench *bench);
