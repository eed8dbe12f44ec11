#include "tic.h"

#include "usb.h"

#include <math.h>

/*
 * Requests, variables and settings are those of Pololu's "Tic Stepper Motor Controller User's
 * Guide" (https://www.pololu.com/docs/0J71), sections 6 (settings), 7 (variables), 8 (commands), 11
 * (USB encoding). Speeds are in microsteps per 10 000 s, and accelerations in microsteps per 100
 * s².
 */
#define VENDOR    0x1ffb
#define TYPE_OUT  0x40
#define TYPE_IN   0xc0
#define CLASS_TIC 0xff

enum request {
    EXIT_SAFE_START = 0x83,
    ENERGIZE = 0x85,
    HALT_AND_HOLD = 0x89,
    CLEAR_DRIVER_ERROR = 0x8a,
    RESET_COMMAND_TIMEOUT = 0x8c,
    GO_HOME = 0x97,
    GET_VARIABLE = 0xa1,
    GET_SETTING = 0xa8,
    SET_TARGET_POSITION = 0xe0,
    SET_TARGET_VELOCITY = 0xe3,
    SET_MAX_SPEED = 0xe6,
    SET_MAX_DECEL = 0xe9,
    SET_MAX_ACCEL = 0xea,
    HALT_AND_SET_POSITION = 0xec,
};

enum variable {
    OPERATION_STATE = 0x00,
    MISC_FLAGS_1 = 0x01,
    ERROR_STATUS = 0x02,
    TARGET_POSITION = 0x0a,
    CURRENT_POSITION = 0x22,
    CURRENT_VELOCITY = 0x26,
    VARIABLES_SIZE = 0x2a, /* read in one request, so that all values belong to the same moment */
};

enum setting { CONTROL_MODE = 0x01, COMMAND_TIMEOUT = 0x09 };

enum flag {
    POSITION_UNCERTAIN = 1 << 1,
    FORWARD_LIMIT_ACTIVE = 1 << 2,
    REVERSE_LIMIT_ACTIVE = 1 << 3,
    HOMING_ACTIVE = 1 << 4,
};

#define STATE_NORMAL 10
#define SPEED_UNITS  10000.0
#define ACCEL_UNITS  100.0
#define MAX_SPEED    500000000.0
#define MIN_ACCEL    100.0
#define ANSWER_MS    600 /* USB 2.0, 9.2.6: a device may take 500 ms for its data */
#define STANDING_MS  100 /* time between polls of an axis that stands */
#define MAX_STEPS    2147483647.0

#define STAMP_MS 2 /* stamp_ms of the motion: an answer takes one to two milliseconds */

/* "Exit safe start" is valid for 200 ms. An earlier error may still be reported during that
 * time. */
#define GRACE_US 250000

enum phase { STANDING, HOMING, MOVING, STOPPING };
enum homing { HOMING_REVERSE, HOMING_FORWARD, HOMING_HERE };

struct tic {
    char *serial, *path;
    struct axis_motion motion;
    double steps_per_deg, home_deg;
    int homing, poll_ms;

    UsbDevice *usb;
    enum phase phase;
    gboolean watched; /* the axis is homed, and is polled even while it stands */
    /* The next stop is a halt, because the axis was homing or has broken down. */
    gboolean halts;
    gboolean asked;    /* a poll is under way */
    gboolean was_well; /* a poll without errors has followed the last start */
    /* n_started  number of starts
     * n_asked    value of n_started when the last poll was sent
     * If the two differ, the poll is older than the last start and proves nothing. */
    int n_started, n_asked;
    int n_commands; /* number of commands so far */
    GList *sent;    /* of struct sent: requests without an answer yet */
    gint64 start_us, asked_us;
    /* fed_us    time of the last reset of the command timeout
     * unfed_us  longest time without a reset since the last start */
    gint64 fed_us, unfed_us;
    int timeout_ms; /* command timeout of the Tic */
    guint timer;
    double target_deg;
    gint32 target_steps;
    double speed_deg_s; /* the speed that was set last */
    gboolean on_target; /* the axis stands at target_steps, which is target_deg rounded to steps */
    double position_deg;
};

