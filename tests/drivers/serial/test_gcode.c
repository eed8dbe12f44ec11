/* Axes on boards that speak G-code: where they truly are, axes that share a board, and faults. The
 * virtual board is real in time. */
#include "conformance/conformance.h"
#include "lib/assert_error.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "lib/wait.h"
#include "serial/detect.h"
#include "serial/devices.h"
#include "virtual/gcode.h"

#include <math.h>
#include <string.h>

/* A slow board, so that a motion is under way when a fault comes. */
#define MOTION                                                                                     \
    "units_per_deg = 2\nmin_deg = -400\nmax_deg = 400\nspeed_deg_s = 50\naccel_deg_s2 = 500\n"
#define FAST                                                                                       \
    "units_per_deg = 2\nmin_deg = -400\nmax_deg = 400\nspeed_deg_s = 500\naccel_deg_s2 = 5000\n"

#define HOME_AT 3.5

struct part { /* an axis and its events */
    Axis *axis;
    Config *config;
    int n;
    enum axis_event last;
    GError *error;
};

struct bench {
    VirtualGcode *board;
    Clock *clock;
    struct part a, b;
};

static void on_axis(Axis *axis, enum axis_event event, const GError *error, gpointer data) {
    struct part *part = data;
    if (event == AXIS_PASSING)
        return;
    part->n++;
    part->last = event;
    g_clear_error(&part->error);
    part->error = error ? g_error_copy(error) : NULL;
}

static Axis *open_axis(struct bench *bench, struct part *part, const char *keys, GError **error) {
    const struct config_section *section;
    const gboolean other = strstr(keys, "dialect = ") && !strstr(keys, "homing = ");
    g_autofree char *text =
        g_strdup_printf("[axis test]\ndriver = gcode-axis\nport = %s\nanswer_ms = 500\nboot_ms = "
                        "1200\npoll_ms = 5\n%s%s",
                        virtual_gcode_port(bench->board), other ? "homing = axis\n" : "", keys);
    const struct conformance with = {.section = text};
    part->config = conformance_config(&with, "", &section);
    part->axis = axis_open(&gcode_axis_driver, section, NULL, bench->clock, error);
    if (part->axis)
        axis_listen(part->axis, on_axis, part);
    return part->axis;
}

static void begin_board(struct bench *bench, const struct virtual_gcode_options *with) {
    struct virtual_gcode_options options = *with;
    *bench = (struct bench){.clock = clock_new_real()};
    options.n_axes = MAX(options.n_axes, 3);
    options.units_s = 1000;
    options.units_s2 = 10000;
    options.steps = 1000;
    options.home_at = HOME_AT;
    bench->board = ok(virtual_gcode_new(&options, ERR));
}

static void begin(struct bench *bench, const struct virtual_gcode_options *with, const char *a,
                  const char *b) {
    begin_board(bench, with);
    ok(open_axis(bench, &bench->a, a, ERR));
    if (b)
        ok(open_axis(bench, &bench->b, b, ERR));
}

static void close_part(struct part *part) {
    g_clear_pointer(&part->axis, axis_close);
    g_clear_pointer(&part->config, config_free);
    g_clear_error(&part->error);
    part->n = 0;
}

static struct virtual_gcode_state state_of(struct bench *bench) {
    struct virtual_gcode_state state;
    virtual_gcode_state(bench->board, &state);
    return state;
}

static void end(struct bench *bench) {
    close_part(&bench->b);
    close_part(&bench->a);
    struct virtual_gcode_state state = state_of(bench);
    g_assert_false(state.moving);
    g_assert_cmpint(state.max_unanswered, <=, 127);
    g_assert_cmpint(state.n_overflows, ==, 0);
    g_clear_pointer(&bench->board, virtual_gcode_free);
    g_clear_pointer(&bench->clock, clock_unref);
}

static void expect(struct bench *bench, struct part *part, enum axis_event event) {
    conformance_wait(bench->clock, &part->n, 1, 60);
    if (event != AXIS_FAULT)
        g_assert_no_error(part->error);
    g_assert_cmpint(part->n, ==, 1);
    g_assert_cmpint(part->last, ==, event);
    part->n = 0;
}

static void home(struct bench *bench, struct part *part) {
    ok(axis_home(part->axis, ERR));
    expect(bench, part, AXIS_HOMED);
}

static void move(struct bench *bench, struct part *part, double deg) {
    ok(axis_move(part->axis, deg, ERR));
    expect(bench, part, AXIS_ARRIVED);
}

static void assert_at(struct bench *bench, int axis, double units) {
    struct virtual_gcode_state state = state_of(bench);
    g_assert_cmpfloat(fabs(state.at[axis] - units), <, 0.002);
    g_assert_false(state.moving);
}

static void wait_moving(struct bench *bench) {
    UNTIL (state_of(bench).moving)
        conformance_pass(bench->clock, 0.002);
    conformance_pass(bench->clock, 0.1);
    g_assert_true(state_of(bench).moving);
}

static void wait_safe(struct bench *bench, struct part *part) {
    UNTIL (axis_safety(part->axis) == DEVICE_SAFE)
        conformance_pass(bench->clock, 0.01);
}

static const struct virtual_gcode_options grbl = {.single_homing = TRUE};
static const struct virtual_gcode_options marlin = {.language = VIRTUAL_MARLIN,
                                                    .emergency_parser = TRUE};
static const struct virtual_gcode_options simple_marlin = {.language = VIRTUAL_MARLIN};

static const struct virtual_gcode_options klipper = {.language = VIRTUAL_KLIPPER, .boot_ms = 300};

#define MARLIN  "dialect = marlin\n"
#define KLIPPER "dialect = klipper\n"

/* The right axis of the board moves the right way, and the others stay. */
static void truth(const struct virtual_gcode_options *with, const char *language) {
    struct bench bench;
    g_autofree char *keys = g_strconcat(language, FAST "letter = Y\nhome_deg = 10\n", NULL);
    begin(&bench, with, keys, NULL);
    home(&bench, &bench.a);
    g_assert_cmpfloat(axis_position_deg(bench.a.axis), ==, 10);
    assert_at(&bench, 1, HOME_AT);
    const double x = state_of(&bench).at[0], z = state_of(&bench).at[2];
    move(&bench, &bench.a, 41.25);
    g_assert_cmpfloat(axis_position_deg(bench.a.axis), ==, 41.25);
    assert_at(&bench, 1, HOME_AT + 31.25 * 2);
    move(&bench, &bench.a, -100);
    assert_at(&bench, 1, HOME_AT - 110 * 2);
    assert_at(&bench, 0, x);
    assert_at(&bench, 2, z);
    end(&bench);
}

TEST(truth) {
    truth(&grbl, "homing = axis\n");
}

TEST(truth_marlin) {
    truth(&marlin, MARLIN);
}

TEST(truth_klipper) {
    truth(&klipper, KLIPPER);
}

