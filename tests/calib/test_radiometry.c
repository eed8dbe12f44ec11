#include "base/residual.h"
#include "lib/ok.h"
#include "lib/radiometry_fixture.h"
#include "lib/test.h"
#include "radiometry/photon_transfer.h"
#include "radiometry/radiometry.h"

#include <string.h>

#define PIXELS (FIXTURE_SIZE * FIXTURE_SIZE)
#define SEEDS  6

static const struct tile white = {80, 80, 4, {0.98, 0.97, 0.96}};

static World *tile_world(int seed) {
    g_autofree char *keys =
        g_strdup_printf("seed=%d\ndrift_pct=3\ndrift_period_s=977\nturntable_albedo=0.02", seed);
    g_autofree char *text = radiometry_fixture_world(
        keys, "[sample]\nkind=flat\nwidth_mm=80\nheight_mm=80\nbase_mm=4\nalbedo=0.98;0.97;0.96\n");
    return world_fixture_new(text);
}

static const double arcs_deg[] = {0, 70, 150, 230, 290};
#define N_ARCS  ((int)G_N_ELEMENTS(arcs_deg))
#define N_SHOTS (3 * N_ARCS)

/* Every lamp at every arc angle; the sample turns too. */
static GArray *tile_cells(World *world, const struct rig *rig, struct tile_shot *shots) {
    GArray *cells = g_array_new(FALSE, FALSE, sizeof(struct tile_cell));
    g_autofree float *mosaic = g_new(float, PIXELS);
    for (int s = 0; s < N_SHOTS; s++) {
        struct fixture_pose pose = {s % 3, 25.0 * s, arcs_deg[s / 3], 40.0 * s};
        shots[s] = (struct tile_shot){pose.lamp, pose.arc_deg * G_PI / 180,
                                      pose.turntable_deg * G_PI / 180};
        for (int c = 0; c < rig->n_cameras; c++) {
            radiometry_fixture_mosaic(world, c, &pose, 2, (guint64)s, mosaic);
            int n = tile_measure(rig, c, "rggb", mosaic, &white, shots, s, cells);
            g_assert_cmpint(n, >, 20);
        }
    }
    return cells;
}

struct normalised { /* squared errors by their standard errors */
    double sum;
    int n;
};

static void add(struct normalised *to, double found, double truth, double error) {
    g_assert_cmpfloat(error, >, 0);
    to->sum += (found - truth) * (found - truth) / (error * error);
    to->n++;
}

static void assert_normal(const struct normalised *a, const struct normalised *b,
                          const struct normalised *c, const struct normalised *d) {
    double all = (a->sum + b->sum + c->sum + d->sum) / (a->n + b->n + c->n + d->n);
    g_assert_cmpfloat(all, >, 0.7);
    g_assert_cmpfloat(all, <, 1.4);
}

/* What the convention makes of the true factors: cameras have a geometric mean of nominal. */
static double true_log_gain(int camera, int colour) {
    double own = 0, mean = 0;
    for (int c = 0; c < 3; c++) {
        double log_gain =
            log(fixture_cameras[c].response * fixture_cameras[c].colour[colour] / 6000);
        mean += log_gain / 3;
        own = c == camera ? log_gain : own;
    }
    return camera < 0 ? mean : own - mean;
}

static double true_drift(int shot) {
    return 1 + 0.03 * sin(2 * G_PI * (40.0 * shot + 1 + FIXTURE_US * 0.5e-6) / 977);
}

/* The lamp's logarithmic mean over its shots. */
static double true_output(int lamp) {
    double sum = 0;
    for (int s = lamp; s < N_SHOTS; s += 3)
        sum += log(true_drift(s));
    return exp(sum / N_ARCS);
}