struct sent {
    Axis *axis;
    int command; /* index of the command, counted by n_commands */
};

struct status {
    int state, flags, errors;
    gint32 target, position, velocity;
};

#define FIELD(name) G_STRUCT_OFFSET(struct tic, name)

static const char *const homings[] = {"reverse", "forward", "here", NULL};

static const struct option options[] = {
    {"serial", OPTION_STRING, NULL, 0, 0, "", NULL, FIELD(serial),
     "Serial number; may be left out if only one Tic is plugged in"},
    {"path", OPTION_STRING, NULL, 0, 0, "", NULL, FIELD(path),
     "USB path of the Tic: bus-port, and .port for each hub, as in 1-2.4"},
    {"steps_per_deg", OPTION_DOUBLE, NULL, 0.001, 1e6, NULL, NULL, FIELD(steps_per_deg),
     "Microsteps in a degree of the axis, its gear included"},
    AXIS_MOTION_OPTIONS(FIELD(motion), "20", "40"),
    AXIS_HOMING_OPTION(FIELD(motion)),
    {"homing", OPTION_CHOICE, NULL, 0, 0, "reverse", homings, FIELD(homing),
     "Limit switch towards which the axis homes; here: no switch, the present position is "
     "home_deg"},
    {"home_deg", OPTION_DOUBLE, "deg", -36000, 36000, "0", NULL, FIELD(home_deg),
     "Position at the end of homing"},
    {"poll_ms", OPTION_INT, "ms", 1, 250, "20", NULL, FIELD(poll_ms),
     "Time between two polls of a moving axis; a poll also resets the command timeout"},
    {NULL},
};

static const guint16 products[] = {0x00b3 /* T825 */, 0x00b5 /* T834 */, 0x00bd /* T500 */,
                                   0x00c9 /* T249 */, 0x00cb /* 36v4 */, 0};

/* Texts of the bits of the error status, from bit 0 on. */
static const char *const error_texts[] = {
    "it was de-energized" ERROR_ADVICE "check what de-energized it",
    "its motor driver reports an error" ERROR_ADVICE "check motor, wiring and temperature",
    "its motor supply is too low" ERROR_ADVICE "check the power supply",
    "its kill switch is active" ERROR_ADVICE "release the kill switch",
    "its required input is invalid" ERROR_ADVICE "check its control mode with ticgui",
    "it reports a serial error" ERROR_ADVICE "check what else is connected to it",
    "its command timeout stopped it, because no command came for too long" ERROR_ADVICE
    "check whether this computer is overloaded",
    "a safe start violation: something else halted it" ERROR_ADVICE "check what else controls it",
    "its ERR line is held high by another device" ERROR_ADVICE "check that device",
};

/* A command timeout sets both errors. The next reset of the timeout clears
 * COMMAND_TIMEOUT_ERROR, but SAFE_START_ERROR remains. */
enum { COMMAND_TIMEOUT_ERROR = 1 << 6, SAFE_START_ERROR = 1 << 7 };

static gint32 get_i32(const guint8 *data) {
    return (gint32)((guint32)data[0] | (guint32)data[1] << 8 | (guint32)data[2] << 16 |
                    (guint32)data[3] << 24);
}

static void tic_let_go(Axis *axis) {
    struct tic *tic = axis->device.priv;
    clock_cancel(axis->device.clock, &tic->timer);
    g_clear_pointer(&tic->usb, usb_close);
    tic->asked = FALSE;
    g_list_free_full(g_steal_pointer(&tic->sent), g_free);
}

/* Reports a fault. Call it last, because the listener may close the axis. Takes ownership of the
 * error. */
static void tic_fault(Axis *axis, GError *error) {
    struct tic *tic = axis->device.priv;
    tic->halts |= tic->phase == HOMING;
    tic->phase = STANDING;
    tic->watched = FALSE;
    clock_cancel(axis->device.clock, &tic->timer);
    if (g_error_matches(error, DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED))
        tic_let_go(axis);
    axis_report(axis, AXIS_FAULT, error);
}

