/* What every lamp bank must do, on a virtual WLED controller. */
#include "conformance/conformance.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "network/devices.h"
#include "virtual/dmx_node.h"
#include "virtual/wled.h"

static VirtualWled *model;
static struct conformance tested;

static void fail(gpointer wled, enum conformance_fault fault) {
    const struct virtual_wled_faults faults = {.silent = fault == CONFORMANCE_UNANSWERED,
                                               .cut = fault == CONFORMANCE_CUT};
    virtual_wled_fail(wled, &faults);
}

BEFORE_TESTS {
    model = ok(virtual_wled_new(virtual_dmx_address(1), 100, ERR));
    tested =
        (struct conformance){.name = "wled", .real_clock = TRUE, .fail = fail, .fail_data = model};
    tested.section = g_strdup_printf("[lamps test]\ndriver = wled-lamps\naddress = %s\n"
                                     "http_port = %d\nlocal_address = %s\nn = 8\nleds = 12\n",
                                     virtual_dmx_address(1), virtual_wled_http_port(model),
                                     virtual_dmx_address(0));
    conformance_lamps(&wled_lamps_driver, &tested);
}

AFTER_TESTS {
    struct virtual_wled_state state;
    virtual_wled_state(model, &state);
    g_assert_cmpint(state.n_damaged, ==, 0);
    virtual_wled_free(model);
    g_free((gpointer)tested.section);
}
