/* What rectifying costs beside decoding, and beside OpenCV at the same error: part of bench_speed.
 */
#pragma once

#include <glib.h>

struct speed_rectify {
    double decode_ms, rectify_ms; /* a frame, one core */
    double prepare_ms;            /* a view */
    double error;                 /* RMS, relative, of texels against their exact means */
    double opencv_ms;             /* 0: there is none */
    double opencv_error;          /* of its fastest way that reaches ours, else of its best */
    gboolean opencv_reaches;
};
struct speed_rectify speed_rectify(void);