TEST(other_way) {
    struct bench bench;
    begin(&bench, &grbl,
          "units_per_deg = -0.5\nwraps = yes\nspeed_deg_s = 1500\naccel_deg_s2 = 15000\n", NULL);
    home(&bench, &bench.a);
    for (int i = 1; i <= 4; i++) {
        move(&bench, &bench.a, 100 * i % 360);
        assert_at(&bench, 0, HOME_AT - 0.5 * 100 * i);
    }
    g_assert_cmpfloat(fabs(axis_position_deg(bench.a.axis) - 40), <, 1e-6);
    end(&bench);
}

/* The position stays known after a stop. aborts: the stop has no ramp. holds: it is a feed hold. */
static void stops(const struct virtual_gcode_options *with, const char *language, gboolean aborts,
                  gboolean holds) {
    struct bench bench;
    g_autofree char *keys = g_strconcat(language, MOTION, NULL);
    begin(&bench, with, keys, NULL);
    home(&bench, &bench.a);
    const struct virtual_gcode_state before = state_of(&bench);
    ok(axis_move(bench.a.axis, 300, ERR));
    wait_moving(&bench);
    ok(axis_stop(bench.a.axis, ERR));
    expect(&bench, &bench.a, AXIS_STOPPED);
    const struct virtual_gcode_state after = state_of(&bench);
    g_assert_false(after.moving);
    g_assert_false(after.alarm);
    g_assert_cmpint(after.n_aborted, ==, before.n_aborted + aborts);
    g_assert_cmpint(after.n_holds, ==, before.n_holds + holds);
    g_assert_true(axis_is_homed(bench.a.axis));
    g_assert_cmpfloat(axis_position_deg(bench.a.axis), >, 1);
    assert_at(&bench, 0, HOME_AT + 2 * axis_position_deg(bench.a.axis));
    move(&bench, &bench.a, 2);
    assert_at(&bench, 0, HOME_AT + 4);
    g_assert_cmpint(state_of(&bench).n_homings, ==, 1);
    end(&bench);
}

TEST(stops) {
    stops(&grbl, "", FALSE, TRUE);
}

TEST(stops_marlin) {
    stops(&marlin, MARLIN, TRUE, FALSE);
}

TEST(stops_simple_marlin) {
    stops(&simple_marlin, MARLIN, TRUE, FALSE);
}

TEST(stops_klipper) {
    stops(&klipper, KLIPPER, FALSE, FALSE);
}

/* A program that has died sends no further pieces of a move. The motion ends by itself. */
TEST(ends_klipper) {
    struct bench bench;
    begin(&bench, &klipper, KLIPPER MOTION, NULL);
    home(&bench, &bench.a);
    ok(axis_move(bench.a.axis, 300, ERR)); /* 6 s */
    wait_moving(&bench);
    virtual_gcode_fail(bench.board, &(struct virtual_gcode_faults){.cut = TRUE});
    g_usleep(2500000);
    const struct virtual_gcode_state state = state_of(&bench);
    g_assert_false(state.moving);
    g_assert_cmpfloat(state.at[0], >=, HOME_AT + 50);
    g_assert_cmpfloat(state.at[0], <, HOME_AT + 250);
    g_assert_cmpint(state.n_aborted, ==, 0);
    virtual_gcode_fail(bench.board, &(struct virtual_gcode_faults){0});
    end(&bench);
}

/* A homing is stopped by M112. The next homing restarts Klipper. */
TEST(stops_homing_klipper) {
    struct bench bench;
    struct virtual_gcode_options options = klipper;
    options.switch_way = 3000;
    begin(&bench, &options, KLIPPER FAST, NULL);
    ok(axis_home(bench.a.axis, ERR));
    wait_moving(&bench);
    ok(axis_stop(bench.a.axis, ERR));
    expect(&bench, &bench.a, AXIS_STOPPED);
    g_assert_cmpint(state_of(&bench).n_kills, ==, 1);
    g_assert_false(state_of(&bench).moving);
    g_assert_false(axis_is_homed(bench.a.axis));
    const int n_resets = state_of(&bench).n_resets;
    home(&bench, &bench.a);
    g_assert_cmpint(state_of(&bench).n_resets, ==, n_resets + 1);
    g_assert_cmpint(state_of(&bench).n_kills, ==, 1);
    move(&bench, &bench.a, 20);
    assert_at(&bench, 0, HOME_AT + 40);
    end(&bench);
}

/* A Klipper that was shut down before the port was opened can be homed. */
static void opens_shut_down(const struct virtual_gcode_options *with) {
    struct bench bench;
    begin_board(&bench, with);
    virtual_gcode_receive(bench.board, "M112\n");
    ok(open_axis(&bench, &bench.a, KLIPPER FAST, ERR));
    ok(axis_halt(bench.a.axis, ERR));
    expect(&bench, &bench.a, AXIS_STOPPED);
    home(&bench, &bench.a);
    move(&bench, &bench.a, 20);
    assert_at(&bench, 0, HOME_AT + 40);
    end(&bench);
}

TEST(opens_shut_down_klipper) {
    struct virtual_gcode_options terse = klipper;
    opens_shut_down(&klipper);
    terse.terse = TRUE;
    opens_shut_down(&terse);
}

/* A Klipper that still starts is waited for. */
TEST(boots_klipper) {
    struct bench bench;
    begin_board(&bench, &klipper);
    virtual_gcode_reset(bench.board);
    const gint64 start = g_get_monotonic_time();
    ok(open_axis(&bench, &bench.a, KLIPPER FAST, ERR));
    g_assert_cmpint(g_get_monotonic_time() - start, >=, 250000);
    home(&bench, &bench.a);
    end(&bench);
}

/* The oks of lines before the stop come after it, and count for no later line. */
static void stops_late(const struct virtual_gcode_options *with, const char *language) {
    struct bench bench;
    g_autofree char *keys = g_strconcat(language, MOTION, NULL);
    begin(&bench, with, keys, NULL);
    home(&bench, &bench.a);
    virtual_gcode_fail(bench.board, &(struct virtual_gcode_faults){.late_ms = 60});
    for (int i = 0; i < 5; i++) {
        ok(axis_move(bench.a.axis, i & 1 ? -300 : 300, ERR));
        wait_moving(&bench);
        conformance_pass(bench.clock, 0.01 * i);
        ok(axis_stop(bench.a.axis, ERR));
        expect(&bench, &bench.a, AXIS_STOPPED);
        g_assert_false(state_of(&bench).moving);
        assert_at(&bench, 0, HOME_AT + 2 * axis_position_deg(bench.a.axis));
    }
    move(&bench, &bench.a, 2);
    assert_at(&bench, 0, HOME_AT + 4);
    virtual_gcode_fail(bench.board, &(struct virtual_gcode_faults){0});
    end(&bench);
}

TEST(stops_late_marlin) {
    stops_late(&marlin, MARLIN);
}

TEST(stops_late_klipper) {
    stops_late(&klipper, KLIPPER);
}

