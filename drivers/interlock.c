#include "interlock.h"

#include "recording.h"

struct listener {
    guint id;
    InterlockFunc func;
    gpointer data;
};

struct interlock_state {
    gboolean closed, lost;
    guint last_id;
    GArray *listeners; /* of struct listener */
};

static void interlock_free(Interlock *interlock) {
    device_clear(&interlock->device);
    g_array_unref(interlock->state->listeners);
    g_free(interlock->state);
    g_free(interlock);
}

Interlock *interlock_open(const struct interlock_driver *driver,
                          const struct config_section *section, const char *const *also,
                          Clock *clock, GError **error) {
    Interlock *interlock = g_new0(Interlock, 1);
    interlock->driver = driver;
    interlock->state = g_new0(struct interlock_state, 1);
    interlock->state->listeners = g_array_new(FALSE, FALSE, sizeof(struct listener));
    if (!device_init(&interlock->device, &driver->info, section, also, clock, error) ||
        !device_record_opened(&interlock->device, driver->open(interlock, error), error)) {
        interlock_free(interlock);
        return NULL;
    }
    return interlock;
}

void interlock_close(Interlock *interlock) {
    if (!interlock)
        return;
    g_array_set_size(interlock->state->listeners, 0);
    recording_device(interlock->device.who, "close");
    interlock->driver->close(interlock);
    interlock_free(interlock);
}

guint interlock_listen(Interlock *interlock, InterlockFunc func, gpointer data) {
    struct listener listener = {++interlock->state->last_id, func, data};
    g_array_append_val(interlock->state->listeners, listener);
    return listener.id;
}

void interlock_unlisten(Interlock *interlock, guint id) {
    GArray *listeners = interlock->state->listeners;
    for (guint i = 0; i < listeners->len; i++) {
        if (g_array_index(listeners, struct listener, i).id == id) {
            g_array_remove_index(listeners, i);
            return;
        }
    }
}

gboolean interlock_is_closed(const Interlock *interlock) {
    return interlock->state->closed;
}

gboolean interlock_is_lost(const Interlock *interlock) {
    return interlock->state->lost;
}

char *interlock_advice(const Interlock *interlock) {
    const char *name = interlock->device.name;
    return interlock->state->lost
               ? g_strdup_printf("interlock %s does not answer, so it counts as open: laser and "
                                 "motion are forbidden. Check its board and cables, then continue.",
                                 name)
               : g_strdup_printf("interlock %s is open: laser and motion are forbidden. Close it, "
                                 "then continue.",
                                 name);
}

static const struct listener *next_listener(const Interlock *interlock, guint after) {
    GArray *listeners = interlock->state->listeners;
    for (guint i = 0; i < listeners->len; i++) {
        if (g_array_index(listeners, struct listener, i).id > after)
            return &g_array_index(listeners, struct listener, i);
    }
    return NULL;
}

static void set(Interlock *interlock, gboolean closed, gboolean lost) {
    interlock->state->lost = lost;
    if (interlock->state->closed == closed)
        return;
    interlock->state->closed = closed;
    recording_device(interlock->device.who, "= %s", closed ? "closed" : lost ? "lost" : "open");
    /* Look the listener up each time, because a listener may remove itself or others from the
     * list. */
    const struct listener *listener;
    for (guint id = 0; (listener = next_listener(interlock, id));) {
        id = listener->id;
        listener->func(interlock, closed, listener->data);
    }
}

void interlock_report(Interlock *interlock, gboolean closed) {
    set(interlock, closed != FALSE, FALSE);
}

void interlock_report_lost(Interlock *interlock) {
    set(interlock, FALSE, TRUE);
}
