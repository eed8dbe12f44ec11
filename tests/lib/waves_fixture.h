/* A BTF for tests: a wavy surface, glossy, in two colours, seen with noise: smooth in every way, as
 * materials are. */
#pragma once

#include "btf_fixture.h"

#include <math.h>

/* constant: all texels are alike, but for the noise. */
struct btf_matrix *waves_fixture_new(int width, int height, int n_views, int n_lights, double noise,
                                     gboolean constant);
