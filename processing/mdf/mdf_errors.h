/*
 * Standard errors of merged distances: private to mdf.h. Any thread.
 *
 * A distance m = Σ w x is the mean of n sweeps' distances x with shares w of their weight. Its
 * variance has three parts.
 *
 * 1. Times of pulses. They are off by alike numbers of frames in all sweeps, and a frame of a sweep
 * is g deep along the ray. So m has the variance u V with V = Σ w² g², and u, in frames², follows
 * from the sweeps' scatter:
 *   S = Σ a (x − m)²,  a = w² / (1 − w),  E = Σ a (g² (1 − 2 w) + V),  u = S / E,
 *   ν = max(1, (Σ a g²)² / Σ (a g²)² − 1) degrees of freedom.
 * By u alone two sweeps' errors in units of σ would follow Student's t of one degree of freedom,
 * whose variance is infinite. So u is mixed with ū, the mean of the 5 × 5 texels around, which
 * counts as k more degrees: û = (ν u + k ū) / (ν + k). That is the expectation of u if true values
 * follow an inverse χ² of k + 2 degrees about ū; k is the view's likeliest (Smyth 2004; ū: local).
 *
 * 2. What all sweeps share: they read the surface at the same pixels, and interpolate. With b =
 * (z(−h) + z(h)) / 2 − z(0) the bend of the surface over the spacing h of the pixels, V_b = E b²
 * and V_b(2h) / V_b(h) = 2^p, the variance is q(p) (b_x² + b_y²), for a surface whose squared
 * differences grow with the p-th power of distance (Mandelbrot & Van Ness 1968; p = 4 is smooth, 3
 * has creases, 1 steps, 0 is rough in every pixel). b: mean over sweeps, without the times' noise.
 *
 * 3. What no sweep shows. Pixels around that see no line in sweeps that light others may see
 * another side of an edge, in shadow or too dark. The texel lies there as well, with the
 * probability h, the mean over sweeps of such pixels' share (weights fall linearly to 0 two
 * spacings of pixels away). The step s between the sides adds h s², s² from the texels around
 * (mdf.c). With few sweeps the shadow of one is a large part of h, and nothing is added.
 */
#pragma once

#include "mdf_merge.h"

#include <glib.h>

/* samples: n agreeing ones; mean: their weighted mean. */
void mdf_spread_of(const struct mdf_candidate *samples, int n, double mean, struct mdf_spread *ret);

struct mdf_errors_grid {
    int width, height;
    double spacing[2]; /* of pixels that see the laser, in texels, along rows and columns */
};

/* spreads: width × height, 0: unknown. Sets errors where two or more sweeps saw; others stay. */
void mdf_errors_find(const struct mdf_errors_grid *grid, const struct mdf_spread *spreads,
                     float *ret_error_mm);

/* q(p): the mean square error of bilinear interpolation in a square cell over the sum of its two
 * squared bends. p: 0 … 4. */
double mdf_errors_between(double p);
