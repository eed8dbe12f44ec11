/*
 * Standard errors of merged distances: private to mdf.h. Any thread.
 *
 * A distance m = Σ w x is the mean of the distances x of n sweeps with weights w, Σ w = 1. Its
 * variance has three parts.
 *
 * 1. Errors of the times of pulses. In frames, these errors are about equal in all sweeps. One
 * frame of a sweep corresponds to a depth g along the ray. Therefore m has the variance u V with V
 * = Σ w² g². u, in frames², follows from the scatter of the sweeps:
 *   S = Σ a (x − m)²,  a = w² / (1 − w),  E = Σ a (g² (1 − 2 w) + V),  u = S / E,
 *   ν = max(1, (Σ a g²)² / Σ (a g²)² − 1) degrees of freedom.
 *
 * If only u were used, the errors of two sweeps in units of σ would follow Student's t with one
 * degree of freedom, whose variance is infinite. Therefore u is mixed with ū, the mean over the 5 ×
 * 5 texels around, which counts as k further degrees of freedom: û = (ν u + k ū) / (ν + k). This is
 * the expectation of u if true values follow an inverse χ² distribution with k + 2 degrees of
 * freedom about ū. k is the most likely value for the view (Smyth 2004; here ū is local).
 *
 * 2. An error that all sweeps have in common, because they sample the surface at the same pixels
 * and interpolate. The bend of the surface z over the spacing h of the pixels is
 *   b = (z(−h) + z(h)) / 2 − z(0),
 * as a mean over sweeps, without the noise of the times. V_b is the mean of b², and p follows from
 * V_b(2h) / V_b(h) = 2^p. The variance of the interpolated distance is then q(p) (b_x² + b_y²).
 * This holds for a surface whose squared differences grow with the p-th power of distance
 * (Mandelbrot & Van Ness 1968). p = 4 is a smooth surface, 3 has creases, 1 has steps, 0 is rough
 * in every pixel.
 *
 * 3. An error that no sweep shows. In a sweep, some pixels around a texel may see no line although
 * other pixels do. They may see another side of an edge, which is in shadow or too dark. The texel
 * lies on that side with the probability h. h is the share of such pixels, as a mean over sweeps;
 * their weights decrease linearly to 0 at two pixel spacings.
 *
 * A step s between the sides adds h s² to the variance. s² is computed from the texels around
 * (mdf.c). With few sweeps, the shadow of one sweep is a large part of h, and nothing is added.
 */
#pragma once

#include "mdf_merge.h"

#include <glib.h>

struct mdf_errors_grid {
    int width, height;
    double spacing[2]; /* spacing of pixels that see the laser, in texels, along rows and columns */
};

/* Computes the errors of texels whose distance is the mean of at least two sweeps. Other elements
 * of ret_error_mm (width × height) are not changed. spreads has an element for each texel (width ×
 * height), in which all members of an unknown texel are 0. */
void mdf_errors_find(const struct mdf_errors_grid *grid, const struct mdf_spread *spreads,
                     float *ret_error_mm);

/* Returns q(p): the mean square error of bilinear interpolation in a square cell, divided by the
 * sum of its two squared bends. p: 0 … 4. */
double mdf_errors_between(double p);
