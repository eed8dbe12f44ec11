/* Pictures of local PCAs against a plain evaluation of the formula, pixel by pixel. */
#include "codecs/lpca/lpca_resample.h"
#include "drawing/methods/lpca_grid.h"
#include "drawing/methods/lpca_revised.h"
#include "drawing/methods/lpca_view.h"
#include "lib/lpca_scene.h"
#include "lib/ok.h"

static void check_case(int n_clusters, int n_components, gboolean nearest, double ambient,
                       int n_grid) {
    struct lpca *lpca = lpca_scene_lpca(n_clusters, n_components);
    lpca_scene_check(lpca, nearest, ambient, n_grid);
    lpca_free(lpca);
}

GPU_TEST(formula) {
    check_case(5, 6, TRUE, 0, 0);
    check_case(5, 6, FALSE, 0, 0);
    check_case(5, 3, FALSE, 0.5, 0);
    check_case(1, 1, FALSE, 0, 0);
}

/* Of an even sky by the trapezoidal rule; the square's area is the hemisphere's 2π. */
static float *sky_of_grid(int n) {
    float *sky = g_new(float, n *n);
    for (int k = 0; k < n * n; k++) {
        const gboolean edge[2] = {k % n == 0 || k % n == n - 1, k / n == 0 || k / n == n - 1};
        sky[k] =
            2.0f / ((float)(n - 1) * (float)(n - 1)) * (edge[0] ? 0.5f : 1) * (edge[1] ? 0.5f : 1);
    }
    return sky;
}

static void check_revised(int n_clusters, int n_components, gboolean nearest, double ambient, int n,
                          gboolean from_grid) {
    struct lpca *lpca = lpca_scene_lpca(n_clusters, n_components);
    struct lpca *grid = ok(lpca_resample(lpca, n, ERR));
    lpca_quantise(grid, LPCA_8BIT);
    g_autofree float *sky = sky_of_grid(n);
    const struct scene scene = {
        .lpca = grid, .sky = sky, .ambient = ambient, .nearest = nearest, .revised = TRUE};
    lpca_scene_compare(&scene, &method_lpca_revised,
                       ok(lpca_revised_new(from_grid ? &grid : &lpca, 1, n, ERR)));
    lpca_free(lpca);
    lpca_free(grid);
}

GPU_TEST(revised) {
    check_revised(5, 6, TRUE, 0, 8, FALSE);
    check_revised(5, 6, FALSE, 0, 6, TRUE);
    check_revised(260, 2, FALSE, 0.5, 8, FALSE); /* more than fit side by side */
}

GPU_TEST(levels) {
    g_autoptr(GError) error = NULL;
    struct lpca *levels[3];
    g_autoptr(Viewer) view = viewer_new(NULL, &error);
    for (int k = 0; k < 3; k++)
        levels[k] = lpca_scene_level(k, 4 - k, k == 1 ? 2 : 3);
    viewer_set_method(view, &method_lpca, lpca_view_new(levels, 3, &error), &error);
    g_assert_no_error(error);
    lpca_scene_check_levels(view, levels, 6);
    lpca_scene_check_levels(view, levels, 18);
    lpca_scene_check_levels(view, levels, 33);
    lpca_scene_check_levels(view, levels, 90);
    levels[1]->layout.views.phi_deg[3] += 1;
    g_assert_null(lpca_view_new(levels, 3, &error));
    g_assert_nonnull(strstr(error->message, "mip level 1"));
    for (int k = 0; k < 3; k++)
        lpca_free(levels[k]);
}

GPU_TEST(grid) {
    check_case(5, 2, TRUE, 0, 5);
    check_case(3, 5, TRUE, 0.5, 4);
    check_case(2, 1, FALSE, 0, 3);
    check_case(7, 9, FALSE, 0.2, 6);
}

/* Lambertian bumps with a soft gloss, a normal a texel. */
static struct btf_matrix *make_btf(void) {
    struct btf_matrix *btf = rings_btf("bumps");
    const int n = RINGS * A_RING;
    for (int k = 0; k < W * H * n * n; k++) {
        const struct vec3 v = btf_fixture_direction(&btf->layout.views, k / n % n);
        const struct vec3 l = btf_fixture_direction(&btf->layout.lights, k % n);
        const int texel = k / n / n;
        const struct vec3 normal = vec3_unit(vec3(0.4 * sin(texel), 0.4 * cos(2.0 * texel), 1));
        const double gloss = pow(fmax(vec3_dot(vec3_unit(vec3_add(v, l)), normal), 0), 8);
        for (int c = 0; c < 3; c++)
            btf->values[3 * k + c] =
                (float)(fmax(vec3_dot(normal, l), 0) * (0.6 - 0.1 * c) + 0.3 * gloss * l.z);
    }
    return btf;
}

/* How far two methods' pictures are apart, relative to those of the first, over all measured pairs
 * of directions and all texels. */
