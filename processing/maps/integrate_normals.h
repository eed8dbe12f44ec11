/* Computes heights from slopes or normals. Any thread. */
#pragma once

#include <glib.h>

/* Computes heights z of a grid of texels from the slopes p = ∂z/∂x and q = ∂z/∂y (dimensionless; x
 * to the right, y up, row 0 at the top). Unknown slopes are NaN. step is the width of a texel.
 * ret_z (height × width) has the unit of step and the mean 0. Where a slope is NaN, ret_z is
 * NaN. */
void integrate_normals(const float *p, const float *q, int width, int height, double step,
                       float *ret_z);

/* Computes heights from unit normals (height × width × 3; all 0 if a texel has none). Normals
 * steeper than 84° count as 84°. ret_z has the unit of step. ret_known is 1, or 0 for a hole, where
 * ret_z is 0. */
void integrate_normals_of(const float *normals, int width, int height, double step, float *ret_z,
                          float *ret_known);
