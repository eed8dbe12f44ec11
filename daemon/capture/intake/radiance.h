/*
 * From raw pictures to linear radiance: the mean of dark frames, and the merging of an exposure
 * bracket. Pure functions over arrays; any thread.
 *
 * Values are DN a millisecond of exposure at 0 dB, above dark. Divided by the camera's response
 * (DN per second per W·sr⁻¹·m⁻²) and times 1000 they are radiance, vignetting aside. Milliseconds,
 * because 4095 DN in half a millisecond are 8.2e6 DN/s, more than a half float holds.
 */
#pragma once

#include "drivers/frame.h"

/* DN from which a pixel is taken to be saturated: 98 % of full scale, rounded up. */
int radiance_saturation(int bits);
gint64 radiance_saturated(const Frame *frame); /* number of saturated pixels */

struct radiance_stats {
    gint64 saturated; /* pixels saturated in every exposure: they hold the shortest's value */
    double signal_dn; /* mean above dark, of the longest exposure */
};

/* Merges n ≥ 1 frames of the same size, shortest exposure first. dark[i] is the dark level of every
 * pixel at frame i's exposure. Each pixel's exposures are weighted by their length; those that by
 * their common mean are saturated are left out, so that noise makes no bias there. A sensor that
 * shows linear·(1 − bend·linear) DN above dark is made linear first; 0 for one that is. ret has
 * width × height values. */
void radiance_merge(const Frame *const *frames, const float *const *dark, int n, double gain_db,
                    double bend_per_dn, float *ret, struct radiance_stats *ret_stats);

/* Whether the exposures of one light disagree, as they do if the lamp dies between them: over the
 * pixels that none saturates, a longer exposure is darker than the shorter one before it, or has
 * more than twice the signal that the shorter one accounts for; by 0.25 % of full scale or more, so
 * that a dark level that has drifted is none. Frames and dark as for radiance_merge(). */
gboolean radiance_disagrees(const Frame *const *frames, const float *const *dark, int n);

/* The least merged value (see above) at which a pixel of this dark level saturates an exposure. */
double radiance_ceiling(int bits, gint64 exposure_us, double dark_dn, double gain_db,
                        double bend_per_dn);

/* 1 for each pixel that is saturated in all of the frames, else 0. */
void radiance_mark(const Frame *const *frames, int n, float *ret);

/* Adds a frame to sums; n sums divided by n are the dark level. */
void radiance_add(const Frame *frame, guint32 *sums);
/* Writes the dark level of every pixel and returns their mean. */
double radiance_mean(const guint32 *sums, int n, gsize n_pixels, float *ret);

/* Number of pixels more than margin_dn above dark: those that a laser lights if it stays on. */
gint64 radiance_lit(const Frame *frame, const float *dark, double margin_dn);
