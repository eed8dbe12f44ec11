#include "bus_hands.h"

#include <gio/gunixfdlist.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "bus_errors.h"
#include "bus_names.h"
#include "bus_safety.h"

/* Numbers of pictures taken by hand begin here. Shots of sessions have lower numbers. */
#define FIRST_PICTURE (G_GUINT64_CONSTANT(1) << 48)
#define MAX_RETAKES   3

enum hand_kind { HAND_CAMERA, HAND_LAMP, HAND_LASER, HAND_AXIS };

/* A device that is in use by hand. It is in use while a call waits for it, while it gives light,
 * and while it is being switched off or stopped. */
struct hand {
    struct bus_hands *hands;
    enum hand_kind kind;
    Camera *camera;
    LampBank *bank;
    int lamp; /* index in the bank */
    Laser *laser;
    Axis *axis;
    const char *name;                  /* name of the device */
    GDBusMethodInvocation *invocation; /* the call that waits; NULL if there is none */
    BusParked parked; /* callback of bus_hands_park(); NULL if a client uses the device */
    gpointer parked_data;
    GDBusConnection *connection; /* connection of the client */
    char *sender;                /* name of the client on a message bus, or NULL */
    /* watch that calls on_vanished() when sender leaves the bus; 0 if sender is NULL */
    guint watch;
    /* The device was commanded to switch off or to stop. The use ends when the device has
     * obeyed. */
    gboolean off_asked;
    guint lease; /* timer for the end of the lease of a lamp or laser */
    gboolean homing;
    guint warming; /* timer on the rig's clock for the moment when the light is stable */
    guint64 picture;
    int retakes;
};

static void hand_fail(struct hand *hand, const GError *error) {
    const BusParked parked = hand->parked;
    hand->parked = NULL;
    if (parked)
        parked(hand->parked_data, error);
    GDBusMethodInvocation *invocation = g_steal_pointer(&hand->invocation);
    if (invocation)
        g_dbus_method_invocation_take_error(invocation, bus_errors_wrap(g_error_copy(error)));
}

static void hand_listen(struct hand *hand, gboolean listen);

void bus_hands_init(struct bus_hands *hands, struct bus_rig *rig, const struct bus_jobs *jobs) {
    hands->rig = rig;
    hands->jobs = jobs;
    hands->list = g_ptr_array_new();
}

void bus_hands_clear(struct bus_hands *hands) {
    g_ptr_array_unref(hands->list);
}

static void on_interlock(Interlock *interlock, gboolean closed, gpointer data) {
    struct bus_hands *hands = data;
    g_autoptr(GError) error = NULL;
    if (!closed && hands->list->len > 0) {
        g_autofree char *why = interlock_advice(interlock);
        bus_hands_stop(hands, why);
        if (!devices_make_safe(hands->rig->devices, &error))
            bus_rig_report(hands->rig, "error", interlock->device.name, error->message);
    }
    bus_rig_show_devices(hands->rig);
}

void bus_hands_watch(struct bus_hands *hands, gboolean watch) {
    for (int i = 0; i < hands->rig->devices->n_interlocks; i++)
        if (watch)
            hands->interlocks[i] =
                interlock_listen(hands->rig->devices->interlocks[i], on_interlock, hands);
        else
            interlock_unlisten(hands->rig->devices->interlocks[i], hands->interlocks[i]);
}

/* Ends the use of the device and frees hand. */
static void hand_drop(struct hand *hand) {
    struct bus_hands *hands = hand->hands;
    hand_listen(hand, FALSE);
    clock_cancel(hands->rig->devices->clock, &hand->warming);
    g_clear_handle_id(&hand->lease, g_source_remove);
    if (hand->camera)
        camera_disarm(hand->camera);
    if (hand->watch)
        g_bus_unwatch_name(hand->watch);
    g_ptr_array_remove_fast(hands->list, hand);
    hands->rig->n_hands = hands->list->len;
    g_free(hand->sender);
    g_free(hand);
    if (hands->list->len == 0) {
        bus_safety_rest_clock(hands->rig);
        hands->rig->freed(hands->rig->data);
    }
    bus_rig_show_devices(hands->rig);
}

