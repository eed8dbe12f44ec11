/*
 * Compares calibrations with the truth of the simulated world, for several worlds, which have
 * different misalignments, lenses and noise. The figures of a part are those of the worst world,
 * except that chi2 is the mean of all worlds.
 */
#include "bench.h"
#include "lib/calibration_fixture.h"

#include "calibration_parts.h"

#include <stdio.h>

static int n_cameras = 5, size_px = 192, n_stops = 20, n_seeds = 5, first_seed = 1,
           distance_mm = 400;
static gboolean show;
static char *only;

struct total {
    struct fixture_errors worst;
    double rms_px, chi2, chi2_low, chi2_high, cpu_s, real_s;
    int done, pictures;
};

static void calibrate(struct fixture *f, int seed, struct total *total) {
    const struct cameras_task task = {f->board, f->pictures, f->n_pictures, boards_read, NULL, f};
    g_autoptr(Calibration) calibration = calibration_new(&f->nominal);
    g_autoptr(GError) error = NULL;
    const double begun = bench_cpu_s();
    const gint64 begun_us = g_get_monotonic_time();
    g_autoptr(CamerasResult) result = cameras_calibrate(calibration, &task, &error);
    const double cpu = bench_cpu_s() - begun;
    total->cpu_s = MAX(total->cpu_s, cpu);
    total->real_s = MAX(total->real_s, (double)(g_get_monotonic_time() - begun_us) * 1e-6);
    total->pictures = f->n_pictures;
    if (!result) {
        fprintf(stderr, "seed %d: refused: %s\n", seed, error->message);
        return;
    }
    const struct fixture_errors e = boards_compare(f, calibration);
    struct fixture_errors *worst = &total->worst;
    worst->point_px = MAX(worst->point_px, e.point_px);
    worst->direction_deg = MAX(worst->direction_deg, e.direction_deg);
    worst->distance_pct = MAX(worst->distance_pct, e.distance_pct);
    worst->axis_mm = MAX(worst->axis_mm, e.axis_mm);
    worst->axis_deg = MAX(worst->axis_deg, e.axis_deg);
    total->rms_px = MAX(total->rms_px, result->rms_px);
    total->chi2 += e.chi2;
    total->chi2_low = total->done ? MIN(total->chi2_low, e.chi2) : e.chi2;
    total->chi2_high = MAX(total->chi2_high, e.chi2);
    total->done++;
    bench_begin(NULL);
    bench_put("%d{seed} %.4f{reprojection_rms_px} %.4f{points_rms_px} %.4f{direction_deg} "
              "%.4f{distance_pct} %.4f{axis_mm} %.4f{axis_deg} %.2f{chi2} %.1f{processor_s}",
              seed, result->rms_px, e.point_px, e.direction_deg, e.distance_pct, e.axis_mm,
              e.axis_deg, e.chi2, cpu);
    if (show) {
        const double azimuth = boards_azimuth_rad(f, &calibration->rig);
        bench_begin_list("cameras");
        for (int c = 0; c < f->nominal.n_cameras; c++) {
            const struct calibration_camera *camera = &calibration->cameras[c];
            bench_row(NULL,
                      "%d{camera} %.4f{rms_px} %d{corners} %.4f{distance_sigma_pct} %.2f{chi2}", c,
                      camera->residual_rms_px, camera->points,
                      100 * sqrt(camera->covariance[14][14]) / f->options.distance_mm,
                      boards_chi2(f, calibration, c, azimuth));
        }
        bench_end();
    }
    bench_end();
}

