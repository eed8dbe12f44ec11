/*
 * A simulated world with a camera at 40° and two lasers at 30° and 60° over a sample, and the rig
 * that corresponds to it.
 */
#pragma once

#include "geometry/rig.h"
#include "world_fixture.h"

#define TWO_LASERS_FOCAL_PX 1800

/* Makes the world. The pictures of the camera have side × side pixels. world and sample are lines
 * that are added to the sections [world] and [sample]. */
World *two_lasers_world(int side, double power_w, const char *world, const char *sample);
struct rig two_lasers_rig(int side);
