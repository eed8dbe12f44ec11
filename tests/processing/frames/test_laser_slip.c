/* A sweep axis that has slipped, in the simulated world: the line on the turntable next to a weave
 * shows the slip, and the surface is found at its true place. */
#include "base/robust.h"
#include "capture/intake/radiance.h"
#include "frames/laser_pictures.h"
#include "frames/sweep.h"
#include "lib/test.h"
#include "lib/two_lasers.h"
#include "mdf/mdf.h"
#include "world/truth.h"

#define DEGREE    (G_PI / 180)
#define SIDE      144
#define TEXELS    24
#define N_TEXELS  (TEXELS * TEXELS)
#define N_STEPS   64
#define POSITIONS 8
#define REACH_MM  17
#define SLIP_DEG  0.25

#define OFFSET_ERROR_MM 0.1

static const struct session_grid grid = {TEXELS, TEXELS, 26, 26, 2.2, 2.2};
static const struct laser_reference table = {0, 0.01, {33, 33}, 2.2, 60};
static const double turntable_deg = 20;

static World *new_world(void) {
    return two_lasers_world(SIDE, 0.02, "turntable_albedo = 0.04\n",
                            "kind = weave\nwidth_mm = 31\nheight_mm = 31\nrelief_mm = 1.2\n"
                            "period_mm = 6.25\n");
}

struct planes {
    float peak[SIDE * SIDE], width[SIDE * SIDE], intensity[SIDE * SIDE];
};

/* The sheet passes REACH_MM on both sides of the middle; the first laser has slipped.
 * ret_published: the lines as the paper finds them, in each picture. */
static struct laser_sweep take(World *world, const struct rig *rig, int position,
                               const LaserRegion *region, struct planes *planes,
                               struct laser_lines *ret_published) {
    const int laser = position % 2;
    const double arc_deg = 20 + 45.0 * position;
    const double half = atan(REACH_MM / 480.0) * (laser ? 0.55 : 0.9);
    struct laser_sweep sweep = {.laser = &rig->lasers[laser],
                                .arc_rad = arc_deg * DEGREE,
                                .from_rad = -half,
                                .step_rad = 2 * half / (N_STEPS - 1),
                                .peak = planes->peak,
                                .width = planes->width,
                                .intensity = planes->intensity};
    struct world_sensor sensor;
    world_sensor(world, 0, &sensor);
    g_autoptr(Sweep) frames = sweep_new(SIDE, SIDE, N_STEPS, radiance_saturation(sensor.bits));
    g_autofree guint16 *pixels = g_new(guint16, SIDE * SIDE);
    g_autoptr(LaserPictures) pictures = laser_pictures_new(region, &sweep, SIDE, SIDE, N_STEPS, 12);
    struct world_state state = {.turntable_deg = turntable_deg, .arc_deg = arc_deg};
    state.laser_on[laser] = TRUE;
    for (int k = 0; k < N_STEPS; k++) {
        state.sweep_deg[laser] =
            (sweep.from_rad + k * sweep.step_rad) / DEGREE + (laser ? 0 : SLIP_DEG);
        world_expose(world, 0, &state, 4000, 0, (guint64)position * N_STEPS + (guint64)k + 1,
                     pixels);
        sweep_add(frames, pixels);
        laser_pictures_add(pictures, pixels);
    }
    laser_pictures_finish(pictures, ret_published);
    sweep_finish(frames, 12, &(struct sweep_pulses){planes->peak, planes->width, planes->intensity},
                 NULL);
    return sweep;
}

/* RMS in mm, off edges; coverage of what a laser lights. */
static double compare(World *world, const MdfView *view, double *ret_coverage) {
    const struct truth_grid at = {TEXELS, TEXELS, grid.width_mm, grid.height_mm, grid.reference_mm};
    float mm[N_TEXELS], n[N_TEXELS], s[N_TEXELS], truth[N_TEXELS];
    guint8 edge[N_TEXELS];
    double squares = 0;
    int measured = 0, all = 0;
    mdf_view_merge(view, mm, n, s);
    truth_mdf(world, 0, turntable_deg, &at, truth, edge);
    for (int i = 0; i < N_TEXELS; i++) {
        all += !edge[i];
        if (edge[i] || mm[i] < 0)
            continue;
        squares += pow((double)(mm[i] - truth[i]), 2);
        measured++;
    }
    *ret_coverage = (double)measured / all;
    return sqrt(squares / measured);
}

/* Squared error of a sheet's angle, mean over the frames that have a line, rad². */
static double sheet_error(const struct laser_lines *lines, double slip) {
    double squares = 0;
    for (int k = 0; k < N_STEPS; k++)
        squares += pow((double)lines->turn_rad[k] - slip, 2) / N_STEPS;
    return squares;
}

