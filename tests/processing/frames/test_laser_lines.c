/* Laser sheets that deviate from the calibration, in simulated sweeps: laser_lines_find() measures
 * them by their lines on the flat face around the sample. */
#include "frames/laser_lines.h"

#include "lib/analytic.h"
#include "lib/test.h"
#include "mdf/mdf.h"

#include <math.h>

#define DEGREE   (G_PI / 180)
#define SIDE     128
#define N_PIXELS (SIDE * SIDE)
#define N_STEPS  100
#define TEXELS   16
#define N_TEXELS (TEXELS * TEXELS)

static const double from_deg = -5, step_deg = 0.1;
static const struct session_grid grid = {TEXELS, TEXELS, 28, 28, 5, 5};
/* The face lies at 1 mm, the sample at 2 mm in a hole that is a bit larger than its texels. */
static const struct laser_reference flat = {1, 0.01, {30, 32}, 5, 40};
static const double sample_mm = 2;

struct sweep {
    struct pinhole pinhole;
    struct line_laser laser;
    double turntable, arc;
    double slip, roll; /* rad */
    int slips_at;      /* frame */
    double noise;      /* frames, standard deviation */
    double astray;     /* share of pixels with a random peak */
    double uneven;     /* of the sheet from frame to frame: rad, up and down */
    gboolean glow;     /* in two runs of frames the line is hidden, and light thrown elsewhere seen:
                          thrown() */
    float peak[N_PIXELS], width[N_PIXELS], intensity[N_PIXELS];
    struct laser_lines lines; /* what find() found */
};

typedef struct sweep TestSweep;
static void free_sweep(struct sweep *sweep) {
    laser_lines_clear(&sweep->lines);
    g_free(sweep);
}
G_DEFINE_AUTOPTR_CLEANUP_FUNC(TestSweep, free_sweep)

static struct sweep *new_sweep(void) {
    struct sweep *sweep = g_new0(struct sweep, 1);
    sweep->pinhole = (struct pinhole){SIDE, SIDE, 40 * DEGREE, 650, 1200};
    sweep->laser = (struct line_laser){45 * DEGREE, 480};
    sweep->turntable = 20 * DEGREE;
    sweep->arc = 115 * DEGREE;
    sweep->noise = 0.1;
    return sweep;
}

/* The angle at which the sheet, rolled about its own beam, meets a point. */
static double meets(const struct sweep *sweep, const double *point) {
    double source[3], axis[3] = {-sin(sweep->arc), cos(sweep->arc), 0};
    line_laser_position(&sweep->laser, sweep->arc, source);
    const double way[3] = {point[0] - source[0], point[1] - source[1], point[2] - source[2]};
    const double aside = analytic_dot(way, axis),
                 range = sqrt(analytic_dot(way, way) - aside * aside);
    return line_laser_sweep(&sweep->laser, sweep->arc, point) -
           asin(aside * tan(sweep->roll) / range);
}

/* Where a ray meets the sample or what lies around, in the rig frame. */
static void hit(const struct sweep *sweep, const double *eye, const double *ray, double *ret) {
    double at[3];
    for (int k = 0; k < 2; k++) {
        const double t = ((k ? flat.plane_mm : sample_mm) - eye[2]) / ray[2];
        for (int i = 0; i < 3; i++)
            ret[i] = eye[i] + t * ray[i];
        analytic_turn(ret, -sweep->turntable, at);
        if (fabs(at[0]) < 14.5 && fabs(at[1]) < 14.5)
            return;
    }
}

static double normal_deviate(GRand *random) {
    double sum = -6;
    for (int i = 0; i < 12; i++)
        sum += g_rand_double(random);
    return sum;
}

/* By how much the sheet has turned too far in a frame, in rad. */
static double turned(const struct sweep *sweep, int frame) {
    return sweep->uneven * (frame * 7 % 5 - 2) / 2;
}

/* In frames 20 to 23 and 74 to 77 the line is hidden; instead they show light where the line is
 * 40 frames later (earlier). */
static double thrown(double peak) {
    const int frame = (int)lround(peak);
    if ((frame >= 20 && frame < 24) || (frame >= 74 && frame < 78))
        return -100;
    if (frame >= 60 && frame < 64)
        return peak - 40;
    return frame >= 34 && frame < 38 ? peak + 40 : peak;
}

