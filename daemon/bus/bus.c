#include "bus_authority.h"
#include "bus_devices.h"
#include "bus_errors.h"
#include "bus_hands.h"
#include "bus_latch.h"
#include "bus_private.h"
#include "bus_safety.h"
#include "bus_unattended.h"
#include "plan/report.h"

#include <glib/gstdio.h>
#include <string.h>

static const char *const state_names[] = {
    [CAPTURE_HOMING] = "homing", [CAPTURE_RUNNING] = "running", [CAPTURE_PAUSING] = "pausing",
    [CAPTURE_PAUSED] = "paused", [CAPTURE_DONE] = "done",       [CAPTURE_ABORTED] = "aborted",
};

static void notify(Bus *bus) {
    if (bus->func)
        bus->func(bus, bus->data);
}

void bus_report(Bus *bus, const char *level, const char *source, const char *message) {
    const gboolean bad = strcmp(level, "error") == 0;
    /* Clients receive earlier messages first. */
    g_dbus_interface_skeleton_flush(G_DBUS_INTERFACE_SKELETON(bus->object));
    bus_rig1_emit_event(bus->object, level, source, message);
    if (bad)
        g_hash_table_insert(bus->faults, g_strdup(source), g_strdup(message));
    g_log_structured(G_LOG_DOMAIN,
                     strcmp(level, "info") == 0 ? G_LOG_LEVEL_MESSAGE : G_LOG_LEVEL_WARNING,
                     "MESORIG_SOURCE", source, "MESSAGE", "%s: %s", source, message);
}

static void on_event(Capture *capture, const char *level, const char *source, const char *message,
                     gpointer data) {
    bus_report(data, level, source, message);
}

static void show_status(Bus *bus, const struct capture_status *status) {
    /* Left_s is in real time. */
    double left_s = status->state <= CAPTURE_PAUSING ? status->left_s : -1;
    if (left_s >= 0 && clock_is_virtual(bus->devices->clock)) {
        /* The clock of a simulated rig does not run at the speed of real time. The ratio is
         * measured since the axes were homed, because homing takes no real time in a simulation. */
        const double simulated_s = status->elapsed_s - bus->started_elapsed_s;
        const double real_s = (double)(g_get_monotonic_time() - bus->started_us) / G_USEC_PER_SEC;
        left_s = simulated_s > 0 ? left_s * real_s / simulated_s : -1;
    }
    const guint64 end = left_s >= 0 && left_s < 1e9
                            ? (guint64)((double)g_get_real_time() / G_USEC_PER_SEC + left_s + 0.5)
                            : 0;
    if (status->state == CAPTURE_HOMING) {
        bus->started_us = g_get_monotonic_time();
        bus->started_elapsed_s = status->elapsed_s;
    }
    g_object_set(bus->object, "state", state_names[status->state], "reason",
                 status->reason ? status->reason : "", "prompt",
                 status->prompt ? status->prompt : "", "doing", status->doing ? status->doing : "",
                 "shots", status->shots, "shots-done", status->shots_done, "frames", status->frames,
                 "retakes", status->retakes, "elapsed", status->elapsed_s, "left", status->left_s,
                 "predicted-end", end, "bytes-stored", status->bytes_stored, "bytes-expected",
                 status->bytes_expected, NULL);
    if (status->shot)
        bus_rig1_set_pose(bus->object, bus_pose(bus->devices, status->shot));
}

void bus_show_devices(Bus *bus) {
    bus_rig1_set_devices(bus->object, bus_devices(bus->devices, bus->faults, bus->unsafe));
}

static void end_capture(Bus *bus) {
    g_clear_handle_id(&bus->tick_id, g_source_remove);
    if (bus->end_id)
        g_source_remove(bus->end_id);
    bus->end_id = 0;
    if (bus->capture) {
        g_autofree char *control = g_build_filename(bus->directory, BUS_CONTROL, NULL);
        g_unlink(control);
        bus_keep_thumbnails(bus);
    }
    g_clear_pointer(&bus->capture, capture_free);
}

/* Releases the session as soon as it has ended, so that another program may resume it. Clients
 * still see its last state. An idle source calls this, because the capture must not be freed within
 * its own callback. */
static gboolean end_capture_idle(gpointer data) {
    Bus *bus = data;
    bus->end_id = 0;
    end_capture(bus);
    bus_show_devices(bus);
    bus_unattended_poke(bus);
    notify(bus);
    return G_SOURCE_REMOVE;
}

