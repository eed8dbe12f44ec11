#include "eigenmaps_product.h"

static void set_directions(const GPtrArray *directions, const int *which, gsize n,
                           float **ret_theta_deg, float **ret_phi_deg) {
    *ret_theta_deg = g_new(float, n);
    *ret_phi_deg = g_new(float, n);
    for (gsize i = 0; i < n; i++) {
        const struct session_direction *direction = directions->pdata[which ? (gsize)which[i] : i];
        (*ret_theta_deg)[i] = (float)direction->theta_deg;
        (*ret_phi_deg)[i] = (float)direction->phi_deg;
    }
}

struct eigenmaps *eigenmaps_product_new(const char *name, const struct catalogue *catalogue,
                                        const int *views, int n_views, int n_terms) {
    struct eigenmaps *maps = g_new0(struct eigenmaps, 1);
    maps->name = g_strdup(name);
    maps->n_terms = n_terms;
    maps->layout.width = catalogue->grid.width;
    maps->layout.height = catalogue->grid.height;
    maps->layout.texel_mm = catalogue->grid.width_mm / catalogue->grid.width;
    maps->layout.reference_mm = catalogue->grid.reference_mm;
    maps->layout.views.n = (gsize)n_views;
    maps->layout.lights.n = catalogue->lights->len;
    set_directions(catalogue->views, views, (gsize)n_views, &maps->layout.views.theta_deg,
                   &maps->layout.views.phi_deg);
    set_directions(catalogue->lights, NULL, catalogue->lights->len, &maps->layout.lights.theta_deg,
                   &maps->layout.lights.phi_deg);
    return maps;
}
