/* The simulated world against formulas of its own: light, shadow, laser, noise; and what it
 * refuses. */
#include "base/config.h"
#include "geometry/rig.h"
#include "lib/test.h"
#include "lib/world_fixture.h"

#include <png.h>
#include <string.h>

#define RAD(deg) ((deg) * (G_PI / 180))

/* A camera straight above: row y shows x = (y − centre)·(650 − z)/1000, column x shows y. */
#define ABOVE                                                                                      \
    "[camera "                                                                                     \
    "above]\ntheta_deg=0\nwidth=101\nheight=101\nfocal_px=1000\nbits=16\nblack_level=100\n"        \
    "cfa=mono\n"
#define QUIET "[world]\nnoise=no\ngather_rays=0\n"
#define LAMP  "[lamp l]\ntheta_deg=30\n"

static double above_mm(int pixel, double z) {
    return (pixel - 50) * (650 - z) / 1000;
}

static struct world_state lamp_state(int lamp, double arc_deg) {
    struct world_state state = {.arc_deg = arc_deg};
    state.lamp_output[lamp] = 1;
    return state;
}

TEST(white_diffuser) {
    g_autoptr(World) world = world_fixture_new(QUIET ABOVE LAMP "[sample]\nkind=flat\nbase_mm=2\n"
                                                                "albedo=1\ngrid=4\n");
    struct world_state state = lamp_state(0, 90);
    guint16 pixels[101 * 101];
    world_expose(world, 0, &state, 100000, 0, 1, pixels);
    /* The arc at 90 degrees: the lamp stands over +y. */
    double lamp_y = 500 * sin(RAD(30)), lamp_z = 500 * cos(RAD(30));
    for (int y = 20; y <= 80; y += 20) {
        for (int x = 20; x <= 80; x += 20) {
            double px = above_mm(y, 2), py = above_mm(x, 2);
            double dy = lamp_y - py, dz = lamp_z - 2, r = sqrt(px * px + dy * dy + dz * dz);
            double aim = (dy * lamp_y + dz * lamp_z) / (500 * r);
            double radiance = 40 * aim * aim / (r * r * 1e-6) * (dz / r) / G_PI;
            double expected = 100 + 6000 * 0.1 * radiance;
            g_assert_cmpfloat_with_epsilon(pixels[y * 101 + x], expected, 1);
        }
    }
}

TEST(lens_and_filters) {
    g_autoptr(World) world = world_fixture_new(
        QUIET "[camera above]\ntheta_deg=0\nwidth=101\nheight=101\nfocal_px=10000\nbits=16\n"
              "black_level=0\nvignetting=0.4\nfalloff=4\ncolour=1;0.5;0.25\n"
              "[lamp far]\ntheta_deg=0\ndistance_mm=10000\nexponent=0\nintensity=4000\n"
              "[sample]\nkind=flat\nalbedo=0.8;0.4;0.2\ngrid=4\n");
    struct world_state state = lamp_state(0, 0);
    guint16 pixels[101 * 101];
    world_expose(world, 0, &state, 200000, 0, 1, pixels);
    double red = pixels[50 * 101 + 50];
    g_assert_cmpfloat(red, >, 10000);
    g_assert_cmpfloat_with_epsilon(pixels[50 * 101 + 51] / red, 0.25, 1e-3);
    g_assert_cmpfloat_with_epsilon(pixels[51 * 101 + 51] / red, 0.0625, 1e-3);
    double corner = 0.6 * pow(1 + 2 * 50.0 * 50 / 1e8, -2);
    g_assert_cmpfloat_with_epsilon(pixels[0] / red, corner, 1e-3);
}

TEST(black_and_full) {
    g_autoptr(World) world = world_fixture_new(QUIET ABOVE LAMP "[sample]\nkind=flat\ngrid=4\n");
    struct world_state state = {0};
    guint16 pixels[101 * 101];
    world_expose(world, 0, &state, 1000000, 12, 1, pixels);
    for (int i = 0; i < 101 * 101; i++)
        g_assert_cmpint(pixels[i], ==, 100);
    state.lamp_output[0] = 1;
    world_expose(world, 0, &state, 60000000, 0, 1, pixels);
    g_assert_cmpint(pixels[50 * 101 + 50], ==, 65535);
}