static void run(int seed, struct total *total) {
    static const struct fixture_lay lays[] = {{0, 0, 3, 1, -2},
                                              {15, 10, 40, 2, 1},
                                              {15, 100, 63, 1, 0},
                                              {30, 190, 75, -1, 2},
                                              {40, 280, 20, 0, 0}};
    const struct fixture_rig options = {.n_cameras = n_cameras,
                                        .width = size_px,
                                        .height = size_px,
                                        .focal_px = 2.56 * distance_mm * size_px / 192,
                                        .distance_mm = distance_mm,
                                        .first_theta_deg = 15,
                                        .last_theta_deg = 75,
                                        .seed = seed,
                                        .supersample = 3,
                                        .error_mm = 1,
                                        .error_deg = 0.2,
                                        .turntable_error_deg = 0.01,
                                        .blur_px = 0.4,
                                        .board = "8x8,square=9,marker=6.75,thickness=3"};
    struct fixture f;
    boards_open(&f, &options, lays, G_N_ELEMENTS(lays));
    boards_capture(&f, n_stops);
    calibrate(&f, seed, total);
    boards_close(&f);
}

static gboolean refused;

static void measure_cameras(int n) {
    struct total total = {0};
    bench_begin_list("each");
    for (int i = 0; i < n; i++)
        run(first_seed + i, &total);
    bench_end();
    refused = total.done < n;
    const struct fixture_errors *w = &total.worst;
    bench_put("%d{worlds} %d{refused} %d{cameras} %d{pictures} %d{distance_mm} "
              "%.4f{reprojection_rms_px} %.4f{points_rms_px} %.4f{direction_deg} "
              "%.4f{distance_pct} %.4f{axis_mm} %.4f{axis_deg} %.3f{chi2} %.3f{chi2_least} "
              "%.3f{chi2_most} %.1f{processor_s} %.1f{real_s}",
              n, n - total.done, n_cameras, total.pictures, distance_mm, total.rms_px, w->point_px,
              w->direction_deg, w->distance_pct, w->axis_mm, w->axis_deg,
              total.chi2 / MAX(total.done, 1), total.chi2_low, total.chi2_high, total.cpu_s,
              total.real_s);
}

/* The whole of a rig of eight cameras, pictures of 192 px from half as many angles. */
static void measure_whole(int n) {
    struct total total = {0};
    n_cameras = 8;
    n_stops = 12;
    bench_begin_list("each");
    run(1, &total);
    bench_end();
    bench_whole(total.cpu_s, total.pictures);
}

int main(int argc, char **argv) {
    const GOptionEntry entries[] = {
        {"cameras", 0, 0, G_OPTION_ARG_INT, &n_cameras, "Cameras, from 15° to 75°", "N"},
        {"size", 0, 0, G_OPTION_ARG_INT, &size_px, "Pixels across", "N"},
        {"stops", 0, 0, G_OPTION_ARG_INT, &n_stops, "Angles of the turntable", "N"},
        {"distance", 0, 0, G_OPTION_ARG_INT, &distance_mm, "Of the cameras", "MM"},
        {"seeds", 0, 0, G_OPTION_ARG_INT, &n_seeds, "Worlds", "N"},
        {"first", 0, 0, G_OPTION_ARG_INT, &first_seed, "Seed of the cameras' first world", "N"},
        {"part", 0, 0, G_OPTION_ARG_STRING, &only, "cameras, lights, radiometry or whole alone",
         "PART"},
        {"show", 0, 0, G_OPTION_ARG_NONE, &show, "Tell more", NULL},
        {NULL},
    };
    static const struct {
        const char *name;
        void (*measure)(int n_seeds); /* adds to the object of the part */
    } parts[] = {{"cameras", measure_cameras},
                 {"lights", bench_lights},
                 {"radiometry", bench_radiometry},
                 {"whole", measure_whole}};
    bench_parse(&argc, &argv, entries, NULL);
    bench_begin(NULL);
    for (gsize i = 0; i < G_N_ELEMENTS(parts); i++) {
        if (only && !g_str_equal(only, parts[i].name))
            continue;
        bench_begin(parts[i].name);
        parts[i].measure(n_seeds);
        bench_end();
    }
    bench_end();
    return refused;
}
