#include "devices_private.h"

#include "lamp_places.h"

#include <gio/gio.h>
#include <string.h>

/* Time limit of devices_secure(). It is longer than the time for which any class waits until a
 * device answers or stops. */
#define SECURE_MS 20000

/*
 * The driver of an interlock that stands for all interlocks of the rig and guards the lasers
 * (devices->guard). It is closed while all others are closed. The listener on_interlock() sets its
 * state.
 */
static gboolean open_all(Interlock *interlock, GError **error) {
    return TRUE;
}

static void close_all(Interlock *interlock) {
}

static const struct interlock_driver all_driver = {
    .info = {.class_name = "interlock", .name = "all", .help = "All interlocks of the rig"},
    .open = open_all,
    .close = close_all,
};

static gboolean all_closed(const struct devices *devices) {
    for (int i = 0; i < devices->n_interlocks; i++)
        if (!interlock_is_closed(devices->interlocks[i]))
            return FALSE;
    return TRUE;
}

static void on_interlock(Interlock *interlock, gboolean closed, gpointer data) {
    struct devices *devices = data;

    interlock_report(devices->guard, closed && all_closed(devices));
}

/* Adds the section of the rig file to the error of a driver that cannot open its device, unless the
 * error already names a place in the rig file. Always returns FALSE. */
static gboolean fail_at(const struct config_section *section, GError **error) {
    const char *path = config_path(section->config);

    if (error && *error && g_strcmp0(error_details_file(*error), path) != 0) {
        g_autofree char *where = g_strdup_printf("[%s]", section->group);
        error_details_add_place(error, path, section->line, where);
    }
    return FALSE;
}

static gboolean open_interlocks(struct devices *devices, const struct layout *layout,
                                GError **error) {
    for (int i = 0; i < layout->n_interlocks; i++) {
        const struct config_section *section = layout->interlocks[i];
        gconstpointer driver = layout_device(layout, section)->info;
        Interlock *opened = interlock_open(driver, section, NULL, devices->clock, error);
        if (!opened)
            return fail_at(section, error);
        devices->interlocks[devices->n_interlocks++] = opened;
    }
    if (devices->n_interlocks == 0)
        return TRUE;
    g_autoptr(Config) config = config_parse("[interlock of the rig]\ndriver=all\n", "", error);
    if (!config)
        return FALSE;
    devices->guard = interlock_open(&all_driver, config_find(config, "interlock", "of the rig"),
                                    NULL, devices->clock, error);
    if (!devices->guard)
        return FALSE;
    for (int i = 0; i < devices->n_interlocks; i++)
        interlock_listen(devices->interlocks[i], on_interlock, devices);
    interlock_report(devices->guard, all_closed(devices));
    return TRUE;
}

static Axis *open_axis(struct devices *devices, const struct layout *layout,
                       const struct config_section *section, GError **error) {
    gconstpointer driver = layout_device(layout, section)->info;
    g_autofree const char **keys = layout_keys("axis");
    g_autoptr(Axis) axis = axis_open(driver, section, keys, devices->clock, error);
    const char *park = config_value(section, LAYOUT_PARK_KEY, NULL);

    if (!axis) {
        fail_at(section, error);
        return NULL;
    }
    if (park) /* the layout has checked that it is a number */
        axis->park_deg = g_ascii_strtod(park, NULL);
    if (park && !axis->motion.wraps &&
        (axis->park_deg < axis->motion.min_deg || axis->park_deg > axis->motion.max_deg)) {
        config_set_error(error, CONFIG_ERROR_VALUE, section, LAYOUT_PARK_KEY,
                         "%g is outside the limits of the axis, %g to %g degrees; correct it, or "
                         "min_deg and max_deg",
                         axis->park_deg, axis->motion.min_deg, axis->motion.max_deg);
        return NULL;
    }
    return g_steal_pointer(&axis);
}

