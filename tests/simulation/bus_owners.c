#include "bus_owners.h"

#include <math.h>
#include <string.h>

#include "devices/devices.h"

/* From the time that nobody wants light any more until it is off or reported as unsafe: a command
 * to switch off has 2 s to be answered. Axes brake within 0.8 s. */
#define DARK_US  (5 * G_USEC_PER_SEC / 2)
#define STILL_US (3 * G_USEC_PER_SEC / 2)

/* From the time that a light goes on until it is no longer said to be off. */
#define SHOWN_US (G_USEC_PER_SEC / 10)

/* From the time that the line to a device is usable until light that nobody wants is off. */
#define RETRIED_US G_USEC_PER_SEC

/* Until calls are answered: of lights, their deadline and warm-up; SafeState. */
#define LIGHT_ANSWER_US (5 * G_USEC_PER_SEC)
#define SAFE_ANSWER_US  (G_USEC_PER_SEC / 4)

enum said { SAID_OFF, SAID_ON, SAID_UNSAFE };

struct watched_light {
    const char *name;
    enum bus_method method; /* that switches it */
    int device, at;         /* at: its index in the world */
    gboolean lit;
    gint64 wanted_us; /* when it was wanted last, or went on */
    gint64 off_us;    /* since when it shines and is said to be off; −1: it does not, or is not */
};

struct watched_axis {
    const char *name;
    int device;
    double deg;
    gint64 wanted_us;
};

struct bus_owners {
    struct scene *scene;
    const struct bus_schedule *schedule;
    Bus *bus;
    const struct bus_clients *clients;
    World *world;
    guint n_sent, n_answered; /* calls that were noted */
    GArray *wants;            /* of guint: calls that want light or motion */
    int released;             /* the last call that ended a safe state; −1: none */
    gint64 latched_us; /* since when SafeState has been answered and not released; −1: it is not */
    struct watched_light lights[4];
    struct watched_axis axes[4];
};

static gint64 owners_now_us(const struct bus_owners *owners) {
    return owners->scene->disk.ended_us;
}

static gint64 latency_us(const struct bus_owners *owners) {
    return (gint64)(owners->schedule->latency_s * 1e6);
}

struct bus_owners *bus_owners_new(struct scene *scene, const struct bus_schedule *schedule,
                                  Bus *bus, const struct bus_clients *clients) {
    struct bus_owners *owners = g_new0(struct bus_owners, 1);
    g_autofree char *path = g_build_filename(scene->folder, "world.conf", NULL);
    g_autoptr(GError) error = NULL;
    owners->scene = scene;
    owners->schedule = schedule;
    owners->bus = bus;
    owners->clients = clients;
    owners->world = world_get(path, &error);
    if (!owners->world)
        g_error("simulate: %s", error->message);
    owners->latched_us = -1;
    owners->released = -1;
    owners->wants = g_array_new(FALSE, FALSE, sizeof(guint));
    for (int i = 0; i < 4; i++) {
        const enum bus_method method = i < 2 ? BUS_SET_LASER : BUS_SET_LAMP;
        const char *name = bus_schedule_device(method, i % 2);
        owners->lights[i] =
            (struct watched_light){.name = name,
                                   .method = method,
                                   .device = i % 2,
                                   .at = i < 2 ? world_find_laser(owners->world, name)
                                               : world_find_lamp(owners->world, name),
                                   .wanted_us = G_MININT64 / 2,
                                   .off_us = -1};
        owners->axes[i] = (struct watched_axis){.name = bus_schedule_device(BUS_MOVE_AXIS, i),
                                                .device = i,
                                                .wanted_us = G_MININT64 / 2};
    }
    return owners;
}

/* What the bus shows of the device. */
static const char *health_of(const struct bus_owners *owners, const char *class_name,
                             const char *name) {
    GVariant *devices = bus_rig1_get_devices(owners->bus->object);
    GVariantIter iter;
    const char *its_class, *its_name, *driver, *health;
    g_variant_iter_init(&iter, devices);
    while (g_variant_iter_next(&iter, "(&s&s&s&s)", &its_class, &its_name, &driver, &health))
        if (strcmp(its_class, class_name) == 0 && (!name || strcmp(its_name, name) == 0))
            return health;
    return NULL;
}

static gboolean is_unsafe(const char *health) {
    return health && (g_str_has_prefix(health, "unsafe") || strstr(health, DEVICES_UNSAFE));
}

