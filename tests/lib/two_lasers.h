/*
 * A camera at 40° and two lasers at 30° and 60° over a sample, in the simulated world, and the rig
 * that says the same.
 */
#pragma once

#include "geometry/rig.h"
#include "world_fixture.h"

#define TWO_LASERS_FOCAL_PX 1800

/* side: of the camera's picture, pixels; keys of [world] and [sample] besides those of all. */
World *two_lasers_world(int side, double power_w, const char *world, const char *sample);
struct rig two_lasers_rig(int side);
