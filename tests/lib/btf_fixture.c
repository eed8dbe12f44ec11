#include "btf_fixture.h"

struct btf_matrix *btf_fixture_new(const char *name, int width, int height, int n_views,
                                   int n_lights) {
    struct btf_matrix *btf = g_new0(struct btf_matrix, 1);
    *btf = (struct btf_matrix){.name = g_strdup(name),
                               .width = width,
                               .height = height,
                               .texel_mm = 0.5,
                               .reference_mm = 5,
                               .n_views = n_views,
                               .n_lights = n_lights,
                               .view_theta_deg = g_new(float, n_views),
                               .view_phi_deg = g_new(float, n_views),
                               .light_theta_deg = g_new(float, n_lights),
                               .light_phi_deg = g_new(float, n_lights),
                               .values = g_new0(float, width *height *n_views *n_lights * 3)};
    for (int i = 0; i < n_views; i++)
        btf->view_theta_deg[i] = (float)i, btf->view_phi_deg[i] = 2 * (float)i;
    for (int i = 0; i < n_lights; i++)
        btf->light_theta_deg[i] = 3 * (float)i, btf->light_phi_deg[i] = 4 * (float)i;
    return btf;
}