/* How far a small square appears from where the rig's own geometry, written apart, says: at most
 * about a sample of 1/6 pixel, since its edges may lie along the samples' rows. */
static void check_place(const World *world, int index, double theta, double phi, double tau,
                        double *sum_dx, double *sum_dy) {
    struct rig_camera camera = {.width = 160, .height = 160, .fx_px = 1664, .fy_px = 1664};
    camera.cx_px = camera.cy_px = 79.5;
    struct vec3 direction = rig_direction(RAD(theta), RAD(phi));
    rig_camera_look_at(&camera, vec3_scale(direction, 650), vec3(0, 0, 0));
    struct world_state state = lamp_state(0, 0);
    state.turntable_deg = tau;
    static guint16 pixels[160 * 160];
    world_expose((World *)world, index, &state, 20000, 0, 1, pixels);
    double sum = 0, sx = 0, sy = 0, x = 0, y = 0;
    for (int i = 0; i < 160 * 160; i++) {
        double value = pixels[i] - 64.0;
        sum += value;
        sx += value * (i % 160);
        sy += value * (i / 160);
    }
    struct vec3 point = rig_turn(vec3(9, 6, 2), RAD(tau));
    g_assert_true(rig_project(&camera, point, &x, &y));
    g_assert_cmpfloat(sum, >, 1000);
    g_assert_cmpfloat_with_epsilon(sx / sum, x, 0.15);
    g_assert_cmpfloat_with_epsilon(sy / sum, y, 0.15);
    *sum_dx += sx / sum - x;
    *sum_dy += sy / sum - y;
}

TEST(same_place_as_rig) {
    g_autofree char *obj =
        world_fixture_write("square.obj", "v 8 5 2\nv 10 5 2\nv 10 7 2\nv 8 7 2\n"
                                          "f 1 2 3 4\n");
    g_autoptr(World) world = world_fixture_new(
        "[world]\nnoise=no\ngather_rays=0\nturntable_albedo=0\nsupersample=6\n"
        "[camera a]\ntheta_deg=15\ncfa=mono\n[camera b]\ntheta_deg=45\nphi_deg=120\ncfa=mono\n"
        "[camera c]\ntheta_deg=75\nphi_deg=-40\ncfa=mono\n" LAMP
        "[sample]\nkind=obj\npath=square.obj\nalbedo=1\n");
    const double theta[] = {15, 45, 75}, phi[] = {0, 120, -40};
    for (int camera = 0; camera < 3; camera++) {
        double dx = 0, dy = 0;
        for (int i = 0; i < 8; i++)
            check_place(world, camera, theta[camera], phi[camera], 45.4 * i, &dx, &dy);
        g_assert_cmpfloat_with_epsilon(dx / 8, 0, 0.03);
        g_assert_cmpfloat_with_epsilon(dy / 8, 0, 0.03);
    }
}

TEST(shadow_of_a_step) {
    g_autoptr(GString) obj = g_string_new(NULL);
    world_fixture_box(obj, 0, -5, 5, -20, 20, 4);
    g_autofree char *path = world_fixture_write("box.obj", obj->str);
    g_autoptr(World) world =
        world_fixture_new("[world]\nnoise=no\ngather_rays=0\nturntable_albedo=0.5\n" ABOVE
                          "[lamp l]\ntheta_deg=60\n[sample]\nkind=obj\npath=box.obj\n");
    struct world_state state = lamp_state(0, 180);
    guint16 pixels[101 * 101];
    world_expose(world, 0, &state, 50000, 0, 1, pixels);
    double lamp_x = -500 * sin(RAD(60)), lamp_z = 500 * cos(RAD(60));
    double end = 5 + 4 * (5 - lamp_x) / (lamp_z - 4);
    for (int y = 0; y < 101; y++) {
        double x = above_mm(y, 0);
        gboolean lit = pixels[y * 101 + 50] > 100;
        if (x > 5.7 && x < end - 0.7)
            g_assert_false(lit);
        if (x < -5.7 || x > end + 0.7)
            g_assert_true(lit);
    }
}