static gboolean open_axes(struct devices *devices, const struct layout *layout, GError **error) {
    const struct {
        const struct config_section *section;
        Axis **axis;
        struct axis_motion *motion; /* limits are 0 to 0 if there is no such axis */
    } axes[] = {{layout->turntable, &devices->turntable, &devices->timing.turntable},
                {layout->arc, &devices->arc, &devices->timing.arc},
                {layout->arm, &devices->arm, &devices->timing.arm},
                {layout->probe, &devices->probe, &devices->timing.probe}};

    for (gsize i = 0; i < G_N_ELEMENTS(axes); i++) {
        if (!axes[i].section)
            continue;
        if (!(*axes[i].axis = open_axis(devices, layout, axes[i].section, error)))
            return FALSE;
        *axes[i].motion = (*axes[i].axis)->motion;
    }
    for (int i = 0; i < layout->geometry.n_lasers; i++) {
        for (int k = 0; k < i && !devices->sweeps[i]; k++)
            if (layout->sweeps[k] == layout->sweeps[i])
                devices->sweeps[i] = devices->sweeps[k];
        if (!devices->sweeps[i] &&
            !(devices->sweeps[i] = open_axis(devices, layout, layout->sweeps[i], error)))
            return FALSE;
        devices->timing.sweep[i] = devices->sweeps[i]->motion;
    }
    return TRUE;
}

/* Reports a lamp that its bank does not have. */
static void refuse_index(const struct layout *layout, int lamp, const LampBank *bank,
                         Mistakes *mistakes) {
    const char *key = lamp_places_key(layout->lamps[lamp]);

    if (key)
        config_mistake(mistakes, CONFIG_ERROR_VALUE, layout->lamps[lamp], key,
                       "%s would be lamp %d, but %s has the lamps 0 to %d; place fewer lamps, or "
                       "correct the number of lamps of the bank",
                       layout->geometry.lamps[lamp].name, layout->lamp_index[lamp],
                       bank->device.name, bank->n - 1);
    else
        config_mistake(mistakes, CONFIG_ERROR_VALUE, layout->lamps[lamp], "index",
                       "%d is too large: %s has the lamps 0 to %d", layout->lamp_index[lamp],
                       bank->device.name, bank->n - 1);
}

static gboolean open_banks(struct devices *devices, const struct layout *layout, GError **error) {
    g_autofree const char **keys = layout_keys("lamps");

    for (int i = 0; i < layout->n_banks; i++) {
        const struct config_section *section = layout->banks[i].section;
        gconstpointer driver = layout_device(layout, section)->info;
        LampBank *bank = lamps_open(driver, section, keys, devices->clock, error);
        if (!bank)
            return fail_at(section, error);
        devices->banks[devices->n_banks++] = bank;
    }
    g_autoptr(Mistakes) mistakes = mistakes_new();
    const struct config_section *told = NULL;
    for (int i = 0; i < layout->geometry.n_lamps; i++) {
        LampBank *bank = devices->banks[layout->lamp_bank[i]];
        if (layout->lamp_index[i] >= bank->n && layout->lamps[i] != told)
            refuse_index(layout, i, bank, mistakes);
        if (layout->lamp_index[i] >= bank->n)
            told = layout->lamps[i];
        devices->lamps[i].bank = bank;
        devices->lamps[i].index = layout->lamp_index[i];
        devices->timing.lamp_warm_up_s[i] = bank->warm_up_s;
    }
    return mistakes_report(mistakes, error);
}

/* Adds a further mount position of a laser unit. Calls laser_mount() for the position to find out
 * whether the driver knows it, so that an error is reported now and not after an operator has
 * mounted the unit there. */
static gboolean open_mount(struct devices *devices, const struct layout *layout, int i,
                           GError **error) {
    int unit = layout->unit[i];
    Laser *laser = devices->lasers[unit];

    if (!laser_mount(laser, layout->lasers[i]->name, error) ||
        !laser_mount(laser, layout->lasers[unit]->name, error))
        return fail_at(layout->lasers[i], error);
    devices->lasers[i] = laser;
    devices->timing.mounts[unit] |= 1u << i;
    devices->timing.laser_warm_up_s[i] = laser->warm_up_s;
    return TRUE;
}

static gboolean open_lasers(struct devices *devices, const struct layout *layout, GError **error) {
    g_autofree const char **keys = layout_keys("laser");

    for (int i = 0; i < layout->geometry.n_lasers; i++) {
        if (layout->unit[i] != i) {
            if (!open_mount(devices, layout, i, error))
                return FALSE;
            continue;
        }
        gconstpointer driver = layout_device(layout, layout->lasers[i])->info;
        devices->lasers[i] = laser_open(driver, layout->lasers[i], keys, devices->clock, error);
        if (!devices->lasers[i])
            return fail_at(layout->lasers[i], error);
        laser_guard(devices->lasers[i], devices->guard);
        devices->timing.laser_warm_up_s[i] = devices->lasers[i]->warm_up_s;
    }
    return TRUE;
}

