#include "bus_private.h"

#include <string.h>

#include "bus_devices.h"
#include "bus_errors.h"
#include "bus_safety.h"
#include "plan/report.h"

static void notify(Bus *bus) {
    if (bus->func)
        bus->func(bus, bus->data);
}

gboolean bus_need_absolute(const char *path, GError **error) {
    if (g_path_is_absolute(path))
        return TRUE;
    g_set_error(error, BUS_ERROR, BUS_ERROR_BAD_PATH,
                "“%s” is not an absolute path: give the whole path, beginning with /", path);
    return FALSE;
}

static void show_idle(Bus *bus) {
    g_object_set(bus->object, "state", bus->rig.devices ? "idle" : "closed", "reason", "", "prompt",
                 "", "doing", "", "rig-path", bus->rig.path ? bus->rig.path : "", "simulated",
                 bus->rig.devices && devices_are_simulated(bus->rig.devices), "session", "",
                 "shots", 0, "shots-done", 0, "frames", (gint64)0, "retakes", (gint64)0, "elapsed",
                 0.0, "left", 0.0, "predicted-end", (guint64)0, "bytes-stored", (guint64)0,
                 "bytes-expected", (guint64)0, NULL);
    bus_rig1_set_pose(bus->object, bus_pose(bus->rig.devices, NULL));
    bus_rig1_set_places(bus->object, bus_places(bus->rig.devices));
    bus_rig1_set_processing(bus->object, (const char *const[]){NULL});
    bus_rig_show_devices(&bus->rig);
    notify(bus);
}

gboolean bus_open_rig(Bus *bus, const char *path, GError **error) {
    GError *failed = NULL;
    if (!bus_jobs_need_free(&bus->jobs, error) || !bus_need_absolute(path, error))
        return FALSE;
    if (bus->rig.devices) {
        g_set_error(error, BUS_ERROR, BUS_ERROR_BUSY,
                    "the rig %s is open: close it first (“mesorig close”, or the method CloseRig)",
                    bus->rig.path);
        return FALSE;
    }
    if (guardian_is_needed(path) && !(bus->rig.guardian = guardian_start(path, error)))
        return FALSE;
    guardian_set_busy(bus->rig.guardian, TRUE);
    bus->rig.devices = devices_open(path, &failed);
    if (!bus->rig.devices) {
        /* A device that has not answered may give light, so the guardian must make it safe. There
         * are two cases without this danger. If another process has the device open
         * (DEVICE_ERROR_BUSY), that process is responsible for the light. Errors of other domains
         * are mistakes in the rig file, which are found before a device is opened. */
        const gboolean other = g_error_matches(failed, DEVICE_ERROR, DEVICE_ERROR_BUSY);
        guardian_end(bus->rig.guardian,
                     failed->domain == DEVICE_ERROR && !other ? GUARDIAN_FAILED : GUARDIAN_SAFE);
        bus->rig.guardian = NULL;
        g_propagate_error(error, failed);
        return FALSE;
    }
    guardian_set_busy(bus->rig.guardian, FALSE);
    bus->rig.is_safe = FALSE;
    for (int i = 0; i < bus->rig.devices->geometry.n_lasers; i++) {
        const Laser *laser = bus->rig.devices->lasers[i];
        if (rig_laser_unit(&bus->rig.devices->timing, i) == i && !laser->driver->simulated &&
            laser->watchdog_s == 0)
            g_warning("laser %s: no watchdog is set up for its device (%s), so the laser stays on "
                      "if this computer stops or the line to the device is cut: set up the "
                      "watchdog if the device has one, otherwise wire an interlock relay; see "
                      "“Watchdogs of devices” in docs/operate/safety.md",
                      laser->device.name, laser->device.info->name);
    }
    bus_rig_hold_clock(&bus->rig, TRUE);
    bus_hands_watch(&bus->hands, TRUE);
    bus_safety_watch(&bus->rig);
    g_free(bus->rig.path);
    bus->rig.path = g_strdup(path);
    show_idle(bus);
    bus_unattended_poke(bus->unattended);
    return TRUE;
}

gboolean bus_can_close(Bus *bus, GError **error) {
    g_autoptr(GError) unsafe = NULL;
    if (!bus->rig.guardian || bus->rig.is_safe || bus_end(bus, &unsafe))
        return TRUE;
    bus_unattended_stop(bus->unattended, "the rig could not be closed, because a device did not "
                                         "confirm that it is off or stands still");
    g_set_error(error, BUS_ERROR, BUS_ERROR_BUSY,
                "the rig stays open, because not every device has confirmed that it is off or "
                "stands still (%s): mesorigd repeats the commands; look at that device, cut its "
                "power if it stays on or moves, then close the rig again",
                unsafe->message);
    return FALSE;
}

