#include "lib/modbus_rig.h"

#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <unistd.h>

/* Every fault of a Modbus device with its words and the way out of it. */

struct bench {
    VirtualModbus *device;
    Clock *clock;
    Axis *axis;
    LampBank *bank;
    Laser *laser;
    Interlock *door;
    int n;     /* events not yet expected */
    int event; /* the last one: of an axis, or on */
    GError *error;
    gint64 at_us;
};

static void hear(struct bench *bench, int event, const GError *error) {
    bench->n++;
    bench->event = event;
    bench->at_us = g_get_monotonic_time();
    g_clear_error(&bench->error);
    bench->error = error ? g_error_copy(error) : NULL;
}

static void on_axis(Axis *axis, enum axis_event event, const GError *error, gpointer data) {
    hear(data, (int)event, error);
}

static void on_lamp(LampBank *bank, int index, gboolean on, gint64 at_us, const GError *error,
                    gpointer data) {
    hear(data, on, error);
}

static void on_laser(Laser *laser, gboolean on, const GError *error, gpointer data) {
    hear(data, on, error);
}

static void on_door(Interlock *door, gboolean closed, gpointer data) {
    hear(data, closed, NULL);
}

static const struct config_section *read_section(const VirtualModbus *device, const char *header,
                                                 const char *keys, Config **ret_config) {
    g_autofree char *section = modbus_rig_section(virtual_modbus_bus(device), header, keys);
    const struct conformance with = {.section = section, .path = "/rig/rig.conf"};
    const struct config_section *found;
    *ret_config = conformance_config(&with, "", &found);
    return found;
}

static void begin(struct bench *bench, gboolean rtu) {
    *bench = (struct bench){.device = modbus_rig_device(rtu), .clock = clock_new_real()};
}

static void end(struct bench *bench) {
    axis_close(bench->axis);
    lamps_close(bench->bank);
    laser_close(bench->laser);
    interlock_close(bench->door);
    g_clear_error(&bench->error);
    virtual_modbus_free(bench->device);
    clock_unref(bench->clock);
}

static void open_axis(struct bench *bench, const char *more) {
    g_autofree char *keys = g_strconcat(RIG_AXIS, more, NULL);
    g_autoptr(Config) config = NULL;
    const struct config_section *section = read_section(bench->device, "axis arc", keys, &config);
    GError *error = NULL;
    bench->axis = axis_open(&modbus_axis_driver, section, NULL, bench->clock, &error);
    g_assert_no_error(error);
    axis_listen(bench->axis, on_axis, bench);
}

static void open_bank(struct bench *bench, const char *keys) {
    g_autoptr(Config) config = NULL;
    const struct config_section *section = read_section(bench->device, "lamps bank", keys, &config);
    GError *error = NULL;
    bench->bank = lamps_open(&modbus_relays_driver, section, NULL, bench->clock, &error);
    g_assert_no_error(error);
    lamps_listen(bench->bank, on_lamp, bench);
}

static void open_laser(struct bench *bench, const char *keys) {
    g_autoptr(Config) config = NULL;
    const struct config_section *section = read_section(bench->device, "laser l", keys, &config);
    GError *error = NULL;
    bench->laser = laser_open(&modbus_laser_driver, section, NULL, bench->clock, &error);
    g_assert_no_error(error);
    laser_listen(bench->laser, on_laser, bench);
}

static void open_door(struct bench *bench, const char *keys) {
    g_autoptr(Config) config = NULL;
    const struct config_section *section =
        read_section(bench->device, "interlock door", keys, &config);
    GError *error = NULL;
    bench->door = interlock_open(&modbus_inputs_driver, section, NULL, bench->clock, &error);
    g_assert_no_error(error);
    interlock_listen(bench->door, on_door, bench);
}

static void fail_with(struct bench *bench, struct virtual_modbus_faults faults) {
    virtual_modbus_fail(bench->device, &faults);
}

static struct virtual_modbus_state state_of(struct bench *bench) {
    struct virtual_modbus_state state;
    virtual_modbus_state(bench->device, &state);
    return state;
}

static void expect(struct bench *bench, int event) {
    conformance_wait(bench->clock, &bench->n, 1, 10);
    g_assert_cmpint(bench->n, ==, 1);
    g_assert_no_error(bench->error);
    g_assert_cmpint(bench->event, ==, event);
    bench->n = 0;
}

static void expect_error(struct bench *bench, enum device_error code, const char *words) {
    conformance_wait(bench->clock, &bench->n, 1, 10);
    g_assert_cmpint(bench->n, ==, 1);
    g_assert_error(bench->error, DEVICE_ERROR, (int)code);
    if (!strstr(bench->error->message, words))
        g_error("\"%s\" does not say \"%s\"", bench->error->message, words);
    g_clear_error(&bench->error);
    bench->n = 0;
}

static void home(struct bench *bench) {
    g_assert_true(axis_home(bench->axis, NULL));
    expect(bench, AXIS_HOMED);
}

