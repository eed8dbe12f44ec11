#include "rings.h"

void rings_fill(double offset_deg, float **ret_theta_deg, float **ret_phi_deg) {
    *ret_theta_deg = g_new(float, RINGS *A_RING);
    *ret_phi_deg = g_new(float, RINGS *A_RING);
    for (int k = 0; k < RINGS * A_RING; k++) {
        (*ret_theta_deg)[k] = (float)(85.0 / RINGS * (1 + k / A_RING));
        (*ret_phi_deg)[k] = (float)(offset_deg + 360.0 / A_RING * (k % A_RING));
    }
}

struct btf_matrix *rings_btf(const char *name) {
    struct direction_list views = {.n = RINGS * A_RING}, lights = {.n = RINGS * A_RING};
    rings_fill(0, &views.theta_deg, &views.phi_deg);
    rings_fill(5, &lights.theta_deg, &lights.phi_deg);
    struct btf_matrix *btf = btf_fixture_of(name, W, H, views, lights);
    btf->layout.texel_mm = 1;
    btf->layout.reference_mm = 0;
    return btf;
}
