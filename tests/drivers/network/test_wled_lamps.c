/* The driver wled-lamps when its controller fails. The LEDs of the model are the truth. */
#include "conformance/conformance.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "lib/wait.h"
#include "network/devices.h"
#include "network/wled_http.h"
#include "virtual/dmx_node.h"
#include "virtual/wled.h"

#include <string.h>

struct bench {
    VirtualWled *wled;
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

static LampBank *open_bank(const VirtualWled *wled, Clock *clock, const char *keys,
                           GError **error) {
    const struct config_section *section;
    g_autofree char *text = g_strdup_printf("[lamps test]\ndriver = wled-lamps\naddress = %s\n"
                                            "http_port = %d\nlocal_address = %s\n%s",
                                            virtual_dmx_address(1), virtual_wled_http_port(wled),
                                            virtual_dmx_address(0), keys);
    const struct conformance with = {.section = text};
    g_autoptr(Config) config = conformance_config(&with, "", &section);
    return lamps_open(&wled_lamps_driver, section, NULL, clock, error);
}

static struct virtual_wled_state state_of(const struct bench *bench) {
    struct virtual_wled_state state;
    virtual_wled_state(bench->wled, &state);
    return state;
}

static void begin(struct bench *bench, const char *keys) {
    *bench = (struct bench){.wled = ok(virtual_wled_new(virtual_dmx_address(1), 500, ERR)),
                            .clock = clock_new_real()};
    bench->bank = ok(open_bank(bench->wled, bench->clock, keys, ERR));
    g_assert_false(state_of(bench).lit);
    g_assert_false(state_of(bench).on);
    lamps_listen(bench->bank, on_lamp, bench);
}

static void end(struct bench *bench) {
    lamps_close(bench->bank);
    g_assert_false(state_of(bench).lit);
    virtual_wled_free(bench->wled);
    clock_unref(bench->clock);
    g_clear_error(&bench->error);
}

#define FAIL(bench, ...)                                                                           \
    virtual_wled_fail((bench)->wled, &(const struct virtual_wled_faults){__VA_ARGS__})

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

/* Nothing but the LEDs of the lamp changes, also behind the first packet. */
TEST(leds) {
    struct bench bench;
    guint8 wanted[VIRTUAL_WLED_LEDS][3] = {0};
    begin(&bench, "n = 5\nfirst_led = 7\nleds = 90\nlevels = 10;20;30;40;50\n");
    for (int lamp = 0; lamp < 5; lamp++) {
        light(&bench, lamp);
        memset(wanted[7 + 90 * lamp], 10 * (lamp + 1), 3 * 90);
        const struct virtual_wled_state state = state_of(&bench);
        g_assert_cmpmem(state.leds, sizeof wanted, wanted, sizeof wanted);
    }
    g_assert_false(state_of(&bench).on);
    g_assert_cmpfloat(bench.bank->watchdog_s, ==, 3);
    g_assert_cmpstr(bench.bank->device.identity, !=, NULL);
    end(&bench);
}

TEST(stays_lit) {
    struct bench bench;
    begin(&bench, "n = 4\n");
    light(&bench, 1);
    FAIL(&bench, .lose = 3);
    conformance_pass(bench.clock, 7);
    g_assert_true(state_of(&bench).lit);
    g_assert_cmpint(state_of(&bench).n_returns, ==, 0);
    g_assert_cmpint(bench.n_lost, ==, 0);
    set_lamp(&bench, 1, FALSE);
    g_assert_no_error(bench.error);
    g_assert_false(state_of(&bench).live);
    end(&bench);
}

static void lost(struct virtual_wled_faults faults, int code, const char *words) {
    struct bench bench;
    begin(&bench, "n = 4\n");
    light(&bench, 2);
    virtual_wled_fail(bench.wled, &faults);
    conformance_wait(bench.clock, &bench.n_lost, 1, 20);
    conformance_expect_error(&bench.error, DEVICE_ERROR, code, words);
    FAIL(&bench, .cut = FALSE);
    UNTIL (lamps_safety(bench.bank) == DEVICE_SAFE)
        conformance_pass(bench.clock, 0.01);
    g_assert_false(state_of(&bench).lit);
    g_clear_error(&bench.error);
    light(&bench, 1);
    end(&bench);
}

TEST(cut_while_lit) {
    lost((struct virtual_wled_faults){.cut = TRUE}, DEVICE_ERROR_TIMEOUT,
         "check its power, its network and address");
}

TEST(silent_while_lit) {
    lost((struct virtual_wled_faults){.silent = TRUE}, DEVICE_ERROR_TIMEOUT,
         "check its power, its network and address");
}

/* It goes off by itself, and says so. */
TEST(deaf_while_lit) {
    lost((struct virtual_wled_faults){.deaf = TRUE}, DEVICE_ERROR_PROTOCOL,
         "does not show what this computer sends, but its own state; let WLED receive UDP");
}

TEST(another_sender) {
    lost((struct virtual_wled_faults){.other = TRUE}, DEVICE_ERROR_PROTOCOL,
         "does not show what this computer sends, but 10.9.8.7");
}

TEST(garbage) {
    lost((struct virtual_wled_faults){.garbage = TRUE}, DEVICE_ERROR_PROTOCOL,
         "the answer is not the state of WLED");
}

TEST(refuses) {
    lost((struct virtual_wled_faults){.refuses = TRUE}, DEVICE_ERROR_PROTOCOL, "HTTP status 500");
}

/* "Off" is confirmed only when WLED says that it is off. */
TEST(does_not_go_off) {
    struct bench bench;
    begin(&bench, "n = 4\n");
    light(&bench, 2);
    FAIL(&bench, .stays = TRUE, .deaf = TRUE);
    set_lamp(&bench, 2, FALSE);
    conformance_expect_error(&bench.error, DEVICE_ERROR, DEVICE_ERROR_PROTOCOL,
                             "still shows what it gets from");
    g_assert_cmpint(lamps_light(bench.bank, 2), ==, LIGHT_UNSAFE);
    FAIL(&bench, .cut = FALSE);
    UNTIL (lamps_safety(bench.bank) == DEVICE_SAFE)
        conformance_pass(bench.clock, 0.01);
    g_assert_false(state_of(&bench).lit);
    end(&bench);
}

/* Somebody switches WLED on while a lamp is lit: it would be on after the time without levels. */
TEST(button) {
    struct bench bench;
    begin(&bench, "n = 4\n");
    light(&bench, 2);
    virtual_wled_press(bench.wled);
    conformance_wait(bench.clock, &bench.n_lost, 1, 20);
    conformance_expect_error(&bench.error, DEVICE_ERROR, DEVICE_ERROR_PROTOCOL,
                             "is on by itself; check what else switches it");
    UNTIL (lamps_safety(bench.bank) == DEVICE_SAFE)
        conformance_pass(bench.clock, 0.01);
    g_assert_false(state_of(&bench).on);
    g_assert_false(state_of(&bench).lit);
    end(&bench);
}

TEST(cannot_be_opened) {
    g_autoptr(VirtualWled) wled = ok(virtual_wled_new(virtual_dmx_address(1), 100, ERR));
    g_autoptr(Clock) clock = clock_new_real();
    GError *error = NULL;
    g_assert_null(open_bank(wled, clock, "n = 11\nleds = 10\n", &error));
    conformance_expect_error(&error, CONFIG_ERROR, CONFIG_ERROR_VALUE,
                             "n: the lamps need 110 LEDs, but WLED at");
    g_assert_null(open_bank(wled, clock, "n = 4\nlevels = 1;2\n", &error));
    conformance_expect_error(&error, CONFIG_ERROR, CONFIG_ERROR_VALUE,
                             "levels: has 2 numbers for 4 lamps");
    virtual_wled_fail(wled, &(const struct virtual_wled_faults){.cut = TRUE});
    g_assert_null(open_bank(wled, clock, "n = 4\n", &error));
    conformance_expect_error(&error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT, "check its power");
}

TEST(answers) {
    static const char good[] =
        "{\"state\":{\"on\":true},\"info\":{\"live\":true,\"lip\":\"10.0.0.9\","
        "\"ver\":\"0.14.4\",\"leds\":{\"count\":30}}}";
    static const char *const bad[] = {
        "",
        "null",
        "[]",
        "{}",
        "{\"state\":[],\"info\":3}",
        "{\"state\":{\"on\":1},\"info\":{\"live\":false,\"leds\":{\"count\":3}}}",
        "{\"state\":{\"on\":true},\"info\":{\"live\":false,\"leds\":[3]}}"};
    struct wled_answer answer = {0};
    ok(wled_answer_read(good, -1 + (gssize)sizeof good, &answer, ERR));
    g_assert_true(answer.on && answer.live);
    g_assert_cmphex(answer.from, ==, 0x0a000009);
    g_assert_cmpint(answer.n_leds, ==, 30);
    g_assert_cmpstr(answer.version, ==, "0.14.4");
    for (gsize i = 0; i < G_N_ELEMENTS(bad); i++)
        g_assert_false(wled_answer_read(bad[i], (gssize)strlen(bad[i]), &answer, NULL));
    for (gsize n = 0; n < sizeof good - 1; n++)
        g_assert_false(wled_answer_read(good, (gssize)n, &answer, NULL));
}
