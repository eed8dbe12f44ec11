/* Measures calibration against the simulated world's own truth. One JSON object with --json. */
#include "tests/calibration_fixture.h"

#include "calibration_radiometry.h"

#include <stdio.h>

static char *only;
static int n_cameras = 5, size_px = 192, n_stops = 12, n_seeds = 5, show;

static double cpu_s(void) {
    return (double)clock() / CLOCKS_PER_SEC;
}

static void run(int seed, gboolean json) {
    static const struct fixture_lay lays[] = {
        {0, 0, 3, 1, -2}, {30, 10, 40, 2, 1}, {35, 130, 75, -1, 2}, {35, 250, 20, 0, 0}};
    const struct fixture_rig options = {.n_cameras = n_cameras,
                                        .width = size_px,
                                        .height = size_px,
                                        .focal_px = 1664.0 * size_px / 192,
                                        .distance_mm = 650,
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
    g_autoptr(GError) error = NULL;
    const double start = cpu_s();
    fixture_open(&f, &options, lays, G_N_ELEMENTS(lays));
    fixture_capture(&f, n_stops);
    const double rendered = cpu_s();
    g_autoptr(Calibration) calibration = calibration_new(&f.nominal);
    const struct cameras_task task = {f.board, f.pictures, f.n_pictures, fixture_read, NULL, &f};
    g_autoptr(CamerasResult) result = cameras_calibrate(calibration, &task, &error);
    const double done = cpu_s();
    if (!result) {
        printf("seed %d: refused: %s\n", seed, error->message);
        fixture_close(&f);
        return;
    }
    const struct fixture_errors e = fixture_compare(&f, calibration);
    const struct calibration_part *part = &calibration->parts[CALIBRATION_CAMERAS];
    printf(
        "seed %d: rms %.4f px, points %.4f px, direction %.4f deg, distance %.4f %%, axis %.4f mm "
        "%.4f deg, chi2 %.2f; %d of %d pictures, %u corners; render %.1f s, calibrate %.1f s\n",
        seed, result->rms_px, e.point_px, e.direction_deg, e.distance_pct, e.axis_mm, e.axis_deg,
        e.chi2, part->pictures, f.n_pictures, result->residuals->len, rendered - start,
        done - rendered);
    for (int c = 0; show && c < n_cameras; c++)
        printf("  cam%d rms %.4f px, %d corners, chi2 %.2f\n", c,
               calibration->cameras[c].residual_rms_px, calibration->cameras[c].points,
               fixture_chi2(&f, calibration, c, fixture_azimuth_rad(&f, &calibration->rig)));
    for (guint i = 0; show && i < part->rejected->len; i++)
        printf("  %s\n", (char *)part->rejected->pdata[i]);
    fixture_close(&f);
}

int main(int argc, char **argv) {
    setvbuf(stdout, NULL, _IOLBF, 0);
    gboolean json = FALSE;
    const GOptionEntry entries[] = {
        {"json", 0, 0, G_OPTION_ARG_NONE, &json, "Print JSON", NULL},
        {"cameras", 0, 0, G_OPTION_ARG_INT, &n_cameras, "Cameras", "N"},
        {"size", 0, 0, G_OPTION_ARG_INT, &size_px, "Pixels across", "N"},
        {"stops", 0, 0, G_OPTION_ARG_INT, &n_stops, "Angles of the turntable", "N"},
        {"seeds", 0, 0, G_OPTION_ARG_INT, &n_seeds, "Worlds", "N"},
        {"part", 0, 0, G_OPTION_ARG_STRING, &only, "cameras or radiometry alone", "PART"},
        {"show", 0, 0, G_OPTION_ARG_NONE, &show, "Tell more", NULL},
        {NULL},
    };
    g_autoptr(GOptionContext) context = g_option_context_new(NULL);
    g_option_context_add_main_entries(context, entries, NULL);
    if (!g_option_context_parse(context, &argc, &argv, NULL))
        return 2;
    for (int seed = 1; seed <= n_seeds && g_strcmp0(only, "radiometry") != 0; seed++)
        run(seed, json);
    if (!only || g_str_equal(only, "radiometry")) {
        g_autofree char *radiometry = bench_radiometry(n_seeds, !json);
        printf("{\"radiometry\":%s}\n", radiometry);
    }
    return 0;
}
