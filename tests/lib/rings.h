/* Small materials: few texels, and directions on rings. */
#pragma once

#include "btf_fixture.h"

#define W      7 /* texels */
#define H      5
#define RINGS  3
#define A_RING 8

/* Makes a BTF whose views are on rings. Its lights are on the same rings, in other azimuths. All
 * values are 0. */
struct btf_matrix *rings_btf(const char *name);

void rings_fill(double offset_deg, float **ret_theta_deg, float **ret_phi_deg);
