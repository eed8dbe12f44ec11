#include "lib/modbus_bench.h"
#include "lib/test.h"
#include "lib/wait.h"

#include <signal.h>
#include <stdio.h>
#include <unistd.h>

/* Watchdogs of Modbus boards and drives, by a register and by pulses: what stays on, what goes off
 * when this program hangs, ends or is disconnected, and what the operator is told. */

#define REGISTER "watchdog_register = 6\nwatchdog_after_s = 1\nwatchdog_scale = 10\n"
#define PULSES   "pulse_coil = 0x209\nwatchdog_after_s = 1\nwatchdog_scale = 10\n"
#define AFTER_US 1000000
#define AFTER_MS 1000

static void open_lit(struct bench *bench, gboolean rtu, const char *keys) {
    bench_begin(bench, GINT_TO_POINTER(rtu));
    bench_open_laser(bench, keys);
    g_assert_cmpfloat(bench->laser->watchdog_s, ==, 1);
    laser_set(bench->laser, TRUE, NULL);
    bench_expect(bench, TRUE);
    g_assert_true(bench_state(bench).coils[9]);
}

/* Without the main loop. The board switches the coil off by itself, after AFTER_MS. */
static void wait_dark(struct bench *bench, int coil) {
    UNTIL (!bench_state(bench).coils[coil])
        g_usleep(5000);
    g_assert_cmpint(bench_state(bench).expired_ms, ==, AFTER_MS);
}

static const char *const watchdog_keys[] = {"coil = 9\n" REGISTER, "coil = 9\n" PULSES};

/* Four times its time. */
TEST(watchdog_stays_on) {
    for (gsize i = 0; i < G_N_ELEMENTS(watchdog_keys); i++) {
        struct bench bench;
        open_lit(&bench, i, watchdog_keys[i]);
        gint64 until = g_get_monotonic_time() + 4 * AFTER_US;
        while (g_get_monotonic_time() < until) {
            conformance_pass(bench.clock, 0.02);
            g_assert_true(bench_state(&bench).coils[9]);
        }
        g_assert_cmpint(bench.n, ==, 0);
        g_assert_cmpint(bench_state(&bench).timeouts, ==, 0);
        g_assert_cmpint(bench_state(&bench).pulses, >=, i ? 8 : 0);
        laser_set(bench.laser, FALSE, NULL);
        bench_expect(&bench, FALSE);
        g_assert_false(bench_state(&bench).coils[9]);
        int requests = bench_state(&bench).requests;
        conformance_pass(bench.clock, 2e-6 * AFTER_US); /* no requests for a light that is off */
        g_assert_cmpint(bench_state(&bench).requests, ==, requests);
        bench_end(&bench, NULL);
    }
}

/* The main loop hangs. As soon as it continues, it reports that the laser went off by itself, and
 * the laser stays off. */
TEST(watchdog_hang) {
    for (gsize i = 0; i < G_N_ELEMENTS(watchdog_keys); i++) {
        struct bench bench;
        open_lit(&bench, i, watchdog_keys[i]);
        wait_dark(&bench, 9);
        int pulses = bench_state(&bench).pulses;
        conformance_wait(bench.clock, &bench.n, 2, 10);
        g_assert_false(laser_is_on(bench.laser));
        conformance_pass(bench.clock, 1e-6 * AFTER_US);
        g_assert_false(bench_state(&bench).coils[9]);
        g_assert_cmpint(bench_state(&bench).pulses, <=, pulses + 1);
        bench_end(&bench, NULL);
    }
}

/* What the listener is told: an "on" that failed, then off. */
TEST(watchdog_lost) {
    struct bench bench;
    open_lit(&bench, FALSE, watchdog_keys[0]);
    wait_dark(&bench, 9);
    conformance_wait(bench.clock, &bench.n, 1, 10);
    g_assert_cmpint(bench.event, ==, TRUE);
    bench_expect_error(&bench, DEVICE_ERROR_PROTOCOL,
                       "laser l: may not be on any more: tcp:127.0.0.1:");
    bench_expect(&bench, FALSE);
    bench_end(&bench, NULL);
}

