#include "conformance_private.h"

#include <math.h>

struct bench {
    const struct axis_driver *driver;
    const struct conformance *with;
    Clock *clock;
    Axis *axis;
    gboolean in_call;
    int n_events;
    enum axis_event last;
};

static void on_event(Axis *axis, enum axis_event event, const GError *error, gpointer data) {
    struct bench *bench = data;
    g_assert_false(bench->in_call);
    g_assert_false(axis_is_moving(axis));
    g_assert_cmpint(event == AXIS_FAULT, ==, error != NULL);
    bench->n_events++;
    bench->last = event;
}

static void begin(struct bench *bench, gconstpointer driver, const struct conformance *with) {
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(with, "", &section);
    GError *error = NULL;
    *bench = (struct bench){driver, with, conformance_clock(with)};
    bench->axis = axis_open(driver, section, NULL, bench->clock, &error);
    g_assert_no_error(error);
    axis_listen(bench->axis, on_event, bench);
}

static void end(struct bench *bench) {
    axis_close(g_steal_pointer(&bench->axis));
    g_clear_pointer(&bench->clock, clock_unref);
}

/* A position at a fraction of the whole way. */
static double at(const struct bench *bench, double fraction) {
    const struct axis_motion *m = &bench->axis->motion;
    return m->wraps ? 360 * fraction : m->min_deg + fraction * (m->max_deg - m->min_deg);
}

static double tolerance(const struct bench *bench) {
    return bench->with->tolerance_deg > 0 ? bench->with->tolerance_deg : 0.01;
}

static void start_move(struct bench *bench, double to_deg) {
    GError *error = NULL;
    bench->in_call = TRUE;
    gboolean ok = axis_move(bench->axis, to_deg, &error);
    bench->in_call = FALSE;
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
    bench->in_call = TRUE;
    gboolean ok = axis_home(bench->axis, &error);
    bench->in_call = FALSE;
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

static void moves(struct bench *bench) {
    static const double fractions[] = {0.5, 0.75, 0.25, 0.26, 0.255};
    home(bench);
    for (gsize i = 0; i < G_N_ELEMENTS(fractions); i++) {
        double to = at(bench, fractions[i]);
        double predicted =
            axis_move_time_s(&bench->axis->motion, axis_position_deg(bench->axis), to);
        gint64 start = clock_now_us(bench->clock);
        start_move(bench, to);
        expect(bench, AXIS_ARRIVED);
        assert_at(bench, to);
        double took = (double)(clock_now_us(bench->clock) - start) / 1e6;
        g_assert_cmpfloat(took, <=, predicted * 1.5 + 2);
        expect_silence(bench, 0.3);
    }
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

/* A move, and a third of its time: braking from then on, it must stand before the target. */
static void start_some(struct bench *bench, double from_deg, double to_deg) {
    start_move(bench, from_deg);
    expect(bench, AXIS_ARRIVED);
    double predicted = axis_move_time_s(&bench->axis->motion, from_deg, to_deg);
    start_move(bench, to_deg);
    conformance_pass(bench->clock, predicted * 0.3);
    g_assert_true(axis_is_moving(bench->axis));
}

static void stops(struct bench *bench) {
    home(bench);
    double from = at(bench, 0.3), to = at(bench, 0.7);
    start_some(bench, from, to);
    bench->in_call = TRUE;
    g_assert_true(axis_stop(bench->axis, NULL));
    bench->in_call = FALSE;
    expect(bench, AXIS_STOPPED);
    double stopped = axis_position_deg(bench->axis);
    g_assert_cmpfloat(stopped, >, from);
    g_assert_cmpfloat(stopped, <, to);
    expect_silence(bench, 0.5);
    g_assert_cmpfloat(fabs(axis_position_deg(bench->axis) - stopped), <=, tolerance(bench));
    g_assert_true(axis_is_homed(bench->axis));
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

/* It says that it stands, also when nothing was asked of it before. */
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
        {"wrong-option", wrong_option},
        {"opens-still", opens_still},
        {"not-homed", not_homed},
        {"homes", homes},
        {"moves", moves},
        {"same-place", same_place},
        {"limits", limits},
        {"busy", busy},
        {"stops", stops},
        {"stops-homing", stops_homing},
        {"stop-standing", stop_standing},
        {"halt-standing", halt_standing},
        {"close-moving", close_moving},
        {"open-close", NULL, TRUE},
        {NULL},
    };
    static const struct suite suite = {"axis", sizeof(struct bench), begin, end, checks};
    conformance_add(&suite, driver, with);
}
