#include "bus_errors.h"
#include "bus_private.h"
#include "bus_safety.h"

#include "drivers/recording.h"

#include <gio/gunixfdlist.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

/* Answers a failed method call with an error. Takes ownership of the error. */
static gboolean refuse(GDBusMethodInvocation *invocation, GError *error) {
    g_dbus_method_invocation_take_error(invocation, bus_errors_wrap(error));
    return TRUE;
}

static void claim(Bus *bus, GDBusMethodInvocation *invocation) {
    if (!bus->client)
        bus->client = g_dbus_method_invocation_get_connection(invocation);
}

static gboolean on_open_rig(BusRig1 *object, GDBusMethodInvocation *invocation, const char *path,
                            Bus *bus) {
    GError *error = NULL;
    claim(bus, invocation);
    if (!bus_open_rig(bus, path, &error))
        return refuse(invocation, error);
    bus_rig_flush(&bus->rig);
    bus_rig1_complete_open_rig(object, invocation);
    return TRUE;
}

static gboolean on_close_rig(BusRig1 *object, GDBusMethodInvocation *invocation, Bus *bus) {
    GError *error = NULL;
    if (!bus_rig_need_open(&bus->rig, &error) || !bus_safety_need(&bus->rig, &error) ||
        !bus_can_close(bus, &error))
        return refuse(invocation, error);
    bus_close_rig(bus);
    bus_rig1_complete_close_rig(object, invocation);
    return TRUE;
}

static gboolean on_validate(BusRig1 *object, GDBusMethodInvocation *invocation,
                            const char *session_path, const char *directory, GVariant *options,
                            Bus *bus) {
    GError *error = NULL;
    return bus_validate(bus, invocation, session_path, directory, options, &error) ||
           refuse(invocation, error);
}

static gboolean on_start(BusRig1 *object, GDBusMethodInvocation *invocation,
                         const char *session_path, const char *directory, GVariant *options,
                         Bus *bus) {
    GError *error = NULL;
    claim(bus, invocation);
    return bus_start(bus, invocation, session_path, directory, options, &error) ||
           refuse(invocation, error);
}

static gboolean on_resume(BusRig1 *object, GDBusMethodInvocation *invocation, const char *directory,
                          GVariant *options, Bus *bus) {
    GError *error = NULL;
    claim(bus, invocation);
    return bus_start(bus, invocation, NULL, directory, options, &error) ||
           refuse(invocation, error);
}

static gboolean on_pause(BusRig1 *object, GDBusMethodInvocation *invocation, Bus *bus) {
    GError *error = NULL;
    if (!bus_run_need(&bus->run, &error))
        return refuse(invocation, error);
    capture_pause(bus->run.capture);
    bus_rig1_complete_pause(object, invocation);
    return TRUE;
}

static gboolean on_finish(BusRig1 *object, GDBusMethodInvocation *invocation, Bus *bus) {
    GError *error = NULL;
    if (!bus_run_need(&bus->run, &error) || !capture_finish(bus->run.capture, &error))
        return refuse(invocation, error);
    bus_rig1_complete_finish(object, invocation);
    return TRUE;
}

static gboolean on_continue(BusRig1 *object, GDBusMethodInvocation *invocation, Bus *bus) {
    GError *error = NULL;
    if (!bus->run.capture && bus_unattended_answer(bus->unattended)) {
        bus_rig1_complete_continue(object, invocation);
        return TRUE;
    }
    if (!bus_run_need(&bus->run, &error))
        return refuse(invocation, error);
    if (!capture_continue(bus->run.capture, &error))
        return refuse(invocation, error);
    g_hash_table_remove_all(bus->rig.faults);
    bus_rig1_complete_continue(object, invocation);
    return TRUE;
}

static gboolean on_abort(BusRig1 *object, GDBusMethodInvocation *invocation, Bus *bus) {
    GError *error = NULL;
    const char *why = "Abort ended the operation that was about to begin";
    const gboolean asked = bus_authority_stop(&bus->authority, why);
    const gboolean trying = bus_unattended_is_beginning(bus->unattended);
    if (trying)
        bus_unattended_stop(bus->unattended, why);
    const gboolean begun = bus_jobs_stop_begin(&bus->jobs, why) || asked || trying;
    if (!begun && !bus_run_need(&bus->run, &error))
        return refuse(invocation, error);
    if (bus->run.capture)
        capture_abort(bus->run.capture);
    bus_rig1_complete_abort(object, invocation);
    return TRUE;
}