void bus_close_rig(Bus *bus) {
    static struct devices *abandoned;
    g_autoptr(GError) error = NULL;
    if (bus->rig.ending)
        return; /* called from within bus_end(), which runs the main loop */
    bus_authority_stop(&bus->authority, "the rig was closed meanwhile");
    bus_unattended_stop(bus->unattended, NULL);
    bus_jobs_stop_all(&bus->jobs, "the rig was closed meanwhile");
    if (bus->rig.devices) {
        bus_hands_end(&bus->hands, "the rig was closed meanwhile");
        bus_hands_watch(&bus->hands, FALSE);
    }
    bus_run_close(&bus->run);
    if (bus->rig.guardian && !bus->rig.is_safe && !bus_end(bus, &error))
        g_warning("the rig is NOT safe: %s", error->message);
    bus_rig_hold_clock(&bus->rig, FALSE);
    if (bus->rig.guardian && !bus->rig.is_safe) {
        abandoned = g_steal_pointer(&bus->rig.devices);
        devices_set_permit(abandoned, NULL, NULL);
        devices_watch_safety(abandoned, NULL, NULL);
        guardian_end(bus->rig.guardian, GUARDIAN_UNSAFE);
    } else {
        guardian_set_busy(bus->rig.guardian, TRUE); /* closing may block; all lights are off */
        g_clear_pointer(&bus->rig.devices, devices_close);
        guardian_end(bus->rig.guardian, GUARDIAN_SAFE);
    }
    bus->rig.guardian = NULL;
    g_clear_pointer(&bus->rig.path, g_free);
    g_hash_table_remove_all(bus->rig.faults);
    bus_safety_forget(&bus->rig);
    show_idle(bus);
}

/* Ends all operations, switches every light off and stops every axis. A device that does not
 * confirm appears in the property Unsafe. If no rig is open, only ends the calls about which polkit
 * has not answered yet. */
static void make_safe(gpointer data) {
    Bus *bus = data;
    g_autoptr(GError) error = NULL;
    bus_authority_stop(&bus->authority, "SafeState ended this call before it began");
    if (!bus->rig.devices)
        return;
    bus_unattended_stop(bus->unattended, "SafeState was called");
    bus_jobs_stop_begin(&bus->jobs, "SafeState ended the operation that was about to begin");
    bus_hands_stop(&bus->hands, "SafeState ended this call");
    bus_rig_hold_clock(&bus->rig, FALSE);
    if (bus->run.capture)
        capture_abort(bus->run.capture);
    if (!devices_make_safe(bus->rig.devices, &error))
        bus_rig_report(&bus->rig, "error", "safe state", error->message);
    bus_rig_show_devices(&bus->rig);
}

static void on_freed(gpointer data) {
    Bus *bus = data;
    bus_unattended_poke(bus->unattended);
}

static void on_begun(gpointer data) {
    Bus *bus = data;
    bus_unattended_begun(bus->unattended);
}

static void on_changed(const struct capture_status *status, gpointer data) {
    Bus *bus = data;
    bus_unattended_changed(bus->unattended, status);
}

static void on_shown(gpointer data) {
    notify(data);
}

Bus *bus_new(const char *address) {
    Bus *bus = g_new0(Bus, 1);
    bus_errors_register();
    bus->object = bus_authority_skeleton();
    g_object_set_data(G_OBJECT(bus->object), "bus", bus);
    bus->address = g_strdup(address);
    bus_rig_init(&bus->rig, bus->object);
    bus->latch = bus->rig.latch = bus_latch_new(&bus->rig, make_safe, bus);
    bus->queue = bus_queue_new(bus->latch);
    bus_authority_init(&bus->authority, bus->latch, address);
    bus_authority_attach(bus->object, &bus->authority);
    bus_jobs_init(&bus->jobs, &bus->rig);
    bus_hands_init(&bus->hands, &bus->rig, &bus->jobs);
    bus->run = (struct bus_run){.rig = &bus->rig,
                                .hands = &bus->hands,
                                .address = bus->address,
                                .hooks = {on_begun, on_changed, on_freed, on_shown, bus}};
    bus->unattended = bus_unattended_new(&bus->run, &bus->jobs);
    bus->rig.freed = on_freed;
    bus->rig.data = bus;
    bus_answer_calls(bus);
    show_idle(bus);
    return bus;
}

