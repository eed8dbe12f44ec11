#include "axis.h"

#include "recording.h"

#include <math.h>

/*
 * The deadline of a movement is 1.5 times its predicted time plus 4 s. The 4 s let a driver recover
 * a device that did not answer for a while. Homing is slow: it is predicted as ten times a move
 * over the whole range (between the limits, or a full turn). A stop is predicted as v/a, with top
 * speed v and acceleration a.
 */
#define DEADLINE_FACTOR  1.5
#define DEADLINE_EXTRA_S 4.0
#define HOMING_FACTOR    10.0

/* Angles that differ by less than this are the same. It is less than the resolution of any
 * drive, and more than the rounding error of sums of angles. */
#define SAME_DEG 1e-9

/* Pauses between two attempts to stop an axis that has not confirmed that it stands. */
#define FIRST_PAUSE_US 100000
#define MAX_PAUSE_US   300000

enum activity { IDLE, HOMING, MOVING };

/* Number of reports of a turn that are kept. A frame may arrive seconds after its exposure, and
 * axis_was_at() then needs the reports around the exposure. */
#define N_PASSED 256

struct passed { /* position at a time */
    gint64 at_us;
    double deg;
};

struct axis_state {
    AxisFunc func;
    gpointer data;
    enum activity activity;
    gboolean homed;
    /* The axis should stand, but the device has not confirmed it, because the last motion ended in
     * a fault or a "stop" has failed. The class repeats "stop" until the device confirms it. */
    gboolean doubt;
    gboolean unsafe; /* a stop has failed; implies doubt */
    /* TRUE until the driver has reported the end of the motion, so FALSE while the axis settles */
    gboolean driver_moves;
    gboolean stopping;
    /* The axis was stopped on the way, so the next move takes up backlash in either direction. */
    gboolean slack_unknown;
    gboolean another_leg;
    double target_deg;  /* target of the whole move, as the driver counts angles */
    double predicted_s; /* duration that the deadline is made from */
    guint deadline, settle;
    guint retry;       /* timer of the pause before the next attempt to stop */
    gint64 pause_us;   /* length of that pause */
    gboolean retrying; /* activity is IDLE, and the class waits for the answer to its "stop" */
    /* Fields of axis_turn(). */
    gboolean turning;
    double turned_from_deg, turn_speed_deg_s;
    gint64 steady_us;               /* time from which the axis turns at constant speed */
    gint64 ramp_us;                 /* time from the start of the turn to steady_us */
    struct passed passed[N_PASSED]; /* ring buffer */
    guint n_passed;
};

double axis_way_deg(const struct axis_motion *motion, double from_deg, double to_deg) {
    double way = to_deg - from_deg;
    if (motion->wraps) {
        way = fmod(way, 360);
        if (way > 180)
            way -= 360;
        else if (way <= -180)
            way += 360;
    }
    return fabs(way) < SAME_DEG ? 0 : way;
}

double axis_ramp_deg(const struct axis_motion *motion, double speed_deg_s) {
    return speed_deg_s * speed_deg_s / (2 * motion->accel_deg_s2);
}

static double leg_time_s(const struct axis_motion *motion, double way_deg) {
    double d = fabs(way_deg), v = motion->speed_deg_s, a = motion->accel_deg_s2;
    return d >= v * v / a ? d / v + v / a : 2 * sqrt(d / a);
}

/* Returns the distance below the target at which a move reverses, so that it arrives in the
 * positive direction. */
static double overshoot_deg(const struct axis_motion *motion, double to_deg) {
    double room = motion->wraps ? motion->backlash_deg : MAX(0, to_deg - motion->min_deg);
    return MIN(motion->backlash_deg, room);
}

double axis_move_time_s(const struct axis_motion *motion, double from_deg, double to_deg) {
    double way = axis_way_deg(motion, from_deg, to_deg);
    if (way == 0)
        return 0;
    double over = way < 0 ? overshoot_deg(motion, to_deg) : 0;
    return leg_time_s(motion, way - over) + leg_time_s(motion, over) + motion->settle_ms / 1000;
}