static void tic_on_lost(UsbDevice *usb, gpointer data) {
    Axis *axis = data;
    tic_fault(axis,
              device_error_new(DEVICE_ERROR_DISCONNECTED, axis->device.who,
                               "it was unplugged" ERROR_ADVICE "plug it in again, then home it"));
}

static void on_sent(UsbDevice *usb, const guint8 *data, gsize n, const GError *error,
                    gpointer user) {
    const struct sent sent = *(struct sent *)user;
    Axis *axis = sent.axis;
    struct tic *tic = axis->device.priv;
    tic->sent = g_list_remove(tic->sent, user);
    g_free(user);
    if (sent.command != tic->n_commands)
        return; /* the result of an earlier command is no longer relevant */
    /* Report only the first of several failures with the same cause. */
    if (error && (tic->phase != STANDING || tic->watched))
        tic_fault(axis, g_error_copy(error));
}

/* Returns the time in which a request must be answered. It is longer while requests of an
 * earlier command have no answer, because a request waits for the earlier ones. */
static guint answer_ms(const struct tic *tic) {
    for (const GList *l = tic->sent; l; l = l->next)
        if (((const struct sent *)l->data)->command != tic->n_commands)
            return 2 * ANSWER_MS;
    return ANSWER_MS;
}

static gboolean send(Axis *axis, enum request request, gint32 value, GError **error) {
    struct tic *tic = axis->device.priv;
    struct usb_request out = {TYPE_OUT, (guint8)request, (guint16)((guint32)value & 0xffff),
                              (guint16)((guint32)value >> 16)};
    struct sent *sent = g_new0(struct sent, 1);
    *sent = (struct sent){axis, tic->n_commands};
    if (!usb_control(tic->usb, &out, answer_ms(tic), on_sent, sent, error)) {
        g_free(sent);
        return FALSE;
    }
    tic->sent = g_list_prepend(tic->sent, sent);
    return TRUE;
}

static void ended(Axis *axis, enum axis_event event) {
    struct tic *tic = axis->device.priv;
    tic->phase = STANDING;
    axis_report(axis, event, NULL);
}

static void broke_down(Axis *axis, const char *why) {
    struct tic *tic = axis->device.priv;
    tic->halts = TRUE;
    tic_fault(axis,
              device_error_new(DEVICE_ERROR_STALLED, axis->device.who,
                               "at %.3f°: %s" ERROR_ADVICE "then home it", tic->position_deg, why));
}

/* Returns whether this program was slower than the Tic's command timeout allows. */
static gboolean was_too_slow(const struct tic *tic) {
    return tic->unfed_us > tic->timeout_ms * (gint64)1000;
}

/* Returns whether the Tic has stopped by its command timeout because this program was too slow. The
 * Tic has then braked and still knows its position, so the move can continue. */
static gboolean stopped_by_timeout(const struct tic *tic, const struct status *status) {
    return tic->was_well && (status->errors & SAFE_START_ERROR) &&
           !(status->errors & ~(COMMAND_TIMEOUT_ERROR | SAFE_START_ERROR)) &&
           !(status->flags & POSITION_UNCERTAIN) && tic->phase != HOMING && was_too_slow(tic);
}

static void tic_resume(Axis *axis) {
    struct tic *tic = axis->device.priv;
    gboolean to_target = tic->phase == MOVING || tic->on_target;
    GError *error = NULL;
    g_message(
        "axis %s: no command for %.1f s, so its command timeout stopped it; the move continues",
        axis->device.name, (double)tic->unfed_us * 1e-6);
    if (!send(axis, EXIT_SAFE_START, 0, &error) ||
        !send(axis, to_target ? SET_TARGET_POSITION : SET_TARGET_VELOCITY,
              to_target ? tic->target_steps : 0, &error)) {
        tic_fault(axis, error);
        return;
    }
    tic->was_well = FALSE;
    tic->unfed_us = 0;
    tic->n_started++;
    tic->start_us = clock_now_us(axis->device.clock);
}