/* A board that does not brake is reset in its motion. Its position is lost, and that is said. */
TEST(stops_by_reset) {
    struct bench bench;
    begin(&bench, &grbl, MOTION, MOTION "letter = Y\n");
    ok(axis_home(bench.a.axis, ERR));
    ok(axis_home(bench.b.axis, ERR));
    expect(&bench, &bench.a, AXIS_HOMED);
    expect(&bench, &bench.b, AXIS_HOMED);
    virtual_gcode_fail(bench.board, &(struct virtual_gcode_faults){.no_hold = TRUE});
    ok(axis_move(bench.a.axis, 300, ERR));
    wait_moving(&bench);
    ok(axis_stop(bench.a.axis, ERR));
    expect(&bench, &bench.a, AXIS_FAULT);
    if (!strstr(bench.a.error->message, "had to be reset while it moved, so its position is lost"))
        g_error("%s", bench.a.error->message);
    expect(&bench, &bench.b, AXIS_FAULT);
    g_assert_false(axis_is_homed(bench.a.axis) || axis_is_homed(bench.b.axis));
    g_assert_cmpint(state_of(&bench).n_aborted, ==, 1);
    virtual_gcode_fail(bench.board, &(struct virtual_gcode_faults){0});
    wait_safe(&bench, &bench.a);
    wait_safe(&bench, &bench.b);
    home(&bench, &bench.a);
    end(&bench);
}

/* Requests to two axes of a board take turns. A wait that is longer than the deadline of the motion
 * is none of its faults. */
TEST(take_turns) {
    struct bench bench;
    begin(&bench, &grbl, MOTION, FAST "letter = Z\n");
    ok(axis_home(bench.a.axis, ERR));
    ok(axis_home(bench.b.axis, ERR));
    expect(&bench, &bench.a, AXIS_HOMED);
    expect(&bench, &bench.b, AXIS_HOMED);
    g_assert_cmpint(state_of(&bench).n_homings, ==, 1); /* both together */
    ok(axis_move(bench.a.axis, 300, ERR));
    ok(axis_move(bench.b.axis, -1, ERR));
    wait_moving(&bench);
    conformance_pass(bench.clock, 5);
    g_assert_cmpint(bench.a.n + bench.b.n, ==, 0);
    g_assert_cmpfloat(state_of(&bench).at[2], ==, HOME_AT);
    expect(&bench, &bench.a, AXIS_ARRIVED);
    expect(&bench, &bench.b, AXIS_ARRIVED);
    assert_at(&bench, 0, HOME_AT + 600);
    assert_at(&bench, 2, HOME_AT - 2);
    end(&bench);
}

/* The stop of an axis that stands or waits does not disturb another one. */
static void stop_of_another(const struct virtual_gcode_options *with, const char *language) {
    struct bench bench;
    g_autofree char *a = g_strconcat(language, MOTION, NULL);
    g_autofree char *b = g_strconcat(language, FAST "letter = Y\n", NULL);
    begin(&bench, with, a, b);
    ok(axis_home(bench.a.axis, ERR));
    ok(axis_home(bench.b.axis, ERR));
    expect(&bench, &bench.a, AXIS_HOMED);
    expect(&bench, &bench.b, AXIS_HOMED);
    ok(axis_move(bench.a.axis, 200, ERR));
    wait_moving(&bench);
    ok(axis_halt(bench.b.axis, ERR));
    expect(&bench, &bench.b, AXIS_STOPPED);
    ok(axis_move(bench.b.axis, 60, ERR));
    conformance_pass(bench.clock, 0.1);
    ok(axis_stop(bench.b.axis, ERR));
    expect(&bench, &bench.b, AXIS_STOPPED);
    g_assert_true(state_of(&bench).moving);
    expect(&bench, &bench.a, AXIS_ARRIVED);
    assert_at(&bench, 0, HOME_AT + 400);
    assert_at(&bench, 1, HOME_AT);
    g_assert_cmpint(state_of(&bench).n_holds, ==, 0);
    g_assert_cmpint(state_of(&bench).n_kills, ==, 0);
    end(&bench);
}

TEST(stop_of_another) {
    stop_of_another(&grbl, "");
}

TEST(stop_of_another_klipper) {
    stop_of_another(&klipper, KLIPPER);
}

/* "$H" and "G28" home the whole board. An axis that had a position is moved back to it. */
static void homing_moves_back(const struct virtual_gcode_options *with, const char *language) {
    struct bench bench;
    g_autofree char *a = g_strconcat(language, FAST, NULL);
    g_autofree char *b = g_strconcat(language, FAST "letter = Y\n", NULL);
    begin(&bench, with, a, b);
    home(&bench, &bench.a);
    move(&bench, &bench.a, 77);
    home(&bench, &bench.b);
    assert_at(&bench, 0, HOME_AT + 154);
    assert_at(&bench, 1, HOME_AT);
    conformance_pass(bench.clock, 0.7); /* several reports */
    g_assert_cmpint(bench.a.n, ==, 0);
    g_assert_true(axis_is_homed(bench.a.axis));
    move(&bench, &bench.a, 78);
    assert_at(&bench, 0, HOME_AT + 156);
    end(&bench);
}

TEST(homing_moves_back) {
    homing_moves_back(&grbl, "");
}

TEST(homing_moves_back_marlin) {
    homing_moves_back(&marlin, MARLIN "homing = all\n");
}

TEST(homing_moves_back_klipper) {
    homing_moves_back(&klipper, KLIPPER "homing = all\n");
}

/* The lines that move five axes back have more bytes than the board can store. */
TEST(homing_moves_many_back) {
    struct bench bench;
    struct virtual_gcode_options options = grbl;
    struct part parts[4] = {0};
    options.n_axes = 6;
    begin(&bench, &options, FAST, FAST "letter = Y\n");
    for (int i = 0; i < 4; i++) {
        g_autofree char *keys = g_strdup_printf(FAST "letter = %c\n", "ZABC"[i]);
        ok(open_axis(&bench, &parts[i], keys, ERR));
    }
    struct part *all[] = {&bench.a, &bench.b, &parts[0], &parts[1], &parts[2]};
    for (gsize i = 0; i < G_N_ELEMENTS(all); i++)
        ok(axis_home(all[i]->axis, ERR));
    for (gsize i = 0; i < G_N_ELEMENTS(all); i++)
        expect(&bench, all[i], AXIS_HOMED);
    for (int i = 0; i < 5; i++)
        move(&bench, all[i], -100.125 - i);
    virtual_gcode_fail(bench.board, &(struct virtual_gcode_faults){.late_ms = 100});
    home(&bench, &parts[3]);
    for (int i = 0; i < 5; i++)
        assert_at(&bench, i, HOME_AT - 2 * (100.125 + i));
    assert_at(&bench, 5, HOME_AT);
    g_assert_cmpint(state_of(&bench).max_unanswered, >, 64);
    for (int i = 0; i < 4; i++)
        close_part(&parts[i]);
    end(&bench);
}

