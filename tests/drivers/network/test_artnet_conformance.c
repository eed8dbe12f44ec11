/* What every lamp bank must do, on virtual Art-Net nodes. */
#include "conformance/conformance.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "network/devices.h"
#include "virtual/dmx_node.h"

static const struct {
    const char *name, *keys;
    struct virtual_dmx_options options;
} nodes[] = {
    {"plain", "n = 6\nuniverse = 1\n", {.universe = 1, .n = 1}},
    {"16-bits",
     "n = 5\nuniverse = 0\nbits = 16\nlevels = 1;256;65535;300;4000\nstart = 509\n"
     "other_values = 7\n",
     {.universe = 0, .n = 2}},
    {"40-lamps",
     "n = 40\nuniverse = 0x7ffc\nchannels = 50\n",
     {.universe = 32764, .n = 4, .page_each = TRUE}},
};

static VirtualDmx *models[G_N_ELEMENTS(nodes)];
static struct conformance tested[G_N_ELEMENTS(nodes)];

static void fail(gpointer node, enum conformance_fault fault) {
    const struct virtual_dmx_faults faults = {.silent = fault == CONFORMANCE_UNANSWERED,
                                              .cut = fault == CONFORMANCE_CUT};
    virtual_dmx_fail(node, &faults);
}

BEFORE_TESTS {
    for (gsize i = 0; i < G_N_ELEMENTS(nodes); i++) {
        struct virtual_dmx_options options = nodes[i].options;
        options.address = virtual_dmx_address(1 + (int)i);
        models[i] = ok(virtual_dmx_new(&options, ERR));
        tested[i] = (struct conformance){
            .name = nodes[i].name, .real_clock = TRUE, .fail = fail, .fail_data = models[i]};
        tested[i].section = g_strdup_printf("[lamps test]\ndriver = artnet-lamps\naddress = %s\n"
                                            "local_address = %s\n%s",
                                            options.address, virtual_dmx_address(0), nodes[i].keys);
        conformance_lamps(&artnet_lamps_driver, &tested[i]);
    }
}

AFTER_TESTS {
    for (gsize i = 0; i < G_N_ELEMENTS(nodes); i++) {
        struct virtual_dmx_state state;
        virtual_dmx_state(models[i], &state);
        g_assert_false(state.lit);
        g_assert_cmpint(state.n_damaged, ==, 0);
        g_assert_cmpint(state.n_foreign, ==, 0);
        virtual_dmx_free(models[i]);
        g_free((gpointer)tested[i].section);
    }
}
