#include "lib/modbus_bench.h"
#include "lib/skip.h"
#include "lib/test.h"
#include "lib/wait.h"

#include <net/if.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

/* "Off" and "stop" on a Modbus line that fails: when the line works again, a command that was
 * carried out without an answer is undone. "Off" and "stop" are sent before all commands that wait.
 */

#define DEAD_S 5

/* The light of the coil, or of several. */
static int n_lit(struct bench *bench) {
    const struct virtual_modbus_state state = bench_state(bench);
    int n = 0;
    for (int i = 0; i < VIRTUAL_MODBUS_BITS; i++)
        n += state.coils[i];
    return n;
}

static void wait_errors(struct bench *bench, int n) {
    conformance_wait(bench->clock, &bench->n, n, 10);
    g_assert_nonnull(bench->error);
    bench->n = 0;
}

/* The line is dead for some seconds, and then works. Until then no light is reported as off,
 * whatever the truth is. */
static void dead_then_well(struct bench *bench, const char *what) {
    bench_fail(bench, .cut = TRUE);
    for (double s = 0; s < DEAD_S; s += 0.25) {
        conformance_pass(bench->clock, 0.25);
        for (int i = 0; bench->bank && i < bench->bank->n; i++)
            g_assert_cmpint(lamps_light(bench->bank, i), !=, LIGHT_ON);
        if (bench->laser)
            g_assert_cmpint(laser_light(bench->laser), ==, LIGHT_UNSAFE);
    }
    bench_fail(bench, 0);
    const gint64 from = g_get_monotonic_time();
    UNTIL (n_lit(bench) == 0)
        conformance_pass(bench->clock, 0.005);
    const double dark_s = (double)(g_get_monotonic_time() - from) * 1e-6;
    const double safe_s = dark_s + bench_wait_safe(bench);
    g_test_message("%s: dark %.2f s after the line worked again, confirmed after %.2f s", what,
                   dark_s, safe_s);
    g_assert_cmpint(bench->n, ==, 0);
}

static void laser_on(struct bench *bench, gconstpointer unused) {
    bench_open_laser(bench, "coil = 9\n");
    bench_fail(bench, .silent = -1);
    laser_set(bench->laser, TRUE, NULL);
    wait_errors(bench, 1);
    g_assert_true(bench_state(bench).coils[9]);
    dead_then_well(bench, "laser on, answer lost");
    g_assert_cmpint(laser_light(bench->laser), ==, LIGHT_OFF);
}

static void laser_off(struct bench *bench, gconstpointer unused) {
    bench_open_laser(bench, "coil = 9\n");
    laser_set(bench->laser, TRUE, NULL);
    bench_expect(bench, TRUE);
    bench_fail(bench, .cut = TRUE);
    laser_set(bench->laser, FALSE, NULL);
    wait_errors(bench, 1);
    g_assert_true(bench_state(bench).coils[9]);
    dead_then_well(bench, "laser off, not heard");
    g_assert_cmpint(laser_light(bench->laser), ==, LIGHT_OFF);
}

/* An axis polls the same line all the time. */
static void busy_line(struct bench *bench, gconstpointer unused) {
    bench_open_axis(bench, "");
    bench_home(bench);
    bench_open_laser(bench, "coil = 9\n");
    laser_set(bench->laser, TRUE, NULL);
    bench_expect(bench, TRUE);
    bench_fail(bench, .cut = TRUE);
    laser_set(bench->laser, FALSE, NULL);
    while (laser_light(bench->laser) != LIGHT_UNSAFE)
        conformance_pass(bench->clock, 0.01);
    bench->n = 0;
    dead_then_well(bench, "laser off, not heard, on a busy line");
    g_assert_cmpint(laser_light(bench->laser), ==, LIGHT_OFF);
}

static void lamp_on(struct bench *bench, gconstpointer unused) {
    bench_open_bank(bench, "n = 3\nfirst_coil = 4\n");
    bench_fail(bench, .silent = -1);
    lamps_set(bench->bank, 1, TRUE, NULL);
    wait_errors(bench, 1);
    g_assert_true(bench_state(bench).coils[5]);
    dead_then_well(bench, "lamp on, answer lost");
    g_assert_cmpint(lamps_light(bench->bank, 1), ==, LIGHT_OFF);
}

