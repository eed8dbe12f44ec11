/* Lamps near the object: light, cones and shadows against formulas, and the reference's pictures.
 */
#include "lib/ok.h"
#include "lib/view_fixture.h"
#include "scene/reference.h"

#define WIDTH  160
#define HEIGHT 120
#define TUBE   0.4

static struct vec3 ray_of(const struct viewer_settings *s, double radius, int k,
                          struct vec3 *ret_eye) {
    return view_fixture_ray(s, radius, WIDTH, HEIGHT, k % WIDTH, k / WIDTH, ret_eye);
}

/* Where the ray of a pixel meets a horizontal plane at height z. */
static struct vec3 on_plane(const struct viewer_settings *s, double radius, int k, double z) {
    struct vec3 eye, d = ray_of(s, radius, k, &eye);
    return vec3_add(eye, vec3_scale(d, (z - eye.z) / d.z));
}

static struct vec3 lamp_place(const struct viewer_lamp *l, double radius) {
    return vec3_scale(direction_of_deg(l->theta_deg, l->phi_deg), l->distance * radius);
}

/* Irradiance at p on what faces the lamp, relative to that at the origin. */
static double shines(const struct viewer_lamp *l, double radius, struct vec3 p) {
    const struct vec3 place = lamp_place(l, radius), way = vec3_sub(place, p);
    const struct vec3 aim = vec3(l->aim[0] * radius, l->aim[1] * radius, l->aim[2] * radius);
    const struct vec3 axis = vec3_unit(vec3_sub(aim, place));
    const double fall = vec3_dot(place, place) / vec3_dot(way, way);
    if (l->cone_deg == 0.0)
        return fall;
    const double off = -vec3_dot(axis, vec3_unit(way)), outer = cos(l->cone_deg * DEG);
    const double inside = CLAMP((off - outer) / (cos(l->inner_deg * DEG) - outer), 0.0, 1.0);
    return fall * inside * inside;
}

/* Direction and irradiance of the one lamp at each pixel of the plane, before any material. */
static void check_geometry(Viewer *view, const struct viewer_settings *s,
                           const struct viewer_lamp *lamp, double radius) {
    g_autoptr(GError) error = NULL;
    g_autofree float *lit =
        viewer_render_geometry(view, s, VIEWER_GEOMETRY_LIT, WIDTH, HEIGHT, &error);
    g_autofree float *light =
        ok(viewer_render_geometry(view, s, VIEWER_GEOMETRY_LIGHT, WIDTH, HEIGHT, ERR));
    double worst = 0.0, worst_light = 0.0;
    for (int k = 0; k < WIDTH * HEIGHT; k++) {
        const struct vec3 p = on_plane(s, radius, k, 0.0);
        if (fabs(p.x) > 0.97 || fabs(p.y) > 0.97)
            continue;
        const struct vec3 l = vec3_unit(vec3_sub(lamp_place(lamp, radius), p));
        const struct vec3 drawn =
            vec3((double)light[4 * k], (double)light[4 * k + 1], (double)light[4 * k + 2]);
        worst = fmax(worst, fabs((double)lit[4 * k] - shines(lamp, radius, p)));
        worst_light = fmax(worst_light, vec3_length(vec3_sub(drawn, l)));
    }
    g_test_message("irradiance off by %.6f, direction by %.6f", worst, worst_light);
    /* The edge of a narrow spot is steep: 1° from full light to none. */
    g_assert_cmpfloat(worst, <, lamp->cone_deg> 0.0 ? 2e-3 : 1e-4);
    g_assert_cmpfloat(worst_light, <, 1e-4);
}

