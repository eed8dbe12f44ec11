/* The driver artnet-lamps: its packets, and a node that fails. The outputs of the model are the
 * truth. */
#include "conformance/conformance.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "lib/text_file.h"
#include "lib/wait.h"
#include "network/artnet_packet.h"
#include "network/devices.h"
#include "virtual/dmx_node.h"

#include <string.h>

#define N_LAMPS 4

struct bench {
    VirtualDmx *node;
    Clock *clock;
    LampBank *bank;
    int n_events, n_failed, n_lost;
    GError *error; /* of the first event that failed */
};

/* Art-Net 4, table of ArtDmx: ID, OpCode (low byte first), ProtVer, Sequence, Physical, SubUni,
 * Net, Length (high byte first), data. */
TEST(levels_packet) {
    guint8 levels[512] = {[0] = 0x11, [511] = 0x99};
    guint8 packet[ARTNET_DMX_SIZE];
    static const guint8 head[] = {'A',  'r', 't', '-', 'N', 'e',  't',  0,    0x00,
                                  0x50, 0,   14,  0,   0,   0x34, 0x12, 0x02, 0x00};
    artnet_dmx(0x1234, levels, packet);
    g_assert_cmpint(sizeof packet, ==, 530);
    g_assert_cmpmem(packet, sizeof head, head, sizeof head);
    g_assert_cmpmem(packet + 18, 512, levels, 512);
}

TEST(poll_packet) {
    guint8 packet[ARTNET_POLL_SIZE];
    static const guint8 wanted[] = {'A', 'r', 't', '-', 'N', 'e', 't', 0, 0x00, 0x20, 0, 14, 0, 0};
    artnet_poll(packet);
    g_assert_cmpmem(packet, sizeof packet, wanted, sizeof wanted);
}

TEST(reply_packet) {
    guint8 bytes[239] = "Art-Net";
    struct artnet_reply reply;
    bytes[9] = 0x21;
    bytes[18] = 0x12;
    bytes[19] = 0x03;
    strcpy((char *)bytes + 26, "short");
    strcpy((char *)bytes + 44, "long\x01name");
    bytes[173] = 4;
    memcpy(bytes + 174, (const guint8[]){0x80, 0x40, 0xc0, 0x80}, 4); /* the second only takes */
    memcpy(bytes + 182, (const guint8[]){0x80, 0x81, 0x88, 0x84}, 4);
    memcpy(bytes + 190, (const guint8[]){0x0a, 0x0b, 0x0c, 0x0d}, 4);
    bytes[211] = 3;
    g_assert_true(artnet_reply_read(bytes, sizeof bytes, &reply));
    g_assert_cmpstr(reply.name, ==, "long?name");
    g_assert_cmpint(reply.page, ==, 3);
    g_assert_cmpint(reply.n, ==, 3);
    g_assert_cmpint(reply.outputs[0].universe, ==, 0x123a);
    g_assert_cmpint(reply.outputs[1].universe, ==, 0x123c);
    g_assert_cmpint(reply.outputs[1].state, ==, 0x88);
    g_assert_cmpint(reply.outputs[2].universe, ==, 0x123d);
    bytes[44] = 0;
    g_assert_true(artnet_reply_read(bytes, 207, &reply));
    g_assert_cmpstr(reply.name, ==, "short");
    g_assert_cmpint(reply.page, ==, 0);
    for (gsize n = 0; n < 207; n++) {
        g_autofree guint8 *cut = g_memdup2(bytes, n);
        g_assert_false(artnet_reply_read(cut, n, &reply));
    }
    bytes[9] = 0x20;
    g_assert_false(artnet_reply_read(bytes, sizeof bytes, &reply));
    bytes[9] = 0x21;
    bytes[6] = 'T';
    g_assert_false(artnet_reply_read(bytes, sizeof bytes, &reply));
    bytes[6] = 't';
    memset(bytes + 26, 'x', 213); /* names without an end, and too many ports */
    g_assert_true(artnet_reply_read(bytes, sizeof bytes, &reply));
    g_assert_cmpint(strlen(reply.name), ==, 63);
    g_assert_cmpint(reply.n, <=, ARTNET_PORTS);
}

static void on_lamp(LampBank *bank, int index, gboolean on, gint64 at_us, const GError *error,
                    gpointer data) {
    struct bench *bench = data;
    bench->n_events++;
    bench->n_failed += error != NULL;
    bench->n_lost += index < 0 && on;
    if (error && !bench->error)
        bench->error = g_error_copy(error);
}

static LampBank *open_bank(Clock *clock, const char *keys, GError **error) {
    const struct config_section *section;
    g_autofree char *text =
        g_strdup_printf("[lamps test]\ndriver = artnet-lamps\naddress = %s\nlocal_address = %s\n%s",
                        virtual_dmx_address(1), virtual_dmx_address(0), keys);
    const struct conformance with = {.section = text};
    g_autoptr(Config) config = conformance_config(&with, "", &section);
    return lamps_open(&artnet_lamps_driver, section, NULL, clock, error);
}

