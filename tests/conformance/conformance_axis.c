#include "conformance_private.h"
#include "lib/ok.h"
#include "lib/wait.h"
#include "reports.h"

#include <math.h>

struct bench {
    const struct axis_driver *driver;
    const struct conformance *with;
    Clock *clock;
    Axis *axis;
    int n_events;
    enum axis_event last;
    /* The reports of a turn: their number, and the first and the last time that was predicted for
     * passing_deg. */
    int n_passing;
    double passing_deg;
    struct conformance_safety safety;
    gint64 said_first_us, said_last_us;
};

static void note_passing(struct bench *bench) {
    gint64 us;
    g_assert_true(axis_is_moving(bench->axis));
    bench->n_passing++;
    if (!axis_passes_at(bench->axis, bench->passing_deg, &us))
        return;
    bench->said_first_us = bench->said_first_us ? bench->said_first_us : us;
    if (us > clock_now_us(bench->clock))
        bench->said_last_us = us;
}

static void on_event(Axis *axis, enum axis_event event, const GError *error, gpointer data) {
    struct bench *bench = data;
    if (event == AXIS_PASSING) {
        note_passing(bench);
        return;
    }
    g_assert_false(axis_is_moving(axis));
    g_assert_cmpint(event == AXIS_FAULT, ==, error != NULL);
    if (error != NULL)
        g_test_message("fault: %s", error->message);
    bench->n_events++;
    bench->last = event;
}

static gboolean open_with(struct bench *bench, const char *keys) {
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(bench->with, keys, &section);
    g_autoptr(GError) error = NULL;
    bench->axis = axis_open(bench->driver, section, NULL, bench->clock, &error);
    if (!conformance_opened(bench->axis, error))
        return FALSE;
    axis_listen(bench->axis, on_event, bench);
    device_watch_safety(&bench->axis->device, conformance_on_safety, &bench->safety);
    return TRUE;
}

static gboolean begin(struct bench *bench, gconstpointer driver, const struct conformance *with) {
    *bench = (struct bench){reports_of_axis(driver), with, conformance_clock(with)};
    return open_with(bench, "");
}

static void end(struct bench *bench) {
    axis_close(g_steal_pointer(&bench->axis));
    g_clear_pointer(&bench->clock, clock_unref);
}

/* Returns the position at a fraction of the axis's range, or of a turn for a wrapping axis. */
static double at(const struct bench *bench, double fraction) {
    const struct axis_motion *m = &bench->axis->motion;
    return m->wraps ? 360 * fraction : m->min_deg + fraction * (m->max_deg - m->min_deg);
}

static double tolerance(const struct bench *bench) {
    return bench->with->tolerance_deg > 0 ? bench->with->tolerance_deg : 0.01;
}

static void start_move(struct bench *bench, double to_deg) {
    GError *error = NULL;
    gboolean ok = axis_move(bench->axis, to_deg, &error);
    g_assert_no_error(error);
    g_assert_true(ok);
    g_assert_true(axis_is_moving(bench->axis));
}

static void expect(struct bench *bench, enum axis_event event) {
    conformance_wait(bench->clock, &bench->n_events, 1, 600);
    g_assert_cmpint(bench->n_events, ==, 1);
    g_assert_cmpint(bench->last, ==, event);
    bench->n_events = 0;
}

static void expect_silence(struct bench *bench, double seconds) {
    conformance_pass(bench->clock, seconds);
    g_assert_cmpint(bench->n_events, ==, 0);
}

static void home(struct bench *bench) {
    GError *error = NULL;
    gboolean ok = axis_home(bench->axis, &error);
    g_assert_no_error(error);
    g_assert_true(ok);
    expect(bench, AXIS_HOMED);
    g_assert_true(axis_is_homed(bench->axis));
}

static void assert_at(struct bench *bench, double deg) {
    double off = axis_way_deg(&bench->axis->motion, axis_position_deg(bench->axis), deg);
    g_assert_cmpfloat(fabs(off), <=, tolerance(bench));
}

static void assert_refused(struct bench *bench, double to_deg, enum device_error code) {
    GError *error = NULL;
    double before = axis_position_deg(bench->axis);
    g_assert_false(axis_move(bench->axis, to_deg, &error));
    g_assert_error(error, DEVICE_ERROR, (int)code);
    g_clear_error(&error);
    if (code == DEVICE_ERROR_RANGE)
        g_assert_cmpfloat(axis_position_deg(bench->axis), ==, before);
}