static void shoot(struct sweep *sweep) {
    GRand *random = g_rand_new_with_seed(11);
    for (int i = 0; i < N_PIXELS; i++) {
        double point[3], eye[3], ray[3];
        pinhole_eye(&sweep->pinhole, eye);
        const int row = i / SIDE, column = i % SIDE;
        pinhole_ray(&sweep->pinhole, column, row, ray);
        hit(sweep, eye, ray, point);
        const double at = meets(sweep, point) / DEGREE;
        double peak = (at - from_deg) / step_deg, slipped = peak - sweep->slip / DEGREE / step_deg;
        if (slipped >= sweep->slips_at)
            peak = slipped;
        else if (peak > sweep->slips_at - 1)
            peak = -100; /* the sheet leaps over it */
        peak -= turned(sweep, (int)lround(peak)) / DEGREE / step_deg;
        peak = sweep->glow ? thrown(peak) : peak;
        peak += sweep->noise * normal_deviate(random);
        if (g_rand_double(random) < sweep->astray)
            peak = g_rand_double_range(random, 1, N_STEPS - 2);
        sweep->peak[i] = peak > 0 && peak < N_STEPS - 1 ? (float)peak : -1;
        sweep->width[i] = 1.5F;
        sweep->intensity[i] = 500;
    }
    g_rand_free(random);
}

static struct rig rig_of(const struct sweep *sweep) {
    struct rig rig = {.n_cameras = 1, .n_lasers = 1};
    rig.cameras[0] = pinhole_to_rig(&sweep->pinhole, "cam");
    rig.lasers[0] = line_laser_to_rig(&sweep->laser, "laser");
    return rig;
}

static struct laser_sweep seen_by(const struct sweep *sweep, const struct rig *rig) {
    return (struct laser_sweep){.laser = &rig->lasers[0],
                                .arc_rad = sweep->arc,
                                .from_rad = from_deg * DEGREE,
                                .step_rad = step_deg * DEGREE,
                                .peak = sweep->peak,
                                .width = sweep->width,
                                .intensity = sweep->intensity};
}

static const struct laser_lines *find(struct sweep *sweep, const struct laser_reference *reference,
                                      const struct laser_known *known) {
    const struct rig rig = rig_of(sweep);
    g_autoptr(LaserRegion) region =
        laser_region_new(&rig, &rig.cameras[0], sweep->turntable, reference);
    const struct laser_sweep seen = seen_by(sweep, &rig);
    laser_lines_clear(&sweep->lines);
    laser_lines_find(region, &seen, N_STEPS, known, &sweep->lines);
    return &sweep->lines;
}

static const struct laser_known well = {2e-4, 2e-4};

/* Without errors no disagreement is reported, and the correction is far below the noise. */
TEST(agrees) {
    g_autoptr(TestSweep) sweep = new_sweep();
    shoot(sweep);
    const struct laser_lines *lines = find(sweep, &flat, &well);
    g_assert_nonnull(lines->turn_rad);
    g_assert_false(lines->disagrees);
    g_assert_cmpint(lines->pixels, >, 1000);
    g_assert_cmpint(lines->frames, >, N_STEPS * 2 / 3);
    g_assert_cmpfloat(fabs(lines->offset_rad), <, 4 * lines->offset_error_rad);
    g_assert_cmpfloat(fabs(lines->roll_seen_rad), <, 4 * lines->roll_error_rad);
    for (int k = 0; k < N_STEPS; k++)
        g_assert_cmpfloat(fabsf(lines->turn_rad[k]), <, 0.02 * step_deg * DEGREE);
    /* A tenth of a frame is 0.01°: 0.084 mm at 480 mm. */
    g_assert_cmpfloat_with_epsilon(lines->scatter_mm, 0.084, 0.015);
}

/* The standard error predicts the scatter of the errors over sweeps with different noise. */
TEST(error) {
    double squares = 0;
    const int n = 30;
    for (int i = 0; i < n; i++) {
        g_autoptr(TestSweep) sweep = new_sweep();
        shoot(sweep);
        GRand *random = g_rand_new_with_seed((guint32)i + 100);
        for (int k = 0; k < N_PIXELS; k++)
            sweep->peak[k] += sweep->peak[k] > 0 ? (float)(0.2 * normal_deviate(random)) : 0;
        g_rand_free(random);
        const struct laser_reference exact = {1, 0, {30, 32}, 5, 40};
        const struct laser_lines *lines = find(sweep, &exact, &well);
        squares += pow(lines->offset_rad / lines->offset_error_rad, 2);
    }
    g_test_message("chi² %.2f", squares / n);
    g_assert_cmpfloat(squares / n, >, 0.3);
    g_assert_cmpfloat(squares / n, <, 2);
}