TEST(watchdog_cut) {
    for (gsize i = 0; i < G_N_ELEMENTS(watchdog_keys); i++) {
        struct bench bench;
        open_lit(&bench, FALSE, watchdog_keys[i]);
        conformance_pass(bench.clock, 2e-6 * AFTER_US);
        g_assert_true(bench_state(&bench).coils[9]);
        bench_fail(&bench, .cut = TRUE);
        wait_dark(&bench, 9);
        conformance_wait(bench.clock, &bench.n, 1, 10);
        g_assert_error(bench.error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT);
        g_assert_cmpint(bench.event, ==, TRUE);
        bench_end(&bench, NULL);
    }
}

/* One answer that is lost, or late, does not put it out. */
TEST(watchdog_lapses) {
    static const struct virtual_modbus_faults lapses[] = {
        {.silent = 1}, {.damaged = 1}, {.late = 1, .late_ms = 90}};
    for (gsize i = 0; i < 2 * G_N_ELEMENTS(lapses); i++) {
        struct bench bench;
        open_lit(&bench, TRUE, watchdog_keys[i % 2]);
        virtual_modbus_fail(bench.device, &lapses[i / 2]);
        conformance_pass(bench.clock, 1.6e-6 * AFTER_US);
        g_assert_true(bench_state(&bench).coils[9]);
        g_assert_cmpint(bench.n, ==, 0);
        bench_end(&bench, NULL);
    }
}

/* One asking fails altogether; the next is still in time. */
static void watchdog_patience(struct bench *bench, gconstpointer unused) {
    bench_open_laser(bench, "coil = 9\nwatchdog_register = 6\nwatchdog_after_s = 3\n"
                            "watchdog_scale = 10\n");
    laser_set(bench->laser, TRUE, NULL);
    bench_expect(bench, TRUE);
    bench_fail(bench, .silent = -1);
    conformance_pass(bench->clock, 2.2);
    bench_fail(bench, 0);
    conformance_pass(bench->clock, 2);
    g_assert_true(bench_state(bench).coils[9]);
    g_assert_cmpint(bench->n, ==, 0);
}

/* A program of its own, on the virtual board of the test. */
TEST(killed_child) {
    const char *bus = g_getenv("MESORIG_TEST_BUS"), *keys = g_getenv("MESORIG_TEST_KEYS");
    if (!bus)
        return;
    struct bench bench = {.clock = clock_new_real()};
    g_autofree char *text = modbus_rig_section(bus, "laser l", keys);
    const struct conformance with = {.section = text, .path = "/rig/rig.conf"};
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(&with, "", &section);
    bench.laser = laser_open(&modbus_laser_driver, section, NULL, bench.clock, NULL);
    laser_listen(bench.laser, bench_on_laser, &bench);
    laser_set(bench.laser, TRUE, NULL);
    bench_expect(&bench, TRUE);
    g_print("lit\n");
    fflush(stdout);
    kill(getpid(), SIGKILL);
}

TEST(watchdog_killed) {
    for (gsize i = 0; i < G_N_ELEMENTS(watchdog_keys); i++) {
        struct bench bench;
        bench_begin(&bench, NULL);
        g_setenv("MESORIG_TEST_BUS", virtual_modbus_bus(bench.device), TRUE);
        g_setenv("MESORIG_TEST_KEYS", watchdog_keys[i], TRUE);
        g_test_trap_subprocess("/modbus-watchdog/killed-child", 0, G_TEST_SUBPROCESS_DEFAULT);
        g_test_trap_assert_stdout("*lit*");
        g_unsetenv("MESORIG_TEST_BUS");
        wait_dark(&bench, 9);
        bench_end(&bench, NULL);
    }
}

