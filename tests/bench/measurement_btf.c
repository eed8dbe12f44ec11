#include "measurement_parts.h"

#include "btf/btf_sigma.h"
#include "capture/intake/radiance.h"
#include "exr/exr_half.h"
#include "frames/rectify.h"
#include "lib/floats.h"

#include <math.h>
#include <stdlib.h>

#define DARK_FRAMES    8
#define GUIDE_AZIMUTHS 5
#define LEAST          0.02 /* of a denominator, in reflectance */

static const gint64 exposures_us[] = {4000, 16000, 64000};
#define N_EXPOSURES ((int)G_N_ELEMENTS(exposures_us))

/* Texels lie turned in the pictures, as they do in a session. */
static double turntable_deg(int view) {
    return 24.0 * view;
}

static Frame *expose(World *world, int camera, const struct world_state *state, gint64 exposure_us,
                     guint64 key) {
    struct world_sensor sensor;
    world_sensor(world, camera, &sensor);
    Frame *frame = frame_new(sensor.width, sensor.height);
    frame->bits = sensor.bits;
    frame->cfa = sensor.cfa;
    frame->exposure_us = exposure_us;
    world_expose(world, camera, state, exposure_us, 0, key, frame->pixels);
    return frame;
}

struct darks {
    float *level[N_EXPOSURES];
};

static struct darks take_darks(World *world, int camera) {
    struct world_state off = {0};
    struct darks darks;
    for (int e = 0; e < N_EXPOSURES; e++) {
        g_autofree guint32 *sums = NULL;
        gsize n = 0;
        for (int i = 0; i < DARK_FRAMES; i++) {
            g_autoptr(Frame) frame = expose(world, camera, &off, exposures_us[e],
                                            900000 + (guint64)e * 100 + (guint64)i);
            n = (gsize)frame->width * (gsize)frame->height;
            sums = sums ? sums : g_new0(guint32, n);
            radiance_add(frame, sums);
        }
        darks.level[e] = g_new(float, n);
        radiance_mean(sums, DARK_FRAMES, n, darks.level[e]);
    }
    return darks;
}

/* What intake stores: merged, in half floats. */
static float *take_mosaic(World *world, int camera, int lamp, double arc, const struct darks *darks,
                          int *ret_saturated) {
    struct world_state state = {.turntable_deg = turntable_deg(camera), .arc_deg = arc};
    state.lamp_output[lamp] = 1;
    Frame *frames[N_EXPOSURES];
    for (int e = 0; e < N_EXPOSURES; e++)
        frames[e] =
            expose(world, camera, &state, exposures_us[e],
                   (((guint64)camera * 16 + (guint64)lamp) * 4096 + (guint64)arc * 8) + (guint64)e);
    gsize n = (gsize)frames[0]->width * (gsize)frames[0]->height;
    float *mosaic = g_new(float, n);
    struct radiance_stats stats;
    radiance_merge((const Frame *const *)frames, (const float *const *)darks->level, N_EXPOSURES, 0,
                   0, mosaic, &stats);
    *ret_saturated = (int)stats.saturated;
    g_autofree guint16 *half = g_new(guint16, n);
    exr_half_from_floats(half, mosaic, n);
    exr_half_to_floats(mosaic, half, n);
    for (int e = 0; e < N_EXPOSURES; e++)
        frame_unref(frames[e]);
    return mosaic;
}

double bench_quantile(GArray *values, double q) {
    g_array_sort(values, floats_by_value);
    return values->len ? (double)g_array_index(values, float, (guint)(q * (values->len - 1))) : NAN;
}

/* The mean under every lamp at some azimuths, as a session has them. */
static void guide_by_all(World *world, int view, const struct darks *darks, Rectify *rectify) {
    struct world_sensor sensor;
    world_sensor(world, view, &sensor);
    gsize n = (gsize)sensor.width * (gsize)sensor.height;
    g_autofree float *sum = g_new0(float, n);
    for (int i = 0; i < RIG_VIEWS * GUIDE_AZIMUTHS; i++) {
        double arc = 15 + 360.0 / GUIDE_AZIMUTHS * (i % GUIDE_AZIMUTHS);
        int saturated;
        g_autofree float *mosaic =
            take_mosaic(world, view, i / GUIDE_AZIMUTHS, arc, darks, &saturated);
        for (gsize k = 0; k < n; k++)
            sum[k] += mosaic[k];
    }
    rectify_guide(rectify, sum);
}

struct bench_sigma {
    float *noise, *detail;
};

/* The simulated sensors' noise as a photon transfer tells it: K = (2^bits − 1 − black) / full well.
 */
static const struct transfer transfer = {.gain_dn_e = (4095 - 64) / 15000.0, .read_noise_e = 4};

