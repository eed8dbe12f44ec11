/* A BTF for tests: a wavy glossy surface in two colours, with noise. Without the noise it is smooth
 * in all variables, like real materials. */
#pragma once

#include "btf_fixture.h"

#include <math.h>

/* With constant, all texels are equal except for the noise. */
struct btf_matrix *waves_fixture_new(int width, int height, int n_views, int n_lights, double noise,
                                     gboolean constant);
