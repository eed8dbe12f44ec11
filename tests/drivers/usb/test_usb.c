#include "conformance/conformance.h"

#include "lib/lock_keeper.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/test.h"
#include "lib/wait.h"
#include "usb/relays.h"
#include "usb/tic.h"
#include "virtual/testbed.h"
#include "virtual/usb_relays.h"
#include "virtual/usb_tic.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/*
 * Faults of the USB drivers against models of their devices, in real time. The Tic's axis has 100
 * microsteps to the degree, homes towards a switch at 0° and has another at 40°.
 */
#define STEPS_PER_DEG 100.0
#define TRAVEL        4000.0

static const struct conformance tic_with = {
    .section = "[axis test]\ndriver = tic-axis\nsteps_per_deg = 100\nmin_deg = 0\nmax_deg = 38\n"
               "speed_deg_s = 60\naccel_deg_s2 = 1200\npoll_ms = 10\n",
};

struct heard {
    int n;
    int last; /* axis event, or lamp */
    GError *error;
};

static void note(struct heard *heard, int last, const GError *error) {
    heard->n++;
    heard->last = last;
    g_clear_error(&heard->error);
    if (error)
        heard->error = g_error_copy(error);
}

static void on_axis(Axis *axis, enum axis_event event, const GError *error, gpointer data) {
    note(data, event, error);
}

static void on_lamp(LampBank *bank, int index, gboolean on, gint64 at_us, const GError *error,
                    gpointer data) {
    note(data, index, error);
}

static void on_laser(Laser *laser, gboolean on, const GError *error, gpointer data) {
    note(data, on, error);
}

struct rig {
    Clock *clock;
    VirtualTic *tic;
    Axis *axis;
    struct heard heard;
};

static Axis *open_tic(Clock *clock, const char *more, GError **error) {
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(&tic_with, more, &section);
    return axis_open(&tic_axis_driver, section, NULL, clock, error);
}

static void begin(struct rig *rig, gconstpointer more) {
    *rig = (struct rig){.clock = clock_new_real()};
    rig->tic = virtual_tic_new("00123456", 1, TRAVEL, 100);
    rig->axis = ok(open_tic(rig->clock, more, ERR));
    axis_listen(rig->axis, on_axis, &rig->heard);
}

static void end(struct rig *rig, gconstpointer unused) {
    g_clear_pointer(&rig->axis, axis_close);
    g_clear_pointer(&rig->tic, virtual_tic_free);
    g_clear_pointer(&rig->clock, clock_unref);
    g_clear_error(&rig->heard.error);
}

static void expect(struct rig *rig, enum axis_event event) {
    conformance_wait(rig->clock, &rig->heard.n, 1, 10);
    if (event != AXIS_FAULT)
        g_assert_no_error(rig->heard.error);
    g_assert_cmpint(rig->heard.last, ==, event);
    g_assert_cmpint(rig->heard.n, ==, 1);
    rig->heard.n = 0;
}

static void expect_fault(struct rig *rig, enum device_error code, const char *text) {
    expect(rig, AXIS_FAULT);
    g_assert_error(rig->heard.error, DEVICE_ERROR, (int)code);
    g_assert_true(g_str_has_prefix(rig->heard.error->message, "axis test: "));
    if (!strstr(rig->heard.error->message, text))
        g_error("\"%s\" does not say \"%s\"", rig->heard.error->message, text);
    g_assert_false(axis_is_homed(rig->axis));
    g_assert_false(axis_is_moving(rig->axis));
    /* One cause, one fault. */
    conformance_pass(rig->clock, 0.1);
    g_assert_cmpint(rig->heard.n, ==, 0);
}

static void wait_confirmed(Clock *clock, const struct device *device) {
    UNTIL (!device_is_unsafe(device))
        conformance_pass(clock, 0.01);
}

static void home(struct rig *rig) {
    ok(axis_home(rig->axis, ERR));
    expect(rig, AXIS_HOMED);
}

static void start(struct rig *rig, double deg) {
    ok(axis_move(rig->axis, deg, ERR));
}

static void start_and_pass(struct rig *rig, double deg) {
    start(rig, deg);
    conformance_pass(rig->clock, 0.1);
    g_assert_cmpint(rig->heard.n, ==, 0);
    g_assert_cmpfloat(virtual_tic_speed(rig->tic), >, 1000);
}