/* Answers the call that waits. The answer to MoveAxis and HomeAxis is the angle of the axis. If
 * bus_hands_park() uses the axis, its callback is called instead. */
static void hand_answer(struct hand *hand) {
    BusRig1 *object = hand->hands->rig->object;
    GDBusMethodInvocation *invocation = g_steal_pointer(&hand->invocation);
    const BusParked parked = hand->parked;
    hand->parked = NULL;
    bus_rig_show_devices(hand->hands->rig);
    g_dbus_interface_skeleton_flush(G_DBUS_INTERFACE_SKELETON(object));
    if (parked)
        parked(hand->parked_data, NULL);
    if (!invocation)
        return;
    if (hand->kind == HAND_LAMP)
        bus_rig1_complete_set_lamp(object, invocation);
    else if (hand->kind == HAND_LASER)
        bus_rig1_complete_set_laser(object, invocation);
    else if (hand->homing)
        bus_rig1_complete_home_axis(object, invocation, axis_position_deg(hand->axis));
    else
        bus_rig1_complete_move_axis(object, invocation, axis_position_deg(hand->axis));
}

/* Ends the use of a device that has not obeyed, with an error. If the device may still give light,
 * drivers/lights.h repeats the command "off" until the device confirms it. */
static void hand_lose(struct hand *hand, const GError *error) {
    hand_fail(hand, error);
    hand_drop(hand);
}

static void hand_on_warm(gpointer data) {
    struct hand *hand = data;
    hand->warming = 0;
    hand_answer(hand);
}

/* Called when a lamp or laser has confirmed that it is on or off. If it has not obeyed, called with
 * an error. */
static void hand_switched(struct hand *hand, gboolean on, double warm_up_s, const GError *error) {
    Clock *clock = hand->hands->rig->devices->clock;
    if (!on && !hand->off_asked)
        return; /* the answer belongs to an earlier command, such as that of SafeState */
    if (error) {
        hand_lose(hand, error);
    } else if (!on) {
        hand_answer(hand);
        hand_drop(hand);
    } else if (!hand->off_asked && !hand->warming) {
        hand->warming =
            clock_call_in(clock, (gint64)ceil(warm_up_s * G_USEC_PER_SEC), hand_on_warm, hand);
        bus_rig_show_devices(hand->hands->rig);
    }
}

/* Listener of a bank. It is called for all lamps that are in use, because a bank has only one
 * listener. index is −1 if the event concerns all lamps of the bank. */
static void hand_on_lamp(LampBank *bank, int index, gboolean on, gint64 at_us, const GError *error,
                         gpointer data) {
    struct bus_hands *hands = data;
    for (guint i = hands->list->len; i-- > 0;) {
        struct hand *hand = hands->list->pdata[i];
        if (hand->kind == HAND_LAMP && hand->bank == bank && (index < 0 || index == hand->lamp))
            hand_switched(hand, on, bank->warm_up_s, error);
    }
}

static void hand_on_laser(Laser *laser, gboolean on, const GError *error, gpointer data) {
    hand_switched(data, on, laser->warm_up_s, error);
}

static void hand_on_axis(Axis *axis, enum axis_event event, const GError *error, gpointer data) {
    struct hand *hand = data;
    g_autoptr(GError) stopped = NULL;
    if (event == AXIS_STOPPED)
        device_error_set(&stopped, DEVICE_ERROR_STALLED, axis->device.who,
                         "the axis was stopped at %g° and has not reached its target" ERROR_ADVICE
                         "find out who or what stopped it, then move it again",
                         axis_position_deg(axis));
    if (event == AXIS_HOMED && hand->parked && isfinite(axis->park_deg)) {
        if (axis_move(axis, axis->park_deg, &stopped))
            return;
    }
    if (error || stopped)
        hand_fail(hand, error ? error : stopped);
    else
        hand_answer(hand);
    hand_drop(hand);
}