/* Moments of the line along the column that runs through the middle. */
static void line_moments(const guint16 *pixels, double z, double *ret_sum, double *ret_mean,
                         double *ret_sigma) {
    double sum = 0, first = 0, second = 0;
    for (int y = 0; y < 101; y++) {
        double value = pixels[y * 101 + 50] - 100.0, x = above_mm(y, z);
        sum += value;
        first += value * x;
        second += value * x * x;
    }
    *ret_sum = sum;
    *ret_mean = first / sum;
    *ret_sigma = sqrt(second / sum - *ret_mean * *ret_mean);
}

TEST(laser_line) {
    g_autoptr(World) world = world_fixture_new(
        QUIET ABOVE "[laser l]\ntheta_deg=45\nwidth_mm=2\nfan_deg=20\npower_w=0.02\n"
                    "[sample]\nkind=flat\nbase_mm=1.5\nalbedo=0.6\ngrid=4\nwidth_mm=90\n"
                    "height_mm=90\n");
    for (int k = -1; k <= 1; k++) {
        double sweep = RAD(1.2 * k), theta = RAD(45);
        struct world_state state = {.laser_on[0] = TRUE};
        state.sweep_deg[0] = 1.2 * k;
        guint16 pixels[101 * 101];
        world_expose(world, 0, &state, 500000, 0, 1, pixels);
        double sum, mean, sigma;
        line_moments(pixels, 1.5, &sum, &mean, &sigma);
        /* The middle of the sheet leaves the laser at θ + s from the plumb line. */
        double x = 480 * sin(theta) - (480 * cos(theta) - 1.5) * tan(theta + sweep);
        double drop = 480 * cos(theta) - 1.5, r = drop / cos(theta + sweep);
        double spread = 2 / 2.354820 / 480 * r / cos(theta + sweep);
        g_assert_cmpfloat_with_epsilon(mean, x, 0.06);
        g_assert_cmpfloat_with_epsilon(sigma / spread, 1, 0.03);
        /* All that the fan carries a radian falls on the plane: P/(fan·r) a metre of line. A pixel
         * is 650 − z over 1000 millimetres high. */
        double radiance_m = 0.02 / RAD(20) / (r * 1e-3) * 0.6 / G_PI;
        double expected = radiance_m * 6000 * 0.5 / ((650 - 1.5) / 1000 * 1e-3);
        g_assert_cmpfloat_with_epsilon(sum / expected, 1, 0.02);
    }
}

TEST(laser_in_shadow) {
    g_autoptr(GString) obj = g_string_new(NULL);
    world_fixture_box(obj, 0, -5, 5, -20, 20, 4);
    g_autofree char *path = world_fixture_write("box.obj", obj->str);
    g_autoptr(World) world =
        world_fixture_new("[world]\nnoise=no\ngather_rays=0\nturntable_albedo=0.5\n" ABOVE
                          "[laser l]\ntheta_deg=60\n[sample]\nkind=obj\npath=box.obj\n");
    struct world_state state = {.laser_on[0] = TRUE, .arc_deg = 180};
    int seen_beside = 0;
    for (double sweep = -3; sweep < 3; sweep += 0.1) {
        state.sweep_deg[0] = sweep;
        guint16 pixels[101 * 101];
        world_expose(world, 0, &state, 500000, 0, 1, pixels);
        for (int y = 0; y < 101; y++) {
            double x = above_mm(y, 0);
            if (x > 5.7 && x < 10.5)
                g_assert_cmpint(pixels[y * 101 + 50], ==, 100);
            seen_beside += x < -6 && pixels[y * 101 + 50] > 110;
        }
    }
    g_assert_cmpint(seen_beside, >, 20);
}

/* What a sensor sees while the turntable turns past 0, against the mean of many pictures of a
 * standing one. */