/* What every fault must leave: an axis that homes and moves again. */
static void assert_recovers(struct rig *rig) {
    home(rig);
    start(rig, 5);
    expect(rig, AXIS_ARRIVED);
    g_assert_cmpfloat(fabs(virtual_tic_steps(rig->tic) - 5 * STEPS_PER_DEG), <, 2);
}

static void assert_stands(struct rig *rig) {
    g_assert_cmpfloat(virtual_tic_speed(rig->tic), ==, 0);
}

/* Where the load truly is, and how fast it went: the units of the commands. */
static void test_tic_truth(struct rig *rig, gconstpointer unused) {
    home(rig);
    g_assert_cmpfloat(axis_position_deg(rig->axis), ==, 3);
    g_assert_cmpfloat(fabs(virtual_tic_steps(rig->tic)), <, 2);
    gint64 from = clock_now_us(rig->clock);
    start(rig, 23.004);
    expect(rig, AXIS_ARRIVED);
    double took = (double)(clock_now_us(rig->clock) - from) * 1e-6;
    g_assert_cmpfloat(fabs(virtual_tic_steps(rig->tic) - 2000), <, 2);
    g_assert_cmpfloat(axis_position_deg(rig->axis), ==, 23.004);
    double top = virtual_tic_top_speed(rig->tic);
    g_assert_cmpfloat(fabs(top - 6000), <, 10);
    g_assert_cmpfloat(took, >, axis_move_time_s(&rig->axis->motion, 3, 23.004) - 0.02);
}

static void test_tic_here(struct rig *rig, gconstpointer unused) {
    home(rig);
    g_assert_cmpfloat(fabs(virtual_tic_steps(rig->tic) - 100), <, 1);
    start(rig, 5);
    expect(rig, AXIS_ARRIVED);
    g_assert_cmpfloat(fabs(virtual_tic_steps(rig->tic) - 600), <, 2);
}

static void test_tic_stall(struct rig *rig, gconstpointer unused) {
    home(rig);
    start_and_pass(rig, 30);
    virtual_usb_set_fault(virtual_tic_usb(rig->tic), VIRTUAL_USB_STALLS);
    expect_fault(rig, DEVICE_ERROR_PROTOCOL, "refused a request");
    virtual_usb_set_fault(virtual_tic_usb(rig->tic), VIRTUAL_USB_WELL);
    assert_recovers(rig);
}

static void test_tic_silent(struct rig *rig, gconstpointer unused) {
    virtual_tic_set_mode(rig->tic, 0, 600);
    home(rig);
    start_and_pass(rig, 38);
    virtual_usb_set_fault(virtual_tic_usb(rig->tic), VIRTUAL_USB_SILENT);
    expect_fault(rig, DEVICE_ERROR_TIMEOUT, "did not answer");
    virtual_usb_set_fault(virtual_tic_usb(rig->tic), VIRTUAL_USB_WELL);
    assert_recovers(rig);
}

static void test_tic_short_answer(struct rig *rig, gconstpointer unused) {
    GError *error = NULL;
    home(rig);
    start_and_pass(rig, 30);
    virtual_usb_set_fault(virtual_tic_usb(rig->tic), VIRTUAL_USB_SHORT);
    expect_fault(rig, DEVICE_ERROR_PROTOCOL, "21 bytes of 42");
    g_clear_pointer(&rig->axis, axis_close);
    g_assert_null(open_tic(rig->clock, "", &error));
    g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_PROTOCOL);
    g_clear_error(&error);
}

/* Requests that are never answered are cancelled, and not reported. */
static void test_tic_close_waiting(struct rig *rig, gconstpointer unused) {
    home(rig);
    start_and_pass(rig, 30);
    virtual_usb_set_fault(virtual_tic_usb(rig->tic), VIRTUAL_USB_SILENT);
    conformance_pass(rig->clock, 0.05);
    g_clear_pointer(&rig->axis, axis_close); /* warns, which is fatal, if it waits in vain */
    conformance_pass(rig->clock, 0.1);
    g_assert_cmpint(rig->heard.n, ==, 0);
}

/* The end of a homing that this program was too slow for names the cause. */
static void test_tic_slow_homing(struct rig *rig, gconstpointer unused) {
    virtual_tic_set_mode(rig->tic, 0, 500);
    g_clear_pointer(&rig->axis, axis_close);
    rig->axis = open_tic(rig->clock, "", NULL);
    axis_listen(rig->axis, on_axis, &rig->heard);
    home(rig);
    start(rig, 38);
    expect(rig, AXIS_ARRIVED);
    g_assert_true(axis_home(rig->axis, NULL));
    conformance_pass(rig->clock, 0.1);
    g_usleep(700000);
    expect_fault(rig, DEVICE_ERROR_STALLED, "its command timeout stopped it");
    assert_stands(rig);
    assert_recovers(rig);
}

