/*
 * An axis: a turntable, a light arc or the sweep of a laser. Positions are in degrees. The options
 * of a linear stage say how many millimetres one degree stands for.
 *
 * The class makes sure that an axis stands when it should. It repeats "stop" until the device has
 * reported that the axis stands. It does so after a stop that failed or was not answered in time,
 * and after a motion that ended in a fault, because the device may still turn then. These
 * repetitions are not reported to the listener.
 */
#pragma once

#include "device.h"

typedef struct Axis Axis;

enum axis_event {
    AXIS_ARRIVED, /* the axis is at the target and stands still */
    AXIS_HOMED,   /* the axis is at its reference; its position is known from now on */
    AXIS_STOPPED, /* the axis was stopped; its position stays known unless a homing was stopped */
    AXIS_PASSING, /* during axis_turn(): the driver has reported a position and its time */
    AXIS_FAULT,   /* error says what failed; the position is unknown until the next homing */
};

/* error is set only with AXIS_FAULT. It is valid during the call. */
typedef void (*AxisFunc)(Axis *axis, enum axis_event event, const GError *error, gpointer data);

/* The motion of an axis. The plan predicts durations from it. The driver's open() fills it, usually
 * with a copy of the struct that AXIS_MOTION_OPTIONS has filled in the driver's private data. */
struct axis_motion {
    double min_deg, max_deg; /* limits of the position, inclusive */
    /* whether the axis turns without end; then it takes the shorter way to a target modulo 360 */
    gboolean wraps;
    double speed_deg_s;  /* top speed, above 0 */
    double accel_deg_s2; /* above 0; also the deceleration */
    /* Lost motion after a change of direction, at least 0. The class takes it up by always arriving
     * in the positive direction. */
    double backlash_deg;
    double settle_ms; /* time from arrival until the load is still; the class waits for it */
    double homing_s;  /* duration of homing, for predictions; 0 if it is not known */
    /* The longest time between two reports of the position during axis_turn(). It is 0 if the
     * driver cannot report positions. */
    double report_ms;
    double stamp_ms; /* largest error of the times in these reports */
};

/* The options of a motion, for a driver's table. homing_s has no row here: add AXIS_HOMING_OPTION
 * or a row of the driver. `at` is the offset of the struct axis_motion in the driver's private
 * data. `speed` and `accel` are the defaults of speed_deg_s and accel_deg_s2. If one of them is
 * NULL, the user must give this option. */
/* clang-format off */
#define AXIS_MOTION_OPTIONS(at, speed, accel)                                                      \
    {"wraps", OPTION_BOOL, NULL, 0, 0, "no", NULL, AXIS_MOTION(at, wraps),                         \
     "Turns without end: it has no limits, and takes the shorter way to a target"},                \
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
     "Time from arrival until the load is still"}
#define AXIS_HOMING_OPTION(at)                                                                     \
    {"homing_s", OPTION_DOUBLE, "s", 0, 3600, "0", NULL, AXIS_MOTION(at, homing_s),                \
     "Duration of homing, for predicted times; 0: homing is not included in them"}
#define AXIS_MOTION(at, field) ((at) + G_STRUCT_OFFSET(struct axis_motion, field))
/* clang-format on */

struct axis_driver {
    struct driver_info info;
    /* Connects and fills axis->motion. Must not move the axis. */
    gboolean (*open)(Axis *axis, GError **error);
    /* Stops the axis if it moves, with a single attempt, and releases the device. The class calls
     * close() once for every open() that succeeded. */
    void (*close)(Axis *axis);
    /* Starts the homing. The axis must arrive in the positive direction. The driver then calls
     * axis_report() once. */
    gboolean (*home)(Axis *axis, GError **error);
    /* Goes straight to the target. The class has checked the limits and takes up backlash. The
     * driver then calls axis_report() once, as after home(). For an axis that wraps, the target
     * continues the count of position(); it may be below 0 or above 360. The class may call move()
     * from within axis_report(), for the second part of a move that takes up backlash. */
    gboolean (*move)(Axis *axis, double target_deg, GError **error);
    /* Goes to a target as move() does, with the given speed of at most motion.speed_deg_s. During
     * the motion the driver calls axis_report_position() with angles as position() counts them.
     * open() must have set motion.report_ms and motion.stamp_ms. turn is NULL if the driver cannot
     * do this. */
    gboolean (*turn)(Axis *axis, double target_deg, double speed_deg_s, GError **error);
    /* Stops the axis now, including a motion that another program has started. The driver calls
     * axis_report(AXIS_STOPPED) when the device has reported that the axis stands, also if the axis
     * stood before. This ends a move or homing that is under way. The driver calls
     * axis_report(AXIS_FAULT) if the axis could not be stopped. "Stop" must not wait for a motion
     * that has not been sent yet. A driver does not repeat a stop that failed, because the class
     * does. */
    gboolean (*stop)(Axis *axis, GError **error);
    /* Returns the position in degrees that the device last reported. Never blocks. */
    double (*position)(Axis *axis);
};

struct Axis {
    struct device device;
    const struct axis_driver *driver;
    struct axis_motion motion;
    /* The position at which the axis is parked when there is nothing to capture. NAN means its
     * reference. The rig sets it, not the driver. */
    double park_deg;
    struct axis_state *state; /* private to the class */
};

