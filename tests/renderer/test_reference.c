/* Pictures from the whole BTF: against the formula, and against eigen-maps that are exact. */
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "lib/view_fixture.h"
#include "lib/view_picture.h"
#include "scene/compose.h"
#include "scene/measured.h"
#include "session/session.h"
#include "window/live.h"

#include <mesorig/material.h>

static void check_reference(enum kind kind, struct mesh *mesh, const struct viewer_settings *s,
                            struct hit (*find)(struct vec3, struct vec3), double tolerance) {
    g_autoptr(GError) error = NULL;
    g_autofree char *dir = view_fixture_write_btf(kind, 8, 16);
    g_autoptr(Reference) reference = reference_open(dir, &error);
    g_assert_no_error(error);
    g_autoptr(Viewer) view = view_fixture_view(kind, 8, 16, mesh);
    struct check c = {kind, s, NULL, 120, 90, mesh->radius, find};
    double relative;
    g_autofree float *pixels = ok(
        reference_render_scene_linear(&reference, 1, view, s, c.width, c.height, &relative, ERR));
    c.pixels = pixels;
    view_fixture_compare(&c, tolerance, 1000);
    /* These materials' eigen-maps are exact. */
    g_assert_cmpfloat(relative, <, 0.01);
    remove_folder(dir);
}

GPU_TEST(formula) {
    struct viewer_settings s = view_fixture_settings();
    s.camera_distance = 2.5;
    s.tiles_u = 3.0;
    g_autoptr(Mesh) mesh = scene_torus(1.0, 0.4, 512, 256);
    check_reference(TEXEL, mesh, &s, view_fixture_hit_torus, 1e-3);
    check_reference(VIEW, mesh, &s, view_fixture_hit_torus, 0.03);
    check_reference(LIGHT, mesh, &s, view_fixture_hit_torus, 0.03);
}

/* Filtered, seen from all around, and lit by the sky too: the two ways agree in every sample. */
GPU_TEST(agrees) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Mesh) mesh = scene_sphere();
    g_autofree char *dir = view_fixture_write_btf(COSINE, 3, 8);
    g_autoptr(Viewer) view = view_fixture_view(COSINE, 3, 8, mesh);
    g_autoptr(Reference) reference = reference_open(dir, &error);
    struct viewer_settings s = viewer_settings_default;
    double relative = 1.0;
    g_autofree guint8 *whole =
        ok(reference_render_scene(&reference, 1, view, &s, 60, 40, &relative, ERR));
    g_autofree guint8 *maps = view_picture(view, &s, 60, 40, &error);
    g_assert_cmpfloat(relative, <, 0.005);
    for (int k = 0; k < 60 * 40 * 3; k++)
        g_assert_cmpint(ABS(whole[k] - maps[k]), <=, 3);
    remove_folder(dir);
}

/* In a shadow both have what an even sky gives, and nothing else. */
GPU_TEST(shadows) {
    const struct scene_options scene = {8, 3, SCENE_Z_UP, TRUE};
    g_autoptr(GError) error = NULL;
    g_autoptr(Mesh) mesh = scene_make("torus", &scene, &error);
    g_autofree char *dir = view_fixture_write_btf(COSINE, 3, 8);
    g_autoptr(Viewer) view = view_fixture_view(COSINE, 3, 8, mesh);
    g_autoptr(Reference) reference = reference_open(dir, &error);
    struct viewer_settings s = viewer_settings_default;
    s.shadows = TRUE;
    s.ambient = 0.1;
    double relative = 1.0, dark = 0.0;
    g_autofree float *whole =
        ok(reference_render_scene_linear(&reference, 1, view, &s, 120, 90, &relative, ERR));
    g_assert_cmpfloat(relative, <, 0.005);
    g_autofree float *lit = viewer_render_geometry(view, &s, VIEWER_GEOMETRY_LIT, 120, 90, &error);
    for (int k = 0; k < 120 * 90; k++)
        if (lit[4 * k + 3] > 0.5f && lit[4 * k] == 0.0f) {
            dark++;
            g_assert_cmpfloat(whole[4 * k], <=, 0.1 + 1e-3);
        }
    g_assert_cmpfloat(dark, >, 500.0);
    remove_folder(dir);
}