struct merged {
    double worst;
    int missing;
};

/* Errors of the sample's texels, with planes from lines, or (NULL) from the calibration only. */
static struct merged measure(const struct sweep *sweep, const struct laser_lines *lines) {
    const struct rig rig = rig_of(sweep);
    g_autoptr(MdfView) view = mdf_view_new(&rig.cameras[0], sweep->turntable, &grid);
    struct laser_sweep seen = seen_by(sweep, &rig);
    seen.lines = lines;
    mdf_view_add(view, &seen);
    float mm[N_TEXELS], n[N_TEXELS], s[N_TEXELS];
    mdf_view_merge(view, mm, n, s);
    struct merged merged = {0};
    for (int i = 0; i < N_TEXELS; i++) {
        const int row = i / TEXELS, column = i % TEXELS;
        double p[3] = {-14 + (column + 0.5) * 1.75, 14 - (row + 0.5) * 1.75, 5};
        double eye[3], point[3];
        analytic_turn(p, sweep->turntable, p);
        pinhole_eye(&sweep->pinhole, eye);
        const double way[3] = {p[0] - eye[0], p[1] - eye[1], p[2] - eye[2]};
        hit(sweep, eye, way, point);
        const double expected = sqrt(analytic_dot(way, way)) * (p[2] - point[2]) / (eye[2] - p[2]);
        analytic_turn(point, -sweep->turntable, p);
        if (MAX(fabs(p[0]), fabs(p[1])) > 12)
            continue; /* its pixels see the sample's edge */
        if (mm[i] < 0)
            merged.missing++;
        else
            merged.worst = MAX(merged.worst, fabs((double)mm[i] - expected));
    }
    return merged;
}

/* The sweep has slipped on its shaft, from the first frame or from the middle on, or the sheet is
 * rolled: with the lines the surface comes out right, with the calibration alone it does not. */
TEST(wrong) {
    static const struct {
        double slip_deg, roll_deg;
        int at;
    } wrongs[] = {{0.3, 0, 0}, {-0.2, 0, 0},   {0.3, 0, N_STEPS / 2}, {0.3, 0, N_STEPS * 7 / 20},
                  {0, 0.6, 0}, {-0.2, -0.5, 0}};
    for (guint i = 0; i < G_N_ELEMENTS(wrongs); i++) {
        g_autoptr(TestSweep) sweep = new_sweep();
        sweep->noise = 0.02;
        sweep->slip = wrongs[i].slip_deg * DEGREE;
        sweep->slips_at = wrongs[i].at;
        sweep->roll = wrongs[i].roll_deg * DEGREE;
        shoot(sweep);
        const struct laser_lines *lines = find(sweep, &flat, &well);
        g_assert_nonnull(lines->turn_rad);
        g_assert_true(lines->disagrees);
        const struct merged by_lines = measure(sweep, lines), alone = measure(sweep, NULL);
        g_test_message("%u: worst %.3f mm by lines, %.3f by calibration; roll %.4f°", i,
                       by_lines.worst, alone.worst, lines->roll_rad / DEGREE);
        g_assert_cmpint(by_lines.missing, <=, N_TEXELS / 6); /* what the slip leaves out */
        g_assert_cmpfloat(by_lines.worst, <, 0.15);
        g_assert_true(alone.missing > N_TEXELS / 2 || alone.worst > 4 * by_lines.worst);
        g_assert_cmpfloat_with_epsilon(lines->roll_rad, wrongs[i].roll_deg * DEGREE, 0.01 * DEGREE);
    }
}

/* Frames in a row that show only light thrown on the face are not taken for sheets that leapt; nor
 * are frames without a line. */
