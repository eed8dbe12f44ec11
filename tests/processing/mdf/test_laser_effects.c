/* A bent laser sheet, speckle, and a material that light enters, in the simulated world: everything
 * from the calibration with plates to the MDF of a sample is compared with the truth. */
#include "capture/intake/radiance.h"
#include "frames/sweep.h"
#include "laser/laser.h"
#include "lib/deviate.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "lib/world_fixture.h"
#include "mdf/mdf.h"
#include "mdf/mdf_lines.h"
#include "world/truth.h"

#include <string.h>

#define DEGREE   (G_PI / 180)
#define SIDE     96
#define FOCAL_PX 780.0 /* 80 mm in the picture */
#define TEXELS   20
#define N_TEXELS (TEXELS * TEXELS)
#define N_STEPS  56
#define LASERS   2
#define CAMERAS  2
#define ARCS     3 /* angles of the arc on a plate, and on the sample */
#define FAR_MM   480.0
#define EYE_MM   650.0

static const struct session_grid grid = {TEXELS, TEXELS, 60, 60, 3.0, 2.6};
static const double heights_mm[2] = {1, 16};
static const double camera_deg[CAMERAS] = {25, 50}, laser_deg[LASERS] = {35, 60};

struct effects {
    const char *world, *laser; /* further lines of these sections */
};

static World *new_world(const struct effects *effects, const char *sample) {
    g_autoptr(GString) text = g_string_new(NULL);
    g_string_append_printf(text,
                           "[world]\nseed=3\ngather_rays=0\nsupersample=2\ncache_mb=200\n"
                           "laser_error_mm=0.4\nlaser_error_deg=0.2\narc_tilt_error_deg=0.05\n%s",
                           effects->world);
    for (int i = 0; i < CAMERAS; i++)
        g_string_append_printf(text,
                               "[camera c%d]\ntheta_deg=%g\nwidth=%d\nheight=%d\nfocal_px=%g\n"
                               "blur_px=0.4\ncfa=mono\n",
                               i, camera_deg[i], SIDE, SIDE, FOCAL_PX);
    for (int i = 0; i < LASERS; i++)
        g_string_append_printf(text, "[laser s%d]\ntheta_deg=%g\npower_w=0.2\nwidth_mm=2.4\n%s", i,
                               laser_deg[i], effects->laser);
    g_string_append_printf(text, "[sample]\n%s", sample);
    return world_fixture_new(text->str);
}

static const double exact[CAMERAS] = {0};

/* Cameras as they are but for a random offset, and nominal lasers. */
static struct rig new_rig(GRand *rand, const double camera_px[CAMERAS]) {
    struct rig rig = {.n_cameras = CAMERAS, .n_lasers = LASERS};
    for (int i = 0; i < CAMERAS; i++) {
        struct rig_camera *c = &rig.cameras[i];
        *c = (struct rig_camera){
            .width = SIDE, .height = SIDE, .fx_px = FOCAL_PX, .fy_px = FOCAL_PX};
        c->cx_px = (SIDE - 1) / 2.0 + camera_px[i] * deviate_sum(rand);
        c->cy_px = (SIDE - 1) / 2.0 + camera_px[i] * deviate_sum(rand);
        rig_camera_look_at(c, vec3_scale(rig_direction(camera_deg[i] * DEGREE, 0), EYE_MM),
                           vec3(0, 0, 0));
    }
    for (int i = 0; i < LASERS; i++) {
        const struct vec3 out = rig_direction(laser_deg[i] * DEGREE, 0);
        rig.lasers[i] =
            (struct rig_laser){.position_mm = vec3_scale(out, FAR_MM),
                               .axis = vec3(0, 1, 0),
                               .normal = vec3_unit(vec3_cross(vec3(0, 1, 0), vec3_scale(out, -1)))};
        g_snprintf(rig.lasers[i].name, RIG_NAME, "s%d", i);
    }
    return rig;
}

struct planes {
    float peak[SIDE * SIDE], width[SIDE * SIDE], intensity[SIDE * SIDE];
};

static double half_rad(int laser) {
    return atan(38.0 * (laser ? 0.62 : 0.9) / FAR_MM);
}

