/* Frames made here by formula, so that what the intake makes of them is known. */
#include <glib/gstdio.h>
#include <math.h>

#include "capture/intake/intake.h"
#include "capture/intake/radiance.h"
#include "capture/thumbnail.h"
#include "exr/exr.h"
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/test.h"

#define SIDE   8
#define PIXELS (SIDE * SIDE)
#define BLACK  64

static Frame *flat_frame(double dn, gint64 exposure_us) {
    Frame *frame = frame_new(SIDE, SIDE);
    frame->bits = 12;
    frame->cfa = CFA_RGGB;
    frame->black_level = BLACK;
    frame->exposure_us = exposure_us;
    for (int i = 0; i < PIXELS; i++)
        frame->pixels[i] = (guint16)CLAMP(lround(dn), 0, 4095);
    return frame;
}

/* DN a millisecond that pixel i is made to shine with: 0 … 8000, three decades and more. */
static double truth(int i) {
    return 8000 * pow((double)i / (PIXELS - 1), 4);
}

static double dark_truth(int i) {
    return BLACK + i % 5;
}

static Frame *shot_frame(gint64 exposure_us) {
    Frame *frame = flat_frame(0, exposure_us);
    for (int i = 0; i < PIXELS; i++) {
        double dn = dark_truth(i) + truth(i) * exposure_us * 1e-3;
        frame->pixels[i] = (guint16)MIN(lround(dn), 4095);
    }
    return frame;
}

static Frame *dark_frame(gint64 exposure_us) {
    Frame *frame = flat_frame(0, exposure_us);
    for (int i = 0; i < PIXELS; i++)
        frame->pixels[i] = (guint16)dark_truth(i);
    return frame;
}

static void check_merged(const float *merged, double shortest_ms, double gain) {
    for (int i = 0; i < PIXELS; i++) {
        double limit = (4095 - dark_truth(i)) / shortest_ms;
        double expected = MIN(truth(i), limit) / gain;
        /* Half a DN of the shortest exposure is what rounding costs where only that one is left. */
        g_assert_cmpfloat_with_epsilon(merged[i], expected, 0.5 / shortest_ms / gain + 1e-3);
    }
}

TEST(merge) {
    const gint64 us[] = {500, 2000, 8000};
    float dark[PIXELS], merged[PIXELS];
    for (int i = 0; i < PIXELS; i++)
        dark[i] = (float)dark_truth(i);
    const Frame *frames[3];
    const float *darks[3] = {dark, dark, dark};
    for (int k = 0; k < 3; k++)
        frames[k] = shot_frame(us[k]);
    struct radiance_stats stats;
    radiance_merge(frames, darks, 3, 0, 0, merged, &stats);
    check_merged(merged, 0.5, 1);
    gint64 saturated = 0;
    for (int i = 0; i < PIXELS; i++)
        saturated += dark_truth(i) + truth(i) * 0.5 >= 0.98 * 4095;
    g_assert_cmpint(saturated, >, 0);
    g_assert_cmpint(stats.saturated, ==, saturated);
    radiance_merge(frames, darks, 3, 20, 0, merged, &stats);
    check_merged(merged, 0.5, 10);
    radiance_merge(&frames[1], darks, 1, 0, 0, merged, &stats);
    check_merged(merged, 2, 1);
    for (int k = 0; k < 3; k++)
        frame_unref((Frame *)frames[k]);
}

/* A dim pixel's error falls as the longest exposure says, a bright one's as the shortest. */
TEST(merge_precision) {
    float dark[PIXELS] = {0}, merged[PIXELS];
    g_autoptr(Frame) brief = flat_frame(0.3 * 1, 1000);
    g_autoptr(Frame) lengthy = flat_frame(0.3 * 100, 100000);
    const Frame *frames[] = {brief, lengthy};
    const float *darks[] = {dark, dark};
    struct radiance_stats stats;
    radiance_merge(frames, darks, 2, 0, 0, merged, &stats);
    g_assert_cmpfloat_with_epsilon(merged[0], 0.3, 0.3 / 100 + 1e-6);
    g_assert_cmpint(stats.saturated, ==, 0);
    g_assert_cmpfloat_with_epsilon(stats.signal_dn, 30, 1e-9);
}