/* A session directory with these views as its BTF, which are moved there. */
static char *make_session(const char *views) {
    static const struct session_texts texts = {
        .rig_conf = "", .session_conf = "", .calibration = "", .rig_path = "/etc/mesorig/rig.conf"};
    const struct session_plan plan = {.grid = {W, H, 0.5 * W, 0.5 * H, 5, 1}};
    g_autofree char *folder = g_dir_make_tmp("mesorig-XXXXXX", NULL);
    char *session = g_build_filename(folder, "a.session", NULL);
    g_autofree char *btf = g_build_filename(session, "products", "btf", NULL);
    ok(session_close(session_create(session, "a", &texts, &plan, ERR)));
    g_autofree char *products = g_path_get_dirname(btf);
    g_assert_cmpint(g_mkdir_with_parents(products, 0755), ==, 0);
    g_assert_cmpint(g_rename(views, btf), ==, 0);
    return session;
}

/* libmesorig-material gives each sample of the picture the value that the reference gives it. */
GPU_TEST(library) {
    enum { WIDTH = 60, HEIGHT = 45 };
    g_autoptr(GError) error = NULL;
    g_autoptr(Mesh) mesh = scene_torus(1.0, 0.4, 128, 64);
    g_autofree char *views = view_fixture_write_btf(VIEW, 3, 8);
    g_autoptr(Viewer) viewer = view_fixture_view(VIEW, 3, 8, mesh);
    g_autofree char *session = make_session(views);
    g_autofree char *btf = g_build_filename(session, "products", "btf", NULL);
    g_autofree char *folder = g_path_get_dirname(session);
    g_autoptr(Reference) reference = reference_open(btf, &error);
    g_assert_no_error(error);
    struct mesorig_error why = {0};
    mesorig_material *material = mesorig_material_open(session, NULL, &why);
    g_assert_cmpstr(why.text, ==, "");
    struct viewer_settings s = view_fixture_settings();
    s.camera_distance = 2.5;
    s.ambient = 0.0;
    s.style.nearest = FALSE;
    g_autofree float *whole =
        ok(reference_render_scene_linear(&reference, 1, viewer, &s, WIDTH, HEIGHT, NULL, ERR));
    float *geometry[3];
    const enum viewer_geometry kinds[] = {VIEWER_GEOMETRY_TEXEL, VIEWER_GEOMETRY_VIEW,
                                          VIEWER_GEOMETRY_LIGHT};
    for (int k = 0; k < 3; k++)
        geometry[k] = viewer_render_geometry(viewer, &s, kinds[k], WIDTH, HEIGHT, &error);
    int n = 0;
    double worst = 0.0;
    for (int k = 0; k < 4 * WIDTH * HEIGHT; k += 4) {
        float rgb[3];
        if (geometry[0][k + 3] <= 0.5f || geometry[0][k + 2] <= 0.5f || geometry[1][k + 2] <= 0.0f)
            continue;
        mesorig_material_evaluate(material, 1, geometry[0] + k, geometry[1] + k, geometry[2] + k,
                                  NULL, rgb);
        for (int c = 0; c < 3; c++)
            worst = fmax(worst, (double)fabsf(rgb[c] - whole[k + c]));
        n += rgb[2] > 0.01f;
    }
    g_test_message("%d lit samples, off by at most %g", n, worst);
    g_assert_cmpint(n, >, 300);
    g_assert_cmpfloat(worst, <, 1e-5);
    for (int k = 0; k < 3; k++)
        g_free(geometry[k]);
    mesorig_material_close(material);
    remove_tree(folder);
}

/* A compressed file on the processor, lit by the sky too, against the graphics card. */
GPU_TEST(file) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Mesh) mesh = scene_sphere();
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "x.exr", NULL);
    g_autofree char *none = g_build_filename(folder, "none.exr", NULL);
    struct eigenmaps *maps = view_fixture_material(COSINE, 3, 8);
    g_assert_true(eigenmaps_write(path, maps, &error));
    eigenmaps_free(maps);
    g_autoptr(Viewer) viewer = view_fixture_view(COSINE, 3, 8, mesh);
    g_autoptr(Reference) reference = reference_open_material(path, &error);
    g_assert_no_error(error);
    struct viewer_settings s = viewer_settings_default;
    g_assert_cmpfloat(s.ambient, >, 0.0);
    double relative = 1.0;
    g_autofree guint8 *whole =
        ok(reference_render_scene(&reference, 1, viewer, &s, 60, 40, &relative, ERR));
    g_assert_cmpfloat(relative, <, 0.005);
    g_assert_null(reference_open_material(none, &error));
    g_assert_error(error, REFERENCE_ERROR, REFERENCE_ERROR_FORMAT);
}