static double arc_deg(int arc) {
    return 20 + 360.0 / ARCS * arc;
}

static void take(World *world, int camera, int laser, int arc, struct planes *ret) {
    struct world_sensor sensor;
    world_sensor(world, camera, &sensor);
    g_autoptr(Sweep) sweep = sweep_new(SIDE, SIDE, N_STEPS, radiance_saturation(sensor.bits));
    g_autofree guint16 *pixels = g_new(guint16, SIDE * SIDE);
    struct world_state state = {.arc_deg = arc_deg(arc)};
    state.laser_on[laser] = TRUE;
    for (int k = 0; k < N_STEPS; k++) {
        state.sweep_deg[laser] = half_rad(laser) * (2.0 * k / (N_STEPS - 1) - 1) / DEGREE;
        world_expose(world, camera, &state, 4000, 0,
                     (guint64)(((camera * LASERS + laser) * ARCS + arc) * N_STEPS + k + 1), pixels);
        sweep_add(sweep, pixels);
    }
    sweep_finish(sweep, 40, &(struct sweep_pulses){ret->peak, ret->width, ret->intensity}, NULL);
}

/* The sweeps of a plate, or of a sample, by all cameras. */
#define SWEEPS (LASERS * ARCS)
struct album {
    struct planes planes[CAMERAS][LASERS][ARCS];
};

static struct album *shoot(const struct effects *effects, const char *sample, int cameras) {
    g_autoptr(World) world = new_world(effects, sample);
    struct album *album = g_new0(struct album, 1);
    for (int c = 0; c < cameras; c++)
        for (int i = 0; i < SWEEPS; i++)
            take(world, c, i % LASERS, i / LASERS, &album->planes[c][i % LASERS][i / LASERS]);
    return album;
}

static struct album *shoot_plate(const struct effects *effects, double height_mm) {
    g_autofree char *sample = g_strdup_printf(
        "kind=flat\ngrid=2\nwidth_mm=90\nheight_mm=90\nbase_mm=%g\ntop_mm=30\n", height_mm);
    return shoot(effects, sample, CAMERAS);
}

/* first: of the cameras that look on. */
static void calibrate(const struct rig *rig, const struct album *const plates[2], int first,
                      struct laser_result *ret) {
    static const struct laser_arc arc = {0.01, 1};
    static const char *const names[] = {"plate.exr"};
    g_autoptr(GArray) points = g_array_new(FALSE, FALSE, sizeof(struct laser_point));
    for (int i = 0; i < 2 * CAMERAS * SWEEPS; i++) {
        const int plate = i % 2, camera = i / 2 % CAMERAS, laser = i / 2 / CAMERAS % LASERS;
        const int a = i / 2 / CAMERAS / LASERS;
        if (camera < first)
            continue;
        const struct planes *planes = &plates[plate]->planes[camera][laser][a];
        const struct laser_plate_sweep sweep = {.laser = laser,
                                                .camera = camera,
                                                .arc_rad = arc_deg(a) * DEGREE,
                                                .from_rad = -half_rad(laser),
                                                .step_rad = 2 * half_rad(laser) / (N_STEPS - 1),
                                                .plane_mm = heights_mm[plate],
                                                .radius_mm = 40,
                                                .peak = planes->peak,
                                                .width = planes->width,
                                                .most = 400};
        laser_points(rig, &sweep, points);
    }
    ok(laser_fit(rig, (const struct laser_point *)(gpointer)points->data, (int)points->len, &arc,
                 names, ret, ERR));
}

static void tell(const struct laser_result *found) {
    for (int i = 0; i < LASERS; i++)
        g_test_message("laser %d: sheet ± %.4f mm, bend %.5f ± %.5f, RMS %.4f mm, expected %.4f, "
                       "source ± %.2f mm, of the prior %d%d%d%d",
                       i, found->sheet_error_mm[i], found->rig.lasers[i].bend_rad,
                       found->bend_error_rad[i], found->rms_mm[i], found->expected_mm[i],
                       found->source_error_mm[i], found->from_prior[i][0], found->from_prior[i][1],
                       found->from_prior[i][2], found->from_prior[i][3]);
}