/* Returns whether the status ends the movement with a fault, and reports that fault. */
static gboolean is_broken(Axis *axis, const struct status *status) {
    struct tic *tic = axis->device.priv;
    gboolean late = clock_now_us(axis->device.clock) > tic->start_us + GRACE_US;
    gboolean up = tic->target_deg > tic->position_deg;
    g_autofree char *errors = g_strdup_printf("it reports the error status 0x%04x" ERROR_ADVICE
                                              "look it up in the manual of the Tic",
                                              status->errors);
    const char *why = NULL;
    if (!status->errors && status->state == STATE_NORMAL) {
        tic->was_well = TRUE;
        tic->unfed_us = 0;
    }
    if (tic->phase == MOVING &&
        status->flags & (up ? FORWARD_LIMIT_ACTIVE : REVERSE_LIMIT_ACTIVE)) {
        why = "ran into a limit switch" ERROR_ADVICE "check min_deg, max_deg and steps_per_deg";
    } else if (status->errors && (tic->was_well || late)) {
        const gboolean timeout = status->errors == SAFE_START_ERROR && was_too_slow(tic);
        int first = g_bit_nth_lsf(timeout ? COMMAND_TIMEOUT_ERROR : (gulong)status->errors, -1);
        why = first < (int)G_N_ELEMENTS(error_texts) ? error_texts[first] : errors;
    } else if (tic->phase != HOMING && status->flags & POSITION_UNCERTAIN) {
        why = "its position has become uncertain, because it was halted or reset" ERROR_ADVICE
              "check what caused that";
    }
    if (why)
        broke_down(axis, why);
    return why != NULL;
}

static void check_tic_homing(Axis *axis, const struct status *status) {
    struct tic *tic = axis->device.priv;
    gboolean late = clock_now_us(axis->device.clock) > tic->start_us + GRACE_US;
    if (status->flags & HOMING_ACTIVE)
        return;
    if (!(status->flags & POSITION_UNCERTAIN) && status->velocity == 0) {
        tic->watched = TRUE;
        tic->on_target = TRUE;
        tic->target_deg = tic->home_deg;
        tic->target_steps = status->position;
        ended(axis, AXIS_HOMED);
    } else if (late && status->flags & POSITION_UNCERTAIN) {
        broke_down(axis, "homing ended without its limit switch" ERROR_ADVICE
                         "check the switch and its settings");
    }
}

static void tic_evaluate(Axis *axis, const struct status *status) {
    struct tic *tic = axis->device.priv;
    tic->position_deg = tic->home_deg + status->position / tic->steps_per_deg;
    if (tic->phase == MOVING && tic->n_asked == tic->n_started)
        axis_report_answer(axis, tic->position_deg, tic->asked_us,
                           clock_now_us(axis->device.clock));
    if (tic->n_asked != tic->n_started)
        return;
    if (tic->phase == STOPPING && status->velocity == 0)
        ended(axis, AXIS_STOPPED);
    else if (tic->phase != STOPPING && stopped_by_timeout(tic, status))
        tic_resume(axis);
    else if (tic->phase == STOPPING || is_broken(axis, status))
        return;
    else if (tic->phase == HOMING)
        check_tic_homing(axis, status);
    else if (tic->phase == MOVING && status->target == tic->target_steps &&
             status->position == tic->target_steps && status->velocity == 0) {
        tic->on_target = TRUE;
        ended(axis, AXIS_ARRIVED);
    }
}

static gboolean read_status(const guint8 *data, gsize n, struct status *ret) {
    if (n != VARIABLES_SIZE)
        return FALSE;
    *ret = (struct status){
        .state = data[OPERATION_STATE],
        .flags = data[MISC_FLAGS_1],
        .errors = data[ERROR_STATUS] | data[ERROR_STATUS + 1] << 8,
        .target = get_i32(data + TARGET_POSITION),
        .position = get_i32(data + CURRENT_POSITION),
        .velocity = get_i32(data + CURRENT_VELOCITY),
    };
    return TRUE;
}

static void tic_wake(Axis *axis);