/* A Lambertian plane: each pixel is the sum of E(p) cos θ of its lamps. */
static void check_plane(const struct viewer_settings *s, const struct viewer_lamp *lamps, int n) {
    g_autoptr(Mesh) mesh = scene_plane();
    g_autoptr(Viewer) view = view_fixture_view(COSINE, 12, 16, mesh);
    g_autofree float *drawn = view_fixture_linear(view, s, WIDTH, HEIGHT);
    const double radius = (double)mesh->radius;
    double worst = 0.0, brightest = 0.0;
    int checked = 0, dark = 0;
    for (int k = 0; k < WIDTH * HEIGHT; k++) {
        const struct vec3 p = on_plane(s, radius, k, 0.0);
        double expected[3] = {0.0}, arriving[3] = {0.0};
        gboolean grazing = FALSE;
        if (fabs(p.x) > 0.97 || fabs(p.y) > 0.97)
            continue;
        for (int l = 0; l < n; l++) {
            const struct vec3 to = lamps[l].distance > 0.0
                                       ? vec3_unit(vec3_sub(lamp_place(&lamps[l], radius), p))
                                       : direction_of_deg(lamps[l].theta_deg, lamps[l].phi_deg);
            const double e = lamps[l].distance > 0.0 ? shines(&lamps[l], radius, p) : 1.0;
            grazing |= to.z < 0.1; /* beyond the lowest light it fades */
            for (int c = 0; c < 3; c++) {
                arriving[c] += e * (double)lamps[l].rgb[c];
                expected[c] += e * to.z * (double)lamps[l].rgb[c];
            }
        }
        if (grazing)
            continue;
        checked++;
        dark += expected[0] == 0.0;
        for (int c = 0; c < 3; c++) {
            const double off = fabs((double)drawn[4 * k + c] - expected[c]);
            /* At the edge of a cone nearly nothing arrives, and rounding decides. */
            worst = fmax(worst, off / fmax(arriving[c], 1e-3));
            brightest = fmax(brightest, expected[c]);
        }
    }
    g_test_message("%d pixels, %d dark, brightest %.3f, off by %.5f of the irradiance", checked,
                   dark, brightest, worst);
    g_assert_cmpint(checked, >, 3000);
    /* Reflectances are interpolated between lights 7° and 22° apart. */
    g_assert_cmpfloat(worst, <, 0.012);
    if (n == 1)
        check_geometry(view, s, &lamps[0], radius);
}

static struct viewer_settings above(void) {
    struct viewer_settings s = view_fixture_settings();
    s.camera_elevation_deg = 80.0;
    s.camera_distance = 3.0;
    return s;
}

GPU_TEST(square) {
    struct viewer_settings s = above();
    for (int k = 0; k < 3; k++) {
        const struct viewer_lamp lamp = {.theta_deg = 20.0 * k,
                                         .phi_deg = 40.0 + 100.0 * k,
                                         .rgb = {0.7F, 0.7F, 0.7F},
                                         .distance = 0.8 + 0.4 * k};
        s.lamp = 0.7;
        s.light_theta_deg = lamp.theta_deg;
        s.light_phi_deg = lamp.phi_deg;
        s.light_distance = lamp.distance;
        check_plane(&s, &lamp, 1);
    }
}

/* Near ones, a spot and one far away together, of three colours. */
GPU_TEST(several) {
    struct viewer_settings s = above();
    const struct viewer_lamp lamps[] = {
        {.theta_deg = 35, .phi_deg = 10, .rgb = {1, 0, 0.5F}, .distance = 0.7},
        {.theta_deg = 25, .phi_deg = 200, .rgb = {0.2F, 0.6F, 0}},
        {.theta_deg = 10,
         .phi_deg = 120,
         .rgb = {0, 0.5F, 1},
         .distance = 1.5,
         .cone_deg = 20,
         .inner_deg = 8,
         .aim = {0.2, -0.1, 0}},
    };
    s.lamp = 0.0;
    s.n_lamps = G_N_ELEMENTS(lamps);
    memcpy(s.lamps, lamps, sizeof lamps);
    check_plane(&s, lamps, s.n_lamps);
}

GPU_TEST(spot) {
    struct viewer_settings s = above();
    const struct viewer_lamp lamp = {.theta_deg = 30,
                                     .phi_deg = 70,
                                     .rgb = {1, 1, 1},
                                     .distance = 1.3,
                                     .cone_deg = 18,
                                     .inner_deg = 17};
    s.light_theta_deg = lamp.theta_deg;
    s.light_phi_deg = lamp.phi_deg;
    s.light_distance = lamp.distance;
    s.light_cone_deg = lamp.cone_deg;
    s.light_inner_deg = lamp.inner_deg;
    check_plane(&s, &lamp, 1);
}

/* At a great distance a lamp is as one that is infinitely far away. */
GPU_TEST(far) {
    g_autoptr(Mesh) mesh = scene_torus(1.0, TUBE, 96, 48);
    g_autoptr(Viewer) view = view_fixture_view(COSINE, 3, 8, mesh);
    struct viewer_settings s = view_fixture_settings();
    for (int shadows = 0; shadows < 2; shadows++) {
        s.shadows = shadows;
        s.light_distance = 0.0;
        g_autofree float *far = view_fixture_linear(view, &s, WIDTH, HEIGHT);
        s.light_distance = 1000.0;
        g_autofree float *near = view_fixture_linear(view, &s, WIDTH, HEIGHT);
        int differ = 0;
        for (int k = 0; k < 4 * WIDTH * HEIGHT; k++)
            differ += fabsf(far[k] - near[k]) > 0.01F;
        g_test_message("%d samples differ", differ);
        /* Maps have other texels: at edges of shadows they differ. */
        g_assert_cmpint(differ, <=, shadows ? 4 * WIDTH * HEIGHT / 50 : 0);
    }
}

