#include "btf_fixture.h"

struct btf_matrix *btf_fixture_new(const char *name, int width, int height, int n_views,
                                   int n_lights) {
    struct btf_matrix *btf = g_new0(struct btf_matrix, 1);
    *btf = (struct btf_matrix){.name = g_strdup(name),
                               .layout.width = width,
                               .layout.height = height,
                               .layout.texel_mm = 0.5,
                               .layout.reference_mm = 5,
                               .layout.views.n = n_views,
                               .layout.lights.n = n_lights,
                               .layout.views.theta_deg = g_new(float, n_views),
                               .layout.views.phi_deg = g_new(float, n_views),
                               .layout.lights.theta_deg = g_new(float, n_lights),
                               .layout.lights.phi_deg = g_new(float, n_lights),
                               .values = g_new0(float, width *height *n_views *n_lights * 3)};
    for (int i = 0; i < n_views; i++)
        btf->layout.views.theta_deg[i] = (float)i, btf->layout.views.phi_deg[i] = 2 * (float)i;
    for (int i = 0; i < n_lights; i++)
        btf->layout.lights.theta_deg[i] = 3 * (float)i,
        btf->layout.lights.phi_deg[i] = 4 * (float)i;
    return btf;
}
