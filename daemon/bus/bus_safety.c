#include "bus_safety.h"

#include "bus_errors.h"
#include "bus_latch.h"

#include <string.h>

/* Returns whether a device may now give light or move. The latch must not be set. For a laser, the
 * guardian must also answer. */
static gboolean permits(const struct device *device, gpointer data, GError **error) {
    struct bus_rig *rig = data;
    if (!bus_latch_need_released(rig->latch, error))
        return FALSE;
    const gboolean is_laser = strcmp(device->info->class_name, "laser") == 0;
    return !is_laser || !rig->guardian || guardian_answers(rig->guardian, error);
}

static void show_unsafe(struct bus_rig *rig) {
    g_autofree const char **names =
        (const char **)g_hash_table_get_keys_as_array(rig->unsafe, NULL);
    bus_rig1_set_unsafe(rig->object, names);
    bus_rig_show_devices(rig);
}

/* Called with an error when a device has not confirmed that it is safe, and without an error when
 * it has confirmed again. If the clock is virtual, it runs until every device has confirmed,
 * because commands to unsafe devices are repeated on that clock. */
static void on_safety(struct device *device, const GError *error, gpointer data) {
    struct bus_rig *rig = data;
    if (error) {
        g_autofree char *text = g_strdup_printf(DEVICES_UNSAFE ": %s", error->message);
        const gboolean is_new = !g_hash_table_contains(rig->unsafe, device->who);
        g_hash_table_insert(rig->unsafe, g_strdup(device->who), g_strdup(error->message));
        bus_rig_hold_clock(rig, FALSE);
        if (is_new)
            bus_rig_report(rig, "error", device->name, text);
    } else if (g_hash_table_remove(rig->unsafe, device->who)) {
        const gboolean is_axis = strcmp(device->info->class_name, "axis") == 0;
        g_hash_table_remove(rig->faults, device->name);
        bus_rig_report(rig, "info", device->name,
                       is_axis ? "confirmed again that it stands still" : "confirmed off again");
        bus_safety_rest_clock(rig);
        rig->freed(rig->data);
    }
    show_unsafe(rig);
}

void bus_safety_watch(struct bus_rig *rig) {
    devices_set_permit(rig->devices, permits, rig);
    devices_watch_safety(rig->devices, on_safety, rig);
}

void bus_safety_forget(struct bus_rig *rig) {
    g_hash_table_remove_all(rig->unsafe);
    show_unsafe(rig);
}

gboolean bus_safety_need(struct bus_rig *rig, GError **error) {
    GHashTableIter iter;
    gpointer who, why;
    g_hash_table_iter_init(&iter, rig->unsafe);
    if (!g_hash_table_iter_next(&iter, &who, &why))
        return TRUE;
    g_set_error(error, BUS_ERROR, BUS_ERROR_BUSY,
                "%s has not confirmed that it is off or stands still (%s): mesorigd repeats the "
                "command; look at the device, and cut its power if it does not obey",
                (const char *)who, (const char *)why);
    return FALSE;
}

gboolean bus_safety_is_free(const struct bus_rig *rig) {
    return rig->devices && !rig->ending && !rig->captured && rig->n_hands == 0 &&
           !bus_latch_is_set(rig->latch);
}

void bus_safety_rest_clock(struct bus_rig *rig) {
    if (rig->devices && !rig->captured && rig->n_hands == 0 && !devices_any_unsafe(rig->devices) &&
        !bus_latch_is_set(rig->latch))
        bus_rig_hold_clock(rig, TRUE);
}
