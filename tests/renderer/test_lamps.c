/* Several lamps, and light from all around. */
#include "drawing/methods/microfacet.h"
#include "exr/exr.h"
#include "lib/gpu_fixture.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "scene/environment_made.h"
#include "scene/viewer.h"
#include "shapes/scene.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

#define SIZE 48

static float *draw(Viewer *viewer, const struct viewer_settings *s) {
    float *linear = ok(viewer_render_linear(viewer, s, SIZE, SIZE, ERR));
    return linear;
}

/* A viewer of a mesh, which is freed. */
static Viewer *open_viewer(struct mesh *mesh) {
    g_autoptr(GError) error = NULL;
    Viewer *viewer = viewer_new(NULL, &error);
    g_assert_true(viewer_set_mesh(viewer, mesh, &error));
    g_assert_true(viewer_open(viewer, &methods_microfacet[2], NULL, &error));
    mesh_free(mesh);
    return viewer;
}

/* Light adds up. */
GPU_TEST(sum) {
    static const struct viewer_lamp lamps[2] = {{30, 10, {1, 0.5F, 0.2F}},
                                                {60, 200, {0.1F, 0.4F, 2}}};
    g_autoptr(Viewer) viewer = open_viewer(scene_torus(1, 0.4, 64, 32));
    struct viewer_settings s = viewer_settings_default;
    s.camera_distance = 3;
    g_autofree float *first = draw(viewer, &s);
    s.n_lamps = 2;
    memcpy(s.lamps, lamps, sizeof lamps);
    g_autofree float *all = draw(viewer, &s);
    s.n_lamps = 0;
    s.ambient = 0;
    float *singly[2];
    for (int k = 0; k < 2; k++) {
        s.light_theta_deg = lamps[k].theta_deg;
        s.light_phi_deg = lamps[k].phi_deg;
        singly[k] = draw(viewer, &s);
    }
    int lit = 0;
    for (gsize k = 0; k < 4 * SIZE * SIZE; k++) {
        const gsize c = k % 4;
        if (c == 3 || all[k - c + 3] < 0.5F || fabsf(first[k] - 0.02F) < 1e-3F)
            continue;
        const float sum =
            first[k] + lamps[0].rgb[c] * singly[0][k] + lamps[1].rgb[c] * singly[1][k];
        g_assert_cmpfloat_with_epsilon(all[k], sum, 0.004F * fmaxf(1, sum));
        lit += all[k] > first[k] + 0.05F;
    }
    g_assert_cmpint(lit, >, 500);
    g_free(singly[0]);
    g_free(singly[1]);
}

/* An even sky of radiance 1 lights a white diffuser as much as a lamp from its normal does. */
TEST(even) {
    g_autofree float *rgb = g_new(float, 3 * 64 * 32);
    struct viewer_lamp lamps[VIEWER_MAX_LAMPS];
    for (int k = 0; k < 3 * 64 * 32; k++)
        rgb[k] = 1;
    const int n = environment_lamps(rgb, 64, 32, 64, lamps);
    double up = 0, sideways = 0, all = 0;
    g_assert_cmpint(n, ==, 64);
    for (int k = 0; k < n; k++) {
        const double theta = lamps[k].theta_deg * G_PI / 180, phi = lamps[k].phi_deg * G_PI / 180;
        all += (double)lamps[k].rgb[1];
        up += (double)lamps[k].rgb[0] * fmax(cos(theta), 0);
        sideways += (double)lamps[k].rgb[2] * fmax(sin(theta) * cos(phi), 0);
    }
    g_assert_cmpfloat_with_epsilon(all, 4, 1e-3);
    g_assert_cmpfloat_with_epsilon(up, 1, 0.03);
    g_assert_cmpfloat_with_epsilon(sideways, 1, 0.03);
}

