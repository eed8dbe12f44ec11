/* Gives the values of a BTF at the points of the mean surface. The texels of a BTF lie on the
 * reference plane. If the surface lies at a depth d below it, the surface point below texel (x, y)
 * is seen from the direction v at
 *   x + d v_x / (v_z w),  y − d v_y / (v_z w)      (texels of the width w, y downwards).
 * A texel of the reference plane therefore shows different points in different views, and maps that
 * follow the texels of the plane would mix these points. Any thread after the object is made. */
#pragma once

#include "base/work.h"
#include "btf/btf_matrix.h"

struct maps_register {
    const struct btf_matrix *btf;
    double depth_mm; /* depth of the mean surface below the reference plane */
    float *shifts;   /* n_views × 2, in texels: x, y; all 0 if depth_mm is 0 */
};

/* Finds the depth at which the views agree best: the minimum of
 *   Σ_x mean_v (M_v(x) − M(x))² / Σ_x (M(x) − M̄)²
 * over the texels x of a window in the middle. M_v is the mean of view v over lights, scaled to a
 * mean of 1 in the window. M is the mean of M_v over the views that cover x. M̄ is the mean of M. If
 * the minimum is not more than a tenth below the value at depth 0, the depth is 0, because a
 * surface without a pattern does not show its depth. The progress stage is "depth". Returns NULL if
 * the scratch file of the BTF cannot be read, or if cancelled. */
struct maps_register *maps_register_new(const struct btf_matrix *btf, const struct work *work,
                                        GError **error);
void maps_register_free(struct maps_register *registered); /* NULL is ignored */

/* Gives the values of texels first … first + n − 1 in a view, interpolated bilinearly: n rows of
 * n_lights × 3 floats, *ret_stride floats apart. The rows are in buffer (n × n_lights × 3) or in
 * the memory of the BTF. Values outside of the BTF are NaN. Returns NULL if the scratch file of the
 * BTF cannot be read. */
const float *maps_register_rows(const struct maps_register *registered, int view, int first, int n,
                                float *buffer, gsize *ret_stride, GError **error);
