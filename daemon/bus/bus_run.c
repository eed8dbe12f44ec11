#include "bus_run.h"

#include <gio/gio.h>
#include <glib/gstdio.h>
#include <string.h>

#include "bus_devices.h"
#include "bus_errors.h"
#include "bus_latch.h"
#include "bus_names.h"
#include "bus_safety.h"

#define THUMBNAIL_INTERVAL_US (1 * G_USEC_PER_SEC)

static const char *const state_names[] = {
    [CAPTURE_HOMING] = "homing", [CAPTURE_RUNNING] = "running", [CAPTURE_PAUSING] = "pausing",
    [CAPTURE_PAUSED] = "paused", [CAPTURE_DONE] = "done",       [CAPTURE_ABORTED] = "aborted",
};

static void on_event(Capture *capture, const char *level, const char *source, const char *message,
                     gpointer data) {
    struct bus_run *run = data;
    bus_rig_report(run->rig, level, source, message);
}

static void show_status(struct bus_run *run, const struct capture_status *status) {
    /* Remaining real time in seconds, or −1 if it is not known. */
    double left_s = status->state <= CAPTURE_PAUSING ? status->left_s : -1;
    if (left_s >= 0 && clock_is_virtual(run->rig->devices->clock)) {
        /* The clock of a simulated rig has another speed than real time. The ratio of the two is
         * measured from the end of homing, because homing takes no real time in a simulation. */
        const double simulated_s = status->elapsed_s - run->started_elapsed_s;
        const double real_s = (double)(g_get_monotonic_time() - run->started_us) / G_USEC_PER_SEC;
        left_s = simulated_s > 0 ? left_s * real_s / simulated_s : -1;
    }
    const guint64 end = left_s >= 0 && left_s < 1e9
                            ? (guint64)((double)g_get_real_time() / G_USEC_PER_SEC + left_s + 0.5)
                            : 0;
    if (status->state == CAPTURE_HOMING) {
        run->started_us = g_get_monotonic_time();
        run->started_elapsed_s = status->elapsed_s;
    }
    g_object_set(run->rig->object, "state", state_names[status->state], "reason",
                 status->reason ? status->reason : "", "prompt",
                 status->prompt ? status->prompt : "", "doing", status->doing ? status->doing : "",
                 "shots", status->shots, "shots-done", status->shots_done, "frames", status->frames,
                 "retakes", status->retakes, "elapsed", status->elapsed_s, "left", status->left_s,
                 "predicted-end", end, "bytes-stored", status->bytes_stored, "bytes-expected",
                 status->bytes_expected, NULL);
    if (status->shot)
        bus_rig1_set_pose(run->rig->object, bus_pose(run->rig->devices, status->shot));
}

static void show_thumbnails(struct bus_run *run) {
    const gint64 now_us = g_get_monotonic_time();
    for (int i = 0; i < run->rig->devices->geometry.n_cameras; i++) {
        if (now_us < run->thumbnail_sent_us[i] + THUMBNAIL_INTERVAL_US)
            continue;
        /* Only the time of the picture is read, because the thumbnail is made when a client asks
         * for it. */
        const double time_s = capture_picture_time_s(run->capture, i);
        if (time_s < 0 || time_s == run->thumbnail_time_s[i])
            continue;
        run->thumbnail_time_s[i] = time_s;
        run->thumbnail_sent_us[i] = now_us;
        bus_rig1_emit_thumbnail_changed(run->rig->object,
                                        run->rig->devices->geometry.cameras[i].name);
    }
}

static void drop_thumbnails(struct bus_run *run) {
    for (int i = 0; i < RIG_MAX_CAMERAS; i++) {
        g_free(run->kept[i].rgb);
        run->kept[i] = (struct capture_thumbnail){0};
    }
}

static void keep_thumbnails(struct bus_run *run) {
    drop_thumbnails(run);
    for (int i = 0; i < run->rig->devices->geometry.n_cameras; i++) {
        const struct capture_thumbnail *last = capture_thumbnail(run->capture, i);
        if (!last)
            continue;
        run->kept[i] = *last;
        run->kept[i].rgb = g_memdup2(last->rgb, (gsize)last->width * (gsize)last->height * 3);
    }
}

void bus_run_end(struct bus_run *run) {
    g_clear_handle_id(&run->tick_id, g_source_remove);
    g_clear_handle_id(&run->end_id, g_source_remove);
    if (run->capture) {
        g_autofree char *control = g_build_filename(run->directory, BUS_CONTROL, NULL);
        g_unlink(control);
        keep_thumbnails(run);
    }
    g_clear_pointer(&run->capture, capture_free);
    run->rig->captured = NULL;
}

void bus_run_close(struct bus_run *run) {
    g_clear_pointer(&run->followers, followers_free);
    bus_run_end(run);
    drop_thumbnails(run);
    g_clear_pointer(&run->directory, g_free);
}

gboolean bus_run_need(const struct bus_run *run, GError **error) {
    if (!run->capture)
        g_set_error(
            error, BUS_ERROR, BUS_ERROR_NO_SESSION,
            "nothing is being captured; “mesorig status” shows the rig, and “mesorig queue list” "
            "shows the sessions that wait");
    return run->capture != NULL;
}

/* Releases the session soon after it has ended, so that another program may resume it. Clients
 * still see its last state. This function is called by an idle source, because the capture must not
 * be freed within its own callback. */