TEST(watchdog_lamps) {
    static const char *const keys[] = {
        "n = 3\nfirst_coil = 4\n" REGISTER,
        "n = 3\nfirst_coil = 4\npulse_coil = 516\nwatchdog_after_s = 1\nwatchdog_scale = 10\n"};
    for (gsize i = 0; i < G_N_ELEMENTS(keys); i++) {
        struct bench bench;
        bench_begin(&bench, NULL);
        bench_open_bank(&bench, keys[i]);
        g_assert_cmpfloat(bench.bank->watchdog_s, ==, 1);
        for (int lamp = 0; lamp < 3; lamp++) {
            lamps_set(bench.bank, lamp, TRUE, NULL);
            bench_expect(&bench, TRUE);
        }
        lamps_set(bench.bank, 1, FALSE, NULL);
        bench_expect(&bench, FALSE);
        conformance_pass(bench.clock, 3e-6 * AFTER_US);
        for (int lamp = 0; lamp < 3; lamp++)
            g_assert_cmpint(bench_state(&bench).coils[4 + lamp], ==, lamp != 1);
        g_assert_cmpint(bench.n, ==, 0);
        wait_dark(&bench, 4);
        wait_dark(&bench, 6);
        conformance_wait(bench.clock, &bench.n, 1, 10);
        g_assert_cmpint(bench.event, ==, TRUE);
        bench_expect_error(&bench, DEVICE_ERROR_PROTOCOL, "lamps bank: may not be on any more");
        bench_expect(&bench, FALSE);
        for (int lamp = 0; lamp < 3; lamp++)
            g_assert_false(lamps_is_on(bench.bank, lamp));
        bench_end(&bench, NULL);
    }
}

/* A drive that is not heard of brakes; while it is polled it goes its way. */
static void watchdog_axis(struct bench *bench, gconstpointer unused) {
    bench_open_axis(bench, REGISTER);
    bench_home(bench);
    conformance_pass(bench->clock, 3e-6 * AFTER_US);
    g_assert_cmpint(bench_state(bench).timeouts, ==, 0);
    g_usleep(AFTER_US + 300000);
    g_assert_cmpint(bench_state(bench).timeouts, ==, 1);
}

static void open_refused(struct bench *bench, const char *keys, GQuark domain, int code,
                         const char *words) {
    const struct config_section *section = bench_section(bench, "laser l", keys);
    GError *error = NULL;
    g_assert_null(laser_open(&modbus_laser_driver, section, NULL, bench->clock, &error));
    conformance_expect_error(&error, domain, code, words);
}