/* The MDF of a sample from the first camera. */
struct measured {
    double rms_mm, chi2, beyond; /* off edges; beyond: share of texels beyond 3 σ */
    struct mdf_light light;
};

/* camera_px < 0: without the calibration's errors. */
static void measure(const struct album *album, const char *sample, const struct laser_result *found,
                    double camera_px, struct measured *ret) {
    static const struct effects none = {"", ""};
    const struct truth_grid at = {TEXELS, TEXELS, grid.width_mm, grid.height_mm, grid.reference_mm};
    const double px2[2][2] = {{camera_px * camera_px, 0}, {0, camera_px * camera_px}};
    g_autoptr(World) world = new_world(&none, sample);
    g_autoptr(MdfView) view = mdf_view_new(&found->rig.cameras[0], 0, &grid);
    float mm[N_TEXELS], n[N_TEXELS], s[N_TEXELS], truth[N_TEXELS];
    guint8 edge[N_TEXELS];
    double all = 0;
    if (camera_px > 0)
        mdf_view_set_sight(view, px2);
    for (int i = 0; i < SWEEPS; i++) {
        const int laser = i % LASERS, a = i / LASERS;
        const struct planes *planes = &album->planes[0][laser][a];
        const struct laser_sweep sweep = {.laser = &found->rig.lasers[laser],
                                          .arc = &found->rig.arc,
                                          .arc_rad = arc_deg(a) * DEGREE,
                                          .from_rad = -half_rad(laser),
                                          .step_rad = 2 * half_rad(laser) / (N_STEPS - 1),
                                          .peak = planes->peak,
                                          .width = planes->width,
                                          .intensity = planes->intensity,
                                          .errors = camera_px < 0 ? NULL : &found->sheet[laser],
                                          .line_rad = found->line_rad[laser]};
        mdf_view_add(view, &sweep);
    }
    *ret = (struct measured){0};
    mdf_view_merge(view, mm, n, s);
    mdf_view_light(view, &ret->light);
    truth_mdf(world, 0, 0, &at, truth, edge);
    for (int i = 0; i < N_TEXELS; i++) {
        const double off = (double)(mm[i] - truth[i]);
        if (edge[i] || mm[i] < 0 || truth[i] < 0)
            continue;
        ret->rms_mm += off * off;
        ret->chi2 += pow(off / (double)s[i], 2);
        ret->beyond += fabs(off) > 3 * (double)s[i];
        all++;
    }
    g_assert_cmpfloat(all, >, 0.8 * N_TEXELS);
    ret->rms_mm = sqrt(ret->rms_mm / all);
    ret->chi2 /= all;
    ret->beyond /= all;
    g_test_message("RMS %.4f mm, χ² %.2f, %.1f %% beyond 3 σ; width %.3f, scatter %.3f",
                   ret->rms_mm, ret->chi2, 100 * ret->beyond, ret->light.width, ret->light.scatter);
}

static const struct effects ideal = {"", ""};
static const char smooth[] = "kind=flat\ngrid=2\nwidth_mm=90\nheight_mm=90\nbase_mm=2\n";
static const char rough[] = "kind=weave\nwidth_mm=66\nheight_mm=66\nbase_mm=0.8\nrelief_mm=1.2\n"
                            "period_mm=12\n";
static struct album *plates[2]; /* of ideal light */

