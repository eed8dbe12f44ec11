#include "rings.h"

void rings_fill(double offset_deg, float **ret_theta_deg, float **ret_phi_deg) {
    *ret_theta_deg = g_new(float, RINGS *A_RING);
    *ret_phi_deg = g_new(float, RINGS *A_RING);
    for (int k = 0; k < RINGS * A_RING; k++) {
        (*ret_theta_deg)[k] = (float)(85.0 / RINGS * (1 + k / A_RING));
        (*ret_phi_deg)[k] = (float)(offset_deg + 360.0 / A_RING * (k % A_RING));
    }
}
