/* What every lamp bank must do, on virtual LED controllers. */
#include "conformance/conformance.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "serial/devices.h"
#include "virtual/leds.h"

static const struct {
    const char *name, *keys;
    struct virtual_leds_options options;
} boards[] = {
    {"plain", "", {.n = 6, .dark_ms = 2000}},
    {"arduino",
     "levels = 10;20;30;40\n",
     {.n = 4, .dark_ms = 2000, .boot_ms = 50, .resets_on_open = TRUE}},
    {"one-lamp", "levels = 1\n", {.n = 1, .dark_ms = 1000}},
    {"64-lamps", "", {.n = 64, .dark_ms = 2000}},
};

static VirtualLeds *models[G_N_ELEMENTS(boards)];
static struct conformance tested[G_N_ELEMENTS(boards)];

static void fail(gpointer leds, enum conformance_fault fault) {
    const struct virtual_leds_faults faults = {.silent = fault == CONFORMANCE_UNANSWERED,
                                               .cut = fault == CONFORMANCE_CUT};
    virtual_leds_fail(leds, &faults);
}

BEFORE_TESTS {
    for (gsize i = 0; i < G_N_ELEMENTS(boards); i++) {
        models[i] = ok(virtual_leds_new(&boards[i].options, ERR));
        tested[i] = (struct conformance){
            .name = boards[i].name, .real_clock = TRUE, .fail = fail, .fail_data = models[i]};
        tested[i].section = g_strdup_printf("[lamps test]\ndriver = serial-lamps\nport = %s\n%s",
                                            virtual_leds_port(models[i]), boards[i].keys);
        conformance_lamps(&serial_lamps_driver, &tested[i]);
    }
}

AFTER_TESTS {
    for (gsize i = 0; i < G_N_ELEMENTS(boards); i++) {
        struct virtual_leds_state state;
        virtual_leds_state(models[i], &state);
        g_assert_false(state.lit);
        g_assert_cmpint(state.n_damaged, ==, 0);
        g_assert_cmpint(state.n_refused, ==, 0);
        virtual_leds_free(models[i]);
        g_free((gpointer)tested[i].section);
    }
}