/* A standard normal number (Box and Muller 1958). */
static double any_normal(GRand *rand) {
    const double u = 1 - g_rand_double(rand), v = g_rand_double(rand);
    return sqrt(-2 * log(u)) * cos(2 * G_PI * v);
}

/* Photon noise of a converter with 0.2 DN an electron, around the level at which the longest or the
 * middle one of three exposures saturates: the mean of many merged pixels is the truth within four
 * standard errors of it, and of what rounding a number of DN adds. */
TEST(merge_bias) {
    enum { ROUNDS = 1500 };
    const gint64 us[] = {1000, 4000, 16000};
    const double gain = 0.2, limit = 0.98 * 4095;
    g_autoptr(GRand) rand = g_rand_new_with_seed(3);
    float dark[PIXELS] = {0}, merged[PIXELS];
    const float *darks[] = {dark, dark, dark};
    for (int saturating = 1; saturating < 3; saturating++)
        for (int step = -4; step <= 4; step++) {
            const double per_ms = (1 + 0.005 * step) * limit / ((double)us[saturating] * 1e-3);
            double sum = 0, squares = 0;
            for (int round = 0; round < ROUNDS; round++) {
                Frame *frames[3];
                struct radiance_stats stats;
                for (int k = 0; k < 3; k++) {
                    const double dn = per_ms * (double)us[k] * 1e-3;
                    frames[k] = flat_frame(0, us[k]);
                    for (int i = 0; i < PIXELS; i++)
                        frames[k]->pixels[i] = (guint16)CLAMP(
                            lround(dn + sqrt(gain * dn) * any_normal(rand)), 0, 4095);
                }
                radiance_merge((const Frame *const *)(gpointer)frames, darks, 3, 0, 0, merged,
                               &stats);
                for (int i = 0; i < PIXELS; i++) {
                    sum += (double)merged[i] / per_ms - 1;
                    squares += pow((double)merged[i] / per_ms - 1, 2);
                }
                for (int k = 0; k < 3; k++)
                    frame_unref(frames[k]);
            }
            const double n = (double)ROUNDS * PIXELS, bias = sum / n;
            const double error = sqrt((squares / n - bias * bias) / n);
            g_test_message("exposure %d at %.3f of saturation: bias %+.4f %% ± %.4f", saturating,
                           1 + 0.005 * step, 100 * bias, 100 * error);
            g_assert_cmpfloat(fabs(bias), <, 4 * error);
        }
}

/* What a sensor that bends by a tenth at full scale shows, bent back, is what there was. */
TEST(bend) {
    const double bends[] = {0.1 / 4095, -0.1 / 4095};
    float dark[PIXELS] = {0}, merged[PIXELS];
    const float *darks[] = {dark};
    for (gsize b = 0; b < G_N_ELEMENTS(bends); b++) {
        for (double linear = 1; linear < 3600; linear *= 1.7) {
            g_autoptr(Frame) frame = flat_frame(linear * (1 - bends[b] * linear), 1000);
            const Frame *frames[] = {frame};
            struct radiance_stats stats;
            radiance_merge(frames, darks, 1, 0, bends[b], merged, &stats);
            g_assert_cmpfloat_with_epsilon(merged[0], linear, 0.75); /* rounding, steeper */
        }
    }
}

TEST(saturation) {
    g_assert_cmpint(radiance_saturation(12), ==, 4014); /* 0.98 · 4095 = 4013.1 */
    g_assert_cmpint(radiance_saturation(8), ==, 250);
    g_assert_cmpint(radiance_saturation(16), ==, 64225);
}