static void changed(Capture *capture, gpointer data) {
    Bus *bus = data;
    struct capture_status status;
    if (!bus->capture)
        return; /* called from within capture_start() */
    capture_get_status(capture, &status);
    show_status(bus, &status);
    bus_show_devices(bus);
    bus_show_thumbnails(bus);
    bus_unattended_changed(bus, &status);
    if (status.state >= CAPTURE_DONE && !bus->end_id)
        bus->end_id = g_idle_add(end_capture_idle, bus);
    notify(bus);
}

/* Shows the state at intervals. While axes home, or during a long exposure, the capture reports
 * nothing. */
static gboolean on_tick(gpointer data) {
    Bus *bus = data;
    changed(bus->capture, bus);
    return G_SOURCE_CONTINUE;
}

gboolean bus_need_rig(Bus *bus, GError **error) {
    if (bus->ending) {
        g_set_error(error, BUS_ERROR, BUS_ERROR_BUSY, "the rig %s is being closed", bus->rig_path);
        return FALSE;
    }
    if (!bus->devices)
        g_set_error(error, BUS_ERROR, BUS_ERROR_NO_RIG, "no rig is open: call OpenRig first");
    return bus->devices != NULL;
}

gboolean bus_need_capture(Bus *bus, GError **error) {
    if (!bus->capture)
        g_set_error(error, BUS_ERROR, BUS_ERROR_NO_SESSION, "nothing is being captured");
    return bus->capture != NULL;
}

gboolean bus_need_free(Bus *bus, GError **error) {
    const char *beginning = bus_jobs_beginning(bus);
    if (bus->capture)
        g_set_error(error, BUS_ERROR, BUS_ERROR_BUSY,
                    "%s is being captured (%s) on this rig: wait for its end; if it is yours, "
                    "“mesorig abort %s” ends it",
                    bus->directory, bus_rig1_get_state(bus->object), bus->directory);
    else if (beginning)
        g_set_error(error, BUS_ERROR, BUS_ERROR_BUSY,
                    "%s is about to begin on this rig: wait for its end; if it is yours, “mesorig "
                    "abort” ends it",
                    beginning);
    return !bus->capture && !beginning;
}

gboolean bus_need_absolute(const char *path, GError **error) {
    if (g_path_is_absolute(path))
        return TRUE;
    g_set_error(error, BUS_ERROR, BUS_ERROR_BAD_PATH,
                "“%s” is not an absolute path: give the whole path, beginning with /", path);
    return FALSE;
}

static void show_idle(Bus *bus) {
    g_object_set(bus->object, "state", bus->devices ? "idle" : "closed", "reason", "", "prompt", "",
                 "doing", "", "rig-path", bus->rig_path ? bus->rig_path : "", "simulated",
                 bus->devices && devices_are_simulated(bus->devices), "session", "", "shots", 0,
                 "shots-done", 0, "frames", (gint64)0, "retakes", (gint64)0, "elapsed", 0.0, "left",
                 0.0, "predicted-end", (guint64)0, "bytes-stored", (guint64)0, "bytes-expected",
                 (guint64)0, NULL);
    bus_rig1_set_pose(bus->object, bus_pose(bus->devices, NULL));
    bus_rig1_set_places(bus->object, bus_places(bus->devices));
    bus_show_devices(bus);
    notify(bus);
}

void bus_hold_clock(Bus *bus, gboolean hold) {
    if (bus->holds_clock == hold || !bus->devices)
        return;
    bus->holds_clock = hold;
    (hold ? clock_hold : clock_release)(bus->devices->clock);
}

void bus_rest_clock(Bus *bus) {
    if (bus->devices && !bus->capture && bus->hands->len == 0 &&
        !devices_any_unsafe(bus->devices) && !bus_latch_is_set(bus->latch))
        bus_hold_clock(bus, TRUE);
}

