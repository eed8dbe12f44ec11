/* A glossy material in the simulated world on which the laser's line saturates the cameras: a
 * second, shorter exposure at each step tells where it was. */
#include "capture/intake/radiance.h"
#include "frames/rectify.h"
#include "frames/sweep.h"
#include "lib/test.h"
#include "lib/two_lasers.h"
#include "mdf/mdf.h"
#include "world/truth.h"

#define DEGREE       (G_PI / 180)
#define SIDE         112
#define N_PIXELS     (SIDE * SIDE)
#define TEXELS       20
#define N_TEXELS     (TEXELS * TEXELS)
#define N_STEPS      56
#define POSITIONS    8
#define REACH_MM     13
#define LONG_US      8000
#define SHORT_US     250
#define THRESHOLD    12
#define SATURATED_DN 3900 /* above black */

static const struct session_grid grid = {TEXELS, TEXELS, 18, 18, 5, 5};
static const double turntable_deg = 20;

static World *new_world(void) {
    return two_lasers_world(
        SIDE, 0.32, "",
        "kind = brushed\nwidth_mm = 30\nheight_mm = 30\nrelief_mm = 0.3\ngloss = 0.45\n"
        "roughness_along = 0.1\nroughness_across = 0.25\n");
}

struct planes {
    float peak[N_PIXELS], width[N_PIXELS], intensity[N_PIXELS];
    float second_peak[N_PIXELS], second_intensity[N_PIXELS];
};

static void finish(const Sweep *sweep, struct planes *planes) {
    const struct sweep_pulses first = {planes->peak, planes->width, planes->intensity};
    const struct sweep_pulses second = {planes->second_peak, NULL, planes->second_intensity};
    sweep_finish(sweep, THRESHOLD, &first, &second);
}

static void expose(World *world, const struct world_state *state, gint64 us, guint64 key,
                   Sweep *sweep) {
    g_autofree guint16 *pixels = g_new(guint16, N_PIXELS);
    world_expose(world, 0, state, us, 0, key, pixels);
    sweep_add(sweep, pixels);
}

/* Errors of the texels that saturated, each position by itself, by the long exposure only and with
 * the short one. */
struct figures {
    double squares[2];
    int n[2], lit;
};

struct truth {
    float mm[N_TEXELS];
    guint8 edge[N_TEXELS], seen[N_TEXELS];
};

/* Whether a pixel next to the texel's middle saturated. */
static void find_saturated(const struct rig *rig, const struct planes *planes, gboolean *ret) {
    for (int i = 0; i < N_TEXELS; i++) {
        const int row = i / TEXELS, column = i % TEXELS;
        const struct vec3 p = rectify_point_mm(&grid, column + 0.5, row + 0.5);
        double x, y;
        ret[i] = FALSE;
        g_assert_true(rig_project(&rig->cameras[0], rig_turn(p, turntable_deg * DEGREE), &x, &y));
        for (int k = 0; k < 4; k++) {
            const int u = (int)x + k % 2, v = (int)y + k / 2;
            ret[i] |= planes->intensity[v * SIDE + u] >= SATURATED_DN;
        }
    }
}

static void compare(const struct rig *rig, const struct laser_sweep *sweep,
                    const struct truth *truth, const gboolean *saturated, int kind,
                    struct figures *ret) {
    g_autoptr(MdfView) view = mdf_view_new(&rig->cameras[0], turntable_deg * DEGREE, &grid);
    float mm[N_TEXELS], n[N_TEXELS], s[N_TEXELS];
    mdf_view_add(view, sweep);
    mdf_view_merge(view, mm, n, s);
    for (int i = 0; i < N_TEXELS; i++) {
        if (!saturated[i] || truth->edge[i] || !truth->seen[i])
            continue;
        ret->lit += kind == 0;
        if (mm[i] < 0)
            continue;
        const double error = (double)(mm[i] - truth->mm[i]);
        ret->squares[kind] += error * error;
        ret->n[kind]++;
    }
}

static void take(World *world, const struct rig *rig, int position, struct figures *ret) {
    const int laser = position % 2;
    const double arc_deg = 20 + 45.0 * position, half = atan(REACH_MM / 480.0);
    const struct truth_grid at = {TEXELS, TEXELS, grid.width_mm, grid.height_mm, grid.reference_mm};
    g_autofree struct planes *planes = g_new(struct planes, 1);
    g_autofree struct truth *truth = g_new(struct truth, 1);
    gboolean saturated[N_TEXELS];
    struct laser_sweep sweep = {.laser = &rig->lasers[laser],
                                .arc_rad = arc_deg * DEGREE,
                                .from_rad = -half,
                                .step_rad = 2 * half / (N_STEPS - 1),
                                .peak = planes->peak,
                                .width = planes->width,
                                .intensity = planes->intensity,
                                .second_peak = planes->second_peak,
                                .second_intensity = planes->second_intensity};
    struct world_sensor sensor;
    world_sensor(world, 0, &sensor);
    const int saturation = radiance_saturation(sensor.bits);
    g_autoptr(Sweep) slow = sweep_new(SIDE, SIDE, N_STEPS, saturation);
    g_autoptr(Sweep) quick = sweep_new(SIDE, SIDE, N_STEPS, saturation);
    struct world_state state = {.turntable_deg = turntable_deg, .arc_deg = arc_deg};
    state.laser_on[laser] = TRUE;
    for (int k = 0; k < N_STEPS; k++) {
        const guint64 key = 2 * ((guint64)position * N_STEPS + (guint64)k + 1);
        state.sweep_deg[laser] = (sweep.from_rad + k * sweep.step_rad) / DEGREE;
        expose(world, &state, SHORT_US, key, quick);
        expose(world, &state, LONG_US, key + 1, slow);
    }
    truth_mdf(world, 0, turntable_deg, &at, truth->mm, truth->edge);
    truth_laser_seen(world, 0, turntable_deg, &at, &arc_deg, &laser, 1, truth->seen);
    finish(slow, planes);
    find_saturated(rig, planes, saturated);
    compare(rig, &sweep, truth, saturated, 0, ret);
    sweep_set_shorter(slow, quick, (double)LONG_US / SHORT_US);
    finish(slow, planes);
    compare(rig, &sweep, truth, saturated, 1, ret);
}

TEST(glossy) {
    g_autoptr(World) world = new_world();
    const struct rig rig = two_lasers_rig(SIDE);
    struct figures f = {0};
    double rms_mm[2];
    for (int i = 0; i < POSITIONS; i++)
        take(world, &rig, i, &f);
    for (int i = 0; i < 2; i++) {
        rms_mm[i] = sqrt(f.squares[i] / f.n[i]);
        g_test_message("%s: RMS %.4f mm, %d texels seen of %d lit", i ? "both" : "long alone",
                       rms_mm[i], f.n[i], f.lit);
    }
    g_assert_cmpint(f.lit, >, POSITIONS * N_TEXELS / 10);
    g_assert_cmpint(f.n[1], >=, f.n[0]);
    g_assert_cmpint(f.n[1], >, f.lit * 95 / 100);
    g_assert_cmpfloat(rms_mm[1], <, 0.025);
    g_assert_cmpfloat(rms_mm[1], <, 0.75 * rms_mm[0]);
}

AFTER_TESTS {
    world_fixture_clean();
}