TEST(bad) {
    g_autoptr(GError) none = NULL, odd = NULL, torn = NULL, lost = NULL;
    g_autofree char *dir = view_fixture_write_btf(GREY, 1, 4);
    g_assert_null(reference_open("/nowhere", &none));
    g_assert_error(none, REFERENCE_ERROR, REFERENCE_ERROR_NONE);
    struct eigenmaps *m = view_fixture_material(GREY, 1, 4);
    m->layout.views.phi_deg[2] = NAN;
    write_view(GREY, m, 2, dir);
    g_assert_null(reference_open(dir, &lost));
    g_assert_error(lost, REFERENCE_ERROR, REFERENCE_ERROR_FORMAT);
    g_assert_nonnull(strstr(lost->message, "view_0002.exr: part light_0000: the attribute view."));
    m->layout.lights.n = 3;
    write_view(GREY, m, 2, dir); /* a light is missing */
    eigenmaps_free(m);
    g_assert_null(reference_open(dir, &odd));
    g_assert_error(odd, REFERENCE_ERROR, REFERENCE_ERROR_FORMAT);
    g_assert_nonnull(strstr(odd->message, "view_0002.exr"));
    g_autofree char *path = g_build_filename(dir, "view_0001.exr", NULL);
    g_assert_true(g_file_set_contents(path, "v/1\1", 4, NULL));
    g_assert_null(reference_open(dir, &torn));
    g_assert_nonnull(strstr(torn->message, "view_0001.exr"));
    remove_folder(dir);
}

/* Of exact eigen-maps nothing differs; each panel is the right texel of the right frame. */
GPU_TEST(measured) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Mesh) mesh = scene_plane();
    g_autofree char *dir = view_fixture_write_btf(VIEW, 3, 8);
    g_autoptr(Reference) reference = reference_open(dir, &error);
    g_autoptr(Viewer) view = view_fixture_view(VIEW, 3, 8, mesh);
    struct viewer_settings s = view_fixture_settings();
    struct measured m;
    s.camera_elevation_deg = 35; /* the rings are at 28, 57 and 85 degrees from above */
    s.camera_azimuth_deg = 80;
    s.light_theta_deg = 20;
    s.light_phi_deg = 200;
    s.exposure_ev = -1; /* below where tones bend */
    g_assert_true(ok(measured_compare(reference, view, &s, 3 * W * 4 + 5, &m, ERR)));
    g_assert_cmpint(m.width, ==, 3 * W * 4);
    g_assert_cmpint(m.height, ==, H * 4);
    g_assert_cmpfloat_with_epsilon((double)m.view_theta_deg, 170.0 / 3, 0.1);
    g_assert_cmpfloat_with_epsilon((double)m.view_phi_deg, 90, 0.1);
    g_assert_cmpfloat_with_epsilon((double)m.light_theta_deg, 85.0 / 3, 0.1);
    g_assert_cmpfloat(m.error, <, 0.002);
    for (int j = 0; j < m.height; j++)
        for (int i = 0; i < W * 4; i++) {
            const guint8 *at = m.rgb + 3 * (j * m.width + i);
            const double blue = 0.8 * 0.5 * texel_code(i / 4, j / 4);
            const double srgb =
                blue <= 0.0031308 ? 12.92 * blue : 1.055 * pow(blue, 1 / 2.4) - 0.055;
            g_assert_cmpfloat(fabs(at[2] - 255 * srgb), <, 2);
            g_assert_cmpint(ABS(at[2] - at[3 * 4 * W + 2]), <=, 1);
            for (int c = 0; c < 3; c++)
                g_assert_cmpint(ABS(at[3 * 8 * W + c] - 128), <=, 8);
        }
    measured_clear(&m);
    remove_folder(dir);
}

GPU_TEST(compose) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Mesh) mesh = scene_torus(1.0, 0.4, 64, 32);
    g_autoptr(Viewer) a = view_fixture_view(LIGHT, 3, 8, mesh),
                      b = view_fixture_view(COSINE, 3, 8, mesh);
    g_autoptr(Compose) compose = compose_new(&error);
    const struct viewer_settings s = view_fixture_settings();
    const struct compose hows[] = {
        {COMPOSE_ONE, 0.5, 4}, {COMPOSE_SPLIT, 0.25, 4}, {COMPOSE_DIFFERENCE, 0.5, 3}};
    guint8 *pictures[3];
    g_autofree guint8 *other = view_picture(b, &s, 80, 60, &error);
    for (int k = 0; k < 3; k++) {
        pictures[k] = ok(compose_render(compose, a, b, &hows[k], &s, 80, 60, ERR));
    }
    for (int k = 0; k < 80 * 60 * 3; k++) {
        const int x = k / 3 % 80, first = pictures[0][k];
        if (x < 18 || x > 21)
            g_assert_cmpint(pictures[1][k], ==, x < 20 ? first : other[k]);
        const double difference = CLAMP(127.5 + 3 * (other[k] - first), 0, 255);
        g_assert_cmpfloat(fabs(pictures[2][k] - difference), <=, 1);
    }
    for (int k = 0; k < 3; k++)
        g_free(pictures[k]);
}