/* A motor that still turns is stopped when it is opened the next time. */
TEST(tic__left_turning) {
    static const struct conformance slow = {
        .section = "[axis test]\ndriver = tic-axis\nsteps_per_deg = 100\nspeed_deg_s = 10\n"
                   "homing = here\n"};
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(&slow, "", &section);
    g_autoptr(Clock) clock = clock_new_real();
    g_autoptr(VirtualTic) tic = virtual_tic_new("1", 1, 0, 0);
    struct heard heard = {0};
    Axis *axis = axis_open(&tic_axis_driver, section, NULL, clock, NULL);
    axis_listen(axis, on_axis, &heard);
    g_assert_true(axis_home(axis, NULL));
    conformance_wait(clock, &heard.n, 1, 5);
    g_assert_true(axis_move(axis, 100, NULL));
    conformance_pass(clock, 0.3);
    virtual_usb_set_fault(virtual_tic_usb(tic), VIRTUAL_USB_SILENT);
    axis_close(axis);
    virtual_usb_set_fault(virtual_tic_usb(tic), VIRTUAL_USB_WELL);
    g_assert_cmpfloat(virtual_tic_speed(tic), >, 900);
    axis = axis_open(&tic_axis_driver, section, NULL, clock, NULL);
    conformance_pass(clock, 0.4);
    g_assert_cmpfloat(virtual_tic_speed(tic), ==, 0);
    g_assert_cmpfloat(virtual_tic_steps(tic), <, 9000);
    axis_close(axis);
}

static void test_tic_unplug(struct rig *rig, gconstpointer unused) {
    GError *error = NULL;
    home(rig);
    start_and_pass(rig, 30);
    gint64 from = clock_now_us(rig->clock);
    virtual_usb_unplug(virtual_tic_usb(rig->tic));
    expect_fault(rig, DEVICE_ERROR_DISCONNECTED, "unplugged");
    g_assert_cmpint(clock_now_us(rig->clock) - from, <, 500000);
    g_assert_false(axis_home(rig->axis, &error));
    conformance_expect_error(&error, DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED, "00123456");
    g_assert_cmpint(axis_safety(rig->axis), ==, DEVICE_UNSAFE);
    virtual_usb_plug(virtual_tic_usb(rig->tic));
    wait_confirmed(rig->clock, &rig->axis->device); /* stopped again as soon as it is back */
    g_assert_cmpint(axis_safety(rig->axis), ==, DEVICE_SAFE);
    assert_stands(rig);
    assert_recovers(rig);
}

/* Nothing under way: the hot-plug event alone tells of it. */
static void test_tic_unplug_standing(struct rig *rig, gconstpointer unused) {
    virtual_usb_unplug(virtual_tic_usb(rig->tic));
    expect_fault(rig, DEVICE_ERROR_DISCONNECTED, "unplugged");
    virtual_usb_plug(virtual_tic_usb(rig->tic));
    conformance_pass(rig->clock, 0.1);
    assert_recovers(rig);
}

static void test_tic_safe_start(struct rig *rig, gconstpointer unused) {
    home(rig);
    start_and_pass(rig, 38);
    virtual_tic_enter_safe_start(rig->tic);
    expect_fault(rig, DEVICE_ERROR_STALLED, "safe start violation");
    assert_stands(rig);
    assert_recovers(rig);
}

static void test_tic_limit(struct rig *rig, gconstpointer unused) {
    home(rig);
    start_and_pass(rig, 38);
    virtual_tic_block_switch(rig->tic, TRUE);
    expect_fault(rig, DEVICE_ERROR_STALLED, "limit switch");
    assert_stands(rig);
    virtual_tic_block_switch(rig->tic, FALSE);
    assert_recovers(rig);
}

static void test_tic_uncertain(struct rig *rig, gconstpointer unused) {
    home(rig);
    start_and_pass(rig, 30);
    virtual_tic_lose_steps(rig->tic);
    expect_fault(rig, DEVICE_ERROR_STALLED, "uncertain");
    assert_stands(rig);
    assert_recovers(rig);
    conformance_pass(rig->clock, 0.2);
    virtual_tic_lose_steps(rig->tic); /* noticed while it stands, too */
    expect_fault(rig, DEVICE_ERROR_STALLED, "uncertain");
}

