/* What every lamp bank must do, on virtual receivers of sACN. */
#include "conformance/conformance.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "network/devices.h"
#include "virtual/dmx_node.h"

static const struct {
    const char *name, *keys;
    struct virtual_dmx_options options;
} nodes[] = {
    {"plain", "n = 6\nuniverse = 1\n", {.sacn = TRUE, .universe = 1, .n = 1}},
    {"16-bits",
     "n = 300\nuniverse = 63998\nbits = 16\nlevels = 300\n",
     {.sacn = TRUE, .universe = 63998, .n = 2}},
};

static VirtualDmx *models[G_N_ELEMENTS(nodes)];
static struct conformance tested[G_N_ELEMENTS(nodes)];

/* A receiver never answers. What the driver can notice is that nothing listens. */
static void fail(gpointer node, enum conformance_fault fault) {
    const struct virtual_dmx_faults faults = {.unplugged = fault != CONFORMANCE_WELL};
    virtual_dmx_fail(node, &faults);
}

BEFORE_TESTS {
    for (gsize i = 0; i < G_N_ELEMENTS(nodes); i++) {
        struct virtual_dmx_options options = nodes[i].options;
        options.address = virtual_dmx_address(1 + (int)i);
        models[i] = ok(virtual_dmx_new(&options, ERR));
        tested[i] = (struct conformance){
            .name = nodes[i].name, .real_clock = TRUE, .fail = fail, .fail_data = models[i]};
        tested[i].section = g_strdup_printf("[lamps test]\ndriver = sacn-lamps\naddress = %s\n"
                                            "local_address = %s\n%s",
                                            options.address, virtual_dmx_address(0), nodes[i].keys);
        conformance_lamps(&sacn_lamps_driver, &tested[i]);
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
