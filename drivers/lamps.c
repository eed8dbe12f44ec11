#include "lamps.h"

#include "lights.h"
#include "recording.h"

#include <math.h>

#define MAX_LAMPS 1024

struct lamps_state {
    LampsFunc func;
    gpointer data;
    struct lights *lights; /* NULL before the bank is open */
};

static void lamps_free(LampBank *bank) {
    lights_free(bank->state->lights);
    device_clear(&bank->device);
    g_free(bank->state);
    g_free(bank);
}

static gboolean lamps_send(gpointer device, int index, gboolean on, GError **error) {
    LampBank *bank = device;
    return bank->driver->set(bank, index, on, error);
}

static void record(const LampBank *bank, int index, gboolean on, const GError *error) {
    if (!recording_is_on())
        return;
    g_autofree char *lamp = index < 0 ? g_strdup("lamps") : g_strdup_printf("lamp %d", index);
    if (error)
        recording_device(bank->device.who, "= fault: %s %s: %s", lamp, on ? "on" : "off",
                         error->message);
    else
        recording_device(bank->device.who, "= %s %s", lamp, on ? "on" : "off");
}

/* Tells the listener the answer to a command. Call it last, because the listener may close the
 * bank. */
static void answer(gpointer device, int index, gboolean on, gint64 at_us, const GError *error) {
    LampBank *bank = device;
    record(bank, index, on, error);
    if (bank->state->func)
        bank->state->func(bank, index, on, at_us, error, bank->state->data);
}

LampBank *lamps_open(const struct lamps_driver *driver, const struct config_section *section,
                     const char *const *also, Clock *clock, GError **error) {
    LampBank *bank = g_new0(LampBank, 1);
    bank->driver = driver;
    bank->state = g_new0(struct lamps_state, 1);
    if (!device_init(&bank->device, &driver->info, section, also, clock, error) ||
        !device_record_opened(&bank->device, driver->open(bank, error), error)) {
        lamps_free(bank);
        return NULL;
    }
    const gboolean n_fits = bank->n >= 1 && bank->n <= MAX_LAMPS;
    if (!n_fits)
        device_error_set(error, DEVICE_ERROR_RANGE, bank->device.who,
                         "its driver reports %d lamps" ERROR_ADVICE
                         "set the number of lamps in its section to 1 to " G_STRINGIFY(MAX_LAMPS),
                         bank->n);
    else if (!isfinite(bank->warm_up_s) || bank->warm_up_s < 0)
        device_error_set(error, DEVICE_ERROR_RANGE, bank->device.who,
                         "its driver reports a warm-up time of %g s" ERROR_ADVICE
                         "set warm_up_s or warm_up_ms in its section to 0 or more, or remove it",
                         bank->warm_up_s);
    if (!n_fits || !isfinite(bank->warm_up_s) || bank->warm_up_s < 0) {
        lamps_close(bank);
        return NULL;
    }
    bank->state->lights = lights_new(bank, bank->n, TRUE, lamps_send, answer);
    return bank;
}

void lamps_close(LampBank *bank) {
    if (!bank)
        return;
    bank->state->func = NULL;
    recording_device(bank->device.who, "close");
    bank->driver->close(bank);
    lamps_free(bank);
}

void lamps_listen(LampBank *bank, LampsFunc func, gpointer data) {
    bank->state->func = func;
    bank->state->data = data;
}

gboolean lamps_set(LampBank *bank, int index, gboolean on, GError **error) {
    if (index < 0 || index >= bank->n)
        return device_error_set(error, DEVICE_ERROR_RANGE, bank->device.who,
                                "there is no lamp %d: the bank has the lamps 0 to %d", index,
                                bank->n - 1);
    if (on && !device_ask_permit(&bank->device, error))
        return FALSE;
    recording_device(bank->device.who, "lamp %d %s", index, on ? "on" : "off");
    return lights_set(bank->state->lights, index, on != FALSE, error);
}

gboolean lamps_all_off(LampBank *bank, GError **error) {
    recording_device(bank->device.who, "lamps off");
    return lights_set(bank->state->lights, -1, FALSE, error);
}

enum light lamps_light(const LampBank *bank, int index) {
    g_return_val_if_fail(index >= 0 && index < bank->n, LIGHT_UNSAFE);
    return lights_light(bank->state->lights, index);
}

gboolean lamps_is_on(const LampBank *bank, int index) {
    return lamps_light(bank, index) != LIGHT_OFF;
}

enum device_safety lamps_safety(const LampBank *bank) {
    return lights_safety(bank->state->lights);
}

void lamps_report(LampBank *bank, int index, gboolean on, GError *error) {
    g_autoptr(GError) owned = error;
    lights_report(bank->state->lights, index, on != FALSE, owned);
}

void lamps_lost(LampBank *bank, GError *error) {
    g_autoptr(GError) owned = error;
    lights_lost(bank->state->lights, owned);
    answer(bank, -1, TRUE, clock_now_us(bank->device.clock), owned);
}
