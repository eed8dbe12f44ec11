#include "devices_private.h"

#include "aravis/camera.h"
#include "devices/devices.h"
#include "gphoto2/gphoto2.h"
#include "modbus/devices.h"
#include "network/devices.h"
#include "program/devices.h"
#include "serial/devices.h"
#include "usb/relays.h"
#include "usb/tic.h"
#include "v4l2/v4l2.h"

#include "base/json.h"

/* All drivers. Add a new driver in drivers/ and name it here. */
/* clang-format off */
static const struct axis_driver *const axis_drivers[] = {
    &sim_axis_driver,
    &modbus_axis_driver,
    &tic_axis_driver,
    &gcode_axis_driver,
    &program_axis_driver,
    NULL,
};
static const struct lamps_driver *const lamps_drivers[] = {
    &sim_lamps_driver,
    &modbus_relays_driver,
    &usb_relays_driver,
    &program_lamps_driver,
    &serial_lamps_driver,
    &artnet_lamps_driver,
    &sacn_lamps_driver,
    &wled_lamps_driver,
    NULL,
};
static const struct camera_driver *const camera_drivers[] = {
    &sim_camera_driver,
    &aravis_camera_driver,
    &v4l2_camera_driver,
    &gphoto2_camera_driver,
    &program_camera_driver,
    NULL,
};
static const struct laser_driver *const laser_drivers[] = {
    &sim_laser_driver,
    &modbus_laser_driver,
    &usb_relay_laser_driver,
    NULL,
};
static const struct interlock_driver *const interlock_drivers[] = {
    &sim_interlock_driver,
    &modbus_inputs_driver,
    NULL,
};
/* clang-format on */

/* The driver of every class begins with a struct driver_info. */
static const struct {
    const char *class_name;
    gconstpointer const *drivers;
} classes[] = {
    {"axis", (gconstpointer const *)axis_drivers},
    {"lamps", (gconstpointer const *)lamps_drivers},
    {"camera", (gconstpointer const *)camera_drivers},
    {"laser", (gconstpointer const *)laser_drivers},
    {"interlock", (gconstpointer const *)interlock_drivers},
};

static gconstpointer choose(const struct config_section *section, gconstpointer const *drivers,
                            GError **error) {
    const char *name = config_value(section, "driver", NULL);
    g_autoptr(GString) names = g_string_new(NULL);

    for (; *drivers; drivers++) {
        const struct driver_info *info = *drivers;
        if (g_strcmp0(info->name, name) == 0)
            return info;
        g_string_append_printf(names, "%s%s", names->len ? ", " : "", info->name);
    }
    if (name)
        config_set_error(error, CONFIG_ERROR_UNKNOWN, section, "driver",
                         "there is no driver \"%s\" for this class; choose from: %s", name,
                         names->str);
    else
        config_set_error(error, CONFIG_ERROR_MISSING, section, "driver",
                         "must be given; choose from: %s", names->str);
    return NULL;
}

const struct driver_info *drivers_by_name(const struct config_section *section) {
    const struct driver_info *info = NULL;

    for (gsize i = 0; i < G_N_ELEMENTS(classes) && !info; i++)
        info = choose(section, classes[i].drivers, NULL);
    return info;
}

gconstpointer drivers_find(const struct config_section *section, GError **error) {
    for (gsize i = 0; i < G_N_ELEMENTS(classes); i++)
        if (g_str_equal(classes[i].class_name, section->class_name))
            return choose(section, classes[i].drivers, error);
    g_return_val_if_reached(NULL);
}

static void describe(const char *class_name, const char *name, const char *help,
                     const struct option *options, gboolean whole, gboolean json, GString *to) {
    if (!json && !whole) {
        g_string_append_printf(to, "%-16s %-10s %s\n", name, class_name, help);
        return;
    }
    if (!json) {
        g_string_append_printf(to, "%s%s (%s): %s\n", to->len ? "\n" : "", name, class_name, help);
        options_describe(options, to);
        return;
    }
    g_string_append(to, to->len > 1 ? ",{\"class\":" : "{\"class\":");
    json_append_string(to, class_name);
    g_string_append(to, ",\"name\":");
    json_append_string(to, name);
    g_string_append(to, ",\"help\":");
    json_append_string(to, help);
    g_string_append(to, ",\"options\":");
    options_describe_json(options, to);
    g_string_append_c(to, '}');
}

const struct driver_info *devices_driver(gsize i) {
    for (gsize k = 0; k < G_N_ELEMENTS(classes); k++)
        for (gconstpointer const *driver = classes[k].drivers; *driver; driver++)
            if (i-- == 0)
                return *driver;
    return NULL;
}

char *devices_describe_drivers(const char *name, gboolean json) {
    /* Sections of the rig file that have keys in addition to those of a driver, or that have no
     * driver. */
    static const char *const sections[][2] = {
        {"rig", "The rig as a whole, in its section [rig]"},
        {"axis",
         "Place of an axis, in its section [axis NAME], in addition to the options of its driver"},
        {"lamps", "Places of the lamps of a bank, in its section [lamps NAME], in addition to the "
                  "options of its driver"},
        {"lamp", "A lamp of a bank, in a section [lamp NAME]"},
        {"camera", "Place of a camera, in its section [camera NAME], in addition to the options of "
                   "its driver"},
        {"laser",
         "Place of a laser, in its section [laser NAME], in addition to the options of its driver"},
        {"mark", "A white mark on the turntable next to the sample, in a section [mark NAME]"},
    };
    GString *text = g_string_new(json ? "[" : NULL);
    gsize empty = text->len;

    for (gsize i = 0; i < G_N_ELEMENTS(classes); i++)
        for (gconstpointer const *driver = classes[i].drivers; *driver; driver++) {
            const struct driver_info *info = *driver;
            if (!name || g_str_equal(name, info->name))
                describe(info->class_name, info->name, info->help, info->options, name != NULL,
                         json, text);
        }
    for (gsize i = 0; i < G_N_ELEMENTS(sections); i++)
        if (!name || g_str_equal(name, sections[i][0]))
            describe("section", sections[i][0], sections[i][1],
                     devices_section_options(sections[i][0]), name != NULL, json, text);
    if (text->len == empty) {
        g_string_free(text, TRUE);
        return NULL;
    }
    if (json)
        g_string_append_c(text, ']');
    return g_string_free(text, FALSE);
}