TEST(mean) {
    guint32 sums[PIXELS] = {0};
    float mean[PIXELS];
    for (int k = 0; k < 3; k++) {
        g_autoptr(Frame) frame = flat_frame(BLACK + k * k, 1000); /* 64, 65, 68 */
        radiance_add(frame, sums);
    }
    g_assert_cmpfloat_with_epsilon(radiance_mean(sums, 3, PIXELS, mean), 65 + 2 / 3., 1e-5);
    g_assert_cmpfloat_with_epsilon(mean[7], 65 + 2 / 3., 1e-5);
}

TEST(thumbnail) {
    g_autoptr(Frame) frame = frame_new(640, 320);
    frame->cfa = CFA_RGGB;
    frame->bits = 12;
    frame->black_level = BLACK;
    for (int i = 0; i < 640 * 320; i++)
        frame->pixels[i] = cfa_colour_at(CFA_RGGB, i % 640, i / 640) == CFA_RED ? 3000 : BLACK;
    int width, height;
    g_autofree guint8 *rgb = NULL;
    thumbnail_make(frame, &width, &height, &rgb);
    g_assert_cmpint(width, ==, 320);
    g_assert_cmpint(height, ==, 160);
    const guint8 *last = rgb + ((gsize)width * height - 1) * 3;
    g_assert_cmpint(last[0], ==, 255);
    g_assert_cmpint(last[1], ==, 0);
    g_assert_cmpint(last[2], ==, 0);
    g_autoptr(Frame) tiny = frame_new(1, 1);
    g_autofree guint8 *one = NULL;
    tiny->cfa = CFA_MONO;
    tiny->pixels[0] = 0;
    thumbnail_make(tiny, &width, &height, &one);
    g_assert_cmpint(width * height, ==, 1);
    g_assert_cmpint(one[0], ==, 0);
}

struct bench {
    struct devices devices;
    struct Camera camera;
    struct session_conf conf;
    char *directory;
    gsize full_bytes;
    Intake *intake;
    int results, rooms;
    gint64 shots[64]; /* of results, in their order */
    char *path, *sha256;
    gint64 saturated;
    double signal_dn;
    double captured_s;
    gboolean uneven, laser_seen, failed;
};

static struct session_shot dark_shot = {
    .id = 1, .kind = SHOT_DARK, .source = -1, .device = -1, .cameras = {{1}}};
static struct session_shot lamp_shot = {
    .id = 2, .kind = SHOT_LAMP, .turntable_deg = 30, .arc_deg = 45.5, .cameras = {{1}}};
static struct session_shot sweep_shot = {.id = 3,
                                         .kind = SHOT_SWEEP,
                                         .cameras = {{1}},
                                         .sweep_from_deg = -3,
                                         .sweep_to_deg = 4,
                                         .sweep_steps = 20};

static void on_result(const struct intake_result *result, gpointer data) {
    struct bench *bench = data;
    bench->shots[bench->results++ % (int)G_N_ELEMENTS(bench->shots)] = result->shot->id;
    g_free(bench->path);
    g_free(bench->sha256);
    bench->path =
        result->frame.path ? g_build_filename(bench->directory, result->frame.path, NULL) : NULL;
    bench->sha256 = g_strdup(result->frame.sha256);
    bench->captured_s = result->frame.captured_s;
    bench->saturated = result->saturated;
    bench->signal_dn = result->signal_dn;
    bench->uneven = result->uneven;
    bench->laser_seen = result->laser_seen;
    bench->failed = result->error != NULL;
}

static void on_room(gpointer data) {
    ((struct bench *)data)->rooms++;
}

static void start_intake(struct bench *bench) {
    struct intake_setup setup = {&bench->devices, &bench->conf, bench->directory,
                                 bench->full_bytes};
    struct intake_hooks hooks = {on_result, on_room, bench};
    bench->intake = intake_new(&setup, &hooks);
}