static VirtualDmx *node_new(void) {
    const struct virtual_dmx_options options = {
        .address = virtual_dmx_address(1), .universe = 1, .n = 2};
    return ok(virtual_dmx_new(&options, ERR));
}

static void begin(struct bench *bench, const char *keys) {
    *bench = (struct bench){.node = node_new(), .clock = clock_new_real()};
    bench->bank = ok(open_bank(bench->clock, keys, ERR));
    lamps_listen(bench->bank, on_lamp, bench);
}

static struct virtual_dmx_state state_of(const struct bench *bench) {
    struct virtual_dmx_state state;
    virtual_dmx_state(bench->node, &state);
    return state;
}

static void end(struct bench *bench) {
    lamps_close(bench->bank);
    g_assert_false(state_of(bench).lit);
    virtual_dmx_free(bench->node);
    clock_unref(bench->clock);
    g_clear_error(&bench->error);
}

#define FAIL(bench, ...)                                                                           \
    virtual_dmx_fail((bench)->node, &(const struct virtual_dmx_faults){__VA_ARGS__})

static void set_lamp(struct bench *bench, int index, gboolean on) {
    bench->n_events = bench->n_failed = 0;
    if (index < 0)
        lamps_all_off(bench->bank, NULL);
    else
        lamps_set(bench->bank, index, on, NULL);
    conformance_wait(bench->clock, &bench->n_events, 1, 10);
}

static void light(struct bench *bench, int index) {
    set_lamp(bench, index, TRUE);
    g_assert_no_error(bench->error);
    g_assert_cmpint(lamps_light(bench->bank, index), ==, LIGHT_ON);
    g_assert_true(state_of(bench).lit);
}

static void expect_lost(struct bench *bench, int code, const char *words) {
    conformance_wait(bench->clock, &bench->n_lost, 1, 10);
    conformance_expect_error(&bench->error, DEVICE_ERROR, code, words);
}

static void expect_recovery(struct bench *bench) {
    FAIL(bench, .cut = FALSE);
    UNTIL (lamps_safety(bench->bank) == DEVICE_SAFE)
        conformance_pass(bench->clock, 0.01);
    g_assert_false(state_of(bench).lit);
    g_clear_error(&bench->error);
    light(bench, 1);
    set_lamp(bench, 1, FALSE);
    g_assert_cmpint(bench->n_failed, ==, 0);
}

/* Nothing but the channels of the lamp changes. */
TEST(channels) {
    static const struct {
        const char *keys;
        int index, universe, channel, n; /* universe and channel count from 0 */
        guint8 values[4];
    } cases[] = {
        {"n = 4\n", 2, 0, 2, 1, {255}},
        {"n = 4\nlevels = 10;20;30;40\nstart = 100\n", 3, 0, 102, 1, {40}},
        {"n = 4\nchannels = 5\nother_values = 1;2;3\n", 1, 0, 5, 4, {255, 1, 2, 3}},
        {"n = 4\nbits = 16\nlevels = 258\n", 3, 0, 6, 2, {1, 2}},
        {"n = 4\nbits = 16\nstart = 510\nother_values = 9\n", 0, 0, 509, 3, {255, 255, 9}},
        {"n = 4\nbits = 16\nstart = 510\nother_values = 9\n", 2, 1, 3, 3, {255, 255, 9}},
        {"n = 340\nchannels = 3\nlevels = 7\n", 170, 1, 0, 1, {7}},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        struct bench bench;
        guint8 wanted[VIRTUAL_DMX_UNIVERSES][512] = {0};
        begin(&bench, cases[i].keys);
        light(&bench, cases[i].index);
        memcpy(&wanted[cases[i].universe][cases[i].channel], cases[i].values, (gsize)cases[i].n);
        const struct virtual_dmx_state state = state_of(&bench);
        g_assert_cmpmem(state.levels, sizeof state.levels, wanted, sizeof wanted);
        set_lamp(&bench, cases[i].index, FALSE);
        g_assert_false(state_of(&bench).lit);
        end(&bench);
    }
}

/* The levels are repeated while nothing changes, whether a lamp is lit or not. */
TEST(repeats) {
    struct bench bench;
    begin(&bench, "n = 4\n");
    for (int lit = 0; lit < 2; lit++) {
        if (lit)
            light(&bench, 1);
        const int before = state_of(&bench).n_levels;
        conformance_pass(bench.clock, 3);
        g_assert_cmpint(state_of(&bench).n_levels - before, >=, 2);
        g_assert_cmpint(state_of(&bench).n_levels - before, <=, 6);
    }
    g_assert_cmpint(bench.n_lost, ==, 0);
    g_assert_cmpint(state_of(&bench).n_damaged, ==, 0);
    end(&bench);
}

