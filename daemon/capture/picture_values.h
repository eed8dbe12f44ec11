/* Measures the exposure and the focus of a camera's frame. The functions are pure, and any thread
 * may call them. */
#pragma once

#include "drivers/frame.h"

#define PICTURE_BINS 64

struct picture_values {
    double mean_dn, max_dn;
    double high_dn;   /* 99th percentile */
    double saturated; /* part of the pixels that have the value 2^bits − 1 */
    double dark;      /* part of the pixels whose value above black is below 1/256 of the range */
    double focus;     /* see below; 0 if the frame is dark */
    /* histogram: numbers of pixels in equal parts of the range 0 … 2^bits − 1 */
    guint bins[PICTURE_BINS];
};

/* Measures a frame. `focus` is the RMS of the Laplacian 4 I(x, y) − I(x ± s, y) − I(x, y ± s),
 * divided by the mean of I. I is the value above black. s is 2 for a sensor with a colour filter,
 * otherwise 1. (Pech-Pacheco et al. 2000 use the variance of the Laplacian.)
 *
 * `focus` grows as the picture becomes sharper. It can only be compared between pictures of the
 * same scale under the same light. */
struct picture_values picture_values(const Frame *frame);