static void set_up(struct bench *bench, gconstpointer data) {
    bench->devices.clock = clock_new_virtual();
    bench->devices.geometry.n_cameras = 1;
    bench->devices.geometry.n_lamps = 1;
    bench->devices.geometry.n_lasers = 1;
    g_strlcpy(bench->devices.geometry.cameras[0].name, "eye", RIG_NAME);
    g_strlcpy(bench->devices.geometry.lamps[0].name, "sun", RIG_NAME);
    g_strlcpy(bench->devices.geometry.lasers[0].name, "ray", RIG_NAME);
    bench->camera.format = (struct camera_format){.width = SIDE, .height = SIDE, .bits = 12};
    bench->devices.cameras[0] = &bench->camera;
    bench->conf.n_exposures = 2;
    bench->conf.exposures_us[0] = 1000;
    bench->conf.exposures_us[1] = 4000;
    bench->conf.laser_exposure_us = 4000;
    bench->conf.dark_frames = 2;
    bench->conf.laser_threshold_dn = 40;
    bench->directory = g_dir_make_tmp("mesorig-intake-XXXXXX", NULL);
    for (const char *const *name = (const char *const[]){"frames", "laser", NULL}; *name; name++) {
        g_autofree char *folder = g_build_filename(bench->directory, *name, NULL);
        g_mkdir(folder, 0777);
    }
    start_intake(bench);
}

static void tear_down(struct bench *bench, gconstpointer data) {
    intake_free(bench->intake);
    clock_unref(bench->devices.clock);
    remove_tree(bench->directory);
    g_free(bench->directory);
    g_free(bench->path);
    g_free(bench->sha256);
}

static void give(struct bench *bench, const struct session_shot *shot, int sub, Frame *frame) {
    const struct taken_frame taken = {.shot = shot,
                                      .sub = sub,
                                      .frame = frame,
                                      .row = {.shot = shot->id, .captured_s = sub * 0.5}};
    intake_take(bench->intake, &taken);
    frame_unref(frame);
}

static void wait_for(struct bench *bench, int results) {
    while (bench->results < results)
        g_main_context_iteration(NULL, TRUE);
    g_assert_cmpint(bench->results, ==, results);
    g_assert_false(bench->failed);
}

static void give_dark(struct bench *bench) {
    g_assert_cmpint(shot_n_frames(&bench->conf, &dark_shot), ==, 4); /* 1 and 4 ms, twice */
    for (int i = 0; i < 4; i++)
        give(bench, &dark_shot, i, dark_frame(shot_exposure_us(&bench->conf, &dark_shot, i)));
}

static void give_lamp(struct bench *bench) {
    g_assert_cmpint(shot_n_frames(&bench->conf, &lamp_shot), ==, 2);
    for (int i = 0; i < 2; i++)
        give(bench, &lamp_shot, i, shot_frame(shot_exposure_us(&bench->conf, &lamp_shot, i)));
}

static struct exr_part *read_part(struct bench *bench, const char *name) {
    struct exr_part *part = ok(exr_read_part(bench->path, name, ERR));
    g_assert_cmpint(part->width, ==, SIDE);
    g_assert_cmpint(part->height, ==, SIDE);
    return part;
}

static void check_double(const struct exr_part *part, const char *name, double expected) {
    double value = NAN;
    g_assert_true(exr_get_double(part, name, &value, NULL));
    g_assert_cmpfloat_with_epsilon(value, expected, 1e-9);
}

static void check_string(const struct exr_part *part, const char *name, const char *expected) {
    const char *value = NULL;
    g_assert_true(exr_get_string(part, name, &value, NULL));
    g_assert_cmpstr(value, ==, expected);
}

static void check_sha256(struct bench *bench) {
    g_autofree char *bytes = NULL;
    gsize length;
    g_assert_true(g_file_get_contents(bench->path, &bytes, &length, NULL));
    g_autofree char *sum = g_compute_checksum_for_data(G_CHECKSUM_SHA256, (guchar *)bytes, length);
    g_assert_cmpstr(sum, ==, bench->sha256);
}