/* One bright pixel is one lamp, just where it is; left of the middle is +y. */
TEST(point) {
    g_autofree float *rgb = g_new0(float, 3 * 16 * 8);
    struct viewer_lamp lamps[VIEWER_MAX_LAMPS];
    g_assert_cmpint(environment_lamps(rgb, 16, 8, 9, lamps), ==, 0);
    rgb[3 * (2 * 16 + 4) + 1] = 100;
    g_assert_cmpint(environment_lamps(rgb, 16, 8, 9, lamps), ==, 1);
    g_assert_cmpfloat_with_epsilon(lamps[0].theta_deg, 180.0 * 2.5 / 8, 1e-6);
    g_assert_cmpfloat_with_epsilon(lamps[0].phi_deg, 180 - 360.0 * 4.5 / 16, 1e-6);
    const double solid = G_PI / 8 * (cos(G_PI / 4) - cos(3 * G_PI / 8));
    g_assert_cmpfloat_with_epsilon((double)lamps[0].rgb[1], 100 * solid / G_PI, 1e-4);
    g_assert_cmpfloat((double)lamps[0].rgb[0], ==, 0);
}

/* Light of a picture of directions, in closed form where sky and boxes have one: ∫ L dω / π, and
 * what a white diffuser that faces the zenith gets of it. */
static void sum_light(const struct environment *e, double *ret_all, double *ret_up) {
    *ret_all = *ret_up = 0.0;
    for (int y = 0; y < e->height; y++)
        for (int x = 0; x < e->width; x++) {
            const double from = G_PI * y / e->height, to = G_PI * (y + 1) / e->height;
            const double solid = 2 * G_PI / e->width * (cos(from) - cos(to)) / G_PI;
            const double green = (double)e->rgb[3 * (y * e->width + x) + 1];
            *ret_all += green * solid;
            *ret_up += green * solid * fmax(cos((from + to) / 2), 0);
        }
}

TEST(overcast) {
    struct environment *sky = environment_open("overcast", NULL);
    double all, up;
    sum_light(sky, &all, &up);
    g_assert_cmpfloat_with_epsilon(up, 1.0, 1e-3);
    /* 2 π L_z / 3 (1 + 1) above, 2 π 0.2 below */
    g_assert_cmpfloat_with_epsilon(all, 2 * 9.0 / 7 * 2 / 3 + 2 * 0.2, 1e-3);
    environment_free(sky);
}

TEST(studio) {
    struct environment *room = environment_open("studio", NULL);
    double all, up, expected = 4 * ENVIRONMENT_ROOM;
    for (int k = 0; k < ENVIRONMENT_BOXES; k++) {
        const struct environment_box *box = &environment_studio[k];
        const double a = box->half_width, b = box->half_height;
        const double solid = 4 * atan(a * b / sqrt(1 + a * a + b * b));
        const double lit = box->radiance * (double)box->rgb[1];
        /* ∫ cos dω of a rectangle on its axis: the room behind it has 1 + cos θ. */
        const double r = sqrt(1 + a * a), q = sqrt(1 + b * b);
        const double projected = 2 * (a / r * atan(b / r) + b / q * atan(a / q));
        const double up_share = cos(box->theta_deg * G_PI / 180);
        expected += (lit * solid - ENVIRONMENT_ROOM * (solid + up_share * projected)) / G_PI;
        /* The pixel at its centre. */
        const int y = (int)(box->theta_deg / 180 * room->height);
        const int x =
            (int)((180 - box->phi_deg + (box->phi_deg > 180 ? 360 : 0)) / 360 * room->width);
        g_assert_cmpfloat_with_epsilon((double)room->rgb[3 * (y * room->width + x) + 1], lit, 1e-5);
    }
    sum_light(room, &all, &up);
    g_assert_cmpfloat_with_epsilon(all, expected, 2e-3);
    g_assert_cmpfloat(up, >, 0.5); /* as bright as the default lamp, about */
    g_assert_cmpfloat(up, <, 1.5);
    environment_free(room);
}

/* Turned lamps are where they were, turned; and no more than are asked for. */
TEST(turned) {
    struct environment *room = environment_open("studio", NULL);
    struct viewer_settings s = viewer_settings_default, turned = s;
    s.environment_lamps = turned.environment_lamps = 9;
    turned.environment_turn_deg = 30.0;
    g_assert_true(environment_light(room, &s, NULL) && environment_light(room, &turned, NULL));
    g_assert_cmpint(s.n_lamps, ==, 9);
    for (int k = 0; k < 9; k++)
        g_assert_cmpfloat_with_epsilon(turned.lamps[k].phi_deg, s.lamps[k].phi_deg + 30, 1e-9);
    environment_free(room);
}