/* Views that come one after the other are in what is shown. */
TEST(live) {
    g_autofree char *made = view_fixture_write_btf(LIGHT, 2, 4);
    g_autofree char *session = g_dir_make_tmp("mesorig-XXXXXX", NULL);
    g_autofree char *products = g_build_filename(session, "products", NULL);
    g_autofree char *btf = g_build_filename(products, "btf", NULL);
    g_assert_cmpint(g_mkdir_with_parents(btf, 0755), ==, 0);
    g_autoptr(Live) live = live_new(session);
    g_autoptr(GError) error = NULL;
    int n_views = 0;
    g_assert_null(live_eigenmaps(session, &n_views, &error));
    g_assert_error(error, REFERENCE_ERROR, REFERENCE_ERROR_NONE);
    g_clear_error(&error);
    g_assert_null(live_poll(live, &n_views, NULL));
    for (int n = 0; n < 8; n += 4) {
        for (int k = n; k < n + 4; k++) {
            g_autofree char *from = g_strdup_printf("%s/view_%04d.exr", made, k);
            g_autofree char *to = g_strdup_printf("%s/view_%04d.exr", btf, k);
            g_assert_cmpint(g_rename(from, to), ==, 0);
        }
        struct eigenmaps *maps = NULL;
        for (int k = 0; maps == NULL && k < 1000; k++) {
            maps = ok(live_poll(live, &n_views, ERR));
            g_usleep(maps == NULL ? 10000 : 0);
        }
        g_assert_nonnull(maps);
        g_assert_cmpint(n_views, ==, n + 4);
        g_assert_cmpint(maps->layout.views.n, ==, n + 4);
        g_assert_cmpint(maps->layout.lights.n, ==, 8);
        g_assert_null(live_poll(live, &n_views, NULL)); /* nothing new */
        eigenmaps_free(maps);
    }
    remove_folder(btf);
    remove_folder(made);
    g_assert_true(g_rmdir(products) == 0 && g_rmdir(session) == 0);
    g_assert_null(live_views(session, &error));
    g_assert_nonnull(error);
}

/* A flat surface below the reference plane, painted with one wave a tile: three views show it
 * displaced, each by its own ray. */
#define DEEP_SIDE 32
#define DEEP_MM   0.5 /* a texel */
#define DEEP_TILE (DEEP_SIDE * DEEP_MM)
#define DEEP      1.6 /* mm below */

static double deep_painted(double x, double y) {
    return 0.5 + 0.3 * sin(2.0 * G_PI / DEEP_TILE * x) * cos(2.0 * G_PI / DEEP_TILE * y);
}

/* What is seen through a point of the reference plane along a ray towards v. */
static double deep_seen(double x, double y, struct vec3 v) {
    return deep_painted(x - v.x * DEEP / v.z, y - v.y * DEEP / v.z);
}

