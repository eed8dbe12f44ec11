/* Heights from normals. Any thread. */
#pragma once

#include <glib.h>

/* Heights z of a grid of texels whose slopes p = ∂z/∂x and q = ∂z/∂y are known (dimensionless; x to
 * the right, y up, row 0 at the top), NaN where they are not. ret_z (height × width) is in units of
 * step, the width of a texel, with mean 0, and NaN where a slope is. */
void integrate_normals(const float *p, const float *q, int width, int height, double step,
                       float *ret_z);

/* Heights from unit normals (height × width × 3; all 0: none). Normals steeper than 84° count as
 * that steep. ret_z: in units of step; ret_known: 1, or 0 for a hole, where ret_z is 0. */
void integrate_normals_of(const float *normals, int width, int height, double step, float *ret_z,
                          float *ret_known);