static gboolean on_queue_add(BusRig1 *object, GDBusMethodInvocation *invocation,
                             const char *session_path, const char *directory, GVariant *options,
                             Bus *bus) {
    GError *error = NULL;
    return bus_add_to_queue(bus, invocation, session_path, directory, options, &error) ||
           refuse(invocation, error);
}

static gboolean on_queue_remove(BusRig1 *object, GDBusMethodInvocation *invocation, guint number,
                                Bus *bus) {
    GError *error = NULL;
    if (!bus_unattended_remove(bus->unattended, number, &error))
        return refuse(invocation, error);
    bus_rig_flush(&bus->rig);
    bus_rig1_complete_queue_remove(object, invocation);
    return TRUE;
}

static gboolean on_queue_move(BusRig1 *object, GDBusMethodInvocation *invocation, guint number,
                              guint place, Bus *bus) {
    GError *error = NULL;
    if (!bus_unattended_move(bus->unattended, number, place, &error))
        return refuse(invocation, error);
    bus_rig_flush(&bus->rig);
    bus_rig1_complete_queue_move(object, invocation);
    return TRUE;
}

static gboolean on_queue_pause(BusRig1 *object, GDBusMethodInvocation *invocation, Bus *bus) {
    GError *error = NULL;
    if (!bus_unattended_pause(bus->unattended, &error))
        return refuse(invocation, error);
    bus_rig_flush(&bus->rig);
    bus_rig1_complete_queue_pause(object, invocation);
    return TRUE;
}

static gboolean on_queue_resume(BusRig1 *object, GDBusMethodInvocation *invocation, Bus *bus) {
    GError *error = NULL;
    if (!bus_unattended_resume(bus->unattended, &error))
        return refuse(invocation, error);
    bus_rig_flush(&bus->rig);
    bus_rig1_complete_queue_resume(object, invocation);
    return TRUE;
}

static gboolean on_get_thumbnail(BusRig1 *object, GDBusMethodInvocation *invocation,
                                 const char *camera, Bus *bus) {
    GError *error = NULL;
    const struct capture_thumbnail *found = bus_run_thumbnail(&bus->run, camera, &error);
    if (!found)
        return refuse(invocation, error);
    GVariant *rgb = g_variant_new_fixed_array(G_VARIANT_TYPE_BYTE, found->rgb,
                                              (gsize)found->width * found->height * 3, 1);
    bus_rig1_complete_get_thumbnail(object, invocation, (guint)found->width, (guint)found->height,
                                    rgb, found->time_s);
    return TRUE;
}

static gboolean on_begin_recording(BusRig1 *object, GDBusMethodInvocation *invocation, Bus *bus) {
    recording_begin();
    bus_rig1_complete_begin_recording(object, invocation);
    return TRUE;
}

/* Sends the text in an unnamed temporary file, because a message bus limits the size of
 * messages. */
static gboolean on_end_recording(BusRig1 *object, GDBusMethodInvocation *invocation,
                                 GUnixFDList *list, Bus *bus) {
    g_autofree char *text = recording_end();
    g_autoptr(GUnixFDList) files = g_unix_fd_list_new();
    GError *error = NULL;
    if (!text) {
        g_set_error(&error, BUS_ERROR, BUS_ERROR_FAILED,
                    "nothing is being recorded: call BeginRecording first");
        return refuse(invocation, error);
    }
    const gsize n = strlen(text);
    const int fd = memfd_create("mesorig-recording", MFD_CLOEXEC);
    const gboolean written = fd >= 0 && write(fd, text, n) == (gssize)n;
    const int index = written ? g_unix_fd_list_append(files, fd, &error) : -1;
    if (fd >= 0)
        close(fd);
    if (index < 0) {
        if (!error)
            g_set_error(&error, BUS_ERROR, BUS_ERROR_LIMIT,
                        "mesorigd has no memory for a recording of %zu bytes: end other programs "
                        "on its computer",
                        n);
        return refuse(invocation, error);
    }
    bus_rig1_complete_end_recording(object, invocation, files, g_variant_new_handle(index));
    return TRUE;
}