gboolean bus_open_rig(Bus *bus, const char *path, GError **error) {
    GError *failed = NULL;
    if (!bus_need_free(bus, error) || !bus_need_absolute(path, error))
        return FALSE;
    if (bus->devices) {
        g_set_error(error, BUS_ERROR, BUS_ERROR_BUSY, "the rig %s is open: call CloseRig first",
                    bus->rig_path);
        return FALSE;
    }
    if (guardian_is_needed(path) && !(bus->guardian = guardian_start(path, error)))
        return FALSE;
    guardian_set_busy(bus->guardian, TRUE);
    bus->devices = devices_open(path, &failed);
    if (!bus->devices) {
        /* A device that has not answered may shine. A device that another process has open is the
         * responsibility of that process. Wrong sections are found before any device is opened. */
        const gboolean other = g_error_matches(failed, DEVICE_ERROR, DEVICE_ERROR_BUSY);
        guardian_end(bus->guardian,
                     failed->domain == DEVICE_ERROR && !other ? GUARDIAN_FAILED : GUARDIAN_SAFE);
        bus->guardian = NULL;
        g_propagate_error(error, failed);
        return FALSE;
    }
    guardian_set_busy(bus->guardian, FALSE);
    bus->is_safe = FALSE;
    for (int i = 0; i < bus->devices->geometry.n_lasers; i++) {
        const Laser *laser = bus->devices->lasers[i];
        if (rig_laser_unit(&bus->devices->timing, i) == i && !laser->driver->simulated &&
            laser->watchdog_s == 0)
            g_warning("laser %s: its device (%s) has no watchdog, so it stays on if this computer "
                      "stops or the line is cut: give it one, or wire an interlock relay; see "
                      "\"Watchdogs of devices\" in docs/operate/safety.md",
                      laser->device.name, laser->device.info->name);
    }
    bus_hold_clock(bus, TRUE);
    bus_hands_watch(bus, TRUE);
    bus_safety_watch(bus);
    g_free(bus->rig_path);
    bus->rig_path = g_strdup(path);
    show_idle(bus);
    bus_unattended_poke(bus);
    return TRUE;
}

gboolean bus_can_close(Bus *bus, GError **error) {
    g_autoptr(GError) unsafe = NULL;
    if (!bus->guardian || bus->is_safe || bus_end(bus, &unsafe))
        return TRUE;
    bus_unattended_stop(bus, "the rig could not be closed, because a device did not confirm");
    g_set_error(error, BUS_ERROR, BUS_ERROR_BUSY,
                "the rig stays open, because not every device has confirmed that it is off or "
                "stands still (%s): the command is repeated until it does; look at the device, and "
                "cut its power if it does not obey",
                unsafe->message);
    return FALSE;
}

void bus_close_rig(Bus *bus) {
    static struct devices *abandoned;
    g_autoptr(GError) error = NULL;
    if (bus->ending)
        return; /* called from within bus_end(), which runs the main loop */
    bus_authority_stop(bus, "the rig was closed meanwhile");
    bus_unattended_stop(bus, NULL);
    bus_jobs_stop_all(bus, "the rig was closed meanwhile");
    if (bus->devices) {
        bus_hands_end(bus, "the rig was closed meanwhile");
        bus_hands_watch(bus, FALSE);
    }
    g_clear_pointer(&bus->follower, follower_free);
    end_capture(bus);
    bus_drop_thumbnails(bus);
    if (bus->guardian && !bus->is_safe && !bus_end(bus, &error))
        g_warning("the rig is NOT safe: %s", error->message);
    bus_hold_clock(bus, FALSE);
    if (bus->guardian && !bus->is_safe) {
        abandoned = g_steal_pointer(&bus->devices);
        devices_set_permit(abandoned, NULL, NULL);
        devices_watch_safety(abandoned, NULL, NULL);
        guardian_end(bus->guardian, GUARDIAN_UNSAFE);
    } else {
        guardian_set_busy(bus->guardian, TRUE); /* closing may block; all lights are off */
        g_clear_pointer(&bus->devices, devices_close);
        guardian_end(bus->guardian, GUARDIAN_SAFE);
    }
    bus->guardian = NULL;
    g_clear_pointer(&bus->rig_path, g_free);
    g_clear_pointer(&bus->directory, g_free);
    g_hash_table_remove_all(bus->faults);
    bus_safety_forget(bus);
    show_idle(bus);
}

/* Writes the path of the rig file into the session, where it is missing or wrong because the file
 * has been moved since. */
static void remember_rig(Bus *bus) {
    g_autoptr(Session) session = session_open(bus->directory, SESSION_PRODUCTS, NULL);
    g_autofree char *known = session ? session_value(session, "rig_path") : NULL;
    if (session && g_strcmp0(known, bus->rig_path) != 0)
        session_set_value(session, "rig_path", bus->rig_path, NULL);
}

static void show_beginning(Bus *bus, Capture *capture, const char *directory, gboolean process) {
    struct capture_status status;
    g_autoptr(GError) error = NULL;
    g_free(bus->directory);
    bus->directory = g_strdup(directory);
    bus->capture = capture;
    bus_hold_clock(bus, FALSE);
    bus_drop_thumbnails(bus);
    g_clear_handle_id(&bus->tick_id, g_source_remove);
    bus->tick_id = g_timeout_add_seconds(1, on_tick, bus);
    capture_get_status(capture, &status);
    bus->started_us = g_get_monotonic_time();
    bus->started_elapsed_s = status.elapsed_s;
    memset(bus->thumbnail_time_s, 0, sizeof(bus->thumbnail_time_s));
    remember_rig(bus);
    g_autofree char *control = g_build_filename(directory, BUS_CONTROL, NULL);
    g_autofree char *line = g_strconcat(bus->address, "\n", NULL);
    if (!g_file_set_contents(control, line, -1, &error))
        g_message("commands in other terminals cannot find this daemon by the session's folder: %s",
                  error->message);
    g_clear_error(&error);
    bus_rig1_set_session(bus->object, directory);
    if (process && !(bus->follower = follower_start(directory, &error)))
        bus_report(bus, "warning", "process", error->message);
    bus_unattended_begun(bus);
    changed(capture, bus);
}