static void check_camera(const struct rig *rig, const struct tile_fit *fit, int c,
                         struct normalised *response, struct normalised *colour) {
    double mean = 0;
    for (int k = 0; k < 3; k++)
        mean += true_log_gain(c, k) / 3;
    add(response, log(rig->cameras[c].response / 6000), mean, fit->cameras[c].response_error);
    for (int k = 0; k < 3; k++)
        add(colour, fit->cameras[c].colour[k], exp(true_log_gain(c, k) - mean),
            fit->cameras[c].colour_error[k]);
    double sum = 0;
    int n = 0;
    for (int y = 8; y < FIXTURE_SIZE; y += 16)
        for (int x = 8; x < FIXTURE_SIZE; x += 16) {
            struct vec3 ray = rig_pixel_ray(&rig->cameras[c], x, y);
            struct vec3 eye = rig_camera_centre_mm(&rig->cameras[c]);
            struct vec3 at = vec3_add(eye, vec3_scale(ray, (white.top_mm - eye.z) / ray.z));
            if (hypot(at.x, at.y) > 36)
                continue; /* the tile was not there at every turntable angle */
            double dx = x - 47.5, dy = y - 47.5;
            double truth =
                1 - fixture_cameras[c].vignetting * (dx * dx + dy * dy) / (2 * 47.5 * 47.5);
            double found = radiometry_flat(&rig->cameras[c], &fit->cameras[c], x, y);
            sum += (found / truth - 1) * (found / truth - 1);
            n++;
        }
    g_assert_cmpfloat(sqrt(sum / n), <, 2e-3);
}

TEST(tile) {
    struct normalised response = {0}, colour = {0}, lamp = {0}, output = {0};
    for (int seed = 1; seed <= SEEDS; seed++) {
        g_autoptr(World) world = tile_world(seed);
        struct rig rig;
        struct tile_shot shots[N_SHOTS];
        struct tile_fit fit;
        radiometry_fixture_rig(&rig);
        g_autoptr(GArray) cells = tile_cells(world, &rig, shots);
        gboolean ok = ok(tile_fit(&rig, shots, N_SHOTS, (struct tile_cell *)(void *)cells->data,
                                  (int)cells->len, &fit, ERR));
        g_assert_true(ok);
        g_test_message("seed %d: %d cells, residual %.4f, quality %.3f, rejected %d", seed,
                       (int)cells->len, fit.residual, fit.quality, fit.rejected);
        g_assert_cmpfloat(fit.quality, >, 0.8);
        g_assert_cmpfloat(fit.quality, <, 1.25);
        for (int i = 0; i < 3; i++) {
            check_camera(&rig, &fit, i, &response, &colour);
            const struct fixture_lamp *truth = &fixture_lamps[i];
            double common = 0;
            for (int k = 0; k < 3; k++)
                common += true_log_gain(-1, k) / 3;
            add(&lamp, log(rig.lamps[i].intensity), log(truth->intensity * true_output(i)) + common,
                fit.lamps[i].intensity_error);
            add(&lamp, rig.lamps[i].exponent, truth->exponent, fit.lamps[i].exponent_error);
            for (int k = 0; k < 3; k++)
                add(&lamp, fit.lamps[i].colour[k], exp(true_log_gain(-1, k) - common),
                    fit.lamps[i].colour_error[k]);
        }
        for (int s = 0; s < N_SHOTS; s++)
            add(&output, fit.output[s], true_drift(s) / true_output(s % 3), fit.output_error[s]);
        tile_fit_clear(&fit);
    }
    g_test_message(
        "chi-square a degree of freedom: response %.2f colour %.2f lamp %.2f output %.2f",
        response.sum / response.n, colour.sum / colour.n, lamp.sum / lamp.n, output.sum / output.n);
    assert_normal(&response, &colour, &lamp, &output);
}

struct pairs {
    struct transfer_pair dark[4], lit[5];
    float *pixels;
};

static const double exposures_us[] = {500, 2000, 4000, 8000, 10000};

