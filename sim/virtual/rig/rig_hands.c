/* This file has what a person does to a rig by hand: unplug devices, plug them in, and exchange the
 * sample. */
#include "rig_private.h"

#include <gio/gio.h>
#include <string.h>

static gboolean set_cut(VirtualModbus *device, gboolean cut) {
    const struct virtual_modbus_faults faults = {.cut = cut};
    virtual_modbus_fail(device, &faults);
    return TRUE;
}

/* Returns the Modbus device whose bus is named at the beginning of `where`, such as "/dev/pts/5
 * unit 1". Returns NULL if there is none. */
static VirtualModbus *find_modbus(const VirtualRig *rig, const char *where) {
    for (int i = 0; i < rig->n_drives + rig->n_boards; i++) {
        VirtualModbus *device =
            i < rig->n_drives ? rig->drives[i].device : rig->boards[i - rig->n_drives].device;
        const char *bus = virtual_modbus_bus(device);
        if (g_str_has_prefix(where, bus) && where[strlen(bus)] == ' ')
            return device;
    }
    return NULL;
}

static gboolean plug_camera(VirtualRig *rig, const char *name, gboolean plugged) {
    for (int i = 0; i < rig->n_cameras; i++) {
        const struct vision_camera *camera = &rig->cameras[i];
        struct virtual_camera_faults faults = rig->camera_faults;
        if (!g_str_equal(camera->name, name))
            continue;
        faults.unplugged = !plugged;
        if (camera->gige)
            virtual_gige_fail(camera->gige, &faults);
        else if (camera->still)
            virtual_ptpip_fail(camera->still,
                               &(struct virtual_ptpip_faults){.unplugged = !plugged});
        else
            (plugged ? virtual_u3v_plug : virtual_u3v_unplug)(camera->u3v);
        return TRUE;
    }
    return FALSE;
}

gboolean virtual_rig_plug(VirtualRig *rig, const char *name, gboolean plugged, GError **error) {
    g_autoptr(GString) names = g_string_new(NULL);
    for (guint i = 0; i < rig->devices->len; i++) {
        const struct virtual_rig_device *device =
            &g_array_index(rig->devices, struct virtual_rig_device, i);
        const char *blank = strchr(device->section, ' ');
        const char *own = blank ? blank + 1 : device->section;
        VirtualModbus *modbus = find_modbus(rig, device->where);
        g_string_append_printf(names, "%s%s", names->len ? ", " : "", own);
        if (!g_str_equal(own, name) && !g_str_equal(device->section, name))
            continue;
        if (modbus
                ? set_cut(modbus, !plugged)
                : rig_plug_gcode(rig, device->where, plugged) ||
                      rig_plug_leds(rig, device->where, plugged) || plug_camera(rig, own, plugged))
            return TRUE;
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_NOT_SUPPORTED,
                    "%s (driver %s) cannot be unplugged; unplug a device on Modbus, on a G-code "
                    "board, a serial LED controller, or a "
                    "GigE Vision, USB3 Vision or PTP/IP camera",
                    own, device->driver);
        return FALSE;
    }
    g_set_error(error, G_IO_ERROR, G_IO_ERROR_NOT_FOUND,
                "the rig has no device “%s”; give one of its devices: %s", name, names->str);
    return FALSE;
}

static gboolean have_same_names(char *const *a, char *const *b, int n_a, int n_b) {
    for (int i = 0; i < n_a && n_a == n_b; i++)
        if (!g_str_equal(a[i], b[i]))
            return FALSE;
    return n_a == n_b;
}

/* Returns whether the new world fits the rig. Cameras, lamps and lasers must have the same names in
 * the same order, because the rig identifies them by their numbers in the world. Size, bits and
 * colour filter of each camera must also be equal. */
static gboolean fits(const World *is, const World *new, const char *path, GError **error) {
    const char *other =
        !have_same_names(is->camera_names, new->camera_names, is->n_cameras, new->n_cameras)
            ? "cameras"
        : !have_same_names(is->lamp_names, new->lamp_names, is->n_lamps, new->n_lamps) ? "lamps"
        : !have_same_names(is->laser_names, new->laser_names, is->n_lasers, new->n_lasers)
            ? "lasers"
            : NULL;
    if (other) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_ARGUMENT,
                    "%s has other %s, or the same %s in another order, than the world of this rig; "
                    "copy the file of that world and change only the sample",
                    path, other, other);
        return FALSE;
    }
    for (int c = 0; c < is->n_cameras; c++) {
        struct world_sensor a, b;
        world_sensor(is, c, &a);
        world_sensor(new, c, &b);
        if (a.width == b.width && a.height == b.height && a.bits == b.bits && a.cfa == b.cfa)
            continue;
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_ARGUMENT,
                    "%s gives the camera %s another width, height, bits or cfa than the world of "
                    "this rig; copy the file of that world and change only the sample",
                    path, is->camera_names[c]);
        return FALSE;
    }
    return TRUE;
}

static void replace(struct world_part *part, World *world) {
    if (!part->world)
        return;
    world_unref(part->world);
    part->world = world_ref(world);
}

gboolean virtual_rig_set_world(VirtualRig *rig, const char *path, GError **error) {
    if (rig->n_tics + rig->n_relays + rig->n_videos > 0) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_NOT_SUPPORTED,
                    "this rig has Tics, USB relay boards or V4L2 cameras, whose world cannot be "
                    "replaced; start mesorig-rig without --usb");
        return FALSE;
    }
    World *world = world_get(path, error);
    if (world && world == rig->world) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_EXISTS,
                    "%s is the world that the rig has now, and a file is read only once; save the "
                    "changed world in a file with another name",
                    path);
        world_unref(world);
        return FALSE;
    }
    if (!world || !fits(rig->world, world, path, error)) {
        world_unref(world);
        return FALSE;
    }
    g_mutex_lock(&rig->coupling);
    for (int i = 0; i < rig->n_drives; i++)
        replace(&rig->drives[i].part, world);
    for (int i = 0; i < rig->n_gcode_axes; i++)
        replace(&rig->gcode_drives[i].part, world);
    for (int b = 0; b < rig->n_led_banks; b++)
        for (int i = 0; i < rig->led_banks[b].n; i++) {
            replace(&rig->led_banks[b].parts[i], world);
            if (rig->led_banks[b].on[i])
                world_part_switch(&rig->led_banks[b].parts[i], TRUE, g_get_monotonic_time());
        }
    for (int i = 0; i < rig->n_boards; i++) {
        struct board *board = &rig->boards[i];
        for (int k = 0; k < board->n_coils; k++) {
            replace(&board->parts[k], world);
            if (board->on[k])
                world_part_switch(&board->parts[k], TRUE, g_get_monotonic_time());
        }
    }
    world_unref(rig->world);
    rig->world = world;
    g_mutex_unlock(&rig->coupling);
    return TRUE;
}