/* "$HX" and "G28 X" leave the other axes where they are. */
TEST(homes_one) {
    struct bench bench;
    begin(&bench, &grbl, FAST "homing = axis\n", FAST "letter = Y\nhoming = axis\n");
    home(&bench, &bench.a);
    move(&bench, &bench.a, 77);
    home(&bench, &bench.b);
    assert_at(&bench, 0, HOME_AT + 154);
    g_assert_cmpint(state_of(&bench).n_homings, ==, 2);
    move(&bench, &bench.b, 5);
    assert_at(&bench, 1, HOME_AT + 10);
    end(&bench);
}

/* Without switches nothing moves, and a board that is locked after a reset is unlocked. */
TEST(homes_here) {
    struct bench bench;
    begin(&bench, &grbl, FAST "homing = here\nhome_deg = 30\n", NULL);
    g_assert_true(state_of(&bench).alarm);
    home(&bench, &bench.a);
    assert_at(&bench, 0, 0);
    g_assert_cmpfloat(axis_position_deg(bench.a.axis), ==, 30);
    move(&bench, &bench.a, 40);
    assert_at(&bench, 0, 20);
    g_assert_cmpint(state_of(&bench).n_homings, ==, 0);
    end(&bench);
}

/* Opening the port of an Arduino resets it, and it does not listen for a while. */
TEST(boots) {
    struct bench bench;
    struct virtual_gcode_options options = grbl;
    options.resets_on_open = TRUE;
    options.boot_ms = 400;
    begin_board(&bench, &options);
    const gint64 start = g_get_monotonic_time();
    ok(open_axis(&bench, &bench.a, FAST, ERR));
    g_assert_cmpint(g_get_monotonic_time() - start, >=, 400000);
    home(&bench, &bench.a);
    move(&bench, &bench.a, 20);
    assert_at(&bench, 0, HOME_AT + 40);
    end(&bench);
}

/* A program that has died leaves one motion behind. The next one stops it. */
static void left_moving(const struct virtual_gcode_options *with, const char *language,
                        const char *motion) {
    struct bench bench;
    g_autofree char *keys = g_strconcat(language, FAST, NULL);
    begin_board(&bench, with);
    virtual_gcode_receive(bench.board, motion);
    wait_moving(&bench);
    ok(open_axis(&bench, &bench.a, keys, ERR));
    UNTIL (!state_of(&bench).moving)
        conformance_pass(bench.clock, 0.01);
    g_assert_cmpfloat(state_of(&bench).at[0], <, 500);
    home(&bench, &bench.a);
    end(&bench);
}

TEST(left_moving) {
    left_moving(&grbl, "", "$X\nG90G53G1X1000F2000\n");
}

TEST(left_moving_marlin) {
    left_moving(&marlin, MARLIN, "G1 X1000 F2000\n");
}

TEST(left_moving_klipper) {
    left_moving(&klipper, KLIPPER, "G28\nG1 X1000 F2000\n");
}

TEST(left_homing_klipper) {
    struct virtual_gcode_options options = klipper;
    options.switch_way = 3000;
    left_moving(&options, KLIPPER, "G28\n");
}

/* A board that an alarm has silenced is not a dead one. */
TEST(silent_alarm) {
    struct bench bench;
    begin_board(&bench, &grbl);
    virtual_gcode_receive(bench.board, "$X\nG90G53G1X1000F2000\n");
    wait_moving(&bench);
    virtual_gcode_press(bench.board, 0, TRUE);
    virtual_gcode_press(bench.board, 0, FALSE);
    ok(open_axis(&bench, &bench.a, FAST, ERR));
    home(&bench, &bench.a);
    end(&bench);
}

/* This program cannot run for a while. The answers of that time wait in the port. */
static void held_up(const struct virtual_gcode_options *with, const char *language) {
    struct bench bench;
    g_autofree char *keys = g_strconcat(language, MOTION, NULL);
    begin(&bench, with, keys, NULL);
    home(&bench, &bench.a);
    ok(axis_move(bench.a.axis, 150, ERR));
    wait_moving(&bench);
    g_usleep(1500000);
    expect(&bench, &bench.a, AXIS_ARRIVED);
    ok(axis_move(bench.a.axis, 0, ERR));
    wait_moving(&bench);
    ok(axis_stop(bench.a.axis, ERR));
    g_usleep(1500000);
    expect(&bench, &bench.a, AXIS_STOPPED);
    g_assert_true(axis_is_homed(bench.a.axis));
    assert_at(&bench, 0, HOME_AT + 2 * axis_position_deg(bench.a.axis));
    end(&bench);
}

TEST(held_up) {
    held_up(&grbl, "");
}

TEST(held_up_marlin) {
    held_up(&marlin, MARLIN);
}

TEST(held_up_klipper) {
    held_up(&klipper, KLIPPER);
}

/* What open() refuses. */
static void refuses(const struct virtual_gcode_options *with, const char *keys, GQuark domain,
                    int code, const char *words) {
    struct bench bench;
    GError *error = NULL;
    begin_board(&bench, with);
    g_assert_null(open_axis(&bench, &bench.a, keys, &error));
    conformance_expect_error(&error, domain, code, words);
    end(&bench);
}

TEST(refuses__speed) {
    refuses(&grbl, "units_per_deg = 20\nspeed_deg_s = 60\naccel_deg_s2 = 100\n", CONFIG_ERROR,
            CONFIG_ERROR_VALUE, "speed_deg_s: the board allows 50 deg/s");
    refuses(&marlin, MARLIN "units_per_deg = 20\nspeed_deg_s = 60\naccel_deg_s2 = 100\n",
            CONFIG_ERROR, CONFIG_ERROR_VALUE, "speed_deg_s: the board allows 50 deg/s");
    refuses(&klipper, KLIPPER "units_per_deg = 20\nspeed_deg_s = 60\naccel_deg_s2 = 100\n",
            CONFIG_ERROR, CONFIG_ERROR_VALUE, "speed_deg_s: the board allows 50 deg/s");
}

TEST(refuses__acceleration) {
    refuses(&grbl, "units_per_deg = 20\nspeed_deg_s = 5\naccel_deg_s2 = 1000\n", CONFIG_ERROR,
            CONFIG_ERROR_VALUE, "accel_deg_s2: the board accelerates with 500 deg/s²");
}

TEST(refuses__homing) {
    const struct virtual_gcode_options off = {.homing_off = TRUE};
    refuses(&off, FAST, CONFIG_ERROR, CONFIG_ERROR_VALUE, "homing: homing is off in the board");
}

TEST(refuses__letter) {
    refuses(&grbl, FAST "letter = A\n", CONFIG_ERROR, CONFIG_ERROR_VALUE,
            "letter: the board has no axis A");
    refuses(&klipper, KLIPPER FAST "letter = A\n", CONFIG_ERROR, CONFIG_ERROR_VALUE,
            "letter: the board has no axis A");
}

TEST(refuses__limits) {
    refuses(&grbl, "units_per_deg = 0\nspeed_deg_s = 5\naccel_deg_s2 = 10\n", CONFIG_ERROR,
            CONFIG_ERROR_VALUE, "units_per_deg: must not be 0");
}

