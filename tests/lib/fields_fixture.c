#include "fields_fixture.h"
#include "codecs/lobes/lobes_levels.h"
#include "lib/ok.h"

void fields_fixture_write(const char *path, int width, int height) {
    const float texel[7] = {0.4F, 0.3F, 0.2F, 0, 0, 1, 1};
    struct eigenmaps *like = view_fixture_material(LIGHT, 1, 3);
    const int n = like->layout.views.n;
    const gsize texels = (gsize)n * (gsize)width * (gsize)height;
    struct lobes fields = {.name = (char[]){"test"},
                           .model = LOBES_FIELDS,
                           .layout.width = width,
                           .layout.height = height,
                           .layout.texel_mm = 1,
                           .layout.views.n = n,
                           .layout.lights.n = n,
                           .n_lobes = 1,
                           .n_slices = n,
                           .n_values = G_N_ELEMENTS(texel),
                           .layout.views.theta_deg = like->layout.views.theta_deg,
                           .layout.views.phi_deg = like->layout.views.phi_deg,
                           .layout.lights.theta_deg = like->layout.lights.theta_deg,
                           .layout.lights.phi_deg = like->layout.lights.phi_deg};
    fields.values = g_new(float, texels *G_N_ELEMENTS(texel));
    for (gsize k = 0; k < texels; k++)
        memcpy(fields.values + G_N_ELEMENTS(texel) * k, texel, sizeof texel);
    struct lobes *const levels[] = {&fields};
    g_assert_true(ok(lobes_write_levels(path, levels, 1, ERR)));
    g_free(fields.values);
    eigenmaps_free(like);
}
