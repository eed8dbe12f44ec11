/* Reads the speeds and delays of the devices from the rig file, without opening a device. All
 * drivers of a class use the same option names. For an axis these are the names of
 * AXIS_MOTION_OPTIONS. For the other classes they are listed below. */
#include "devices_private.h"

#include <string.h>

#define ASSUMED_READOUT_MS 33.0 /* for a camera with 30 pictures a second */
#define ASSUMED_BITS       12
#define ASSUMED_STAMP_US   1000 /* for a camera whose time stamps are the time of the exposure */
#define MOST_EXPOSURE_US   60000000

struct offline { /* the options of one device */
    const struct driver_info *info;
    char *fields; /* the values that its driver's open() would find */
};

static gboolean offline_read(struct offline *device, const struct config_section *section,
                             GError **error) {
    g_autofree const char **also = layout_keys(section->class_name);
    g_autoptr(GPtrArray) keys = g_ptr_array_new();

    for (const char **key = also; *key; key++)
        g_ptr_array_add(keys, (gpointer)*key);
    g_ptr_array_add(keys, (gpointer) "driver");
    g_ptr_array_add(keys, NULL);
    *device = (struct offline){drivers_find(section, error), NULL};
    if (!device->info)
        return FALSE;
    device->fields = g_malloc0(MAX(device->info->priv_size, 1));
    if (options_parse(device->info->options, section, (const char *const *)keys->pdata,
                      device->fields, error))
        return TRUE;
    g_clear_pointer(&device->fields, g_free);
    return FALSE;
}

static void offline_clear(struct offline *device) {
    if (device->fields)
        options_clear(device->info->options, device->fields);
    g_clear_pointer(&device->fields, g_free);
}

/* Returns FALSE if its driver has no such option. */
static gboolean offline_number(const struct offline *device, const char *name, double *ret) {
    const struct option *option = options_find(device->info->options, name);

    if (!option || (option->type != OPTION_DOUBLE && option->type != OPTION_INT))
        return FALSE;
    *ret = option->type == OPTION_INT ? *(int *)(gpointer)(device->fields + option->offset)
                                      : *(double *)(gpointer)(device->fields + option->offset);
    return TRUE;
}

G_GNUC_PRINTF(3, 4)
static void offline_assume(GPtrArray *assumed, const struct config_section *section,
                           const char *format, ...) {
    va_list args;

    va_start(args, format);
    g_autofree char *what = g_strdup_vprintf(format, args);
    va_end(args);
    g_ptr_array_add(assumed, g_strdup_printf("assumed for [%s]: %s", section->group, what));
}

/* Sets report_ms and stamp_ms of an axis that has turn(). While the axis turns, it reports its
 * position with each poll. Its driver's open() adds the time that an answer may take. */
static void offline_turn(const struct offline *device, struct axis_motion *motion) {
    const struct axis_driver *driver = (const struct axis_driver *)device->info;
    double poll_ms, speed_register, stamp_ms = 0;

    if (!driver->turn || motion->report_ms > 0 || !offline_number(device, "poll_ms", &poll_ms) ||
        (offline_number(device, "speed_register", &speed_register) && speed_register < 0))
        return;
    offline_number(device, "stamp_ms", &stamp_ms);
    motion->report_ms = poll_ms;
    motion->stamp_ms = stamp_ms;
}

static gboolean offline_axis(const struct config_section *section, struct axis_motion *ret,
                             GPtrArray *assumed, GError **error) {
    struct offline device;

    if (!section)
        return TRUE;
    if (!offline_read(&device, section, error))
        return FALSE;
    const struct option *first = options_find(device.info->options, "wraps");
    if (first) /* the whole struct, because the driver's table has it from AXIS_MOTION_OPTIONS */
        *ret = *(struct axis_motion *)(gpointer)(device.fields + first->offset -
                                                 G_STRUCT_OFFSET(struct axis_motion, wraps));
    else {
        *ret = (struct axis_motion){-360, 360, FALSE, 20, 40, 0, 0};
        offline_assume(assumed, section, "20° a second, from -360° to 360°");
    }
    offline_turn(&device, ret);
    offline_clear(&device);
    return TRUE;
}

/* Returns the warm-up time of a bank or laser. Simulated lamps take it from their world file, which
 * can be read without devices. */
static gboolean offline_warm_up(const struct config_section *section, double *ret_s,
                                GPtrArray *assumed, GError **error) {
    struct offline device;
    double ms;

    if (!offline_read(&device, section, error))
        return FALSE;
    gboolean ok = TRUE;
    if (offline_number(&device, "warm_up_ms", &ms)) {
        *ret_s = ms / 1000;
    } else if (!offline_number(&device, "warm_up_s", ret_s)) {
        *ret_s = 0;
        if (g_str_has_prefix(device.info->name, "sim-") &&
            g_str_equal(section->class_name, "lamps")) {
            Clock *clock = clock_new_virtual();
            LampBank *bank =
                lamps_open((const struct lamps_driver *)device.info, section, NULL, clock, error);
            ok = bank != NULL;
            *ret_s = ok ? bank->warm_up_s : 0;
            lamps_close(bank);
            clock_unref(clock);
        } else {
            offline_assume(assumed, section, "no time to warm up");
        }
    }
    offline_clear(&device);
    return ok;
}

