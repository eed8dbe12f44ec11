/* Sections for the virtual Modbus device (sim/virtual/modbus.h), on TCP or RTU. */
#pragma once

#include "conformance/conformance.h"
#include "modbus/bus.h"
#include "modbus/devices.h"
#include "virtual/modbus.h"

#define RIG_UNIT 7

/* Makes a fast device, so that tests take little time. It has 100 steps per degree. */
VirtualModbus *modbus_rig_device(gboolean rtu);

/* Returns the section of a device on this bus; g_free(). */
char *modbus_rig_section(const char *bus, const char *header, const char *keys);

#define RIG_AXIS                                                                                   \
    "min_deg = -90\nmax_deg = 90\nspeed_deg_s = 400\naccel_deg_s2 = 4000\nsteps_per_deg = 100\n"   \
    "target_register = 0\nposition_register = 21\nstatus_register = 20\nmoving_bit = 0\n"          \
    "homed_bit = 1\nfault_bit = 2\nlimit_bit = 3\nspeed_register = 3\nspeed_scale = 2\n"           \
    "accel_register = 4\naccel_scale = 0.5\nsetup = 0x64=1;0x65=2,3\nstart = 2=1\nhome = 2=2\n"    \
    "stop = 2=3\nclear = 2=4\nwatchdog = 5=1\nwatchdog_ms = 50\npoll_ms = 5\nstart_ms = 150\n"     \
    "stall_ms = 150\n"

#define RIG_AFTER "watchdog_after_s = 1\nwatchdog_scale = 10\n"

/* The function fail() of struct conformance, for a VirtualModbus. */
typedef void (*ModbusRigFail)(gpointer fail_data, enum conformance_fault fault);
void modbus_rig_fail(gpointer device, enum conformance_fault fault);

/* Runs the tests of lamps and laser again, with the watchdog that switches them off by timeout or
 * by pulses. */
void modbus_rig_conformance_watchdog(const char *bus, const char *name, gboolean pulses,
                                     ModbusRigFail fail, gpointer fail_data);

/* Adds the tests of all classes for one device. Its bus must exist until they have run. */
void modbus_rig_conformance(const char *bus, const char *name, ModbusRigFail fail,
                            gpointer fail_data);
