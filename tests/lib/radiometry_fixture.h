/*
 * A small simulated rig for tests of radiometry, with three cameras and three lamps. The test
 * chooses the objects on the turntable. The world file contains the true values. The struct rig
 * contains the values of a rig file: its geometry is correct, and everything that radiometry
 * determines is wrong.
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

/* Returns the true direction in which a lamp aims: its nominal aim tilted along and across the arc,
 * as in world/world_load.c. */
struct vec3 radiometry_fixture_aim(int lamp);

struct fixture_pose {
    int lamp;
    double turntable_deg, arc_deg;
    double time_s; /* time for the drift of the lamp */
};

/* Computes the raw values (DN) of one exposure. The noise depends on key. If lamp is negative, the
 * picture is dark. */
void radiometry_fixture_expose(World *world, int camera, const struct fixture_pose *pose,
                               gint64 exposure_us, guint64 key, float *ret);

/* Computes the mean of n exposures in DN per millisecond above black. */
void radiometry_fixture_mosaic(World *world, int camera, const struct fixture_pose *pose, int n,
                               guint64 key, float *ret);