static void start(struct bench *bench, double to_deg) {
    GError *error = NULL;
    axis_move(bench->axis, to_deg, &error);
    g_assert_no_error(error);
}

static void go(struct bench *bench, double to_deg) {
    start(bench, to_deg);
    expect(bench, AXIS_ARRIVED);
    g_assert_cmpfloat(fabs(state_of(bench).position_steps - 100 * to_deg), <=, 1);
}

static void recovers(struct bench *bench) {
    g_assert_false(axis_is_homed(bench->axis));
    fail_with(bench, (struct virtual_modbus_faults){0});
    home(bench);
    go(bench, 12.5);
}

static void registers(void) {
    struct bench bench;
    begin(&bench, FALSE);
    open_axis(&bench, "");
    g_assert_cmpuint(state_of(&bench).speed, ==, 800);
    g_assert_cmpuint(state_of(&bench).accel, ==, 2000);
    conformance_pass(bench.clock, 0.3);
    g_assert_cmpint(state_of(&bench).watchdogs, >=, 3);
    home(&bench);
    go(&bench, -45.5);
    g_assert_cmpfloat(axis_position_deg(bench.axis), ==, -45.5);
    end(&bench);
}

static void one_connection(void) {
    struct bench bench;
    begin(&bench, FALSE);
    open_axis(&bench, "");
    open_bank(&bench, "n = 2\n");
    open_laser(&bench, "coil = 9\n");
    open_door(&bench, "");
    g_assert_cmpint(state_of(&bench).connections, ==, 1);
    end(&bench);
}

static void close_is_safe(void) {
    struct bench bench;
    begin(&bench, FALSE);
    open_axis(&bench, "");
    open_bank(&bench, "n = 2\n");
    open_laser(&bench, "coil = 9\n");
    home(&bench);
    lamps_set(bench.bank, 1, TRUE, NULL);
    expect(&bench, TRUE);
    laser_set(bench.laser, TRUE, NULL);
    expect(&bench, TRUE);
    g_assert_true(state_of(&bench).coils[1]);
    g_assert_true(state_of(&bench).coils[9]);
    start(&bench, 80);
    conformance_pass(bench.clock, 0.1);
    g_assert_true(state_of(&bench).moving);
    g_clear_pointer(&bench.axis, axis_close);
    g_clear_pointer(&bench.bank, lamps_close);
    g_clear_pointer(&bench.laser, laser_close);
    g_assert_false(state_of(&bench).coils[1]);
    g_assert_false(state_of(&bench).coils[9]);
    conformance_pass(bench.clock, 0.15);
    g_assert_false(state_of(&bench).moving);
    g_assert_cmpfloat(state_of(&bench).position_steps, <, 7900);
    end(&bench);
}

static void stall(void) {
    struct bench bench;
    begin(&bench, FALSE);
    open_axis(&bench, "");
    home(&bench);
    fail_with(&bench, (struct virtual_modbus_faults){.blocked = TRUE});
    start(&bench, 40);
    expect_error(&bench, DEVICE_ERROR_STALLED, "axis arc: stalled at 0.000° on its way to 40.000°");
    conformance_pass(bench.clock, 0.1);
    fail_with(&bench, (struct virtual_modbus_faults){0});
    conformance_pass(bench.clock, 0.1);
    g_assert_cmpfloat(state_of(&bench).position_steps, <, 3900); /* it was told to stop */
    recovers(&bench);
    end(&bench);
}

/* How it gets on is not known for a while, which ends nothing. */
static void unheard_for_a_while(void) {
    struct virtual_modbus_faults lapses[] = {
        {.silent = 4}, {.damaged = 4}, {.late = 3, .late_ms = 90}};
    struct bench bench;
    begin(&bench, TRUE);
    open_axis(&bench, "retries = 0\n");
    home(&bench);
    for (gsize i = 0; i < G_N_ELEMENTS(lapses); i++) {
        start(&bench, i % 2 ? -80 : 80);
        conformance_pass(bench.clock, 0.04); /* the command has been answered */
        fail_with(&bench, lapses[i]);
        expect(&bench, AXIS_ARRIVED);
        g_assert_true(axis_is_homed(bench.axis));
    }
    end(&bench);
}

static void unheard_for_long(void) {
    struct bench bench;
    begin(&bench, TRUE);
    open_axis(&bench, "retries = 1\nlost_ms = 400\n");
    home(&bench);
    start(&bench, 80);
    conformance_pass(bench.clock, 0.04);
    gint64 from = g_get_monotonic_time();
    fail_with(&bench, (struct virtual_modbus_faults){.silent = -1});
    expect_error(&bench, DEVICE_ERROR_TIMEOUT, "no answer within 60 ms (2 tries); check its power");
    g_assert_cmpint(bench.at_us - from, >, 380000);
    fail_with(&bench, (struct virtual_modbus_faults){0});
    conformance_pass(bench.clock, 0.5);
    recovers(&bench);
    end(&bench);
}

