/*
 * An axis: turntable, light arc, laser sweep. Positions are degrees; a linear stage says in its
 * options how many millimetres a degree stands for.
 *
 * An axis that should stand is stopped until the device has reported that it stands: after a stop
 * that failed or was not answered in time, and after a motion that ended in a fault, in which the
 * device may still turn. These repetitions are not reported to the listener.
 */
#pragma once

#include "device.h"

typedef struct Axis Axis;

enum axis_event {
    AXIS_ARRIVED, /* at the target, and still */
    AXIS_HOMED,   /* at its reference; position is known from now on */
    AXIS_STOPPED, /* by axis_stop(); position is still known */
    AXIS_PASSING, /* during axis_turn(): where it was, and when, has been reported */
    AXIS_FAULT,   /* error says why; position is unknown until the next homing */
};

/* error is set with AXIS_FAULT only, and valid during the call. */
typedef void (*AxisFunc)(Axis *axis, enum axis_event event, const GError *error, gpointer data);

/* How an axis moves; a plan predicts its times from this. The driver's open() fills it, most simply
 * with a copy of the one in its private struct that AXIS_MOTION_OPTIONS has filled. */
struct axis_motion {
    double min_deg, max_deg; /* limits, inclusive */
    gboolean wraps;      /* turns without end: targets are taken modulo 360, by the shorter way */
    double speed_deg_s;  /* > 0 */
    double accel_deg_s2; /* > 0, also to stop */
    double backlash_deg; /* >= 0: taken up by always arriving in the positive direction */
    double settle_ms;    /* from arrival until the load is still; the class waits for it */
    double homing_s;     /* duration of homing, for predictions; 0: not known */
    double report_ms;    /* axis_turn(): the driver tells at least so often where the axis was, and
                            when; 0: it cannot */
    double stamp_ms;     /* by which these times are off, at most */
};

/* The options of a motion, for a driver's table; the driver adds its own row for homing_s. at:
 * offset of the struct axis_motion that they fill; speed, accel: defaults of speed_deg_s and
 * accel_deg_s2, NULL where they must be given. */
/* clang-format off */
#define AXIS_MOTION_OPTIONS(at, speed, accel)                                                      \
    {"wraps", OPTION_BOOL, NULL, 0, 0, "no", NULL, AXIS_MOTION(at, wraps),                         \
     "Turns without end, so that it has no limits and takes the shorter way"},                     \
    {"min_deg", OPTION_DOUBLE, "deg", -36000, 36000, "-360", NULL, AXIS_MOTION(at, min_deg),       \
     "Lower limit"},                                                                               \
    {"max_deg", OPTION_DOUBLE, "deg", -36000, 36000, "360", NULL, AXIS_MOTION(at, max_deg),        \
     "Upper limit"},                                                                               \
    {"speed_deg_s", OPTION_DOUBLE, "deg/s", 0.001, 100000, speed, NULL,                            \
     AXIS_MOTION(at, speed_deg_s), "Top speed"},                                                   \
    {"accel_deg_s2", OPTION_DOUBLE, "deg/s²", 0.001, 1000000, accel, NULL,                         \
     AXIS_MOTION(at, accel_deg_s2), "Acceleration, also to stop"},                                 \
    {"backlash_deg", OPTION_DOUBLE, "deg", 0, 10, "0", NULL, AXIS_MOTION(at, backlash_deg),        \
     "Lost motion, taken up by always arriving in the positive direction"},                        \
    {"settle_ms", OPTION_DOUBLE, "ms", 0, 60000, "0", NULL, AXIS_MOTION(at, settle_ms),            \
     "From arrival until the load is still"}
#define AXIS_MOTION(at, field) ((at) + G_STRUCT_OFFSET(struct axis_motion, field))
/* clang-format on */

struct axis_driver {
    struct driver_info info;
    /* Connects and fills axis->motion; moves nothing. */
    gboolean (*open)(Axis *axis, GError **error);
    /* Stops the axis if it moves, trying once, and releases the device. Called once for every
     * open() that succeeded. */
    void (*close)(Axis *axis);
    /* Starts; the driver ends it by axis_report() once, having arrived in the positive direction.
     */
    gboolean (*home)(Axis *axis, GError **error);
    /* Goes straight to the target, within limits already checked. Ends like home(). Where the axis
     * wraps, the target counts on from position() and may be below 0 or above 360. Called also from
     * within axis_report(): the second leg of a move that takes up backlash. */
    gboolean (*move)(Axis *axis, double target_deg, GError **error);
    /* NULL: it cannot. Goes to a target as move() does, but at a speed of its own, up to
     * motion.speed_deg_s, and calls axis_report_position() from then on, with the angles that
     * position() counts. motion.report_ms and stamp_ms are set by open(). */
    gboolean (*turn)(Axis *axis, double target_deg, double speed_deg_s, GError **error);
    /* Stops now. The driver ends the move or homing under way by axis_report(AXIS_STOPPED). It does
     * the same for an axis that already stands, or that another program has set off, once it sees
     * that the axis stands, and AXIS_FAULT if it could not be stopped. "Stop" must not wait for a
     * motion that has not been sent. A driver does not repeat a stop that failed; the class does.
     */
    gboolean (*stop)(Axis *axis, GError **error);
    /* The position that the device last reported. Never blocks. */
    double (*position)(Axis *axis);
};