/* Sends the picture in an unnamed temporary file, because a message bus limits the size of
 * messages. */
static void hand_answer_picture(struct hand *hand, const Frame *frame) {
    const gsize size = (gsize)frame->width * (gsize)frame->height * sizeof(guint16);
    g_autoptr(GError) error = NULL;
    g_autoptr(GUnixFDList) list = g_unix_fd_list_new();
    const int fd = memfd_create("mesorig-picture", MFD_CLOEXEC);
    FILE *file = fd >= 0 ? fdopen(fd, "wb") : NULL;
    const gboolean written =
        file && fwrite(frame->pixels, 1, size, file) == size && fflush(file) == 0;
    const int index = written ? g_unix_fd_list_append(list, fd, &error) : -1;
    if (index >= 0) {
        bus_rig1_complete_snap(hand->hands->rig->object, g_steal_pointer(&hand->invocation), list,
                               (guint)frame->width, (guint)frame->height, (guint)frame->bits,
                               frame->black_level, cfa_name(frame->cfa), frame->exposure_us,
                               g_variant_new_handle(index));
    } else {
        if (!error)
            g_set_error(&error, BUS_ERROR, BUS_ERROR_LIMIT,
                        "mesorigd has no memory for a picture of %d × %d pixels: end other "
                        "programs on its computer",
                        frame->width, frame->height);
        hand_fail(hand, error);
    }
    if (file)
        fclose(file);
    else if (fd >= 0)
        close(fd);
}

static void hand_on_camera(Camera *camera, enum camera_event event, Frame *frame,
                           const GError *error, gpointer data) {
    struct hand *hand = data;
    if (event == CAMERA_EXPOSED)
        return;
    if (event == CAMERA_REFUSED && hand->retakes++ < MAX_RETAKES &&
        camera_trigger(camera, hand->picture, NULL))
        return;
    if (event == CAMERA_FRAME)
        hand_answer_picture(hand, frame);
    else
        hand_fail(hand, error);
    hand_drop(hand);
}

static void hand_listen(struct hand *hand, gboolean listen) {
    gboolean others = FALSE;
    for (guint i = 0; hand->bank && i < hand->hands->list->len; i++) {
        const struct hand *other = hand->hands->list->pdata[i];
        others |= other != hand && other->bank == hand->bank;
    }
    if (hand->camera)
        camera_listen(hand->camera, listen ? hand_on_camera : NULL, hand);
    else if (hand->bank && !others)
        lamps_listen(hand->bank, listen ? hand_on_lamp : NULL, hand->hands);
    else if (hand->laser)
        laser_listen(hand->laser, listen ? hand_on_laser : NULL, hand);
    else if (hand->axis)
        axis_listen(hand->axis, listen ? hand_on_axis : NULL, hand);
}

/* Ends the use of a device: switches it off or stops it. A light stays in use until it has
 * confirmed that it is off, and an axis until it stands still. The use of a camera, and of a device
 * that refuses the command, ends at once. */
static void hand_end(struct hand *hand, const char *why) {
    g_autoptr(GError) error = NULL;
    g_autoptr(GError) cancelled = g_error_new_literal(BUS_ERROR, BUS_ERROR_CANCELLED, why);
    hand_fail(hand, cancelled);
    clock_cancel(hand->hands->rig->devices->clock, &hand->warming);
    g_clear_handle_id(&hand->lease, g_source_remove);
    hand->off_asked = TRUE;
    if (hand->axis && !axis_stop(hand->axis, &error))
        bus_rig_report(hand->hands->rig, "error", hand->name, error->message);
    if (hand->axis && !error && axis_is_moving(hand->axis))
        return; /* the use ends when the axis stands */
    if (hand->camera || hand->axis) {
        hand_drop(hand);
        return;
    }
    const gboolean asked = hand->bank ? lamps_set(hand->bank, hand->lamp, FALSE, &error)
                                      : laser_set(hand->laser, FALSE, &error);
    if (!asked)
        hand_lose(hand, error);
}