TEST(turning) {
    enum { STANDING = 101, PIXELS = 101 * 101 };
    g_autoptr(GString) obj = g_string_new(NULL);
    world_fixture_box(obj, 0, -15, 15, -6, 6, 2);
    g_autofree char *path = world_fixture_write("box.obj", obj->str);
    g_autoptr(World) world = world_fixture_new(
        "[world]\nnoise=no\ngather_rays=0\nturntable_albedo=0\n" ABOVE
        "[lamp l]\ntheta_deg=30\nintensity=2\n[sample]\nkind=obj\npath=box.obj\n");
    guint16 pixels[PIXELS], still[PIXELS];
    g_autofree double *mean = g_new0(double, PIXELS);
    struct world_state state;
    world_set_lamp(world, 0, TRUE, 0);
    world_turn_turntable(world, 358, 8, 10000000);
    world_turn_turntable(world, 0.4, 8, 10300000); /* the same, after a full turn */
    world_snapshot(world, 10000000, 500000, &state);
    g_assert_cmpfloat_with_epsilon(state.turning_deg[WORLD_INSTANTS - 1] - state.turning_deg[0], 4,
                                   1e-9);
    g_assert_cmpfloat_with_epsilon(state.turntable_deg, 360, 1e-9);
    world_expose(world, 0, &state, 500000, 0, 1, pixels);
    for (int i = 0; i < STANDING; i++) {
        world_set_turntable(world, 358 + 4 * (i + 0.5) / STANDING);
        world_snapshot(world, 10000000, 500000, &state);
        world_expose(world, 0, &state, 500000, 0, 1, still);
        for (int p = 0; p < PIXELS; p++)
            mean[p] += (double)still[p] / STANDING;
    }
    world_set_turntable(world, 0);
    world_snapshot(world, 10000000, 500000, &state);
    world_expose(world, 0, &state, 500000, 0, 1, still);
    double off = 0, blurred = 0, most = 0;
    for (int p = 0; p < PIXELS; p++) {
        off += (pixels[p] - mean[p]) * (pixels[p] - mean[p]);
        blurred += (still[p] - mean[p]) * (still[p] - mean[p]);
        most = MAX(most, mean[p]);
    }
    g_test_message("off by %.3g of %.4g DN, from the standing one by %.3g", sqrt(off / PIXELS),
                   most, sqrt(blurred / PIXELS));
    g_assert_cmpfloat(most, >, 1000);
    g_assert_cmpfloat(most, <, 60000);
    g_assert_cmpfloat(off, <, 0.01 * blurred);
}

static float output_at(World *world, double start_s, double exposure_s) {
    struct world_state state;
    world_snapshot(world, (gint64)(start_s * 1e6), (gint64)(exposure_s * 1e6), &state);
    return state.lamp_output[0];
}

TEST(warm_up) {
    g_autoptr(World) world = world_fixture_new("[world]\nwarm_up_s=4\nwarm_up_start=0.5\n" LAMP
                                               "[sample]\nkind=flat\ngrid=2\n");
    g_assert_cmpfloat(world_lamp_warm_up_s(world), ==, 4);
    g_assert_true(output_at(world, 9, 0.1) == 0);
    world_set_lamp(world, 0, TRUE, 10000000);
    g_assert_true(output_at(world, 9, 0.5) == 0);
    g_assert_cmpfloat_with_epsilon(output_at(world, 10, 1e-4), 0.5, 1e-3);
    g_assert_true(output_at(world, 14, 0.1) == 1);
    g_assert_true(output_at(world, 1000, 10) == 1);
    float before = 0;
    for (double t = 10; t < 13.95; t += 0.1) {
        float output = output_at(world, t, 0.01);
        g_assert_true(output > before && output < 1);
        before = output;
    }
    /* Averages over an exposure: of its parts, be they before, in or after warming up. */
    for (double t = 9; t < 15; t += 0.75) {
        double parts = 0;
        for (int i = 0; i < 1000; i++)
            parts += output_at(world, t + i * 1e-3, 1e-3) / 1000;
        g_assert_cmpfloat_with_epsilon(output_at(world, t, 1), parts, 1e-5);
    }
    world_set_lamp(world, 0, FALSE, 20500000);
    g_assert_cmpfloat_with_epsilon(output_at(world, 20, 1), 0.5, 1e-6);
    g_assert_true(output_at(world, 20.5, 1) == 0);
    world_set_lamp(world, 0, TRUE, 30000000);
    world_set_lamp_dead(world, 0, TRUE);
    g_assert_true(output_at(world, 40, 1) == 0);
}