TEST(refuses__other_language) {
    refuses(&marlin, FAST, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT, "baud and dialect");
    refuses(&grbl, MARLIN FAST, DEVICE_ERROR, DEVICE_ERROR_PROTOCOL,
            "the board does not speak marlin");
    refuses(&grbl, KLIPPER FAST, DEVICE_ERROR, DEVICE_ERROR_PROTOCOL,
            "the board does not speak klipper");
    refuses(&marlin, KLIPPER FAST, DEVICE_ERROR, DEVICE_ERROR_PROTOCOL,
            "the board does not speak klipper");
    refuses(&klipper, MARLIN FAST, DEVICE_ERROR, DEVICE_ERROR_PROTOCOL,
            "the board does not speak marlin");
}

TEST(refuses__halted_klipper) {
    struct virtual_gcode_options halted = klipper;
    halted.halted = TRUE;
    refuses(&halted, KLIPPER FAST, DEVICE_ERROR, DEVICE_ERROR_UNSUPPORTED,
            "Klipper reports: Option 'step_pin' is not specified; correct its configuration");
}

TEST(refuses__silence) {
    struct bench bench;
    GError *error = NULL;
    begin_board(&bench, &grbl);
    virtual_gcode_fail(bench.board, &(struct virtual_gcode_faults){.cut = TRUE});
    g_assert_null(open_axis(&bench, &bench.a, FAST, &error));
    conformance_expect_error(&error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT,
                             "the board has not answered for 1200 ms");
    close_part(&bench.a);
    virtual_gcode_fail(bench.board, &(struct virtual_gcode_faults){0});
    virtual_gcode_unplug(bench.board);
    g_assert_null(open_axis(&bench, &bench.a, FAST, &error));
    conformance_expect_error(&error, DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED, "cannot open");
    close_part(&bench.a);
    virtual_gcode_plug(bench.board);
    ok(open_axis(&bench, &bench.a, FAST, ERR));
    end(&bench);
}

/* Two sections of a board agree about its settings. */
TEST(refuses__second_section) {
    struct bench bench;
    GError *error = NULL;
    begin(&bench, &grbl, FAST, NULL);
    g_assert_null(open_axis(&bench, &bench.b, FAST "letter = Y\nbaud = 9600\n", &error));
    conformance_expect_error(&error, CONFIG_ERROR, CONFIG_ERROR_VALUE,
                             "port: another section opens");
    end(&bench);
}

/* So do two sections of a rig file, before anything is opened. */
TEST(refuses__other_settings) {
    struct bench bench;
    GError *error = NULL;
    gsize n;
    begin_board(&bench, &grbl);
    const char *port = virtual_gcode_port(bench.board);
    g_autofree char *text =
        g_strdup_printf("[axis a]\ndriver = gcode-axis\nport = %s\n" FAST
                        "[axis b]\ndriver = gcode-axis\nport = %s\nletter = Y\nbaud = 9600\n" FAST,
                        port, port);
    g_autoptr(Config) config = ok(config_parse(text, "./test.conf", ERR));
    const struct config_section *sections = config_sections(config, &n);
    g_assert_null(axis_open(&gcode_axis_driver, &sections[1], NULL, bench.clock, &error));
    conformance_expect_error(&error, CONFIG_ERROR, CONFIG_ERROR_VALUE,
                             "port: [axis a], in line 1, opens");
    end(&bench);
}

/* The language of a board is found by its answer, also if the board is locked or boots. */
TEST(detects) {
    static const struct {
        const struct virtual_gcode_options *options;
        const char *says, *firmware; /* a line of the board, instead of its own answer, or NULL */
        enum gcode_dialect dialect;
    } cases[] = {
        {&grbl, NULL, "GRBL", GCODE_GRBL},
        {&marlin, NULL, "Marlin 2.1.2 (Jan 1 2023)", GCODE_MARLIN},
        {&klipper, NULL, "Klipper v0.13.0-300-g1234567", GCODE_KLIPPER},
        {&grbl, "FIRMWARE_NAME:grblHAL FIRMWARE_URL:x", "grblHAL", GCODE_GRBL},
        {&grbl, "Grbl 3.7 [FluidNC v3.7.8 (wifi) '$' for help]", "GRBL", GCODE_GRBL},
        {&marlin, "FIRMWARE_NAME:Smoothieware, X-GRBL_MODE:0", NULL, GCODE_MARLIN},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        struct bench bench;
        struct virtual_gcode_options options = *cases[i].options;
        enum gcode_dialect dialect = GCODE_GRBL;
        g_autofree char *firmware = NULL;
        int baud = 0;
        GError *error = NULL;
        options.resets_on_open = options.language == VIRTUAL_MARLIN && !cases[i].says;
        options.boot_ms = 300;
        begin_board(&bench, &options);
        if (cases[i].says) {
            /* The line comes when the port is open, before the answer of the board itself. */
            virtual_gcode_fail(bench.board, &(struct virtual_gcode_faults){.late_ms = 200});
            virtual_gcode_send(bench.board, cases[i].says);
            virtual_gcode_fail(bench.board, &(struct virtual_gcode_faults){.late_ms = 400});
        }
        const gboolean found =
            gcode_detect(virtual_gcode_port(bench.board), &dialect, &baud, &firmware, &error);
        if (cases[i].firmware) {
            g_assert_no_error(error);
            g_assert_cmpint(dialect, ==, cases[i].dialect);
            g_assert_cmpint(baud, ==, 115200);
            g_assert_cmpstr(firmware, ==, cases[i].firmware);
        } else {
            g_assert_false(found);
            conformance_expect_error(&error, DEVICE_ERROR, DEVICE_ERROR_UNSUPPORTED,
                                     "the firmware of the board is Smoothieware");
        }
        virtual_gcode_fail(bench.board, &(struct virtual_gcode_faults){0});
        end(&bench);
    }
}

/* Presets are sections to copy: every key of theirs is one of the driver's. */
TEST(presets) {
    static const char *const names[] = {"grbl.conf", "marlin.conf", "klipper.conf"};
    static const char *const also[] = {"driver", NULL};
    for (gsize i = 0; i < G_N_ELEMENTS(names); i++) {
        const struct driver_info *info = &gcode_axis_driver.info;
        g_autofree char *path = g_build_filename(SOURCE_DIR "/etc/devices", names[i], NULL);
        g_autoptr(Config) config = ok(config_load(path, ERR));
        g_autofree gpointer priv = g_malloc0(info->priv_size);
        gsize n;
        const struct config_section *section = config_sections(config, &n);
        g_assert_cmpuint(n, ==, 1);
        ok(options_parse(info->options, section, also, priv, ERR));
        options_clear(info->options, priv);
    }
}

/* Each fault comes during a move, or before it. Afterwards the axis stands, its position is not
 * known, and after homing it works again. */
enum when { MOVING, BEFORE, HOMING, STANDING };

