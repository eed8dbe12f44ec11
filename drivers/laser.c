#include "laser.h"

#include "lights.h"
#include "recording.h"

#include <math.h>

struct laser_state {
    LaserFunc func;
    gpointer data;
    struct lights *lights;
    Interlock *guard;
    guint guard_id;
};

static void laser_free(Laser *laser) {
    lights_free(laser->state->lights);
    device_clear(&laser->device);
    g_free(laser->state);
    g_free(laser);
}

static gboolean laser_send(gpointer device, int index, gboolean on, GError **error) {
    Laser *laser = device;
    return laser->driver->set(laser, on, error);
}

/* Tells the listener the answer to a command. Call it last, because the listener may close the
 * laser. */
static void answer(gpointer device, int index, gboolean on, gint64 at_us, const GError *error) {
    Laser *laser = device;
    if (error)
        recording_device(laser->device.who, "= fault: %s: %s", on ? "on" : "off", error->message);
    else
        recording_device(laser->device.who, "= %s", on ? "on" : "off");
    if (laser->state->func)
        laser->state->func(laser, on, error, laser->state->data);
}

Laser *laser_open(const struct laser_driver *driver, const struct config_section *section,
                  const char *const *also, Clock *clock, GError **error) {
    Laser *laser = g_new0(Laser, 1);
    laser->driver = driver;
    laser->state = g_new0(struct laser_state, 1);
    if (!device_init(&laser->device, &driver->info, section, also, clock, error) ||
        !device_record_opened(&laser->device, driver->open(laser, error), error)) {
        laser_free(laser);
        return NULL;
    }
    const gboolean warm_up_fits = isfinite(laser->warm_up_s) && laser->warm_up_s >= 0;
    if (!warm_up_fits)
        device_error_set(error, DEVICE_ERROR_RANGE, laser->device.who,
                         "its driver reports a warm-up time of %g s" ERROR_ADVICE
                         "set warm_up_s or warm_up_ms in its section to 0 or more, or remove it",
                         laser->warm_up_s);
    else if (!isfinite(laser->watchdog_s) || laser->watchdog_s < 0)
        device_error_set(error, DEVICE_ERROR_RANGE, laser->device.who,
                         "its driver reports a watchdog time of %g s" ERROR_ADVICE
                         "set the keys of the watchdog in its section to 0 or more, or remove them",
                         laser->watchdog_s);
    if (!warm_up_fits || !isfinite(laser->watchdog_s) || laser->watchdog_s < 0) {
        laser_close(laser);
        return NULL;
    }
    laser->state->lights = lights_new(laser, 1, FALSE, laser_send, answer);
    return laser;
}

void laser_close(Laser *laser) {
    if (!laser)
        return;
    laser->state->func = NULL;
    laser_guard(laser, NULL);
    recording_device(laser->device.who, "close");
    laser->driver->close(laser);
    laser_free(laser);
}

void laser_listen(Laser *laser, LaserFunc func, gpointer data) {
    laser->state->func = func;
    laser->state->data = data;
}

static void trip(Laser *laser) {
    g_autoptr(GError) error = NULL;
    if (laser_is_on(laser) && !lights_set(laser->state->lights, 0, FALSE, &error))
        answer(laser, 0, FALSE, clock_now_us(laser->device.clock), error);
}

void laser_lost(Laser *laser, GError *error) {
    g_autoptr(GError) owned = error;
    lights_lost(laser->state->lights, owned);
    answer(laser, 0, TRUE, clock_now_us(laser->device.clock), owned);
}

static void on_interlock(Interlock *interlock, gboolean closed, gpointer data) {
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
    state->guard_id = interlock_listen(interlock, on_interlock, laser);
    if (!interlock_is_closed(interlock))
        trip(laser);
}

gboolean laser_set(Laser *laser, gboolean on, GError **error) {
    const Interlock *guard = laser->state->guard;
    if (on && guard && !interlock_is_closed(guard))
        return device_error_set(
            error, DEVICE_ERROR_INTERLOCK, laser->device.who,
            interlock_is_lost(guard)
                ? "it is not switched on, because the interlock %s does not answer and counts as "
                  "open" ERROR_ADVICE "check the interlock's board and cables"
                : "it is not switched on, because the interlock %s is open" ERROR_ADVICE
                  "close the interlock first",
            guard->device.name);
    if (on && !device_ask_permit(&laser->device, error))
        return FALSE;
    recording_device(laser->device.who, "%s", on ? "on" : "off");
    return lights_set(laser->state->lights, 0, on != FALSE, error);
}

enum light laser_light(const Laser *laser) {
    return lights_light(laser->state->lights, 0);
}

gboolean laser_is_on(const Laser *laser) {
    return laser_light(laser) != LIGHT_OFF;
}

enum device_safety laser_safety(const Laser *laser) {
    return lights_safety(laser->state->lights);
}

gboolean laser_mount(Laser *laser, const char *place, GError **error) {
    return !laser->driver->mount || laser->driver->mount(laser, place, error);
}

void laser_report(Laser *laser, gboolean on, GError *error) {
    g_autoptr(GError) owned = error;
    lights_report(laser->state->lights, 0, on != FALSE, owned);
}
