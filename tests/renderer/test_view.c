/* Pictures against what the formula gives; view_fixture.h says how. */
#include "base/data_error.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/skip.h"
#include "lib/test.h"
#include "lib/view_fixture.h"
#include "lib/view_picture.h"
#include "scene/picture.h"

static struct hit hit_plane(struct vec3 eye, struct vec3 d) {
    double along = -eye.z / d.z;
    struct vec3 p = view_fixture_mix(eye, 1.0, d, along);
    struct hit hit = {along > 0.0 && fabs(p.x) < 0.99 && fabs(p.y) < 0.99,
                      0.5 * (p.x + 1.0),
                      0.5 * (p.y + 1.0),
                      vec3(1, 0, 0),
                      vec3(0, 1, 0),
                      vec3(0, 0, 1),
                      view_fixture_mix(d, -1.0, d, 0.0)};
    return hit;
}

static void check_kind(enum kind kind, struct mesh *mesh, const struct viewer_settings *s,
                       struct hit (*find)(struct vec3, struct vec3), double tolerance) {
    g_autoptr(Viewer) view = view_fixture_view(kind, 12, 24, mesh);
    struct check c = {kind, s, NULL, 120, 90, mesh->radius, find};
    g_autofree float *pixels = view_fixture_linear(view, s, c.width, c.height);
    c.pixels = pixels;
    view_fixture_compare(&c, tolerance, 1000);
}

static void check_mesh(struct mesh *mesh, struct viewer_settings s,
                       struct hit (*find)(struct vec3, struct vec3)) {
    check_kind(TEXEL, mesh, &s, find, 1e-3);
    check_kind(VIEW, mesh, &s, find, 0.012);
    check_kind(LIGHT, mesh, &s, find, 0.012);
    mesh_free(mesh);
}

GPU_TEST(plane) {
    struct viewer_settings s = view_fixture_settings();
    s.camera_distance = 1.6;
    s.camera_fov_deg = 60.0;
    s.camera_azimuth_deg = -70.0;
    s.camera_elevation_deg = 50.0;
    s.light_theta_deg = 40.0;
    s.light_phi_deg = 130.0;
    s.tiles_u = 2.0;
    s.tiles_v = 1.5;
    check_mesh(scene_plane(), s, hit_plane);
}

GPU_TEST(plane_from_above) {
    struct viewer_settings s = view_fixture_settings();
    s.camera_elevation_deg = 90.0;
    s.light_theta_deg = 3.0;
    s.light_phi_deg = 300.0;
    check_mesh(scene_plane(), s, hit_plane);
}

GPU_TEST(torus) {
    struct viewer_settings s = view_fixture_settings();
    s.camera_distance = 2.5;
    s.tiles_u = 3.0;
    s.tiles_v = 1.0;
    check_mesh(scene_torus(1.0, 0.4, 512, 256), s, view_fixture_hit_torus);
}

/* Of all pixels that show the mesh. */
static void mean_pixel(const float *pixels, int n, double ret[3]) {
    int found = 0;
    memset(ret, 0, 3 * sizeof(double));
    for (int k = 0; k < n; k++)
        if (pixels[4 * k + 3] > 0.5f) {
            found++;
            for (int c = 0; c < 3; c++)
                ret[c] += pixels[4 * k + c];
        }
    g_assert_cmpint(found, >, 0);
    for (int c = 0; c < 3; c++)
        ret[c] /= found;
}

/* A white diffuser is BTF = n·l: it must follow the cosine all the way down, also below the lowest
 * measured light, be dark beyond, and reflect an even sky in full. */