/* Returns the median standard error of the distances. */
static double median_error(const MdfView *view) {
    float mm[N_TEXELS], n[N_TEXELS], error_mm[N_TEXELS];
    double known[N_TEXELS];
    int n_known = 0;
    mdf_view_merge(view, mm, n, error_mm);
    for (int i = 0; i < N_TEXELS; i++)
        if (mm[i] >= 0 && error_mm[i] >= 0)
            known[n_known++] = (double)error_mm[i];
    return robust_median(known, n_known);
}

TEST(slipped) {
    static const struct laser_known known = {1e-4, 1e-4};
    static const struct rig_sheet_errors errors = {.covariance[RIG_SHEET_OFFSET][RIG_SHEET_OFFSET] =
                                                       OFFSET_ERROR_MM * OFFSET_ERROR_MM};
    g_autoptr(World) world = new_world();
    const struct rig rig = two_lasers_rig(SIDE);
    g_autoptr(LaserRegion) region =
        laser_region_new(&rig, &rig.cameras[0], turntable_deg * DEGREE, &table);
    g_autoptr(MdfView) with = mdf_view_new(&rig.cameras[0], turntable_deg * DEGREE, &grid);
    g_autoptr(MdfView) without = mdf_view_new(&rig.cameras[0], turntable_deg * DEGREE, &grid);
    g_autoptr(MdfView) published = mdf_view_new(&rig.cameras[0], turntable_deg * DEGREE, &grid);
    g_autofree struct planes *planes = g_new(struct planes, 1);
    double squares = 0, published_squares = 0;
    for (int position = 0; position < POSITIONS; position++) {
        struct laser_lines lines, in_pictures;
        struct laser_sweep sweep = take(world, &rig, position, region, planes, &in_pictures);
        const double slip = position % 2 ? 0 : SLIP_DEG * DEGREE;
        laser_lines_find(region, &sweep, N_STEPS, &known, &lines);
        g_test_message("position %d: %d pixels in %d frames, %.4f ± %.4f°, roll %.4f ± %.4f°, "
                       "%.3f mm",
                       position, lines.pixels, lines.frames, lines.offset_rad / DEGREE,
                       lines.offset_error_rad / DEGREE, lines.roll_seen_rad / DEGREE,
                       lines.roll_error_rad / DEGREE, lines.scatter_mm);
        g_assert_nonnull(lines.turn_rad);
        g_assert_true(lines.disagrees == (slip > 0));
        g_assert_cmpfloat_with_epsilon(lines.offset_rad, slip, 0.01 * DEGREE);
        mdf_view_add(without, &sweep);
        sweep.lines = &lines;
        mdf_view_add(with, &sweep);
        g_assert_nonnull(in_pictures.turn_rad);
        g_test_message("  in pictures: %d candidates in %d frames, %.4f°, roll %.4f°",
                       in_pictures.pixels, in_pictures.frames, in_pictures.offset_rad / DEGREE,
                       in_pictures.roll_rad / DEGREE);
        g_assert_cmpfloat_with_epsilon(in_pictures.offset_rad, slip, 0.05 * DEGREE);
        sweep.lines = &in_pictures;
        sweep.errors = &errors;
        mdf_view_add(published, &sweep);
        squares += sheet_error(&lines, slip) / POSITIONS;
        published_squares += sheet_error(&in_pictures, slip) / POSITIONS;
        laser_lines_clear(&in_pictures);
        laser_lines_clear(&lines);
    }
    double coverage, bare_coverage, published_coverage;
    const double rms = compare(world, with, &coverage);
    const double bare = compare(world, without, &bare_coverage);
    g_test_message("RMS %.4f mm by lines (%.3f covered), %.4f by calibration (%.3f)", rms, coverage,
                   bare, bare_coverage);
    const double in_pictures = compare(world, published, &published_coverage);
    g_test_message(
        "RMS %.4f mm by lines found in pictures (%.3f); sheets %.5f°, by peak times %.5f°",
        in_pictures, published_coverage, sqrt(published_squares) / DEGREE, sqrt(squares) / DEGREE);
    /* Lines in pictures have no known error, so error bars keep the calibration's: 0.1 mm for each
     * of two lasers, more along a slanting ray. */
    g_assert_cmpfloat(median_error(published), >, OFFSET_ERROR_MM / sqrt(2));
    g_assert_cmpfloat(squares, <, published_squares);
    g_assert_cmpfloat(in_pictures, <, bare / 2);
    g_assert_cmpfloat(coverage, >, 0.95);
    g_assert_cmpfloat(rms, <, 0.06);
    g_assert_cmpfloat(bare, >, 5 * rms);
}

AFTER_TESTS {
    world_fixture_clean();
}