/* A bent sheet is found, and the surface is as well known as by a flat one. */
TEST(bent) {
    static const struct effects bent = {"", "sheet_bend_mm=0.1\n"};
    const double bend_rad = 0.1 * FAR_MM / (36 * 36);
    g_autoptr(GRand) rand = g_rand_new_with_seed(1);
    const struct rig rig = new_rig(rand, exact);
    g_autofree struct album *low = shoot_plate(&bent, heights_mm[0]);
    g_autofree struct album *high = shoot_plate(&bent, heights_mm[1]);
    g_autofree struct album *on_bent = shoot(&bent, smooth, 1), *on_flat = shoot(&ideal, smooth, 1);
    struct laser_result of_bent, of_flat;
    struct measured with, flat;
    calibrate(&rig, (const struct album *const[]){low, high}, 0, &of_bent);
    calibrate(&rig, (const struct album *const *)plates, 0, &of_flat);
    tell(&of_bent);
    tell(&of_flat);
    measure(on_bent, smooth, &of_bent, 0, &with);
    measure(on_flat, smooth, &of_flat, 0, &flat);
    for (int i = 0; i < LASERS; i++) {
        g_assert_cmpfloat(of_flat.rig.lasers[i].bend_rad, ==, 0);
        g_assert_cmpfloat(fabs(of_bent.rig.lasers[i].bend_rad - bend_rad), <,
                          4 * of_bent.bend_error_rad[i]);
        g_assert_cmpfloat(of_bent.bend_error_rad[i], <, 0.05 * bend_rad);
        g_assert_cmpfloat(of_bent.rms_mm[i], <, 1.5 * of_bent.expected_mm[i]);
        /* Where a sheet is used it is known far better than its parameters. */
        g_assert_cmpfloat(of_flat.sheet_error_mm[i], <, 0.02);
    }
    g_assert_cmpfloat(with.rms_mm, <, 1.2 * flat.rms_mm);
    g_assert_cmpfloat(with.beyond, <, 0.02);
    laser_result_clear(&of_bent);
    laser_result_clear(&of_flat);
}

/* One camera has calibrated the sheets, and another that is off by some tenths of a pixel looks at
 * the sample: its points are wrong by much more than noise. The error bars with the calibration's
 * errors hold, over several such calibrations. */
TEST(calibration_dominates) {
    enum { ROUNDS = 4 };
    static const double camera_px[CAMERAS] = {0.6, 0.05};
    g_autoptr(GRand) rand = g_rand_new_with_seed(2);
    g_autofree struct album *album = shoot(&ideal, smooth, 1);
    double chi2 = 0, bare = 0;
    for (int i = 0; i < ROUNDS; i++) {
        const struct rig rig = new_rig(rand, camera_px);
        struct laser_result found;
        struct measured with, without;
        calibrate(&rig, (const struct album *const *)plates, 1, &found);
        measure(album, smooth, &found, camera_px[0], &with);
        measure(album, smooth, &found, -1, &without);
        chi2 += with.chi2 / ROUNDS;
        bare += without.chi2 / ROUNDS;
        laser_result_clear(&found);
    }
    g_test_message("χ² %.2f with the calibration's errors, %.2f without", chi2, bare);
    g_assert_cmpfloat(bare, >, 2.5);
    g_assert_cmpfloat(chi2, >, 0.5);
    g_assert_cmpfloat(chi2, <, 2);
}

/* Speckle is told apart from a rough sample, and wide lines have a sentence. */
TEST(light) {
    static const struct {
        struct effects effects;
        const char *says;
    } cases[] = {{{"", ""}, NULL}, {{"speckle_contrast=0.3\n", ""}, "speckle"}};
    g_autofree char *wide = mdf_lines_warning(1.2, 0.03), *fine = mdf_lines_warning(1.05, 0.03);
    g_assert_true(wide && strstr(wide, "enters the material"));
    g_assert_null(fine);
    g_autoptr(GRand) rand = g_rand_new_with_seed(1);
    const struct rig rig = new_rig(rand, exact);
    struct laser_result found;
    calibrate(&rig, (const struct album *const *)plates, 0, &found);
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++)
        for (int k = 0; k < 2; k++) {
            const char *sample = k ? rough : smooth;
            g_autofree struct album *album = shoot(&cases[i].effects, sample, 1);
            struct measured ret;
            g_test_message("%s%s:", cases[i].effects.world, sample);
            measure(album, sample, &found, 0, &ret);
            g_autofree char *said = mdf_lines_warning(ret.light.width, ret.light.scatter);
            g_test_message("%s", said ? said : "nothing said");
            if (cases[i].says)
                g_assert_true(said && strstr(said, cases[i].says));
            else
                g_assert_null(said);
        }
    laser_result_clear(&found);
}

BEFORE_TESTS {
    for (int i = 0; i < 2; i++)
        plates[i] = shoot_plate(&ideal, heights_mm[i]);
}

AFTER_TESTS {
    for (int i = 0; i < 2; i++)
        g_free(plates[i]);
    world_fixture_clean();
}
