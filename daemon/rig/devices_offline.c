/* Reads the speeds and delays of the devices from the rig file, without opening a device. All
 * drivers of a class use the same option names. For an axis these are the names of
 * AXIS_MOTION_OPTIONS. For the other classes, the functions below name them. */
#include "devices_private.h"

#include <string.h>

#define ASSUMED_READOUT_MS 33.0 /* for a camera with 30 pictures a second */
#define ASSUMED_BITS       12
#define ASSUMED_STAMP_US   1000 /* for a camera whose time stamps are the time of the exposure */
#define MOST_EXPOSURE_US   60000000

/* Reads a number from the options of a device into *ret. Returns FALSE and keeps *ret if the driver
 * has no such option. */
static gboolean number_of(const struct layout_device *device, const char *name, double *ret) {
    const struct option *option = options_find(device->info->options, name);

    if (!option || (option->type != OPTION_DOUBLE && option->type != OPTION_INT))
        return FALSE;
    gconstpointer value = G_STRUCT_MEMBER_P(device->fields, option->offset);
    *ret = option->type == OPTION_INT ? *(const int *)value : *(const double *)value;
    return TRUE;
}

G_GNUC_PRINTF(3, 4)
static void assume(GPtrArray *assumed, const struct config_section *section, const char *format,
                   ...) {
    va_list args;

    va_start(args, format);
    g_autofree char *what = g_strdup_vprintf(format, args);
    va_end(args);
    g_ptr_array_add(assumed, g_strdup_printf("assumed for [%s]: %s", section->group, what));
}

/* Returns whether an axis reports its positions while it turns. A Modbus axis does not if it has no
 * register for the speed. Of the boards that speak G-code, only those with GRBL do. */
static gboolean has_reports(const struct layout_device *device) {
    const struct axis_driver *driver = (const struct axis_driver *)device->info;
    const struct option *dialect = options_find(device->info->options, "dialect");
    double speed_register;

    if (!driver->turn ||
        (number_of(device, "speed_register", &speed_register) && speed_register < 0))
        return FALSE;
    return !dialect ||
           g_str_equal(
               dialect->choices[*(const int *)G_STRUCT_MEMBER_P(device->fields, dialect->offset)],
               "grbl");
}

/* Sets report_ms and stamp_ms of an axis that reports its positions, so that passes can be planned.
 * The axis reports its position with each poll. The driver's open() would add to these values the
 * time that an answer may take. This time is not known here. */
static void read_turning(const struct layout_device *device, struct axis_motion *motion) {
    double poll_ms, stamp_ms = 0;

    if (!has_reports(device) || motion->report_ms > 0 || !number_of(device, "poll_ms", &poll_ms))
        return;
    number_of(device, "stamp_ms", &stamp_ms);
    motion->report_ms = poll_ms;
    motion->stamp_ms = stamp_ms;
}

static void read_axis(const struct layout *layout, const struct config_section *section,
                      struct axis_motion *ret, GPtrArray *assumed) {
    if (!section)
        return;
    const struct layout_device *device = layout_device(layout, section);
    const struct option *first = options_find(device->info->options, "wraps");
    if (first) /* the driver then has all options of AXIS_MOTION_OPTIONS, in a struct axis_motion */
        *ret = *(const struct axis_motion *)G_STRUCT_MEMBER_P(
            device->fields, (goffset)first->offset - G_STRUCT_OFFSET(struct axis_motion, wraps));
    else {
        *ret = (struct axis_motion){-360, 360, FALSE, 20, 40, 0, 0};
        assume(assumed, section, "20° a second, from -360° to 360°");
    }
    read_turning(device, ret);
}

/* Reads the warm-up time of a lamp bank or laser. Simulated lamps have it in their world file.
 * Their bank is opened to read it, which needs no real device. Returns FALSE with an error if the
 * bank cannot be opened. */
static gboolean read_warm_up(const struct layout *layout, const struct config_section *section,
                             double *ret_s, GPtrArray *assumed, GError **error) {
    const struct layout_device *device = layout_device(layout, section);
    double ms;
    gboolean ok = TRUE;
    if (number_of(device, "warm_up_ms", &ms)) {
        *ret_s = ms / 1000;
    } else if (!number_of(device, "warm_up_s", ret_s)) {
        *ret_s = 0;
        if (g_str_has_prefix(device->info->name, "sim-") &&
            g_str_equal(section->class_name, "lamps")) {
            Clock *clock = clock_new_virtual();
            g_autofree const char **keys = layout_keys("lamps");
            LampBank *bank =
                lamps_open((const struct lamps_driver *)device->info, section, keys, clock, error);
            ok = bank != NULL;
            *ret_s = ok ? bank->warm_up_s : 0;
            lamps_close(bank);
            clock_unref(clock);
        } else {
            assume(assumed, section, "no time to warm up");
        }
    }
    return ok;
}

