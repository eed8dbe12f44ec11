#include "lamps.h"

#include <math.h>

#define DEADLINE_US (2 * G_USEC_PER_SEC)
#define MAX_LAMPS   1024

struct pending {
    LampBank *bank;
    int index;
    gboolean on;
    guint deadline;
};

struct lamp {
    gboolean on;
    gint64 since_us, burnt_us;
};

struct lamps_state {
    LampsFunc func;
    gpointer data;
    GQueue pending; /* of struct pending, in order */
    gboolean doubt; /* an "off" has failed, and no "off" of all lamps has succeeded since */
    struct lamp *lamps;
};

static void lamps_pending_free(struct pending *pending) {
    clock_cancel(pending->bank->device.clock, &pending->deadline);
    g_free(pending);
}

static void lamps_free(LampBank *bank) {
    struct pending *pending;
    while ((pending = g_queue_pop_head(&bank->state->pending)))
        lamps_pending_free(pending);
    device_clear(&bank->device);
    g_free(bank->state->lamps);
    g_free(bank->state);
    g_free(bank);
}

LampBank *lamps_open(const struct lamps_driver *driver, const struct config_section *section,
                     const char *const *also, Clock *clock, GError **error) {
    LampBank *bank = g_new0(LampBank, 1);
    bank->driver = driver;
    bank->state = g_new0(struct lamps_state, 1);
    if (!device_init(&bank->device, &driver->info, section, also, clock, error) ||
        !driver->open(bank, error)) {
        lamps_free(bank);
        return NULL;
    }
    if (bank->n < 1 || bank->n > MAX_LAMPS || !isfinite(bank->warm_up_s) || bank->warm_up_s < 0) {
        device_error_set(error, DEVICE_ERROR_RANGE, bank->device.who,
                         "%d lamps with a warm-up of %g s are out of range" ERROR_ADVICE
                         "give 1 to " G_STRINGIFY(MAX_LAMPS) " lamps and a warm-up of 0 s or more",
                         bank->n, bank->warm_up_s);
        lamps_close(bank);
        return NULL;
    }
    bank->state->lamps = g_new0(struct lamp, bank->n);
    return bank;
}

void lamps_close(LampBank *bank) {
    if (!bank)
        return;
    bank->state->func = NULL;
    bank->driver->close(bank);
    lamps_free(bank);
}

void lamps_listen(LampBank *bank, LampsFunc func, gpointer data) {
    bank->state->func = func;
    bank->state->data = data;
}

/* Call it last: the listener may close the bank. */
static void lamps_notify(LampBank *bank, int index, gboolean on, gint64 at_us,
                         const GError *error) {
    if (bank->state->func)
        bank->state->func(bank, index, on, at_us, error, bank->state->data);
}

static void lamps_on_deadline(gpointer data) {
    struct pending *pending = data;
    LampBank *bank = pending->bank;
    int index = pending->index;
    gboolean on = pending->on;
    g_autofree char *what = index < 0 ? g_strdup("all lamps") : g_strdup_printf("lamp %d", index);
    g_autoptr(GError) error = device_error_new(
        DEVICE_ERROR_TIMEOUT, bank->device.who,
        "%s did not answer to \"%s\" within %d s" ERROR_ADVICE "check its cable and power", what,
        on ? "on" : "off", (int)(DEADLINE_US / G_USEC_PER_SEC));
    pending->deadline = 0;
    bank->state->doubt |= !on;
    g_queue_remove(&bank->state->pending, pending);
    lamps_pending_free(pending);
    lamps_notify(bank, index, on, clock_now_us(bank->device.clock), error);
}

static gboolean lamps_start(LampBank *bank, int index, gboolean on, GError **error) {
    struct pending *pending = g_new0(struct pending, 1);
    pending->bank = bank;
    pending->index = index;
    pending->on = on;
    g_queue_push_tail(&bank->state->pending, pending);
    if (!bank->driver->set(bank, index, on, error)) {
        g_queue_remove(&bank->state->pending, pending);
        lamps_pending_free(pending);
        bank->state->doubt |= !on;
        return FALSE;
    }
    pending->deadline = clock_call_in(bank->device.clock, DEADLINE_US, lamps_on_deadline, pending);
    return TRUE;
}

gboolean lamps_set(LampBank *bank, int index, gboolean on, GError **error) {
    if (index < 0 || index >= bank->n)
        return device_error_set(error, DEVICE_ERROR_RANGE, bank->device.who,
                                "there is no lamp %d; it has 0 to %d", index, bank->n - 1);
    return lamps_start(bank, index, on != FALSE, error);
}

gboolean lamps_all_off(LampBank *bank, GError **error) {
    return lamps_start(bank, -1, FALSE, error);
}

gboolean lamps_is_on(const LampBank *bank, int index) {
    g_return_val_if_fail(index >= 0 && index < bank->n, FALSE);
    return bank->state->lamps[index].on;
}

enum device_safety lamps_safety(const LampBank *bank) {
    const struct lamps_state *state = bank->state;
    gboolean lit = FALSE;
    for (int i = 0; i < bank->n; i++)
        lit |= state->lamps[i].on;
    if (!g_queue_is_empty((GQueue *)&state->pending))
        return DEVICE_TOLD;
    return lit || state->doubt ? DEVICE_UNSAFE : DEVICE_SAFE;
}

gint64 lamps_on_since_us(const LampBank *bank, int index) {
    g_return_val_if_fail(index >= 0 && index < bank->n, -1);
    const struct lamp *lamp = &bank->state->lamps[index];
    return lamp->on ? lamp->since_us : -1;
}

double lamps_hours(const LampBank *bank, int index) {
    g_return_val_if_fail(index >= 0 && index < bank->n, 0);
    const struct lamp *lamp = &bank->state->lamps[index];
    gint64 us = lamp->burnt_us;
    if (lamp->on)
        us += clock_now_us(bank->device.clock) - lamp->since_us;
    return (double)us / (3600.0 * G_USEC_PER_SEC);
}

static void lamps_switched(LampBank *bank, int index, gboolean on, gint64 now) {
    for (int i = 0; i < bank->n; i++) {
        struct lamp *lamp = &bank->state->lamps[i];
        if (index >= 0 && index != i)
            continue;
        if (lamp->on && !on)
            lamp->burnt_us += now - lamp->since_us;
        if (!lamp->on && on)
            lamp->since_us = now;
        lamp->on = on;
    }
}

void lamps_report(LampBank *bank, int index, gboolean on, GError *error) {
    g_autoptr(GError) owned = error;
    struct pending *pending = g_queue_peek_head(&bank->state->pending);
    gint64 now = clock_now_us(bank->device.clock);
    on = on != FALSE;
    if (!pending || pending->index != index || pending->on != on) {
        /* The late answer to a set() that has timed out; if it reports light, believe it. */
        if (!owned && on)
            lamps_switched(bank, index, TRUE, now);
        return;
    }
    g_queue_pop_head(&bank->state->pending);
    lamps_pending_free(pending);
    if (!on && (owned || index < 0))
        bank->state->doubt = owned != NULL;
    if (!owned)
        lamps_switched(bank, index, on, now);
    lamps_notify(bank, index, on, now, owned);
}

void lamps_lost(LampBank *bank, GError *error) {
    g_autoptr(GError) owned = error;
    g_autoptr(GError) unsent = NULL;
    if (!lamps_start(bank, -1, FALSE, &unsent))
        g_warning("%s", unsent->message);
    lamps_notify(bank, -1, TRUE, clock_now_us(bank->device.clock), owned);
}