static gint64 to_us(double seconds) {
    return (gint64)MIN(ceil(seconds * 1e6), 1e15);
}

static void axis_free(Axis *axis) {
    device_clear(&axis->device);
    g_free(axis->state);
    g_free(axis);
}

/* Checks what the driver's open() has written to axis->motion. */
static gboolean check_motion(const Axis *axis, GError **error) {
    const struct axis_motion *m = &axis->motion;
    const struct {
        const char *key;
        double value;
        gboolean above_0;
    } values[] = {{"speed_deg_s", m->speed_deg_s, TRUE},    {"accel_deg_s2", m->accel_deg_s2, TRUE},
                  {"backlash_deg", m->backlash_deg, FALSE}, {"settle_ms", m->settle_ms, FALSE},
                  {"report_ms", m->report_ms, FALSE},       {"stamp_ms", m->stamp_ms, FALSE}};
    for (gsize i = 0; i < G_N_ELEMENTS(values); i++)
        if (!isfinite(values[i].value) || values[i].value < 0 ||
            (values[i].above_0 && values[i].value == 0))
            return device_error_set(
                error, DEVICE_ERROR_RANGE, axis->device.who,
                "its driver gives %s = %g, which is not a finite number %s 0" ERROR_ADVICE
                "correct the section or the settings of the device",
                values[i].key, values[i].value, values[i].above_0 ? "above" : "of at least");
    if (m->report_ms > 0 && !axis->driver->turn)
        return device_error_set(
            error, DEVICE_ERROR_RANGE, axis->device.who,
            "its driver gives report_ms = %g, but cannot report positions during a "
            "motion" ERROR_ADVICE "set report_ms = 0",
            m->report_ms);
    if (isfinite(m->min_deg) && isfinite(m->max_deg) && (m->wraps || m->min_deg < m->max_deg))
        return TRUE;
    return device_error_set(error, DEVICE_ERROR_RANGE, axis->device.who,
                            "its limits are min_deg = %g and max_deg = %g" ERROR_ADVICE
                            "give finite limits, with min_deg less than max_deg",
                            m->min_deg, m->max_deg);
}

Axis *axis_open(const struct axis_driver *driver, const struct config_section *section,
                const char *const *also, Clock *clock, GError **error) {
    Axis *axis = g_new0(Axis, 1);
    axis->driver = driver;
    axis->park_deg = NAN;
    axis->state = g_new0(struct axis_state, 1);
    if (!device_init(&axis->device, &driver->info, section, also, clock, error) ||
        !device_record_opened(&axis->device, driver->open(axis, error), error)) {
        axis_free(axis);
        return NULL;
    }
    if (check_motion(axis, error))
        return axis;
    axis_close(axis);
    return NULL;
}

static void cancel_timers(Axis *axis) {
    clock_cancel(axis->device.clock, &axis->state->deadline);
    clock_cancel(axis->device.clock, &axis->state->settle);
    clock_cancel(axis->device.clock, &axis->state->retry);
}

void axis_close(Axis *axis) {
    if (!axis)
        return;
    axis->state->func = NULL;
    axis->state->activity = IDLE;
    cancel_timers(axis);
    recording_device(axis->device.who, "close");
    axis->driver->close(axis);
    axis_free(axis);
}

void axis_listen(Axis *axis, AxisFunc func, gpointer data) {
    axis->state->func = func;
    axis->state->data = data;
}

static void on_retry(gpointer data);

/* Notes that a stop has failed, reports it, and tries again after a pause. */
static void not_stopped(Axis *axis, const GError *error) {
    struct axis_state *state = axis->state;
    state->doubt = state->unsafe = TRUE;
    state->retrying = FALSE;
    cancel_timers(axis);
    state->pause_us = state->pause_us ? MIN(2 * state->pause_us, MAX_PAUSE_US) : FIRST_PAUSE_US;
    state->retry = clock_call_in(axis->device.clock, state->pause_us, on_retry, axis);
    device_report_safety(&axis->device, error);
}

