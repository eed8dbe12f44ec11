#include "calibration_parts.h"

#include "bench.h"
#include "lib/grey_fixture.h"

struct figures {
    double worst_pct, worst_uncorrected_pct; /* of the grey scale */
    struct grey_chi2 chi2;
    double quality; /* largest */
    int nudges, nudges_noticed, slips, slips_noticed, alarms;
    double calibrate_s, cpu_s; /* of all: tile to calibration; everything */
};

/* Once more without the capture, for the time it takes. */
static double calibrate_seconds(const char *folder) {
    g_autofree char *path = g_build_filename(folder, "tile.session", NULL);
    g_autoptr(Session) session = session_open(path, SESSION_READ, NULL);
    g_autofree char *text = session_text(session, "calibration.conf", NULL);
    g_autoptr(Calibration) calibration = calibration_from_text(text, path, NULL);
    struct tile_result result;
    double start = bench_cpu_s();
    g_assert_true(tile_session(session, calibration, &grey_tile, &result, NULL));
    return bench_cpu_s() - start;
}

static gboolean notices(int seed, const char *camera, const char *turntable, const char *says) {
    enum capture_state state;
    g_autofree char *told = grey_pause(seed, camera, turntable, &state);
    return state == CAPTURE_PAUSED && strstr(told, says) != NULL;
}

static void measure_check(int seed, struct figures *to) {
    static const char *const nudges[] = {"turn_deg=0.1;0;0", "turn_deg=-0.1;0;0",
                                         "turn_deg=0;0.1;0", "turn_deg=0;-0.1;0"};
    static const char *const slips[] = {"fault_slip_deg=0.1\n", "fault_slip_deg=-0.1\n"};
    for (gsize i = 0; i < G_N_ELEMENTS(nudges); i++, to->nudges++)
        to->nudges_noticed += notices(seed, nudges[i], "", "camera cam1 is turned");
    for (gsize i = 0; i < G_N_ELEMENTS(slips); i++, to->slips++)
        to->slips_noticed += notices(seed, NULL, slips[i], "the turntable has slipped");
    to->alarms += notices(seed, NULL, "", "moved");
}

void bench_radiometry(int n_seeds) {
    struct figures f = {0};
    double start = bench_cpu_s();
    bench_begin_list("each");
    for (int seed = 1; seed <= n_seeds; seed++) {
        double corrected = 100 * grey_error(seed, TRUE);
        double uncorrected = 100 * grey_error(seed, FALSE);
        f.worst_pct = MAX(f.worst_pct, corrected);
        f.worst_uncorrected_pct = MAX(f.worst_uncorrected_pct, uncorrected);
        g_autofree char *folder = grey_folder();
        g_autofree char *path = g_build_filename(folder, "calibration.conf", NULL);
        struct tile_result result;
        grey_calibrate(folder, seed, &result);
        g_autoptr(Calibration) found = calibration_read(path, NULL);
        grey_compare(found, &f.chi2);
        f.quality = MAX(f.quality, result.quality);
        f.calibrate_s += calibrate_seconds(folder);
        radiometry_rig_remove(folder);
        measure_check(seed, &f);
        bench_row(NULL,
                  "%d{seed} %.3f{grey_pct} %.1f{grey_uncorrected_pct} %.2f{chi_square} "
                  "%d{chi_square_of} %d{nudges_noticed} %d{nudges} %d{slips_noticed} %d{slips} "
                  "%d{false_alarms}",
                  seed, corrected, uncorrected, f.chi2.sum / f.chi2.n, f.chi2.n, f.nudges_noticed,
                  f.nudges, f.slips_noticed, f.slips, f.alarms);
    }
    bench_end();
    f.cpu_s = bench_cpu_s() - start;
    bench_put("%d{seeds} %.4f{grey_worst_pct} %.3f{grey_worst_uncorrected_pct} %.3f{chi_square} "
              "%d{chi_square_of} %.3f{tile_quality_worst} %d{nudges_noticed} %d{nudges} "
              "%d{slips_noticed} %d{slips} %d{false_alarms} %.3f{calibrate_s} %.1f{cpu_s}",
              n_seeds, f.worst_pct, f.worst_uncorrected_pct, f.chi2.sum / f.chi2.n, f.chi2.n,
              f.quality, f.nudges_noticed, f.nudges, f.slips_noticed, f.slips, f.alarms,
              f.calibrate_s / n_seeds, f.cpu_s);
}