/* Whether the way from p to the lamp is free of the torus; by steps of the distance from it. */
static gboolean torus_hides(struct vec3 p, struct vec3 lamp) {
    const struct vec3 way = vec3_sub(lamp, p), d = vec3_unit(way);
    const double end = vec3_length(way);
    for (double along = 0.01; along < end;) {
        const struct vec3 at = vec3_add(p, vec3_scale(d, along));
        const double off = hypot(hypot(at.x, at.y) - 1.0, at.z) - TUBE;
        if (off < 1e-4)
            return TRUE;
        along += off;
    }
    return FALSE;
}

/* Shadows of the torus on the floor, of lamps that have one map, and of one amid it, with six. */
GPU_TEST(shadows) {
    static const struct viewer_lamp lamps[] = {
        {.theta_deg = 40, .phi_deg = 200, .rgb = {1, 1, 1}, .distance = 2.0},
        {.theta_deg = 50, .phi_deg = 60, .rgb = {1, 1, 1}, .distance = 1.05},
        {.theta_deg = 20, .phi_deg = 300, .rgb = {1, 1, 1}, .distance = 0.25},
        {.theta_deg = 30, .phi_deg = 0, .rgb = {1, 1, 1}, .distance = 1.6, .cone_deg = 50},
        {.theta_deg = 60, .phi_deg = 100, .rgb = {1, 1, 1}, .distance = 1.9, .cone_deg = 85},
    };
    const struct scene_options scene = {8, 3, SCENE_Z_UP, TRUE};
    g_autoptr(GError) error = NULL;
    g_autoptr(Mesh) mesh = scene_make("torus", &scene, &error);
    g_autoptr(Viewer) view = view_fixture_view(COSINE, 3, 8, mesh);
    const double radius = (double)mesh->radius;
    struct viewer_settings s = view_fixture_settings();
    s.camera_distance = 5.0;
    s.shadows = TRUE;
    s.shadow_size = 512;
    s.lamp = 0.0;
    s.n_lamps = 1;
    for (gsize l = 0; l < G_N_ELEMENTS(lamps); l++) {
        s.lamps[0] = lamps[l];
        g_autofree float *lit =
            ok(viewer_render_geometry(view, &s, VIEWER_GEOMETRY_LIT, WIDTH, HEIGHT, ERR));
        int both = 0, either = 0;
        for (int k = 0; k < WIDTH * HEIGHT; k++) {
            struct vec3 eye;
            ray_of(&s, radius, k, &eye);
            const struct vec3 p = on_plane(&s, radius, k, -TUBE);
            if (torus_hides(p, eye) || fabs(p.x) > 5.0 || fabs(p.y) > 5.0 ||
                !(shines(&lamps[l], radius, p) > 1e-3))
                continue;
            const gboolean dark = lit[4 * k] < 0.5F * (float)shines(&lamps[l], radius, p);
            const gboolean truth = torus_hides(p, lamp_place(&lamps[l], radius));
            both += dark && truth;
            either += dark || truth;
        }
        g_test_message("lamp %zu: shadow of %d pixels, %.4f in common", l, either,
                       (double)both / either);
        g_assert_cmpint(either, >, WIDTH * HEIGHT / 100);
        g_assert_cmpfloat((double)both / either, >, 0.95);
    }
}

GPU_TEST(reference) {
    const struct scene_options scene = {8, 3, SCENE_Z_UP, TRUE};
    g_autoptr(GError) error = NULL;
    g_autoptr(Mesh) mesh = scene_make("torus", &scene, &error);
    g_autofree char *dir = view_fixture_write_btf(COSINE, 3, 8);
    g_autoptr(Viewer) view = view_fixture_view(COSINE, 3, 8, mesh);
    g_autoptr(Reference) reference = reference_open(dir, &error);
    struct viewer_settings s = viewer_settings_default;
    double relative = 1.0;
    s.shadows = TRUE;
    s.lamp = 0.6;
    s.light_distance = 1.8;
    s.n_lamps = 2;
    s.lamps[0] = (struct viewer_lamp){.theta_deg = 30, .phi_deg = 90, .rgb = {0.1F, 0.2F, 0.9F}};
    s.lamps[1] = (struct viewer_lamp){.theta_deg = 40,
                                      .phi_deg = 0,
                                      .rgb = {1, 0.5F, 0},
                                      .distance = 2.0,
                                      .cone_deg = 30,
                                      .inner_deg = 10};
    g_autofree float *whole =
        ok(reference_render_scene_linear(&reference, 1, view, &s, WIDTH, HEIGHT, &relative, ERR));
    g_test_message("relative error %.5f", relative);
    g_assert_cmpfloat(relative, <, 0.005);
    /* Not the first lamp only. */
    s.n_lamps = 0;
    g_autofree float *one = view_fixture_linear(view, &s, WIDTH, HEIGHT);
    double more = 0.0, all = 0.0;
    for (int k = 0; k < 4 * WIDTH * HEIGHT; k++) {
        more += k % 4 != 3 ? fabs((double)whole[k] - (double)one[k]) : 0.0;
        all += k % 4 != 3 ? (double)whole[k] : 0.0;
    }
    g_assert_cmpfloat(more, >, 0.2 * all);
    remove_folder(dir);
}

