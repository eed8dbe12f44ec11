/*
 * MERL's .binary files (Matusik et al. 2003): an isotropic BRDF on a grid of half and difference
 * angles (Rusinkiewicz 1998). With h = (l + v) / |l + v|, θ_h and φ_h its angles, and
 * d = R_y(−θ_h) R_z(−φ_h) l with the angles θ_d and φ_d, the file has
 *   3 × i32                        numbers of θ_h, θ_d and φ_d: 90, 90 and 180 (or 360, if the BRDF
 *                                  is not reciprocal)
 *   3 × f64[n_θh · n_θd · n_φd]    red, green and blue; φ_d varies fastest, then θ_d
 * All numbers are little-endian. Bin i of θ_h extends from 90° (i/90)² to 90° ((i+1)/90)². The bins
 * of θ_d divide 90° equally. The bins of φ_d divide 180° equally, because f(φ_d + 180°) = f(φ_d) if
 * the BRDF is reciprocal. If it is not reciprocal, they divide 360°. f_r is the number times 1/1500
 * for red, 1.15/1500 for green and 1.66/1500 for blue. A negative number means that the bin was not
 * measured, or that one of its directions lies below the surface.
 */
#pragma once

#include "base/work.h"
#include "brdf_function.h"

struct merl;

struct merl *merl_read(const char *path, GError **error);
void merl_free(struct merl *merl); /* NULL is ignored */

/* Gives the three values of the bin that contains the directions, as MERL's own reader does. If one
 * of them is negative, all three are 0. */
void merl_evaluate(const struct merl *merl, const float light[3], const float view[3],
                   float ret[3]);

struct merl_result {
    /* RMS difference between f and the means that are written, relative to the RMS of these means.
     * It is 0 if neither a rotation about the normal nor an exchange of light and view changes
     * f. */
    double spread;
};

/* Writes a file. The value of each bin is the mean of f at its centre over n_turns equally spaced
 * rotations about the normal, and over both orders of light and view. The progress stage is
 * "export". */
gboolean merl_write(const char *path, BrdfBothFunction f, gpointer data, int n_turns,
                    const struct work *work, struct merl_result *ret, GError **error);