static void stands(Axis *axis) {
    struct axis_state *state = axis->state;
    cancel_timers(axis);
    state->doubt = state->unsafe = state->retrying = FALSE;
    state->pause_us = 0;
    device_report_safety(&axis->device, NULL);
}

static void record(Axis *axis, enum axis_event event, const GError *error) {
    static const char *const results[] = {
        [AXIS_ARRIVED] = "arrived at", [AXIS_HOMED] = "homed at", [AXIS_STOPPED] = "stopped at"};
    if (!recording_is_on())
        return;
    if (event == AXIS_FAULT)
        recording_device(axis->device.who, "= fault: %s", error->message);
    else if (results[event])
        recording_device(axis->device.who, "= %s %.4f", results[event], axis_position_deg(axis));
}

/* Ends the activity and tells the listener so. Call it last, because the listener may close the
 * axis. */
static void end(Axis *axis, enum axis_event event, const GError *error) {
    struct axis_state *state = axis->state;
    const gboolean stop_failed = state->stopping || state->unsafe;
    cancel_timers(axis);
    state->activity = IDLE;
    state->driver_moves = state->stopping = state->turning = FALSE;
    if (event != AXIS_FAULT) {
        stands(axis);
    } else if (stop_failed) {
        not_stopped(axis, error);
    } else {
        state->doubt = TRUE;
        state->retry = clock_call_in(axis->device.clock, 0, on_retry, axis);
    }
    record(axis, event, error);
    if (state->func)
        state->func(axis, event, error, state->data);
}

static void do_fault(Axis *axis, const GError *error) {
    axis->state->homed = FALSE;
    end(axis, AXIS_FAULT, error);
}

static const char *activity_name(const Axis *axis) {
    return axis->state->stopping || axis->state->retrying ? "stopping"
           : axis->state->activity == HOMING              ? "homing"
                                                          : "moving";
}

static void on_deadline(gpointer data) {
    Axis *axis = data;
    axis->state->deadline = 0;
    g_autoptr(GError) error = device_error_new(
        DEVICE_ERROR_TIMEOUT, axis->device.who,
        "still %s at its deadline, %.1f s after the command; the last position that the drive "
        "has reported is %.3f°" ERROR_ADVICE "check drive and cable",
        activity_name(axis), axis->state->predicted_s * DEADLINE_FACTOR + DEADLINE_EXTRA_S,
        axis->driver->position(axis));
    if (axis->state->retrying)
        not_stopped(axis, error);
    else
        do_fault(axis, error);
}

static void set_deadline(Axis *axis, double predicted_s) {
    struct axis_state *state = axis->state;
    clock_cancel(axis->device.clock, &state->deadline);
    state->predicted_s = predicted_s;
    state->deadline =
        clock_call_in(axis->device.clock, to_us(predicted_s * DEADLINE_FACTOR + DEADLINE_EXTRA_S),
                      on_deadline, axis);
}

/* Makes an attempt of the class to stop the axis. */
static void on_retry(gpointer data) {
    Axis *axis = data;
    struct axis_state *state = axis->state;
    g_autoptr(GError) error = NULL;
    state->retry = 0;
    if (state->activity == IDLE)
        state->retrying = TRUE;
    else
        state->stopping = TRUE; /* the driver has refused to stop this motion */
    if (axis->driver->stop(axis, &error)) {
        set_deadline(axis, axis->motion.speed_deg_s / axis->motion.accel_deg_s2);
        return;
    }
    state->stopping = FALSE;
    not_stopped(axis, error);
}

/* Cancels the repetition of "stop", because another command follows. */
static void drop_retry(Axis *axis) {
    axis->state->retrying = FALSE;
    cancel_timers(axis);
}

static gboolean check_idle(const Axis *axis, GError **error) {
    if (axis->state->activity == IDLE)
        return TRUE;
    return device_error_set(error, DEVICE_ERROR_BUSY, axis->device.who,
                            "still %s" ERROR_ADVICE "wait, or stop the axis first",
                            activity_name(axis));
}