static void check_format(const struct camera_format *format, const struct rig_camera *said,
                         const struct config_section *section, Mistakes *mistakes) {
    gboolean wide = said->width != format->width;

    if (wide || said->height != format->height)
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, wide ? "width" : "height",
                       "is %d, but the camera's pictures are %d × %d: write width = %d and height "
                       "= %d",
                       wide ? said->width : said->height, format->width, format->height,
                       format->width, format->height);
}

/* Opens the cameras. Begins to open all of them before it waits for any of them, so that many
 * cameras take no longer than the slowest one. */
static gboolean open_cameras(struct devices *devices, const struct layout *layout, GError **error) {
    g_autofree const char **keys = layout_keys("camera");
    g_autoptr(Mistakes) mistakes = mistakes_new();

    for (int i = 0; i < layout->geometry.n_cameras; i++) {
        const struct config_section *section = layout->cameras[i];
        if (!devices_is_unit(&layout->geometry, i)) {
            devices->cameras[i] = devices->cameras[i - 1];
            continue;
        }
        gconstpointer driver = layout_device(layout, section)->info;
        devices->cameras[i] = camera_open_begin(driver, section, keys, devices->clock, error);
        if (!devices->cameras[i])
            return fail_at(section, error);
    }
    for (int i = 0; i < layout->geometry.n_cameras; i++) {
        const struct camera_format *format = &devices->cameras[i]->format;
        if (devices_is_unit(&layout->geometry, i) &&
            !camera_open_finish(devices->cameras[i], error))
            return fail_at(layout->cameras[i], error);
        check_format(format, &layout->geometry.cameras[i], layout->cameras[i], mistakes);
        devices->timing.trigger_us[i] = format->trigger_us;
        devices->timing.readout_us[i] = format->readout_us;
        devices->timing.min_exposure_us[i] = format->min_exposure_us;
        devices->timing.max_exposure_us[i] = format->max_exposure_us;
        devices->timing.stamp_us[i] = format->stamp_us;
        devices->timing.bits[i] = format->bits;
        devices->timing.listed_exposures[i] = devices->cameras[i]->driver->listed_exposures;
    }
    return mistakes_report(mistakes, error);
}

struct devices *devices_open(const char *rig_path, GError **error) {
    struct layout layout;

    if (!layout_read(&layout, rig_path, NULL, TRUE, error))
        return NULL;
    struct devices *devices = g_new0(struct devices, 1);
    devices->clock = layout.virtual_clock ? clock_new_virtual() : clock_new_real();
    devices->geometry = layout.geometry;
    devices->text = layout_text(&layout);
    devices->path = g_canonicalize_filename(config_path(layout.config), NULL);
    devices->calibration_path = g_strdup(layout.calibration_path);
    devices->calibration_days = layout.calibration_days;
    if (!open_interlocks(devices, &layout, error) || !open_axes(devices, &layout, error) ||
        !open_banks(devices, &layout, error) || !open_lasers(devices, &layout, error) ||
        !open_cameras(devices, &layout, error))
        g_clear_pointer(&devices, devices_close);
    layout_clear(&layout);
    return devices;
}

gboolean devices_check_file(const struct devices *devices, GError **error) {
    struct layout layout;
    g_autofree char *text = NULL;
    if (!g_file_test(devices->path, G_FILE_TEST_EXISTS))
        return TRUE;
    if (layout_read(&layout, devices->path, NULL, FALSE, NULL)) {
        text = layout_text(&layout);
        layout_clear(&layout);
    }
    if (g_strcmp0(text, devices->text) == 0)
        return TRUE;
    g_set_error(error, G_IO_ERROR, G_IO_ERROR_FAILED,
                "the rig file %s has changed since mesorigd opened it: run “mesorig close”, or "
                "restart the service mesorigd, so that the changed file is opened",
                devices->path);
    return FALSE;
}

static gboolean read_geometry(const char *path, const char *text, struct rig *ret, GError **error) {
    struct layout layout;

    if (!layout_read(&layout, path, text, FALSE, error))
        return FALSE;
    *ret = layout.geometry;
    layout_clear(&layout);
    return TRUE;
}