static void check_lamp_file(struct bench *bench) {
    struct exr_part *part = read_part(bench, "radiance");
    const float *plane = exr_part_plane(part, "Y");
    g_assert_cmpint(part->type, ==, EXR_HALF);
    for (int i = 0; i < PIXELS; i++) {
        double expected = MIN(truth(i), (4095 - dark_truth(i)) / 1.0);
        g_assert_cmpfloat_with_epsilon(plane[i], expected, 0.5 + expected / 2048);
    }
    check_string(part, "mesorig.camera", "eye");
    check_string(part, "mesorig.lamp", "sun");
    check_string(part, "mesorig.cfa", "rggb");
    check_string(part, "mesorig.unit", "DN/ms");
    check_string(part, "mesorig.exposures_us", "1000;4000");
    check_double(part, "mesorig.turntable_deg", 30);
    check_double(part, "mesorig.arc_deg", 45.5);
    g_assert_cmpfloat(bench->captured_s, ==, 0.5);
    double mean = 0;
    for (int i = 0; i < PIXELS; i++)
        mean += dark_truth(i) / PIXELS;
    check_double(part, "mesorig.dark_dn", mean);
    int saturated, shot;
    g_assert_true(exr_get_int(part, "mesorig.saturated", &saturated, NULL));
    g_assert_true(exr_get_int(part, "mesorig.shot", &shot, NULL));
    g_assert_cmpint(saturated, ==, bench->saturated);
    g_assert_cmpint(saturated, >, 0);
    g_assert_cmpint(shot, ==, 2);
    double shorter_from = 0;
    g_assert_true(exr_get_double(part, "mesorig.shorter_from", &shorter_from, NULL));
    g_assert_cmpfloat_with_epsilon(shorter_from, (4014 - mean) / 4, 1e-3);
    const float *mark = exr_part_plane(part, "saturated");
    g_assert_nonnull(mark);
    for (int i = 0; i < PIXELS; i++)
        g_assert_cmpfloat(mark[i], ==, lround(dark_truth(i) + truth(i)) >= 4014 ? 1 : 0);
    exr_part_free(part);
}

static void test_lamp(struct bench *bench, gconstpointer data) {
    give_dark(bench);
    wait_for(bench, 1);
    struct exr_part *part = read_part(bench, "dark_4000_us");
    for (int i = 0; i < PIXELS; i++)
        g_assert_cmpfloat(exr_part_plane(part, "Y")[i], ==, dark_truth(i));
    exr_part_free(part);
    give_lamp(bench);
    wait_for(bench, 2);
    check_lamp_file(bench);
    check_sha256(bench);
}

/* A lamp that dies between two exposures, or lights only the longer one; noise and a dark level
 * that has drifted are no such thing, even where there is no light at all. */
static void test_uneven(struct bench *bench, gconstpointer data) {
    const struct {
        double shorter_dn, longer_dn; /* above dark */
        gboolean uneven;
    } cases[] = {{300, 0, TRUE},     {300, 1200, FALSE}, {0, 1200, TRUE}, {3, 3, FALSE},
                 {250, 1200, FALSE}, {0, 30, FALSE},     {5, -3, FALSE},  {900, 4000, FALSE}};
    give_dark(bench);
    wait_for(bench, 1);
    for (int i = 0; i < (int)G_N_ELEMENTS(cases); i++) {
        const double above[] = {cases[i].shorter_dn, cases[i].longer_dn};
        for (int sub = 0; sub < 2; sub++) {
            Frame *frame = dark_frame(shot_exposure_us(&bench->conf, &lamp_shot, sub));
            for (int p = 0; p < PIXELS; p++)
                frame->pixels[p] = (guint16)CLAMP(frame->pixels[p] + above[sub], 0, 4095);
            give(bench, &lamp_shot, sub, frame);
        }
        wait_for(bench, i + 2);
        g_assert_cmpint(bench->uneven, ==, cases[i].uneven);
        g_assert_true(bench->uneven == !bench->path);
    }
}