GPU_TEST(diffuser) {
    g_autoptr(Viewer) view = view_fixture_plane(COSINE, 5, 12);
    struct viewer_settings s = view_fixture_settings();
    s.style.nearest = FALSE;
    const double thetas[] = {0.0, 10.0, 17.0, 34.0, 60.0, 80.0, 86.0, 89.0, 91.0, 150.0};
    double mean[3];
    for (gsize k = 0; k < G_N_ELEMENTS(thetas); k++) {
        s.light_theta_deg = thetas[k];
        g_autofree float *pixels = view_fixture_linear(view, &s, 40, 30);
        mean_pixel(pixels, 40 * 30, mean);
        double expected = fmax(cos(thetas[k] * DEG), 0.0);
        /* The pole is the mean of the ring at 17°. */
        g_assert_cmpfloat_with_epsilon(mean[1], expected, thetas[k] < 17.0 ? 0.045 : 0.012);
    }
    s.ambient = 0.5;
    g_autofree float *pixels = view_fixture_linear(view, &s, 40, 30);
    mean_pixel(pixels, 40 * 30, mean);
    g_assert_cmpfloat_with_epsilon(mean[1], 0.5, 0.015);
}

/* Bytes: exposure, tone and transfer, without and with supersampling. */
GPU_TEST(bytes) {
    g_autoptr(Viewer) view = view_fixture_plane(GREY, 5, 12);
    const struct {
        double ev, linear;
    } cases[] = {{0.0, 0.4}, {-2.0, 0.1}, {1.0, 0.8}, {2.0, 1.0 - 0.2 * exp(-4.0)}, {9.0, 1.0}};
    for (gsize k = 0; k < G_N_ELEMENTS(cases); k++)
        for (int samples = 1; samples <= 4; samples += 3) {
            struct viewer_settings s = view_fixture_settings();
            s.camera_elevation_deg = 90.0;
            s.camera_distance = 0.5;
            s.light_theta_deg = 20.0;
            s.exposure_ev = cases[k].ev;
            s.samples = samples;
            g_autofree guint8 *rgb = ok(view_picture(view, &s, 16, 12, ERR));
            const double x = cases[k].linear;
            const double srgb = x <= 0.0031308 ? 12.92 * x : 1.055 * pow(x, 1.0 / 2.4) - 0.055;
            for (int b = 0; b < 16 * 12 * 3; b++)
                g_assert_cmpfloat_with_epsilon(rgb[b], 255.0 * srgb, 1.01);
            /* Light is neither toned nor rounded. */
            g_autofree float *light = ok(viewer_render_light(view, &s, 16, 12, ERR));
            for (int b = 0; b < 16 * 12 * 3; b++)
                g_assert_cmpfloat_with_epsilon(light[b] / exp2(cases[k].ev), 0.4, 0.002);
        }
}

/* Where texels are far smaller than pixels the picture is their mean and does not shimmer. */
GPU_TEST(minified) {
    g_autoptr(Viewer) view = view_fixture_plane(TEXEL, 5, 12);
    struct viewer_settings s = view_fixture_settings();
    s.style.nearest = FALSE;
    s.tiles_u = s.tiles_v = 200.0;
    s.camera_elevation_deg = 90.0;
    s.light_theta_deg = 20.0;
    s.camera_distance = 1.0;
    g_autofree float *pixels = view_fixture_linear(view, &s, 40, 30);
    for (int k = 0; k < 40 * 30; k++)
        for (int c = 0; c < 3; c++)
            g_assert_cmpfloat_with_epsilon(pixels[4 * k + c], 0.5, 0.06);
}

/* Between texels a wave is nearer to its true course than straight lines could bring it: those miss
 * its crests by 0.4 (1 − cos(π/7)) = 0.040 and 0.4 (1 − cos(π/5)) = 0.076. */
GPU_TEST(magnified) {
    g_autoptr(Viewer) view = view_fixture_plane(WAVE, 5, 12);
    struct viewer_settings s = view_fixture_settings();
    s.style.nearest = FALSE;
    s.camera_elevation_deg = 90.0;
    s.camera_azimuth_deg = -90.0;
    s.camera_distance = 3.0;
    s.light_theta_deg = 20.0;
    g_autofree float *pixels = view_fixture_linear(view, &s, 200, 200);
    double worst[2] = {0.0, 0.0};
    for (int k = 0; k < 200 * 200; k++) {
        struct vec3 eye, d = view_fixture_ray(&s, M_SQRT2, 200, 200, k % 200, k / 200, &eye);
        struct hit hit = hit_plane(eye, d);
        if (!hit.found)
            continue;
        double x = 0.5 + 0.4 * sin(2.0 * G_PI * hit.u), y = 0.5 + 0.4 * cos(-2.0 * G_PI * hit.v);
        worst[0] = fmax(worst[0], fabs(pixels[4 * k] - x));
        worst[1] = fmax(worst[1], fabs(pixels[4 * k + 1] - y));
    }
    g_test_message("worst %.4f, %.4f", worst[0], worst[1]);
    g_assert_cmpfloat(worst[0], <, 0.020);
    g_assert_cmpfloat(worst[1], <, 0.038);
}