static gboolean on_lease_over(gpointer data) {
    struct hand *hand = data;
    hand->lease = 0;
    bus_rig_report(hand->hands->rig, "info", hand->name,
                   "the lease of this light has ended, so the light is switched off");
    hand_end(hand, "the lease ended before the light was stable: call Renew while the light warms "
                   "up, or give a longer lease");
    return G_SOURCE_REMOVE;
}

static void hand_begin_lease(struct hand *hand, double for_s) {
    g_clear_handle_id(&hand->lease, g_source_remove);
    hand->lease = g_timeout_add((guint)ceil(for_s * 1000), on_lease_over, hand);
}

static gboolean check_lease(double for_s, GError **error) {
    if (for_s > 0 && for_s <= BUS_MAX_LEASE_S)
        return TRUE;
    g_set_error(error, BUS_ERROR, BUS_ERROR_LIMIT,
                "the lease of %g s is out of range: give more than 0 s and at most %d s, and call "
                "Renew before the lease ends",
                for_s, BUS_MAX_LEASE_S);
    return FALSE;
}

static gboolean hand_is_of(const struct hand *hand, GDBusMethodInvocation *invocation) {
    return hand->connection == g_dbus_method_invocation_get_connection(invocation) &&
           g_strcmp0(hand->sender, g_dbus_method_invocation_get_sender(invocation)) == 0;
}

gboolean bus_hands_renew(struct bus_hands *hands, GDBusMethodInvocation *invocation, double for_s,
                         guint *ret_n, GError **error) {
    if (!bus_rig_need_open(hands->rig, error) || !check_lease(for_s, error))
        return FALSE;
    *ret_n = 0;
    for (guint i = 0; i < hands->list->len; i++) {
        struct hand *hand = hands->list->pdata[i];
        if (!hand->lease || hand->off_asked || !hand_is_of(hand, invocation))
            continue;
        hand_begin_lease(hand, for_s);
        ++*ret_n;
    }
    return TRUE;
}

void bus_hands_stop(struct bus_hands *hands, const char *why) {
    for (guint i = hands->list->len; i-- > 0;)
        hand_end(hands->list->pdata[i], why);
}

void bus_hands_end(struct bus_hands *hands, const char *why) {
    bus_hands_stop(hands, why);
    while (hands->list->len > 0)
        hand_drop(hands->list->pdata[0]);
}

static void end_those_of(struct bus_hands *hands, GDBusConnection *connection, const char *sender) {
    for (guint i = hands->list->len; i-- > 0;) {
        struct hand *hand = hands->list->pdata[i];
        if (connection && hand->connection == connection && !hand->off_asked &&
            (!sender || g_strcmp0(hand->sender, sender) == 0))
            hand_end(hand, "the client has disconnected");
    }
}

void bus_hands_end_client(struct bus_hands *hands, GDBusConnection *connection) {
    end_those_of(hands, connection, NULL);
}

static void on_vanished(GDBusConnection *connection, const char *name, gpointer data) {
    end_those_of(data, connection, name);
}

static gboolean need_closed_interlocks(struct bus_hands *hands, GError **error) {
    const Interlock *open = bus_rig_open_interlock(hands->rig);
    if (!open)
        return TRUE;
    g_autofree char *advice = interlock_advice(open);
    g_set_error_literal(error, DEVICE_ERROR, DEVICE_ERROR_INTERLOCK, advice);
    return FALSE;
}

static struct hand *find_hand(struct bus_hands *hands, const struct hand *like) {
    for (guint i = 0; i < hands->list->len; i++) {
        struct hand *other = hands->list->pdata[i];
        if (other->camera == like->camera && other->bank == like->bank &&
            other->lamp == like->lamp && other->laser == like->laser && other->axis == like->axis)
            return other;
    }
    return NULL;
}