gboolean axis_home(Axis *axis, GError **error) {
    struct axis_state *state = axis->state;
    const struct axis_motion *motion = &axis->motion;
    if (!check_idle(axis, error) || !device_ask_permit(&axis->device, error))
        return FALSE;
    recording_device(axis->device.who, "home");
    state->homed = FALSE;
    state->activity = HOMING;
    state->driver_moves = TRUE;
    drop_retry(axis);
    if (!axis->driver->home(axis, error)) {
        state->activity = IDLE;
        state->driver_moves = FALSE;
        if (state->doubt)
            state->retry = clock_call_in(axis->device.clock, state->pause_us, on_retry, axis);
        return FALSE;
    }
    double way = motion->wraps ? 360 : motion->max_deg - motion->min_deg;
    set_deadline(axis, HOMING_FACTOR * leg_time_s(motion, way));
    return TRUE;
}

static void on_settled(gpointer data) {
    Axis *axis = data;
    axis->state->settle = 0;
    end(axis, axis->state->stopping ? AXIS_STOPPED : AXIS_ARRIVED, NULL);
}

static void axis_settle(Axis *axis, double seconds) {
    axis->state->driver_moves = FALSE;
    clock_cancel(axis->device.clock, &axis->state->settle);
    axis->state->settle = clock_call_in(axis->device.clock, to_us(seconds), on_settled, axis);
}

static gboolean start_leg(Axis *axis, double target_deg, GError **error) {
    axis->state->driver_moves = TRUE;
    if (axis->driver->move(axis, target_deg, error))
        return TRUE;
    axis->state->driver_moves = FALSE;
    return FALSE;
}

static gboolean check_move(const Axis *axis, double target_deg, GError **error) {
    const struct axis_motion *motion = &axis->motion;
    if (!check_idle(axis, error))
        return FALSE;
    if (!axis->state->homed)
        return device_error_set(error, DEVICE_ERROR_RANGE, axis->device.who,
                                "its position is not known" ERROR_ADVICE "home it first");
    if (!isfinite(target_deg))
        return device_error_set(error, DEVICE_ERROR_RANGE, axis->device.who,
                                "a position of %g° is not a finite number" ERROR_ADVICE
                                "give an angle in degrees",
                                target_deg);
    if (!motion->wraps && (target_deg < motion->min_deg || target_deg > motion->max_deg))
        return device_error_set(
            error, DEVICE_ERROR_RANGE, axis->device.who,
            "%g° is outside its limits, %g to %g°" ERROR_ADVICE
            "choose another position, or correct min_deg and max_deg in its section",
            target_deg, motion->min_deg, motion->max_deg);
    return device_ask_permit(&axis->device, error);
}

gboolean axis_move(Axis *axis, double target_deg, GError **error) {
    struct axis_state *state = axis->state;
    const struct axis_motion *motion = &axis->motion;
    if (!check_move(axis, target_deg, error))
        return FALSE;
    recording_device(axis->device.who, "move to %.4f", target_deg);
    double from = axis->driver->position(axis);
    double way = axis_way_deg(motion, from, target_deg);
    gboolean take_up = way < 0 || state->slack_unknown;
    double over = take_up ? overshoot_deg(motion, target_deg) : 0;
    double to = motion->wraps ? from + way : target_deg;

    state->activity = MOVING;
    state->target_deg = to;
    state->another_leg = over > 0;
    if (way == 0 && over == 0) {
        axis_settle(axis, 0);
        return TRUE;
    }
    if (!start_leg(axis, to - over, error)) {
        state->activity = IDLE;
        return FALSE;
    }
    state->slack_unknown = FALSE;
    set_deadline(axis, leg_time_s(motion, way - over) + leg_time_s(motion, over) +
                           motion->settle_ms / 1000);
    return TRUE;
}

gboolean axis_can_turn(const Axis *axis) {
    return axis->driver->turn && axis->motion.report_ms > 0;
}