/* The switches are cut: it would turn on for ever, if it were not stopped. */
static void test_tic_no_switch(struct rig *rig, gconstpointer unused) {
    virtual_tic_cut_switches(rig->tic);
    g_assert_true(axis_home(rig->axis, NULL));
    conformance_pass(rig->clock, 0.5);
    g_assert_true(axis_is_moving(rig->axis));
    g_assert_true(axis_stop(rig->axis, NULL));
    expect(rig, AXIS_STOPPED);
    g_assert_false(axis_is_homed(rig->axis));
    assert_stands(rig);
}

/* As if the daemon hung or died: the Tic's own timeout stops the motor. When it wakes, it goes on.
 */
static void test_tic_daemon_hangs(struct rig *rig, gconstpointer unused) {
    axis_close(rig->axis);
    virtual_tic_set_mode(rig->tic, 0, 500);
    rig->axis = open_tic(rig->clock, "", NULL);
    axis_listen(rig->axis, on_axis, &rig->heard);
    home(rig);
    conformance_pass(rig->clock, 0.6); /* fed while it stands */
    g_assert_false(virtual_tic_has_timed_out(rig->tic));
    start_and_pass(rig, 38);
    g_usleep(700000);
    g_assert_true(virtual_tic_has_timed_out(rig->tic));
    assert_stands(rig);
    g_assert_cmpfloat(virtual_tic_steps(rig->tic), <, 37 * STEPS_PER_DEG);
    expect(rig, AXIS_ARRIVED);
    g_assert_true(axis_is_homed(rig->axis));
    g_assert_cmpfloat_with_epsilon(axis_position_deg(rig->axis), 38, 1e-9);
    g_usleep(700000); /* while it stands, too */
    conformance_pass(rig->clock, 0.3);
    g_assert_false(virtual_tic_has_timed_out(rig->tic));
    start(rig, 5);
    expect(rig, AXIS_ARRIVED);
}

static void assert_not_opened(Clock *clock, const char *more, GQuark domain, int code,
                              const char *text) {
    GError *error = NULL;
    g_assert_null(open_tic(clock, more, &error));
    conformance_expect_error(&error, domain, code, text);
}

TEST(tic__settings) {
    g_autoptr(Clock) clock = clock_new_real();
    g_autoptr(VirtualTic) tic = virtual_tic_new("1", 1, TRAVEL, 100);
    virtual_tic_set_mode(tic, 1, 1000);
    assert_not_opened(clock, "", DEVICE_ERROR, DEVICE_ERROR_UNSUPPORTED, "control mode is 1");
    virtual_tic_set_mode(tic, 0, 0);
    assert_not_opened(clock, "", DEVICE_ERROR, DEVICE_ERROR_UNSUPPORTED, "(off)");
    virtual_tic_set_mode(tic, 0, 100);
    assert_not_opened(clock, "", DEVICE_ERROR, DEVICE_ERROR_UNSUPPORTED, "200 ms or more");
    virtual_tic_set_mode(tic, 0, 1000);
    virtual_usb_set_fault(virtual_tic_usb(tic), VIRTUAL_USB_SILENT);
    assert_not_opened(clock, "", DEVICE_ERROR, DEVICE_ERROR_TIMEOUT, "did not answer");
    virtual_usb_set_fault(virtual_tic_usb(tic), VIRTUAL_USB_STALLS);
    assert_not_opened(clock, "", DEVICE_ERROR, DEVICE_ERROR_PROTOCOL, "refused a request");
}

TEST(tic__units) {
    static const struct conformance fast = {
        .section = "[axis test]\ndriver = tic-axis\nsteps_per_deg = 10000\nspeed_deg_s = 60\n"};
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(&fast, "", &section);
    g_autoptr(Clock) clock = clock_new_real();
    GError *error = NULL;
    g_assert_null(axis_open(&tic_axis_driver, section, NULL, clock, &error));
    conformance_expect_error(&error, CONFIG_ERROR, CONFIG_ERROR_VALUE, "600000 microsteps/s");
}