/* This program did not run for longer than a drive may be unheard: it has hardly been asked. */
static void held_up(void) {
    struct bench bench;
    begin(&bench, TRUE);
    open_axis(&bench, "retries = 0\nlost_ms = 400\n");
    home(&bench);
    start(&bench, 80);
    conformance_pass(bench.clock, 0.04);
    fail_with(&bench, (struct virtual_modbus_faults){.silent = 2});
    conformance_pass(bench.clock, 0.03); /* a poll is under way */
    g_usleep(600000);
    expect(&bench, AXIS_ARRIVED);
    g_assert_true(axis_is_homed(bench.axis));
    end(&bench);
}

static void drive_fault(void) {
    struct bench bench;
    begin(&bench, FALSE);
    open_axis(&bench, "");
    home(&bench);
    start(&bench, 80);
    conformance_pass(bench.clock, 0.05);
    virtual_modbus_set_drive_fault(bench.device, TRUE);
    expect_error(&bench, DEVICE_ERROR_STALLED, "the drive reports a fault (status 0x0006)");
    recovers(&bench);
    virtual_modbus_set_drive_fault(bench.device, TRUE); /* and while it stands */
    expect_error(&bench, DEVICE_ERROR_STALLED, "the drive reports a fault");
    recovers(&bench);
    end(&bench);
}

static void restart(void) {
    struct bench bench;
    begin(&bench, FALSE);
    open_axis(&bench, "");
    home(&bench);
    go(&bench, 10);
    virtual_modbus_restart(bench.device, 100);
    expect_error(&bench, DEVICE_ERROR_DISCONNECTED, "has lost its reference");
    recovers(&bench);
    g_assert_cmpint(state_of(&bench).connections, >=, 2);
    start(&bench, 80);
    conformance_pass(bench.clock, 0.05);
    virtual_modbus_restart(bench.device, 100);
    expect_error(&bench, DEVICE_ERROR_STALLED, "it stands at 0.000° instead of 80.000°");
    recovers(&bench);
    end(&bench);
}

/* Longer than any deadline: given up, and found again when it is back. */
static void long_loss(void) {
    struct bench bench;
    begin(&bench, FALSE);
    open_bank(&bench, "n = 2\n");
    virtual_modbus_restart(bench.device, 2200);
    g_usleep(20000);
    gint64 asked = g_get_monotonic_time();
    lamps_set(bench.bank, 0, TRUE, NULL);
    expect_error(&bench, DEVICE_ERROR_DISCONNECTED, "lamps bank: ");
    g_assert_cmpint(bench.at_us - asked, <, 1900000);
    g_assert_false(lamps_is_on(bench.bank, 0));
    conformance_pass(bench.clock, 1.2);
    lamps_set(bench.bank, 0, TRUE, NULL);
    expect(&bench, TRUE);
    g_assert_true(state_of(&bench).coils[0]);
    end(&bench);
}

static void lamp_faults(void) {
    struct bench bench;
    begin(&bench, FALSE);
    open_bank(&bench, "n = 2\nretries = 1\n");
    fail_with(&bench, (struct virtual_modbus_faults){.deaf = TRUE});
    lamps_set(bench.bank, 1, TRUE, NULL);
    expect_error(&bench, DEVICE_ERROR_PROTOCOL, "wrote 1 to 1, but it reads back as 0");
    g_assert_false(lamps_is_on(bench.bank, 1));
    fail_with(&bench, (struct virtual_modbus_faults){.refused = 1, .exception = 2});
    lamps_set(bench.bank, 1, TRUE, NULL);
    expect_error(&bench, DEVICE_ERROR_PROTOCOL, "it refused: Illegal data address");
    fail_with(&bench, (struct virtual_modbus_faults){.refused = 1, .exception = 6}); /* busy */
    lamps_set(bench.bank, 1, TRUE, NULL);
    expect(&bench, TRUE);
    fail_with(&bench, (struct virtual_modbus_faults){.silent = -1});
    lamps_set(bench.bank, 1, FALSE, NULL);
    expect_error(&bench, DEVICE_ERROR_TIMEOUT, "no answer within 60 ms (2 tries)");
    fail_with(&bench, (struct virtual_modbus_faults){.damaged = 1}); /* another transaction's */
    lamps_set(bench.bank, 0, TRUE, NULL);
    expect(&bench, TRUE);
    fail_with(&bench, (struct virtual_modbus_faults){.late = 1, .late_ms = 90});
    lamps_set(bench.bank, 0, FALSE, NULL);
    expect(&bench, FALSE);
    g_assert_false(state_of(&bench).coils[0]);
    end(&bench);
}

/* The answer is lost, the light is not: it is put out. */
static void laser_unanswered(void) {
    struct bench bench;
    begin(&bench, FALSE);
    open_laser(&bench, "coil = 9\nretries = 0\n");
    fail_with(&bench, (struct virtual_modbus_faults){.silent = 1});
    laser_set(bench.laser, TRUE, NULL);
    expect_error(&bench, DEVICE_ERROR_TIMEOUT, "laser l: ");
    conformance_pass(bench.clock, 0.4);
    g_assert_false(state_of(&bench).coils[9]);
    laser_set(bench.laser, TRUE, NULL);
    expect(&bench, TRUE);
    g_assert_true(state_of(&bench).coils[9]);
    end(&bench);
}

