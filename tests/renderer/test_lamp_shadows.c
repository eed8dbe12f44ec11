/* Shadows of several lamps: each against displaced geometry that is ray traced, and against the
 * first lamp's in its place. */
#include "lib/ok.h"
#include "lib/silhouettes_fixture.h"

#include <string.h>

#define W                 320
#define H                 240
#define N                 3    /* lamps */
#define BRIGHT            0.5F /* grey() under a lamp of 1 */
#define N_DIFFERENT(a, b) silhouettes_differ(a, b, 4 * W * H, 1.0F / 255)

/* The first lamp gives red, green and blue alike, further ones one of them: so a picture tells
 * what arrives of each. */
static const struct viewer_lamp lamps[N - 1] = {{55, 320, {0, 0, 1}}, {35, 80, {0, 1, 0}}};

static float *draw(Viewer *view, const struct viewer_settings *s) {
    float *linear = ok(viewer_render_linear(view, s, W, H, ERR));
    return linear;
}

static struct viewer_settings settings(void) {
    struct viewer_settings s = viewer_settings_default;
    s.shadows = TRUE;
    s.ambient = 0.0;
    s.shadow_size = 512;
    return s;
}

static gboolean arrives(const float *p, int lamp) {
    return (lamp == 0 ? p[0] : lamp == 1 ? p[2] - p[0] : p[1] - p[0]) > 0.5F * BRIGHT;
}

/* Of one lamp's shadow on the floor, of which the traced picture knows only. */
static double share(const struct viewer_settings *s, int lamp, const float *drawn,
                    const float *seen, Displaced *displaced) {
    struct viewer_settings alone = *s;
    if (lamp > 0) {
        alone.light_theta_deg = lamps[lamp - 1].theta_deg;
        alone.light_phi_deg = lamps[lamp - 1].phi_deg;
    }
    const struct displaced_camera camera = silhouettes_camera(&silhouettes_torus, s, W, H);
    g_autofree struct displaced_pixel *truth =
        silhouettes_trace(&silhouettes_torus, displaced, &alone, W, H);
    struct overlap shadow = {0};
    for (int k = 0; k < W * H; k++) {
        const double distance = silhouettes_floor_distance(&camera, k % W, k / W);
        if (seen[4 * k + 3] > 0.5F && fabs((double)seen[4 * k + 2] - distance) < 2e-3 * distance &&
            truth[k].part == DISPLACED_FLOOR)
            overlap_add(&shadow, !arrives(drawn + 4 * (gsize)k, lamp), truth[k].shadowed);
    }
    g_assert_cmpint(shadow.either, >, W * H / 100);
    return overlap_share(&shadow);
}

static Viewer *set_scene(int u, int v) {
    g_autoptr(GError) error = NULL;
    struct scene_options scene = {u, v, SCENE_Z_UP, TRUE};
    g_autoptr(Mesh) mesh = scene_make("torus", &scene, &error);
    g_assert_no_error(error);
    Viewer *view = silhouettes_view(mesh, NULL);
    return view;
}

GPU_TEST(truth) {
    const int u = 3, v = 1;
    const double reference_mm = 1.75;
    g_autoptr(GError) error = NULL;
    g_autoptr(World) world = silhouettes_world("weave", 1.2);
    const struct truth_grid grid = {TEXELS, TEXELS, 25.0, 25.0, reference_mm};
    g_autofree char *mdf = silhouettes_write_truth(world, &grid);
    g_autoptr(Viewer) view = set_scene(u, v);
    g_assert_true(viewer_open_mdf(view, mdf, &error));
    struct truth_surface surface;
    truth_surface(world, &surface);
    const struct displaced_shape shape =
        silhouettes_displaced(&silhouettes_torus, u, v, TRUE, 25.0, reference_mm);
    g_autoptr(Displaced) displaced = displaced_new(&surface, &shape);
    struct viewer_settings s = settings();
    s.n_lamps = N - 1;
    memcpy(s.lamps, lamps, sizeof lamps);
    viewer_fit(view, &s, (double)W / H);
    double shares[2][N];
    for (int way = 0; way < 2; way++) {
        s.silhouettes = way;
        g_autofree float *drawn = draw(view, &s);
        g_autofree float *seen =
            ok(viewer_render_geometry(view, &s, VIEWER_GEOMETRY_LIT, W, H, ERR));
        for (int k = 0; k < N; k++)
            shares[way][k] = share(&s, k, drawn, seen, displaced);
    }
    for (int k = 0; k < N; k++) {
        g_test_message("lamp %d: shadow %.4f, BTF alone %.4f", k, shares[1][k], shares[0][k]);
        g_assert_cmpfloat(shares[1][k], >=, 0.97);
        g_assert_cmpfloat(1.0 - shares[0][k], >, 1.3 * (1.0 - shares[1][k]));
    }
}