/* With the dark level read back the next shot's file has the same bytes. */
static void test_dark_again(struct bench *bench, gconstpointer data) {
    give_dark(bench);
    give_lamp(bench);
    wait_for(bench, 2);
    g_autofree char *sha256 = g_strdup(bench->sha256);
    intake_free(bench->intake);
    start_intake(bench);
    g_autoptr(GError) error = NULL;
    g_assert_true(intake_load_dark(bench->intake, &dark_shot, 0, &error));
    give_lamp(bench);
    wait_for(bench, 3);
    g_assert_cmpstr(bench->sha256, ==, sha256);
    struct session_shot other = dark_shot;
    other.id = 99;
    g_assert_false(intake_load_dark(bench->intake, &other, 0, &error));
    g_assert_nonnull(error);
    g_clear_error(&error);
    bench->camera.format.width = SIDE + 1;
    g_assert_false(intake_load_dark(bench->intake, &dark_shot, 0, &error));
    g_assert_error(error, EXR_ERROR, EXR_ERROR_MISSING);
}

/* Time at which the laser crosses pixel i, in frames; the pulse is a Gaussian of σ = 1.5 frames. */
static double crossing(int i) {
    return 3 + 13.0 * i / (PIXELS - 1);
}

static void give_sweep(struct bench *bench, double guard_dn) {
    int steps = sweep_shot.sweep_steps;
    for (int k = 0; k < steps; k++) {
        Frame *frame = flat_frame(BLACK, 4000);
        for (int i = 0; i < PIXELS - 1; i++) {
            double d = (k - crossing(i)) / 1.5;
            frame->pixels[i] = (guint16)lround(BLACK + 2000 * exp(-d * d / 2));
        }
        give(bench, &sweep_shot, k, frame);
    }
    give(bench, &sweep_shot, steps, flat_frame(guard_dn, 4000));
}

static void test_sweep(struct bench *bench, gconstpointer data) {
    give_dark(bench);
    give_sweep(bench, BLACK + 20);
    wait_for(bench, 2);
    g_assert_false(bench->laser_seen);
    struct exr_part *part = read_part(bench, "sweep");
    g_assert_cmpint(part->type, ==, EXR_FLOAT);
    for (int i = 0; i < PIXELS - 1; i++) {
        g_assert_cmpfloat_with_epsilon(exr_part_plane(part, "peak")[i], crossing(i), 0.05);
        g_assert_cmpfloat_with_epsilon(exr_part_plane(part, "width")[i], 1.5, 0.1);
        g_assert_cmpfloat_with_epsilon(exr_part_plane(part, "intensity")[i], 2000, 150);
    }
    g_assert_cmpfloat(exr_part_plane(part, "peak")[PIXELS - 1], ==, -1);
    check_string(part, "mesorig.laser", "ray");
    check_double(part, "sweep.from_deg", -3);
    check_double(part, "sweep.to_deg", 4);
    int steps;
    g_assert_true(exr_get_int(part, "sweep.steps", &steps, NULL));
    g_assert_cmpint(steps, ==, 20);
    exr_part_free(part);
}

/* The same pulses five times too bright, and a second frame at each step, of a sixteenth: the short
 * one comes first. */
