#include "measurement_parts.h"

#include "capture/intake/radiance.h"
#include "frames/sweep.h"
#include "mdf/mdf.h"
#include "measurement_shown.h"

#include <math.h>
#include <string.h>

#define RAD(deg)     ((deg) * (G_PI / 180))
#define EXPOSURE_US  4000
#define THRESHOLD_DN 12
#define MARGIN_MM    2
#define POSITIONS    26 /* as in the demo: 2 at 15°, 6 each at 30, 45, 60 and 75° */

struct position {
    int laser;
    double arc_deg;
};

static struct position position_at(int index) {
    if (index < 2)
        return (struct position){0, 15 + 180.0 * index};
    return (struct position){1 + (index - 2) / 6, 15 + 60.0 * ((index - 2) % 6)};
}

/* As a plan would have it: from edge to edge of the sample's box. */
static void find_range(const struct rig *rig, const struct session_grid *grid,
                       const struct position *position, double turntable_rad, double *ret_from,
                       double *ret_to) {
    *ret_from = G_MAXDOUBLE;
    *ret_to = -G_MAXDOUBLE;
    for (int corner = 0; corner < 8; corner++) {
        double x = grid->width_mm / 2 + MARGIN_MM, y = grid->height_mm / 2 + MARGIN_MM;
        double z = grid->reference_mm - (corner & 4 ? grid->depth_mm : 0);
        struct vec3 p = rig_turn(vec3(corner & 1 ? x : -x, corner & 2 ? y : -y, z), turntable_rad);
        double s = rig_laser_sweep_rad(&rig->arc, &rig->lasers[position->laser],
                                       RAD(position->arc_deg), p);
        *ret_from = MIN(*ret_from, s);
        *ret_to = MAX(*ret_to, s);
    }
}

struct planes {
    float *peak, *width, *intensity, *second_peak, *second_intensity;
};

static void take_sweep(World *world, int camera, double turntable_deg,
                       const struct position *position, double from, double to, int steps,
                       const struct planes *planes) {
    struct world_sensor sensor;
    world_sensor(world, camera, &sensor);
    g_autofree guint16 *pixels = g_new(guint16, (gsize)sensor.width * (gsize)sensor.height);
    g_autoptr(Sweep) sweep =
        sweep_new(sensor.width, sensor.height, steps, radiance_saturation(sensor.bits));
    struct world_state state = {.turntable_deg = turntable_deg, .arc_deg = position->arc_deg};
    state.laser_on[position->laser] = TRUE;
    for (int k = 0; k < steps; k++) {
        double angle = from + (to - from) * k / (steps - 1);
        state.sweep_deg[position->laser] = angle * 180 / G_PI;
        guint64 key = ((guint64)camera * 64 + (guint64)position->laser) * 1024 + (guint64)k;
        world_expose(world, camera, &state, EXPOSURE_US, 0,
                     key * 512 + (guint64)position->arc_deg + 7, pixels);
        sweep_add(sweep, pixels);
    }
    const struct sweep_pulses first = {planes->peak, planes->width, planes->intensity};
    const struct sweep_pulses second = {planes->second_peak, NULL, planes->second_intensity};
    sweep_finish(sweep, THRESHOLD_DN, &first, &second);
}

void bench_mdf_init(struct bench_mdf *mdf) {
    *mdf = (struct bench_mdf){.errors = g_array_new(FALSE, FALSE, sizeof(float)),
                              .chi2 = g_array_new(FALSE, FALSE, sizeof(float)),
                              .edge_chi2 = g_array_new(FALSE, FALSE, sizeof(float)),
                              .alone_chi2 = g_array_new(FALSE, FALSE, sizeof(float))};
}

void bench_mdf_clear(struct bench_mdf *mdf) {
    GArray *const arrays[] = {mdf->errors, mdf->chi2, mdf->edge_chi2, mdf->alone_chi2};
    for (gsize i = 0; i < G_N_ELEMENTS(arrays); i++)
        g_array_unref(arrays[i]);
    g_free(mdf->distance);
    g_free(mdf->other);
    g_free(mdf->lasers);
    g_free(mdf->truth);
    g_free(mdf->edge);
    g_free(mdf->lit);
}

/* error_mm: the texels' error bars; below 0: none. */
static void compare(const struct bench_setup *setup, const float *truth, const float *error_mm,
                    struct bench_mdf *ret) {
    for (int i = 0; i < setup->texels * setup->texels; i++) {
        const gboolean known = ret->distance[i] >= 0;
        ret->texels++;
        ret->seen += ret->lit[i] > 0;
        ret->covered += ret->lit[i] > 0 && known;
        if (!known || truth[i] < 0)
            continue;
        const double off_mm = (double)(ret->distance[i] - truth[i]),
                     error = off_mm / setup->texel_mm;
        const gboolean out = fabs(error) > 1, alone = ret->lasers[i] == 1;
        const float size = (float)fabs(error), chi2 = (float)pow(off_mm / (double)error_mm[i], 2);
        if (error_mm[i] > 0) {
            g_array_append_val(ret->edge[i] ? ret->edge_chi2 : ret->chi2, chi2);
            if (alone)
                g_array_append_val(ret->alone_chi2, chi2);
        }
        ret->alone += alone;
        ret->alone_outliers += alone && out;
        ret->alone_squares += alone ? error * error : 0;
        if (ret->edge[i]) {
            ret->edges++;
            ret->edge_squares += error * error;
            ret->edge_outliers += out;
            continue;
        }
        ret->measured++;
        ret->squares += error * error;
        ret->sum += error;
        ret->outliers += out;
        g_array_append_val(ret->errors, size);
    }
}