TEST(drift) {
    g_autoptr(World) world = world_fixture_new("[world]\ndrift_pct=2\ndrift_period_s=100\n" LAMP
                                               "[sample]\nkind=flat\ngrid=2\n");
    world_set_lamp(world, 0, TRUE, 0);
    g_assert_cmpfloat_with_epsilon(output_at(world, 125, 0.001), 1.02, 1e-5);
    g_assert_cmpfloat_with_epsilon(output_at(world, 175, 0.001), 0.98, 1e-5);
}

#define SMALL                                                                                      \
    "[camera "                                                                                     \
    "s]\ntheta_deg=0\nwidth=16\nheight=16\nfocal_px=20000\nresponse=100\nfull_well_e=10000\n"

TEST(noise_statistics) {
    g_autoptr(World) world = world_fixture_new("[world]\ngather_rays=0\nsupersample=1\n" SMALL LAMP
                                               "[sample]\nkind=flat\ngrid=2\nalbedo=1\n");
    const double exposures_s[] = {0, 0.05, 0.3};
    for (int k = 0; k < 3; k++) {
        for (double gain_db = 0; gain_db <= 6.1; gain_db += 6.0206) {
            struct world_state state = lamp_state(0, 0);
            double n = 0, sum = 0, squares = 0, beside = 0, gain = pow(10, gain_db / 20);
            for (guint64 key = 0; key < 400; key++) {
                guint16 pixels[256];
                gint64 exposure_us = (gint64)(exposures_s[k] * 1e6);
                world_expose(world, 0, &state, exposure_us, gain_db, key << 16, pixels);
                for (int i = 0; i < 256; i++) {
                    sum += pixels[i];
                    squares += (double)pixels[i] * pixels[i];
                    beside += (double)pixels[i] * pixels[i ^ 1];
                    n++;
                }
            }
            double mean = sum / n, variance = squares / n - mean * mean;
            double e_per_dn = 10000.0 / (4095 - 64);
            double electrons = (mean - 64) / gain * e_per_dn;
            double expected = (MAX(electrons, 0) + 16) * pow(gain / e_per_dn, 2) + 1 / 12.0;
            g_assert_cmpfloat_with_epsilon(variance / expected, 1, 0.03);
            g_assert_cmpfloat_with_epsilon((beside / n - mean * mean) / variance, 0, 0.02);
            double cosine = cos(RAD(30)), e = 40 / 0.25 * cosine;
            double clean = 64 + 100 * exposures_s[k] * gain * e / G_PI;
            g_assert_cmpfloat_with_epsilon(mean, clean, 0.005 * clean);
        }
    }
}

struct job {
    World *world;
    guint16 *pixels; /* of all states in turn */
    gboolean backwards;
};

#define N_STATES 12
#define N_PIXELS (48 * 48)

static gpointer expose_all(gpointer data) {
    const struct job *job = data;
    for (int k = 0; k < N_STATES; k++) {
        int i = job->backwards ? N_STATES - 1 - k : k;
        struct world_state state = {.turntable_deg = 30.0 * (i % 3), .arc_deg = 60.0 * (i / 4)};
        if (i % 4 == 3) {
            state.laser_on[0] = TRUE;
            state.sweep_deg[0] = 0.3 * i;
        } else {
            state.lamp_output[0] = 1;
        }
        world_expose(job->world, i % 2, &state, 20000, 0, (guint64)i, job->pixels + i * N_PIXELS);
    }
    return NULL;
}

