#include "measurement_shown.h"

#include <math.h>
#include <string.h>

#define FAR_DEG 25 /* as far next to, a sheet misses the sample */

struct shown { /* one view */
    World *world;
    int view;
    double turntable_deg;
    const struct bench_positions *positions;
    struct world_sensor sensor;
    guint16 *pixels;
};

static double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Where the ray through a texel's centre ends, rig frame. */
static void surface_point(const struct shown *shown, const struct truth_grid *grid, int texel,
                          float distance_mm, double ret_mm[3]) {
    const int column = texel % grid->width, row = texel / grid->width;
    const double turn = shown->turntable_deg * (G_PI / 180);
    double at[3] = {grid->width_mm * ((column + 0.5) / grid->width - 0.5),
                    grid->height_mm * (0.5 - (row + 0.5) / grid->height), grid->reference_mm};
    double eye[3], ray[3];
    truth_view_centre_mm(shown->world, shown->view, shown->turntable_deg, eye);
    for (int k = 0; k < 3; k++)
        ray[k] = at[k] - eye[k];
    const double length = sqrt(dot(ray, ray));
    for (int k = 0; k < 3; k++)
        at[k] += ray[k] / length * (double)distance_mm;
    ret_mm[0] = cos(turn) * at[0] - sin(turn) * at[1];
    ret_mm[1] = sin(turn) * at[0] + cos(turn) * at[1];
    ret_mm[2] = at[2];
}

static int pixel_dn(struct shown *shown, int position, double angle_deg, gsize pixel) {
    const int laser = shown->positions->laser[position];
    struct world_state state = {.turntable_deg = shown->turntable_deg,
                                .arc_deg = shown->positions->arc_deg[position]};
    state.laser_on[laser] = TRUE;
    state.sweep_deg[laser] = angle_deg;
    world_expose(shown->world, shown->view, &state, shown->positions->exposure_us, 0, 0,
                 shown->pixels);
    return shown->pixels[pixel];
}

void bench_shown(const struct bench_setup *setup, int view, double turntable_deg,
                 const struct bench_positions *positions, const float *distance_mm,
                 const guint8 *asked, guint8 *ret_shown) {
    const struct truth_grid grid = bench_truth_grid(setup);
    const gsize n = (gsize)grid.width * (gsize)grid.height;
    memset(ret_shown, 0, n);
    if (!memchr(asked, 1, n))
        return;
    struct bench_setup still = *setup;
    still.noise = FALSE;
    g_autoptr(GError) error = NULL;
    g_autoptr(World) world = bench_world(&still, &error);
    g_assert_no_error(error);
    struct shown shown = {world, view, turntable_deg, positions, {0}, NULL};
    world_sensor(world, view, &shown.sensor);
    g_autofree guint16 *pixels = shown.pixels =
        g_new(guint16, (gsize)shown.sensor.width * (gsize)shown.sensor.height);
    g_autofree guint8 *lit = g_new(guint8, n);
    for (int k = 0; k < positions->n; k++) {
        truth_laser_seen(world, view, turntable_deg, &grid, &positions->arc_deg[k],
                         &positions->laser[k], 1, lit);
        for (gsize i = 0; i < n; i++) {
            double point_mm[3];
            if (!asked[i] || !lit[i] || ret_shown[i])
                continue;
            surface_point(&shown, &grid, (int)i, distance_mm[i], point_mm);
            double xy[2];
            truth_project(shown.world, shown.view, point_mm, xy);
            const int x = (int)lround(xy[0]), y = (int)lround(xy[1]);
            g_assert(x >= 0 && y >= 0 && x < shown.sensor.width && y < shown.sensor.height);
            const gsize pixel = (gsize)y * (gsize)shown.sensor.width + (gsize)x;
            /* How far a point is from a sheet goes with cosine and sine of the angle it is swept
             * to. */
            struct truth_sheet begun, quarter;
            truth_laser_sheet(shown.world, shown.positions->laser[k], shown.positions->arc_deg[k],
                              0, &begun);
            truth_laser_sheet(shown.world, shown.positions->laser[k], shown.positions->arc_deg[k],
                              90, &quarter);
            const double on = atan(-(dot(begun.normal, point_mm) - begun.offset_mm) /
                                   (dot(quarter.normal, point_mm) - quarter.offset_mm)) *
                              180 / G_PI;
            ret_shown[i] =
                pixel_dn(&shown, k, on, pixel) - pixel_dn(&shown, k, on + FAR_DEG, pixel) >=
                shown.positions->threshold_dn;
        }
    }
}