TEST(tic__choice) {
    g_autoptr(Clock) clock = clock_new_real();
    g_autoptr(VirtualTic) one = virtual_tic_new("AAA", 1, TRAVEL, 100);
    g_autoptr(VirtualTic) two = virtual_tic_new("BBB", 2, TRAVEL, 700);
    struct heard heard = {0};
    GError *error = NULL;
    assert_not_opened(clock, "", DEVICE_ERROR, DEVICE_ERROR_RANGE, "more than one device");
    assert_not_opened(clock, "serial = CCC\n", DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED, "BBB");
    assert_not_opened(clock, "path = 1-3\n", DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED, "1-3");
    g_autoptr(Axis) by_path = open_tic(clock, "path = 1-1\nhoming = here\n", &error);
    g_assert_no_error(error);
    g_autoptr(Axis) by_serial = open_tic(clock, "serial = BBB\nhoming = here\n", &error);
    g_assert_true(g_str_has_suffix(by_serial->device.identity, ", serial number BBB"));
    g_assert_no_error(error);
    axis_listen(by_path, on_axis, &heard);
    axis_listen(by_serial, on_axis, &heard);
    g_assert_true(axis_home(by_path, NULL) && axis_home(by_serial, NULL));
    conformance_wait(clock, &heard.n, 2, 5);
    heard.n = 0;
    g_assert_true(axis_move(by_path, 4, NULL) && axis_move(by_serial, 6, NULL));
    conformance_wait(clock, &heard.n, 2, 5);
    g_assert_no_error(heard.error);
    g_assert_cmpfloat(fabs(virtual_tic_steps(one) - 500), <, 2);
    g_assert_cmpfloat(fabs(virtual_tic_steps(two) - 1300), <, 2);
}

/* One of two Tics cannot be opened, so that its serial number is not known. It may be the one that
 * is looked for. That the other Tic could be opened, and is not the right one, must not hide this,
 * whichever of them is found first. */
TEST(tic__not_readable) {
    static const char *const serials[] = {"AAA", "BBB"};
    g_autoptr(Clock) clock = clock_new_real();
    g_autoptr(VirtualTic) one = virtual_tic_new(serials[0], 1, TRAVEL, 100);
    g_autoptr(VirtualTic) two = virtual_tic_new(serials[1], 2, TRAVEL, 700);
    for (int i = 0; i < 2; i++) {
        g_autofree char *node =
            g_strdup_printf("%s/dev/bus/usb/001/%03d", g_getenv("UMOCKDEV_DIR"), 2 + i);
        g_autofree char *away = g_strconcat(node, ".away", NULL);
        g_autofree char *wanted = g_strdup_printf("serial = %s\n", serials[i]);
        g_autofree char *there = g_strdup_printf("serial = %s\n", serials[1 - i]);
        /* Nobody, root included, can open a folder as a device. */
        g_assert_cmpint(rename(node, away), ==, 0);
        g_assert_cmpint(mkdir(node, 0700), ==, 0);
        assert_not_opened(clock, wanted, DEVICE_ERROR, DEVICE_ERROR_PROTOCOL, "USB failed");
        g_autoptr(Axis) other = open_tic(clock, there, NULL);
        g_assert_nonnull(other);
        g_assert_cmpint(rmdir(node), ==, 0);
        g_assert_cmpint(rename(away, node), ==, 0);
    }
}

/* The right ids on a device of another kind, as a Tic in its bootloader is. */
TEST(no_interface) {
    static const guint8 no_vendor[] = {9, 2, 18, 0, 1, 1, 0, 0xc0, 50, 9, 4, 0, 0, 0, 2, 0, 0, 0};
    static const struct virtual_usb_class class = {
        0x1ffb, 0x00b3, "Tic Bootloader", "1", no_vendor, sizeof no_vendor, NULL};
    g_autoptr(Clock) clock = clock_new_real();
    g_autoptr(VirtualUsb) usb = virtual_usb_new(&class, 1, NULL);
    assert_not_opened(clock, "", DEVICE_ERROR, DEVICE_ERROR_PROTOCOL, "no interface");
    g_assert_cmpint(virtual_usb_n_requests(usb), ==, 0);
}

struct board {
    Clock *clock;
    VirtualRelays *relays;
    LampBank *bank;
    Laser *laser;
    struct heard lamps, lasers;
};

static LampBank *open_bank(Clock *clock, const char *more, GError **error) {
    static const struct conformance with = {.section = "[lamps bank]\ndriver = usb-relays\n"};
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(&with, more, &section);
    return lamps_open(&usb_relays_driver, section, NULL, clock, error);
}

TEST(nothing_plugged) {
    g_autoptr(Clock) clock = clock_new_real();
    g_autoptr(VirtualRelays) other = virtual_relays_new("Mouse7", "XXXXX", 1, FALSE);
    GError *error = NULL;
    assert_not_opened(clock, "", DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED, "found: none");
    g_assert_null(open_bank(clock, "", &error));
    g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED);
    g_assert_nonnull(strstr(error->message, "Mouse7"));
    g_assert_cmpint(virtual_usb_n_requests(virtual_relays_usb(other)), ==, 0);
    g_clear_error(&error);
}