gboolean devices_read_geometry(const char *rig_path, struct rig *ret, GError **error) {
    return read_geometry(rig_path, NULL, ret, error);
}

gboolean devices_parse_geometry(const char *text, const char *path, struct rig *ret,
                                GError **error) {
    return read_geometry(path, text, ret, error);
}

static gboolean is_first_sweep(const struct devices *devices, int laser) {
    for (int i = 0; i < laser; i++)
        if (devices->sweeps[i] == devices->sweeps[laser])
            return FALSE;
    return TRUE;
}

/* Lasers and lamps are closed first, because closing switches them off and their light may injure
 * somebody. */
void devices_close(struct devices *devices) {
    if (!devices)
        return;
    for (int i = 0; i < RIG_MAX_LASERS; i++)
        if (rig_laser_unit(&devices->timing, i) == i)
            laser_close(devices->lasers[i]);
    for (int i = 0; i < devices->n_banks; i++)
        lamps_close(devices->banks[i]);
    for (int i = 0; i < RIG_MAX_LASERS; i++)
        if (is_first_sweep(devices, i))
            axis_close(devices->sweeps[i]);
    for (int i = 0; i < DEVICES_POSITIONERS; i++)
        axis_close(devices_positioner(devices, i));
    for (int i = 0; i < RIG_MAX_CAMERAS; i++)
        if (devices_is_unit(&devices->geometry, i))
            camera_close(devices->cameras[i]);
    for (int i = 0; i < devices->n_interlocks; i++)
        interlock_close(devices->interlocks[i]);
    interlock_close(devices->guard);
    clock_unref(devices->clock);
    g_free(devices->text);
    g_free(devices->path);
    g_free(devices->calibration_path);
    g_free(devices);
}

/* Adds an error, if it is not NULL, to the collected errors. *collected is a single error with the
 * domain and the code of the first one, and with the messages of all. Takes ownership of error. */
static void collect(GError **collected, GError *error) {
    if (!error)
        return;
    if (!*collected) {
        *collected = error;
        return;
    }
    char *both = g_strconcat((*collected)->message, "; ", error->message, NULL);
    g_free((*collected)->message);
    (*collected)->message = both;
    g_error_free(error);
}

static void stop(Axis *axis, GError **collected) {
    GError *error = NULL;

    if (axis)
        axis_stop(axis, &error);
    collect(collected, error);
}

static gboolean is_simulated(const struct device *device) {
    return !device || g_str_has_prefix(device->info->name, "sim-");
}

gboolean devices_are_simulated(const struct devices *devices) {
    gboolean all = TRUE;
    for (int i = 0; i < DEVICES_POSITIONERS; i++)
        all &= is_simulated((const struct device *)devices_positioner(devices, i));
    for (int i = 0; i < devices->geometry.n_cameras; i++)
        all &= is_simulated(&devices->cameras[i]->device);
    for (int i = 0; i < devices->n_banks; i++)
        all &= is_simulated(&devices->banks[i]->device);
    for (int i = 0; i < devices->geometry.n_lasers; i++)
        all &= is_simulated(&devices->lasers[i]->device) &&
               is_simulated((const struct device *)devices->sweeps[i]);
    for (int i = 0; i < devices->n_interlocks; i++)
        all &= is_simulated(&devices->interlocks[i]->device);
    return all;
}

gboolean devices_make_safe(struct devices *devices, GError **error) {
    GError *collected = NULL;

    for (int i = 0; i < devices->geometry.n_lasers; i++) {
        GError *failed = NULL;
        if (rig_laser_unit(&devices->timing, i) == i)
            laser_set(devices->lasers[i], FALSE, &failed);
        collect(&collected, failed);
    }
    for (int i = 0; i < devices->n_banks; i++) {
        GError *failed = NULL;
        lamps_all_off(devices->banks[i], &failed);
        collect(&collected, failed);
    }
    for (int i = 0; i < devices->geometry.n_lasers; i++)
        if (is_first_sweep(devices, i))
            stop(devices->sweeps[i], &collected);
    for (int i = 0; i < DEVICES_POSITIONERS; i++)
        stop(devices_positioner(devices, i), &collected);
    if (!collected)
        return TRUE;
    g_propagate_error(error, collected);
    return FALSE;
}