static void take_pairs(World *world, int camera, guint64 key, struct pairs *pairs) {
    pairs->pixels = g_new(float, 18 * PIXELS);
    float *at = pairs->pixels;
    for (int i = 0; i < 9; i++) {
        struct fixture_pose pose = {i < 4 ? -1 : 0, 0, 70, i < 4 ? 500 : 0};
        double us = exposures_us[i < 4 ? i : i - 4];
        struct transfer_pair *pair = i < 4 ? &pairs->dark[i] : &pairs->lit[i - 4];
        *pair = (struct transfer_pair){us, at, at + PIXELS};
        radiometry_fixture_expose(world, camera, &pose, (gint64)us, key * 100 + 2 * (guint64)i, at);
        radiometry_fixture_expose(world, camera, &pose, (gint64)us, key * 100 + 2 * (guint64)i + 1,
                                  at + PIXELS);
        at += 2 * PIXELS;
    }
}

TEST(photon_transfer) {
    struct transfer_sensor sensor = {FIXTURE_SIZE, FIXTURE_SIZE, 12};
    struct normalised gain = {0}, read = {0}, black = {0}, curvature = {0};
    double k = (4095.0 - 64) / 15000;
    for (int seed = 1; seed <= SEEDS; seed++) {
        g_autoptr(World) world = tile_world(seed);
        for (int c = 0; c < 3; c++) {
            struct pairs pairs;
            struct transfer found;
            take_pairs(world, c, (guint64)seed, &pairs);
            gboolean ok = ok(transfer_fit(&sensor, pairs.dark, 4, pairs.lit, 5, &found, ERR));
            g_assert_true(ok);
            g_assert_cmpfloat(fabs(found.gain_dn_e / k - 1), <, 0.05);
            g_assert_cmpfloat(found.linearity, <, 0.002);
            add(&gain, found.gain_dn_e, k, found.gain_error_dn_e);
            add(&read, found.read_noise_e, 4, found.read_noise_error_e);
            add(&black, found.black_dn, 64, found.black_error_dn);
            add(&curvature, found.curvature, 0, found.curvature_error);
            g_free(pairs.pixels);
        }
    }
    g_test_message("chi-square: gain %.2f read %.2f black %.2f curvature %.2f", gain.sum / gain.n,
                   read.sum / read.n, black.sum / black.n, curvature.sum / curvature.n);
    assert_normal(&gain, &read, &black, &curvature);
}

static void refused(const struct pairs *pairs, int n_dark, int n_lit, enum transfer_error code,
                    const char *says) {
    struct transfer_sensor sensor = {FIXTURE_SIZE, FIXTURE_SIZE, 12};
    struct transfer found;
    g_autoptr(GError) error = NULL;
    g_assert_false(transfer_fit(&sensor, pairs->dark, n_dark, pairs->lit, n_lit, &found, &error));
    g_assert_error(error, TRANSFER_ERROR, (int)code);
    g_assert_nonnull(strstr(error->message, says));
}

TEST(bad_pairs) {
    g_autoptr(World) world = tile_world(1);
    struct pairs pairs, changed;
    take_pairs(world, 0, 1, &pairs);
    refused(&pairs, 1, 5, TRANSFER_ERROR_TOO_FEW, "two dark");
    refused(&pairs, 4, 2, TRANSFER_ERROR_TOO_FEW, "three lit");
    changed = pairs;
    changed.dark[0].exposure_us = changed.dark[1].exposure_us;
    refused(&changed, 2, 5, TRANSFER_ERROR_TOO_FEW, "all have one exposure");
    changed = pairs;
    changed.lit[1].second = changed.lit[1].first;
    refused(&changed, 4, 5, TRANSFER_ERROR_DATA, "the same picture twice");
    changed = pairs;
    changed.lit[1].second = pairs.lit[3].first;
    refused(&changed, 4, 5, TRANSFER_ERROR_DATA, "warm up");
    for (int i = 0; i < 3; i++) /* nothing but darkness */
        changed.lit[i] = pairs.dark[i];
    refused(&changed, 4, 3, TRANSFER_ERROR_RANGE, "brightest");
    float *pixel = (float *)pairs.lit[2].first + 77, kept = *pixel;
    *pixel = (float)NAN;
    refused(&pairs, 4, 5, TRANSFER_ERROR_DATA, "not a number");
    *pixel = kept;
    g_free(pairs.pixels);
}

