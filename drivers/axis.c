#include "axis.h"

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

/* Below the resolution of any drive, above the rounding error of sums of angles. */
#define SAME_DEG 1e-9

enum activity { IDLE, HOMING, MOVING };

struct axis_state {
    AxisFunc func;
    gpointer data;
    enum activity activity;
    gboolean homed;
    gboolean doubt; /* it may still turn: it did not stop, or its last motion ended in a fault */
    gboolean driver_moves; /* the driver has not reported yet; FALSE while settling */
    gboolean stopping;
    gboolean
        slack_unknown; /* stopped on the way: the next move takes up backlash in either direction */
    gboolean another_leg;
    double target_deg; /* target of the present leg, in the angle that the driver counts */
    guint deadline, settle;
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

static double leg_time_s(const struct axis_motion *motion, double way_deg) {
    double d = fabs(way_deg), v = motion->speed_deg_s, a = motion->accel_deg_s2;
    return d >= v * v / a ? d / v + v / a : 2 * sqrt(d / a);
}

/* Distance below the target at which a move reverses, so that it arrives in the positive direction.
 */
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

static gint64 axis_to_us(double seconds) {
    return (gint64)MIN(ceil(seconds * 1e6), 1e15);
}

static void axis_free(Axis *axis) {
    device_clear(&axis->device);
    g_free(axis->state);
    g_free(axis);
}

Axis *axis_open(const struct axis_driver *driver, const struct config_section *section,
                const char *const *also, Clock *clock, GError **error) {
    Axis *axis = g_new0(Axis, 1);
    const struct axis_motion *m = &axis->motion;
    axis->driver = driver;
    axis->park_deg = NAN;
    axis->state = g_new0(struct axis_state, 1);
    if (!device_init(&axis->device, &driver->info, section, also, clock, error) ||
        !driver->open(axis, error)) {
        axis_free(axis);
        return NULL;
    }
    gboolean finite = isfinite(m->speed_deg_s) && isfinite(m->accel_deg_s2) &&
                      isfinite(m->backlash_deg) && isfinite(m->settle_ms) && isfinite(m->min_deg) &&
                      isfinite(m->max_deg);
    if (finite && m->speed_deg_s > 0 && m->accel_deg_s2 > 0 && m->backlash_deg >= 0 &&
        m->settle_ms >= 0 && (m->wraps || m->min_deg < m->max_deg))
        return axis;
    device_error_set(error, DEVICE_ERROR_RANGE, axis->device.who,
                     "a value is out of range: limits %g to %g°, speed %g°/s, acceleration %g°/s², "
                     "backlash %g°" ERROR_ADVICE "correct its section",
                     m->min_deg, m->max_deg, m->speed_deg_s, m->accel_deg_s2, m->backlash_deg);
    axis_close(axis);
    return NULL;
}

static void cancel_timers(Axis *axis) {
    clock_cancel(axis->device.clock, &axis->state->deadline);
    clock_cancel(axis->device.clock, &axis->state->settle);
}

void axis_close(Axis *axis) {
    if (!axis)
        return;
    axis->state->func = NULL;
    axis->state->activity = IDLE;
    cancel_timers(axis);
    axis->driver->close(axis);
    axis_free(axis);
}

void axis_listen(Axis *axis, AxisFunc func, gpointer data) {
    axis->state->func = func;
    axis->state->data = data;
}

/* Call it last: the listener may close the axis. */
static void axis_end(Axis *axis, enum axis_event event, const GError *error) {
    struct axis_state *state = axis->state;
    cancel_timers(axis);
    state->activity = IDLE;
    state->driver_moves = state->stopping = FALSE;
    state->doubt = event == AXIS_FAULT;
    if (state->func)
        state->func(axis, event, error, state->data);
}

static void axis_do_fault(Axis *axis, const GError *error) {
    axis->state->homed = FALSE;
    axis_end(axis, AXIS_FAULT, error);
}

static const char *activity_name(const Axis *axis) {
    return axis->state->stopping             ? "stopping"
           : axis->state->activity == HOMING ? "homing"
                                             : "moving";
}

static void axis_on_deadline(gpointer data) {
    Axis *axis = data;
    axis->state->deadline = 0;
    g_autoptr(GError) error = device_error_new(
        DEVICE_ERROR_TIMEOUT, axis->device.who,
        "still %s at its deadline, last seen at %.3f°" ERROR_ADVICE "check drive and cable",
        activity_name(axis), axis->driver->position(axis));
    /* The answer does not matter: the position is unknown in any case. */
    axis->state->driver_moves = FALSE;
    axis->driver->stop(axis, NULL);
    axis_do_fault(axis, error);
}

static void set_deadline(Axis *axis, double predicted_s) {
    struct axis_state *state = axis->state;
    clock_cancel(axis->device.clock, &state->deadline);
    state->deadline = clock_call_in(axis->device.clock,
                                    axis_to_us(predicted_s * DEADLINE_FACTOR + DEADLINE_EXTRA_S),
                                    axis_on_deadline, axis);
}

static gboolean axis_check_idle(const Axis *axis, GError **error) {
    if (axis->state->activity == IDLE)
        return TRUE;
    return device_error_set(error, DEVICE_ERROR_BUSY, axis->device.who,
                            "still %s" ERROR_ADVICE "wait or stop it first", activity_name(axis));
}

gboolean axis_home(Axis *axis, GError **error) {
    struct axis_state *state = axis->state;
    const struct axis_motion *motion = &axis->motion;
    if (!axis_check_idle(axis, error))
        return FALSE;
    state->homed = FALSE;
    state->activity = HOMING;
    state->driver_moves = TRUE;
    if (!axis->driver->home(axis, error)) {
        state->activity = IDLE;
        state->driver_moves = FALSE;
        return FALSE;
    }
    double way = motion->wraps ? 360 : motion->max_deg - motion->min_deg;
    set_deadline(axis, HOMING_FACTOR * leg_time_s(motion, way));
    return TRUE;
}

static void on_settled(gpointer data) {
    Axis *axis = data;
    axis->state->settle = 0;
    axis_end(axis, axis->state->stopping ? AXIS_STOPPED : AXIS_ARRIVED, NULL);
}

static void axis_settle(Axis *axis, double seconds) {
    axis->state->driver_moves = FALSE;
    clock_cancel(axis->device.clock, &axis->state->settle);
    axis->state->settle = clock_call_in(axis->device.clock, axis_to_us(seconds), on_settled, axis);
}

static gboolean start_leg(Axis *axis, double target_deg, GError **error) {
    axis->state->driver_moves = TRUE;
    if (axis->driver->move(axis, target_deg, error))
        return TRUE;
    axis->state->driver_moves = FALSE;
    return FALSE;
}

gboolean axis_move(Axis *axis, double target_deg, GError **error) {
    struct axis_state *state = axis->state;
    const struct axis_motion *motion = &axis->motion;
    if (!axis_check_idle(axis, error))
        return FALSE;
    if (!state->homed)
        return device_error_set(error, DEVICE_ERROR_RANGE, axis->device.who,
                                "its position is not known" ERROR_ADVICE "home it first");
    if (!isfinite(target_deg))
        return device_error_set(error, DEVICE_ERROR_RANGE, axis->device.who,
                                "a position of %g° is not a finite number", target_deg);
    if (!motion->wraps && (target_deg < motion->min_deg || target_deg > motion->max_deg))
        return device_error_set(error, DEVICE_ERROR_RANGE, axis->device.who,
                                "%g° is outside its limits, %g to %g°", target_deg, motion->min_deg,
                                motion->max_deg);
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

gboolean axis_stop(Axis *axis, GError **error) {
    struct axis_state *state = axis->state;
    if (state->activity == IDLE || state->stopping)
        return TRUE;
    state->stopping = TRUE;
    if (!state->driver_moves) { /* settling: the drive already stands */
        axis_settle(axis, 0);
        return TRUE;
    }
    if (!axis->driver->stop(axis, error)) {
        state->stopping = FALSE;
        state->doubt = TRUE;
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
    if (state->activity != IDLE)
        return state->doubt && !state->stopping ? DEVICE_UNSAFE : DEVICE_TOLD;
    return state->doubt ? DEVICE_UNSAFE : DEVICE_SAFE;
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
            owned = device_error_new(DEVICE_ERROR_PROTOCOL, axis->device.who, "a fault");
        axis_do_fault(axis, owned);
        return;
    }
    if (!state->driver_moves)
        return;
    if (event == AXIS_HOMED && state->activity == HOMING) {
        state->homed = TRUE;
        state->slack_unknown = FALSE;
        axis_end(axis, state->stopping ? AXIS_STOPPED : AXIS_HOMED, NULL);
    } else if (event == AXIS_STOPPED && state->stopping) {
        axis_end(axis, AXIS_STOPPED, NULL);
    } else if (event == AXIS_ARRIVED && state->activity == MOVING) {
        if (state->stopping) {
            axis_end(axis, AXIS_STOPPED, NULL);
        } else if (!state->another_leg) {
            axis_settle(axis, axis->motion.settle_ms / 1000);
        } else {
            state->another_leg = FALSE;
            if (!start_leg(axis, state->target_deg, &owned))
                axis_do_fault(axis, owned);
        }
    }
}