static void watchdog_refused(struct bench *bench, gconstpointer unused) {
    /* The coil is written and read first. */
    bench_fail(bench, .skip = 2, .refused = 1, .exception = 2);
    open_refused(bench, "coil = 9\n" REGISTER, DEVICE_ERROR, DEVICE_ERROR_PROTOCOL,
                 "laser l: watchdog_register: tcp:");
    bench_fail(bench, .skip = 3, .refused = 1, .exception = 3);
    open_refused(bench, "coil = 9\n" REGISTER, DEVICE_ERROR, DEVICE_ERROR_PROTOCOL,
                 "writing holding register 6 (0x0006): the device refused: Illegal data value");
    bench_fail(bench, 0);
    open_refused(bench, "coil = 9\nwatchdog_register = 200\n", DEVICE_ERROR, DEVICE_ERROR_PROTOCOL,
                 "reading holding register 200 (0x00c8): the device refused: Illegal data address");
    open_refused(bench, "coil = 9\nwatchdog_register = 20\n", DEVICE_ERROR, DEVICE_ERROR_PROTOCOL,
                 "3 was written to address 20, which reads back as 0");
    open_refused(bench,
                 "coil = 9\nwatchdog_register = 6\nwatchdog_after_s = 0.3\n"
                 "watchdog_scale = 10\n",
                 CONFIG_ERROR, CONFIG_ERROR_VALUE, "watchdog_after_s: 0.3 s is too short");
    open_refused(
        bench, "coil = 9\nwatchdog_register = 6\nwatchdog_scale = 100000\n", CONFIG_ERROR,
        CONFIG_ERROR_VALUE,
        "watchdog_scale: watchdog_after_s × watchdog_scale, 3 × 100000, is not a number from "
        "1 to 65535");
    open_refused(bench, "coil = 9\nwatchdog_register = 6\npulse_coil = 0x209\n", CONFIG_ERROR,
                 CONFIG_ERROR_VALUE, "pulse_coil: is given together with watchdog_register");
    bench_open_bank(bench, "n = 2\n");
    open_refused(bench, "coil = 9\n" REGISTER, CONFIG_ERROR, CONFIG_ERROR_VALUE,
                 "watchdog_register: [lamps bank] has another watchdog for the same board");
    /* A board without pulses. */
    bench_open_laser(bench, "coil = 9\npulse_coil = 0x300\n");
    laser_set(bench->laser, TRUE, NULL);
    bench_expect_error(bench, DEVICE_ERROR_PROTOCOL,
                       "writing a time to coil 768 (0x0300): the device refused: Illegal data");
    g_clear_pointer(&bench->laser, laser_close);
    bench_open_laser(bench, watchdog_keys[1]);
    bench_fail(bench, .deaf = TRUE);
    laser_set(bench->laser, TRUE, NULL);
    bench_expect_error(bench, DEVICE_ERROR_PROTOCOL,
                       "the time 10 was written, but coil 9 reads as off");
}

/* Left on by a program that could not reach it any more: a section whose watchdog is wrong switches
 * it off all the same. */
static void watchdog_dark_first(struct bench *bench, gconstpointer unused) {
    bench_open_laser(bench, "coil = 9\n");
    laser_set(bench->laser, TRUE, NULL);
    bench_expect(bench, TRUE);
    bench_fail(bench, .cut = TRUE);
    g_clear_pointer(&bench->laser, laser_close);
    g_assert_true(bench_state(bench).coils[9]);
    bench_fail(bench, 0);
    open_refused(bench, "coil = 9\nwatchdog_register = 6\nwatchdog_after_s = 0.1\n", CONFIG_ERROR,
                 CONFIG_ERROR_VALUE,
                 "watchdog_scale: watchdog_after_s × watchdog_scale, 0.1 × 1, is not a number");
    g_assert_false(bench_state(bench).coils[9]);
}

/* The board was without power, came back and has forgotten its timeout: no light without it. */
static void watchdog_forgotten(struct bench *bench, gconstpointer unused) {
    bench_open_laser(bench, watchdog_keys[0]);
    virtual_modbus_restart(bench->device, 20);
    g_usleep(50000);
    laser_set(bench->laser, TRUE, NULL);
    conformance_wait(bench->clock, &bench->n, 1, 10);
    bench->n = 0;
    conformance_wait(bench->clock, &bench->n, 1, 10);
    bench_expect_error(
        bench, DEVICE_ERROR_PROTOCOL,
        "reading holding register 6 (0x0006): address 6 should hold 10, but reads as 0");
    bench_expect(bench, FALSE);
    g_assert_false(bench_state(bench).coils[9]);
}

static const struct {
    const char *name;
    void (*run)(struct bench *bench, gconstpointer unused);
} tests[] = {
    {"/modbus/watchdog/patience", watchdog_patience},
    {"/modbus/watchdog/axis", watchdog_axis},
    {"/modbus/watchdog/refused", watchdog_refused},
    {"/modbus/watchdog/dark-first", watchdog_dark_first},
    {"/modbus/watchdog/forgotten", watchdog_forgotten},
};

BEFORE_TESTS {
    for (gsize i = 0; i < G_N_ELEMENTS(tests); i++)
        g_test_add(tests[i].name, struct bench, NULL, bench_begin, tests[i].run, bench_end);
}