struct Axis {
    struct device device;
    const struct axis_driver *driver;
    struct axis_motion motion;
    double park_deg;          /* where the axis is parked when there is nothing to capture; NAN: at
                                 its reference. The rig sets it, not the driver */
    struct axis_state *state; /* the class's own */
};

/* Opens the device a section describes; not homed. also: see device_init(). */
Axis *axis_open(const struct axis_driver *driver, const struct config_section *section,
                const char *const *also, Clock *clock, GError **error);

/* Stops the axis and closes its device. NULL is ignored. No event comes afterwards. */
void axis_close(Axis *axis);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Axis, axis_close)

/* Sets the one listener that receives the events. */
void axis_listen(Axis *axis, AxisFunc func, gpointer data);

/* Homing, moves and turns need a permit (device_set_permit()). */
gboolean axis_home(Axis *axis, GError **error);

/* Takes up backlash. Refuses, before anything moves: an axis that is not homed or busy, a target
 * that is NaN or outside the limits. */
gboolean axis_move(Axis *axis, double target_deg, GError **error);

/*
 * Pictures are taken while an axis turns by: a driver that can tell where its axis was at a time
 * makes that possible. axis_turn() accelerates, goes on at one speed, and brakes, in the positive
 * direction alone, so that backlash stays taken up. Each report is an AXIS_PASSING; the turn ends
 * like a move. Angles are those that position() counts, from axis_turned_from_deg() on, without a
 * step at 360.
 */

/* Whether its driver can do that. */
gboolean axis_can_turn(const Axis *axis);

/* Turns by an angle above 0. Refuses as axis_move() does, and axes that cannot turn, and speeds
 * that are not above 0 or above motion.speed_deg_s. */
gboolean axis_turn(Axis *axis, double by_deg, double speed_deg_s, GError **error);
double axis_turned_from_deg(const Axis *axis);

/* When the turn under way passes an angle, by the last report and the speed. FALSE: it has not
 * reported yet since it turns at that speed. */
gboolean axis_passes_at(const Axis *axis, double deg, gint64 *ret_us);

/* Where it was in the last turn, which may have ended: linear between the reports before and after
 * that time. FALSE: there is none after it yet, or none before it. */
gboolean axis_was_at(const Axis *axis, gint64 at_us, double *ret_deg);

/* On an axis that stands, does nothing and succeeds. */
gboolean axis_stop(Axis *axis, GError **error);

/* Stops any motion, also one that another program has started, of which axis_stop() does not know.
 * Ends in AXIS_STOPPED when the device reports that it stands, or in AXIS_FAULT. */
gboolean axis_halt(Axis *axis, GError **error);

gboolean axis_is_homed(const Axis *axis);
/* Whether it stands. DEVICE_TOLD: it moves, or an answer to "stop" is due; DEVICE_UNSAFE: "stop"
 * has failed. */
enum device_safety axis_safety(const Axis *axis);
/* TRUE until the event of the motion was delivered, settling included. */
gboolean axis_is_moving(const Axis *axis);
double axis_position_deg(Axis *axis);

/* For drivers: reports how a homing, move or stop has ended. Call it from the main loop's thread,
 * not from within home() or move(). Takes ownership of error (NULL except for AXIS_FAULT). A report
 * that nobody waits for is ignored, except AXIS_FAULT of an axis that stood. The listener may close
 * the axis: do not touch it afterwards. */
void axis_report(Axis *axis, enum axis_event event, GError *error);

/* For drivers, in a turn: where the axis was, at a time on the Clock's scale. Reports out of order
 * are ignored. The listener may stop the axis meanwhile, but does not close it. */
void axis_report_position(Axis *axis, double deg, gint64 at_us);

/* The same for a driver that asks its device, which looks between request and answer: in the middle
 * of these, within half of the time between them. If that is more than motion.stamp_ms, nothing is
 * reported. */
void axis_report_answer(Axis *axis, double deg, gint64 asked_us, gint64 answered_us);

/* Seconds a move takes, backlash and settling included; 0 if from and to are the same. Pure.
 * Trapezoidal speed: t = d/v + v/a, or 2 sqrt(d/a) where the top speed is not reached. */
double axis_move_time_s(const struct axis_motion *motion, double from_deg, double to_deg);

/* The angle that an axis needs to accelerate from 0 to a speed, or to brake: v²/2a. Pure. */
double axis_ramp_deg(const struct axis_motion *motion, double speed_deg_s);

/* Signed distance from one position to another: the shorter way round if the axis wraps. Pure. */
double axis_way_deg(const struct axis_motion *motion, double from_deg, double to_deg);