gboolean axis_turn(Axis *axis, double by_deg, double speed_deg_s, GError **error) {
    struct axis_state *state = axis->state;
    const struct axis_motion *motion = &axis->motion;
    double from = axis->driver->position(axis);
    if (!axis_can_turn(axis))
        return device_error_set(error, DEVICE_ERROR_RANGE, axis->device.who,
                                "%s%s does not report positions during a motion" ERROR_ADVICE
                                "let the axis stand for pictures: [capture] motion = standing",
                                axis->driver->turn ? "with report_ms = 0, its driver "
                                                   : "its driver ",
                                axis->driver->info.name);
    if (!check_move(axis, from + by_deg, error))
        return FALSE;
    if (!(by_deg > 0) || !(speed_deg_s > 0) || speed_deg_s > motion->speed_deg_s)
        return device_error_set(
            error, DEVICE_ERROR_RANGE, axis->device.who,
            "it cannot turn by %g° at %g°/s: the angle and the speed must be above 0, "
            "and the speed at most speed_deg_s = %g",
            by_deg, speed_deg_s, motion->speed_deg_s);
    recording_device(axis->device.who, "turn by %.4f at %.4f", by_deg, speed_deg_s);
    state->activity = MOVING;
    state->turning = TRUE;
    state->another_leg = FALSE;
    state->target_deg = from + by_deg;
    state->turned_from_deg = from;
    state->turn_speed_deg_s = speed_deg_s;
    state->n_passed = 0;
    state->ramp_us = to_us(speed_deg_s / motion->accel_deg_s2 + 1e-3 * motion->report_ms);
    state->steady_us = clock_now_us(axis->device.clock) + state->ramp_us;
    state->driver_moves = TRUE;
    if (!axis->driver->turn(axis, state->target_deg, speed_deg_s, error)) {
        state->activity = IDLE;
        state->turning = state->driver_moves = FALSE;
        return FALSE;
    }
    state->slack_unknown = FALSE;
    set_deadline(axis, by_deg / speed_deg_s + speed_deg_s / motion->accel_deg_s2 +
                           motion->settle_ms / 1000);
    return TRUE;
}

double axis_turned_from_deg(const Axis *axis) {
    return axis->state->turned_from_deg;
}

/* Returns an earlier report of the turn, or NULL if it is not kept. back is 0 for the last
 * report. */
static const struct passed *axis_passed(const struct axis_state *state, guint back) {
    return back < MIN(state->n_passed, N_PASSED)
               ? &state->passed[(state->n_passed - 1 - back) % N_PASSED]
               : NULL;
}

/* The time is rounded to whole µs: up if its fraction is at least 0.27 µs, otherwise down. Angles
 * and speeds that are round numbers do not give fractions near 0.27 µs. Rounding errors of the
 * positions therefore do not change the result. */
gboolean axis_passes_at(const Axis *axis, double deg, gint64 *ret_us) {
    const struct axis_state *state = axis->state;
    const struct passed *last = axis_passed(state, 0);
    if (!state->turning || !last || last->at_us < state->steady_us)
        return FALSE;
    *ret_us = last->at_us + (gint64)floor((deg - last->deg) / state->turn_speed_deg_s * 1e6 + 0.73);
    return TRUE;
}

gboolean axis_was_at(const Axis *axis, gint64 at_us, double *ret_deg) {
    const struct axis_state *state = axis->state;
    const struct passed *after = axis_passed(state, 0), *before = NULL;
    if (!after || after->at_us < at_us)
        return FALSE;
    for (guint back = 1; (before = axis_passed(state, back)) && before->at_us > at_us; back++)
        after = before;
    if (!before)
        return FALSE;
    const double part = (double)(at_us - before->at_us) / (double)(after->at_us - before->at_us);
    *ret_deg = before->deg + part * (after->deg - before->deg);
    return TRUE;
}

void axis_report_position(Axis *axis, double deg, gint64 at_us) {
    struct axis_state *state = axis->state;
    const struct passed *last = axis_passed(state, 0);
    if (!state->turning || !state->driver_moves || (last && at_us <= last->at_us))
        return;
    state->passed[state->n_passed++ % N_PASSED] = (struct passed){at_us, deg};
    if (state->func)
        state->func(axis, AXIS_PASSING, NULL, state->data);
}