static void wrong_option(struct bench *bench) {
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(bench->with, "no_such_option = 1\n", &section);
    GError *error = NULL;
    g_assert_null(axis_open(bench->driver, section, NULL, bench->clock, &error));
    conformance_assert_unknown_option(error);
}

static void opens_still(struct bench *bench) {
    const struct axis_motion *m = &bench->axis->motion;
    g_assert_true(m->wraps || m->min_deg < m->max_deg);
    g_assert_cmpfloat(m->speed_deg_s, >, 0);
    g_assert_cmpfloat(m->accel_deg_s2, >, 0);
    g_assert_false(axis_is_homed(bench->axis));
    g_assert_false(axis_is_moving(bench->axis));
    double before = axis_position_deg(bench->axis);
    expect_silence(bench, 0.3);
    g_assert_cmpfloat(axis_position_deg(bench->axis), ==, before);
}

static void not_homed(struct bench *bench) {
    assert_refused(bench, at(bench, 0.5), DEVICE_ERROR_RANGE);
    expect_silence(bench, 0.3);
}

static void homes(struct bench *bench) {
    home(bench);
    expect_silence(bench, 0.3);
    home(bench);
}

/* Moves to a position. Returns whether that took about as long as predicted. */
static gboolean moves_in_time(struct bench *bench, double to) {
    const double predicted =
        axis_move_time_s(&bench->axis->motion, axis_position_deg(bench->axis), to);
    const gint64 start = clock_now_us(bench->clock);
    start_move(bench, to);
    expect(bench, AXIS_ARRIVED);
    assert_at(bench, to);
    return (double)(clock_now_us(bench->clock) - start) / 1e6 <= predicted * 1.5 + 2;
}

/* Checks that a move takes about as long as predicted. On a real clock, a busy computer can make a
 * move late. The move is then repeated. */
static void move_in_time(struct bench *bench, double to) {
    const double from = axis_position_deg(bench->axis);
    UNTIL (moves_in_time(bench, to)) {
        g_assert_true(bench->with->real_clock);
        start_move(bench, from);
        expect(bench, AXIS_ARRIVED);
    }
}

static void moves(struct bench *bench) {
    static const double fractions[] = {0.5, 0.75, 0.25, 0.26, 0.255};
    home(bench);
    for (gsize i = 0; i < G_N_ELEMENTS(fractions); i++) {
        move_in_time(bench, at(bench, fractions[i]));
        expect_silence(bench, 0.3);
    }
}

/* On a real clock, a motion that should be under way may have ended, if this program did not run in
 * the meantime. Asserts that this was the reason: a motion never ends in less than half of its
 * time. */
static void assert_held_up(struct bench *bench, gint64 start_us, double motion_s) {
    g_assert_true(bench->with->real_clock);
    g_assert_cmpfloat((double)(clock_now_us(bench->clock) - start_us) / 1e6, >=, motion_s / 2);
}

static void refuses_turn(struct bench *bench, double by_deg, double speed_deg_s) {
    GError *error = NULL;
    const double before = axis_position_deg(bench->axis);
    g_assert_false(axis_turn(bench->axis, by_deg, speed_deg_s, &error));
    conformance_expect_error(&error, DEVICE_ERROR, DEVICE_ERROR_RANGE, "");
    g_assert_false(axis_is_moving(bench->axis));
    g_assert_cmpfloat(axis_position_deg(bench->axis), ==, before);
}

/* Turns, and returns whether the axis has reported its position before and after the middle of the
 * turn. Asserts that the reports are right: the axis was where they say, at a steady speed. Asserts
 * that the axis arrives. */