static GError *check_hand(struct bus_hands *hands, GDBusMethodInvocation *invocation,
                          const struct hand *hand, const struct hand *like) {
    const gboolean emits =
        (like->kind == HAND_LASER && !like->off_asked) || like->kind == HAND_AXIS;
    GError *error = NULL;
    if (g_dbus_connection_is_closed(g_dbus_method_invocation_get_connection(invocation)))
        return g_error_new_literal(BUS_ERROR, BUS_ERROR_CANCELLED, "the client has disconnected");
    if (emits && !need_closed_interlocks(hands, &error))
        return error;
    if (hand && hand->lease && !like->off_asked && !hand_is_of(hand, invocation))
        return g_error_new(BUS_ERROR, BUS_ERROR_BUSY,
                           "another client has switched %s on: try again when it is off",
                           like->name);
    /* A call that switches off may use a light that is in use: it ends a call that switches on and
     * is not answered yet. If the light is already being switched off, the call may wait for this
     * too, provided that no other call waits for it. */
    const gboolean joins = like->off_asked && hand && !(hand->off_asked && hand->invocation);
    if (hand && !joins && (hand->off_asked || hand->parked || hand->invocation))
        return g_error_new(BUS_ERROR, BUS_ERROR_BUSY,
                           "%s is busy with another call: try again when that call is answered",
                           like->name);
    return NULL;
}

static struct hand *hand_new(struct bus_hands *hands, GDBusMethodInvocation *invocation,
                             const struct hand *like) {
    struct hand *hand = g_memdup2(like, sizeof *like);
    if (hands->list->len == 0)
        bus_rig_hold_clock(hands->rig, FALSE); /* virtual time runs while any device is in use */
    hand->hands = hands;
    g_ptr_array_add(hands->list, hand);
    hands->rig->n_hands = hands->list->len;
    hand_listen(hand, TRUE);
    hand->connection = g_dbus_method_invocation_get_connection(invocation);
    hand->sender = g_strdup(g_dbus_method_invocation_get_sender(invocation));
    if (hand->sender)
        hand->watch = g_bus_watch_name_on_connection(hand->connection, hand->sender,
                                                     G_BUS_NAME_WATCHER_FLAGS_NONE, NULL,
                                                     on_vanished, hands, NULL);
    return hand;
}

/* Begins the use of a device. `like` describes the device and the use. If off_asked is TRUE, the
 * call switches off, and a waiting call that switches on is ended. If the use is not possible now,
 * answers the call with an error and returns NULL. */
static struct hand *hand_take(struct bus_hands *hands, GDBusMethodInvocation *invocation,
                              struct hand like) {
    struct hand *hand = find_hand(hands, &like);
    GError *error = check_hand(hands, invocation, hand, &like);
    if (error) {
        g_dbus_method_invocation_take_error(invocation, bus_errors_wrap(error));
        return NULL;
    }
    if (!hand) {
        hand = hand_new(hands, invocation, &like);
    } else if (like.off_asked) {
        g_autoptr(GError) ended = g_error_new_literal(BUS_ERROR, BUS_ERROR_CANCELLED,
                                                      "a later call has switched the light off");
        hand_fail(hand, ended);
        clock_cancel(hands->rig->devices->clock, &hand->warming);
        g_clear_handle_id(&hand->lease, g_source_remove);
        hand->off_asked = TRUE;
    }
    hand->invocation = invocation;
    hands->rig->is_safe = FALSE;
    return hand;
}

/* Checks that a rig is open and that nothing is captured. Otherwise answers the call with an error
 * and returns FALSE. */
static gboolean rig_is_free(struct bus_hands *hands, GDBusMethodInvocation *invocation) {
    GError *error = NULL;
    if (bus_rig_need_open(hands->rig, &error) && bus_jobs_need_free(hands->jobs, &error))
        return TRUE;
    g_dbus_method_invocation_take_error(invocation, bus_errors_wrap(error));
    return FALSE;
}

/* Answers the call with an error: there is no device of this name. names is the list of the
 * existing devices, for the message. */
static void refuse_name(GDBusMethodInvocation *invocation, const char *kind, const char *name,
                        const GString *names) {
    g_dbus_method_invocation_return_error(
        invocation, BUS_ERROR, BUS_ERROR_UNKNOWN, "there is no %s “%s”; %s%s", kind, name,
        names->len ? "choose from: " : "the rig has none", names->str);
}

