#include "bus_safety.h"

#include "bus_errors.h"
#include "bus_latch.h"
#include "bus_unattended.h"

#include <string.h>

/* Decides whether a device may give light or move. */
static gboolean permits(const struct device *device, gpointer data, GError **error) {
    Bus *bus = data;
    if (!bus_latch_need_released(bus->latch, error))
        return FALSE;
    const gboolean is_laser = strcmp(device->info->class_name, "laser") == 0;
    return !is_laser || !bus->guardian || guardian_answers(bus->guardian, error);
}

static void show_unsafe(Bus *bus) {
    g_autofree const char **names =
        (const char **)g_hash_table_get_keys_as_array(bus->unsafe, NULL);
    bus_rig1_set_unsafe(bus->object, names);
    bus_show_devices(bus);
}

/* A virtual clock runs until every device has confirmed. */
static void on_safety(struct device *device, const GError *error, gpointer data) {
    Bus *bus = data;
    if (error) {
        g_autofree char *text = g_strdup_printf(DEVICES_UNSAFE ": %s", error->message);
        const gboolean is_new = !g_hash_table_contains(bus->unsafe, device->who);
        g_hash_table_insert(bus->unsafe, g_strdup(device->who), g_strdup(error->message));
        bus_hold_clock(bus, FALSE);
        if (is_new)
            bus_report(bus, "error", device->name, text);
    } else if (g_hash_table_remove(bus->unsafe, device->who)) {
        const gboolean is_axis = strcmp(device->info->class_name, "axis") == 0;
        g_hash_table_remove(bus->faults, device->name);
        bus_report(bus, "info", device->name,
                   is_axis ? "confirmed again that it stands still" : "confirmed off again");
        bus_rest_clock(bus);
        bus_unattended_poke(bus);
    }
    show_unsafe(bus);
}

void bus_safety_watch(Bus *bus) {
    devices_set_permit(bus->devices, permits, bus);
    devices_watch_safety(bus->devices, on_safety, bus);
}

void bus_safety_forget(Bus *bus) {
    g_hash_table_remove_all(bus->unsafe);
    show_unsafe(bus);
}

gboolean bus_need_safe(Bus *bus, GError **error) {
    GHashTableIter iter;
    gpointer who, why;
    g_hash_table_iter_init(&iter, bus->unsafe);
    if (!g_hash_table_iter_next(&iter, &who, &why))
        return TRUE;
    g_set_error(error, BUS_ERROR, BUS_ERROR_BUSY,
                "%s has not confirmed that it is off or stands still; the command is repeated "
                "until it does (%s): look at the device, and cut its power if it does not obey",
                (const char *)who, (const char *)why);
    return FALSE;
}
