/* The driver serial-lamps when its controller fails. The outputs of the model are the truth. */
#include "conformance/conformance.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "lib/wait.h"
#include "serial/devices.h"
#include "virtual/leds.h"

#include <string.h>

#define N_LAMPS 4

struct bench {
    VirtualLeds *leds;
    Clock *clock;
    LampBank *bank;
    int n_events, n_failed, n_lost;
    GError *error; /* of the last event that failed */
    int n_unsafe, n_safe;
};

static void on_lamp(LampBank *bank, int index, gboolean on, gint64 at_us, const GError *error,
                    gpointer data) {
    struct bench *bench = data;
    bench->n_events++;
    bench->n_failed += error != NULL;
    bench->n_lost += index < 0 && on;
    if (error && (on || !bench->error)) {
        g_clear_error(&bench->error);
        bench->error = g_error_copy(error);
    }
}

static void on_safety(struct device *device, const GError *error, gpointer data) {
    struct bench *bench = data;
    *(error ? &bench->n_unsafe : &bench->n_safe) += 1;
}

static LampBank *open_bank(const VirtualLeds *leds, Clock *clock, const char *keys,
                           GError **error) {
    const struct config_section *section;
    g_autofree char *text =
        g_strdup_printf("[lamps test]\ndriver = serial-lamps\nport = %s\nboot_ms = 300\n%s",
                        virtual_leds_port(leds), keys);
    const struct conformance with = {.section = text};
    g_autoptr(Config) config = conformance_config(&with, "", &section);
    return lamps_open(&serial_lamps_driver, section, NULL, clock, error);
}

static void begin(struct bench *bench, const char *keys) {
    const struct virtual_leds_options options = {.n = N_LAMPS, .dark_ms = 800};
    *bench = (struct bench){.leds = ok(virtual_leds_new(&options, ERR)), .clock = clock_new_real()};
    bench->bank = ok(open_bank(bench->leds, bench->clock, keys, ERR));
    lamps_listen(bench->bank, on_lamp, bench);
    device_watch_safety(&bench->bank->device, on_safety, bench);
}

static void end(struct bench *bench) {
    struct virtual_leds_state state;
    lamps_close(bench->bank);
    virtual_leds_state(bench->leds, &state);
    g_assert_false(state.lit);
    virtual_leds_free(bench->leds);
    clock_unref(bench->clock);
    g_clear_error(&bench->error);
}

static struct virtual_leds_state state_of(const struct bench *bench) {
    struct virtual_leds_state state;
    virtual_leds_state(bench->leds, &state);
    return state;
}

static void fail(struct bench *bench, const struct virtual_leds_faults *faults) {
    static const struct virtual_leds_faults well;
    virtual_leds_fail(bench->leds, faults ? faults : &well);
}

/* Switches a lamp and waits for the event. */
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
    g_assert_cmpint(bench->n_failed, ==, 0);
    g_assert_cmpint(lamps_light(bench->bank, index), ==, LIGHT_ON);
    g_assert_cmpint(state_of(bench).levels[index], >, 0);
}

/* The lamps become lost with these words, and are off and safe afterwards. */
static void expect_lost(struct bench *bench, int code, const char *words) {
    conformance_wait(bench->clock, &bench->n_lost, 1, 10);
    conformance_expect_error(&bench->error, DEVICE_ERROR, code, words);
    g_assert_cmpint(bench->n_lost, ==, 1);
}

static void expect_recovery(struct bench *bench) {
    fail(bench, NULL);
    UNTIL (lamps_safety(bench->bank) == DEVICE_SAFE)
        conformance_pass(bench->clock, 0.01);
    g_assert_false(state_of(bench).lit);
    g_assert_cmpint(bench->n_lost, <=, 1);
    light(bench, 1);
    set_lamp(bench, 1, FALSE);
    g_assert_cmpint(bench->n_failed, ==, 0);
}