/* All lamps are in one bank, which tells how many are on. */
static enum said said_of(const struct bus_owners *owners, const struct watched_light *light,
                         int n_lit) {
    const gboolean is_lamp = light->method == BUS_SET_LAMP;
    const char *health =
        health_of(owners, is_lamp ? "lamps" : "laser", is_lamp ? NULL : light->name);
    if (is_unsafe(health))
        return SAID_UNSAFE;
    if (!health)
        return SAID_OFF;
    if (is_lamp)
        return g_ascii_strtoll(health, NULL, 10) >= n_lit ? SAID_ON : SAID_OFF;
    return strcmp(health, "off") == 0 ? SAID_OFF : SAID_ON;
}

/* A session may light everything and move everything. */
static gboolean is_capturing(const struct bus_owners *owners) {
    static const char *const states[] = {"homing", "running", "pausing", NULL};
    return g_strv_contains(states, bus_rig1_get_state(owners->bus->object));
}

static const struct bus_call *call_at(const struct bus_owners *owners, guint at) {
    return &g_array_index(bus_clients_calls(owners->clients), struct bus_call, at);
}

static gboolean call_lights(const struct bus_call *call) {
    return call->method == BUS_SET_LASER || call->method == BUS_SET_LAMP;
}

static gboolean call_moves(const struct bus_call *call) {
    return call->method == BUS_MOVE_AXIS || call->method == BUS_HOME_AXIS;
}

/* Whether a call that was answered ends what another one wants that was sent before it: the daemon
 * begins with calls in the order in which they were sent. A device's error is no refusal: the call
 * was carried out, perhaps. SafeState ends also what was sent after it, unless it was released
 * meanwhile. */
static gboolean call_ends(const struct bus_owners *owners, guint at, guint wants) {
    const struct bus_call *call = call_at(owners, at), *earlier = call_at(owners, wants);
    if (call->method == BUS_SAFE_STATE)
        return call->ok && (wants < at || owners->released < (int)at);
    if (wants > at)
        return FALSE;
    if (call->method == BUS_CLOSE_RIG || call->method == BUS_START || call->method == BUS_RESUME)
        return call->ok;
    return call_lights(call) && !call->on && call->method == earlier->method &&
           call->device == earlier->device && (call->ok || g_str_has_prefix(call->error, "Device"));
}

/* A call wants light from its sending until its lease ends, its client goes, or another ends it;
 * motion, until it is answered. Who does not read may have been answered at any time. */
static gint64 call_wants_until(const struct bus_owners *owners, const struct bus_call *call) {
    const gboolean answered = call->answered_us >= 0;
    const gint64 gone_us = bus_clients_gone_us(owners->clients, call);
    const double lease_us = call_lights(call) ? MAX(call->for_s, 0) * 1e6 : 0;
    if (gone_us >= 0)
        return gone_us;
    if (answered && (!call->ok || call_moves(call)))
        return call->answered_us;
    if (call_moves(call) || !(lease_us < 1e15))
        return G_MAXINT64;
    return (answered ? call->answered_us : call->sent_us + LIGHT_ANSWER_US + latency_us(owners)) +
           (gint64)lease_us;
}

/* The main loop may have slept since a lease was over. */
static void note_wanted(struct bus_owners *owners, const struct bus_call *call, gint64 until_us) {
    for (int i = 0; i < 4; i++) {
        gint64 *wanted_us =
            call_moves(call) ? &owners->axes[i].wanted_us : &owners->lights[i].wanted_us;
        const gboolean is_its = call_moves(call) ? owners->axes[i].device == call->device
                                                 : owners->lights[i].method == call->method &&
                                                       owners->lights[i].device == call->device;
        if (is_its)
            *wanted_us = MAX(*wanted_us, MIN(until_us, owners_now_us(owners)));
    }
}

/* Takes note of calls that were sent since the last look, and of those that were answered. */
static void take_calls(struct bus_owners *owners) {
    const GArray *calls = bus_clients_calls(owners->clients);
    const GArray *answered = bus_clients_answered(owners->clients);
    for (; owners->n_sent < calls->len; owners->n_sent++) {
        const struct bus_call *call = call_at(owners, owners->n_sent);
        if (call_moves(call) || (call_lights(call) && call->on))
            g_array_append_val(owners->wants, owners->n_sent);
        if (call->method == BUS_RELEASE) {
            owners->latched_us = -1;
            owners->released = (int)owners->n_sent;
        }
    }
    for (; owners->n_answered < answered->len; owners->n_answered++) {
        const guint at = g_array_index(answered, guint, owners->n_answered);
        const struct bus_call *call = call_at(owners, at);
        for (guint i = owners->wants->len; i-- > 0;)
            if (call_ends(owners, at, g_array_index(owners->wants, guint, i)))
                g_array_remove_index(owners->wants, i);
        if (call->method == BUS_SAFE_STATE && call->ok && owners->released < (int)at &&
            owners->latched_us < 0)
            owners->latched_us = call->answered_us;
        if (call->method == BUS_SAFE_STATE && !call->deaf &&
            call->answered_us - call->sent_us > SAFE_ANSWER_US)
            scene_break(owners->scene, "answered", "SafeState is answered after %.3f s",
                        (double)(call->answered_us - call->sent_us) * 1e-6);
    }
    for (guint i = owners->wants->len; i-- > 0;) {
        const struct bus_call *call = call_at(owners, g_array_index(owners->wants, guint, i));
        const gint64 until_us = call_wants_until(owners, call);
        note_wanted(owners, call, until_us);
        if (until_us < owners_now_us(owners))
            g_array_remove_index(owners->wants, i);
    }
}