#define REGISTER "watchdog_register = 6\nwatchdog_after_s = 1\nwatchdog_scale = 10\n"
#define PULSES   "pulse_coil = 0x209\nwatchdog_after_s = 1\nwatchdog_scale = 10\n"
#define AFTER_US 1000000

static void open_lit(struct bench *bench, gboolean rtu, const char *keys) {
    begin(bench, rtu);
    open_laser(bench, keys);
    g_assert_cmpfloat(bench->laser->watchdog_s, ==, 1);
    laser_set(bench->laser, TRUE, NULL);
    expect(bench, TRUE);
    g_assert_true(state_of(bench).coils[9]);
}

/* Without the main loop; how long it took. */
static gint64 wait_dark(struct bench *bench, int coil) {
    gint64 from = g_get_monotonic_time(), limit = from + 20 * G_USEC_PER_SEC;
    while (state_of(bench).coils[coil] && g_get_monotonic_time() < limit)
        g_usleep(5000);
    return g_get_monotonic_time() - from;
}

static const char *const watchdog_keys[] = {"coil = 9\n" REGISTER, "coil = 9\n" PULSES};

/* Four times its time. */
static void watchdog_stays_on(void) {
    for (gsize i = 0; i < G_N_ELEMENTS(watchdog_keys); i++) {
        struct bench bench;
        open_lit(&bench, i, watchdog_keys[i]);
        gint64 until = g_get_monotonic_time() + 4 * AFTER_US;
        while (g_get_monotonic_time() < until) {
            conformance_pass(bench.clock, 0.02);
            g_assert_true(state_of(&bench).coils[9]);
        }
        g_assert_cmpint(bench.n, ==, 0);
        g_assert_cmpint(state_of(&bench).timeouts, ==, 0);
        g_assert_cmpint(state_of(&bench).pulses, >=, i ? 8 : 0);
        laser_set(bench.laser, FALSE, NULL);
        expect(&bench, FALSE);
        g_assert_false(state_of(&bench).coils[9]);
        int requests = state_of(&bench).requests;
        conformance_pass(bench.clock, 2e-6 * AFTER_US); /* nothing is asked for what is off */
        g_assert_cmpint(state_of(&bench).requests, ==, requests);
        end(&bench);
    }
}

/* The main loop hangs: as soon as it goes on it is told that the laser went off by itself, and that
 * does not come on again. */
static void watchdog_hang(void) {
    for (gsize i = 0; i < G_N_ELEMENTS(watchdog_keys); i++) {
        struct bench bench;
        open_lit(&bench, i, watchdog_keys[i]);
        g_assert_cmpint(wait_dark(&bench, 9), <, AFTER_US + 300000);
        int pulses = state_of(&bench).pulses;
        conformance_wait(bench.clock, &bench.n, 2, 10);
        g_assert_false(laser_is_on(bench.laser));
        conformance_pass(bench.clock, 1e-6 * AFTER_US);
        g_assert_false(state_of(&bench).coils[9]);
        g_assert_cmpint(state_of(&bench).pulses, <=, pulses + 1);
        end(&bench);
    }
}

/* What the listener is told: an "on" that failed, then off. */
static void watchdog_lost(void) {
    struct bench bench;
    open_lit(&bench, FALSE, watchdog_keys[0]);
    wait_dark(&bench, 9);
    conformance_wait(bench.clock, &bench.n, 1, 10);
    g_assert_cmpint(bench.event, ==, TRUE);
    expect_error(&bench, DEVICE_ERROR_PROTOCOL,
                 "laser l: not known to be on any more: tcp:127.0.0.1:");
    expect(&bench, FALSE);
    end(&bench);
}

static void watchdog_cut(void) {
    for (gsize i = 0; i < G_N_ELEMENTS(watchdog_keys); i++) {
        struct bench bench;
        open_lit(&bench, FALSE, watchdog_keys[i]);
        conformance_pass(bench.clock, 2e-6 * AFTER_US);
        g_assert_true(state_of(&bench).coils[9]);
        fail_with(&bench, (struct virtual_modbus_faults){.cut = TRUE});
        g_assert_cmpint(wait_dark(&bench, 9), <, AFTER_US + 300000);
        conformance_wait(bench.clock, &bench.n, 1, 10);
        g_assert_error(bench.error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT);
        g_assert_cmpint(bench.event, ==, TRUE);
        end(&bench);
    }
}

/* One answer that is lost, or late, does not put it out. */
static void watchdog_lapses(void) {
    static const struct virtual_modbus_faults lapses[] = {
        {.silent = 1}, {.damaged = 1}, {.late = 1, .late_ms = 90}};
    for (gsize i = 0; i < 2 * G_N_ELEMENTS(lapses); i++) {
        struct bench bench;
        open_lit(&bench, TRUE, watchdog_keys[i % 2]);
        fail_with(&bench, lapses[i / 2]);
        conformance_pass(bench.clock, 1.6e-6 * AFTER_US);
        g_assert_true(state_of(&bench).coils[9]);
        g_assert_cmpint(bench.n, ==, 0);
        end(&bench);
    }
}