static void test_short_sweep(struct bench *bench, gconstpointer data) {
    bench->conf.laser_short_us = 250;
    bench->conf.keep_laser_frames = TRUE;
    const int n = shot_n_frames(&bench->conf, &sweep_shot);
    g_assert_cmpint(n, ==, 2 * sweep_shot.sweep_steps + 1);
    give_dark(bench);
    for (int sub = 0; sub < n - 1; sub++) {
        const gint64 us = shot_exposure_us(&bench->conf, &sweep_shot, sub);
        g_assert_cmpint(us, ==, sub % 2 ? 4000 : 250);
        g_assert_cmpint(shot_sweep_step(&bench->conf, &sweep_shot, sub), ==, sub / 2);
        const int step = sub / 2;
        Frame *frame = flat_frame(BLACK, us);
        for (int i = 0; i < PIXELS - 1; i++) {
            double d = (step - crossing(i)) / 1.5, light = 20000 * exp(-d * d / 2);
            frame->pixels[i] = (guint16)MIN(lround(BLACK + light * (double)us / 4000), 4095);
        }
        give(bench, &sweep_shot, sub, frame);
    }
    g_assert_cmpint(shot_exposure_us(&bench->conf, &sweep_shot, n - 1), ==, 4000);
    g_assert_cmpint(shot_sweep_step(&bench->conf, &sweep_shot, n - 1), ==, 20);
    give(bench, &sweep_shot, n - 1, flat_frame(BLACK, 4000));
    wait_for(bench, 2);
    g_assert_false(bench->laser_seen);
    struct exr_part *part = read_part(bench, "sweep");
    check_string(part, "mesorig.exposures_us", "250;4000");
    for (int i = 0; i < PIXELS - 1; i++) {
        g_assert_cmpfloat_with_epsilon(exr_part_plane(part, "peak")[i], crossing(i), 0.01);
        g_assert_cmpfloat_with_epsilon(exr_part_plane(part, "width")[i], 1.5, 0.02);
        g_assert_cmpfloat(exr_part_plane(part, "intensity")[i], <, 4095);
    }
    exr_part_free(part);
    g_free(bench->path);
    bench->path = g_build_filename(bench->directory, "laser", "000003_eye", "0007_short.exr", NULL);
    part = read_part(bench, "frame");
    check_double(part, "mesorig.exposure_us", 250);
    exr_part_free(part);
}

static void test_laser_stays_on(struct bench *bench, gconstpointer data) {
    give_dark(bench);
    give_sweep(bench, BLACK + 100);
    wait_for(bench, 2);
    g_assert_true(bench->laser_seen);
    g_assert_null(bench->path);
}

/* A line that is too dim for the threshold, over two pixels in the middle of the sweep. */
static void test_dim_laser_stays_on(struct bench *bench, gconstpointer data) {
    static const struct {
        int lit[2];        /* pixels of the picture without the laser */
        guint16 before_dn; /* how bright the pixels of the line are when the sweep begins */
        gboolean seen;
    } cases[] = {{{5, 6}, BLACK, TRUE}, {{1, 2}, BLACK, FALSE}, {{5, 6}, BLACK + 28, FALSE}};
    const int steps = sweep_shot.sweep_steps;
    give_dark(bench);
    for (int i = 0; i < (int)G_N_ELEMENTS(cases); i++) {
        for (int k = 0; k < steps; k++) {
            Frame *frame = flat_frame(BLACK, 4000);
            const gboolean middle = k == steps / 2 - 1 || k == steps / 2;
            frame->pixels[5] = frame->pixels[6] = middle ? BLACK + 28 : cases[i].before_dn;
            give(bench, &sweep_shot, k, frame);
        }
        Frame *last = flat_frame(BLACK, 4000);
        last->pixels[cases[i].lit[0]] = last->pixels[cases[i].lit[1]] = BLACK + 30;
        give(bench, &sweep_shot, steps, last);
        wait_for(bench, 2 + i);
        g_assert_cmpint(bench->laser_seen, ==, cases[i].seen);
    }
}

static void test_keep_frames(struct bench *bench, gconstpointer data) {
    bench->conf.keep_laser_frames = TRUE;
    give_sweep(bench, BLACK);
    wait_for(bench, 1);
    g_free(bench->path);
    bench->path = g_build_filename(bench->directory, "laser", "000003_eye", "0007.exr", NULL);
    struct exr_part *part = read_part(bench, "frame");
    double d = (7 - crossing(11)) / 1.5;
    g_assert_cmpfloat(exr_part_plane(part, "Y")[11], ==, lround(BLACK + 2000 * exp(-d * d / 2)));
    exr_part_free(part);
}