static void lamps_off(struct bench *bench, gconstpointer unused) {
    bench_open_bank(bench, "n = 3\nfirst_coil = 4\n");
    for (int i = 0; i < 3; i++) {
        lamps_set(bench->bank, i, TRUE, NULL);
        bench_expect(bench, TRUE);
    }
    bench_fail(bench, .cut = TRUE);
    lamps_all_off(bench->bank, NULL);
    wait_errors(bench, 1);
    g_assert_cmpint(n_lit(bench), ==, 3);
    dead_then_well(bench, "all lamps off, not heard");
    for (int i = 0; i < 3; i++)
        g_assert_cmpint(lamps_light(bench->bank, i), ==, LIGHT_OFF);
}

/* A board that forgets its watchdog's time: the light is lost, and its "off" is not heard. */
static void lost(struct bench *bench, gconstpointer unused) {
    bench_open_laser(bench, "coil = 9\nwatchdog_register = 6\nwatchdog_after_s = 1\n"
                            "watchdog_scale = 10\n");
    laser_set(bench->laser, TRUE, NULL);
    bench_expect(bench, TRUE);
    bench_fail(bench, .cut = TRUE);
    wait_errors(bench, 1); /* not known to be on any more */
    g_assert_cmpint(laser_light(bench->laser), ==, LIGHT_UNSAFE);
    wait_errors(bench, 1); /* the "off" */
    virtual_modbus_set_coil(bench->device, 9, TRUE);
    dead_then_well(bench, "laser lost");
    g_assert_cmpint(laser_light(bench->laser), ==, LIGHT_OFF);
}

/* It turns for longer than the line is dead. */
static void axis(struct bench *bench, gconstpointer unused) {
    bench_open_axis(bench, "wraps = yes\n");
    bench_home(bench);
    g_assert_true(axis_turn(bench->axis, 10000, 400, NULL));
    conformance_pass(bench->clock, 0.3);
    g_assert_true(bench_state(bench).moving);
    bench_fail(bench, .cut = TRUE);
    bench->n = 0; /* it has told where it was */
    g_assert_true(axis_stop(bench->axis, NULL));
    while (axis_is_moving(bench->axis))
        conformance_pass(bench->clock, 0.01);
    g_assert_cmpint(bench->event, ==, AXIS_FAULT);
    bench->n = 0;
    for (double s = 0; s < DEAD_S; s += 0.25) {
        conformance_pass(bench->clock, 0.25);
        g_assert_cmpint(axis_safety(bench->axis), ==, DEVICE_UNSAFE);
        g_assert_true(bench_state(bench).moving);
    }
    bench_fail(bench, 0);
    g_test_message("axis: stands %.2f s after the line worked again", bench_wait_safe(bench));
    g_assert_false(bench_state(bench).moving);
    g_assert_cmpfloat(bench_state(bench).position_steps, <, 900000);
    g_assert_cmpint(bench->n, ==, 0);
}

/* On a slow line the laser goes off before lamps that were asked for earlier go on. */
static void off_overtakes(struct bench *bench, gconstpointer unused) {
    bench_open_laser(bench, "coil = 15\n");
    const struct config_section *section;
    laser_set(bench->laser, TRUE, NULL);
    bench_expect(bench, TRUE);
    section = bench_section(bench, "lamps bank", "n = 8\n");
    bench->bank = lamps_open(&modbus_relays_driver, section, NULL, bench->clock, NULL);
    g_assert_nonnull(bench->bank);
    bench_fail(bench, .delay_us = 20000);
    for (int i = 0; i < 8; i++)
        g_assert_true(lamps_set(bench->bank, i, TRUE, NULL));
    laser_set(bench->laser, FALSE, NULL);
    bench_expect(bench, FALSE);
    g_assert_cmpint(n_lit(bench), <=, 2); /* one was under way, another may have begun since */
    while (n_lit(bench) < 8)
        conformance_pass(bench->clock, 0.005);
    g_assert_false(bench_state(bench).coils[15]);
}