static double apart(Viewer *a, Viewer *b, const struct btf_matrix *btf) {
    struct viewer_settings s = viewer_settings_default;
    g_autoptr(GError) error = NULL;
    double off = 0, all = 0;
    for (gsize k = 0; k < btf->layout.views.n * btf->layout.lights.n; k++) {
        const struct vec3 v = btf_fixture_direction(&btf->layout.views, k / btf->layout.lights.n);
        const struct vec3 l = btf_fixture_direction(&btf->layout.lights, k % btf->layout.lights.n);
        const float to_view[3] = {(float)v.x, (float)v.y, (float)v.z};
        const float to_light[3] = {(float)l.x, (float)l.y, (float)l.z};
        g_autofree float *one = viewer_render_flat(a, &s, to_view, to_light, W, H, &error);
        g_autofree float *other = ok(viewer_render_flat(b, &s, to_view, to_light, W, H, ERR));
        for (int i = 0; i < 4 * W * H; i++) {
            off += i % 4 < 3 ? pow((double)other[i] - one[i], 2) : 0;
            all += i % 4 < 3 ? pow(one[i], 2) : 0;
        }
    }
    return sqrt(off / all);
}

/* At measured directions lpca shows what was compressed: revised is as far from it as resampling
 * said, and a finer grid is nearer. What remains is that cube maps tell directions a third of a
 * degree apart. */
GPU_TEST(agree) {
    static const int grids[] = {5, 8, 12};
    g_autoptr(GError) error = NULL;
    struct btf_matrix *btf = make_btf();
    const struct lpca_options options = {.n_clusters = 2, .n_components = 3};
    struct lpca *lpca = ok(lpca_compute(btf, &options, ERR));
    g_autoptr(Viewer) original = viewer_new(NULL, &error), revised = viewer_new(NULL, &error);
    double before = 1;
    viewer_set_method(original, &method_lpca, lpca_view_new(&lpca, 1, &error), &error);
    g_assert_no_error(error);
    for (gsize k = 0; k < G_N_ELEMENTS(grids); k++) {
        struct lpca *grid = lpca_resample(lpca, grids[k], &error);
        lpca_quantise(grid, LPCA_8BIT);
        const double reported = lpca_resample_error(grid, btf, 0);
        viewer_set_method(revised, &method_lpca_revised, lpca_revised_new(&grid, 1, 0, &error),
                          &error);
        g_assert_no_error(error);
        const double found = apart(original, revised, btf);
        g_test_message("grid of %d: compression %.4f, with resampling %.4f; pictures %.4f apart",
                       grids[k], lpca->error, reported, found);
        g_assert_cmpfloat(found, <, sqrt(reported * reported - lpca->error * lpca->error) + 0.01);
        g_assert_cmpfloat(found, <, before);
        before = found;
        lpca_free(grid);
    }
    lpca_free(lpca);
    btf_matrix_free(btf);
}

/* Cube maps: six faces of 256² of 8 bytes; texels: clusters 8 bytes, weights 16 a page. */
GPU_TEST(bytes) {
    g_autoptr(GError) error = NULL;
    struct lpca *levels[2] = {lpca_scene_level(0, 3, 5), lpca_scene_level(1, 2, 5)};
    g_autoptr(Viewer) view = viewer_new(NULL, &error);
    g_assert_no_error(error);
    const gint64 texels = (gint64)(W * H + W / 2 * (H / 2)) * (8 + 2 * 16),
                 cubes = 4 * 6 * 65536 * 8;
    const gint64 n = RINGS * A_RING;
    viewer_set_method(view, &method_lpca, lpca_view_new(levels, 2, &error), &error);
    g_assert_no_error(error);
    g_assert_cmpint(viewer_memory(view).material, ==, texels + cubes + 5 * n * (n + 1) * 6 * 8);
    viewer_set_method(view, &method_lpca_grid, lpca_grid_new(levels, 2, 6, &error), &error);
    g_assert_no_error(error);
    g_assert_cmpint(viewer_memory(view).material, ==, texels + 5 * 36 * 37 * 2 * 16);
    g_assert_cmpint(viewer_memory(view).mdf, ==, 0);
    lpca_free(levels[0]);
    lpca_free(levels[1]);
}

static void refuse_lpca(struct lpca *lpca, const char *said) {
    g_autoptr(GError) error = NULL;
    g_autoptr(GError) of_grid = NULL;
    g_assert_null(lpca_view_new(&lpca, 1, &error));
    g_assert_nonnull(error);
    g_assert_nonnull(strstr(error->message, said));
    g_assert_null(lpca_grid_new(&lpca, 1, 4, &of_grid));
    g_assert_cmpstr(of_grid->message, ==, error->message);
    lpca_free(lpca);
}

GPU_TEST(bad) {
    struct lpca *lpca = lpca_scene_lpca(3, 2);
    lpca->weights[11] = NAN;
    refuse_lpca(lpca, "weight number 11");
    lpca = lpca_scene_lpca(3, 2);
    lpca->brdfs[77] = INFINITY;
    refuse_lpca(lpca, "eigen-BRDF value number 77");
    lpca = lpca_scene_lpca(3, 2);
    lpca->clusters[4] = 3;
    refuse_lpca(lpca, "is in cluster 3, but");
    lpca = lpca_scene_lpca(3, 2);
    lpca->clusters[0] = -1;
    refuse_lpca(lpca, "cluster -1");
    lpca = lpca_scene_lpca(3, 2);
    lpca->layout.views.theta_deg[1] = NAN;
    refuse_lpca(lpca, "views: ");
    lpca = lpca_scene_lpca(3, 2);
    lpca->layout.lights.n = 0;
    refuse_lpca(lpca, "the local PCA has no directions");
}
