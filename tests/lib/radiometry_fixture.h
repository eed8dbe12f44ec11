/*
 * A small simulated rig for tests of radiometry: three cameras, three lamps, what lies on the
 * turntable is up to the test. What the world file says is the truth; the struct rig is what a rig
 * file would say, which is wrong in all that radiometry finds out and right in geometry.
 */
#pragma once

#include "geometry/rig.h"
#include "world/world.h"
#include "world_fixture.h"

#define FIXTURE_SIZE 96
#define FIXTURE_US   8000

/* theta, phi, response (nominal 6000), colour, vignetting */
static const struct fixture_camera {
    double theta_deg, phi_deg, response, colour[3], vignetting;
} fixture_cameras[] = {
    {10, 0, 6300, {0.9, 1, 0.8}, 0.2},
    {40, 20, 5800, {1, 1.05, 0.85}, 0.2},
    {65, 0, 6100, {0.95, 1, 0.9}, 0.15},
};

/* theta, intensity (nominal 40), exponent (nominal 2), aim */
static const struct fixture_lamp {
    double theta_deg, intensity, exponent, aim_deg[2];
} fixture_lamps[] = {
    {15, 42, 2.5, {0.5, -0.3}},
    {45, 38, 1.5, {-0.4, 0.2}},
    {70, 41, 2.2, {0.2, 0.6}},
};

char *radiometry_fixture_world(const char *world_keys, const char *objects);
void radiometry_fixture_rig(struct rig *rig);

/* Where a lamp truly looks: its aim tilted along and across the arc, as world/world_load.c says. */
struct vec3 radiometry_fixture_aim(int lamp);

struct fixture_pose {
    int lamp;
    double turntable_deg, arc_deg;
    double time_s; /* of the lamp's drift */
};

/* One exposure's raw DN; key: of the noise. lamp < 0: a dark picture. */
void radiometry_fixture_expose(World *world, int camera, const struct fixture_pose *pose,
                               gint64 exposure_us, guint64 key, float *ret);

/* DN a millisecond above black: the mean of n exposures. */
void radiometry_fixture_mosaic(World *world, int camera, const struct fixture_pose *pose, int n,
                               guint64 key, float *ret);
