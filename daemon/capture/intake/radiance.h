/*
 * Converts raw pictures to linear radiance: means of dark frames, merging of an exposure bracket.
 * Pure functions on arrays; any thread.
 *
 * Values are DN above dark per millisecond of exposure at 0 dB. Radiance is such a value times 1000
 * divided by the camera's response (DN per second per W·sr⁻¹·m⁻²), apart from vignetting. The unit
 * is a millisecond because 4095 DN in half a millisecond are 8.2e6 DN/s, which exceeds the range of
 * a half float.
 */
#pragma once

#include "drivers/frame.h"

/* Returns the DN from which a pixel counts as saturated: 98 % of full scale, rounded up. */
int radiance_saturation(int bits);
gint64 radiance_saturated(const Frame *frame); /* number of saturated pixels */

struct radiance_stats {
    /* Number of pixels that are saturated in every exposure. They have the value of the shortest
     * exposure. */
    gint64 saturated;
    double signal_dn; /* mean of the longest exposure above dark, in DN */
};

/* Merges n ≥ 1 frames of the same size, shortest exposure first. dark[i] is the dark level of every
 * pixel at the exposure of frame i. ret has width × height values, and *ret_stats describes them.
 *
 * The exposures of a pixel are weighted by their length. Saturated exposures are left out. Whether
 * an exposure is saturated is decided by the merged value instead of its own noisy value, so that
 * noise causes no bias. The curvature of the sensor is corrected first: a signal of x DN is read as
 * x·(1 − bend_per_dn·x) DN above dark; bend_per_dn is 0 for a linear sensor. */
void radiance_merge(const Frame *const *frames, const float *const *dark, int n, double gain_db,
                    double bend_per_dn, float *ret, struct radiance_stats *ret_stats);

/* Returns whether the exposures of one light disagree, for instance because the lamp has failed
 * between them. They disagree if a longer exposure is darker than the shorter one before it, or
 * has more than twice the signal that the shorter one predicts. Only pixels that neither of
 * these two exposures saturates are compared. A difference below 0.25 % of full scale does not
 * count, because the dark level may have drifted. Frames and dark are as for radiance_merge(). */
gboolean radiance_disagrees(const Frame *const *frames, const float *const *dark, int n);

/* Returns the smallest merged value, in DN/ms, at which a pixel with this dark level is saturated
 * in an exposure. */
double radiance_ceiling(int bits, gint64 exposure_us, double dark_dn, double gain_db,
                        double bend_per_dn);

/* Sets each pixel to 1 if it is saturated in all frames, otherwise to 0. */
void radiance_mark(const Frame *const *frames, int n, float *ret);

/* Adds each pixel of a frame to its sum. radiance_mean() computes the dark level from the sums. */
void radiance_add(const Frame *frame, guint32 *sums);
/* Computes the dark level of every pixel from the sums of n frames, and returns the mean of these
 * levels. */
double radiance_mean(const guint32 *sums, int n, gsize n_pixels, float *ret);

/* Returns the number of pixels that are more than margin_dn above dark. */
gint64 radiance_lit(const Frame *frame, const float *dark, double margin_dn);