/* Whether a row or a column of the picture shows the mesh anywhere. */
static gboolean shows(const float *pixels, int size, int at, gboolean column) {
    for (int k = 0; k < size; k++)
        if (pixels[4 * (column ? k * size + at : at * size + k) + 3] > 0.5f)
            return TRUE;
    return FALSE;
}

/* The shape stands in the middle and fills 92 % of the picture one way. */
static void check_fit(const char *shape, double azimuth_deg, double elevation_deg) {
    enum { SIZE = 200 };
    g_autoptr(GError) error = NULL;
    g_autoptr(Mesh) mesh = scene_shape(shape, SCENE_Z_UP, &error);
    g_autoptr(Viewer) view = view_fixture_view(GREY, 3, 8, mesh);
    struct viewer_settings s = viewer_settings_default;
    s.camera_azimuth_deg = azimuth_deg;
    s.camera_elevation_deg = elevation_deg;
    g_autofree float *pixels = view_fixture_linear(view, &s, SIZE, SIZE);
    int filled = 0;
    for (int column = 0; column < 2; column++) {
        int first = 0, last = SIZE - 1;
        while (first < last && !shows(pixels, SIZE, first, column))
            first++;
        while (last > first && !shows(pixels, SIZE, last, column))
            last--;
        g_test_message("%s: %d … %d", shape, first, last);
        filled = MAX(filled, last - first + 1);
        g_assert_cmpint(ABS(first - (SIZE - 1 - last)), <=, 4);
    }
    g_assert_cmpint(filled, >=, 180);
    g_assert_cmpint(filled, <=, 185);
}

GPU_TEST(fit) {
    check_fit("torus", -90.0, 40.0);
    check_fit("torus", 20.0, 5.0);
    check_fit("plane", -90.0, 25.0);
    check_fit("plane", -60.0, 90.0);
    check_fit("sphere", 10.0, -30.0);
    check_fit("cylinder", -90.0, 40.0);
}

static void refuse(struct eigenmaps *material, const char *said) {
    g_autoptr(GError) error = NULL;
    g_assert_null(viewer_new(material, &error));
    g_assert_nonnull(error);
    g_test_message("%s", error->message);
    g_assert_nonnull(strstr(error->message, said));
    eigenmaps_free(material);
}

GPU_TEST(bad_material) {
    struct eigenmaps *m = view_fixture_material(GREY, 3, 4);
    m->maps[(2 * 12 + 5) * W * H * 3 + 8 * 3] = NAN;
    refuse(m, "term 2 and light 5 at texel (1, 1)");
    m = view_fixture_material(GREY, 3, 4);
    m->weights[13] = INFINITY;
    refuse(m, "term 1 for view 1");
    m = view_fixture_material(GREY, 3, 4);
    m->layout.lights.theta_deg[2] = 100.0f;
    refuse(m, "lights: direction 2");
    m = view_fixture_material(GREY, 3, 4);
    m->layout.views.phi_deg[2] = NAN;
    refuse(m, "views: direction 2");
    m = view_fixture_material(GREY, 3, 4);
    m->n_terms = 100000; /* refused before anything of it is read */
    refuse(m, "layers");
    m = view_fixture_material(GREY, 3, 4);
    m->layout.width = 1 << 20;
    refuse(m, "texels");
    m = view_fixture_material(GREY, 3, 4);
    m->layout.lights.n = 0;
    refuse(m, "the eigen-maps have no lights");
}