/* Many switches of one moment are one change of the levels. */
TEST(at_once) {
    struct bench bench;
    begin(&bench, "n = 60\n");
    conformance_pass(bench.clock, 0.1);
    const int before = state_of(&bench).n_levels;
    for (int i = 0; i < 60; i++)
        g_assert_true(lamps_set(bench.bank, i, TRUE, NULL));
    conformance_wait(bench.clock, &bench.n_events, 60, 10);
    g_assert_cmpint(bench.n_failed, ==, 0);
    g_assert_cmpint(state_of(&bench).n_levels - before, <=, 8);
    for (int i = 0; i < 60; i++)
        g_assert_cmpint(state_of(&bench).levels[0][i], ==, 255);
    end(&bench);
}

/* An answer that was under way when the cable was pulled does not confirm a later "off". */
TEST(late_answer) {
    struct bench bench;
    begin(&bench, "n = 4\n");
    light(&bench, 1);
    FAIL(&bench, .late_ms = 900);
    UNTIL (state_of(&bench).n_polls >= 2) /* the node is asked while the lamp is lit */
        conformance_pass(bench.clock, 0.01);
    const int polls = state_of(&bench).n_polls;
    UNTIL (state_of(&bench).n_polls > polls)
        conformance_pass(bench.clock, 0.01);
    FAIL(&bench, .cut = TRUE, .late_ms = 900);
    FAIL(&bench, .lose = 1); /* its answers leave, but nothing arrives */
    set_lamp(&bench, 1, FALSE);
    g_assert_cmpint(bench.n_failed, ==, 1);
    g_assert_cmpint(lamps_light(bench.bank, 1), ==, LIGHT_UNSAFE);
    g_assert_true(state_of(&bench).lit);
    conformance_expect_error(&bench.error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT,
                             "has not answered; check its power, its cable and address");
    expect_recovery(&bench);
    end(&bench);
}

TEST(lossy) {
    struct bench bench;
    begin(&bench, "n = 4\n");
    FAIL(&bench, .lose = 10, .lose_answers = 7, .garbage = TRUE);
    for (int i = 0; i < 20; i++) {
        set_lamp(&bench, i % 4, TRUE);
        g_assert_no_error(bench.error);
        g_assert_cmpint(state_of(&bench).levels[0][i % 4], ==, 255);
        set_lamp(&bench, i % 4, FALSE);
        g_assert_no_error(bench.error);
        g_assert_false(state_of(&bench).lit);
    }
    end(&bench);
}

TEST(slow_node) {
    struct bench bench;
    begin(&bench, "n = 4\n");
    FAIL(&bench, .late_ms = 900);
    for (int i = 0; i < 3; i++) {
        set_lamp(&bench, i, TRUE);
        set_lamp(&bench, i, FALSE);
    }
    g_assert_no_error(bench.error);
    end(&bench);
}

static void lost(struct virtual_dmx_faults faults, int code, const char *words) {
    struct bench bench;
    begin(&bench, "n = 4\n");
    light(&bench, 2);
    virtual_dmx_fail(bench.node, &faults);
    expect_lost(&bench, code, words);
    expect_recovery(&bench);
    end(&bench);
}

TEST(cut_while_lit) {
    lost((struct virtual_dmx_faults){.cut = TRUE}, DEVICE_ERROR_TIMEOUT, "has not answered");
}

TEST(silent_while_lit) {
    lost((struct virtual_dmx_faults){.silent = TRUE}, DEVICE_ERROR_TIMEOUT, "has not answered");
}

TEST(unplugged_while_lit) {
    lost((struct virtual_dmx_faults){.unplugged = TRUE}, DEVICE_ERROR_TIMEOUT, "has not answered");
}

TEST(another_universe) {
    lost((struct virtual_dmx_faults){.other = TRUE}, DEVICE_ERROR_TIMEOUT, "has not answered");
}

TEST(another_controller) {
    lost((struct virtual_dmx_faults){.state = 0x08}, DEVICE_ERROR_PROTOCOL,
         ": another controller also sends to it; end the other controller");
}

TEST(short_circuit) {
    lost((struct virtual_dmx_faults){.state = 0x04}, DEVICE_ERROR_PROTOCOL, "short circuit");
}

TEST(listens_to_sacn) {
    lost((struct virtual_dmx_faults){.state = 0x01}, DEVICE_ERROR_PROTOCOL, "sacn-lamps");
}

TEST(sends_nothing) {
    lost((struct virtual_dmx_faults){.state = 0x80}, DEVICE_ERROR_PROTOCOL,
         "does not send it to the lamps");
}