static void on_status(UsbDevice *usb, const guint8 *data, gsize n, const GError *error,
                      gpointer user) {
    Axis *axis = user;
    struct tic *tic = axis->device.priv;
    struct status status;
    tic->asked = FALSE;
    if (tic->phase == STANDING && !tic->watched)
        return;
    if (error && tic->n_asked != tic->n_started) {
        tic_wake(axis); /* the poll was sent before the last command */
    } else if (error) {
        tic_fault(axis, g_error_copy(error));
    } else if (!read_status(data, n, &status)) {
        tic_fault(axis, device_error_new(DEVICE_ERROR_PROTOCOL, axis->device.who,
                                         "it answered %d bytes of %d" ERROR_ADVICE
                                         "check its firmware, then home it",
                                         (int)n, VARIABLES_SIZE));
    } else {
        tic->unfed_us = MAX(tic->unfed_us, clock_now_us(axis->device.clock) - tic->fed_us);
        tic->fed_us = tic->asked_us;
        tic_wake(axis);
        tic_evaluate(axis, &status);
    }
}

static const struct usb_request get_status = {TYPE_IN,         GET_VARIABLE, 0,
                                              OPERATION_STATE, NULL,         VARIABLES_SIZE};

static void tic_on_timer(gpointer data) {
    Axis *axis = data;
    struct tic *tic = axis->device.priv;
    GError *error = NULL;
    tic->timer = 0;
    if (tic->asked)
        return;
    tic->asked = TRUE;
    tic->asked_us = clock_now_us(axis->device.clock);
    tic->n_asked = tic->n_started;
    if (!send(axis, RESET_COMMAND_TIMEOUT, 0, &error) ||
        !usb_control(tic->usb, &get_status, answer_ms(tic), on_status, axis, &error)) {
        tic->asked = FALSE;
        tic_fault(axis, error);
    }
}

static void tic_wake(Axis *axis) {
    struct tic *tic = axis->device.priv;
    gint64 period_ms = tic->phase == STANDING ? MAX(STANDING_MS, tic->poll_ms) : tic->poll_ms;
    clock_cancel(axis->device.clock, &tic->timer);
    tic->timer = clock_call_in(axis->device.clock, period_ms * 1000, tic_on_timer, axis);
}

static void started(Axis *axis, enum phase phase) {
    struct tic *tic = axis->device.priv;
    tic->phase = phase;
    tic->halts &= phase == STOPPING;
    tic->on_target = FALSE;
    tic->was_well = FALSE;
    tic->n_started++;
    tic->start_us = tic->fed_us = clock_now_us(axis->device.clock);
    tic->unfed_us = 0;
    tic_wake(axis);
}

static gboolean check_plugged(Axis *axis, GError **error) {
    struct tic *tic = axis->device.priv;
    return tic->usb ||
           device_error_set(error, DEVICE_ERROR_DISCONNECTED, axis->device.who,
                            "it is not plugged in" ERROR_ADVICE "plug it in, then home it");
}

static gboolean tic_set_speed(Axis *axis, double deg_s, GError **error) {
    struct tic *tic = axis->device.priv;
    const double speed = deg_s * tic->steps_per_deg * SPEED_UNITS;
    if (deg_s == tic->speed_deg_s)
        return TRUE;
    tic->speed_deg_s = deg_s;
    return send(axis, SET_MAX_SPEED, (gint32)MAX(1, llround(speed)), error);
}

static gboolean connect_usb(Axis *axis, GError **error);
/* Halts first, which makes the position uncertain. Homing is complete when the position is certain
 * again. */
static gboolean tic_home(Axis *axis, GError **error) {
    struct tic *tic = axis->device.priv;
    if (!tic->usb && !connect_usb(axis, error))
        return FALSE;
    tic->n_commands++;
    gint32 accel = (gint32)llround(tic->motion.accel_deg_s2 * tic->steps_per_deg * ACCEL_UNITS);
    tic->speed_deg_s = 0; /* the previous speed is unknown now */
    if (!send(axis, CLEAR_DRIVER_ERROR, 0, error) || !send(axis, ENERGIZE, 0, error) ||
        !tic_set_speed(axis, tic->motion.speed_deg_s, error) ||
        !send(axis, SET_MAX_ACCEL, accel, error) || !send(axis, SET_MAX_DECEL, accel, error) ||
        !send(axis, EXIT_SAFE_START, 0, error) || !send(axis, HALT_AND_HOLD, 0, error) ||
        !(tic->homing == HOMING_HERE ? send(axis, HALT_AND_SET_POSITION, 0, error)
                                     : send(axis, GO_HOME, tic->homing == HOMING_FORWARD, error)))
        return FALSE;
    started(axis, HOMING);
    return TRUE;
}