static Laser *open_laser(Clock *clock, const char *more, GError **error) {
    static const struct conformance with = {.section = "[laser line]\ndriver = usb-relay-laser\n"};
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(&with, more, &section);
    return laser_open(&usb_relay_laser_driver, section, NULL, clock, error);
}

/* A bank on relays 2 to 4, and a laser on relay 6, of one board. */
static void begin_board(struct board *board, gconstpointer unused) {
    *board = (struct board){.clock = clock_new_real()};
    board->relays = virtual_relays_new("USBRelay8", "BOARD", 3, TRUE);
    board->bank = ok(open_bank(board->clock, "first_relay = 2\nn_lamps = 3\n", ERR));
    board->laser = ok(open_laser(board->clock, "relay = 6\n", ERR));
    lamps_listen(board->bank, on_lamp, &board->lamps);
    laser_listen(board->laser, on_laser, &board->lasers);
}

static void end_board(struct board *board, gconstpointer unused) {
    g_clear_pointer(&board->bank, lamps_close);
    g_clear_pointer(&board->laser, laser_close);
    g_clear_pointer(&board->relays, virtual_relays_free);
    g_clear_pointer(&board->clock, clock_unref);
    g_clear_error(&board->lamps.error);
    g_clear_error(&board->lasers.error);
}

static void set_lamp(struct board *board, int index, gboolean on) {
    board->lamps.n = 0;
    ok(lamps_set(board->bank, index, on, ERR));
    conformance_wait(board->clock, &board->lamps.n, 1, 5);
}

static void set_laser(struct board *board, gboolean on) {
    board->lasers.n = 0;
    ok(laser_set(board->laser, on, ERR));
    conformance_wait(board->clock, &board->lasers.n, 1, 5);
}

static void test_relays_shared(struct board *board, gconstpointer unused) {
    GError *error = NULL;
    set_lamp(board, 0, TRUE);
    set_lamp(board, 2, TRUE);
    set_laser(board, TRUE);
    g_assert_cmphex(virtual_relays_state(board->relays), ==, 0x2a);
    lamps_all_off(board->bank, &error);
    conformance_wait(board->clock, &board->lamps.n, 2, 5);
    g_assert_cmphex(virtual_relays_state(board->relays), ==, 0x20);
    set_lamp(board, 1, TRUE);
    g_clear_pointer(&board->bank, lamps_close);
    g_assert_cmphex(virtual_relays_state(board->relays), ==, 0x20);
    g_clear_pointer(&board->laser, laser_close);
    g_assert_cmphex(virtual_relays_state(board->relays), ==, 0);
}

/* Whatever was left on by a program that died is off once opened. */
static void test_relays_left_on(struct board *board, gconstpointer unused) {
    set_laser(board, TRUE);
    Laser *again = ok(open_laser(board->clock, "relay = 6\n", ERR));
    g_assert_cmphex(virtual_relays_state(board->relays), ==, 0);
    laser_close(again);
}

static void test_relays_stuck(struct board *board, gconstpointer unused) {
    virtual_relays_stick(board->relays, 1 << 2);
    set_lamp(board, 1, TRUE);
    g_assert_error(board->lamps.error, DEVICE_ERROR, DEVICE_ERROR_PROTOCOL);
    g_assert_nonnull(strstr(board->lamps.error->message, "relay 3 was switched on"));
    g_assert_cmpint(lamps_light(board->bank, 1), ==, LIGHT_UNSAFE); /* until it reads back as off */
    conformance_pass(board->clock, 0.2);
    g_assert_cmpint(lamps_light(board->bank, 1), ==, LIGHT_OFF);
    set_lamp(board, 0, TRUE);
    g_assert_no_error(board->lamps.error);
    virtual_relays_stick(board->relays, 0);
    set_lamp(board, 1, TRUE);
    g_assert_no_error(board->lamps.error);
    g_assert_true(lamps_is_on(board->bank, 1));
}

/* A laser that will not go off must not be taken for off. */
static void test_relays_laser_stuck(struct board *board, gconstpointer unused) {
    set_laser(board, TRUE);
    virtual_relays_stick(board->relays, 1 << 5);
    set_laser(board, FALSE);
    g_assert_error(board->lasers.error, DEVICE_ERROR, DEVICE_ERROR_PROTOCOL);
    g_assert_nonnull(strstr(board->lasers.error->message, "relay 6 was switched off"));
    g_assert_true(laser_is_on(board->laser));
    virtual_relays_stick(board->relays, 0);
    set_laser(board, FALSE);
    g_assert_no_error(board->lasers.error);
    g_assert_false(laser_is_on(board->laser));
}