/* A sensor that bends as is said: signal = linear (1 − c·linear/range). */
TEST(bent_sensor) {
    const double range = 4095 - 64, bend = 0.05;
    struct transfer_sensor sensor = {FIXTURE_SIZE, FIXTURE_SIZE, 12};
    struct transfer found;
    struct pairs pairs;
    g_autoptr(World) world = tile_world(2);
    g_autoptr(GError) error = NULL;
    take_pairs(world, 0, 2, &pairs);
    for (int i = 8 * PIXELS; i < 18 * PIXELS; i++) {
        double linear = pairs.pixels[i] - 64.0;
        pairs.pixels[i] = (float)(64 + linear * (1 - bend * linear / range));
    }
    g_assert_true(transfer_fit(&sensor, pairs.dark, 4, pairs.lit, 5, &found, &error));
    g_test_message("curvature %.4f ± %.4f, off a line by %.4f", found.curvature,
                   found.curvature_error, found.linearity);
    g_assert_cmpfloat(fabs(found.curvature - bend), <, 5 * found.curvature_error);
    g_assert_cmpfloat(found.linearity, >, 0.005);
    g_free(pairs.pixels);
}

/* Some cells of a dark surround under two lamps that move: the share `glare` of the picture's mean,
 * a dark surface, and noise, in thousandths of the mean. */
static gboolean fit_glare(double glare, int n_shots, int n_cells, double noise, double *ret_glare,
                          double *ret_error) {
    g_autofree struct tile_shot *shots = g_new0(struct tile_shot, n_shots);
    g_autofree struct glare_cell *cells = g_new0(struct glare_cell, n_shots * n_cells);
    GRand *rand = g_rand_new_with_seed(5);
    for (int s = 0; s < n_shots; s++) {
        shots[s].lamp = s % 2;
        for (int k = 0; k < n_cells; k++) {
            struct glare_cell *cell = &cells[n_cells * s + k];
            double deviate = -6;
            for (int i = 0; i < 12; i++)
                deviate += g_rand_double(rand);
            *cell = (struct glare_cell){.shot = s, .cell = k, .colour = 1, .error = noise};
            cell->mean = 1000 + 300 * sin(s);
            cell->white = 2000 + 600 * cos(0.7 * s + k);
            cell->signal =
                glare / (1 + glare) * cell->mean + 0.01 * cell->white + cell->error * deviate;
        }
    }
    g_rand_free(rand);
    return glare_fit(cells, n_shots * n_cells, 0, shots, ret_glare, ret_error);
}

/* A glare that is known is given with its error. One that is plain, but not known well enough to be
 * subtracted, is in the error; without a trace of it nothing is. */
TEST(glare) {
    double glare, error;
    g_assert_true(fit_glare(0.02, 48, 20, 1, &glare, &error));
    g_test_message("%.5f ± %.5f", glare, error);
    g_assert_cmpfloat(fabs(glare - 0.02), <, 3 * error);
    g_assert_true(fit_glare(0, 48, 20, 1, &glare, &error));
    g_assert_cmpfloat(glare, <, 3 * error);
    g_assert_false(fit_glare(0.03, 16, 1, 5, &glare, &error));
    g_test_message("%.5f ± %.5f", glare, error);
    g_assert_cmpfloat(glare, ==, 0);
    g_assert_cmpfloat(error, >, 0.015);
    g_assert_cmpfloat(error, <, 0.06);
    g_assert_false(fit_glare(0, 16, 1, 5, &glare, &error));
    g_assert_cmpfloat(glare, ==, 0);
    g_assert_cmpfloat(error, ==, 0);
}

static void tile_refused(const struct tile_shot *shots, int n_shots, const GArray *cells,
                         enum radiometry_error code, const char *says) {
    g_autoptr(GError) error = NULL;
    struct tile_fit fit;
    struct rig rig, before;
    radiometry_fixture_rig(&rig);
    before = rig;
    g_assert_false(tile_fit(&rig, shots, n_shots, (struct tile_cell *)(void *)cells->data,
                            (int)cells->len, &fit, &error));
    g_assert_error(error, RADIOMETRY_ERROR, (int)code);
    g_test_message("%s", error->message);
    g_assert_nonnull(strstr(error->message, says));
    g_assert_cmpmem(&rig, sizeof rig, &before, sizeof before);
}