/* In shadow a floor shows ambient / π · ∫ T(v, l) dω_l (Wang et al. 2005 §4.2) and nothing else. Of
 * VIEW, T = 0.5 + 0.4 v_x for every l down to the lowest light at 85°, below which T falls with
 * cos θ to 0: the integral is 2π T (1 − cos 85° / 2). */
GPU_TEST(ambient) {
    const struct scene_options scene = {8, 3, SCENE_Z_UP, TRUE};
    g_autoptr(GError) error = NULL;
    g_autoptr(Mesh) mesh = scene_make("torus", &scene, &error);
    g_autoptr(Viewer) view = view_fixture_view(VIEW, 8, 16, mesh);
    struct viewer_settings s = view_fixture_settings();
    const double radius = (double)mesh->radius;
    s.shadows = TRUE;
    s.ambient = 0.1;
    s.camera_distance = 4.0;
    s.camera_elevation_deg = 65.0;
    s.light_distance = 1.5;
    const struct viewer_lamp lamp = {
        .theta_deg = s.light_theta_deg, .phi_deg = s.light_phi_deg, .distance = 1.5};
    g_autofree float *drawn = view_fixture_linear(view, &s, WIDTH, HEIGHT);
    g_autofree float *lit =
        viewer_render_geometry(view, &s, VIEWER_GEOMETRY_LIT, WIDTH, HEIGHT, &error);
    double worst = 0.0, low = 1.0, high = 0.0;
    int n = 0;
    for (int k = 0; k < WIDTH * HEIGHT; k++) {
        struct vec3 eye, d = ray_of(&s, radius, k, &eye);
        const struct vec3 p = on_plane(&s, radius, k, -TUBE);
        if (torus_hides(p, eye) || lit[4 * k + 3] < 0.5F || lit[4 * k] > 0.0F ||
            !torus_hides(p, lamp_place(&lamp, radius)))
            continue;
        const double expected =
            0.1 / G_PI * 2.0 * G_PI * (0.5 - 0.4 * d.x) * (1.0 - 0.5 * cos(85.0 * DEG));
        worst = fmax(worst, fabs((double)drawn[4 * k] / expected - 1.0));
        low = fmin(low, expected);
        high = fmax(high, expected);
        n++;
    }
    g_test_message("%d points in shadow, %.3f … %.3f, off by %.4f", n, low, high, worst);
    g_assert_cmpint(n, >, 200);
    g_assert_cmpfloat(high, >, 1.1 * low);
    g_assert_cmpfloat(worst, <, 0.01);
}

GPU_TEST(mistakes) {
    const struct {
        double distance, cone, inner;
    } wrong[] = {{-1, 0, 0}, {1001, 0, 0}, {1, 91, 0}, {1, 30, -1}, {NAN, 0, 0}};
    for (gsize k = 0; k < G_N_ELEMENTS(wrong); k++) {
        g_autoptr(GError) first = NULL, further = NULL;
        struct viewer_settings s = viewer_settings_default;
        s.light_distance = wrong[k].distance;
        s.light_cone_deg = wrong[k].cone;
        s.light_inner_deg = wrong[k].inner;
        g_assert_false(viewer_settings_check(&s, &first));
        g_assert_error(first, G_OPTION_ERROR, G_OPTION_ERROR_BAD_VALUE);
        s = viewer_settings_default;
        s.n_lamps = 2;
        s.lamps[1].distance = wrong[k].distance;
        s.lamps[1].cone_deg = wrong[k].cone;
        s.lamps[1].inner_deg = wrong[k].inner;
        g_assert_false(viewer_settings_check(&s, &further));
        g_assert_nonnull(strstr(further->message, "further lamp 2"));
    }
    g_autoptr(GError) many = NULL;
    struct viewer_settings s = viewer_settings_default;
    s.n_lamps = VIEWER_MAX_LAMPS;
    g_assert_true(viewer_settings_check(&s, &many));
    s.light_distance = 1.0;
    g_assert_false(viewer_settings_check(&s, &many));
}