static const char woven[] =
    "[camera a]\ntheta_deg=20\nwidth=48\nheight=48\nfocal_px=500\n"
    "[camera b]\ntheta_deg=60\nphi_deg=90\nwidth=48\nheight=48\nfocal_px=500\n" LAMP
    "[laser s]\ntheta_deg=45\n"
    "[sample]\nkind=weave\nwidth_mm=12.5\nheight_mm=12.5\nrelief_mm=3\n";

TEST(same_snapshot_same_picture) {
    g_autofree guint16 *pixels = g_new0(guint16, 4 * N_STATES * N_PIXELS);
    gsize bytes = sizeof(guint16) * N_STATES * N_PIXELS;
    for (int round = 0; round < 2; round++) {
        g_autofree char *text =
            g_strdup_printf("[world]\ncache_mb=%d\ngather_rays=6\n%s", round ? 1 : 64, woven);
        g_autoptr(World) world = world_fixture_new(text);
        struct job jobs[2] = {{world, pixels + (2 * round) * N_STATES * N_PIXELS, FALSE},
                              {world, pixels + (2 * round + 1) * N_STATES * N_PIXELS, TRUE}};
        GThread *thread = g_thread_new("expose", expose_all, &jobs[1]);
        expose_all(&jobs[0]);
        g_thread_join(thread);
    }
    for (int i = 1; i < 4; i++)
        g_assert_cmpmem(pixels, bytes, pixels + i * N_STATES * N_PIXELS, bytes);
    g_assert_true(memcmp(pixels, pixels + N_PIXELS, sizeof(guint16) * N_PIXELS) != 0);
}

/* Walls of a groove at right angles, each 3 mm wide and split into strips along it. */
static char *groove(void) {
    GString *obj = g_string_new(NULL);
    int strips = 30, n = 0;
    for (int side = -1; side <= 1; side += 2) {
        for (int i = 0; i <= strips; i++) {
            for (int j = 0; j <= 60; j++) {
                double along = 3.0 * i / strips * G_SQRT2 / 2;
                g_string_append_printf(obj, "v %.6f %.6f %.6f\n", side * along, j - 30.0,
                                       0.5 + along);
            }
        }
        for (int i = 0; i < strips; i++) {
            for (int j = 0; j < 60; j++) {
                int a = n + i * 61 + j + 1, b = a + 61;
                g_string_append_printf(obj, "f %d %d %d %d\n", a, side > 0 ? b : a + 1, b + 1,
                                       side > 0 ? a + 1 : b);
            }
        }
        n += (strips + 1) * 61;
    }
    return g_string_free(obj, FALSE);
}

static void mean_rows(int gather, double rows[101]) {
    g_autofree char *text = g_strdup_printf(
        "[world]\nnoise=no\nturntable_albedo=0\ngather_rays=%d\n"
        "[camera above]\ntheta_deg=0\nwidth=31\nheight=101\nfocal_px=12000\nbits=16\ncfa=mono\n"
        "response=1000\nblack_level=0\n"
        "[lamp far]\ntheta_deg=0\ndistance_mm=10000\nexponent=0\nintensity=4000\n"
        "[sample]\nkind=obj\npath=groove.obj\nalbedo=0.8\nsmooth=no\n",
        gather);
    g_autoptr(World) world = world_fixture_new(text);
    struct world_state state = lamp_state(0, 0);
    guint16 pixels[31 * 101];
    world_expose(world, 0, &state, 2000000, 0, 1, pixels);
    for (int y = 0; y < 101; y++) {
        rows[y] = 0;
        for (int x = 0; x < 31; x++)
            rows[y] += pixels[y * 31 + x] / 31.0;
    }
}

/* A wall sees the other one, at a right angle, by F = (1 − x/√(x² + L²))/2 where x is the distance
 * from the corner; both are lit alike from far above, so one bounce adds albedo·F. */