TEST(bad_tiles) {
    g_autoptr(World) world = tile_world(1);
    struct rig rig;
    struct tile_shot shots[N_SHOTS], same[N_SHOTS];
    radiometry_fixture_rig(&rig);
    g_autoptr(GArray) cells = tile_cells(world, &rig, shots);
    g_autoptr(GArray) none = g_array_new(FALSE, FALSE, sizeof(struct tile_cell));
    tile_refused(shots, N_SHOTS, none, RADIOMETRY_ERROR_TOO_FEW,
                 "the pictures show too little of the lit tile");
    for (int s = 0; s < N_SHOTS; s++)
        same[s] = (struct tile_shot){shots[s].lamp, 0.3, shots[s].turntable_rad};
    tile_refused(same, N_SHOTS, cells, RADIOMETRY_ERROR_TOO_FEW, "from one side only");
    struct tile_cell *cell = (struct tile_cell *)(void *)cells->data;
    for (guint i = 0; i < cells->len; i++) /* a pattern, no tile */
        cell[i].signal *= 1 + 0.2 * sin(i * 0.7);
    tile_refused(shots, N_SHOTS, cells, RADIOMETRY_ERROR_MISFIT, "do not show a matt white tile");
    /* A camera that never sees the tile when others do. */
    g_autoptr(GArray) apart = g_array_new(FALSE, FALSE, sizeof(struct tile_cell));
    for (guint i = 0; i < cells->len; i++) {
        cell[i].signal /= 1 + 0.2 * sin(i * 0.7);
        if ((cell[i].camera == 1) == (cell[i].shot % 2 == 1))
            g_array_append_val(apart, cell[i]);
    }
    tile_refused(shots, N_SHOTS, apart, RADIOMETRY_ERROR_DEGENERATE, "too few shots show the tile");
}

/* Pictures that are coded as sRGB is, nearly, and taken for linear: the fit takes it for another
 * fall-off of the lamps; a tile with spots leaves residuals. Without either nothing is in excess.
 */
TEST(wrong_tones) {
    struct tile_shot shots[N_SHOTS];
    struct rig nominal;
    g_autoptr(World) world = tile_world(3);
    radiometry_fixture_rig(&nominal);
    g_autoptr(GArray) cells = tile_cells(world, &nominal, shots);
    for (int wrong = 0; wrong < 3; wrong++) {
        g_autofree struct tile_cell *own = g_memdup2(cells->data, cells->len * sizeof *own);
        struct rig rig = nominal;
        struct tile_fit fit;
        for (guint i = 0; i < cells->len; i++) {
            const double power = wrong == 1 ? 1 / 2.2 : 1, signal = own[i].signal;
            own[i].error *= power * pow(signal, power - 1);
            own[i].signal = pow(signal, power);
            if (wrong == 2)
                own[i].signal *= 1 + 0.005 * sin(0.3 * own[i].point_mm.x + own[i].point_mm.y);
        }
        const gboolean ok = ok(tile_fit(&rig, shots, N_SHOTS, own, (int)cells->len, &fit, ERR));
        g_assert_true(ok);
        g_test_message("%d: residual %.5f, expected %.5f, exponents %.2f, aims %.3f, excess %.5f",
                       wrong, fit.residual, fit.expected, fit.exponent_off, fit.aim_off_rad,
                       fit.cameras[0].excess);
        g_assert_cmpint(fit.aim_off_rad > 0.5, ==, wrong == 1);
        g_assert_cmpint(fit.residual > RESIDUAL_LIMIT * fit.expected, ==, wrong == 2);
        g_assert_cmpint(fit.cameras[0].excess > 0.002, ==, wrong == 2);
        g_assert_cmpfloat(fabs(fit.exponent_off - 0.45), <, 0.6);
        tile_fit_clear(&fit);
    }
}

AFTER_TESTS {
    world_fixture_clean();
}
