/* A model of neural planes for tests, with random numbers and a relief, and its evaluation by the
 * formulas of neural.h in double precision, which shares no code with neural_evaluate(). */
#pragma once

#include "codecs/neural/neural.h"

/* The model has six views and six lights (btf_fixture_two_rings()), no positions, and texels of 0.5
 * mm. depth_mm is the depth of its relief; 0 makes it flat. neural_free() */
struct neural *neural_fixture_new(int width, int height, int n_channels, double depth_mm,
                                  guint32 seed);

/* The colour of the texel at (x, y), in texels: from four rays, with places clamped to the edge. */
void neural_formula(const struct neural *neural, double x, double y, const double view[3],
                    const double light[3], double ret[3]);
/* The colour of the point (x, y): from one ray. The material repeats. */
void neural_formula_point(const struct neural *neural, double x, double y, const double view[3],
                          const double light[3], double ret[3]);