static void refused(const char *keys, GQuark domain, int code, const char *words) {
    g_autoptr(Clock) clock = clock_new_real();
    GError *error = NULL;
    g_assert_null(open_bank(clock, keys, &error));
    conformance_expect_error(&error, domain, code, words);
}

TEST(cannot_be_opened) {
    g_autoptr(VirtualDmx) node = node_new();
    struct virtual_dmx_state state;
    static const struct {
        const char *keys, *words;
    } cases[] = {
        {"n = 4\nbits = 12\n", "bits: 12 is neither 8 nor 16"},
        {"n = 4\nlevels = 1;2;3\n", "levels: has 3 numbers for 4 lamps"},
        {"n = 4\nlevels = 256\n", "levels: 256 is out of range: 1 to 255 with bits = 8"},
        {"n = 4\nbits = 16\nother_values = 1\nchannels = 2\n", "channels: 2 is too few"},
        {"n = 4\nstart = 512\nbits = 16\n", "start: lamp 0 does not fit"},
        {"n = 4\nuniverse = 32768\n", "universe: "},
        {"n = 600\nuniverse = 32767\n", "universe: 600 lamps need 2 universes"},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++)
        refused(cases[i].keys, CONFIG_ERROR, CONFIG_ERROR_VALUE, cases[i].words);
    virtual_dmx_state(node, &state);
    g_assert_cmpint(state.n_levels + state.n_polls, ==, 0);
    refused("n = 4\nuniverse = 18\n", DEVICE_ERROR, DEVICE_ERROR_PROTOCOL,
            "has no output with universe 18; set an output of the node to net 0, sub-net 1, "
            "universe 2, or change universe");
    virtual_dmx_fail(node, &(const struct virtual_dmx_faults){.cut = TRUE});
    refused("n = 4\n", DEVICE_ERROR, DEVICE_ERROR_TIMEOUT, "has not answered");
}

TEST(wrong_address) {
    static const char *const addresses[] = {
        "", "lamps.example", "10.0.0.256", "255.255.255.255", "239.0.0.1", "0.0.0.0"};
    g_autoptr(Clock) clock = clock_new_real();
    for (gsize i = 0; i < G_N_ELEMENTS(addresses); i++) {
        const struct config_section *section;
        g_autofree char *text = g_strdup_printf(
            "[lamps test]\ndriver = artnet-lamps\naddress = %s\nn = 1\n", addresses[i]);
        const struct conformance with = {.section = text};
        g_autoptr(Config) config = conformance_config(&with, "", &section);
        GError *error = NULL;
        g_assert_null(lamps_open(&artnet_lamps_driver, section, NULL, clock, &error));
        g_assert_nonnull(error);
        g_assert_nonnull(strstr(error->message, "address"));
        g_clear_error(&error);
    }
}

/* The section to copy, with the address of the model. */
TEST(preset) {
    g_autofree char *text = text_file_read(SOURCE_DIR "/etc/devices/artnet.conf");
    g_autoptr(GString) changed = g_string_new(text);
    g_autofree char *addresses =
        g_strdup_printf("%s\nlocal_address = %s", virtual_dmx_address(1), virtual_dmx_address(0));
    g_autoptr(VirtualDmx) node = node_new();
    g_autoptr(Clock) clock = clock_new_real();
    const struct config_section *section;
    g_string_replace(changed, "address 10.0.0.7", "address", 0); /* in a comment */
    g_assert_cmpint(g_string_replace(changed, "10.0.0.7", addresses, 0), ==, 1);
    const struct conformance with = {.section = changed->str};
    g_autoptr(Config) config = conformance_config(&with, "", &section);
    g_autoptr(LampBank) bank = ok(lamps_open(&artnet_lamps_driver, section, NULL, clock, ERR));
    g_assert_cmpint(bank->n, ==, 8);
    g_assert_cmpfloat(bank->warm_up_s, ==, 60);
}

/* Two banks on universes of one node share the socket. */
TEST(two_banks) {
    struct bench bench;
    begin(&bench, "n = 4\n");
    LampBank *other = ok(open_bank(bench.clock, "n = 3\nuniverse = 2\n", ERR));
    lamps_listen(other, on_lamp, &bench);
    light(&bench, 1);
    bench.n_events = 0;
    g_assert_true(lamps_set(other, 2, TRUE, NULL));
    conformance_wait(bench.clock, &bench.n_events, 1, 10);
    g_assert_cmpint(state_of(&bench).levels[0][1], ==, 255);
    g_assert_cmpint(state_of(&bench).levels[1][2], ==, 255);
    lamps_close(other);
    g_assert_cmpint(state_of(&bench).levels[0][1], ==, 255);
    g_assert_cmpint(state_of(&bench).levels[1][2], ==, 0);
    g_autoptr(GError) error = NULL;
    g_assert_null(open_bank(bench.clock, "n = 4\n", &error));
    g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_BUSY);
    end(&bench);
}