static void press(VirtualGcode *board) {
    virtual_gcode_press(board, 0, TRUE);
    virtual_gcode_press(board, 0, FALSE);
}

static void open_door(VirtualGcode *board) {
    virtual_gcode_set_door(board, TRUE);
}

/* Somebody presses the emergency stop of a user interface of Klipper. */
static void send_m112(VirtualGcode *board) {
    virtual_gcode_receive(board, "M112\n");
}

static void push(VirtualGcode *board) {
    virtual_gcode_push(board, 0, 0.5);
}

static const struct fault {
    const char *name, *keys;
    enum when when;
    struct virtual_gcode_faults faults;
    void (*act)(VirtualGcode *board);
    enum device_error code;
    const char *says;
} faults[] = {
    {"silence",
     "",
     MOVING,
     {.silent = TRUE},
     NULL,
     DEVICE_ERROR_TIMEOUT,
     "the board has not answered for 500 ms; check its power"},
    {"cut", "", MOVING, {.cut = TRUE}, NULL, DEVICE_ERROR_TIMEOUT, "has not answered"},
    {"cut-before", "", BEFORE, {.cut = TRUE}, NULL, DEVICE_ERROR_TIMEOUT, "has not answered"},
    {"late-ok", "", BEFORE, {.late_ok_ms = 1300}, NULL, DEVICE_ERROR_TIMEOUT, "has not answered"},
    {"late", "", BEFORE, {.late_ms = 1300}, NULL, DEVICE_ERROR_TIMEOUT, "has not answered"},
    {"lost-answers", "", MOVING, {.lose_sent = 5}, NULL, DEVICE_ERROR_TIMEOUT, "has not answered"},
    {"damaged-answers",
     "",
     MOVING,
     {.damage_sent = 7},
     NULL,
     DEVICE_ERROR_TIMEOUT,
     "has not answered"},
    {"lost-lines", "", BEFORE, {.lose_received = 2}, NULL, DEVICE_ERROR_PROTOCOL, "error "},
    {"error-9",
     "",
     BEFORE,
     {.error = 9},
     NULL,
     DEVICE_ERROR_PROTOCOL,
     "error 9: the board is locked by an alarm; home it"},
    {"error-77",
     "",
     BEFORE,
     {.error = 77},
     NULL,
     DEVICE_ERROR_PROTOCOL,
     "error 77; see the manual of 1.1h"},
    {"limit-switch",
     "",
     MOVING,
     {0},
     press,
     DEVICE_ERROR_STALLED,
     "alarm 1: a limit switch stopped it; move the axis off the switch"},
    {"reset",
     "",
     MOVING,
     {0},
     virtual_gcode_reset,
     DEVICE_ERROR_DISCONNECTED,
     "the board was reset, so its position is lost"},
    {"reset-standing",
     "",
     STANDING,
     {0},
     virtual_gcode_reset,
     DEVICE_ERROR_DISCONNECTED,
     "the board was reset"},
    {"unplugged",
     "",
     MOVING,
     {0},
     virtual_gcode_unplug,
     DEVICE_ERROR_DISCONNECTED,
     "was unplugged or its port has failed"},
    {"unplugged-standing",
     "",
     STANDING,
     {0},
     virtual_gcode_unplug,
     DEVICE_ERROR_DISCONNECTED,
     "was unplugged"},
    {"door",
     "",
     MOVING,
     {0},
     open_door,
     DEVICE_ERROR_STALLED,
     "the safety door is open; close it, then home it"},
    {"hold-button",
     "",
     MOVING,
     {0},
     virtual_gcode_press_hold,
     DEVICE_ERROR_STALLED,
     "a feed hold stopped it"},
    {"pushed", "", STANDING, {0}, push, DEVICE_ERROR_STALLED, "without a command"},
    {"no-switch",
     "",
     HOMING,
     {.no_switch = TRUE},
     NULL,
     DEVICE_ERROR_STALLED,
     "alarm 9: homing did not find the limit switch"},
    {"silent-marlin",
     MARLIN,
     MOVING,
     {.silent = TRUE},
     NULL,
     DEVICE_ERROR_TIMEOUT,
     "has not answered"},
    {"cut-marlin", MARLIN, BEFORE, {.cut = TRUE}, NULL, DEVICE_ERROR_TIMEOUT, "has not answered"},
    {"late-ok-marlin",
     MARLIN,
     BEFORE,
     {.late_ok_ms = 1300},
     NULL,
     DEVICE_ERROR_TIMEOUT,
     "has not answered"},
    {"lost-answers-marlin",
     MARLIN,
     MOVING,
     {.lose_sent = 5},
     NULL,
     DEVICE_ERROR_TIMEOUT,
     "has not answered"},
    {"reset-marlin",
     MARLIN,
     MOVING,
     {0},
     virtual_gcode_reset,
     DEVICE_ERROR_DISCONNECTED,
     "the board was reset"},
    {"unplugged-marlin",
     MARLIN,
     MOVING,
     {0},
     virtual_gcode_unplug,
     DEVICE_ERROR_DISCONNECTED,
     "was unplugged"},
    {"pushed-marlin", MARLIN, STANDING, {0}, push, DEVICE_ERROR_STALLED, "without a command"},
    {"silent-klipper",
     KLIPPER,
     MOVING,
     {.silent = TRUE},
     NULL,
     DEVICE_ERROR_TIMEOUT,
     "has not answered"},
    {"cut-klipper", KLIPPER, MOVING, {.cut = TRUE}, NULL, DEVICE_ERROR_TIMEOUT, "has not answered"},
    {"cut-before-klipper",
     KLIPPER,
     BEFORE,
     {.cut = TRUE},
     NULL,
     DEVICE_ERROR_TIMEOUT,
     "has not answered"},
    {"late-ok-klipper",
     KLIPPER,
     BEFORE,
     {.late_ok_ms = 1300},
     NULL,
     DEVICE_ERROR_TIMEOUT,
     "has not answered"},
    {"lost-answers-klipper",
     KLIPPER,
     MOVING,
     {.lose_sent = 5},
     NULL,
     DEVICE_ERROR_TIMEOUT,
     "has not answered"},
    {"reset-klipper",
     KLIPPER,
     MOVING,
     {0},
     virtual_gcode_reset,
     DEVICE_ERROR_DISCONNECTED,
     "Klipper was restarted, so the position is lost; home it"},
    {"reset-standing-klipper",
     KLIPPER,
     STANDING,
     {0},
     virtual_gcode_reset,
     DEVICE_ERROR_DISCONNECTED,
     "Klipper was restarted"},
    {"unplugged-klipper",
     KLIPPER,
     MOVING,
     {0},
     virtual_gcode_unplug,
     DEVICE_ERROR_DISCONNECTED,
     "was unplugged"},
    {"pushed-klipper", KLIPPER, STANDING, {0}, push, DEVICE_ERROR_STALLED, "without a command"},
    {"m112-klipper",
     KLIPPER,
     MOVING,
     {0},
     send_m112,
     DEVICE_ERROR_STALLED,
     "Klipper has shut down, so the position is lost; see its log"},
    {"m112-standing-klipper",
     KLIPPER,
     STANDING,
     {0},
     send_m112,
     DEVICE_ERROR_STALLED,
     "Klipper has shut down"},
    {"no-switch-klipper",
     KLIPPER,
     HOMING,
     {.no_switch = TRUE},
     NULL,
     DEVICE_ERROR_STALLED,
     "Klipper reports: No trigger on x after full movement; check its switches"},
};