/* One asking fails altogether; the next is still in time. */
static void watchdog_patience(void) {
    struct bench bench;
    begin(&bench, FALSE);
    open_laser(&bench, "coil = 9\nwatchdog_register = 6\nwatchdog_after_s = 3\n"
                       "watchdog_scale = 10\n");
    laser_set(bench.laser, TRUE, NULL);
    expect(&bench, TRUE);
    fail_with(&bench, (struct virtual_modbus_faults){.silent = -1});
    conformance_pass(bench.clock, 2.2);
    fail_with(&bench, (struct virtual_modbus_faults){0});
    conformance_pass(bench.clock, 2);
    g_assert_true(state_of(&bench).coils[9]);
    g_assert_cmpint(bench.n, ==, 0);
    end(&bench);
}

/* A program of its own, on the virtual board of the test. */
static void killed_child(void) {
    const char *bus = g_getenv("MESORIG_TEST_BUS"), *keys = g_getenv("MESORIG_TEST_KEYS");
    if (!bus)
        return;
    struct bench bench = {.clock = clock_new_real()};
    g_autofree char *text = modbus_rig_section(bus, "laser l", keys);
    const struct conformance with = {.section = text, .path = "/rig/rig.conf"};
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(&with, "", &section);
    bench.laser = laser_open(&modbus_laser_driver, section, NULL, bench.clock, NULL);
    laser_listen(bench.laser, on_laser, &bench);
    laser_set(bench.laser, TRUE, NULL);
    expect(&bench, TRUE);
    g_print("lit\n");
    fflush(stdout);
    kill(getpid(), SIGKILL);
}

static void watchdog_killed(void) {
    for (gsize i = 0; i < G_N_ELEMENTS(watchdog_keys); i++) {
        struct bench bench;
        begin(&bench, FALSE);
        g_setenv("MESORIG_TEST_BUS", virtual_modbus_bus(bench.device), TRUE);
        g_setenv("MESORIG_TEST_KEYS", watchdog_keys[i], TRUE);
        g_test_trap_subprocess("/modbus/watchdog/killed/child", 0, G_TEST_SUBPROCESS_DEFAULT);
        g_test_trap_assert_stdout("*lit*");
        g_unsetenv("MESORIG_TEST_BUS");
        g_assert_cmpint(wait_dark(&bench, 9), <, AFTER_US + 300000);
        end(&bench);
    }
}

static void watchdog_lamps(void) {
    static const char *const keys[] = {
        "n = 3\nfirst_coil = 4\n" REGISTER,
        "n = 3\nfirst_coil = 4\npulse_coil = 516\nwatchdog_after_s = 1\nwatchdog_scale = 10\n"};
    for (gsize i = 0; i < G_N_ELEMENTS(keys); i++) {
        struct bench bench;
        begin(&bench, FALSE);
        open_bank(&bench, keys[i]);
        g_assert_cmpfloat(bench.bank->watchdog_s, ==, 1);
        for (int lamp = 0; lamp < 3; lamp++) {
            lamps_set(bench.bank, lamp, TRUE, NULL);
            expect(&bench, TRUE);
        }
        lamps_set(bench.bank, 1, FALSE, NULL);
        expect(&bench, FALSE);
        conformance_pass(bench.clock, 3e-6 * AFTER_US);
        for (int lamp = 0; lamp < 3; lamp++)
            g_assert_cmpint(state_of(&bench).coils[4 + lamp], ==, lamp != 1);
        g_assert_cmpint(bench.n, ==, 0);
        g_assert_cmpint(wait_dark(&bench, 4), <, AFTER_US + 300000);
        g_assert_cmpint(wait_dark(&bench, 6), <, 300000);
        conformance_wait(bench.clock, &bench.n, 1, 10);
        g_assert_cmpint(bench.event, ==, TRUE);
        expect_error(&bench, DEVICE_ERROR_PROTOCOL, "lamps bank: not known to be on any more");
        expect(&bench, FALSE);
        for (int lamp = 0; lamp < 3; lamp++)
            g_assert_false(lamps_is_on(bench.bank, lamp));
        end(&bench);
    }
}

/* A drive that is not heard of brakes; while it is polled it goes its way. */
static void watchdog_axis(void) {
    struct bench bench;
    begin(&bench, FALSE);
    open_axis(&bench, REGISTER);
    home(&bench);
    conformance_pass(bench.clock, 3e-6 * AFTER_US);
    g_assert_cmpint(state_of(&bench).timeouts, ==, 0);
    g_usleep(AFTER_US + 300000);
    g_assert_cmpint(state_of(&bench).timeouts, ==, 1);
    end(&bench);
}

