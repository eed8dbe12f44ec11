/* The driver sacn-lamps: its packets, and a receiver that fails. The outputs of the model are the
 * truth. */
#include "conformance/conformance.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "lib/text_file.h"
#include "lib/wait.h"
#include "network/devices.h"
#include "network/sacn_packet.h"
#include "virtual/dmx_node.h"

#include <string.h>

/* E1.31-2018 table 4-1: the E1.31 data packet. */
TEST(packet) {
    struct sacn_source source = {.name = "Source Name", .priority = 0x64};
    guint8 levels[512] = {[0] = 0x11, [511] = 0x99}, packet[SACN_SIZE], wanted[638] = {0};
    for (int i = 0; i < 16; i++)
        source.cid[i] = (guint8)(0xa0 + i);
    sacn_data(&source, 0x1234, 0x56, FALSE, levels, packet);
    static const guint8 root[] = {0x00, 0x10, 0x00, 0x00, 0x41, 0x53, 0x43, 0x2d, 0x45, 0x31, 0x2e,
                                  0x31, 0x37, 0x00, 0x00, 0x00, 0x72, 0x6e, 0x00, 0x00, 0x00, 0x04};
    static const guint8 framing[] = {0x72, 0x58, 0x00, 0x00, 0x00, 0x02};
    static const guint8 tail[] = {0x64, 0x00, 0x00, 0x56, 0x00, 0x12, 0x34, 0x72, 0x0b, 0x02,
                                  0xa1, 0x00, 0x00, 0x00, 0x01, 0x02, 0x01, 0x00, 0x11};
    memcpy(wanted, root, sizeof root);
    memcpy(wanted + 22, source.cid, 16);
    memcpy(wanted + 38, framing, sizeof framing);
    memcpy(wanted + 44, "Source Name", 12);
    memcpy(wanted + 108, tail, sizeof tail);
    wanted[637] = 0x99;
    g_assert_cmpmem(packet, sizeof packet, wanted, sizeof wanted);
    sacn_data(&source, 0x1234, 0x56, TRUE, levels, packet);
    wanted[112] = 0x40;
    g_assert_cmpmem(packet, sizeof packet, wanted, sizeof wanted);
    g_assert_cmphex(sacn_group(63999), ==, 0xeffff9ff);
}

struct bench {
    VirtualDmx *node;
    Clock *clock;
    LampBank *bank;
    int n_events, n_lost;
    GError *error; /* of the first event that failed */
};

static void on_lamp(LampBank *bank, int index, gboolean on, gint64 at_us, const GError *error,
                    gpointer data) {
    struct bench *bench = data;
    bench->n_events++;
    bench->n_lost += index < 0 && on;
    if (error && !bench->error)
        bench->error = g_error_copy(error);
}

static LampBank *open_bank(Clock *clock, const char *keys, GError **error) {
    const struct config_section *section;
    g_autofree char *text = g_strdup_printf(
        "[lamps test]\ndriver = sacn-lamps\nlocal_address = %s\n%s", virtual_dmx_address(0), keys);
    const struct conformance with = {.section = text};
    g_autoptr(Config) config = conformance_config(&with, "", &section);
    return lamps_open(&sacn_lamps_driver, section, NULL, clock, error);
}

static char *unicast(const char *keys) {
    return g_strdup_printf("address = %s\n%s", virtual_dmx_address(1), keys);
}

static void begin(struct bench *bench, gboolean multicast, int universe, const char *keys) {
    const struct virtual_dmx_options options = {.sacn = TRUE,
                                                .address = virtual_dmx_address(multicast ? 0 : 1),
                                                .universe = universe,
                                                .n = 2,
                                                .multicast = multicast};
    g_autofree char *all = multicast ? g_strdup(keys) : unicast(keys);
    *bench = (struct bench){.node = ok(virtual_dmx_new(&options, ERR)), .clock = clock_new_real()};
    bench->bank = ok(open_bank(bench->clock, all, ERR));
    lamps_listen(bench->bank, on_lamp, bench);
}

static struct virtual_dmx_state state_of(const struct bench *bench) {
    struct virtual_dmx_state state;
    virtual_dmx_state(bench->node, &state);
    return state;
}

static void end(struct bench *bench) {
    lamps_close(bench->bank);
    UNTIL (state_of(bench).n_terminated > 0)
        g_usleep(1000);
    g_assert_false(state_of(bench).lit);
    g_assert_cmpint(state_of(bench).n_damaged, ==, 0);
    virtual_dmx_free(bench->node);
    clock_unref(bench->clock);
    g_clear_error(&bench->error);
}

#define FAIL(bench, ...)                                                                           \
    virtual_dmx_fail((bench)->node, &(const struct virtual_dmx_faults){__VA_ARGS__})

static void set_lamp(struct bench *bench, int index, gboolean on) {
    bench->n_events = 0;
    lamps_set(bench->bank, index, on, NULL);
    conformance_wait(bench->clock, &bench->n_events, 1, 10);
}

static void light(struct bench *bench, int index) {
    set_lamp(bench, index, TRUE);
    g_assert_no_error(bench->error);
    g_assert_true(state_of(bench).lit);
}

TEST(channels) {
    struct bench bench;
    guint8 wanted[VIRTUAL_DMX_UNIVERSES][512] = {0};
    begin(&bench, FALSE, 7, "universe = 7\nn = 300\nbits = 16\nlevels = 513\npriority = 120\n");
    light(&bench, 255);
    light(&bench, 256);
    wanted[0][510] = wanted[1][0] = 2;
    wanted[0][511] = wanted[1][1] = 1;
    const struct virtual_dmx_state state = state_of(&bench);
    g_assert_cmpmem(state.levels, sizeof state.levels, wanted, sizeof wanted);
    g_assert_cmpint(state.priority, ==, 120);
    g_assert_cmpfloat(bench.bank->watchdog_s, ==, 2.5);
    end(&bench);
}