static gboolean tic_turn(Axis *axis, double target_deg, double speed_deg_s, GError **error) {
    struct tic *tic = axis->device.priv;
    double steps = round((target_deg - tic->home_deg) * tic->steps_per_deg);
    if (!check_plugged(axis, error))
        return FALSE;
    if (fabs(steps) > MAX_STEPS)
        return device_error_set(
            error, DEVICE_ERROR_RANGE, axis->device.who,
            "%g° is %.0f microsteps from home_deg, and the Tic counts to %.0f" ERROR_ADVICE
            "home the axis again",
            target_deg, steps, MAX_STEPS);
    tic->n_commands++;
    if (!send(axis, EXIT_SAFE_START, 0, error) || !tic_set_speed(axis, speed_deg_s, error) ||
        !send(axis, SET_TARGET_POSITION, (gint32)steps, error))
        return FALSE;
    tic->target_deg = target_deg;
    tic->target_steps = (gint32)steps;
    started(axis, MOVING);
    return TRUE;
}

static gboolean tic_move(Axis *axis, double target_deg, GError **error) {
    const struct tic *tic = axis->device.priv;
    return tic_turn(axis, target_deg, tic->motion.speed_deg_s, error);
}

/* A target velocity of 0 brakes with the set deceleration and keeps the position. A halt loses the
 * position. */
static gboolean tic_stop(Axis *axis, GError **error) {
    struct tic *tic = axis->device.priv;
    if (!tic->usb && !connect_usb(axis, error))
        return FALSE;
    gboolean halts = tic->halts || tic->phase == HOMING;
    tic->n_commands++;
    if (!send(axis, halts ? HALT_AND_HOLD : SET_TARGET_VELOCITY, 0, error))
        return FALSE;
    started(axis, STOPPING);
    return TRUE;
}

static double tic_position(Axis *axis) {
    const struct tic *tic = axis->device.priv;
    return tic->on_target ? tic->target_deg : tic->position_deg;
}

static gboolean tic_get_setting(Axis *axis, enum setting setting, guint16 length, guint8 *ret,
                                GError **error) {
    struct tic *tic = axis->device.priv;
    struct usb_request request = {TYPE_IN, GET_SETTING, 0, (guint16)setting, NULL, length};
    int n = usb_control_sync(tic->usb, &request, ret, error);
    return n == length ||
           (n >= 0 &&
            device_error_set(error, DEVICE_ERROR_PROTOCOL, axis->device.who,
                             "it answered %d bytes of %d" ERROR_ADVICE "check its firmware", n,
                             length));
}

/* Checks the control mode and the command timeout that are stored in the Tic. Only the user
 * changes these settings, with ticgui. */
static gboolean check_settings(Axis *axis, GError **error) {
    struct tic *tic = axis->device.priv;
    guint8 mode, timeout[2];
    if (!tic_get_setting(axis, CONTROL_MODE, 1, &mode, error) ||
        !tic_get_setting(axis, COMMAND_TIMEOUT, 2, timeout, error))
        return FALSE;
    int timeout_ms = tic->timeout_ms = timeout[0] | timeout[1] << 8;
    if (mode != 0)
        return device_error_set(
            error, DEVICE_ERROR_UNSUPPORTED, axis->device.who,
            "its control mode is %d" ERROR_ADVICE "set it to Serial/I2C/USB with ticgui", mode);
    int min_ms = 2 * MAX(STANDING_MS, tic->poll_ms);
    if (timeout_ms < min_ms)
        return device_error_set(
            error, DEVICE_ERROR_UNSUPPORTED, axis->device.who,
            "its command timeout is %d ms%s" ERROR_ADVICE "set it to %d ms or more with ticgui",
            timeout_ms,
            timeout_ms ? "" : " (off), so the motor would keep turning if this program died",
            min_ms);
    return TRUE;
}