static void open_refused(struct bench *bench, const char *keys, GQuark domain, int code,
                         const char *words) {
    g_autoptr(Config) config = NULL;
    const struct config_section *section = read_section(bench->device, "laser l", keys, &config);
    GError *error = NULL;
    g_assert_null(laser_open(&modbus_laser_driver, section, NULL, bench->clock, &error));
    g_assert_error(error, domain, code);
    if (!strstr(error->message, words))
        g_error("\"%s\" does not say \"%s\"", error->message, words);
    g_clear_error(&error);
}

static void watchdog_refused(void) {
    struct bench bench;
    begin(&bench, FALSE);
    /* The coil is written and read first. */
    fail_with(&bench, (struct virtual_modbus_faults){.skip = 2, .refused = 1, .exception = 2});
    open_refused(&bench, "coil = 9\n" REGISTER, DEVICE_ERROR, DEVICE_ERROR_PROTOCOL,
                 "laser l: watchdog_register: tcp:");
    fail_with(&bench, (struct virtual_modbus_faults){.skip = 3, .refused = 1, .exception = 3});
    open_refused(&bench, "coil = 9\n" REGISTER, DEVICE_ERROR, DEVICE_ERROR_PROTOCOL,
                 "writing holding register 6 (0x0006): it refused: Illegal data value");
    fail_with(&bench, (struct virtual_modbus_faults){0});
    open_refused(&bench, "coil = 9\nwatchdog_register = 200\n", DEVICE_ERROR, DEVICE_ERROR_PROTOCOL,
                 "reading holding register 200 (0x00c8): it refused: Illegal data address");
    open_refused(&bench, "coil = 9\nwatchdog_register = 20\n", DEVICE_ERROR, DEVICE_ERROR_PROTOCOL,
                 "wrote 3 to 20, but it reads back as 0");
    open_refused(&bench,
                 "coil = 9\nwatchdog_register = 6\nwatchdog_after_s = 0.3\n"
                 "watchdog_scale = 10\n",
                 CONFIG_ERROR, CONFIG_ERROR_VALUE, "watchdog_after_s: 0.3 s is too short");
    open_refused(&bench, "coil = 9\nwatchdog_register = 6\nwatchdog_scale = 100000\n", CONFIG_ERROR,
                 CONFIG_ERROR_VALUE,
                 "watchdog_scale: 3 s × 100000 is not a number from 1 to 65535");
    open_refused(&bench, "coil = 9\nwatchdog_register = 6\npulse_coil = 0x209\n", CONFIG_ERROR,
                 CONFIG_ERROR_VALUE, "pulse_coil: is given beside watchdog_register");
    open_bank(&bench, "n = 2\n");
    open_refused(&bench, "coil = 9\n" REGISTER, CONFIG_ERROR, CONFIG_ERROR_VALUE,
                 "watchdog_register: [lamps bank] has another watchdog for the same board");
    /* A board without pulses. */
    open_laser(&bench, "coil = 9\npulse_coil = 0x300\n");
    laser_set(bench.laser, TRUE, NULL);
    expect_error(&bench, DEVICE_ERROR_PROTOCOL,
                 "writing a time to coil 768 (0x0300): it refused: Illegal data");
    g_clear_pointer(&bench.laser, laser_close);
    open_laser(&bench, watchdog_keys[1]);
    fail_with(&bench, (struct virtual_modbus_faults){.deaf = TRUE});
    laser_set(bench.laser, TRUE, NULL);
    expect_error(&bench, DEVICE_ERROR_PROTOCOL, "wrote 10, but coil 9 reads as off");
    end(&bench);
}

/* Left on by a program that could not reach it any more: a section whose watchdog is wrong switches
 * it off all the same. */
static void watchdog_dark_first(void) {
    struct bench bench;
    begin(&bench, FALSE);
    open_laser(&bench, "coil = 9\n");
    laser_set(bench.laser, TRUE, NULL);
    expect(&bench, TRUE);
    fail_with(&bench, (struct virtual_modbus_faults){.cut = TRUE});
    g_clear_pointer(&bench.laser, laser_close);
    g_assert_true(state_of(&bench).coils[9]);
    fail_with(&bench, (struct virtual_modbus_faults){0});
    open_refused(&bench, "coil = 9\nwatchdog_register = 6\nwatchdog_after_s = 0.1\n", CONFIG_ERROR,
                 CONFIG_ERROR_VALUE, "watchdog_scale: 0.1 s × 1 is not a number from 1 to 65535");
    g_assert_false(state_of(&bench).coils[9]);
    end(&bench);
}

/* The board was without power, came back and has forgotten its timeout: no light without it. */
static void watchdog_forgotten(void) {
    struct bench bench;
    begin(&bench, FALSE);
    open_laser(&bench, watchdog_keys[0]);
    virtual_modbus_restart(bench.device, 20);
    g_usleep(50000);
    laser_set(bench.laser, TRUE, NULL);
    conformance_wait(bench.clock, &bench.n, 1, 10);
    bench.n = 0;
    conformance_wait(bench.clock, &bench.n, 1, 10);
    expect_error(&bench, DEVICE_ERROR_PROTOCOL,
                 "reading holding register 6 (0x0006): 6 was set to 10, but it reads as 0");
    expect(&bench, FALSE);
    g_assert_false(state_of(&bench).coils[9]);
    end(&bench);
}