static gboolean end_idle(gpointer data) {
    struct bus_run *run = data;
    run->end_id = 0;
    bus_run_end(run);
    bus_rig_show_devices(run->rig);
    run->hooks.ended(run->hooks.data);
    run->hooks.shown(run->hooks.data);
    return G_SOURCE_REMOVE;
}

static void changed(Capture *capture, gpointer data) {
    struct bus_run *run = data;
    struct capture_status status;
    if (!run->capture)
        return; /* called from within capture_begin() */
    capture_get_status(capture, &status);
    show_status(run, &status);
    bus_rig_show_devices(run->rig);
    show_thumbnails(run);
    run->hooks.changed(&status, run->hooks.data);
    if (status.state >= CAPTURE_DONE && !run->end_id)
        run->end_id = g_idle_add(end_idle, run);
    run->hooks.shown(run->hooks.data);
}

/* Shows the state every second. The capture itself reports nothing while axes home or during a long
 * exposure. */
static gboolean on_tick(gpointer data) {
    struct bus_run *run = data;
    changed(run->capture, run);
    return G_SOURCE_CONTINUE;
}

/* Writes the path of the rig file into the session, unless the session has this path. The session
 * may have an older path, because the rig file may have been moved since the session was made. */
static void remember_rig(struct bus_run *run) {
    g_autoptr(Session) session = session_open(run->directory, SESSION_PRODUCTS, NULL);
    g_autofree char *known = session ? session_value(session, "rig_path") : NULL;
    if (session && g_strcmp0(known, run->rig->path) != 0)
        session_set_value(session, "rig_path", run->rig->path, NULL);
}

static void show_processing(gpointer data) {
    struct bus_run *run = data;
    g_autofree const char **directories = followers_directories(run->followers);
    bus_rig1_set_processing(run->rig->object, directories);
    run->hooks.shown(run->hooks.data);
}

static void processing_failed(const char *directory, gpointer data) {
    struct bus_run *run = data;
    g_autofree char *text = g_strdup_printf(
        "%s could not be processed: when the capture has ended, mesorig process %s says why",
        directory, directory);
    bus_rig_report(run->rig, "warning", "process", text);
}

static void show_beginning(struct bus_run *run, Capture *capture, const char *directory,
                           gboolean process) {
    struct capture_status status;
    g_autoptr(GError) error = NULL;
    g_free(run->directory);
    run->directory = g_strdup(directory);
    run->capture = capture;
    run->rig->captured = run->directory;
    bus_rig_hold_clock(run->rig, FALSE);
    drop_thumbnails(run);
    g_clear_handle_id(&run->tick_id, g_source_remove);
    run->tick_id = g_timeout_add_seconds(1, on_tick, run);
    capture_get_status(capture, &status);
    run->started_us = g_get_monotonic_time();
    run->started_elapsed_s = status.elapsed_s;
    memset(run->thumbnail_time_s, 0, sizeof(run->thumbnail_time_s));
    remember_rig(run);
    g_autofree char *control = g_build_filename(directory, BUS_CONTROL, NULL);
    g_autofree char *line = g_strconcat(run->address, "\n", NULL);
    if (!g_file_set_contents(control, line, -1, &error))
        g_message("commands cannot find this mesorigd by the session's folder: %s; leave the "
                  "folder out of the commands",
                  error->message);
    g_clear_error(&error);
    bus_rig1_set_session(run->rig->object, directory);
    if (!run->followers)
        run->followers = followers_new(show_processing, processing_failed, run);
    if (process && !followers_start(run->followers, directory, &error))
        bus_rig_report(run->rig, "warning", "process", error->message);
    run->hooks.begun(run->hooks.data);
    changed(capture, run);
}

gboolean bus_run_begin(struct bus_run *run, const char *directory, gboolean resumed,
                       const char *warning, gboolean process, GError **error) {
    const struct capture_callbacks callbacks = {changed, on_event, run};
    if (!bus_latch_need_released(run->rig->latch, error) || !bus_safety_need(run->rig, error))
        return FALSE;
    run->rig->is_safe = FALSE;
    bus_hands_end(run->hands, "a capture begins");
    g_hash_table_remove_all(run->rig->faults);
    Capture *capture = resumed
                           ? capture_go_on(run->rig->devices, directory, warning, &callbacks, error)
                           : capture_begin(run->rig->devices, directory, &callbacks, error);
    if (capture)
        show_beginning(run, capture, directory, process);
    return capture != NULL;
}

const struct capture_thumbnail *bus_run_thumbnail(struct bus_run *run, const char *camera,
                                                  GError **error) {
    g_autoptr(GString) names = g_string_new(NULL);
    int index = 0;
    if (!bus_rig_need_open(run->rig, error))
        return NULL;
    const struct rig *rig = &run->rig->devices->geometry;
    for (; index < rig->n_cameras && strcmp(rig->cameras[index].name, camera) != 0; index++)
        g_string_append_printf(names, "%s%s", index ? ", " : "", rig->cameras[index].name);
    if (index == rig->n_cameras) {
        g_set_error(error, BUS_ERROR, BUS_ERROR_UNKNOWN,
                    "there is no camera “%s”; the cameras are: %s", camera,
                    names->len ? names->str : "none");
        return NULL;
    }
    if (!run->capture && run->kept[index].rgb)
        return &run->kept[index];
    if (!bus_run_need(run, error))
        return NULL;
    const struct capture_thumbnail *found = capture_thumbnail(run->capture, index);
    if (!found)
        g_set_error(error, BUS_ERROR, BUS_ERROR_NO_PICTURE,
                    "camera %s has not taken a picture in this capture yet: try again later",
                    camera);
    return found;
}