TEST(stays_lit) {
    struct bench bench;
    begin(&bench, "levels = 1;20;30;255\n");
    g_assert_cmpfloat(bench.bank->watchdog_s, ==, 0.8);
    light(&bench, 1);
    light(&bench, 3);
    conformance_pass(bench.clock, 3);
    const struct virtual_leds_state state = state_of(&bench);
    const guint8 levels[] = {0, 20, 0, 255};
    g_assert_cmpmem(state.levels, N_LAMPS, levels, N_LAMPS);
    g_assert_cmpint(state.n_watchdog, ==, 0);
    g_assert_cmpint(state.n_pings, >, 4);
    g_assert_cmpint(bench.n_lost, ==, 0);
    set_lamp(&bench, -1, FALSE);
    const int n_pings = state_of(&bench).n_pings;
    conformance_pass(bench.clock, 1);
    g_assert_cmpint(state_of(&bench).n_pings, ==, n_pings);
    end(&bench);
}

TEST(close_lit) {
    struct bench bench;
    begin(&bench, "");
    light(&bench, 2);
    lamps_close(bench.bank);
    g_assert_false(state_of(&bench).lit);
    g_assert_cmpint(state_of(&bench).n_watchdog, ==, 0);
    bench.bank = NULL;
    end(&bench);
}

/* A program that hangs: the lamps go off by themselves, and are not switched on again. */
TEST(program_hangs) {
    struct bench bench;
    begin(&bench, "");
    light(&bench, 2);
    UNTIL (!state_of(&bench).lit)
        g_usleep(1000);
    g_assert_cmpint(state_of(&bench).n_watchdog, ==, 1);
    expect_lost(&bench, DEVICE_ERROR_PROTOCOL, "lamp 2 was at 255");
    expect_recovery(&bench);
    end(&bench);
}

TEST(reset) {
    struct bench bench;
    begin(&bench, "");
    light(&bench, 0);
    virtual_leds_reset(bench.leds);
    expect_lost(&bench, DEVICE_ERROR_DISCONNECTED, "was reset");
    expect_recovery(&bench);
    end(&bench);
}

/* A reset whose message is lost is noticed by the next answer. */
TEST(reset_unheard) {
    struct bench bench;
    begin(&bench, "");
    light(&bench, 0);
    fail(&bench, &(struct virtual_leds_faults){.silent = TRUE});
    virtual_leds_reset(bench.leds);
    g_usleep(50000);
    fail(&bench, NULL);
    expect_lost(&bench, DEVICE_ERROR_PROTOCOL, "lamp 0 was at 255");
    expect_recovery(&bench);
    end(&bench);
}

TEST(unplugged) {
    struct bench bench;
    begin(&bench, "");
    light(&bench, 0);
    virtual_leds_unplug(bench.leds);
    expect_lost(&bench, DEVICE_ERROR_DISCONNECTED, "unplugged");
    UNTIL (!state_of(&bench).lit)
        conformance_pass(bench.clock, 0.01);
    g_assert_cmpint(state_of(&bench).n_watchdog, ==, 1);
    g_assert_cmpint(lamps_light(bench.bank, 0), ==, LIGHT_UNSAFE);
    g_assert_false(lamps_set(bench.bank, 1, TRUE, NULL));
    virtual_leds_plug(bench.leds);
    expect_recovery(&bench);
    end(&bench);
}

/* The line is cut while a lamp is lit: the watchdog switches it off, which nobody can confirm. */
TEST(cut) {
    struct bench bench;
    begin(&bench, "");
    light(&bench, 0);
    fail(&bench, &(struct virtual_leds_faults){.cut = TRUE});
    expect_lost(&bench, DEVICE_ERROR_TIMEOUT, "has not answered");
    UNTIL (!state_of(&bench).lit)
        conformance_pass(bench.clock, 0.01);
    conformance_pass(bench.clock, 1);
    g_assert_cmpint(lamps_light(bench.bank, 0), ==, LIGHT_UNSAFE);
    expect_recovery(&bench);
    end(&bench);
}

