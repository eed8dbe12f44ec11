#include "device_by_text.h"

#include "lib/ok.h"

#include "modbus/devices.h"
#include "network/devices.h"
#include "program/devices.h"
#include "serial/devices.h"
#include "usb/relays.h"
#include "usb/tic.h"

#include <stdio.h>
#include <string.h>

struct DeviceByText {
    Axis *axis;
    LampBank *bank;
    Laser *laser;
    Interlock *interlock;
    int n_results;
};

static const struct axis_driver *const axes[] = {&gcode_axis_driver, &modbus_axis_driver,
                                                 &program_axis_driver, &tic_axis_driver, NULL};
static const struct lamps_driver *const lamps[] = {
    &serial_lamps_driver, &modbus_relays_driver, &usb_relays_driver, &program_lamps_driver,
    &artnet_lamps_driver, &sacn_lamps_driver,    &wled_lamps_driver, NULL};
static const struct laser_driver *const lasers[] = {&modbus_laser_driver, &usb_relay_laser_driver,
                                                    NULL};
static const struct interlock_driver *const interlocks[] = {&modbus_inputs_driver, NULL};

/* Returns the driver of a section, or NULL. All drivers begin with a struct driver_info. */
static gconstpointer find(gconstpointer const *drivers, const struct config_section *section) {
    const char *name = config_value(section, "driver", NULL);
    for (; *drivers; drivers++)
        if (g_strcmp0(((const struct driver_info *)*drivers)->name, name) == 0)
            return *drivers;
    return NULL;
}

gboolean device_by_text_can(const struct config_section *section) {
    return find((gconstpointer const *)axes, section) ||
           find((gconstpointer const *)lamps, section) ||
           find((gconstpointer const *)lasers, section) ||
           find((gconstpointer const *)interlocks, section);
}

static void on_axis(Axis *axis, enum axis_event event, const GError *error, gpointer data) {
    ((DeviceByText *)data)->n_results += event != AXIS_PASSING;
}

static void on_lamp(LampBank *bank, int index, gboolean on, gint64 at_us, const GError *error,
                    gpointer data) {
    ((DeviceByText *)data)->n_results++;
}

static void on_laser(Laser *laser, gboolean on, const GError *error, gpointer data) {
    ((DeviceByText *)data)->n_results++;
}

#define OPEN(class, drivers)                                                                       \
    class##_open(find((gconstpointer const *)(drivers), section), section, any, clock, error)

DeviceByText *device_by_text_open(const struct config_section *section, Clock *clock,
                                  GError **error) {
    static const char *const any[] = {"*", NULL};
    DeviceByText *device = g_new0(DeviceByText, 1);
    const char *class_name = section->class_name;
    if (strcmp(class_name, "axis") == 0 && (device->axis = OPEN(axis, axes)))
        axis_listen(device->axis, on_axis, device);
    else if (strcmp(class_name, "lamps") == 0 && (device->bank = OPEN(lamps, lamps)))
        lamps_listen(device->bank, on_lamp, device);
    else if (strcmp(class_name, "laser") == 0 && (device->laser = OPEN(laser, lasers)))
        laser_listen(device->laser, on_laser, device);
    else if (strcmp(class_name, "interlock") == 0)
        device->interlock = OPEN(interlock, interlocks);
    if (device->axis || device->bank || device->laser || device->interlock)
        return device;
    g_free(device);
    return NULL;
}

void device_by_text_close(DeviceByText *device) {
    if (!device)
        return;
    axis_close(device->axis);
    lamps_close(device->bank);
    laser_close(device->laser);
    interlock_close(device->interlock);
    g_free(device);
}

void device_by_text_call(DeviceByText *device, const char *words) {
    const gboolean on = g_str_has_suffix(words, "on");
    double by_deg, speed_deg_s;
    if (device->axis && strcmp(words, "home") == 0)
        ok(axis_home(device->axis, ERR));
    else if (device->axis && g_str_has_prefix(words, "move to "))
        ok(axis_move(device->axis, g_ascii_strtod(words + 8, NULL), ERR));
    else if (device->axis && sscanf(words, "turn by %lf at %lf", &by_deg, &speed_deg_s) == 2)
        ok(axis_turn(device->axis, by_deg, speed_deg_s, ERR));
    else if (device->axis && strcmp(words, "stop") == 0)
        ok(axis_halt(device->axis, ERR));
    else if (device->bank && strcmp(words, "lamps off") == 0)
        ok(lamps_all_off(device->bank, ERR));
    else if (device->bank && g_str_has_prefix(words, "lamp "))
        ok(lamps_set(device->bank, (int)g_ascii_strtoll(words + 5, NULL, 10), on, ERR));
    else if (device->laser && (strcmp(words, "on") == 0 || strcmp(words, "off") == 0))
        ok(laser_set(device->laser, on, ERR));
    else
        g_error("the device cannot do “%s”", words);
}

int device_by_text_results(const DeviceByText *device) {
    return device->n_results;
}