/* Opens the device that a section describes. The axis is not homed. `also` is as in
 * device_init(). */
Axis *axis_open(const struct axis_driver *driver, const struct config_section *section,
                const char *const *also, Clock *clock, GError **error);

/* Stops the axis and closes its device. NULL is ignored. No event comes afterwards. */
void axis_close(Axis *axis);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Axis, axis_close)

/* Sets the one listener that receives the events; func NULL removes it. */
void axis_listen(Axis *axis, AxisFunc func, gpointer data);

/* Starts homing. Fails if the axis is busy. Needs a permit (device_set_permit()). */
gboolean axis_home(Axis *axis, GError **error);

/* Moves to a target and takes up backlash. Fails, before anything moves, if the axis is busy or
 * not homed, or if the target is not finite or outside the limits. Needs a permit. */
gboolean axis_move(Axis *axis, double target_deg, GError **error);

/*
 * Turning while pictures are taken. This needs a driver that can tell the position of its axis at a
 * given time. axis_turn() accelerates, continues at a constant speed, and brakes. It turns only in
 * the positive direction, so that backlash stays taken up. Each report of the driver is an event
 * AXIS_PASSING. The turn ends like a move. Angles are counted as by position(): from
 * axis_turned_from_deg() on, without a step at 360.
 */

/* Returns whether the axis can turn while pictures are taken: its driver has turn(), and
 * motion.report_ms is above 0. */
gboolean axis_can_turn(const Axis *axis);

/* Turns by an angle above 0. Fails for the same reasons as axis_move(), and if the axis cannot
 * turn, or if the speed is not above 0 or exceeds motion.speed_deg_s. Needs a permit. */
gboolean axis_turn(Axis *axis, double by_deg, double speed_deg_s, GError **error);
double axis_turned_from_deg(const Axis *axis);

/* Predicts the time *ret_us of the Clock at which the turn under way passes an angle, from the last
 * report and the speed. Returns FALSE if no turn is under way, or if the axis has not reported
 * since it reached its constant speed. */
gboolean axis_passes_at(const Axis *axis, double deg, gint64 *ret_us);

/* Computes the position *ret_deg at a time during the last turn, which may have ended. The position
 * is interpolated linearly between the reports before and after that time. Returns FALSE if one of
 * these reports is missing. */
gboolean axis_was_at(const Axis *axis, gint64 at_us, double *ret_deg);

/* Stops the axis. Does nothing and succeeds if no motion is under way, or if the axis is already
 * being stopped. */
gboolean axis_stop(Axis *axis, GError **error);

/* Stops any motion, including one that another program has started and that axis_stop() does not
 * know of. Ends in AXIS_STOPPED when the device reports that the axis stands, or in AXIS_FAULT. */
gboolean axis_halt(Axis *axis, GError **error);

gboolean axis_is_homed(const Axis *axis);
/* Returns DEVICE_SAFE if the axis stands, DEVICE_TOLD if it moves or if an answer to "stop" is due,
 * and DEVICE_UNSAFE if the last "stop" has failed. */
enum device_safety axis_safety(const Axis *axis);
/* Returns TRUE from the start of a motion until its event. It is FALSE when the listener gets the
 * event. Settling is part of the motion. */
gboolean axis_is_moving(const Axis *axis);
double axis_position_deg(Axis *axis);

/* For drivers: reports the end of a homing, move or stop. Call it from the main loop's thread, but
 * not from within home() or move(). It takes ownership of error, which is NULL except for
 * AXIS_FAULT. A report that nobody waits for is ignored, except an AXIS_FAULT of an axis that
 * stood. The listener may close the axis, so a driver does not use the axis after this call. */
void axis_report(Axis *axis, enum axis_event event, GError *error);

/* For drivers whose controller moves one axis after another: says that the motion that was started
 * last has not begun yet. The deadline of that motion, and the ramp of a turn, count from the last
 * such report. */
void axis_report_waiting(Axis *axis);

/* For drivers, during a turn: reports the position of the axis at a time of the Clock. Reports out
 * of order are ignored. The listener may stop the axis during the call, but does not close it. */
void axis_report_position(Axis *axis, double deg, gint64 at_us);

/* The same as axis_report_position(), for a driver that asks its device. The device reads its
 * position at some time between the request and the answer. The position is reported for the middle
 * between these two times. The error of that time is at most half the time between request and
 * answer. If half that time is longer than motion.stamp_ms, nothing is reported. */
void axis_report_answer(Axis *axis, double deg, gint64 asked_us, gint64 answered_us);

/* Returns the duration of a move in seconds, including backlash and settling. Returns 0 if from_deg
 * and to_deg are the same. A way of d degrees with top speed v and acceleration a takes d/v + v/a
 * seconds, or 2 sqrt(d/a) seconds if the top speed is not reached. Pure function. */
double axis_move_time_s(const struct axis_motion *motion, double from_deg, double to_deg);

/* Returns the angle v²/2a of a ramp, in degrees. With the acceleration a, an axis needs this angle
 * to accelerate from 0 to the speed v, or to brake from v to 0. Pure function. */
double axis_ramp_deg(const struct axis_motion *motion, double speed_deg_s);

/* Returns the signed distance from one position to another, the shorter way round if the axis
 * wraps. Pure function. */
double axis_way_deg(const struct axis_motion *motion, double from_deg, double to_deg);