TEST(bad_settings) {
    struct viewer_settings s = viewer_settings_default;
    g_autoptr(GError) error = NULL, nan = NULL;
    g_assert_true(viewer_settings_check(&s, &error));
    s.camera_fov_deg = 180.0;
    g_assert_false(viewer_settings_check(&s, &error));
    g_assert_nonnull(strstr(error->message, "1 … 120"));
    s = viewer_settings_default;
    s.exposure_ev = NAN;
    g_assert_false(viewer_settings_check(&s, &nan));
    g_assert_nonnull(strstr(nan->message, "exposure"));
}

GPU_TEST(too_large) {
    g_autoptr(Viewer) view = view_fixture_plane(GREY, 3, 4);
    g_autoptr(GError) error = NULL;
    g_assert_null(view_picture(view, &viewer_settings_default, 1000000, 2, &error));
    g_assert_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE);
}

TEST(png) {
    g_autoptr(GError) error = NULL, folder = NULL;
    g_autofree char *dir = g_dir_make_tmp("mesorig-XXXXXX", NULL);
    g_autofree char *path = g_build_filename(dir, "a.png", NULL);
    guint8 rgb[5 * 3 * 3];
    for (gsize k = 0; k < sizeof rgb; k++)
        rgb[k] = 37 * k;
    const char *texts[] = {"Shape", "torus", "Light", "theta 50°", NULL};
    g_assert_true(ok(picture_write_png(path, rgb, 5, 3, texts, ERR)));
    int width, height;
    g_autofree guint8 *read = view_fixture_read_png(path, &width, &height);
    g_assert_cmpint(width, ==, 5);
    g_assert_cmpint(height, ==, 3);
    g_assert_cmpmem(read, sizeof rgb, rgb, sizeof rgb);
    g_autofree char *bytes = NULL;
    gsize length;
    g_assert_true(g_file_get_contents(path, &bytes, &length, NULL));
    g_assert_nonnull(memmem(bytes, length, "tEXtShape\0torus", 15));
    g_assert_nonnull(memmem(bytes, length, "theta 50°", 10));
    g_unlink(path);
    g_rmdir(dir);
    g_assert_false(picture_write_png(path, rgb, 5, 3, texts, &folder));
    g_assert_error(folder, DATA_ERROR, DATA_ERROR_IO);
}

static void check_usage(int status, const char *const *arguments, const char *said) {
    g_autofree char *out = NULL, *err = NULL;
    g_assert_cmpint(process_run(arguments, &out, &err), ==, status);
    g_test_message("%s", err);
    g_assert_nonnull(strstr(err, said));
}

GPU_TEST(program__usage) {
    if (!view_fixture_have_program())
        return;
    check_usage(2, (const char *[]){VIEWER, "a", "b", NULL}, "one MATERIAL");
    check_usage(2, (const char *[]){VIEWER, "--method", "lpca", NULL}, "mesorig compress");
    check_usage(2, (const char *[]){VIEWER, "a", "--method", "lpca", "--plain", NULL}, "--plain");
    check_usage(2, (const char *[]){VIEWER, "--rotation", "left", NULL}, "approximate");
    check_usage(2, (const char *[]){VIEWER, "a", "--split", "halves", NULL}, "--split halves");
    check_usage(2, (const char *[]){VIEWER, "a", "-o", "b", "--measured", NULL}, "a session");
    check_usage(2, (const char *[]){VIEWER, "a", "-o", "b", "--live", NULL}, "eigenmaps");
    check_usage(2, (const char *[]){VIEWER, "--bogus", NULL}, "--bogus");
    check_usage(2, (const char *[]){VIEWER, "a", "-o", "b", "--size", "0x9", NULL}, "--size 0x9");
    check_usage(2, (const char *[]){VIEWER, "a", "-o", "b", "--tiles", "3x", NULL}, "--tiles 3x");
    check_usage(2, (const char *[]){VIEWER, "a", "-o", "b", "--exposure", "99", NULL}, "exposure");
    check_usage(2, (const char *[]){VIEWER, "a", "--frames", "3", NULL}, "--render");
    check_usage(2, (const char *[]){VIEWER, "a", "--reference", NULL}, "--reference");
    check_usage(2, (const char *[]){VIEWER, "a", "-o", "b", "--sheet", "2", NULL}, "--sheet");
    check_usage(2,
                (const char *[]){VIEWER, "a", "-o", "b", "--frames", "99", "--sheet", "99", NULL},
                "16384");
    check_usage(2, (const char *[]){VIEWER, "a", "-o", "b", "--silhouettes=x", NULL}, "peel");
    check_usage(2, (const char *[]){VIEWER, "a", "-o", "b", "--layers", "99", NULL}, "layers");
    check_usage(2, (const char *[]){VIEWER, "a", "-o", "b", "--shadow-map", "1", NULL}, "16384");
    check_usage(1, (const char *[]){VIEWER, "/nowhere", "-o", "b.png", NULL}, "/nowhere");
    check_usage(1, (const char *[]){VIEWER, "/nowhere", "-o", "b", "--shape", "cow", NULL}, "cow");
    check_usage(1, (const char *[]){VIEWER, "/", "-o", "b.png", NULL}, "products/eigenmaps.exr");
    check_usage(1, (const char *[]){VIEWER, "no.session", "-o", "b.png", NULL},
                "there is no no.session; give the directory of a session");
}