static void read_camera(const struct layout *layout, int index, struct rig_timing *timing,
                        GPtrArray *assumed) {
    const struct config_section *section = layout->cameras[index];
    const struct layout_device *device = layout_device(layout, section);
    const struct camera_driver *driver = (const struct camera_driver *)(const void *)device->info;
    double readout_ms = ASSUMED_READOUT_MS, trigger_ms = ASSUMED_READOUT_MS / 2;
    double min_us = 1, max_us = MOST_EXPOSURE_US, bits = ASSUMED_BITS;

    if (!number_of(device, "readout_ms", &readout_ms) ||
        !number_of(device, "trigger_ms", &trigger_ms))
        assume(assumed, section, "30 pictures a second, because only the camera knows its rate");
    if (!number_of(device, "min_exposure_us", &min_us) ||
        !number_of(device, "max_exposure_us", &max_us))
        assume(assumed, section, "that it supports the exposures of the session");
    number_of(device, "bits", &bits);
    timing->readout_us[index] = (gint64)(readout_ms * 1000);
    timing->trigger_us[index] = (gint64)(trigger_ms * 1000);
    timing->min_exposure_us[index] = (gint64)min_us;
    timing->max_exposure_us[index] = (gint64)max_us;
    timing->stamp_us[index] = driver->no_stamps                              ? -1
                              : g_str_has_prefix(device->info->name, "sim-") ? 0
                                                                             : ASSUMED_STAMP_US;
    timing->bits[index] = bits > 0 ? (int)bits : ASSUMED_BITS;
    timing->listed_exposures[index] = driver->listed_exposures;
}

static gboolean read_lights(const struct layout *layout, struct rig_timing *timing,
                            GPtrArray *assumed, GError **error) {
    double bank_s[DEVICES_MAX_BANKS] = {0};

    for (int i = 0; i < layout->n_banks; i++)
        if (!read_warm_up(layout, layout->banks[i].section, &bank_s[i], assumed, error))
            return FALSE;
    for (int i = 0; i < layout->geometry.n_lamps; i++)
        timing->lamp_warm_up_s[i] = bank_s[layout->lamp_bank[i]];
    for (int i = 0; i < layout->geometry.n_lasers; i++) {
        const int unit = layout->unit[i];
        read_axis(layout, layout->sweeps[i], &timing->sweep[i], assumed);
        if (unit != i) {
            timing->mounts[unit] |= 1u << i;
            timing->laser_warm_up_s[i] = timing->laser_warm_up_s[unit];
        } else if (!read_warm_up(layout, layout->lasers[i], &timing->laser_warm_up_s[i], assumed,
                                 error)) {
            return FALSE;
        }
    }
    return TRUE;
}

gboolean devices_read_timing(const char *rig_path, struct rig *ret_geometry,
                             struct rig_timing *ret_timing, GPtrArray *assumed, GError **error) {
    struct layout layout;

    if (!layout_read(&layout, rig_path, NULL, TRUE, error))
        return FALSE;
    memset(ret_timing, 0, sizeof *ret_timing);
    *ret_geometry = layout.geometry;
    read_axis(&layout, layout.turntable, &ret_timing->turntable, assumed);
    read_axis(&layout, layout.arc, &ret_timing->arc, assumed);
    read_axis(&layout, layout.arm, &ret_timing->arm, assumed);
    read_axis(&layout, layout.probe, &ret_timing->probe, assumed);
    const gboolean ok = read_lights(&layout, ret_timing, assumed, error);
    for (int i = 0; i < layout.geometry.n_cameras && ok; i++) {
        if (devices_is_unit(&layout.geometry, i)) {
            read_camera(&layout, i, ret_timing, assumed);
            continue;
        }
        ret_timing->trigger_us[i] = ret_timing->trigger_us[i - 1];
        ret_timing->readout_us[i] = ret_timing->readout_us[i - 1];
        ret_timing->min_exposure_us[i] = ret_timing->min_exposure_us[i - 1];
        ret_timing->max_exposure_us[i] = ret_timing->max_exposure_us[i - 1];
        ret_timing->stamp_us[i] = ret_timing->stamp_us[i - 1];
        ret_timing->bits[i] = ret_timing->bits[i - 1];
        ret_timing->listed_exposures[i] = ret_timing->listed_exposures[i - 1];
    }
    layout_clear(&layout);
    return ok;
}