/* What was given before is forgotten, and a shot begun anew is not mixed up with it. */
static void test_discard(struct bench *bench, gconstpointer data) {
    give_dark(bench);
    wait_for(bench, 1);
    give(bench, &lamp_shot, 0, flat_frame(3000, 1000));
    intake_discard(bench->intake);
    give_lamp(bench);
    wait_for(bench, 2);
    check_lamp_file(bench);
    give_lamp(bench);
    intake_discard(bench->intake);
    give_sweep(bench, BLACK);
    wait_for(bench, 3);
    g_assert_nonnull(strstr(bench->path, "laser"));
}

/* What is made of a sweep meanwhile does not let others pass, and a sweep that was not yet on disk
 * is forgotten like any other. */
static void test_order(struct bench *bench, gconstpointer data) {
    static const gint64 shots[] = {3, 2, 3, 3, 1};
    for (int round = 0; round < 3; round++) {
        give_sweep(bench, BLACK);
        give_lamp(bench);
        give_sweep(bench, BLACK);
        give_sweep(bench, BLACK);
        give_dark(bench);
    }
    wait_for(bench, 15);
    for (int i = 0; i < 15; i++)
        g_assert_cmpint(bench->shots[i], ==, shots[i % 5]);
    for (int i = 0; i < 4; i++)
        give_sweep(bench, BLACK);
    intake_discard(bench->intake);
    give_lamp(bench);
    wait_for(bench, 16);
    check_lamp_file(bench);
}

static void must_not_happen(gpointer data) {
    g_assert_not_reached();
}

/* Four frames are too much: triggers wait and a virtual clock stands until they are worked on. */
static void test_full(struct bench *bench, gconstpointer data) {
    intake_free(bench->intake);
    bench->full_bytes = 4 * PIXELS * sizeof(guint16);
    start_intake(bench);
    int filled = 0;
    for (int k = 0; k <= sweep_shot.sweep_steps; k++) {
        give(bench, &sweep_shot, k, flat_frame(BLACK, 4000));
        g_assert_true(k != 3 || intake_is_full(bench->intake));
        if (!intake_is_full(bench->intake))
            continue;
        guint call = clock_call_in(bench->devices.clock, 1, must_not_happen, NULL);
        while (intake_is_full(bench->intake))
            g_main_context_iteration(NULL, TRUE);
        clock_cancel(bench->devices.clock, &call);
        g_assert_cmpint(bench->rooms, ==, ++filled);
    }
    wait_for(bench, 1);
    g_assert_cmpint(filled, >, 0);
}

static void test_unwritable(struct bench *bench, gconstpointer data) {
    g_autofree char *frames = g_build_filename(bench->directory, "frames", NULL);
    remove_tree(frames);
    give_dark(bench);
    while (bench->results < 1)
        g_main_context_iteration(NULL, TRUE);
    g_assert_true(bench->failed);
}

BEFORE_TESTS {
#define ADD(path, func) g_test_add(path, struct bench, NULL, set_up, func, tear_down)
    ADD("/intake/lamp", test_lamp);
    ADD("/intake/uneven", test_uneven);
    ADD("/intake/dark-again", test_dark_again);
    ADD("/intake/sweep", test_sweep);
    ADD("/intake/sweep/short", test_short_sweep);
    ADD("/intake/sweep/dim-laser-stays-on", test_dim_laser_stays_on);
    ADD("/intake/laser-stays-on", test_laser_stays_on);
    ADD("/intake/keep-frames", test_keep_frames);
    ADD("/intake/discard", test_discard);
    ADD("/intake/order", test_order);
    ADD("/intake/full", test_full);
    ADD("/intake/unwritable", test_unwritable);
}