GPU_TEST(program__renders) {
    if (!view_fixture_have_program())
        return;
    g_autofree char *dir = view_fixture_write_session(), *out = NULL, *err = NULL;
    g_autofree char *path = g_build_filename(dir, "turn.png", NULL);
    const char *arguments[] = {VIEWER,         dir,       "--render", path,       "--size",
                               "48x32",        "--shape", "sphere",   "--frames", "4",
                               "--light-turn", "--json",  NULL};
    g_assert_cmpint(process_run(arguments, &out, &err), ==, 0);
    g_assert_nonnull(strstr(out, "\"width\": 48, \"height\": 32, \"frames\": 4"));
    g_assert_nonnull(strstr(out, "turn_0003.png\"]"));
    guint8 *rgb[2];
    for (int k = 0; k < 2; k++) {
        g_autofree char *one = g_strdup_printf("%s/turn_%04d.png", dir, 2 * k);
        int width, height;
        rgb[k] = view_fixture_read_png(one, &width, &height);
        g_assert_cmpint(width, ==, 48);
    }
    g_assert_cmpint(memcmp(rgb[0], rgb[1], 48 * 32 * 3), !=, 0);
    g_free(rgb[0]);
    g_free(rgb[1]);
    view_fixture_remove_session(dir, (const char *[]){"turn_0000.png", "turn_0001.png",
                                                      "turn_0002.png", "turn_0003.png", NULL});
}

/* A session without an MDF has shadows, but no silhouettes. */
GPU_TEST(program__relief) {
    if (!view_fixture_have_program())
        return;
    g_autofree char *dir = view_fixture_write_session(), *out = NULL, *err = NULL;
    g_autofree char *path = g_build_filename(dir, "floor.png", NULL);
    check_usage(1, (const char *[]){VIEWER, dir, "-o", path, "--silhouettes", NULL},
                "products/mdf.exr");
    const char *arguments[] = {VIEWER,    dir,         "-o",      path,         "--size", "24x16",
                               "--floor", "--shadows", "--shape", "torus-knot", NULL};
    g_assert_cmpint(process_run(arguments, &out, &err), ==, 0);
    view_fixture_remove_session(dir, (const char *[]){"floor.png", NULL});
}