static gint64 dead_until_us(const struct bus_owners *owners, const struct watched_light *light) {
    const struct devices *devices = owners->bus->rig.devices;
    if (!devices)
        return 0;
    /* Their clock is the monotonic one. */
    return (light->method == BUS_SET_LASER ? sim_laser_dead_until_us(devices->lasers[light->device])
                                           : sim_lamps_dead_until_us(devices->banks[0])) -
           g_get_monotonic_time() + owners_now_us(owners);
}

static void check_light(struct bus_owners *owners, struct watched_light *light, int n_lit) {
    struct scene *scene = owners->scene;
    const gint64 now = owners_now_us(owners);
    const enum said said = said_of(owners, light, n_lit);
    const gint64 grace = DARK_US + latency_us(owners);
    if (is_capturing(owners))
        light->wanted_us = now;
    if (!light->lit || said != SAID_OFF)
        light->off_us = -1;
    else if (light->off_us < 0)
        light->off_us = now;
    if (!light->lit)
        return;
    if (light->off_us >= 0 && now - light->off_us > SHOWN_US)
        scene_break(scene, "shown", "%s shines, and the daemon says that it is off", light->name);
    if (said != SAID_UNSAFE && owners->latched_us >= 0 && now - owners->latched_us > grace)
        scene_break(scene, "latched", "%s shines after SafeState was answered", light->name);
    if (said != SAID_UNSAFE && now - light->wanted_us > grace)
        scene_break(scene, "owned", "%s shines, and nobody wants it", light->name);
    const gint64 dark = MAX(light->wanted_us, dead_until_us(owners, light));
    if (now - light->wanted_us > grace && now - dark > RETRIED_US + latency_us(owners))
        scene_break(scene, "retried", "%s shines %.1f s after its line was usable", light->name,
                    (double)(now - dark) * 1e-6);
}

static void check_axis(struct bus_owners *owners, struct watched_axis *axis, double deg) {
    struct scene *scene = owners->scene;
    const gint64 now = owners_now_us(owners);
    const gboolean moves = deg != axis->deg;
    axis->deg = deg;
    if (is_capturing(owners))
        axis->wanted_us = now;
    if (!moves || is_unsafe(health_of(owners, "axis", axis->name)))
        return;
    if (owners->latched_us >= 0 && now - owners->latched_us > STILL_US)
        scene_break(scene, "latched", "%s moves after SafeState was answered", axis->name);
    if (now - axis->wanted_us > STILL_US)
        scene_break(scene, "owned", "%s moves, and nobody wants it", axis->name);
}

void bus_owners_look(struct bus_owners *owners) {
    struct world_state state;
    int n_lamps = 0;
    world_snapshot(owners->world, g_get_monotonic_time(), 1, &state);
    take_calls(owners);
    for (int i = 0; i < 4; i++) {
        struct watched_light *light = &owners->lights[i];
        const gboolean lit = light->method == BUS_SET_LASER ? state.laser_on[light->at]
                                                            : state.lamp_output[light->at] > 0;
        n_lamps += lit && light->method == BUS_SET_LAMP;
        if (lit != light->lit)
            disk_say(&owners->scene->disk, "%s is %s", light->name, lit ? "lit" : "dark");
        if (lit && !light->lit)
            light->wanted_us = owners_now_us(owners);
        light->lit = lit;
    }
    for (int i = 0; i < 4; i++)
        check_light(owners, &owners->lights[i], n_lamps);
    const double angles[] = {state.turntable_deg, state.arc_deg,
                             state.sweep_deg[owners->lights[0].at],
                             state.sweep_deg[owners->lights[1].at]};
    for (int i = 0; i < 4; i++)
        check_axis(owners, &owners->axes[i], angles[i]);
}