/* A further lamp in the place of the first lights and shadows the same, to the step of a byte. */
GPU_TEST(in_place) {
    g_autoptr(Viewer) view = set_scene(6, 2);
    struct viewer_settings s = settings();
    for (int k = 0; k < 3; k++) {
        s.lamp = 1.0;
        s.n_lamps = 0;
        s.light_theta_deg = 20.0 * k + 3.0; /* the map turns beyond 26° */
        s.light_phi_deg = 70.0 + 100.0 * k;
        g_autofree float *first = draw(view, &s);
        s.lamp = 0.0;
        s.n_lamps = 1;
        s.lamps[0] = (struct viewer_lamp){s.light_theta_deg, s.light_phi_deg, {1, 1, 1}};
        g_autofree float *further = draw(view, &s);
        g_assert_cmpint(N_DIFFERENT(first, further), ==, 0);
        s.shadows = FALSE;
        g_autofree float *without = draw(view, &s);
        g_assert_cmpint(N_DIFFERENT(further, without), >, W * H / 100);
        s.shadows = TRUE;
    }
}

/* As many as there can be, from one place, give what one gives; but for the size of their maps. */
GPU_TEST(most) {
    g_autoptr(Viewer) view = set_scene(6, 2);
    struct viewer_settings s = settings();
    s.lamp = 0.0;
    s.shadow_size = 64;
    s.n_lamps = 1;
    s.lamps[0] = (struct viewer_lamp){40, 120, {1, 1, 1}};
    g_autofree float *one = draw(view, &s);
    s.shadow_size = 256;
    s.n_lamps = VIEWER_MAX_LAMPS;
    for (int k = 0; k < VIEWER_MAX_LAMPS; k++)
        s.lamps[k] = (struct viewer_lamp){40, 120, {1.0F / 64.0F, 1.0F / 64.0F, 1.0F / 64.0F}};
    g_autofree float *most = draw(view, &s);
    g_assert_cmpint(N_DIFFERENT(one, most), ==, 0);
}

/* Maps are kept only as long as nothing changes that they depend on. */
GPU_TEST(kept) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Viewer) view = set_scene(6, 2);
    struct viewer_settings s = settings();
    s.n_lamps = N - 1;
    memcpy(s.lamps, lamps, sizeof lamps);
    g_autofree float *first = draw(view, &s);
    s.lamps[1].phi_deg += 40.0;
    g_autofree float *turned = draw(view, &s);
    g_assert_cmpint(N_DIFFERENT(first, turned), >, W * H / 100);
    s.lamps[1].phi_deg -= 40.0;
    g_autofree float *again = draw(view, &s);
    g_assert_cmpint(N_DIFFERENT(first, again), ==, 0);
    struct scene_options scene = {6, 2, SCENE_Z_UP, TRUE};
    struct mesh *mesh = scene_make("cylinder", &scene, &error);
    g_assert_true(viewer_set_mesh(view, mesh, &error));
    mesh_free(mesh);
    g_autofree float *other = draw(view, &s);
    g_autoptr(Viewer) fresh_view = set_scene(6, 2);
    mesh = scene_make("cylinder", &scene, &error);
    g_assert_true(viewer_set_mesh(fresh_view, mesh, &error));
    mesh_free(mesh);
    g_autofree float *fresh = draw(fresh_view, &s);
    g_assert_cmpint(N_DIFFERENT(other, fresh), ==, 0);
}

AFTER_TESTS {
    world_fixture_clean();
}