TEST(light_in_a_groove) {
    g_autofree char *obj = groove();
    g_autofree char *path = world_fixture_write("groove.obj", obj);
    double direct[101], all[101];
    mean_rows(0, direct);
    mean_rows(48, all);
    for (int y = 24; y <= 76; y++) {
        double x = fabs((y - 50) / 12000.0 * 649) * G_SQRT2;
        if (x < 0.4)
            continue;
        double expected = 0.8 * (1 - x / sqrt(x * x + 9)) / 2;
        g_assert_cmpfloat_with_epsilon(all[y] / direct[y] - 1, expected, 0.035);
    }
}

TEST(deviations) {
    const char *line = "[sample]\nkind=flat\ngrid=8\nalbedo=1\n";
    guint16 pictures[3][101 * 101];
    const char *heads[3] = {"[world]\nnoise=no\nseed=1\ngather_rays=0\n",
                            "[world]\nnoise=no\nseed=2\ngather_rays=0\n",
                            ("[world]\nnoise=no\nseed=2\ngather_rays=0\ncamera_error_mm=0.2\n"
                             "lamp_error_pct=3\n")};
    for (int i = 0; i < 3; i++) {
        g_autofree char *text = g_strconcat(heads[i], ABOVE LAMP, line, NULL);
        g_autoptr(World) world = world_fixture_new(text);
        struct world_state state = lamp_state(0, 0);
        world_expose(world, 0, &state, 100000, 0, 1, pictures[i]);
    }
    g_assert_cmpmem(pictures[0], sizeof pictures[0], pictures[1], sizeof pictures[1]);
    double change = pictures[2][5100] / (double)pictures[1][5100];
    g_assert_cmpfloat(fabs(change - 1), >, 1e-3);
    g_assert_cmpfloat(fabs(change - 1), <, 0.15);
}

TEST(shared_by_path) {
    g_autoptr(World) a = world_fixture_new(QUIET ABOVE LAMP "[sample]\nkind=flat\ngrid=2\n");
    g_autofree char *other = g_build_filename(world_fixture_folder(), ".", "world.conf", NULL);
    g_autoptr(World) b = world_get(other, NULL);
    g_assert_true(a == b);
    g_assert_cmpint(world_find_camera(a, "above"), ==, 0);
    g_assert_cmpint(world_find_camera(a, "below"), ==, -1);
    g_assert_cmpint(world_find_lamp(a, "l"), ==, 0);
    g_assert_cmpint(world_find_laser(a, "l"), ==, -1);
    struct world_sensor sensor;
    world_sensor(a, 0, &sensor);
    g_assert_cmpint(sensor.width, ==, 101);
    g_assert_cmpint(sensor.bits, ==, 16);
    g_assert_cmpint(sensor.cfa, ==, CFA_MONO);
    world_set_turntable(a, 12.5);
    world_set_arc(b, -3);
    struct world_state state;
    world_snapshot(b, 0, 1000, &state);
    g_assert_cmpfloat(state.turntable_deg, ==, 12.5);
    g_assert_cmpfloat(state.arc_deg, ==, -3);
}

TEST(demo_world) {
    g_autoptr(GError) error = NULL;
    g_autoptr(World) world = world_get(SOURCE_DIR "/etc/demo/world.conf", &error);
    g_assert_no_error(error);
    for (int i = 0; i < 5; i++) {
        g_autofree char *camera = g_strdup_printf("cam%d", 15 * (i + 1));
        g_autofree char *lamp = g_strdup_printf("lamp%d", 15 * (i + 1));
        g_autofree char *laser = g_strdup_printf("laser%d", 15 * (i + 1));
        g_assert_cmpint(world_find_camera(world, camera), ==, i);
        g_assert_cmpint(world_find_lamp(world, lamp), ==, i);
        g_assert_cmpint(world_find_laser(world, laser), ==, i);
    }
}

static void refuse(const char *text, const char *words) {
    g_autofree char *path = world_fixture_write("bad.conf", text);
    g_autoptr(GError) error = NULL;
    g_autoptr(World) world = world_get(path, &error);
    g_assert_null(world);
    g_assert_nonnull(error);
    g_test_message("%s", error->message);
    if (!strstr(error->message, words))
        g_error("\"%s\" does not say \"%s\"", error->message, words);
}