static void add_safety(GVariantBuilder *list, const struct device *device,
                       enum device_safety safety, enum device_safety *most) {
    const char *words[] = {device->info->confirmed ? device->info->confirmed : "read back",
                           "NOT safe", "commanded only"};
    g_variant_builder_add(list, "(sss)", device->info->class_name, device->name, words[safety]);
    *most = MAX(*most, safety);
}

GVariant *devices_safety(const struct devices *devices, enum device_safety *ret) {
    GVariantBuilder list;
    *ret = DEVICE_SAFE;
    g_variant_builder_init(&list, G_VARIANT_TYPE("a(sss)"));
    for (int i = 0; i < devices->geometry.n_lasers; i++)
        if (rig_laser_unit(&devices->timing, i) == i)
            add_safety(&list, &devices->lasers[i]->device, laser_safety(devices->lasers[i]), ret);
    for (int i = 0; i < devices->n_banks; i++)
        add_safety(&list, &devices->banks[i]->device, lamps_safety(devices->banks[i]), ret);
    for (int i = 0; i < devices->geometry.n_lasers; i++)
        if (is_first_sweep(devices, i) && devices->sweeps[i])
            add_safety(&list, &devices->sweeps[i]->device, axis_safety(devices->sweeps[i]), ret);
    for (int i = DEVICES_POSITIONERS - 1; i >= 0; i--) {
        const Axis *axis = devices_positioner(devices, i);
        if (axis)
            add_safety(&list, &axis->device, axis_safety(axis), ret);
    }
    return g_variant_builder_end(&list);
}

/* Calls func once for each axis, lamp bank and laser. */
static void foreach(const struct devices *devices,
                    void (*func)(struct device *device, gpointer data), gpointer data) {
    for (int i = 0; i < devices->geometry.n_lasers; i++) {
        if (devices->lasers[i] && rig_laser_unit(&devices->timing, i) == i)
            func(&devices->lasers[i]->device, data);
        if (devices->sweeps[i] && is_first_sweep(devices, i))
            func(&devices->sweeps[i]->device, data);
    }
    for (int i = 0; i < devices->n_banks; i++)
        func(&devices->banks[i]->device, data);
    for (int i = 0; i < DEVICES_POSITIONERS; i++)
        if (devices_positioner(devices, i))
            func(&devices_positioner(devices, i)->device, data);
}

struct permit {
    DevicePermit func;
    gpointer data;
};

static void set_permit(struct device *device, gpointer data) {
    const struct permit *permit = data;
    device_set_permit(device, permit->func, permit->data);
}

void devices_set_permit(struct devices *devices, DevicePermit permit, gpointer data) {
    foreach(devices, set_permit, &(struct permit){permit, data});
}

struct watch {
    DeviceSafetyFunc func;
    gpointer data;
};

static void watch_safety(struct device *device, gpointer data) {
    const struct watch *watch = data;
    device_watch_safety(device, watch->func, watch->data);
}

void devices_watch_safety(struct devices *devices, DeviceSafetyFunc func, gpointer data) {
    foreach(devices, watch_safety, &(struct watch){func, data});
}

static void add_identity(struct device *device, gpointer data) {
    if (device->identity)
        g_ptr_array_add(data, g_strdup_printf("%s: %s", device->who, device->identity));
}

GPtrArray *devices_identities(const struct devices *devices) {
    GPtrArray *ret = g_ptr_array_new_with_free_func(g_free);
    foreach(devices, add_identity, ret);
    for (int i = 0; i < devices->geometry.n_cameras; i++)
        if (devices_is_unit(&devices->geometry, i))
            add_identity(&devices->cameras[i]->device, ret);
    for (int i = 0; i < devices->n_interlocks; i++)
        add_identity(&devices->interlocks[i]->device, ret);
    return ret;
}

static void find_unsafe(struct device *device, gpointer data) {
    *(gboolean *)data |= device_is_unsafe(device);
}

gboolean devices_any_unsafe(const struct devices *devices) {
    gboolean any = FALSE;
    foreach(devices, find_unsafe, &any);
    return any;
}

/* Answer of a device to devices_secure(). */
struct answer {
    const char *who; /* name of the device; not owned */
    gboolean done;
    GError *error;
};

struct securing {
    /* in the order in which the devices were commanded */
    struct answer answers[2 * RIG_MAX_LASERS + DEVICES_MAX_BANKS + DEVICES_POSITIONERS];
    int n;
    gboolean too_late;
};