/* A sheet holds the frames that would be files of their own, row by row. */
GPU_TEST(program__sheet) {
    if (!view_fixture_have_program())
        return;
    g_autofree char *dir = view_fixture_write_session(), *out = NULL, *err = NULL, *out2 = NULL,
                    *err2 = NULL;
    g_autofree char *sheet = g_build_filename(dir, "sheet.png", NULL);
    g_autofree char *turn = g_build_filename(dir, "turn.png", NULL);
    const char *one[] = {VIEWER, dir,       "-o", sheet,          "--size", "24x16", "--frames",
                         "3",    "--sheet", "2",  "--light-turn", "--json", NULL};
    const char *many[] = {VIEWER,  dir,        "-o", turn,           "--size",
                          "24x16", "--frames", "3",  "--light-turn", NULL};
    g_assert_cmpint(process_run(one, &out, &err), ==, 0);
    g_assert_nonnull(strstr(out, "sheet.png\"]"));
    g_assert_cmpint(process_run(many, &out2, &err2), ==, 0);
    int width, height;
    g_autofree guint8 *whole = view_fixture_read_png(sheet, &width, &height);
    g_assert_cmpint(width, ==, 48);
    g_assert_cmpint(height, ==, 32);
    for (int k = 0; k < 3; k++) {
        g_autofree char *path = g_strdup_printf("%s/turn_%04d.png", dir, k);
        int w, h;
        g_autofree guint8 *frame = view_fixture_read_png(path, &w, &h);
        for (int j = 0; j < 16; j++)
            g_assert_cmpmem(whole + 3 * ((k / 2 * 16 + j) * 48 + k % 2 * 24), 3 * 24,
                            frame + 3 * 24 * j, 3 * 24);
    }
    view_fixture_remove_session(dir, (const char *[]){"sheet.png", "turn_0000.png", "turn_0001.png",
                                                      "turn_0002.png", NULL});
}

/* The program finds a session's BTF, and says how far the eigen-maps are from it. */
GPU_TEST(program__reference) {
    if (!view_fixture_have_program())
        return;
    g_autofree char *dir = view_fixture_write_session(), *out = NULL, *err = NULL;
    g_autofree char *made = view_fixture_write_btf(LIGHT, 3, 4);
    g_autofree char *btf = g_build_filename(dir, "products", "btf", NULL);
    g_autofree char *path = g_build_filename(dir, "whole.png", NULL);
    g_assert_cmpint(g_rename(made, btf), ==, 0);
    const char *arguments[] = {VIEWER,  dir,           "-o",     path, "--size",
                               "48x32", "--reference", "--json", NULL};
    g_assert_cmpint(process_run(arguments, &out, &err), ==, 0);
    g_test_message("%s", out);
    /* Only the steps between texels differ: bicubic here, linear there. */
    g_assert_nonnull(strstr(out, "\"relative_error\": 0.0"));
    remove_folder(btf);
    check_usage(1, arguments, "products/btf");
    view_fixture_remove_session(dir, (const char *[]){"whole.png", NULL});
}

GPU_TEST(program__window) {
    g_autofree char *xvfb = g_find_program_in_path("xvfb-run");
    if (!view_fixture_have_program())
        return;
    if (xvfb == NULL) {
        test_skip_or_fail("no xvfb-run");
        return;
    }
    g_autofree char *dir = view_fixture_write_session(), *out = NULL, *err = NULL;
    g_autofree char *path = g_build_filename(dir, "window.png", NULL);
    const char *arguments[] = {xvfb,     "-a",           VIEWER,   dir,
                               "--size", "160x120",      "--json", "--close-after",
                               "3",      "--screenshot", path,     NULL};
    int status = process_run(arguments, &out, &err);
    g_test_message("%s%s", out, err);
    g_assert_cmpint(status, ==, 0);
    g_assert_nonnull(strstr(out, "\"frames\": 3"));
    int width, height;
    g_autofree guint8 *rgb = view_fixture_read_png(path, &width, &height);
    g_assert_cmpint(width, ==, 160);
    g_assert_cmpint(rgb[3 * (60 * 160 + 40)], >, 60); /* on the torus, left of its hole */
    view_fixture_remove_session(dir, (const char *[]){"window.png", NULL});
}

GPU_TEST(program__no_display) {
    if (!view_fixture_have_program())
        return;
    g_autofree char *dir = view_fixture_write_session();
    check_usage(
        1, (const char *[]){"env", "-u", "DISPLAY", "-u", "WAYLAND_DISPLAY", VIEWER, dir, NULL},
        "--render");
    view_fixture_remove_session(dir, (const char *[]){NULL});
}
