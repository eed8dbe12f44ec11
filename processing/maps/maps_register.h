/*
 * The values of a BTF as points of the mean surface have them. A BTF's texels lie on the reference
 * plane; where the surface lies a depth d below it, the point below texel (x, y) is seen from the
 * direction v at
 *   x + d v_x / (v_z w),  y − d v_y / (v_z w)      (texels of the width w, y downwards),
 * so that a texel of the reference plane shows other points in each view. Maps that follow the
 * plane's texels would mix them. Any thread, once it is made.
 */
#pragma once

#include "base/work.h"
#include "btf/btf_matrix.h"

struct maps_register {
    const struct btf_matrix *btf;
    double depth_mm; /* of the mean surface below the reference plane */
    float *shifts;   /* n_views × 2, in texels: x, y; all 0: depth_mm is 0 */
};

/*
 * Finds the depth at which views agree best: the least of
 *   Σ_v (M_v(x) − M(x))² / Σ (M(x) − M)²,
 * M_v being the pictures' mean over lights, relative to the whole picture's, M their mean over
 * views. 0 where that is not better by a tenth than the reference plane: a surface without a
 * pattern tells nothing of its depth. Stage "depth".
 */
struct maps_register *maps_register_new(const struct btf_matrix *btf, const struct work *work,
                                        GError **error);
void maps_register_free(struct maps_register *registered); /* NULL is ignored */

/* The values of texels first … first + n − 1 in a view, bilinear: n rows of n_lights × 3 floats,
 * *ret_stride floats apart, in buffer (n × n_lights × 3) or in memory. NaN outside of the BTF. NULL
 * if a file cannot be read. */
const float *maps_register_rows(const struct maps_register *registered, int view, int first, int n,
                                float *buffer, gsize *ret_stride, GError **error);
