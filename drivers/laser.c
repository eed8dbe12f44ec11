#include "laser.h"

#include <math.h>

#define DEADLINE_US (2 * G_USEC_PER_SEC)

struct pending {
    Laser *laser;
    gboolean on;
    guint deadline;
};

struct laser_state {
    LaserFunc func;
    gpointer data;
    gboolean on;    /* as last reported */
    gboolean doubt; /* the last "off" failed */
    GQueue pending; /* of struct pending, in order */
    Interlock *guard;
    guint guard_id;
};

static void laser_pending_free(struct pending *pending) {
    clock_cancel(pending->laser->device.clock, &pending->deadline);
    g_free(pending);
}

static void laser_free(Laser *laser) {
    struct pending *pending;
    while ((pending = g_queue_pop_head(&laser->state->pending)))
        laser_pending_free(pending);
    device_clear(&laser->device);
    g_free(laser->state);
    g_free(laser);
}

Laser *laser_open(const struct laser_driver *driver, const struct config_section *section,
                  const char *const *also, Clock *clock, GError **error) {
    Laser *laser = g_new0(Laser, 1);
    laser->driver = driver;
    laser->state = g_new0(struct laser_state, 1);
    if (!device_init(&laser->device, &driver->info, section, also, clock, error) ||
        !driver->open(laser, error)) {
        laser_free(laser);
        return NULL;
    }
    if (!isfinite(laser->warm_up_s) || laser->warm_up_s < 0 || !isfinite(laser->watchdog_s) ||
        laser->watchdog_s < 0) {
        device_error_set(
            error, DEVICE_ERROR_RANGE, laser->device.who,
            "the warm-up of %g s or the watchdog of %g s is negative or not finite" ERROR_ADVICE
            "correct its section",
            laser->warm_up_s, laser->watchdog_s);
        laser_close(laser);
        return NULL;
    }
    return laser;
}

void laser_close(Laser *laser) {
    if (!laser)
        return;
    laser->state->func = NULL;
    laser_guard(laser, NULL);
    laser->driver->close(laser);
    laser_free(laser);
}

void laser_listen(Laser *laser, LaserFunc func, gpointer data) {
    laser->state->func = func;
    laser->state->data = data;
}

/* Call it last: the listener may close the laser. */
static void laser_notify(Laser *laser, gboolean on, const GError *error) {
    if (laser->state->func)
        laser->state->func(laser, on, error, laser->state->data);
}

static void laser_on_deadline(gpointer data) {
    struct pending *pending = data;
    Laser *laser = pending->laser;
    gboolean on = pending->on;
    g_autoptr(GError) error = device_error_new(
        DEVICE_ERROR_TIMEOUT, laser->device.who, "did not answer to \"%s\" within %d s%s",
        on ? "on" : "off", (int)(DEADLINE_US / G_USEC_PER_SEC),
        on ? ERROR_ADVICE "check its cable and power"
           : ERROR_ADVICE "it may still shine: cut its power by hand");
    pending->deadline = 0;
    laser->state->doubt |= !on;
    g_queue_remove(&laser->state->pending, pending);
    laser_pending_free(pending);
    laser_notify(laser, on, error);
}

static gboolean laser_start(Laser *laser, gboolean on, GError **error) {
    struct pending *pending = g_new0(struct pending, 1);
    pending->laser = laser;
    pending->on = on;
    g_queue_push_tail(&laser->state->pending, pending);
    if (!laser->driver->set(laser, on, error)) {
        g_queue_remove(&laser->state->pending, pending);
        laser_pending_free(pending);
        laser->state->doubt |= !on;
        return FALSE;
    }
    pending->deadline = clock_call_in(laser->device.clock, DEADLINE_US, laser_on_deadline, pending);
    return TRUE;
}

static void trip(Laser *laser) {
    g_autoptr(GError) error = NULL;
    if (laser_is_on(laser) && !laser_start(laser, FALSE, &error))
        laser_notify(laser, FALSE, error);
}

void laser_lost(Laser *laser, GError *error) {
    g_autoptr(GError) owned = error;
    g_autoptr(GError) unsent = NULL;
    if (!laser_start(laser, FALSE, &unsent))
        g_warning("%s", unsent->message);
    laser_notify(laser, TRUE, owned);
}

static void laser_on_interlock(Interlock *interlock, gboolean closed, gpointer data) {
    if (!closed)
        trip(data);
}

void laser_guard(Laser *laser, Interlock *interlock) {
    struct laser_state *state = laser->state;
    if (state->guard)
        interlock_unlisten(state->guard, state->guard_id);
    state->guard = interlock;
    if (!interlock)
        return;
    state->guard_id = interlock_listen(interlock, laser_on_interlock, laser);
    if (!interlock_is_closed(interlock))
        trip(laser);
}

gboolean laser_set(Laser *laser, gboolean on, GError **error) {
    const Interlock *guard = laser->state->guard;
    if (on && guard && !interlock_is_closed(guard))
        return device_error_set(error, DEVICE_ERROR_INTERLOCK, laser->device.who,
                                "not switched on, since the interlock %s is open" ERROR_ADVICE
                                "close it first",
                                guard->device.name);
    return laser_start(laser, on != FALSE, error);
}

gboolean laser_is_on(const Laser *laser) {
    const struct pending *last = g_queue_peek_tail((GQueue *)&laser->state->pending);
    return laser->state->on || (last && last->on);
}

enum device_safety laser_safety(const Laser *laser) {
    const struct laser_state *state = laser->state;
    if (!g_queue_is_empty((GQueue *)&state->pending))
        return DEVICE_TOLD;
    return state->on || state->doubt ? DEVICE_UNSAFE : DEVICE_SAFE;
}

gboolean laser_mount(Laser *laser, const char *place, GError **error) {
    return !laser->driver->mount || laser->driver->mount(laser, place, error);
}

void laser_report(Laser *laser, gboolean on, GError *error) {
    g_autoptr(GError) owned = error;
    struct pending *pending = g_queue_peek_head(&laser->state->pending);
    on = on != FALSE;
    if (!pending || pending->on != on) {
        /* The late answer to a set() that has timed out; if it reports light, believe it. */
        if (!owned && on)
            laser->state->on = TRUE;
        return;
    }
    g_queue_pop_head(&laser->state->pending);
    laser_pending_free(pending);
    if (!owned)
        laser->state->on = on;
    if (!on)
        laser->state->doubt = owned != NULL;
    laser_notify(laser, on, owned);
}