static gboolean is_named(GString *names, const char *is, const char *wanted) {
    g_string_append_printf(names, "%s%s", names->len ? ", " : "", is);
    return strcmp(is, wanted) == 0;
}

/* Ends the use of a device that has refused a command, with the error. */
static void hand_refused(struct hand *hand, GError *error) {
    hand_fail(hand, error);
    hand_drop(hand);
    g_error_free(error);
}

void bus_hands_snap(struct bus_hands *hands, GDBusMethodInvocation *invocation, const char *name,
                    gint64 exposure_us, double gain_db) {
    static guint64 n_pictures;
    g_autoptr(GString) names = g_string_new(NULL);
    GError *error = NULL;
    Camera *camera = NULL;
    if (!rig_is_free(hands, invocation))
        return;
    for (int i = 0; i < hands->rig->devices->geometry.n_cameras && !camera; i++)
        if (devices_is_unit(&hands->rig->devices->geometry, i) &&
            is_named(names, hands->rig->devices->cameras[i]->device.name, name))
            camera = hands->rig->devices->cameras[i];
    if (!camera) {
        refuse_name(invocation, "camera", name, names);
        return;
    }
    struct hand *hand = hand_take(
        hands, invocation,
        (struct hand){.kind = HAND_CAMERA, .camera = camera, .name = camera->device.name});
    if (!hand)
        return;
    const struct camera_settings settings = {exposure_us, gain_db};
    hand->picture = FIRST_PICTURE + n_pictures++;
    if (!camera_configure(camera, &settings, &error) || !camera_arm(camera, &error) ||
        !camera_trigger(camera, hand->picture, &error))
        hand_refused(hand, error);
}

/* Switches a lamp or laser on or off. If the light is to be switched on and is already on and
 * stable, only its lease is renewed. */
static void set_light(struct bus_hands *hands, GDBusMethodInvocation *invocation, struct hand like,
                      gboolean on, double for_s) {
    GError *error = NULL;
    if (on && !check_lease(for_s, &error)) {
        g_dbus_method_invocation_take_error(invocation, bus_errors_wrap(error));
        return;
    }
    like.off_asked = !on;
    struct hand *hand = hand_take(hands, invocation, like);
    if (!hand)
        return;
    const enum light light =
        hand->bank ? lamps_light(hand->bank, hand->lamp) : laser_light(hand->laser);
    const gboolean stays = on && hand->lease && !hand->warming && light == LIGHT_ON;
    if (on)
        hand_begin_lease(hand, for_s);
    if (stays)
        hand_answer(hand);
    else if (!(hand->bank ? lamps_set(hand->bank, hand->lamp, on, &error)
                          : laser_set(hand->laser, on, &error)))
        hand_refused(hand, error);
    else
        bus_rig_show_devices(hands->rig); /* the light may shine before the device answers */
}

void bus_hands_set_lamp(struct bus_hands *hands, GDBusMethodInvocation *invocation,
                        const char *name, gboolean on, double for_s) {
    g_autoptr(GString) names = g_string_new(NULL);
    char device[RIG_NAME];
    int i = 0;
    if (!rig_is_free(hands, invocation))
        return;
    const struct rig *rig = &hands->rig->devices->geometry;
    /* a lamp on the probe is one lamp, although each stop of the probe has an entry */
    for (; i < rig->n_lamps; i++) {
        rig_stop_device(rig->lamps[i].name, rig->lamps[i].on_probe, device);
        if (rig_lamp_unit(rig, i) == i && is_named(names, device, name))
            break;
    }
    if (i == rig->n_lamps) {
        refuse_name(invocation, "lamp", name, names);
        return;
    }
    const struct hand like = {.kind = HAND_LAMP,
                              .bank = hands->rig->devices->lamps[i].bank,
                              .lamp = hands->rig->devices->lamps[i].index,
                              .name = rig->lamps[i].name};
    set_light(hands, invocation, like, on, for_s);
}

