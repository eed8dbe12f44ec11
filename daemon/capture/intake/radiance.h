/*
 * Converts raw pictures to linear radiance: means of dark frames, and merging of an exposure
 * bracket. The functions are pure and work on arrays. Any thread may call them.
 *
 * Values are DN above dark per millisecond of exposure at 0 dB. Radiance is such a value times 1000
 * divided by the camera's response (DN per second per W·sr⁻¹·m⁻²), apart from vignetting. The unit
 * of time is the millisecond because of the range of a half float: 4095 DN in half a millisecond
 * would be 8.2e6 DN/s, which exceeds the range.
 */
#pragma once

#include "drivers/frame.h"

/* Returns the DN from which a pixel counts as saturated: 98 % of full scale, rounded up. */
int radiance_saturation(int bits);
gint64 radiance_saturated(const Frame *frame); /* number of saturated pixels */

struct radiance_stats {
    /* Number of pixels that are saturated in every exposure. These pixels get the value of the
     * shortest exposure. */
    gint64 saturated;
    double signal_dn; /* mean of the longest exposure above dark, in DN */
};

/* Merges n ≥ 1 frames of the same size, the shortest exposure first. dark[i] is the dark level of
 * every pixel at the exposure of frame i. ret gets width × height values, and *ret_stats describes
 * them.
 *
 * The exposures of a pixel are weighted by their length. Exposures that are saturated at the merged
 * value of the pixel are left out. The pixel's own value in an exposure does not decide this,
 * because its noise would cause a bias.
 *
 * The curvature of the sensor is corrected first: a signal of x DN is read as x·(1 − bend_per_dn·x)
 * DN above dark. bend_per_dn is 0 for a linear sensor. */
void radiance_merge(const Frame *const *frames, const float *const *dark, int n, double gain_db,
                    double bend_per_dn, float *ret, struct radiance_stats *ret_stats);

/* Returns whether the exposures of one light contradict each other, for instance because the lamp
 * has failed between them. They do if an exposure is darker than the shorter one before it, or has
 * more than twice the signal that the shorter one predicts. Only pixels that neither of these two
 * exposures saturates are compared. A difference below 0.25 % of full scale does not count, because
 * the dark level may have drifted. frames, dark and n are as for radiance_merge(). */
gboolean radiance_disagrees(const Frame *const *frames, const float *const *dark, int n);

/* Returns the smallest merged value, in DN/ms, at which a pixel with this dark level is saturated
 * at this exposure. */
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
