/* Devices of the small simulated rig, for the tests of drivers and of device classes. */
#pragma once

#include "conformance/conformance.h"
#include "devices/devices.h"
#include "world/world.h"

#define RIG   SOURCE_DIR "/tests/small/rig.conf"
#define WORLD SOURCE_DIR "/tests/small/world.conf"

static const struct conformance turntable = {
    .name = "sim-turntable",
    .path = RIG,
    .section = "[axis turntable]\nworld = world.conf\nwraps = yes\nspeed_deg_s = 60\n"
               "accel_deg_s2 = 120\nbacklash_deg = 0.05\nsettle_ms = 150\n",
};
static const struct conformance bank = {
    .name = "sim-lamps",
    .path = RIG,
    .section = "[lamps bank]\nworld = world.conf\n",
};
static const struct conformance camera = {
    .name = "sim-camera",
    .path = RIG,
    .section = "[camera cam30]\nworld = world.conf\n",
    .exposure_us = 20000,
};
static const struct conformance laser = {
    .name = "sim-laser",
    .path = RIG,
    .section = "[laser laser30]\nworld = world.conf\n",
};
static const struct conformance door = {
    .name = "sim-interlock",
    .section = "[interlock door]\n",
};
