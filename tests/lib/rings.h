/* Small materials: few texels, and directions on rings. */
#pragma once

#include <glib.h>

#define W      7 /* texels */
#define H      5
#define RINGS  3
#define A_RING 8

static void fill_directions(double offset_deg, float **ret_theta_deg, float **ret_phi_deg) {
    *ret_theta_deg = g_new(float, RINGS *A_RING);
    *ret_phi_deg = g_new(float, RINGS *A_RING);
    for (int k = 0; k < RINGS * A_RING; k++) {
        (*ret_theta_deg)[k] = (float)(85.0 / RINGS * (1 + k / A_RING));
        (*ret_phi_deg)[k] = (float)(offset_deg + 360.0 / A_RING * (k % A_RING));
    }
}