static gboolean turns_with_reports(struct bench *bench, double from, double by, double speed) {
    const struct axis_motion *m = &bench->axis->motion;
    double deg, later_deg;
    bench->n_passing = 0;
    bench->said_first_us = bench->said_last_us = 0;
    bench->passing_deg = axis_position_deg(bench->axis) + by / 2;
    ok(axis_turn(bench->axis, by, speed, ERR));
    bench->passing_deg = axis_turned_from_deg(bench->axis) + by / 2;
    expect(bench, AXIS_ARRIVED);
    assert_at(bench, from + by);
    g_assert_false(axis_was_at(bench->axis, clock_now_us(bench->clock) + 1, &deg));
    const gint64 later_us = bench->said_last_us + (gint64)(by / 8 / speed * 1e6);
    if (bench->n_passing < 3 || bench->said_first_us == 0 || bench->said_last_us == 0 ||
        !axis_was_at(bench->axis, bench->said_last_us, &deg) ||
        !axis_was_at(bench->axis, later_us, &later_deg))
        return FALSE;
    const double off = tolerance(bench) + speed * 2e-3 * m->stamp_ms;
    g_assert_cmpfloat((double)ABS(bench->said_last_us - bench->said_first_us) * 1e-6 * speed, <=,
                      2 * off + 0.05 * by);
    g_assert_cmpfloat(fabs(deg - bench->passing_deg), <=, 2 * off);
    g_assert_cmpfloat(fabs(later_deg - deg - by / 8), <=, 2 * off + 0.01 * by / 8);
    return TRUE;
}

/* Checks that the axis turns as it reports, or that it refuses a turn and does not move. Drivers
 * leave out a report whose answer took too long, as on a busy computer. The turn is then repeated.
 */
static void turns(struct bench *bench) {
    const struct axis_motion *m = &bench->axis->motion;
    const double from = at(bench, 0.25), by = at(bench, 0.75) - from;
    double speed = m->speed_deg_s / 2;
    home(bench);
    start_move(bench, from);
    expect(bench, AXIS_ARRIVED);
    if (!axis_can_turn(bench->axis)) {
        refuses_turn(bench, by, speed);
        return;
    }
    refuses_turn(bench, by, m->speed_deg_s * 1.01);
    refuses_turn(bench, by, 0);
    refuses_turn(bench, -by, speed);
    /* At least half of the way is at this speed. */
    speed = MIN(speed, sqrt(by * m->accel_deg_s2 / 4));
    UNTIL (turns_with_reports(bench, from, by, speed)) {
        g_assert_true(bench->with->real_clock);
        start_move(bench, from);
        expect(bench, AXIS_ARRIVED);
    }
    move_in_time(bench, from); /* a turn does not change the speed of moves */
}

/* Checks that axis_stop() stops a turn in its middle. */
static void stops_turning(struct bench *bench) {
    const double from = at(bench, 0.25), by = at(bench, 0.75) - from;
    home(bench);
    start_move(bench, from);
    expect(bench, AXIS_ARRIVED);
    if (!axis_can_turn(bench->axis))
        return;
    const double half_s = by / bench->axis->motion.speed_deg_s;
    gint64 start_us = 0;
    UNTIL (start_us != 0 && axis_is_moving(bench->axis)) {
        if (start_us != 0) {
            assert_held_up(bench, start_us, 2 * half_s);
            expect(bench, AXIS_ARRIVED);
            start_move(bench, from);
            expect(bench, AXIS_ARRIVED);
        }
        start_us = clock_now_us(bench->clock);
        g_assert_true(axis_turn(bench->axis, by, bench->axis->motion.speed_deg_s / 2, NULL));
        conformance_pass(bench->clock, half_s);
    }
    g_assert_true(axis_stop(bench->axis, NULL));
    expect(bench, AXIS_STOPPED);
    expect_silence(bench, 0.5);
    start_move(bench, from);
    expect(bench, AXIS_ARRIVED);
    assert_at(bench, from);
}

static void same_place(struct bench *bench) {
    home(bench);
    start_move(bench, at(bench, 0.4));
    expect(bench, AXIS_ARRIVED);
    start_move(bench, at(bench, 0.4));
    expect(bench, AXIS_ARRIVED);
    expect_silence(bench, 0.3);
}

static void limits(struct bench *bench) {
    home(bench);
    assert_refused(bench, NAN, DEVICE_ERROR_RANGE);
    assert_refused(bench, INFINITY, DEVICE_ERROR_RANGE);
    assert_refused(bench, -INFINITY, DEVICE_ERROR_RANGE);
    if (!bench->axis->motion.wraps) {
        assert_refused(bench, bench->axis->motion.max_deg + 0.001, DEVICE_ERROR_RANGE);
        assert_refused(bench, bench->axis->motion.min_deg - 0.001, DEVICE_ERROR_RANGE);
    }
    g_assert_false(axis_is_moving(bench->axis));
    expect_silence(bench, 0.3);
}