/* All off drops every "on" that was not sent, of the same lamps. */
static void off_drops_on(struct bench *bench, gconstpointer unused) {
    bench_open_bank(bench, "n = 8\n");
    bench_fail(bench, .delay_us = 20000);
    for (int i = 0; i < 8; i++)
        g_assert_true(lamps_set(bench->bank, i, TRUE, NULL));
    const int requests = bench_state(bench).requests;
    lamps_all_off(bench->bank, NULL);
    conformance_wait(bench->clock, &bench->n, 9, 10);
    g_assert_cmpint(bench_state(bench).requests - requests, <=, 4);
    conformance_pass(bench->clock, 0.5);
    g_assert_cmpint(bench->n, ==, 9);
    g_assert_cmpint(n_lit(bench), ==, 0);
    for (int i = 0; i < 8; i++)
        g_assert_cmpint(lamps_light(bench->bank, i), ==, LIGHT_OFF);
    g_assert_false(device_is_unsafe(&bench->bank->device)); /* nothing has failed */
}

/* An "on" that waited for so long that it was given up is never sent. */
static void given_up(struct bench *bench, gconstpointer unused) {
    bench_open_laser(bench, "coil = 15\n");
    const struct config_section *section = bench_section(bench, "lamps bank", "n = 2\n");
    bench->bank = lamps_open(&modbus_relays_driver, section, NULL, bench->clock, NULL);
    g_assert_nonnull(bench->bank);
    bench_fail(bench, .cut = TRUE);
    for (int i = 0; i < 6; i++)
        g_assert_true(lamps_set(bench->bank, i % 2, TRUE, NULL));
    g_assert_true(laser_set(bench->laser, TRUE, NULL));
    bench_expect_error(bench, DEVICE_ERROR_TIMEOUT, "did not answer to \"on\" within 2 s");
    g_assert_cmpint(laser_light(bench->laser), ==, LIGHT_UNSAFE);
    bench_fail(bench, 0);
    const gint64 until = g_get_monotonic_time() + 3 * G_USEC_PER_SEC;
    UNTIL (g_get_monotonic_time() >= until && !device_is_unsafe(&bench->laser->device) &&
           !device_is_unsafe(&bench->bank->device)) {
        conformance_pass(bench->clock, 0.002);
        g_assert_false(bench_state(bench).coils[15]);
    }
    g_assert_cmpint(laser_light(bench->laser), ==, LIGHT_OFF);
    g_assert_cmpint(n_lit(bench), ==, 0);
    g_assert_cmpint(bench->n, ==, 0);
}

/* A move that was not sent is dropped by a stop. */
static void stop_drops_move(struct bench *bench, gconstpointer unused) {
    bench_open_axis(bench, "");
    bench_home(bench);
    const struct config_section *section = bench_section(bench, "lamps bank", "n = 8\n");
    bench->bank = lamps_open(&modbus_relays_driver, section, NULL, bench->clock, NULL);
    g_assert_nonnull(bench->bank);
    bench_fail(bench, .delay_us = 20000);
    for (int i = 0; i < 8; i++)
        g_assert_true(lamps_set(bench->bank, i, TRUE, NULL));
    g_assert_true(axis_move(bench->axis, 80, NULL));
    g_assert_true(axis_stop(bench->axis, NULL));
    bench_expect(bench, AXIS_STOPPED);
    g_assert_cmpfloat(axis_position_deg(bench->axis), ==, 0);
    conformance_pass(bench->clock, 1);
    g_assert_cmpfloat(bench_state(bench).position_steps, ==, 0);
    g_assert_true(axis_is_homed(bench->axis));
    g_assert_cmpint(bench->n, ==, 0);
}

/* A relay that does not go off is not fed meanwhile, for longer than the time between feedings. */
static void not_fed(struct bench *bench, gconstpointer unused) {
    bench_open_laser(bench, "coil = 9\npulse_coil = 0x209\n" RIG_AFTER);
    laser_set(bench->laser, TRUE, NULL);
    bench_expect(bench, TRUE);
    conformance_pass(bench->clock, 0.5);
    g_assert_cmpint(bench_state(bench).pulses, >, 1);
    bench_fail(bench, .refused = 6, .exception = 4);
    laser_set(bench->laser, FALSE, NULL);
    bench_expect_error(bench, DEVICE_ERROR_PROTOCOL, "the device refused: Slave device or server");
    g_assert_cmpint(laser_light(bench->laser), ==, LIGHT_UNSAFE);
    const int pulses = bench_state(bench).pulses, requests = bench_state(bench).requests;
    bench_wait_safe(bench);
    g_assert_cmpint(laser_light(bench->laser), ==, LIGHT_OFF);
    g_assert_false(bench_state(bench).coils[9]);
    g_assert_cmpint(bench_state(bench).pulses, ==, pulses);
    /* Five attempts were refused; the sixth was written and read back. */
    g_assert_cmpint(bench_state(bench).requests - requests, <=, 7);
    g_assert_cmpint(bench->n, ==, 0);
}