gboolean bus_begin(Bus *bus, const char *directory, gboolean resumed, const char *warning,
                   gboolean process, GError **error) {
    const struct capture_callbacks callbacks = {changed, on_event, bus};
    if (!bus_latch_need_released(bus->latch, error) || !bus_need_safe(bus, error))
        return FALSE;
    bus->is_safe = FALSE;
    bus_hands_end(bus, "a capture begins");
    g_clear_pointer(&bus->follower, follower_free);
    g_hash_table_remove_all(bus->faults);
    Capture *capture = resumed ? capture_go_on(bus->devices, directory, warning, &callbacks, error)
                               : capture_begin(bus->devices, directory, &callbacks, error);
    if (capture)
        show_beginning(bus, capture, directory, process);
    return capture != NULL;
}

void bus_make_safe(Bus *bus) {
    g_autoptr(GError) error = NULL;
    bus_authority_stop(bus, "SafeState ended it before it began");
    bus_unattended_stop(bus, "SafeState was called");
    bus_jobs_stop_begin(bus, "SafeState ended the operation that was about to begin");
    bus_hands_stop(bus, "SafeState ended it");
    bus_hold_clock(bus, FALSE);
    if (bus->capture)
        capture_abort(bus->capture);
    if (!devices_make_safe(bus->devices, &error))
        bus_report(bus, "error", "safe state", error->message);
    bus_show_devices(bus);
}

Bus *bus_new(const char *address) {
    Bus *bus = g_new0(Bus, 1);
    bus_errors_register();
    bus->object = bus_authority_skeleton();
    g_object_set_data(G_OBJECT(bus->object), "bus", bus);
    bus->address = g_strdup(address);
    bus->faults = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, g_free);
    bus->jobs = g_ptr_array_new();
    bus->questions = g_ptr_array_new();
    bus->hands = g_ptr_array_new();
    memcpy(bus->limits, preparer_default_limits, sizeof bus->limits);
    bus->unsafe = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, g_free);
    bus->latch = bus_latch_new(bus);
    bus->queue = bus_queue_new(bus->latch);
    bus->unattended = bus_unattended_new(bus);
    bus_answer_calls(bus);
    show_idle(bus);
    return bus;
}

gboolean bus_end(Bus *bus, GError **error) {
    bus_authority_stop(bus, "mesorigd ends");
    bus_unattended_stop(bus, NULL);
    bus_jobs_stop_all(bus, "mesorigd ends");
    if (!bus->devices)
        return TRUE;
    bus_hands_end(bus, "mesorigd ends");
    end_capture(bus);
    bus_hold_clock(bus, FALSE);
    bus->ending = TRUE;
    bus->is_safe = devices_secure(bus->devices, error);
    bus->ending = FALSE;
    return bus->is_safe;
}

void bus_free(Bus *bus) {
    if (!bus)
        return;
    bus->func = NULL;
    bus_close_rig(bus);
    bus_unattended_free(bus->unattended);
    bus_latch_close(bus->latch);
    bus_queue_close(bus->queue);
    GDBusInterfaceSkeleton *skeleton = G_DBUS_INTERFACE_SKELETON(bus->object);
    GList *connections = g_dbus_interface_skeleton_get_connections(skeleton);
    g_dbus_interface_skeleton_flush(skeleton);
    if (connections)
        g_dbus_interface_skeleton_unexport(skeleton);
    g_list_free_full(connections, g_object_unref);
    g_object_set_data(G_OBJECT(bus->object), "bus", NULL);
    g_object_unref(bus->object);
    g_hash_table_unref(bus->faults);
    g_hash_table_unref(bus->unsafe);
    g_ptr_array_unref(bus->jobs);
    g_ptr_array_unref(bus->questions);
    g_ptr_array_unref(bus->hands);
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
        bus_jobs_stop_client(bus, connection);
    if (bus)
        bus_hands_end_client(bus, connection);
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
    return bus->devices != NULL;
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
    } else if (done < shots && bus->capture) {
        g_autofree char *left = report_duration(bus_rig1_get_left(bus->object));
        g_string_append_printf(text, ", %s left", left);
    }
    return g_string_free(text, FALSE);
}