static void door(void) {
    struct bench bench;
    begin(&bench, FALSE);
    open_door(&bench, "input = 3\nlost_ms = 200\npoll_ms = 5\n");
    g_assert_false(interlock_is_closed(bench.door));
    virtual_modbus_set_input(bench.device, 3, TRUE);
    expect(&bench, TRUE);
    virtual_modbus_set_input(bench.device, 3, FALSE);
    expect(&bench, FALSE);
    virtual_modbus_set_input(bench.device, 3, TRUE);
    expect(&bench, TRUE);
    gint64 lost = g_get_monotonic_time();
    fail_with(&bench, (struct virtual_modbus_faults){.silent = -1});
    expect(&bench, FALSE);
    g_assert_cmpint(bench.at_us - lost, <, 600000);
    fail_with(&bench, (struct virtual_modbus_faults){0});
    expect(&bench, TRUE);
    end(&bench);
}

static void refuse(const struct axis_driver *driver, const char *text, GQuark domain, int code,
                   const char *words, gboolean virtual_clock) {
    g_autoptr(Clock) clock = virtual_clock ? clock_new_virtual() : clock_new_real();
    const struct conformance with = {.section = text, .path = "/rig/rig.conf"};
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(&with, "", &section);
    GError *error = NULL;
    g_assert_null(axis_open(driver, section, NULL, clock, &error));
    g_assert_error(error, domain, code);
    if (!strstr(error->message, words))
        g_error("\"%s\" does not say \"%s\"", error->message, words);
    g_clear_error(&error);
}

/* Each row is added to a good section, whose keys are on lines 2 to 34. */
static void bad_configuration(void) {
    static const struct {
        const char *replace, *with;
        enum config_error code;
        const char *words;
    } rows[] = {
        {"steps_per_deg = 100", "steps_per_deg = 0", CONFIG_ERROR_VALUE,
         "/rig/rig.conf:10: [axis arc] steps_per_deg: must not be 0"},
        {"start = 2=1", "start = 2", CONFIG_ERROR_VALUE, "start: \"2\" is not ADDRESS=VALUE"},
        {"start = 2=1", "start = 2=65536", CONFIG_ERROR_VALUE, "start: \"2=65536\""},
        {"start = 2=1", "start = 0xffff=1,2", CONFIG_ERROR_VALUE, "start: \"0xffff=1,2\""},
        {"start = 2=1", "start = 0x=1", CONFIG_ERROR_VALUE, "start: \"0x=1\""},
        {"start = 2=1", "start = ", CONFIG_ERROR_VALUE, "start: is empty"},
        {"start = 2=1", "", CONFIG_ERROR_MISSING, "start: must be given"},
        {"stop = 2=3", "stop = 2=1;2=1;2=1;2=1;2=1;2=1;2=1", CONFIG_ERROR_VALUE,
         "stop: more than 6 writes"},
        {"min_deg = -90", "min_deg = 90", CONFIG_ERROR_VALUE, "min_deg: 90 is not below"},
        {"speed_scale = 2", "speed_scale = 1000", CONFIG_ERROR_VALUE,
         "speed_scale: 400000 does not fit into its 16 bits"},
        {"moving_bit = 0", "moving_bit = 16", CONFIG_ERROR_VALUE, "moving_bit: 16 is out of range"},
        {"target_register = 0", "target_register = 0x1ffff", CONFIG_ERROR_VALUE, "target_register"},
        {"unit = 7", "unit = 0", CONFIG_ERROR_VALUE, "/rig/rig.conf:3: [axis arc] unit"},
        {"poll_ms = 5", "poll_s = 5", CONFIG_ERROR_UNKNOWN, "write poll_ms"},
    };
    g_autoptr(VirtualModbus) device = modbus_rig_device(FALSE);
    g_autofree char *good = modbus_rig_section(virtual_modbus_bus(device), "axis arc", RIG_AXIS);
    for (gsize i = 0; i < G_N_ELEMENTS(rows); i++) {
        g_autoptr(GString) text = g_string_new(good);
        g_assert_cmpuint(g_string_replace(text, rows[i].replace, rows[i].with, 1), ==, 1);
        refuse(&modbus_axis_driver, text->str, CONFIG_ERROR, (int)rows[i].code, rows[i].words,
               FALSE);
    }
    refuse(&modbus_axis_driver, good, CONFIG_ERROR, CONFIG_ERROR_VALUE, "set clock = real", TRUE);
}

static void refuse_bus(const char *bus, int code, const char *words) {
    g_autofree char *text = g_strdup_printf("[axis arc]\nunit = 9\nretries = 1\nbus = %s\n"
                                            "timeout_ms = 60\nlate_ms = 100\n" RIG_AXIS,
                                            bus);
    refuse(&modbus_axis_driver, text, DEVICE_ERROR, code, words, FALSE);
}