TEST(refused) {
#define SAMPLE "[sample]\nkind=flat\ngrid=2\n"
    refuse("[world]\nnoies=no\n" SAMPLE, "noies");
    refuse("[world]\nwarm_up_s=nan\n" SAMPLE, "warm_up_s");
    refuse("[world]\nsupersample=900\n" SAMPLE, "supersample");
    refuse("[planet x]\na=1\n" SAMPLE, "planet");
    refuse("[camera]\ntheta_deg=3\n" SAMPLE, "name");
    refuse("[camera c]\n" SAMPLE, "theta_deg");
    refuse("[camera c]\ntheta_deg=1\noffset_mm=1;2\n" SAMPLE, "offset_mm");
    refuse("[camera c]\ntheta_deg=1\nbits=8\nblack_level=300\n" SAMPLE, "black_level");
    refuse("[lamp l]\ntheta_deg=1\naim_deg=1;inf\n" SAMPLE, "aim_deg");
    refuse(LAMP, "[sample]");
    refuse("[sample]\nkind=marble\n", "kind");
    refuse("[sample]\nkind=flat\nalbedo=0.1;0.2\n", "albedo");
    refuse("[sample]\nkind=flat\nbase_mm=7\ngrid=2\n", "top_mm");
    refuse("[sample]\nkind=weave\nperiod_mm=0.1\n", "period_mm");
    refuse("[sample]\nkind=weave\nrepeats=2\n", "repeats");
    refuse("[sample]\nkind=picture\n", "path");
    refuse("[sample]\nkind=picture\npath=missing.png\n", "missing.png");
    refuse("[sample]\nkind=obj\npath=missing.obj\n", "missing.obj");
    g_autofree char *folder_path = g_build_filename(world_fixture_folder(), "gone.conf", NULL);
    g_autoptr(GError) error = NULL;
    g_assert_null(world_get(folder_path, &error));
    g_assert_nonnull(error);
}

static void refuse_file(const char *kind, const char *content, gsize size, const char *words) {
    g_autofree char *path = g_build_filename(world_fixture_folder(), "bad.file", NULL);
    g_assert_true(g_file_set_contents(path, content, (gssize)size, NULL));
    g_autofree char *text = g_strdup_printf("[sample]\nkind=%s\npath=bad.file\n", kind);
    refuse(text, words);
}

TEST(refused_files) {
    const char *objs[] = {"v 0 0 nan\n",
                          "v 0 0\n",
                          "v 0 0 1\nv 1 0 1\nv 0 1 1\nf 1 2 4\n",
                          "v 0 0 1\nv 1 0 1\nf 1 2\n",
                          "v 0 0 1\nv 1 0 1\nv 0 1 1\nf 1 2 99999999999999999999\n",
                          "v 0 0 1\nf 0 1 1\n",
                          "v 0 0 1\nf 1 1 x\n"};
    for (gsize i = 0; i < G_N_ELEMENTS(objs); i++)
        refuse_file("obj", objs[i], strlen(objs[i]), "bad.file:");
    refuse_file("obj", "", 0, "has no face");
    refuse_file("obj", "v 0 0 9\nv 1 0 9\nv 0 1 9\nf 1 2 3\n", 32, "top_mm");
    refuse_file("picture", "not a picture", 13, "bad.file");
    guint8 grey[64 * 64] = {0};
    for (int i = 0; i < 64 * 64; i++)
        grey[i] = (guint8)(i * 7);
    png_image image = {.version = PNG_IMAGE_VERSION, .width = 64, .height = 64};
    image.format = PNG_FORMAT_GRAY;
    guint8 file[20000];
    png_alloc_size_t size = sizeof file;
    g_assert_true(png_image_write_to_memory(&image, file, &size, 0, grey, 0, NULL));
    refuse_file("picture", (const char *)file, size / 2, "bad.file");
    refuse_file("picture", (const char *)file, 20, "bad.file");
}

AFTER_TESTS {
    world_fixture_clean();
}
