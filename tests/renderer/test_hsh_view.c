/* Pictures of hemispherical harmonics against hsh_evaluate(), pixel by pixel. */
#include "lib/formula_fixture.h"
#include "lib/gpu_fixture.h"
#include "lib/rings.h"

#include "gl/directions.h"
#include "methods/hsh_view.h"

#include <glib/gstdio.h>
#include <string.h>

struct scene {
    const struct hsh *hsh;
    Directions *views;
    double ambient;
    gboolean nearest;
};

/* (1/π) ∫ f dω by the midpoint rule in cos θ and φ. */
static void sky_value(const struct hsh *hsh, int view, int texel, double ret[3]) {
    const int rows = 100, columns = 8;
    double sums[3] = {0};
    for (int k = 0; k < rows * columns; k++) {
        const int row = k / columns;
        const double z = (row + 0.5) / rows, r = sqrt(1 - z * z), phi = 2 * G_PI * k / columns;
        const float l[3] = {(float)(r * cos(phi)), (float)(r * sin(phi)), (float)z};
        float rgb[3];
        hsh_evaluate(hsh, view, texel, l, rgb);
        for (int c = 0; c < 3; c++)
            sums[c] += 2.0 * rgb[c] / (rows * columns);
    }
    for (int c = 0; c < 3; c++)
        ret[c] = fmax(sums[c], 0);
}

/* A texel of a view, or of the pole of the views, under the light and the sky. */
static void add_view(const struct scene *s, int view, int texel, const float *l, double share,
                     double ret[3]) {
    int n = 1;
    const int *members = &view;
    if (view == (int)s->hsh->layout.views.n)
        members = directions_pole(s->views, &n);
    for (int k = 0; k < n; k++) {
        float rgb[3];
        double sky[3] = {0};
        hsh_evaluate(s->hsh, members[k], texel, l, rgb);
        if (s->ambient > 0)
            sky_value(s->hsh, members[k], texel, sky);
        for (int c = 0; c < 3; c++)
            ret[c] += share / n * (fmax(rgb[c], 0) + s->ambient * sky[c]);
    }
}

static gboolean expected(gconstpointer data, const float *at, const float *v, const float *l,
                         double ret[3]) {
    const struct scene *s = data;
    struct direction_weights g;
    const double x = at[0] * (double)W - 0.5, y = at[1] * (double)H - 0.5;
    const double part[2] = {x - floor(x), y - floor(y)};
    if (v[2] < 0.1 || l[2] < 0.1 ||
        (s->nearest && (fabs(part[0] - 0.5) < 0.03 || fabs(part[1] - 0.5) < 0.03)))
        return FALSE;
    directions_weights(s->views, (struct vec3){v[0], v[1], v[2]}, &g);
    ret[0] = ret[1] = ret[2] = 0;
    for (int k = 0; k < 4; k++) {
        const int i = (int)floor(x) + k % 2, j = (int)floor(y) + k / 2;
        const int texel = (i % W + W) % W + W * ((j % H + H) % H);
        const double near_x = s->nearest ? part[0] > 0.5 : part[0];
        const double near_y = s->nearest ? part[1] > 0.5 : part[1];
        const double share = (k % 2 ? near_x : 1 - near_x) * (k / 2 ? near_y : 1 - near_y);
        for (int a = 0; share > 0 && a < 4; a++)
            if (g.weight[a] > 0)
                add_view(s, g.index[a], texel, l, share * g.weight[a], ret);
    }
    return TRUE;
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

/* Through a file, as the viewer opens it; returns what the file gives back. */
static struct hsh *show(Viewer *view, int n_terms) {
    g_autoptr(GError) error = NULL;
    g_autofree char *dir = g_dir_make_tmp("mesorig-XXXXXX", NULL);
    g_autofree char *path = g_build_filename(dir, "hsh.exr", NULL);
    struct hsh *made = make_hsh(n_terms);
    g_assert_true(hsh_write(path, made, &error));
    hsh_free(made);
    struct hsh *hsh = hsh_read(path, &error);
    g_assert_no_error(error);
    g_assert_true(viewer_open(view, &method_hsh, path, &error));
    g_assert_no_error(error);
    g_assert_true(g_unlink(path) == 0 && g_rmdir(dir) == 0);
    return hsh;
}

static void check_terms(int n_terms, gboolean nearest, double ambient) {
    g_autoptr(GError) error = NULL;
    struct mesh *mesh = scene_torus(1, 0.4, 128, 64);
    struct viewer_settings settings;
    g_autoptr(Viewer) view = viewer_new(NULL, &error);
    g_assert_no_error(error);
    formula_start_view(view, &settings, mesh);
    settings.style.nearest = nearest;
    settings.ambient = ambient;
    struct hsh *hsh = show(view, n_terms);
    g_autoptr(Directions) views = directions_new(
        hsh->layout.views.theta_deg, hsh->layout.views.phi_deg, hsh->layout.views.n, &error);
    const struct scene scene = {hsh, views, ambient, nearest};
    g_test_message("%d terms", n_terms);
    formula_compare(expected, &scene, view, &settings);
    hsh_free(hsh);
    mesh_free(mesh);
}

static void test_formula(struct fixture *f, gconstpointer data) {
    if (f->gpu == NULL)
        return;
    check_terms(4, FALSE, 0);
    check_terms(9, TRUE, 0);
    check_terms(9, FALSE, 0.3);
    check_terms(16, FALSE, 0);
    check_terms(16, TRUE, 0.2);
}

static void test_bad(struct fixture *f, gconstpointer data) {
    if (f->gpu == NULL)
        return;
    g_autoptr(GError) error = NULL;
    struct hsh *hsh = make_hsh(9);
    hsh->values[19] = NAN;
    g_assert_null(hsh_view_new(hsh, &error));
    g_assert_nonnull(strstr(error->message, "value number 19 of the hemispherical harmonics"));
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
    g_assert_nonnull(strstr(error->message, "more than"));
    hsh_free(hsh);
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    g_test_add("/hsh-view/formula", struct fixture, NULL, gpu_fixture_set_up, test_formula,
               gpu_fixture_tear_down);
    g_test_add("/hsh-view/bad", struct fixture, NULL, gpu_fixture_set_up, test_bad,
               gpu_fixture_tear_down);
    return g_test_run();
}