static void no_such_bus(void) {
    g_autoptr(VirtualModbus) tcp = modbus_rig_device(FALSE);
    g_autoptr(VirtualModbus) rtu = modbus_rig_device(TRUE);
    refuse_bus("/dev/no-such-port", DEVICE_ERROR_DISCONNECTED,
               "/rig/rig.conf:4: [axis arc] bus: cannot open /dev/no-such-port: No such file");
    refuse_bus("tcp:127.0.0.1:1", DEVICE_ERROR_DISCONNECTED,
               "/rig/rig.conf:4: [axis arc] bus: cannot open tcp:127.0.0.1:1");
    refuse_bus("tcp:[::1", DEVICE_ERROR_DISCONNECTED, "is no Modbus line");
    refuse_bus(virtual_modbus_bus(tcp), DEVICE_ERROR_TIMEOUT,
               "unit 9, writing holding register 100 (0x0064): no answer within 60 ms (2 tries)");
    refuse_bus(virtual_modbus_bus(rtu), DEVICE_ERROR_TIMEOUT, "check its power, its address");
}

static void other_settings(void) {
    struct bench bench;
    begin(&bench, FALSE);
    open_bank(&bench, "n = 2\n");
    g_autofree char *text =
        modbus_rig_section(virtual_modbus_bus(bench.device), "axis arc", RIG_AXIS "baud = 9600\n");
    refuse(&modbus_axis_driver, text, CONFIG_ERROR, CONFIG_ERROR_VALUE,
           "/rig/rig.conf:2: [axis arc] bus: another section opens", FALSE);
    end(&bench);
}

/* Presets are sections to copy: every key of theirs is one of the driver's. */
static void presets(void) {
    g_autoptr(GDir) dir = g_dir_open(SOURCE_DIR "/etc/devices", 0, NULL);
    int n = 0;
    g_assert_nonnull(dir);
    for (const char *name; (name = g_dir_read_name(dir));) {
        g_autofree char *path = g_build_filename(SOURCE_DIR "/etc/devices", name, NULL);
        GError *error = NULL;
        g_autoptr(Config) config = config_load(path, &error);
        g_assert_no_error(error);
        gsize n_sections;
        const struct config_section *section = config_sections(config, &n_sections);
        g_assert_cmpuint(n_sections, ==, 1);
        const char *driver = config_value(section, "driver", NULL);
        if (!g_str_has_prefix(driver, "modbus-"))
            continue;
        const struct driver_info *info = g_str_equal(driver, "modbus-axis")
                                             ? &modbus_axis_driver.info
                                             : &modbus_relays_driver.info;
        const char *const also[] = {"driver", NULL};
        g_autofree gpointer priv = g_malloc0(info->priv_size);
        g_assert_cmpstr(info->name, ==, driver);
        options_parse(info->options, section, also, priv, &error);
        g_assert_no_error(error);
        options_clear(info->options, priv);
        n++;
    }
    g_assert_cmpint(n, ==, 5);
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/modbus/registers", registers);
    g_test_add_func("/modbus/one-connection", one_connection);
    g_test_add_func("/modbus/close-is-safe", close_is_safe);
    g_test_add_func("/modbus/stall", stall);
    g_test_add_func("/modbus/unheard-for-a-while", unheard_for_a_while);
    g_test_add_func("/modbus/unheard-for-long", unheard_for_long);
    g_test_add_func("/modbus/held-up", held_up);
    g_test_add_func("/modbus/drive-fault", drive_fault);
    g_test_add_func("/modbus/restart", restart);
    g_test_add_func("/modbus/long-loss", long_loss);
    g_test_add_func("/modbus/lamp-faults", lamp_faults);
    g_test_add_func("/modbus/laser-unanswered", laser_unanswered);
    g_test_add_func("/modbus/watchdog/stays-on", watchdog_stays_on);
    g_test_add_func("/modbus/watchdog/hang", watchdog_hang);
    g_test_add_func("/modbus/watchdog/lost", watchdog_lost);
    g_test_add_func("/modbus/watchdog/cut", watchdog_cut);
    g_test_add_func("/modbus/watchdog/lapses", watchdog_lapses);
    g_test_add_func("/modbus/watchdog/patience", watchdog_patience);
    g_test_add_func("/modbus/watchdog/killed", watchdog_killed);
    g_test_add_func("/modbus/watchdog/killed/child", killed_child);
    g_test_add_func("/modbus/watchdog/lamps", watchdog_lamps);
    g_test_add_func("/modbus/watchdog/axis", watchdog_axis);
    g_test_add_func("/modbus/watchdog/refused", watchdog_refused);
    g_test_add_func("/modbus/watchdog/dark-first", watchdog_dark_first);
    g_test_add_func("/modbus/watchdog/forgotten", watchdog_forgotten);
    g_test_add_func("/modbus/door", door);
    g_test_add_func("/modbus/bad-configuration", bad_configuration);
    g_test_add_func("/modbus/no-such-bus", no_such_bus);
    g_test_add_func("/modbus/other-settings", other_settings);
    g_test_add_func("/modbus/presets", presets);
    return g_test_run();
}