/* Stores the answer of a device. A later answer replaces an earlier one, because the earlier one
 * may belong to a command of a session. */
static void take_answer(struct answer *answer, const GError *error) {
    answer->done = TRUE;
    g_clear_error(&answer->error);
    answer->error = error ? g_error_copy(error) : NULL;
}

static void on_laser_off(Laser *laser, gboolean on, const GError *error, gpointer data) {
    if (!on)
        take_answer(data, error);
}

static void on_lamps_off(LampBank *bank, int index, gboolean on, gint64 at_us, const GError *error,
                         gpointer data) {
    if (index < 0 && !on)
        take_answer(data, error);
}

static void on_axis_stopped(Axis *axis, enum axis_event event, const GError *error, gpointer data) {
    take_answer(data, error);
}

static void secure_axis(Axis *axis, struct securing *securing) {
    g_autoptr(GError) error = NULL;
    if (!axis)
        return;
    struct answer *answer = &securing->answers[securing->n++];
    answer->who = axis->device.who;
    axis_listen(axis, on_axis_stopped, answer);
    if (!axis_halt(axis, &error))
        take_answer(answer, error);
}

static void secure_laser(Laser *laser, struct securing *securing) {
    g_autoptr(GError) error = NULL;
    struct answer *answer = &securing->answers[securing->n++];
    answer->who = laser->device.who;
    laser_listen(laser, on_laser_off, answer);
    if (!laser_set(laser, FALSE, &error))
        take_answer(answer, error);
}

static void secure_bank(LampBank *bank, struct securing *securing) {
    g_autoptr(GError) error = NULL;
    struct answer *answer = &securing->answers[securing->n++];
    answer->who = bank->device.who;
    lamps_listen(bank, on_lamps_off, answer);
    if (!lamps_all_off(bank, &error))
        take_answer(answer, error);
}

static gboolean on_too_late(gpointer data) {
    ((struct securing *)data)->too_late = TRUE;
    return G_SOURCE_CONTINUE;
}

static gboolean is_answered(const struct securing *securing) {
    for (int i = 0; i < securing->n; i++)
        if (!securing->answers[i].done)
            return FALSE;
    return TRUE;
}

static void unlisten(struct devices *devices) {
    for (int i = 0; i < devices->geometry.n_lasers; i++) {
        if (devices->lasers[i])
            laser_listen(devices->lasers[i], NULL, NULL);
        if (devices->sweeps[i])
            axis_listen(devices->sweeps[i], NULL, NULL);
    }
    for (int i = 0; i < devices->n_banks; i++)
        lamps_listen(devices->banks[i], NULL, NULL);
    for (int i = 0; i < DEVICES_POSITIONERS; i++)
        if (devices_positioner(devices, i))
            axis_listen(devices_positioner(devices, i), NULL, NULL);
}

gboolean devices_secure(struct devices *devices, GError **error) {
    struct securing securing = {0};
    GError *collected = NULL;
    for (int i = 0; i < devices->geometry.n_lasers; i++)
        if (rig_laser_unit(&devices->timing, i) == i)
            secure_laser(devices->lasers[i], &securing);
    for (int i = 0; i < devices->n_banks; i++)
        secure_bank(devices->banks[i], &securing);
    for (int i = 0; i < devices->geometry.n_lasers; i++)
        if (is_first_sweep(devices, i))
            secure_axis(devices->sweeps[i], &securing);
    for (int i = 0; i < DEVICES_POSITIONERS; i++)
        secure_axis(devices_positioner(devices, i), &securing);
    /* The device classes have their own deadlines on the rig's clock. This deadline is for a rig
     * whose clock does not run. */
    guint timer = g_timeout_add(SECURE_MS, on_too_late, &securing);
    while (!is_answered(&securing) && !securing.too_late)
        g_main_context_iteration(NULL, TRUE);
    g_source_remove(timer);
    unlisten(devices);
    for (int i = 0; i < securing.n; i++) {
        struct answer *answer = &securing.answers[i];
        if (!answer->done)
            device_error_set(&answer->error, DEVICE_ERROR_TIMEOUT, answer->who,
                             "has not confirmed its safe state within %d s" ERROR_ADVICE
                             "switch the rig off by hand",
                             SECURE_MS / 1000);
        collect(&collected, answer->error);
    }
    if (collected)
        g_propagate_error(error, collected);
    return collected == NULL;
}
