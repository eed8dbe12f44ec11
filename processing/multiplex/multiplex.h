/*
 * Pictures under several lamps at once, and what each lamp alone would have shown.
 *
 * n lamps of a rig that stands still are taken with n patterns. Pattern k lights the lamps j with
 * s_kj = 1; S is an S-matrix of order n: cyclic, of zeros and ones, with (n + 1)/2 ones in each row
 * and S Sᵀ = (n + 1)/4 · (I + J), J being all ones (Harwit and Sloane 1979). A lamp is in its own
 * pattern: s_kk = 1. Light adds up, so that the pictures of the patterns are m = S x, and those of
 * the lamps
 *   x = S⁻¹ m,   S⁻¹ = 2/(n + 1) · (2 Sᵀ − J)     (Schechner, Nayar and Belhumeur 2003)
 *
 * Noise. A picture of brightness m has the variance a + b·m: read noise, and photons. All entries
 * of S⁻¹ are ±2/(n + 1), so that all n pictures have the same variance, which is
 *   4n/(n + 1)² · (a + b·m̄),   m̄ = (n + 1)/(2n) · Σ x   the mean of the patterns
 *   = 4n/(n + 1)² · a + 2/(n + 1) · b·Σ x
 * instead of a + b·x. Where a prevails it falls to about 4/n; where photons do, it doubles, and
 * lamps one at a time are better (Schechner, Nayar and Belhumeur 2007; Ratner and Schechner 2007,
 * who choose how many lamps are lit by the noise: here the order n does it, a rig's lamps being
 * divided into groups of n). Two pictures of a group have the covariance −1/n of that variance.
 *
 * Exposed for the part r of the time, a is a/r², b is b/r (transfer_noise()): multiplex_part() is
 * the r at which the noise is what it would have been.
 *
 * Pure functions over arrays: any thread.
 */
#pragma once

#include <glib.h>

#define MULTIPLEX_LEAST 3
#define MULTIPLEX_MOST  127

/* The largest order that is at most this and has a matrix here: 3, 7, 11, 15, 19, 23, 31, 35, 43,
 * 47, 59, 63, 67, 71, 79, 83, 103, 107, 127; 0: there is none. */
int multiplex_order(int most);

/* s_kj: whether pattern k of an order lights lamp j; both from 0. */
gboolean multiplex_lit(int n, int pattern, int lamp);

/* Puts the n pictures of the lamps into the place of those of the patterns; n_pixels values each.
 * Sums are kept in double. */
void multiplex_solve(int n, float *const *pictures, gsize n_pixels);

/* 4n/(n + 1)²: the variance of each lamp's picture, that of a pattern's being 1. 1 for n = 1. */
double multiplex_variance(int n);

/* The part r of the exposure with which the variance of n lamps together is that of one alone,
 * a + b·x, x being the mean of their values: floor a, and slope b·x. 1 for n = 1. */
double multiplex_part(int n, double floor, double slope);

/* The variance of each lamp's picture exposed for the part r; as above. */
double multiplex_part_variance(int n, double part, double floor, double slope);