TEST(glow) {
    g_autoptr(TestSweep) sweep = new_sweep();
    sweep->glow = TRUE;
    shoot(sweep);
    const struct laser_lines *lines = find(sweep, &flat, &well);
    g_assert_nonnull(lines->turn_rad);
    g_assert_false(lines->disagrees);
    g_assert_cmpint(lines->frames_off, ==, 0);
    g_assert_cmpfloat(fabs(lines->offset_rad), <, 4 * lines->offset_error_rad);
    for (int k = 0; k < N_STEPS; k++)
        g_assert_cmpfloat(fabsf(lines->turn_rad[k]), <, 0.02 * step_deg * DEGREE);
}

/* An axis that steps unevenly is followed frame by frame. */
TEST(uneven) {
    g_autoptr(TestSweep) sweep = new_sweep();
    double squares = 0, left = 0;
    int n = 0;
    sweep->noise = 0.05;
    sweep->uneven = 0.02 * DEGREE;
    shoot(sweep);
    const struct laser_lines *lines = find(sweep, &flat, &well);
    g_assert_nonnull(lines->turn_rad);
    for (int k = 25; k < 75; k++, n++) {
        squares += pow(turned(sweep, k), 2);
        left += pow(turned(sweep, k) - (double)lines->turn_rad[k], 2);
    }
    g_test_message("uneven by %.5f°, %.5f° left", sqrt(squares / n) / DEGREE,
                   sqrt(left / n) / DEGREE);
    g_assert_cmpfloat(left, <, 0.1 * squares);
}

/* Both are weighted by their errors: where the face's height is hardly known, the calibration
 * counts. */
TEST(weights) {
    static const struct laser_reference vague = {1, 1.0, {30, 32}, 5, 40};
    static const struct laser_known hardly = {0.02, 0.02};
    g_autoptr(TestSweep) sweep = new_sweep();
    sweep->slip = 0.02 * DEGREE;
    shoot(sweep);
    const struct laser_lines *lines = find(sweep, &vague, &well);
    g_assert_false(lines->disagrees);
    g_assert_cmpfloat(fabsf(lines->turn_rad[N_STEPS / 2]), <, 0.004 * DEGREE);
    find(sweep, &flat, &hardly);
    g_assert_false(lines->disagrees);
    g_assert_cmpfloat_with_epsilon(lines->turn_rad[N_STEPS / 2], 0.02 * DEGREE, 0.003 * DEGREE);
}

/* A fifth of the pixels have a random peak. */
TEST(astray) {
    g_autoptr(TestSweep) sweep = new_sweep();
    sweep->astray = 0.2;
    sweep->slip = 0.3 * DEGREE;
    shoot(sweep);
    const struct laser_lines *lines = find(sweep, &flat, &well);
    g_assert_true(lines->disagrees);
    for (int k = 10; k < N_STEPS - 10; k++)
        g_assert_cmpfloat_with_epsilon(lines->turn_rad[k], 0.3 * DEGREE, 0.01 * DEGREE);
}

/* Without a face, without light, or with peaks that are no times, only the calibration is used. */
TEST(nothing) {
    static const struct laser_reference none = {0}, hole = {1, 0.01, {80, 80}, 5, 40};
    static const float bad[] = {-1, NAN, INFINITY, -INFINITY, 1e30F};
    g_autoptr(TestSweep) sweep = new_sweep();
    const struct rig rig = rig_of(sweep);
    struct laser_sweep seen = seen_by(sweep, &rig);
    shoot(sweep);
    const struct laser_lines *lines = find(sweep, &none, &well);
    g_assert_null(lines->turn_rad);
    find(sweep, &hole, &well);
    g_assert_null(lines->turn_rad);
    const struct vec3 eye_mm = vec3(30, -20, 600), down = vec3(0, 0, -1);
    struct laser_sheets sheets = laser_lines_sheets(&seen);
    const double calibrated_mm = laser_lines_range_mm(&sheets, 7.5, eye_mm, down, 0.01);
    const struct rig_plane sheet =
        rig_laser_sheet(NULL, &rig.lasers[0], sweep->arc, (from_deg + 7.5 * step_deg) * DEGREE);
    g_assert_cmpfloat_with_epsilon(
        calibrated_mm,
        (sheet.offset_mm - vec3_dot(sheet.normal, eye_mm)) / vec3_dot(sheet.normal, down), 1e-9);
    seen.lines = lines;
    sheets = laser_lines_sheets(&seen);
    g_assert_cmpfloat(laser_lines_range_mm(&sheets, 7.5, eye_mm, down, 0.01), ==, calibrated_mm);
    for (guint k = 0; k < G_N_ELEMENTS(bad); k++) {
        for (int i = 0; i < N_PIXELS; i++)
            sweep->peak[i] = bad[k];
        find(sweep, &flat, &well);
        g_assert_null(lines->turn_rad);
    }
}