void axis_report_waiting(Axis *axis) {
    struct axis_state *state = axis->state;
    if (!state->driver_moves || state->stopping)
        return;
    set_deadline(axis, state->predicted_s);
    state->steady_us = clock_now_us(axis->device.clock) + state->ramp_us;
}

void axis_report_answer(Axis *axis, double deg, gint64 asked_us, gint64 answered_us) {
    const gint64 took_us = answered_us - asked_us;
    if ((double)took_us <= 2000 * axis->motion.stamp_ms)
        axis_report_position(axis, deg, asked_us + took_us / 2);
}

gboolean axis_stop(Axis *axis, GError **error) {
    struct axis_state *state = axis->state;
    if (state->activity == IDLE || state->stopping)
        return TRUE;
    recording_device(axis->device.who, "stop");
    state->stopping = TRUE;
    if (!state->driver_moves) { /* settling: the drive already stands still */
        axis_settle(axis, 0);
        return TRUE;
    }
    GError *failed = NULL;
    drop_retry(axis);
    if (!axis->driver->stop(axis, &failed)) {
        state->stopping = FALSE;
        not_stopped(axis, failed);
        g_propagate_error(error, failed);
        return FALSE;
    }
    state->slack_unknown = TRUE;
    set_deadline(axis, axis->motion.speed_deg_s / axis->motion.accel_deg_s2);
    return TRUE;
}

gboolean axis_halt(Axis *axis, GError **error) {
    struct axis_state *state = axis->state;
    gboolean idle = state->activity == IDLE;
    if (idle) {
        state->activity = MOVING;
        state->driver_moves = TRUE;
        state->another_leg = FALSE;
    }
    if (axis_stop(axis, error))
        return TRUE;
    if (idle) {
        state->activity = IDLE;
        state->driver_moves = FALSE;
    }
    return FALSE;
}

gboolean axis_is_homed(const Axis *axis) {
    return axis->state->homed;
}

enum device_safety axis_safety(const Axis *axis) {
    const struct axis_state *state = axis->state;
    return state->unsafe                             ? DEVICE_UNSAFE
           : state->doubt || state->activity != IDLE ? DEVICE_TOLD
                                                     : DEVICE_SAFE;
}

gboolean axis_is_moving(const Axis *axis) {
    return axis->state->activity != IDLE;
}

double axis_position_deg(Axis *axis) {
    double deg = axis->driver->position(axis);
    if (!axis->motion.wraps)
        return deg;
    deg = fmod(deg, 360);
    if (deg < 0)
        deg += 360;
    return 360 - deg < SAME_DEG ? 0 : deg;
}

void axis_report(Axis *axis, enum axis_event event, GError *error) {
    struct axis_state *state = axis->state;
    g_autoptr(GError) owned = error;
    if (event == AXIS_FAULT) {
        if (!owned)
            owned = device_error_new(DEVICE_ERROR_PROTOCOL, axis->device.who,
                                     "it has reported a fault without a reason" ERROR_ADVICE
                                     "check the device and its cable, then home it");
        if (state->retrying)
            not_stopped(axis, owned);
        /* in doubt, the fault was reported before */
        else if (state->activity != IDLE || !state->doubt)
            do_fault(axis, owned);
        return;
    }
    if (state->retrying)
        stands(axis);
    if (!state->driver_moves)
        return;
    if (event == AXIS_HOMED && state->activity == HOMING) {
        state->homed = TRUE;
        state->slack_unknown = FALSE;
        end(axis, state->stopping ? AXIS_STOPPED : AXIS_HOMED, NULL);
    } else if (event == AXIS_STOPPED && state->stopping) {
        end(axis, AXIS_STOPPED, NULL);
    } else if (event == AXIS_ARRIVED && state->activity == MOVING) {
        if (state->stopping || state->doubt) {
            end(axis, AXIS_STOPPED, NULL);
        } else if (!state->another_leg) {
            axis_settle(axis, axis->motion.settle_ms / 1000);
        } else {
            state->another_leg = FALSE;
            if (!start_leg(axis, state->target_deg, &owned))
                do_fault(axis, owned);
        }
    }
}