static void check_file(const char *path, int width, int height, float value, const char *said) {
    static const char *const channels[] = {"B", "G", "R", NULL};
    g_autoptr(GError) error = NULL;
    struct exr_file *file = exr_file_new();
    struct exr_part *part = exr_part_new("sky", width, height, channels, EXR_FLOAT);
    struct viewer_settings s = viewer_settings_default;
    for (int c = 0; c < 3; c++)
        part->planes[c][0] = value;
    exr_file_add(file, part);
    g_assert_true(exr_write(path, file, EXR_NONE, FALSE, &error));
    exr_file_free(file);
    struct environment *environment = environment_read(path, &error);
    const gboolean good = environment != NULL && environment_light(environment, &s, &error);
    environment_free(environment);
    g_assert_cmpint(good, ==, said == NULL);
    g_assert_true(said == NULL || strstr(error->message, said) != NULL);
    g_assert_cmpint(s.n_lamps, ==, good ? 1 : 0);
}

TEST(files) {
    g_autofree char *dir = g_dir_make_tmp("mesorig-XXXXXX", NULL);
    g_autofree char *path = g_build_filename(dir, "sky.exr", NULL);
    check_file(path, 8, 4, 3, NULL);
    check_file(path, 8, 5, 3, "it has 8 × 5 pixels");
    check_file(path, 8, 4, 0, "black");
    check_file(path, 8, 4, NAN, "is nan, not within 0 … 1e30");
    check_file(path, 8, 4, -1, "is -1, not within 0 … 1e30");
    g_assert_true(g_unlink(path) == 0 && g_rmdir(dir) == 0);
    g_autoptr(GError) error = NULL;
    g_assert_null(environment_read(path, &error));
    g_assert_nonnull(strstr(error->message, path));
}

/* With all lamps given, an environment has no place. */
TEST(full) {
    g_autoptr(GError) error = NULL;
    float rgb[6] = {1, 1, 1, 1, 1, 1};
    const struct environment even = {2, 1, rgb};
    struct viewer_settings s = viewer_settings_default;
    s.n_lamps = VIEWER_MAX_LAMPS;
    g_assert_false(environment_light(&even, &s, &error));
    g_assert_nonnull(strstr(error->message, "give fewer"));
    g_assert_cmpint(s.n_lamps, ==, VIEWER_MAX_LAMPS);
}

/* A small shape on which nothing falls, before a picture of directions. */
static Viewer *before(const struct environment *environment, struct viewer_settings *ret) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Viewer) viewer = open_viewer(scene_torus(1, 0.1, 12, 6));
    g_assert_true(viewer_set_environment(viewer, environment, &error));
    *ret = viewer_settings_default;
    ret->backdrop = TRUE;
    ret->camera_distance = 30;
    ret->camera_pan[0] = ret->camera_pan[1] = 4; /* out of the middle */
    ret->camera_fov_deg = 60;
    ret->exposure_ev = 0;
    return g_steal_pointer(&viewer);
}

/* Where the ray through a pixel's middle goes: written anew, as view.h describes the camera. */
static void direction_of(const struct viewer_settings *s, int i, int j, double ret[3]) {
    const double a = s->camera_azimuth_deg * G_PI / 180, e = s->camera_elevation_deg * G_PI / 180;
    const double half = tan(s->camera_fov_deg * G_PI / 360) / SIZE;
    const double x = (2 * i + 1 - SIZE) * half, y = (SIZE - 2 * j - 1) * half;
    const double back[3] = {cos(e) * cos(a), cos(e) * sin(a), sin(e)};
    const double right[3] = {-sin(a), cos(a), 0};
    const double up[3] = {-sin(e) * cos(a), -sin(e) * sin(a), cos(e)};
    const double length = sqrt(1 + x * x + y * y);
    for (int k = 0; k < 3; k++)
        ret[k] = (x * right[k] + y * up[k] - back[k]) / length;
}

#define SKY 256 /* pixels wide */