static void test_relays_faults(struct board *board, gconstpointer unused) {
    static const struct {
        enum virtual_usb_fault fault;
        enum device_error code;
    } cases[] = {
        {VIRTUAL_USB_STALLS, DEVICE_ERROR_PROTOCOL},
        {VIRTUAL_USB_SILENT, DEVICE_ERROR_TIMEOUT},
        {VIRTUAL_USB_SHORT, DEVICE_ERROR_PROTOCOL},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        virtual_usb_set_fault(virtual_relays_usb(board->relays), cases[i].fault);
        set_lamp(board, 0, TRUE);
        g_assert_error(board->lamps.error, DEVICE_ERROR, (int)cases[i].code);
        g_assert_true(g_str_has_prefix(board->lamps.error->message, "USB relay board"));
        virtual_usb_set_fault(virtual_relays_usb(board->relays), VIRTUAL_USB_WELL);
        set_lamp(board, 0, TRUE);
        g_assert_no_error(board->lamps.error);
        set_lamp(board, 0, FALSE);
    }
}

/* A kernel may end what is under way as failed, a moment before it says that the device is gone. */
static gboolean tells_unplugged(const GError *error) {
    return g_error_matches(error, DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED) ||
           (g_error_matches(error, DEVICE_ERROR, DEVICE_ERROR_PROTOCOL) &&
            strstr(error->message, "USB failed") && strstr(error->message, "check its cable"));
}

static void test_relays_unplug(struct board *board, gconstpointer unused) {
    GError *error = NULL;
    set_laser(board, TRUE);
    board->lamps.n = 0;
    virtual_usb_set_fault(virtual_relays_usb(board->relays), VIRTUAL_USB_SILENT);
    g_assert_true(lamps_set(board->bank, 0, TRUE, NULL));
    virtual_usb_unplug(virtual_relays_usb(board->relays));
    virtual_relays_lose_power(board->relays);
    conformance_wait(board->clock, &board->lamps.n, 1, 5);
    g_assert_true(tells_unplugged(board->lamps.error));
    conformance_pass(board->clock, 0.1);
    g_assert_false(lamps_set(board->bank, 0, TRUE, &error));
    g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED);
    g_assert_true(g_str_has_prefix(error->message, "lamps bank: "));
    g_clear_error(&error);
    virtual_usb_set_fault(virtual_relays_usb(board->relays), VIRTUAL_USB_WELL);
    virtual_usb_plug(virtual_relays_usb(board->relays));
    conformance_pass(board->clock, 0.1);
    set_lamp(board, 0, TRUE);
    g_assert_no_error(board->lamps.error);
    set_laser(board, FALSE);
    g_assert_no_error(board->lasers.error);
    g_assert_cmphex(virtual_relays_state(board->relays), ==, 0x02);
}

/* A board with a power supply of its own: its relays stay on while it is unplugged, which is told
 * at that moment, and go off once it is back. */
static void test_relays_unplug_lit(struct board *board, gconstpointer unused) {
    set_laser(board, TRUE);
    set_lamp(board, 0, TRUE);
    board->lamps.n = board->lasers.n = 0;
    virtual_usb_unplug(virtual_relays_usb(board->relays));
    conformance_wait(board->clock, &board->lasers.n, 1, 5);
    conformance_wait(board->clock, &board->lamps.n, 1, 5);
    g_assert_true(tells_unplugged(board->lamps.error));
    g_assert_true(tells_unplugged(board->lasers.error));
    conformance_pass(board->clock, 1);
    g_assert_cmpint(laser_light(board->laser), ==, LIGHT_UNSAFE);
    g_assert_cmpint(lamps_light(board->bank, 0), ==, LIGHT_UNSAFE);
    g_assert_cmphex(virtual_relays_state(board->relays), ==, 0x22);
    virtual_usb_plug(virtual_relays_usb(board->relays));
    wait_confirmed(board->clock, &board->laser->device);
    wait_confirmed(board->clock, &board->bank->device);
    g_assert_cmphex(virtual_relays_state(board->relays), ==, 0);
    g_assert_cmpint(laser_light(board->laser), ==, LIGHT_OFF);
    g_assert_cmpint(lamps_light(board->bank, 0), ==, LIGHT_OFF);
    g_assert_cmpint(board->lasers.n, ==, 1);
    g_assert_cmpint(board->lamps.n, ==, 1);
}