/* The standard error of each texel as btf.c finds it, in the unit of rgb: n × 3 variances each. */
static void find_errors(const Rectify *rectify, const float *mosaic, gsize n_pixels, int saturation,
                        int n, struct bench_sigma *ret) {
    struct btf_exposures exposures = {.n = N_EXPOSURES};
    g_autofree float *pixels = g_new(float, n_pixels), *shift = g_new(float, 3 * n);
    for (int e = 0; e < N_EXPOSURES; e++)
        exposures.ms[e] = (double)exposures_us[e] * 1e-3;
    exposures.shorter = (float)((saturation - 64) / exposures.ms[N_EXPOSURES - 1]);
    btf_sigma_pixels(&transfer, &exposures, mosaic, n_pixels, pixels);
    ret->noise = g_new(float, 3 * n);
    ret->detail = g_new(float, 3 * n);
    rectify_errors(rectify, mosaic, pixels, ret->noise, ret->detail, shift);
}

static void compare(const float *rgb, const float *irradiance, const float *truth, int n,
                    gboolean mono, const struct bench_sigma *sigma, struct bench_cell *cell) {
    GArray *errors = cell->errors, *bias = cell->bias;
    for (int i = 0; i < n; i++)
        for (int c = mono; c < (mono ? 2 : 3); c++) {
            float value = rgb[3 * i + c] * (float)G_PI / irradiance[i], exact = truth[3 * i + c];
            const double off = (double)((value - exact) * irradiance[i]) / G_PI;
            const double noise = (double)sigma->noise[3 * i + c];
            const double all = noise + (double)sigma->detail[3 * i + c];
            cell->values++;
            cell->chi_noise += off * off / noise;
            cell->chi += off * off / all;
            cell->beyond += off * off > 9 * all;
            float error = (value - exact) / MAX(exact, (float)LEAST);
            float size = fabsf(error);
            g_array_append_val(errors, size);
            g_array_append_val(bias, error);
        }
}

/* Views and lights that are shown. */
static gboolean is_shown(int view, int lamp) {
    static const int shown[DEMO_BTF_COLUMNS] = {0, 3, 11, 15, 18, 24};
    for (int i = 0; i < DEMO_BTF_COLUMNS; i++)
        if (shown[i] == view * RIG_VIEWS + lamp)
            return TRUE;
    return FALSE;
}

void bench_btf(const struct bench_setup *setup, int truth_samples, struct bench_cell *ret,
               struct demo_btf *picture) {
    g_autoptr(GError) error = NULL;
    g_autoptr(World) world = bench_world(setup, &error);
    g_assert_no_error(error);
    struct rig rig;
    bench_rig(setup, &rig);
    struct session_grid grid = bench_grid(setup);
    struct truth_grid truth_grid = bench_truth_grid(setup);
    int n = grid.width * grid.height;
    g_autofree float *rgb = g_new(float, 3 * n), *truth = g_new(float, 3 * n);
    g_autofree float *irradiance = g_new(float, n);
    for (int view = 0; view < RIG_VIEWS; view++) {
        double turn_rad = turntable_deg(view) * G_PI / 180;
        struct darks darks = take_darks(world, view);
        g_autoptr(Rectify) rectify = rectify_new(
            &rig.cameras[view], NULL, setup->mono ? "mono" : "rggb", turn_rad, &grid, &error);
        g_assert_no_error(error);
        guide_by_all(world, view, &darks, rectify);
        for (int lamp = 0; lamp < RIG_VIEWS; lamp++) {
            /* Between cameras at azimuth 0 and the lamp, one a pair: every sort of azimuth comes
             * about. */
            static const double azimuths[] = {20, 75, 130, 200, 290};
            double arc = azimuths[(view + 2 * lamp) % 5] + turntable_deg(view);
            struct bench_cell *cell = &ret[view * RIG_VIEWS + lamp];
            g_autofree float *mosaic =
                take_mosaic(world, view, lamp, arc, &darks, &cell->saturated);
            rectify_apply(rectify, mosaic, rgb, NULL);
            rectify_irradiance(&rig.arc, &rig.lamps[lamp], arc * G_PI / 180, turn_rad, &grid,
                               irradiance);
            truth_btf(world, view, lamp, turntable_deg(view), arc, &truth_grid, truth_samples,
                      truth);
            if (picture && is_shown(view, lamp)) {
                static const char *const channels[] = {"B", "G", "R", NULL};
                struct exr_part *part =
                    exr_part_new("shown", grid.width, grid.height, channels, EXR_FLOAT);
                for (int k = 0; k < grid.width * grid.height; k++)
                    for (int c = 0; c < 3; c++)
                        part->planes[2 - c][k] = rgb[3 * k + c] * (float)G_PI / irradiance[k];
                demo_btf_add(
                    picture, part,
                    &(struct session_direction){.theta_deg = bench_elevation_deg(view),
                                                .phi_deg = fmod(720 - turntable_deg(view), 360)},
                    &(struct session_direction){.theta_deg = bench_elevation_deg(lamp),
                                                .phi_deg =
                                                    fmod(720 + arc - turntable_deg(view), 360)},
                    truth);
                exr_part_free(part);
            }
            struct bench_sigma sigma;
            find_errors(rectify, mosaic, (gsize)rig.cameras[view].width * rig.cameras[view].height,
                        radiance_saturation(12), n, &sigma);
            compare(rgb, irradiance, truth, n, setup->mono, &sigma, cell);
            g_free(sigma.noise);
            g_free(sigma.detail);
        }
        for (int e = 0; e < N_EXPOSURES; e++)
            g_free(darks.level[e]);
    }
}
