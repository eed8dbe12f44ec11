#include "modbus_rig.h"
#include "lib/ok.h"

VirtualModbus *modbus_rig_device(gboolean rtu) {
    static const struct virtual_modbus_options options = {.unit = RIG_UNIT,
                                                          .speed_steps_s = 40000,
                                                          .accel_steps_s2 = 400000,
                                                          .speed_unit_steps_s = 50};
    struct virtual_modbus_options with = options;
    with.rtu = rtu;
    VirtualModbus *device = ok(virtual_modbus_new(&with, ERR));
    return device;
}

char *modbus_rig_section(const char *bus, const char *header, const char *keys) {
    return g_strdup_printf("[%s]\nbus = %s\nunit = %d\ntimeout_ms = 60\nlate_ms = 120\n%s", header,
                           bus, RIG_UNIT, keys);
}

/* Does the same as modbus_rig_section() with a longer timeout, so that no answer is late even on a
 * busy computer. The conformance suites need this. */
static char *patient_section(const char *bus, const char *header, const char *keys) {
    return g_strdup_printf("[%s]\nbus = %s\nunit = %d\ntimeout_ms = 300\nlate_ms = 120\n%s", header,
                           bus, RIG_UNIT, keys);
}

void modbus_rig_fail(gpointer device, enum conformance_fault fault) {
    const struct virtual_modbus_faults faults = {.silent = fault == CONFORMANCE_UNANSWERED ? -1 : 0,
                                                 .cut = fault == CONFORMANCE_CUT};
    virtual_modbus_fail(device, &faults);
}

void modbus_rig_conformance_watchdog(const char *bus, const char *name, gboolean pulses,
                                     ModbusRigFail fail, gpointer fail_data) {
    static struct conformance tested[4];
    struct conformance *lamps = &tested[pulses ? 0 : 2], *laser = lamps + 1;
    lamps->name = laser->name = name;
    lamps->real_clock = laser->real_clock = TRUE;
    lamps->fail = laser->fail = fail;
    lamps->fail_data = laser->fail_data = fail_data;
    lamps->section =
        patient_section(bus, "lamps bank",
                        pulses ? "n = 3\nfirst_coil = 4\npulse_coil = 0x204\n" RIG_AFTER
                               : "n = 3\nfirst_coil = 4\nwatchdog_register = 6\n" RIG_AFTER);
    laser->section = patient_section(bus, "laser l",
                                     pulses ? "coil = 9\npulse_coil = 0x209\n" RIG_AFTER
                                            : "coil = 9\nwatchdog_register = 6\n" RIG_AFTER);
    conformance_lamps(&modbus_relays_driver, lamps);
    conformance_laser(&modbus_laser_driver, laser);
}

void modbus_rig_conformance(const char *bus, const char *name, ModbusRigFail fail,
                            gpointer fail_data) {
    static struct conformance axis, lamps, laser, door;
    struct conformance common = {.name = name,
                                 .real_clock = TRUE,
                                 .tolerance_deg = 0.02,
                                 .fail = fail,
                                 .fail_data = fail_data};
    axis = lamps = laser = door = common;
    axis.section = patient_section(bus, "axis arc", RIG_AXIS "backlash_deg = 0.2\n");
    lamps.section = patient_section(bus, "lamps bank", "n = 3\nfirst_coil = 4\n");
    laser.section = patient_section(bus, "laser l", "coil = 9\n");
    door.section = patient_section(bus, "interlock door", "input = 2\n");
    conformance_axis(&modbus_axis_driver, &axis);
    conformance_lamps(&modbus_relays_driver, &lamps);
    conformance_laser(&modbus_laser_driver, &laser);
    conformance_interlock(&modbus_inputs_driver, &door);
}