static void busy(struct bench *bench) {
    GError *error = NULL;
    home(bench);
    start_move(bench, at(bench, 0.4));
    assert_refused(bench, at(bench, 0.6), DEVICE_ERROR_BUSY);
    g_assert_false(axis_home(bench->axis, &error));
    g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_BUSY);
    g_clear_error(&error);
    expect(bench, AXIS_ARRIVED);
    assert_at(bench, at(bench, 0.4));
}

/* Begins a move, and lets 0.3 of its predicted time pass. An axis that brakes from then on stands
 * still before the target. Returns the time at which the move began. */
static gint64 start_some(struct bench *bench, double from_deg, double to_deg) {
    const double predicted = axis_move_time_s(&bench->axis->motion, from_deg, to_deg);
    gint64 start_us = 0;
    UNTIL (start_us != 0 && axis_is_moving(bench->axis)) {
        if (start_us != 0) {
            assert_held_up(bench, start_us, predicted);
            expect(bench, AXIS_ARRIVED);
        }
        start_move(bench, from_deg);
        expect(bench, AXIS_ARRIVED);
        start_us = clock_now_us(bench->clock);
        start_move(bench, to_deg);
        conformance_pass(bench->clock, predicted * 0.3);
    }
    return start_us;
}

/* Returns FALSE if the axis had arrived before this program could stop it. */
static gboolean stops_on_the_way(struct bench *bench, double from, double to) {
    const gint64 start_us = start_some(bench, from, to);
    g_assert_true(axis_stop(bench->axis, NULL));
    expect(bench, AXIS_STOPPED);
    const double stopped = axis_position_deg(bench->axis);
    if (fabs(stopped - to) <= tolerance(bench)) {
        assert_held_up(bench, start_us, axis_move_time_s(&bench->axis->motion, from, to));
        return FALSE;
    }
    g_assert_cmpfloat(stopped, >, from);
    g_assert_cmpfloat(stopped, <, to);
    expect_silence(bench, 0.5);
    g_assert_cmpfloat(fabs(axis_position_deg(bench->axis) - stopped), <=, tolerance(bench));
    g_assert_true(axis_is_homed(bench->axis));
    return TRUE;
}

static void stops(struct bench *bench) {
    const double from = at(bench, 0.3);
    home(bench);
    UNTIL (stops_on_the_way(bench, from, at(bench, 0.7)))
        ;
    start_move(bench, from);
    expect(bench, AXIS_ARRIVED);
    assert_at(bench, from);
}

static void stops_homing(struct bench *bench) {
    g_assert_true(axis_home(bench->axis, NULL));
    g_assert_true(axis_stop(bench->axis, NULL));
    expect(bench, AXIS_STOPPED);
    home(bench);
}

static void stop_standing(struct bench *bench) {
    g_assert_true(axis_stop(bench->axis, NULL));
    expect_silence(bench, 0.3);
    home(bench);
    g_assert_true(axis_stop(bench->axis, NULL));
    expect_silence(bench, 0.3);
}

/* Checks that the axis answers axis_halt() with AXIS_STOPPED, also if no command was given before.
 */
static void halt_standing(struct bench *bench) {
    g_assert_true(axis_halt(bench->axis, NULL));
    expect(bench, AXIS_STOPPED);
    home(bench);
    double before = axis_position_deg(bench->axis);
    g_assert_true(axis_halt(bench->axis, NULL));
    expect(bench, AXIS_STOPPED);
    g_assert_true(axis_is_homed(bench->axis));
    g_assert_cmpfloat(fabs(axis_position_deg(bench->axis) - before), <=, tolerance(bench));
    start_move(bench, at(bench, 0.5));
    g_assert_true(axis_halt(bench->axis, NULL));
    expect(bench, AXIS_STOPPED);
    expect_silence(bench, 0.3);
}

/* Checks a command that is not answered: the axis is stopped until it confirms that it stands
 * still, and only the fault is reported. */