/* Plugs the network cable in or out, in a network of this process only. */
static gboolean plug(gboolean in) {
    struct ifreq request = {.ifr_name = "lo", .ifr_flags = in ? IFF_UP : 0};
    int any = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    gboolean ok = ioctl(any, SIOCSIFFLAGS, &request) == 0;
    close(any);
    return ok;
}

static gboolean enter_network(void) {
    return unshare(CLONE_NEWUSER | CLONE_NEWNET) == 0 && plug(TRUE);
}

TEST(cable_child) {
    if (!g_test_subprocess())
        return;
    struct bench bench;
    g_assert_true(enter_network());
    bench_begin(&bench, NULL);
    bench_open_laser(&bench, "coil = 9\n");
    laser_set(bench.laser, TRUE, NULL);
    bench_expect(&bench, TRUE);
    g_assert_true(plug(FALSE));
    laser_set(bench.laser, FALSE, NULL);
    wait_errors(&bench, 1);
    conformance_pass(bench.clock, 7);
    g_assert_true(bench_state(&bench).coils[9]);
    g_assert_cmpint(laser_light(bench.laser), ==, LIGHT_UNSAFE);
    g_assert_cmpint(bench_state(&bench).connections, ==, 1);
    g_assert_true(plug(TRUE));
    g_print("safe %.2f s after the cable was plugged in", bench_wait_safe(&bench));
    g_assert_false(bench_state(&bench).coils[9]);
    g_assert_cmpint(bench_state(&bench).connections, ==, 2);
    g_print(", dark\n");
    bench_end(&bench, NULL);
}

/* The network's cable is unplugged for seven seconds. The connection would come back only when the
 * kernel repeats its packets, with pauses of up to as long as the cable was out: the line makes a
 * new one. */
static void cable(void) {
    int status = 0;
    pid_t probe = fork();
    if (probe == 0)
        _exit(!enter_network());
    g_assert_cmpint(waitpid(probe, &status, 0), ==, probe);
    if (status != 0) {
        test_skip_or_fail("no name spaces of networks");
        return;
    }
    g_test_trap_subprocess("/modbus-dark/cable-child", 0, G_TEST_SUBPROCESS_INHERIT_STDERR);
    g_test_trap_assert_passed();
    g_test_trap_assert_stdout("*dark*");
}

static const struct {
    const char *name;
    void (*run)(struct bench *bench, gconstpointer unused);
    gboolean rtu; /* too */
} tests[] = {
    {"laser-on", laser_on, TRUE},
    {"laser-off", laser_off, TRUE},
    {"lamp-on", lamp_on, TRUE},
    {"busy-line", busy_line, TRUE},
    {"lamps-off", lamps_off},
    {"lost", lost, TRUE},
    {"axis", axis, TRUE},
    {"off-overtakes", off_overtakes},
    {"off-drops-on", off_drops_on},
    {"given-up", given_up},
    {"stop-drops-move", stop_drops_move},
    {"not-fed", not_fed},
};

BEFORE_TESTS {
    for (gsize i = 0; i < 2 * G_N_ELEMENTS(tests); i++) {
        const gboolean rtu = i % 2;
        if (rtu && !tests[i / 2].rtu)
            continue;
        g_autofree char *path =
            g_strdup_printf("/modbus/dark/%s/%s", rtu ? "rtu" : "tcp", tests[i / 2].name);
        g_test_add(path, struct bench, GINT_TO_POINTER(rtu), bench_begin, tests[i / 2].run,
                   bench_end);
    }
    g_test_add_func("/modbus/dark/tcp/cable", cable);
}