/* The stream goes on while nothing changes: a lamp stays lit for longer than the loss of data
 * takes, and each packet has a new sequence number. */
TEST(stays_lit) {
    struct bench bench;
    begin(&bench, FALSE, 1, "n = 4\n");
    light(&bench, 3);
    const int before = state_of(&bench).n_levels;
    conformance_pass(bench.clock, 6);
    const struct virtual_dmx_state state = state_of(&bench);
    g_assert_true(state.lit);
    g_assert_cmpint(state.n_lost + state.n_old, ==, 0);
    g_assert_cmpint(state.n_levels - before, >=, 5);
    g_assert_cmpint(state.n_levels - before, <=, 10);
    g_assert_cmpint(bench.n_lost, ==, 0);
    end(&bench);
}

TEST(multicast) {
    struct bench bench;
    begin(&bench, TRUE, 60000, "universe = 60000\nn = 4\n");
    light(&bench, 3);
    g_assert_cmpint(state_of(&bench).levels[0][3], ==, 255);
    set_lamp(&bench, 3, FALSE);
    g_assert_false(state_of(&bench).lit);
    end(&bench);
}

TEST(lossy) {
    struct bench bench;
    begin(&bench, FALSE, 1, "n = 4\n");
    FAIL(&bench, .lose = 3);
    for (int i = 0; i < 20; i++) {
        light(&bench, i % 4);
        set_lamp(&bench, i % 4, FALSE);
        g_assert_no_error(bench.error);
        g_assert_false(state_of(&bench).lit);
    }
    end(&bench);
}

/* A new program takes over the stream of a dead one, whatever the last sequence number was: its
 * "off" arrives before the receiver notices the loss of data. */
TEST(takes_over) {
    struct bench bench;
    begin(&bench, FALSE, 1, "n = 4\n");
    for (int k = 0; k < 12; k++) {
        light(&bench, k % 4);
        FAIL(&bench, .cut = TRUE); /* "off" and the end of the stream do not arrive */
        lamps_close(g_steal_pointer(&bench.bank));
        g_assert_true(state_of(&bench).lit);
        FAIL(&bench, .cut = FALSE);
        g_autofree char *keys = unicast("n = 4\n");
        bench.bank = ok(open_bank(bench.clock, keys, ERR));
        lamps_listen(bench.bank, on_lamp, &bench);
        g_assert_false(state_of(&bench).lit);
        g_assert_cmpint(state_of(&bench).n_lost, ==, 0);
        for (int i = 0; i < k; i++) /* another sequence number for the next time */
            conformance_pass(bench.clock, 0.01);
    }
    end(&bench);
}

TEST(unplugged_while_lit) {
    struct bench bench;
    begin(&bench, FALSE, 1, "n = 4\n");
    light(&bench, 2);
    FAIL(&bench, .unplugged = TRUE);
    conformance_wait(bench.clock, &bench.n_lost, 1, 10);
    conformance_expect_error(&bench.error, DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED,
                             "does not receive sACN: its UDP port 5568 is closed; check address, "
                             "and set the device to sACN");
    g_assert_cmpint(lamps_light(bench.bank, 2), ==, LIGHT_UNSAFE);
    FAIL(&bench, .unplugged = FALSE);
    UNTIL (lamps_safety(bench.bank) == DEVICE_SAFE)
        conformance_pass(bench.clock, 0.01);
    g_assert_false(state_of(&bench).lit);
    g_clear_error(&bench.error);
    light(&bench, 1);
    end(&bench);
}

/* The section to copy, with the address of the model. */
TEST(preset) {
    const struct virtual_dmx_options options = {
        .sacn = TRUE, .address = virtual_dmx_address(1), .universe = 1, .n = 1};
    g_autofree char *text = text_file_read(SOURCE_DIR "/etc/devices/sacn.conf");
    g_autoptr(GString) changed = g_string_new(text);
    g_autoptr(VirtualDmx) node = ok(virtual_dmx_new(&options, ERR));
    g_autoptr(Clock) clock = clock_new_real();
    const struct config_section *section;
    g_string_replace(changed, "10.0.0.7", virtual_dmx_address(1), 0);
    const struct conformance with = {.section = changed->str};
    g_autoptr(Config) config = conformance_config(&with, "", &section);
    g_autoptr(LampBank) bank = ok(lamps_open(&sacn_lamps_driver, section, NULL, clock, ERR));
    g_assert_cmpint(bank->n, ==, 8);
}

TEST(cannot_be_opened) {
    static const struct {
        const char *keys, *words;
    } cases[] = {
        {"n = 4\nuniverse = 0\n", "universe: 0 is out of range: 1 to 63999"},
        {"n = 600\nuniverse = 63999\n", "universe: 600 lamps need 2 universes"},
        {"n = 4\naddress = 239.255.0.1\n", "for multicast leave the key out"},
        {"n = 4\naddress = lamp\n", "is not the IPv4 address of a receiver"},
    };
    g_autoptr(Clock) clock = clock_new_real();
    GError *error = NULL;
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        g_assert_null(open_bank(clock, cases[i].keys, &error));
        conformance_expect_error(&error, CONFIG_ERROR, CONFIG_ERROR_VALUE, cases[i].words);
    }
    g_autofree char *keys = unicast("n = 4\n");
    g_assert_null(open_bank(clock, keys, &error));
    conformance_expect_error(&error, DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED,
                             "does not receive sACN");
}
