/* What rectifying costs beside decoding: part of bench_measurement. */
#pragma once

#include "measurement_rig.h"

struct bench_speed {
    double decode_ms, rectify_ms, errors_ms; /* a frame */
    double prepare_ms, guide_ms;             /* a view */
};

/* One core, a frame as capture stores it. */
struct bench_speed bench_speed(const struct bench_setup *setup, int view);