/* A lamp that does not go off: "off" is not confirmed as long as the controller reports light. */
TEST(refuses_off) {
    struct bench bench;
    begin(&bench, "");
    light(&bench, 0);
    fail(&bench, &(struct virtual_leds_faults){.stuck = 1});
    set_lamp(&bench, 0, FALSE);
    g_assert_cmpint(bench.n_failed, ==, 1);
    conformance_expect_error(&bench.error, DEVICE_ERROR, DEVICE_ERROR_PROTOCOL,
                             "lamp 0 was set to 0");
    conformance_pass(bench.clock, 2);
    g_assert_cmpint(lamps_light(bench.bank, 0), ==, LIGHT_UNSAFE);
    g_assert_cmpint(bench.n_unsafe, ==, 1);
    g_assert_cmpint(bench.n_safe, ==, 0);
    g_assert_cmpint(state_of(&bench).n_pings, <=, 1);
    expect_recovery(&bench);
    end(&bench);
}

TEST(does_not_light) {
    struct bench bench;
    begin(&bench, "");
    fail(&bench, &(struct virtual_leds_faults){.dead = 2});
    set_lamp(&bench, 1, TRUE);
    g_assert_cmpint(bench.n_failed, ==, 1);
    conformance_expect_error(&bench.error, DEVICE_ERROR, DEVICE_ERROR_PROTOCOL,
                             "lamp 1 was set to 255");
    expect_recovery(&bench);
    end(&bench);
}

/* Light that nobody asked for, for example by another program on the line. */
TEST(lit_by_others) {
    struct bench bench;
    begin(&bench, "");
    virtual_leds_receive(bench.leds, "L1 002a s 03 ff*91de\n");
    g_assert_true(state_of(&bench).lit);
    set_lamp(&bench, 0, TRUE);
    expect_lost(&bench, DEVICE_ERROR_PROTOCOL, "lamp 3 was at 0");
    expect_recovery(&bench);
    end(&bench);
}

/* Lamps that an earlier program has left on are off when the bank is open. */
TEST(left_on) {
    struct bench bench;
    begin(&bench, "");
    lamps_close(bench.bank);
    virtual_leds_receive(bench.leds, "L1 002a s 03 ff*91de\n");
    g_assert_true(state_of(&bench).lit);
    bench.bank = ok(open_bank(bench.leds, bench.clock, "", ERR));
    g_assert_false(state_of(&bench).lit);
    conformance_pass(bench.clock, 0.2);
    g_assert_cmpint(lamps_safety(bench.bank), ==, DEVICE_SAFE);
    end(&bench);
}

/* With damaged, lost and late bytes no wrong lamp is ever lit, and most switches succeed. */
TEST(bad_line) {
    static const struct virtual_leds_faults faults[] = {
        {.damage_sent = 97},
        {.lose_sent = 89},
        {.damage_received = 61},
        {.lose_received = 53},
        {.noise = TRUE},
        {.late_ms = 60},
        {.damage_sent = 131, .damage_received = 113, .noise = TRUE},
    };
    for (gsize k = 0; k < G_N_ELEMENTS(faults); k++) {
        struct bench bench;
        int n_failed = 0;
        begin(&bench, "answer_ms = 100\n");
        fail(&bench, &faults[k]);
        for (int i = 0; i < 40; i++) {
            const int lamp = i / 2 % N_LAMPS;
            set_lamp(&bench, lamp, i % 2 == 0);
            n_failed += bench.n_failed;
            UNTIL (lamps_safety(bench.bank) == DEVICE_SAFE || i % 2 == 0)
                conformance_pass(bench.clock, 0.01);
            const struct virtual_leds_state state = state_of(&bench);
            for (int other = 0; other < N_LAMPS; other++)
                if (other != lamp || i % 2)
                    g_assert_cmpint(state.levels[other], ==, 0);
        }
        g_test_message("fault %zu: %d of 40 switches failed", k, n_failed);
        g_assert_cmpint(n_failed, <, 10);
        expect_recovery(&bench);
        end(&bench);
    }
}