/* Lit, but shown by no position in which it is. */
static gint64 count_dark(const struct bench_setup *setup, int view, double turntable_deg,
                         const struct bench_positions *positions, const struct bench_mdf *mdf) {
    const int n = setup->texels * setup->texels;
    g_autofree guint8 *asked = g_new(guint8, n), *shown = g_new(guint8, n);
    gint64 dark = 0;
    for (int i = 0; i < n; i++)
        asked[i] = mdf->lit[i] > 0 && mdf->distance[i] < 0;
    bench_shown(setup, view, turntable_deg, positions, mdf->truth, asked, shown);
    for (int i = 0; i < n; i++)
        dark += asked[i] && !shown[i];
    return dark;
}

void bench_mdf(const struct bench_setup *setup, int view, int steps, int every, gboolean plain,
               struct bench_mdf *ret) {
    g_autoptr(GError) error = NULL;
    g_autoptr(World) world = bench_world(setup, &error);
    g_assert_no_error(error);
    struct rig rig;
    bench_rig(setup, &rig);
    struct session_grid grid = bench_grid(setup);
    struct truth_grid truth_grid = bench_truth_grid(setup);
    double turntable_deg = 24.0 * view;
    g_autoptr(MdfView) mdf = mdf_view_new(&rig.cameras[view], RAD(turntable_deg), &grid);
    if (plain)
        mdf_view_set_plain(mdf);
    gsize n_pixels = (gsize)rig.cameras[view].width * (gsize)rig.cameras[view].height;
    g_autofree float *peak = g_new(float, n_pixels), *width = g_new(float, n_pixels);
    g_autofree float *intensity = g_new(float, n_pixels);
    g_autofree float *second_peak = g_new(float, n_pixels), *second = g_new(float, n_pixels);
    struct planes planes = {peak, width, intensity, second_peak, second};
    double arcs[POSITIONS];
    int lasers[POSITIONS], positions_used = 0;
    for (int i = 0; i < POSITIONS; i += every) {
        struct position position = position_at(i);
        double from, to;
        find_range(&rig, &grid, &position, RAD(turntable_deg), &from, &to);
        take_sweep(world, view, turntable_deg, &position, from, to, steps, &planes);
        struct laser_sweep sweep = {.arc = &rig.arc,
                                    .laser = &rig.lasers[position.laser],
                                    .arc_rad = RAD(position.arc_deg),
                                    .from_rad = from,
                                    .step_rad = (to - from) / (steps - 1),
                                    .peak = peak,
                                    .width = width,
                                    .intensity = intensity,
                                    .second_peak = second_peak,
                                    .second_intensity = second};
        mdf_view_add(mdf, &sweep);
        arcs[positions_used] = position.arc_deg;
        lasers[positions_used++] = position.laser;
    }
    int n = grid.width * grid.height;
    g_autofree float *distance = g_new(float, n), *count = g_new(float, n);
    g_autofree float *spread = g_new(float, n), *truth = g_new(float, n);
    g_autofree guint8 *edge = g_new(guint8, n), *seen = g_new(guint8, n);
    mdf_view_merge(mdf, distance, count, spread);
    ret->other = g_new(float, n);
    mdf_view_other(mdf, distance, ret->other);
    truth_mdf(world, view, turntable_deg, &truth_grid, truth, edge);
    truth_laser_seen(world, view, turntable_deg, &truth_grid, arcs, lasers, positions_used, seen);
    struct vec3 centre = rig_turn(rig_camera_centre_mm(&rig.cameras[view]), -RAD(turntable_deg));
    memcpy(ret->centre_mm, (double[3]){centre.x, centre.y, centre.z}, sizeof ret->centre_mm);
    ret->distance = g_steal_pointer(&distance);
    ret->truth = g_steal_pointer(&truth);
    ret->lasers = g_steal_pointer(&count);
    ret->edge = g_steal_pointer(&edge);
    ret->lit = g_steal_pointer(&seen);
    compare(setup, ret->truth, spread, ret);
    const struct bench_positions positions = {arcs, lasers, positions_used, EXPOSURE_US,
                                              THRESHOLD_DN};
    ret->dark += count_dark(setup, view, turntable_deg, &positions, ret);
}