static void run_fault(gconstpointer data) {
    const struct fault *fault = data;
    const gboolean is_marlin = strcmp(fault->keys, MARLIN) == 0;
    struct bench bench;
    g_autofree char *keys = g_strconcat(fault->keys, MOTION, NULL);
    struct virtual_gcode_options options = is_marlin ? marlin : *fault->keys ? klipper : grbl;
    options.resets_on_open = is_marlin; /* M112 may halt it */
    begin(&bench, &options, keys, NULL);
    home(&bench, &bench.a);
    if (fault->when != MOVING)
        virtual_gcode_fail(bench.board, &fault->faults);
    if (fault->when == HOMING)
        ok(axis_home(bench.a.axis, ERR));
    else if (fault->when != STANDING)
        ok(axis_move(bench.a.axis, 300, ERR));
    if (fault->when == MOVING) {
        wait_moving(&bench);
        virtual_gcode_fail(bench.board, &fault->faults);
    }
    if (fault->act)
        fault->act(bench.board);
    expect(&bench, &bench.a, AXIS_FAULT);
    g_assert_error(bench.a.error, DEVICE_ERROR, (int)fault->code);
    g_assert_true(g_str_has_prefix(bench.a.error->message, "axis test: "));
    if (!strstr(bench.a.error->message, fault->says))
        g_error("\"%s\" does not say \"%s\"", bench.a.error->message, fault->says);
    g_assert_false(axis_is_homed(bench.a.axis));
    conformance_pass(bench.clock, 1);
    virtual_gcode_fail(bench.board, &(struct virtual_gcode_faults){0});
    virtual_gcode_set_door(bench.board, FALSE);
    if (fault->act == virtual_gcode_unplug)
        virtual_gcode_plug(bench.board);
    if (fault->faults.late_ms > 0) /* a late answer may arrive during homing */
        conformance_pass(bench.clock, 2e-3 * fault->faults.late_ms);
    wait_safe(&bench, &bench.a);
    g_assert_false(state_of(&bench).moving);
    g_assert_cmpfloat(state_of(&bench).at[0], <, 590);
    g_assert_cmpint(bench.a.n, ==, 0); /* one cause, one fault */
    home(&bench, &bench.a);
    move(&bench, &bench.a, 5);
    assert_at(&bench, 0, HOME_AT + 10);
    end(&bench);
}

/* Without [force_move], Klipper does not know SET_KINEMATIC_POSITION. */
TEST(no_force_move) {
    struct bench bench;
    struct virtual_gcode_options options = klipper;
    options.homing_off = TRUE;
    begin(&bench, &options, KLIPPER FAST "homing = here\n", NULL);
    ok(axis_home(bench.a.axis, ERR));
    expect(&bench, &bench.a, AXIS_FAULT);
    if (!strstr(bench.a.error->message, "unknown command \"SET_KINEMATIC_POSITION\"; set "
                                        "enable_force_move: True"))
        g_error("%s", bench.a.error->message);
    wait_safe(&bench, &bench.a);
    end(&bench);
}

TEST(soft_limit_klipper) {
    struct bench bench;
    struct virtual_gcode_options options = klipper;
    options.max_travel = 50;
    begin(&bench, &options, KLIPPER MOTION, NULL);
    home(&bench, &bench.a);
    ok(axis_move(bench.a.axis, 30, ERR));
    expect(&bench, &bench.a, AXIS_FAULT);
    if (!strstr(bench.a.error->message, "Klipper reports: Move out of range: "))
        g_error("%s", bench.a.error->message);
    wait_safe(&bench, &bench.a);
    g_assert_cmpint(state_of(&bench).n_kills, ==, 0);
    home(&bench, &bench.a);
    move(&bench, &bench.a, 20);
    end(&bench);
}

/* The board's own limits are narrower than the section says. */
TEST(soft_limit) {
    struct bench bench;
    struct virtual_gcode_options options = grbl;
    options.max_travel = 50;
    begin(&bench, &options, MOTION, NULL);
    home(&bench, &bench.a);
    ok(axis_move(bench.a.axis, 30, ERR));
    expect(&bench, &bench.a, AXIS_FAULT);
    if (!strstr(bench.a.error->message, "alarm 2: the target is beyond the travel"))
        g_error("%s", bench.a.error->message);
    wait_safe(&bench, &bench.a);
    home(&bench, &bench.a);
    move(&bench, &bench.a, 20);
    end(&bench);
}

/* Noise, and single damaged answers, do not end a motion. */
TEST(noise) {
    struct bench bench;
    begin(&bench, &grbl, FAST, NULL);
    home(&bench, &bench.a);
    virtual_gcode_fail(bench.board, &(struct virtual_gcode_faults){.noise = TRUE});
    for (int i = 0; i < 10; i++)
        move(&bench, &bench.a, 10 * (i & 1));
    assert_at(&bench, 0, HOME_AT + 20);
    virtual_gcode_fail(bench.board, &(struct virtual_gcode_faults){0});
    end(&bench);
}

/* A digit that is lost is not taken for another position. What is lost may be an "ok", which is
 * missed. */
TEST(lost_digits) {
    struct bench bench;
    int n_arrived = 0;
    begin(&bench, &grbl, FAST, NULL);
    home(&bench, &bench.a);
    for (int i = 0; i < 40; i++) {
        const double deg = 100 + 10 * (i & 1);
        virtual_gcode_fail(bench.board, &(struct virtual_gcode_faults){.lose_sent = 61 + i});
        ok(axis_move(bench.a.axis, deg, ERR));
        conformance_wait(bench.clock, &bench.a.n, 1, 60);
        if (bench.a.last == AXIS_ARRIVED) {
            assert_at(&bench, 0, HOME_AT + 2 * deg);
            n_arrived++;
        } else {
            g_assert_error(bench.a.error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT);
        }
        bench.a.n = 0;
        virtual_gcode_fail(bench.board, &(struct virtual_gcode_faults){0});
        wait_safe(&bench, &bench.a);
        if (!axis_is_homed(bench.a.axis))
            home(&bench, &bench.a);
    }
    g_test_message("%d of 40 moves ended without an error", n_arrived);
    g_assert_cmpint(n_arrived, >, 10);
    end(&bench);
}