void bus_hands_set_laser(struct bus_hands *hands, GDBusMethodInvocation *invocation,
                         const char *name, gboolean on, double for_s) {
    g_autoptr(GString) names = g_string_new(NULL);
    Laser *laser = NULL;
    if (!rig_is_free(hands, invocation))
        return;
    for (int i = 0; i < hands->rig->devices->geometry.n_lasers && !laser; i++)
        if (rig_laser_unit(&hands->rig->devices->timing, i) == i &&
            is_named(names, hands->rig->devices->lasers[i]->device.name, name))
            laser = hands->rig->devices->lasers[i];
    if (!laser) {
        refuse_name(invocation, "laser", name, names);
        return;
    }
    const struct hand like = {.kind = HAND_LASER, .laser = laser, .name = laser->device.name};
    set_light(hands, invocation, like, on, for_s);
}

/* Begins the use of the axis of this name. Returns NULL if that is not possible. The call has then
 * been answered. */
static struct hand *take_axis(struct bus_hands *hands, GDBusMethodInvocation *invocation,
                              const char *name) {
    g_autoptr(GString) names = g_string_new(NULL);
    Axis *axis = NULL;
    if (!rig_is_free(hands, invocation))
        return NULL;
    for (int i = -DEVICES_POSITIONERS; i < hands->rig->devices->geometry.n_lasers && !axis; i++) {
        Axis *one = i < 0 ? devices_positioner(hands->rig->devices, i + DEVICES_POSITIONERS)
                          : hands->rig->devices->sweeps[i];
        if (one && is_named(names, one->device.name, name))
            axis = one;
    }
    if (axis)
        return hand_take(hands, invocation,
                         (struct hand){.kind = HAND_AXIS, .axis = axis, .name = axis->device.name});
    refuse_name(invocation, "axis", name, names);
    return NULL;
}

void bus_hands_move(struct bus_hands *hands, GDBusMethodInvocation *invocation, const char *axis,
                    double deg) {
    GError *error = NULL;
    struct hand *hand = take_axis(hands, invocation, axis);
    if (hand && !axis_move(hand->axis, deg, &error))
        hand_refused(hand, error);
    else if (hand)
        bus_rig_show_devices(hands->rig); /* shows that it moves */
}

void bus_hands_home(struct bus_hands *hands, GDBusMethodInvocation *invocation, const char *axis) {
    GError *error = NULL;
    struct hand *hand = take_axis(hands, invocation, axis);
    if (hand)
        hand->homing = TRUE;
    if (hand && !axis_home(hand->axis, &error))
        hand_refused(hand, error);
    else if (hand)
        bus_rig_show_devices(hands->rig);
}

gboolean bus_hands_park(struct bus_hands *hands, Axis *axis, BusParked done, gpointer data,
                        GError **error) {
    if (!need_closed_interlocks(hands, error))
        return FALSE;
    for (guint i = 0; i < hands->list->len; i++)
        if (((const struct hand *)hands->list->pdata[i])->axis == axis) {
            g_set_error(error, BUS_ERROR, BUS_ERROR_BUSY,
                        "somebody is moving the axis %s: try again when it stands still",
                        axis->device.name);
            return FALSE;
        }
    const gboolean homes = !axis_is_homed(axis) || !isfinite(axis->park_deg);
    struct hand *hand = g_new(struct hand, 1);
    *hand = (struct hand){.hands = hands,
                          .kind = HAND_AXIS,
                          .axis = axis,
                          .name = axis->device.name,
                          .homing = homes};
    if (hands->list->len == 0)
        bus_rig_hold_clock(hands->rig, FALSE);
    g_ptr_array_add(hands->list, hand);
    hands->rig->n_hands = hands->list->len;
    hand_listen(hand, TRUE);
    hands->rig->is_safe = FALSE;
    if (!(homes ? axis_home(axis, error) : axis_move(axis, axis->park_deg, error))) {
        hand_drop(hand);
        return FALSE;
    }
    hand->parked = done;
    hand->parked_data = data;
    bus_rig_show_devices(hands->rig);
    return TRUE;
}