/* "Off" does not wait for the answer to "on", and that "on" is not sent again. */
TEST(off_first) {
    struct bench bench;
    begin(&bench, "");
    fail(&bench, &(struct virtual_leds_faults){.silent = TRUE});
    g_assert_true(lamps_set(bench.bank, 0, TRUE, NULL));
    g_assert_true(lamps_set(bench.bank, 1, TRUE, NULL));
    g_assert_true(lamps_all_off(bench.bank, NULL));
    UNTIL (state_of(&bench).n_offs > 1) /* the main loop does not run */
        g_usleep(1000);
    conformance_pass(bench.clock, 0.5);
    g_assert_cmpint(state_of(&bench).n_sets, ==, 1);
    g_assert_false(state_of(&bench).lit);
    expect_recovery(&bench);
    end(&bench);
}

static void expect_refusal(const VirtualLeds *leds, const char *keys, GQuark domain, int code,
                           const char *words) {
    g_autoptr(Clock) clock = clock_new_real();
    GError *error = NULL;
    const int files = conformance_open_files();
    g_assert_null(open_bank(leds, clock, keys, &error));
    conformance_expect_error(&error, domain, code, words);
    g_assert_cmpint(conformance_open_files(), ==, files);
}

TEST(refusals) {
    const struct virtual_leds_options options = {.n = N_LAMPS, .dark_ms = 800};
    const struct virtual_leds_options hasty = {.n = N_LAMPS, .dark_ms = 100};
    g_autoptr(VirtualLeds) leds = ok(virtual_leds_new(&options, ERR));
    g_autoptr(VirtualLeds) other = ok(virtual_leds_new(&hasty, ERR));
    g_autoptr(Clock) clock = clock_new_real();
    expect_refusal(leds, "levels = 1;2\n", CONFIG_ERROR, CONFIG_ERROR_VALUE,
                   "has 2 numbers, but the controller has 4 lamps");
    expect_refusal(leds, "levels = 0\n", CONFIG_ERROR, CONFIG_ERROR_VALUE, "1 to 255");
    expect_refusal(other, "", DEVICE_ERROR, DEVICE_ERROR_PROTOCOL, "too soon");
    LampBank *bank = ok(open_bank(leds, clock, "", ERR));
    expect_refusal(leds, "", DEVICE_ERROR, DEVICE_ERROR_BUSY, "");
    lamps_close(bank);
    virtual_leds_fail(leds, &(struct virtual_leds_faults){.silent = TRUE});
    expect_refusal(leds, "", DEVICE_ERROR, DEVICE_ERROR_TIMEOUT, "has not answered");
    virtual_leds_fail(leds, &(struct virtual_leds_faults){.damage_sent = 5});
    expect_refusal(leds, "answer_ms = 50\n", DEVICE_ERROR, DEVICE_ERROR_TIMEOUT, "check");
    virtual_leds_unplug(leds);
    expect_refusal(leds, "", DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED, "cannot open");
}

/* The preset of etc/devices is a valid section. */
TEST(preset) {
    g_autofree char *path = g_build_filename(SOURCE_DIR "/etc/devices/led-controller.conf", NULL);
    g_autoptr(Config) config = ok(config_load(path, ERR));
    g_autoptr(Clock) clock = clock_new_real();
    GError *error = NULL;
    gsize n;
    const struct config_section *sections = config_sections(config, &n);
    g_assert_cmpuint(n, ==, 1);
    g_assert_null(lamps_open(&serial_lamps_driver, &sections[0], NULL, clock, &error));
    conformance_expect_error(&error, DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED, "cannot open");
}