/* Marlin asks for damaged lines again. */
TEST(resend) {
    struct bench bench;
    begin(&bench, &marlin, MARLIN FAST, NULL);
    home(&bench, &bench.a);
    virtual_gcode_fail(bench.board, &(struct virtual_gcode_faults){.lose_received = 67});
    for (int i = 0; i < 10; i++)
        move(&bench, &bench.a, 10 * (i & 1));
    g_assert_cmpint(state_of(&bench).n_resends, >, 0);
    assert_at(&bench, 0, HOME_AT + 20);
    virtual_gcode_fail(bench.board, &(struct virtual_gcode_faults){0});
    end(&bench);
}

/* A Marlin that has halted itself says so until it was reset. */
TEST(halted) {
    struct bench bench;
    begin(&bench, &marlin, MARLIN MOTION, NULL);
    home(&bench, &bench.a);
    virtual_gcode_fail(bench.board, &(struct virtual_gcode_faults){.no_switch = TRUE});
    ok(axis_home(bench.a.axis, ERR));
    expect(&bench, &bench.a, AXIS_FAULT);
    if (!strstr(bench.a.error->message, "Homing Failed"))
        g_error("%s", bench.a.error->message);
    wait_safe(&bench, &bench.a);
    virtual_gcode_fail(bench.board, &(struct virtual_gcode_faults){0});
    ok(axis_home(bench.a.axis, ERR));
    expect(&bench, &bench.a, AXIS_FAULT);
    if (!strstr(bench.a.error->message, "the board has halted itself; press its reset button"))
        g_error("%s", bench.a.error->message);
    virtual_gcode_reset(bench.board);
    wait_safe(&bench, &bench.a);
    home(&bench, &bench.a);
    move(&bench, &bench.a, 5);
    end(&bench);
}

/* A Marlin that does not answer M410 is halted by M112. If nothing comes, the port is opened again,
 * which resets most boards. */
TEST(last_resort) {
    struct bench bench;
    struct virtual_gcode_options options = marlin;
    options.resets_on_open = TRUE;
    begin(&bench, &options, MARLIN MOTION, NULL);
    home(&bench, &bench.a);
    ok(axis_move(bench.a.axis, 300, ERR));
    wait_moving(&bench);
    virtual_gcode_fail(bench.board, &(struct virtual_gcode_faults){.silent = TRUE});
    expect(&bench, &bench.a, AXIS_FAULT);
    UNTIL (state_of(&bench).n_kills > 0)
        conformance_pass(bench.clock, 0.01);
    g_assert_cmpint(axis_safety(bench.a.axis), !=, DEVICE_SAFE);
    virtual_gcode_fail(bench.board, &(struct virtual_gcode_faults){0});
    wait_safe(&bench, &bench.a);
    home(&bench, &bench.a);
    move(&bench, &bench.a, 5);
    end(&bench);
}

/* Answers without a request, and commands, at random times. Afterwards both axes are safe, can be
 * homed, and are where they say. */
static void chaos(const struct virtual_gcode_options *with, const char *language, guint32 seed) {
    static const char *const lines[] = {
        "ok",
        "error:9",
        "ALARM:1",
        "ALARM:3",
        "Grbl 1.1h ['$' for help]",
        "<Idle|MPos:1.000,2.000,3.000|FS:0,0>",
        "<Run|MPos:9.000,2.000,3.000|FS:0,0>",
        "<Hold:0|MPos:1.000,2.000,3.000|FS:0,0>",
        "<Hold:1|MPos:1.000,2.000,3.000|FS:0,0>",
        "<Alarm|MPos:1.000,2.000,3.000|FS:0,0>",
        "<Door:1|MPos:1.000,2.000,3.000|FS:0,0>",
        "<Tool|MPos:1.000,2.000,3.000|FS:0,0>",
        "<Idle|MPos:1.000,2.000,3.000,4.000|FS:0,0>",
        "<Idle|WPos:1.000,2.000,3.000|FS:0,0>",
        "start",
        "Resend: 3",
        "Resend: 99999",
        "echo:busy: processing",
        "echo:Unknown command: \"L1\"",
        "Error:something",
        "Error:Printer halted. kill() called!",
        "X:1.00 Y:2.00 Z:3.00 E:0.00 Count X:1000 Y:2000 Z:3000",
        "X:1.000 Y:2.000 Z:3.000 E:0.000",
        "// Klipper state: Ready",
        "// Klipper state: Shutdown",
        "// Klipper state: Disconnect",
        "// ECHO MESORIG=1",
        "// Unknown command:\"G28\"",
        "!! Must home axis first: 1.000 2.000 3.000 [0.000]",
    };
    struct bench bench;
    g_autoptr(GRand) random = g_rand_new_with_seed(seed);
    g_autofree char *a = g_strconcat(language, FAST, NULL);
    g_autofree char *b = g_strconcat(language, FAST "letter = Y\n", NULL);
    begin(&bench, with, a, b);
    for (int i = 0; i < 400; i++) {
        Axis *axis = g_rand_boolean(random) ? bench.a.axis : bench.b.axis;
        switch (g_rand_int_range(random, 0, 8)) {
        case 0:
            axis_home(axis, NULL);
            break;
        case 1:
            axis_move(axis, g_rand_int_range(random, -300, 300), NULL);
            break;
        case 2:
            axis_stop(axis, NULL);
            break;
        case 3:
            axis_halt(axis, NULL);
            break;
        default:
            virtual_gcode_send(bench.board,
                               lines[g_rand_int_range(random, 0, (int)G_N_ELEMENTS(lines))]);
            break;
        }
        conformance_pass(bench.clock, g_rand_boolean(random) ? 0.001 : 0.02);
    }
    struct part *parts[] = {&bench.a, &bench.b};
    for (int i = 0; i < 2; i++) {
        ok(axis_halt(parts[i]->axis, ERR));
        UNTIL (!axis_is_moving(parts[i]->axis) && axis_safety(parts[i]->axis) == DEVICE_SAFE)
            conformance_pass(bench.clock, 0.01);
    }
    conformance_pass(bench.clock, 0.5); /* what was sent last has been heard */
    for (int i = 0; i < 2; i++) {
        wait_safe(&bench, parts[i]);
        parts[i]->n = 0;
        home(&bench, parts[i]);
    }
    for (int i = 0; i < 2; i++) {
        move(&bench, parts[i], 20 + i);
        assert_at(&bench, i, HOME_AT + 2 * (20 + i));
    }
    end(&bench);
}

TEST(chaos) {
    for (guint32 seed = 1; seed <= 2; seed++)
        chaos(&grbl, "", seed);
}

TEST(chaos_marlin) {
    struct virtual_gcode_options options = marlin;
    options.resets_on_open = TRUE;
    for (guint32 seed = 1; seed <= 2; seed++)
        chaos(&options, MARLIN, seed);
}

TEST(chaos_klipper) {
    for (guint32 seed = 1; seed <= 2; seed++)
        chaos(&klipper, KLIPPER, seed);
}

BEFORE_TESTS {
    for (gsize i = 0; i < G_N_ELEMENTS(faults); i++) {
        g_autofree char *path = g_strdup_printf("/gcode/fault/%s", faults[i].name);
        g_test_add_data_func(path, &faults[i], run_fault);
    }
}