/* Each axis has its colour: red grows along x, green along y, blue along z. */
static float *axes_sky(void) {
    float *rgb = g_new(float, 3 * SKY * SKY / 2);
    for (int k = 0; k < SKY * SKY / 2; k++) {
        const int row = k / SKY, column = k % SKY;
        const double theta = 2 * G_PI * (row + 0.5) / SKY;
        const double phi = G_PI - 2 * G_PI * (column + 0.5) / SKY;
        const double d[3] = {sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta)};
        for (int c = 0; c < 3; c++)
            rgb[3 * k + c] = (float)(0.5 + 0.4 * d[c]);
    }
    return rgb;
}

/* Looked at from all sides, straight up and down, it is seen where it is. */
GPU_TEST(backdrop) {
    static const double cameras[][2] = {{-90, 20},  {-20, -35}, {60, 5},  {180, 0},
                                        {135, -70}, {10, 90},   {10, -90}};
    g_autofree float *rgb = axes_sky();
    const struct environment sky = {SKY, SKY / 2, rgb};
    struct viewer_settings s;
    g_autoptr(Viewer) viewer = before(&sky, &s);
    for (gsize k = 0; k < G_N_ELEMENTS(cameras); k++) {
        s.camera_azimuth_deg = cameras[k][0];
        s.camera_elevation_deg = cameras[k][1];
        s.exposure_ev = k % 2 == 0 ? 0 : 1;
        g_autofree float *seen = draw(viewer, &s);
        int n = 0;
        for (int i = 0; i < SIZE * SIZE; i++) {
            double d[3];
            if (seen[4 * i + 3] > 0.5F)
                continue;
            n++;
            direction_of(&s, i % SIZE, i / SIZE, d);
            for (int c = 0; c < 3; c++)
                g_assert_cmpfloat_with_epsilon((double)seen[4 * i + c],
                                               (0.5 + 0.4 * d[c]) * viewer_settings_exposure(&s),
                                               0.006);
        }
        g_assert_cmpint(n, >, SIZE * SIZE * 9 / 10);
    }
}

/* Looking at the lamp that one bright pixel is, the middle of the picture is bright, and no other:
 * light comes from where its source is seen. */
GPU_TEST(source) {
    g_autofree float *rgb = g_new0(float, 3 * SKY * SKY / 2);
    rgb[3 * (75 * SKY + 77)] = 1e30F; /* beyond what a half float holds */
    const struct environment sky = {SKY, SKY / 2, rgb};
    struct viewer_lamp lamp[VIEWER_MAX_LAMPS];
    g_assert_cmpint(environment_lamps(rgb, SKY, SKY / 2, 4, lamp), ==, 1);
    struct viewer_settings s;
    g_autoptr(Viewer) viewer = before(&sky, &s);
    s.camera_elevation_deg = lamp[0].theta_deg - 90;
    for (int turn_deg = 0; turn_deg <= 50; turn_deg += 50) {
        s.environment_turn_deg = turn_deg;
        s.camera_azimuth_deg = lamp[0].phi_deg + turn_deg + 180;
        g_autofree float *seen = draw(viewer, &s);
        for (int i = 0; i < SIZE * SIZE; i++) {
            const int x = i % SIZE - SIZE / 2, y = i / SIZE - SIZE / 2;
            g_assert_true(isfinite(seen[4 * i]));
            if (x >= -1 && x <= 0 && y >= -1 && y <= 0)
                g_assert_cmpfloat((double)seen[4 * i], >, 1e3);
            else if (x * x + y * y > 16 && seen[4 * i + 3] < 0.5F)
                g_assert_cmpfloat((double)seen[4 * i], ==, 0);
        }
    }
}

GPU_TEST(refused) {
    g_autoptr(GError) none = NULL, large = NULL;
    g_autoptr(Viewer) viewer = open_viewer(scene_plane());
    struct viewer_settings s = viewer_settings_default;
    s.backdrop = TRUE;
    g_assert_null(viewer_render_linear(viewer, &s, 8, 8, &none));
    g_assert_nonnull(strstr(none->message, "--environment"));
    const struct environment vast = {1 << 22, 1 << 21, NULL};
    g_assert_false(viewer_set_environment(viewer, &vast, &large));
    g_assert_error(large, GPU_ERROR, GPU_ERROR_TOO_LARGE);
    g_assert_nonnull(strstr(large->message, "make it smaller"));
}
