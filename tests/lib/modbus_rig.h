/* Sections for the virtual Modbus device (sim/virtual/modbus.h), over TCP or RTU. */
#pragma once

#include "conformance/conformance.h"
#include "modbus/bus.h"
#include "modbus/devices.h"
#include "virtual/modbus.h"

#define RIG_UNIT 7

/* Quick, so that a test is; 100 steps a degree. */
static inline VirtualModbus *rig_device(gboolean rtu) {
    static const struct virtual_modbus_options options = {
        .unit = RIG_UNIT, .speed_steps_s = 40000, .accel_steps_s2 = 400000};
    struct virtual_modbus_options with = options;
    GError *error = NULL;
    with.rtu = rtu;
    VirtualModbus *device = virtual_modbus_new(&with, &error);
    g_assert_no_error(error);
    return device;
}

/* What a section of that device says, with its line; g_free(). */
static inline char *rig_section(const char *bus, const char *header, const char *keys) {
    return g_strdup_printf("[%s]\nbus = %s\nunit = %d\ntimeout_ms = 60\nlate_ms = 120\n%s", header,
                           bus, RIG_UNIT, keys);
}

#define RIG_AXIS                                                                                   \
    "min_deg = -90\nmax_deg = 90\nspeed_deg_s = 400\naccel_deg_s2 = 4000\nsteps_per_deg = 100\n"   \
    "target_register = 0\nposition_register = 21\nstatus_register = 20\nmoving_bit = 0\n"          \
    "homed_bit = 1\nfault_bit = 2\nlimit_bit = 3\nspeed_register = 3\nspeed_scale = 2\n"           \
    "accel_register = 4\naccel_scale = 0.5\nsetup = 0x64=1;0x65=2,3\nstart = 2=1\nhome = 2=2\n"    \
    "stop = 2=3\nclear = 2=4\nwatchdog = 5=1\nwatchdog_ms = 50\npoll_ms = 5\nstart_ms = 150\n"     \
    "stall_ms = 150\n"

#define RIG_AFTER "watchdog_after_s = 1\nwatchdog_scale = 10\n"

/* Lamps and laser again, going off by themselves in each of the two ways. */
static inline void rig_conformance_watchdog(const char *bus, const char *name, gboolean pulses) {
    static struct conformance tested[4];
    struct conformance *lamps = &tested[pulses ? 0 : 2], *laser = lamps + 1;
    lamps->name = laser->name = name;
    lamps->real_clock = laser->real_clock = TRUE;
    lamps->section =
        rig_section(bus, "lamps bank",
                    pulses ? "n = 3\nfirst_coil = 4\npulse_coil = 0x204\n" RIG_AFTER
                           : "n = 3\nfirst_coil = 4\nwatchdog_register = 6\n" RIG_AFTER);
    laser->section = rig_section(bus, "laser l",
                                 pulses ? "coil = 9\npulse_coil = 0x209\n" RIG_AFTER
                                        : "coil = 9\nwatchdog_register = 6\n" RIG_AFTER);
    conformance_lamps(&modbus_relays_driver, lamps);
    conformance_laser(&modbus_laser_driver, laser);
}

/* The suites of all classes over one device. Its bus must live until they have run. */
static inline void rig_conformance(const char *bus, const char *name) {
    static struct conformance axis, lamps, laser, door;
    struct conformance common = {.name = name, .real_clock = TRUE, .tolerance_deg = 0.02};
    axis = lamps = laser = door = common;
    axis.section = rig_section(bus, "axis arc", RIG_AXIS "backlash_deg = 0.2\n");
    lamps.section = rig_section(bus, "lamps bank", "n = 3\nfirst_coil = 4\n");
    laser.section = rig_section(bus, "laser l", "coil = 9\n");
    door.section = rig_section(bus, "interlock door", "input = 2\n");
    conformance_axis(&modbus_axis_driver, &axis);
    conformance_lamps(&modbus_relays_driver, &lamps);
    conformance_laser(&modbus_laser_driver, &laser);
    conformance_interlock(&modbus_inputs_driver, &door);
}