static gboolean on_snap(BusRig1 *object, GDBusMethodInvocation *invocation, GUnixFDList *list,
                        const char *camera, gint64 exposure_us, double gain_db, Bus *bus) {
    bus_hands_snap(&bus->hands, invocation, camera, exposure_us, gain_db);
    return TRUE;
}

static gboolean on_set_lamp(BusRig1 *object, GDBusMethodInvocation *invocation, const char *lamp,
                            gboolean on, double for_s, Bus *bus) {
    bus_hands_set_lamp(&bus->hands, invocation, lamp, on, for_s);
    return TRUE;
}

static gboolean on_set_laser(BusRig1 *object, GDBusMethodInvocation *invocation, const char *laser,
                             gboolean on, double for_s, Bus *bus) {
    bus_hands_set_laser(&bus->hands, invocation, laser, on, for_s);
    return TRUE;
}

static gboolean on_renew(BusRig1 *object, GDBusMethodInvocation *invocation, double for_s,
                         Bus *bus) {
    GError *error = NULL;
    guint n = 0;
    if (!bus_hands_renew(&bus->hands, invocation, for_s, &n, &error))
        return refuse(invocation, error);
    bus_rig1_complete_renew(object, invocation, n);
    return TRUE;
}

static gboolean on_release(BusRig1 *object, GDBusMethodInvocation *invocation, Bus *bus) {
    GError *error = NULL;
    if (!bus_latch_release(bus->latch, invocation, &error))
        return refuse(invocation, error);
    bus_safety_rest_clock(&bus->rig);
    bus_unattended_poke(bus->unattended);
    bus_rig_flush(&bus->rig);
    bus_rig1_complete_release(object, invocation);
    return TRUE;
}

static gboolean on_move_axis(BusRig1 *object, GDBusMethodInvocation *invocation, const char *axis,
                             double deg, Bus *bus) {
    bus_hands_move(&bus->hands, invocation, axis, deg);
    return TRUE;
}

static gboolean on_home_axis(BusRig1 *object, GDBusMethodInvocation *invocation, const char *axis,
                             Bus *bus) {
    bus_hands_home(&bus->hands, invocation, axis);
    return TRUE;
}

/* Connects all handlers except the handler of SafeState, which bus_latch.c answers. */
void bus_answer_calls(Bus *bus) {
    const struct {
        const char *signal;
        GCallback handler;
    } handlers[] = {
        {"handle-open-rig", G_CALLBACK(on_open_rig)},
        {"handle-close-rig", G_CALLBACK(on_close_rig)},
        {"handle-validate", G_CALLBACK(on_validate)},
        {"handle-start", G_CALLBACK(on_start)},
        {"handle-resume", G_CALLBACK(on_resume)},
        {"handle-pause", G_CALLBACK(on_pause)},
        {"handle-continue", G_CALLBACK(on_continue)},
        {"handle-finish", G_CALLBACK(on_finish)},
        {"handle-abort", G_CALLBACK(on_abort)},
        {"handle-queue-add", G_CALLBACK(on_queue_add)},
        {"handle-queue-remove", G_CALLBACK(on_queue_remove)},
        {"handle-queue-move", G_CALLBACK(on_queue_move)},
        {"handle-queue-pause", G_CALLBACK(on_queue_pause)},
        {"handle-queue-resume", G_CALLBACK(on_queue_resume)},
        {"handle-get-thumbnail", G_CALLBACK(on_get_thumbnail)},
        {"handle-begin-recording", G_CALLBACK(on_begin_recording)},
        {"handle-end-recording", G_CALLBACK(on_end_recording)},
        {"handle-snap", G_CALLBACK(on_snap)},
        {"handle-set-lamp", G_CALLBACK(on_set_lamp)},
        {"handle-set-laser", G_CALLBACK(on_set_laser)},
        {"handle-renew", G_CALLBACK(on_renew)},
        {"handle-release", G_CALLBACK(on_release)},
        {"handle-move-axis", G_CALLBACK(on_move_axis)},
        {"handle-home-axis", G_CALLBACK(on_home_axis)},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(handlers); i++)
        g_signal_connect(bus->object, handlers[i].signal, handlers[i].handler, bus);
}