/* Pixels that see the sample, its side, or a mark do not belong to the region. */
TEST(region) {
    g_autoptr(TestSweep) sweep = new_sweep();
    struct rig rig = rig_of(sweep);
    g_autoptr(LaserRegion) all = laser_region_new(&rig, &rig.cameras[0], 0, &flat);
    rig.n_fiducials = 1;
    rig.fiducials[0] = (struct rig_fiducial){.centre_mm = vec3(0, 22, 1), .radius_mm = 2};
    g_autoptr(LaserRegion) marked = laser_region_new(&rig, &rig.cameras[0], 0, &flat);
    const int mark = laser_region_pixels(all) - laser_region_pixels(marked);
    /* 3.5 mm in radius with what is kept off, 1200/650 px a mm, and seen from 40°. */
    const double px = G_PI * 3.5 * 3.5 * pow(1200.0 / 650, 2) * cos(40 * DEGREE);
    g_assert_cmpfloat_with_epsilon(mark, px, 0.15 * px);
    /* The box of 4 mm hides 4 · tan 40° of the face behind it, as wide as it is. */
    const struct laser_reference low = {1, 0.01, {30, 32}, 1, 40};
    g_autoptr(LaserRegion) whole =
        laser_region_new(&rig, &rig.cameras[0], 0, &low); /* marked, too */
    const double hidden = 4 * tan(40 * DEGREE) * 32 * pow(1200.0 / 650, 2) * cos(40 * DEGREE);
    g_assert_cmpfloat_with_epsilon(laser_region_pixels(whole) - laser_region_pixels(marked), hidden,
                                   0.15 * hidden);
}

/* A rig of half and of ten times the size: as many pixels show the face next to a fiducial. */
TEST(region_scale) {
    static const double scales[] = {1, 0.5, 10};
    g_autoptr(TestSweep) sweep = new_sweep();
    int first = 0;
    for (guint i = 0; i < G_N_ELEMENTS(scales); i++) {
        const double k = scales[i];
        struct rig rig = rig_of(sweep);
        struct laser_reference scaled = flat;
        scaled.plane_mm *= k;
        scaled.hole_mm[0] *= k;
        scaled.hole_mm[1] *= k;
        scaled.top_mm *= k;
        scaled.radius_mm *= k;
        struct vec3 *shift = &rig.cameras[0].translation_mm;
        *shift = vec3_scale(*shift, k);
        rig.n_fiducials = 1;
        rig.fiducials[0] =
            (struct rig_fiducial){.centre_mm = vec3(0, 22 * k, k), .radius_mm = 2 * k};
        g_autoptr(LaserRegion) region = laser_region_new(&rig, &rig.cameras[0], 0, &scaled);
        const int pixels = laser_region_pixels(region);
        if (i == 0)
            first = pixels;
        g_test_message("scale %g: %d pixels", k, pixels);
        g_assert_cmpint(abs(pixels - first), <=, 4); /* those on a border */
    }
    g_assert_cmpint(first, >, 1000);
}

TEST(text) {
    static const char *const bad[] = {"",           "1;2;3;4",    "1;2;3;4;5;6", "1;2;3;4;nan",
                                      "a;2;3;4;5",  "1;2;3;-4;5", "1;2;;4;5",    "1;2;3;4;inf",
                                      "1 2;2;3;4;5"};
    struct laser_reference back;
    g_autofree char *text = laser_reference_to_text(&flat);
    g_assert_true(laser_reference_from_text(text, &back));
    g_assert_cmpfloat(back.plane_mm, ==, flat.plane_mm);
    g_assert_cmpfloat(back.plane_error_mm, ==, flat.plane_error_mm);
    g_assert_cmpfloat(back.hole_mm[1], ==, flat.hole_mm[1]);
    g_assert_cmpfloat(back.radius_mm, ==, flat.radius_mm);
    for (guint i = 0; i < G_N_ELEMENTS(bad); i++)
        g_assert_false(laser_reference_from_text(bad[i], &back));
    g_assert_false(laser_reference_from_text(NULL, &back));
}