void bus_keep_queue(Bus *bus, const char *path) {
    bus_unattended_keep(bus->unattended, path);
}

gboolean bus_end(Bus *bus, GError **error) {
    bus_authority_stop(&bus->authority, "mesorigd ends");
    bus_unattended_stop(bus->unattended, NULL);
    bus_jobs_stop_all(&bus->jobs, "mesorigd ends");
    if (!bus->rig.devices)
        return TRUE;
    bus_hands_end(&bus->hands, "mesorigd ends");
    bus_run_end(&bus->run);
    bus_rig_hold_clock(&bus->rig, FALSE);
    bus->rig.ending = TRUE;
    bus->rig.is_safe = devices_secure(bus->rig.devices, error);
    bus->rig.ending = FALSE;
    return bus->rig.is_safe;
}

void bus_free(Bus *bus) {
    if (!bus)
        return;
    bus->func = NULL;
    bus_close_rig(bus);
    g_clear_pointer(&bus->unattended, bus_unattended_free);
    bus_latch_close(bus->latch);
    bus_queue_close(bus->queue);
    GDBusInterfaceSkeleton *skeleton = G_DBUS_INTERFACE_SKELETON(bus->object);
    GList *connections = g_dbus_interface_skeleton_get_connections(skeleton);
    g_dbus_interface_skeleton_flush(skeleton);
    if (connections)
        g_dbus_interface_skeleton_unexport(skeleton);
    g_list_free_full(connections, g_object_unref);
    g_object_set_data(G_OBJECT(bus->object), "bus", NULL);
    bus_authority_attach(bus->object, NULL);
    g_object_unref(bus->object);
    bus_authority_clear(&bus->authority);
    bus_hands_clear(&bus->hands);
    bus_jobs_clear(&bus->jobs);
    bus_rig_clear(&bus->rig);
    g_free(bus->address);
    g_free(bus);
}

void bus_listen(Bus *bus, BusFunc func, gpointer data) {
    bus->func = func;
    bus->data = data;
}

void bus_listen_client(Bus *bus, BusFunc gone, gpointer data) {
    bus->client_gone = gone;
    bus->client_data = data;
}

static void connection_closed(GDBusConnection *connection, gboolean by_peer, GError *error,
                              gpointer object) {
    if (g_dbus_interface_skeleton_has_connection(object, connection))
        g_dbus_interface_skeleton_unexport_from_connection(object, connection);
    Bus *bus = g_object_get_data(object, "bus");
    if (bus)
        bus_jobs_stop_client(&bus->jobs, connection);
    if (bus)
        bus_hands_end_client(&bus->hands, connection);
    if (!bus || bus->client != connection)
        return;
    bus->client = NULL;
    if (bus->client_gone)
        bus->client_gone(bus, bus->client_data);
}

gboolean bus_export(Bus *bus, GDBusConnection *connection, GError **error) {
    GDBusInterfaceSkeleton *skeleton = G_DBUS_INTERFACE_SKELETON(bus->object);
    if (!g_dbus_interface_skeleton_export(skeleton, connection, BUS_PATH, error))
        return FALSE;
    bus_queue_guard(bus->queue, connection);
    g_signal_connect_object(connection, "closed", G_CALLBACK(connection_closed), skeleton, 0);
    return TRUE;
}

gboolean bus_has_rig(const Bus *bus) {
    return bus->rig.devices != NULL;
}

char *bus_status(Bus *bus) {
    const char *state = bus_rig1_get_state(bus->object);
    const int shots = bus_rig1_get_shots(bus->object), done = bus_rig1_get_shots_done(bus->object);
    const char *reason = bus_rig1_get_reason(bus->object);
    if (shots <= 0)
        return g_strdup(state);
    GString *text = g_string_new(state);
    g_string_append_printf(text, ", %d %% (%d of %d shots)", (int)(100.0 * done / shots), done,
                           shots);
    if (*reason) {
        g_string_append_printf(text, ": %s", reason);
    } else if (done < shots && bus->run.capture) {
        g_autofree char *left = report_duration(bus_rig1_get_left(bus->object));
        g_string_append_printf(text, ", %s left", left);
    }
    return g_string_free(text, FALSE);
}
