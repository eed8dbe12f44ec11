/* Pictures of hemispherical harmonics against hsh_formula(), pixel by pixel. */
#include "lib/lobes_scene.h"

#include "drawing/methods/hsh_view.h"
#include "lib/hsh_formula.h"
#include "lib/ok.h"

#include <glib/gstdio.h>
#include <string.h>

/* (1/π) ∫ f dω by the midpoint rule in cos θ and φ. */
static void sky_value(const struct hsh *hsh, int view, int texel, double ret[3]) {
    const int rows = 100, columns = 8;
    double sums[3] = {0};
    for (int k = 0; k < rows * columns; k++) {
        const int row = k / columns;
        const double z = (row + 0.5) / rows, r = sqrt(1 - z * z), phi = 2 * G_PI * k / columns;
        const float l[3] = {(float)(r * cos(phi)), (float)(r * sin(phi)), (float)z};
        float rgb[3];
        hsh_formula(hsh, view, texel, l, rgb);
        for (int c = 0; c < 3; c++)
            sums[c] += 2.0 * rgb[c] / (rows * columns);
    }
    for (int c = 0; c < 3; c++)
        ret[c] = fmax(sums[c], 0);
}

struct material {
    struct hsh *hsh;
    double *skies; /* sky_value() of each texel of each view; NULL without a sky */
};

static double *sky_values(const struct hsh *hsh) {
    const gsize texels = btf_layout_texels(&hsh->layout), n = texels * hsh->layout.views.n;
    double *ret = g_new(double, 3 * n);
    for (gsize k = 0; k < n; k++)
        sky_value(hsh, (int)(k / texels), (int)(k % texels), ret + 3 * k);
    return ret;
}

static void add_view(const struct scene *s, int view, int texel, const float *l, double share,
                     double ret[3]) {
    const struct material *m = s->model;
    const gsize at = (gsize)view * btf_layout_texels(&m->hsh->layout) + (gsize)texel;
    float rgb[3];
    hsh_formula(m->hsh, view, texel, l, rgb);
    for (int c = 0; c < 3; c++)
        ret[c] +=
            share * (fmax(rgb[c], 0) + (m->skies ? s->ambient * m->skies[3 * at + (gsize)c] : 0));
}

/* Coefficients fall with the degree, as those of a surface do; some values are negative. Views
 * differ at random by about as much as white from black. */
static struct hsh *make_hsh(int n_terms) {
    g_autoptr(GRand) random = g_rand_new_with_seed(11);
    struct hsh *hsh = g_new0(struct hsh, 1);
    *hsh = (struct hsh){.name = g_strdup("test"),
                        .layout.width = W,
                        .layout.height = H,
                        .layout.texel_mm = 1,
                        .layout.views.n = RINGS * A_RING,
                        .layout.lights.n = RINGS * A_RING,
                        .n_terms = n_terms};
    rings_fill(0, &hsh->layout.views.theta_deg, &hsh->layout.views.phi_deg);
    rings_fill(5, &hsh->layout.lights.theta_deg, &hsh->layout.lights.phi_deg);
    hsh->values = g_new0(float, hsh_bytes(hsh) / 2);
    for (int k = 0; k < hsh_bytes(hsh) / 2; k++) {
        const int term = k / 3 % n_terms, fall = 1 + term / 4;
        hsh->values[k] = (float)(term == 0 ? g_rand_double_range(random, 0.1, 0.5)
                                           : g_rand_double_range(random, -0.3, 0.3) / fall);
    }
    return hsh;
}

/* Through a file, as the viewer opens it. */
static void check_terms(int n_terms, gboolean nearest, double ambient) {
    g_autoptr(GError) error = NULL;
    g_autofree char *dir = g_dir_make_tmp("mesorig-XXXXXX", NULL);
    g_autofree char *path = g_build_filename(dir, "hsh.exr", NULL);
    struct hsh *made = make_hsh(n_terms);
    g_assert_true(hsh_write(path, made, &error));
    hsh_free(made);
    struct material material = {.hsh = ok(hsh_read(path, ERR))};
    if (ambient > 0)
        material.skies = sky_values(material.hsh);
    struct scene scene = {.ambient = ambient,
                          .nearest = nearest,
                          .layout = &material.hsh->layout,
                          .model = &material,
                          .add = add_view};
    g_test_message("%d terms", n_terms);
    lobes_scene_compare(&scene, &method_hsh, path, NULL, NULL);
    g_assert_true(g_unlink(path) == 0 && g_rmdir(dir) == 0);
    g_free(material.skies);
    hsh_free(material.hsh);
}

GPU_TEST(formula) {
    check_terms(4, FALSE, 0);
    check_terms(9, TRUE, 0);
    check_terms(9, FALSE, 0.3);
    check_terms(16, FALSE, 0);
    check_terms(16, TRUE, 0.2);
}

GPU_TEST(bad) {
    g_autoptr(GError) error = NULL;
    struct hsh *hsh = make_hsh(9);
    hsh->values[19] = NAN;
    g_assert_null(hsh_view_new(hsh, &error));
    g_assert_nonnull(
        strstr(error->message, "value number 19 (counted from 0) of the hemispherical harmonics"));
    g_clear_error(&error);
    hsh->values[19] = 0.5F;
    hsh->layout.views.theta_deg[1] = NAN;
    g_assert_null(hsh_view_new(hsh, &error));
    g_assert_true(g_str_has_prefix(error->message, "views: "));
    g_clear_error(&error);
    hsh->layout.views.theta_deg[1] = 20;
    hsh->layout.width = 1 << 20;
    hsh->layout.height = 0;
    g_assert_null(hsh_view_new(hsh, &error));
    g_assert_nonnull(strstr(error->message, "do not fit into textures"));
    hsh_free(hsh);
}
