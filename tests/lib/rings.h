/* Small materials: few texels, and directions on rings. */
#pragma once

#include <glib.h>

#define W      7 /* texels */
#define H      5
#define RINGS  3
#define A_RING 8

void rings_fill(double offset_deg, float **ret_theta_deg, float **ret_phi_deg);