static gboolean offline_camera(const struct config_section *section, int index,
                               struct rig_timing *timing, GPtrArray *assumed, GError **error) {
    struct offline device;
    double readout_ms = ASSUMED_READOUT_MS, trigger_ms = ASSUMED_READOUT_MS / 2;
    double min_us = 1, max_us = MOST_EXPOSURE_US, bits = ASSUMED_BITS;

    if (!offline_read(&device, section, error))
        return FALSE;
    if (!offline_number(&device, "readout_ms", &readout_ms) ||
        !offline_number(&device, "trigger_ms", &trigger_ms))
        offline_assume(assumed, section,
                       "30 pictures a second, because only the camera knows its rate");
    if (!offline_number(&device, "min_exposure_us", &min_us) ||
        !offline_number(&device, "max_exposure_us", &max_us))
        offline_assume(assumed, section, "that it supports the exposures of the session");
    offline_number(&device, "bits", &bits);
    timing->readout_us[index] = (gint64)(readout_ms * 1000);
    timing->trigger_us[index] = (gint64)(trigger_ms * 1000);
    timing->min_exposure_us[index] = (gint64)min_us;
    timing->max_exposure_us[index] = (gint64)max_us;
    timing->stamp_us[index] = g_str_has_prefix(device.info->name, "v4l2")   ? -1
                              : g_str_has_prefix(device.info->name, "sim-") ? 0
                                                                            : ASSUMED_STAMP_US;
    timing->bits[index] = bits > 0 ? (int)bits : ASSUMED_BITS;
    offline_clear(&device);
    return TRUE;
}

static gboolean offline_lights(const struct layout *layout, struct rig_timing *timing,
                               GPtrArray *assumed, GError **error) {
    double bank_s[DEVICES_MAX_BANKS] = {0};

    for (int i = 0; i < layout->n_banks; i++)
        if (!offline_warm_up(layout->banks[i], &bank_s[i], assumed, error))
            return FALSE;
    for (int i = 0; i < layout->geometry.n_lamps; i++)
        timing->lamp_warm_up_s[i] = bank_s[layout->lamp_bank[i]];
    for (int i = 0; i < layout->geometry.n_lasers; i++) {
        const int unit = layout->unit[i];
        if (!offline_axis(layout->sweeps[i], &timing->sweep[i], assumed, error))
            return FALSE;
        if (unit != i) {
            timing->mounts[unit] |= 1u << i;
            timing->laser_warm_up_s[i] = timing->laser_warm_up_s[unit];
        } else if (!offline_warm_up(layout->lasers[i], &timing->laser_warm_up_s[i], assumed,
                                    error)) {
            return FALSE;
        }
    }
    return TRUE;
}

gboolean devices_read_timing(const char *rig_path, struct rig *ret_geometry,
                             struct rig_timing *ret_timing, GPtrArray *assumed, GError **error) {
    struct layout layout;

    if (!layout_load(&layout, rig_path, TRUE, error))
        return FALSE;
    memset(ret_timing, 0, sizeof *ret_timing);
    *ret_geometry = layout.geometry;
    gboolean ok = offline_axis(layout.turntable, &ret_timing->turntable, assumed, error) &&
                  offline_axis(layout.arc, &ret_timing->arc, assumed, error) &&
                  offline_axis(layout.arm, &ret_timing->arm, assumed, error) &&
                  offline_axis(layout.probe, &ret_timing->probe, assumed, error) &&
                  offline_lights(&layout, ret_timing, assumed, error);
    for (int i = 0; i < layout.geometry.n_cameras && ok; i++) {
        if (devices_is_unit(&layout.geometry, i)) {
            ok = offline_camera(layout.cameras[i], i, ret_timing, assumed, error);
            continue;
        }
        ret_timing->trigger_us[i] = ret_timing->trigger_us[i - 1];
        ret_timing->readout_us[i] = ret_timing->readout_us[i - 1];
        ret_timing->min_exposure_us[i] = ret_timing->min_exposure_us[i - 1];
        ret_timing->max_exposure_us[i] = ret_timing->max_exposure_us[i - 1];
        ret_timing->stamp_us[i] = ret_timing->stamp_us[i - 1];
        ret_timing->bits[i] = ret_timing->bits[i - 1];
    }
    layout_clear(&layout);
    return ok;
}