static const struct usb_request brake = {TYPE_OUT, SET_TARGET_VELOCITY};

static gboolean read_position(Axis *axis, GError **error) {
    struct tic *tic = axis->device.priv;
    guint8 data[VARIABLES_SIZE];
    struct status status;
    int n = usb_control_sync(tic->usb, &get_status, data, error);
    if (n < 0)
        return FALSE;
    if (!read_status(data, (gsize)n, &status))
        return device_error_set(error, DEVICE_ERROR_PROTOCOL, axis->device.who,
                                "it answered %d bytes of %d" ERROR_ADVICE "check its firmware", n,
                                VARIABLES_SIZE);
    tic->position_deg = tic->home_deg + status.position / tic->steps_per_deg;
    /* A program that has died may have left the motor turning. Stop it. */
    return status.velocity == 0 || usb_control_sync(tic->usb, &brake, NULL, error) >= 0;
}

static gboolean connect_usb(Axis *axis, GError **error) {
    struct tic *tic = axis->device.priv;
    struct usb_match match = {.who = axis->device.who,
                              .vendor = VENDOR,
                              .products = products,
                              .interface_class = CLASS_TIC,
                              .serial = tic->serial,
                              .path = tic->path};
    tic->usb = usb_open(&match, tic_on_lost, axis, error);
    if (!tic->usb)
        return FALSE;
    device_set_identity(&axis->device, usb_product(tic->usb), usb_serial(tic->usb), tic->path);
    if (check_settings(axis, error) && read_position(axis, error))
        return TRUE;
    tic_let_go(axis);
    return FALSE;
}

static void tic_check(gconstpointer given, const struct config_section *section,
                      Mistakes *mistakes) {
    const struct tic *tic = given;
    const double speed = tic->motion.speed_deg_s * tic->steps_per_deg * SPEED_UNITS;
    const double accel = tic->motion.accel_deg_s2 * tic->steps_per_deg * ACCEL_UNITS;
    if (speed > MAX_SPEED)
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "speed_deg_s",
                       "%g microsteps/s are more than the maximum of a Tic, %g; change speed_deg_s "
                       "or steps_per_deg",
                       speed / SPEED_UNITS, MAX_SPEED / SPEED_UNITS);
    if (accel < MIN_ACCEL || accel > MAX_STEPS)
        config_mistake(
            mistakes, CONFIG_ERROR_VALUE, section, "accel_deg_s2",
            "%g microsteps/s² are outside of a Tic's range, %g to %g; change accel_deg_s2 "
            "or steps_per_deg",
            accel / ACCEL_UNITS, MIN_ACCEL / ACCEL_UNITS, MAX_STEPS / ACCEL_UNITS);
}

static void tic_needs(gconstpointer given, GPtrArray *to) {
    const struct tic *tic = given;
    g_ptr_array_add(to, usb_words("Tic", tic->serial, tic->path));
}

static gboolean tic_open_axis(Axis *axis, GError **error) {
    struct tic *tic = axis->device.priv;
    axis->motion = tic->motion;
    axis->motion.report_ms = tic->poll_ms + 2 * STAMP_MS;
    axis->motion.stamp_ms = STAMP_MS;
    return connect_usb(axis, error);
}

static void tic_close_axis(Axis *axis) {
    struct tic *tic = axis->device.priv;
    if (tic->usb && (tic->phase != STANDING || axis_safety(axis) != DEVICE_SAFE))
        usb_control_sync(tic->usb, &brake, NULL, NULL);
    tic_let_go(axis);
}

const struct axis_driver tic_axis_driver = {
    .info = {"axis", "tic-axis",
             "An axis turned by a stepper motor on a Pololu Tic (T825, T834, T500, T249, 36v4)",
             options, sizeof(struct tic), tic_check, tic_needs},
    .open = tic_open_axis,
    .close = tic_close_axis,
    .home = tic_home,
    .move = tic_move,
    .turn = tic_turn,
    .stop = tic_stop,
    .position = tic_position,
};
