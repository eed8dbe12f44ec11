/* What every axis must do, on virtual boards with each language. */
#include "conformance/conformance.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "serial/devices.h"
#include "virtual/gcode.h"

#include <string.h>

#define FAST "speed_deg_s = 400\naccel_deg_s2 = 4000\n"
/* Klipper brakes up to 1.5 s after the stop, so the moves must be longer. */
#define SLOW "speed_deg_s = 24\naccel_deg_s2 = 400\n"

static const struct board {
    const char *name, *keys;
    struct virtual_gcode_options options;
} boards[] = {
    {"grbl", FAST, {0}},
    {"fluidnc",
     FAST "homing = axis\nletter = A\nunits_per_deg = -0.5\n",
     {.n_axes = 6, .single_homing = TRUE, .work_positions = TRUE}},
    {"marlin",
     FAST "dialect = marlin\nletter = Y\nhoming = axis\n",
     {.language = VIRTUAL_MARLIN, .emergency_parser = TRUE, .resets_on_open = TRUE, .boot_ms = 50}},
    {"marlin-simple",
     FAST "dialect = marlin\nhoming = here\nbacklash_deg = 0.2\n",
     {.language = VIRTUAL_MARLIN, .resets_on_open = TRUE}},
    {"klipper",
     SLOW "dialect = klipper\nletter = Y\nhoming = axis\n",
     {.language = VIRTUAL_KLIPPER, .boot_ms = 200}},
    {"klipper-here",
     SLOW "dialect = klipper\nhoming = here\nbacklash_deg = 0.2\n",
     {.language = VIRTUAL_KLIPPER, .boot_ms = 200}},
};

static VirtualGcode *models[G_N_ELEMENTS(boards)];
static struct conformance tested[G_N_ELEMENTS(boards)];

static void fail(gpointer board, enum conformance_fault fault) {
    const struct virtual_gcode_faults faults = {.silent = fault == CONFORMANCE_UNANSWERED,
                                                .cut = fault == CONFORMANCE_CUT};
    virtual_gcode_fail(board, &faults);
}

BEFORE_TESTS {
    for (gsize i = 0; i < G_N_ELEMENTS(boards); i++) {
        struct virtual_gcode_options options = boards[i].options;
        options.n_axes = MAX(options.n_axes, 3);
        options.units_s = 500;
        options.units_s2 = 5000;
        options.steps = 1000;
        options.home_at = 1;
        models[i] = ok(virtual_gcode_new(&options, ERR));
        tested[i] = (struct conformance){
            .name = boards[i].name, .real_clock = TRUE, .fail = fail, .fail_data = models[i]};
        tested[i].section = g_strdup_printf(
            "[axis test]\ndriver = gcode-axis\nport = %s\nanswer_ms = 1500\nboot_ms = 2500\n"
            "min_deg = -90\nmax_deg = 90\npoll_ms = 5\n"
            "%s%s",
            virtual_gcode_port(models[i]),
            strstr(boards[i].keys, "units_per_deg") ? "" : "units_per_deg = 1\n", boards[i].keys);
        conformance_axis(&gcode_axis_driver, &tested[i]);
    }
}

AFTER_TESTS {
    for (gsize i = 0; i < G_N_ELEMENTS(boards); i++) {
        struct virtual_gcode_state state;
        virtual_gcode_state(models[i], &state);
        g_assert_cmpint(state.max_unanswered, <=, 127);
        g_assert_cmpint(state.n_overflows, ==, 0);
        g_assert_false(state.moving);
        virtual_gcode_free(models[i]);
        g_free((gpointer)tested[i].section);
    }
}