TEST(relays__wrong_relay) {
    g_autoptr(Clock) clock = clock_new_real();
    g_autoptr(VirtualRelays) relays = virtual_relays_new("USBRelay2", "SMALL", 1, FALSE);
    GError *error = NULL;
    g_assert_null(open_laser(clock, "relay = 3\n", &error));
    conformance_expect_error(
        &error, CONFIG_ERROR, CONFIG_ERROR_VALUE,
        "relay 3 does not exist, because the USB relay board has 2 relays; correct relay, or");
    g_assert_null(open_bank(clock, "serial = OTHER\n", &error));
    conformance_expect_error(&error, DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED, "SMALL");
    virtual_relays_stick(relays, 0x3);
    g_autoptr(LampBank) bank = open_bank(clock, "", &error);
    g_assert_no_error(error);
    g_assert_cmpint(bank->n, ==, 2);
}

/* Another process has the board's lock: the error names it, and the board is left as it is. */
TEST(relays__held) {
    g_autoptr(Clock) clock = clock_new_real();
    g_autoptr(VirtualRelays) relays = virtual_relays_new("USBRelay2", "HELD", 1, FALSE);
    g_autofree char *key = lock_key_of_node("usb", "/dev/bus/usb/001/002"); /* after the hub */
    GError *error = NULL;
    pid_t holder = 0;
    GSubprocess *keeper = lock_keeper_start(key);
    g_assert_null(open_laser(clock, "relay = 1\n", &error));
    assert_has(error->message, ": cannot open USB device 1-");
    lock_keeper_expect(keeper, &error);
    lock_keeper_end(keeper);
    g_autoptr(Laser) laser = open_laser(clock, "relay = 1\n", &error);
    g_assert_no_error(error);
    g_assert_true(lock_holder(key, &holder));
    g_assert_cmpint(holder, ==, getpid());
    g_assert_null(open_bank(clock, "serial = HELD\n", &error)); /* it is named differently */
    conformance_expect_error(&error, DEVICE_ERROR, DEVICE_ERROR_BUSY,
                             "is already open for another section");
}

static const struct {
    const char *name;
    void (*run)(struct rig *rig, gconstpointer unused);
    const char *more; /* keys of the axis */
} tics[] = {
    {"/usb/tic/truth", test_tic_truth, "home_deg = 3\n"},
    {"/usb/tic/here", test_tic_here, "homing = here\n"},
    {"/usb/tic/stall", test_tic_stall, ""},
    {"/usb/tic/silent", test_tic_silent, ""},
    {"/usb/tic/short-answer", test_tic_short_answer, ""},
    {"/usb/tic/close-waiting", test_tic_close_waiting, ""},
    {"/usb/tic/unplug", test_tic_unplug, "serial = 00123456\n"},
    {"/usb/tic/unplug-standing", test_tic_unplug_standing, ""},
    {"/usb/tic/safe-start", test_tic_safe_start, ""},
    {"/usb/tic/limit", test_tic_limit, ""},
    {"/usb/tic/uncertain", test_tic_uncertain, ""},
    {"/usb/tic/no-switch", test_tic_no_switch, ""},
    {"/usb/tic/daemon-hangs", test_tic_daemon_hangs, ""},
    {"/usb/tic/slow-homing", test_tic_slow_homing, ""},
};

static const struct {
    const char *name;
    void (*run)(struct board *board, gconstpointer unused);
} boards[] = {
    {"/usb/relays/shared", test_relays_shared},
    {"/usb/relays/left-on", test_relays_left_on},
    {"/usb/relays/stuck", test_relays_stuck},
    {"/usb/relays/laser-stuck", test_relays_laser_stuck},
    {"/usb/relays/faults", test_relays_faults},
    {"/usb/relays/unplug", test_relays_unplug},
    {"/usb/relays/unplug-lit", test_relays_unplug_lit},
};

BEFORE_TESTS {
    for (gsize i = 0; i < G_N_ELEMENTS(tics); i++)
        g_test_add(tics[i].name, struct rig, tics[i].more, begin, tics[i].run, end);
    for (gsize i = 0; i < G_N_ELEMENTS(boards); i++)
        g_test_add(boards[i].name, struct board, NULL, begin_board, boards[i].run, end_board);
}

int main(int argc, char **argv) {
    testbed_enter(argv);
    return tests_run(argc, argv);
}