static void unanswered(struct bench *bench, gboolean stop) {
    g_autofree char *keys = conformance_fault_keys(bench->with, stop ? 3 : 2);
    g_clear_pointer(&bench->axis, axis_close);
    open_with(bench, keys);
    home(bench);
    if (!stop)
        conformance_fail(bench->with, CONFORMANCE_UNANSWERED);
    start_move(bench, at(bench, 0.6));
    if (stop) {
        conformance_fail(bench->with, CONFORMANCE_UNANSWERED);
        g_assert_true(axis_stop(bench->axis, NULL));
    }
    expect(bench, AXIS_FAULT);
    g_assert_cmpint(axis_safety(bench->axis), !=, DEVICE_SAFE);
    conformance_fail(bench->with, CONFORMANCE_CUT);
    conformance_wait(bench->clock, &bench->safety.n_unsafe, 1, 30);
    g_assert_cmpint(axis_safety(bench->axis), ==, DEVICE_UNSAFE);
    conformance_expect_unsafe(bench->with, &bench->axis->device, &bench->safety);
    conformance_expect_safe(bench->with, &bench->axis->device, &bench->safety);
    g_assert_cmpint(axis_safety(bench->axis), ==, DEVICE_SAFE);
    const double before = axis_position_deg(bench->axis);
    expect_silence(bench, 0.5);
    g_assert_cmpfloat(axis_position_deg(bench->axis), ==, before);
    home(bench);
    start_move(bench, at(bench, 0.4));
    expect(bench, AXIS_ARRIVED);
    g_assert_cmpint(bench->safety.n_unsafe, ==, 1);
}

static void move_unanswered(struct bench *bench) {
    unanswered(bench, FALSE);
}

static void stop_unanswered(struct bench *bench) {
    unanswered(bench, TRUE);
}

static void permit(struct bench *bench) {
    GError *error = NULL;
    device_set_permit(&bench->axis->device, conformance_refuse, NULL);
    g_assert_false(axis_home(bench->axis, &error));
    conformance_expect_error(&error, DEVICE_ERROR, DEVICE_ERROR_UNSUPPORTED, "not now");
    device_set_permit(&bench->axis->device, NULL, NULL);
    home(bench);
    device_set_permit(&bench->axis->device, conformance_refuse, NULL);
    assert_refused(bench, at(bench, 0.5), DEVICE_ERROR_UNSUPPORTED);
    if (axis_can_turn(bench->axis)) {
        g_assert_false(axis_turn(bench->axis, 1, bench->axis->motion.speed_deg_s / 2, &error));
        conformance_expect_error(&error, DEVICE_ERROR, DEVICE_ERROR_UNSUPPORTED, "not now");
    }
    expect_silence(bench, 0.3);
    device_set_permit(&bench->axis->device, NULL, NULL);
    start_move(bench, at(bench, 0.5));
    device_set_permit(&bench->axis->device, conformance_refuse, NULL);
    g_assert_true(axis_stop(bench->axis, NULL));
    expect(bench, AXIS_STOPPED);
    g_assert_cmpint(bench->safety.n_unsafe, ==, 0);
}

static void close_moving(struct bench *bench) {
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(bench->with, "", &section);
    home(bench);
    start_some(bench, at(bench, 0.3), at(bench, 0.7));
    g_clear_pointer(&bench->axis, axis_close);
    expect_silence(bench, 2);
    bench->axis = axis_open(bench->driver, section, NULL, bench->clock, NULL);
    g_assert_nonnull(bench->axis);
    double before = axis_position_deg(bench->axis);
    expect_silence(bench, 0.5);
    g_assert_cmpfloat(axis_position_deg(bench->axis), ==, before);
}

void conformance_axis(const struct axis_driver *driver, const struct conformance *with) {
    static const struct check checks[] = {
        {"wrong-option", wrong_option, .unopened = TRUE},
        {"opens-still", opens_still},
        {"not-homed", not_homed},
        {"homes", homes},
        {"moves", moves},
        {"turns", turns},
        {"stops-turning", stops_turning},
        {"same-place", same_place},
        {"limits", limits},
        {"busy", busy},
        {"stops", stops},
        {"stops-homing", stops_homing},
        {"stop-standing", stop_standing},
        {"halt-standing", halt_standing},
        {"close-moving", close_moving},
        {"permit", permit},
        {"move-unanswered", move_unanswered, FALSE, TRUE},
        {"stop-unanswered", stop_unanswered, FALSE, TRUE},
        {"open-close", NULL, TRUE},
        {NULL},
    };
    static const struct suite suite = {"axis", sizeof(struct bench), begin, end, checks};
    conformance_add(&suite, driver, with);
}
