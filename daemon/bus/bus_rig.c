#include "bus_rig.h"

#include <gio/gio.h>
#include <string.h>

#include "bus_devices.h"
#include "bus_errors.h"

void bus_rig_init(struct bus_rig *rig, BusRig1 *object) {
    rig->object = object;
    rig->faults = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, g_free);
    rig->unsafe = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, g_free);
}

void bus_rig_clear(struct bus_rig *rig) {
    g_hash_table_unref(rig->faults);
    g_hash_table_unref(rig->unsafe);
}

gboolean bus_rig_need_open(const struct bus_rig *rig, GError **error) {
    if (rig->ending) {
        g_set_error(error, BUS_ERROR, BUS_ERROR_BUSY,
                    "the rig %s is being closed: open it again when it is closed", rig->path);
        return FALSE;
    }
    if (!rig->devices)
        g_set_error(error, BUS_ERROR, BUS_ERROR_NO_RIG,
                    "no rig is open: open one first (mesorigd --rig RIG, or the method OpenRig)");
    return rig->devices != NULL;
}

const Interlock *bus_rig_open_interlock(const struct bus_rig *rig) {
    for (int i = 0; i < rig->devices->n_interlocks; i++)
        if (!interlock_is_closed(rig->devices->interlocks[i]))
            return rig->devices->interlocks[i];
    return NULL;
}

void bus_rig_report(struct bus_rig *rig, const char *level, const char *source,
                    const char *message) {
    bus_rig_flush(rig); /* clients receive earlier messages first */
    bus_rig1_emit_event(rig->object, level, source, message);
    if (strcmp(level, "error") == 0)
        g_hash_table_insert(rig->faults, g_strdup(source), g_strdup(message));
    g_log_structured(G_LOG_DOMAIN,
                     strcmp(level, "info") == 0 ? G_LOG_LEVEL_MESSAGE : G_LOG_LEVEL_WARNING,
                     "MESORIG_SOURCE", source, "MESSAGE", "%s: %s", source, message);
}

void bus_rig_show_devices(struct bus_rig *rig) {
    bus_rig1_set_devices(rig->object, bus_devices(rig->devices, rig->faults, rig->unsafe));
}

void bus_rig_flush(const struct bus_rig *rig) {
    g_dbus_interface_skeleton_flush(G_DBUS_INTERFACE_SKELETON(rig->object));
}

void bus_rig_hold_clock(struct bus_rig *rig, gboolean hold) {
    if (rig->holds_clock == hold || !rig->devices)
        return;
    rig->holds_clock = hold;
    (hold ? clock_hold : clock_release)(rig->devices->clock);
}
