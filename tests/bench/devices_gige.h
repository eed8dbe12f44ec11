/* A part of bench_devices. */
#pragma once

#include <glib.h>

/* How long GigE Vision takes from a trigger to its whole picture: through the driver, and by the
 * bare protocol on plain sockets, in turns. Microseconds; ratios are driver to protocol. */
struct gige_latency {
    double register_us;                  /* one register read, for scale */
    double protocol_us, protocol_p99_us; /* trigger to the last packet */
    double driver_us, driver_p99_us;     /* camera_trigger() to CAMERA_FRAME */
};

void gige_latency(int width, int height, struct gige_latency *ret);
