/* A part of bench_devices. */
#pragma once

#include "bench.h"

#include <glib.h>

/* How long GigE Vision takes from a trigger to its whole picture: through the driver, and by the
 * bare protocol on plain sockets, in turns. Microseconds; ratios are driver to protocol. */
struct gige_latency {
    double register_us;          /* one register read, for scale */
    struct bench_times protocol; /* trigger to the last packet */
    struct bench_times driver;   /* camera_trigger() to CAMERA_FRAME */
};

void gige_latency(int width, int height, struct gige_latency *ret);