/* view_0000.exr … and mdf.exr; the same under each light. */
static char *write_deep(void) {
    static const char *const colours[] = {"B", "G", "R", NULL}, *const distance[] = {"D", NULL};
    char *folder = g_dir_make_tmp("mesorig-XXXXXX", NULL);
    g_autofree char *mdf_path = g_build_filename(folder, "mdf.exr", NULL);
    g_autoptr(ExrFile) mdf = exr_file_new();
    g_autoptr(GError) error = NULL;
    for (int view = 0; view < 3; view++) {
        const struct vec3 centre = vec3_scale(direction_of_deg(45, 120 * view), 600);
        g_autofree char *name = g_strdup_printf("view_%04d", view);
        g_autofree char *path = g_strdup_printf("%s/%s.exr", folder, name);
        g_autoptr(ExrFile) file = exr_file_new();
        struct exr_part *depth = exr_part_new(name, DEEP_SIDE, DEEP_SIDE, distance, EXR_FLOAT);
        exr_set_v3d(depth, "view.centre_mm", centre.x, centre.y, centre.z);
        exr_set_double(depth, "texel_mm", DEEP_MM);
        exr_set_double(depth, "reference_mm", 0);
        for (int light = 0; light < 4; light++) {
            g_autofree char *light_name = g_strdup_printf("light_%04d", light);
            struct exr_part *part =
                exr_part_new(light_name, DEEP_SIDE, DEEP_SIDE, colours, EXR_FLOAT);
            exr_set_double(part, "light.theta_deg", light > 0 ? 40 : 0);
            exr_set_double(part, "light.phi_deg", 120 * light);
            exr_set_double(part, "view.theta_deg", 45);
            exr_set_double(part, "view.phi_deg", 120 * view);
            for (int k = 0; k < DEEP_SIDE * DEEP_SIDE; k++) {
                const int column = k % DEEP_SIDE, row = k / DEEP_SIDE;
                const double x = (column + 0.5 - 0.5 * DEEP_SIDE) * DEEP_MM;
                const double y = (0.5 * DEEP_SIDE - row - 0.5) * DEEP_MM;
                const struct vec3 v = vec3_unit(vec3(centre.x - x, centre.y - y, centre.z));
                for (int c = 0; c < 3; c++)
                    part->planes[c][k] = deep_seen(x, y, v);
                depth->planes[0][k] = DEEP / v.z;
            }
            exr_file_add(file, part);
        }
        exr_set_double(depth, "view.theta_deg", 45);
        exr_set_double(depth, "view.phi_deg", 120 * view);
        exr_file_add(mdf, depth);
        g_assert_true(exr_write(path, file, EXR_NONE, FALSE, &error));
    }
    g_assert_true(exr_write(mdf_path, mdf, EXR_NONE, FALSE, &error));
    return folder;
}

/* RMS difference between a picture and what is truly seen, over the plane. */
static double deep_error(Reference *reference, Viewer *viewer, const struct viewer_settings *s) {
    enum { WIDTH = 80, HEIGHT = 60 };
    g_autoptr(GError) error = NULL;
    g_autofree float *drawn =
        ok(reference_render_scene_linear(&reference, 1, viewer, s, WIDTH, HEIGHT, NULL, ERR));
    g_autofree float *at =
        viewer_render_geometry(viewer, s, VIEWER_GEOMETRY_TEXEL, WIDTH, HEIGHT, &error);
    g_autofree float *v =
        viewer_render_geometry(viewer, s, VIEWER_GEOMETRY_VIEW, WIDTH, HEIGHT, &error);
    g_autofree float *lit =
        ok(viewer_render_geometry(viewer, s, VIEWER_GEOMETRY_LIT, WIDTH, HEIGHT, ERR));
    double squares = 0;
    int n = 0;
    for (int k = 0; k < 4 * WIDTH * HEIGHT; k += 4) {
        if (at[k + 3] <= 0.5f || at[k + 2] <= 0.5f)
            continue;
        const double truth = deep_seen((at[k] - 0.5) * DEEP_TILE, (0.5 - at[k + 1]) * DEEP_TILE,
                                       vec3(v[k], v[k + 1], v[k + 2]));
        squares += (drawn[k] - lit[k] * truth) * (drawn[k] - lit[k] * truth);
        n++;
    }
    g_assert_cmpint(n, >, 500);
    return sqrt(squares / n);
}

GPU_TEST(along_surface) {
    g_autoptr(GError) error = NULL;
    g_autofree char *folder = write_deep();
    g_autofree char *mdf = g_build_filename(folder, "mdf.exr", NULL);
    g_autoptr(Mesh) mesh = scene_plane();
    g_autoptr(Viewer) viewer = view_fixture_view(COSINE, 3, 8, mesh);
    g_autoptr(Reference) reference = reference_open(folder, &error);
    g_assert_no_error(error);
    struct viewer_settings s = view_fixture_settings();
    s.camera_elevation_deg = 70;
    s.light_theta_deg = 10;
    const double mixed = deep_error(reference, viewer, &s);
    g_assert_false(reference_move_along_surface(reference, folder, &error)); /* no file */
    g_assert_nonnull(error);
    g_clear_error(&error);
    ok(reference_move_along_surface(reference, mdf, ERR));
    const double along = deep_error(reference, viewer, &s);
    g_test_message("off by %g mixed, by %g along the surface", mixed, along);
    g_assert_cmpfloat(along, <, 0.005);
    g_assert_cmpfloat(mixed, >, 10 * along);
    remove_folder(folder);
}
