#include "address.h"
#include "bus.h"
#include "devices.h"
#include "watchdog.h"

#include <math.h>
#include <string.h>

#define DEADLINE_MS 1500
/* Deadline of a command. A busy drive may answer late. The deadline is shorter than the 4 s that
 * the class adds to the predicted time of a movement. */
#define COMMAND_MS 3000
#define IDLE_MS    200 /* time between polls of a drive that stands */
/* A drive is lost only after this number of failed polls in a row, because this program itself
 * may have caused a single delay. */
#define MIN_UNHEARD 3
#define MAX_WRITES  6 /* largest number of writes in a list of the section */
#define MAX_WORDS   8 /* largest number of registers of one write */

enum phase { STANDING, MOVING, HOMING, STOPPING };
enum bits { BITS_16, BITS_32 };
enum order { HIGH_FIRST, LOW_FIRST };
enum kind { HOLDING, INPUT };

struct number { /* a number in one register, or in two consecutive ones */
    int address, bits;
};

struct modbus_axis {
    struct modbus_link link;
    struct axis_motion motion;
    double home_deg;
    double steps_per_deg, tolerance_deg, speed_scale, accel_scale;
    struct number target, position, speed, accel;
    int word_order, read_with, status_address;
    int moving_bit, homed_bit, fault_bit, limit_bit;
    gboolean verify;
    char **setup, **start, **home, **stop, **clear, **watchdog;
    struct modbus_watchdog own; /* the drive's own watchdog */
    double poll_ms, watchdog_ms, start_ms, stall_ms, lost_ms, stamp_ms;

    ModbusBus *bus;
    enum phase phase;
    guint timer;
    int n_commands;   /* commands without an answer yet */
    int last_command; /* tag of the last command */
    int n_unheard;    /* polls in a row that were not answered */
    gboolean polling, faulty;
    gboolean left_home; /* since homing began, the drive has moved or was without a reference */
    gboolean was_still; /* the drive stood in the last poll of a stop */
    gint64 target_steps, steps;
    double speed_deg_s; /* value of the drive's speed register */
    /* still_us is the time of the last command, or of the last poll that saw a motion if that was
     * later. progress_us is the time of the last command, or of the last change of position if that
     * was later. */
    gint64 still_us, progress_us;
    gint64 heard_us, fed_us; /* time of the last answer, and time of the last write of watchdog */
    gint64 polled_us;        /* time of the poll that is under way */
};

#define FIELD(name) G_STRUCT_OFFSET(struct modbus_axis, name)

static const char *const bits_choices[] = {"16", "32", NULL};
static const char *const order_choices[] = {"high-first", "low-first", NULL};
static const char *const kind_choices[] = {"holding", "input", NULL};

static const struct option options[] = {
    MODBUS_LINK_OPTIONS,
    AXIS_MOTION_OPTIONS(FIELD(motion), NULL, NULL),
    AXIS_HOMING_OPTION(FIELD(motion)),
    {"home_deg", OPTION_DOUBLE, "deg", -36000, 36000, "0", NULL, FIELD(home_deg),
     "Position of the axis when the drive counts 0, which is where homing ends"},
    {"steps_per_deg", OPTION_DOUBLE, NULL, -1e7, 1e7, NULL, NULL, FIELD(steps_per_deg),
     "The drive's steps per degree, gears included; negative: the drive counts in the opposite "
     "direction"},
    {"tolerance_deg", OPTION_DOUBLE, "deg", 0, 10, "0.01", NULL, FIELD(tolerance_deg),
     "Largest distance from the target at which the axis counts as arrived"},
    {"target_register", OPTION_INT, NULL, 0, 65535, NULL, NULL, FIELD(target.address),
     "Holding register of the absolute target, in steps"},
    {"target_bits", OPTION_CHOICE, NULL, 0, 0, "32", bits_choices, FIELD(target.bits),
     "Bits of the target, signed; 32 bits are two registers"},
    {"position_register", OPTION_INT, NULL, 0, 65535, NULL, NULL, FIELD(position.address),
     "Register of the position, in steps"},
    {"position_bits", OPTION_CHOICE, NULL, 0, 0, "32", bits_choices, FIELD(position.bits),
     "Bits of the position, signed"},
    {"word_order", OPTION_CHOICE, NULL, 0, 0, "high-first", order_choices, FIELD(word_order),
     "The half of a 32-bit value that has the lower address"},
    {"read_with", OPTION_CHOICE, NULL, 0, 0, "holding", kind_choices, FIELD(read_with),
     "Whether position and status are holding registers (function 3) or input registers (4)"},
    {"status_register", OPTION_INT, NULL, 0, 65535, NULL, NULL, FIELD(status_address),
     "Register with the status bits: moving_bit and the following keys"},
    {"moving_bit", OPTION_INT, NULL, 0, 15, NULL, NULL, FIELD(moving_bit),
     "Bit that is 1 while the axis moves"},
    {"homed_bit", OPTION_INT, NULL, -1, 15, "-1", NULL, FIELD(homed_bit),
     "Bit that is 1 once the axis was homed; −1: there is none"},
    {"fault_bit", OPTION_INT, NULL, -1, 15, "-1", NULL, FIELD(fault_bit),
     "Bit that is 1 while the drive has a fault; −1: there is none"},
    {"limit_bit", OPTION_INT, NULL, -1, 15, "-1", NULL, FIELD(limit_bit),
     "Bit that is 1 at a limit switch; −1: there is none"},
    {"verify", OPTION_BOOL, NULL, 0, 0, "yes", NULL, FIELD(verify),
     "Read target, speed and acceleration back after writing them"},
    {"speed_register", OPTION_INT, NULL, -1, 65535, "-1", NULL, FIELD(speed.address),
     "Holding register of the top speed, written when opened; −1: none, the drive is set to "
     "speed_deg_s"},
    {"speed_bits", OPTION_CHOICE, NULL, 0, 0, "16", bits_choices, FIELD(speed.bits),
     "Bits of the top speed's register"},
    {"speed_scale", OPTION_DOUBLE, NULL, 1e-6, 1e9, "1", NULL, FIELD(speed_scale),
     "Value of the top speed's register for 1 deg/s"},
    {"accel_register", OPTION_INT, NULL, -1, 65535, "-1", NULL, FIELD(accel.address),
     "Holding register of the acceleration, written when opened; −1: none, the drive is set to "
     "accel_deg_s2"},
    {"accel_bits", OPTION_CHOICE, NULL, 0, 0, "16", bits_choices, FIELD(accel.bits),
     "Bits of the acceleration's register"},
    {"accel_scale", OPTION_DOUBLE, NULL, 1e-6, 1e9, "1", NULL, FIELD(accel_scale),
     "Value of the acceleration's register for 1 deg/s²"},
    {"setup", OPTION_STRINGS, NULL, 0, 0, "", NULL, FIELD(setup),
     "Values written when the axis is opened: ADDRESS=VALUE, or ADDRESS=VALUE,VALUE for "
     "consecutive registers"},
    {"start", OPTION_STRINGS, NULL, 0, 0, NULL, NULL, FIELD(start),
     "Values written to start a move to the target, in the form of setup; they may be written "
     "twice"},
    {"home", OPTION_STRINGS, NULL, 0, 0, NULL, NULL, FIELD(home),
     "Values written to start homing, in the form of setup; if there is backlash, homing must end "
     "in the positive direction"},
    {"stop", OPTION_STRINGS, NULL, 0, 0, NULL, NULL, FIELD(stop),
     "Values written to stop, in the form of setup"},
    {"clear", OPTION_STRINGS, NULL, 0, 0, "", NULL, FIELD(clear),
     "Values written before homing to clear a fault, in the form of setup"},
    {"watchdog", OPTION_STRINGS, NULL, 0, 0, "", NULL, FIELD(watchdog),
     "Values written repeatedly to keep the drive's watchdog from stopping it, in the form of "
     "setup"},
    {"watchdog_ms", OPTION_DOUBLE, "ms", 10, 60000, "200", NULL, FIELD(watchdog_ms),
     "Time between two writes of watchdog"},
    MODBUS_WATCHDOG_OPTIONS(FIELD(own)),
    {"poll_ms", OPTION_DOUBLE, "ms", 1, 1000, "20", NULL, FIELD(poll_ms),
     "Time between two polls while the axis moves"},
    {"stamp_ms", OPTION_DOUBLE, "ms", 0.1, 1000, "10", NULL, FIELD(stamp_ms),
     "With motion = continuous: largest error of the time of a position. A poll that takes more "
     "than twice as long is ignored; the drive's own delay must also be below it"},
    {"start_ms", OPTION_DOUBLE, "ms", 1, 10000, "500", NULL, FIELD(start_ms),
     "How long the axis may stand still after a command, and pause while homing"},
    {"stall_ms", OPTION_DOUBLE, "ms", 10, 60000, "1000", NULL, FIELD(stall_ms),
     "How long the drive may report a motion while its position does not change"},
    {"lost_ms", OPTION_DOUBLE, "ms", 1, 60000, "3000", NULL, FIELD(lost_ms),
     "How long the axis may move without an answer to a poll before that is a fault"},
    {NULL},
};

static double to_deg(const struct modbus_axis *priv, gint64 steps) {
    return priv->home_deg + (double)steps / priv->steps_per_deg;
}

static gint64 axis_join(const struct modbus_axis *priv, const guint16 *words, int bits) {
    if (bits == BITS_16)
        return (gint16)words[0];
    guint16 high = words[priv->word_order == LOW_FIRST], low = words[priv->word_order != LOW_FIRST];
    return (gint32)((guint32)high << 16 | low);
}

static void add_number(const struct modbus_axis *priv, struct modbus_job *job,
                       const struct number *number, gint64 value) {
    gboolean wide = number->bits == BITS_32, swapped = !wide || priv->word_order == LOW_FIRST;
    guint16 low = (guint16)value, high = (guint16)(value >> 16);
    struct modbus_request *request =
        modbus_job_add(job, MODBUS_WRITE_HOLDING, number->address, wide ? 2 : 1);
    request->values[0] = swapped ? low : high;
    request->values[1] = swapped ? high : low;
    request->verify = priv->verify;
}

/* Parses a decimal number, or a hexadecimal number after 0x. Returns FALSE if the text is neither
 * or the number is too large. */
static gboolean axis_parse_word(const char *text, int min, int *ret) {
    gboolean hex = g_str_has_prefix(text, "0x");
    char *end = NULL;
    gint64 value = g_ascii_strtoll(text, &end, hex ? 16 : 10);
    *ret = (int)CLAMP(value, min, 65535);
    return *text && !g_ascii_isspace(*text) && !*end && value == *ret;
}

/* Parses ADDRESS=VALUE[,VALUE…]. Returns FALSE if the text has another form. */
static gboolean parse_write(const char *text, struct modbus_request *ret) {
    g_auto(GStrv) sides = g_strsplit(text, "=", 0);
    if (g_strv_length(sides) != 2 || !axis_parse_word(g_strstrip(sides[0]), 0, &ret->address))
        return FALSE;
    g_auto(GStrv) values = g_strsplit(sides[1], ",", 0);
    ret->n = (int)g_strv_length(values);
    if (ret->n < 1 || ret->n > MAX_WORDS)
        return FALSE;
    for (int i = 0; i < ret->n; i++) {
        int value;
        if (!axis_parse_word(g_strstrip(values[i]), -32768, &value))
            return FALSE;
        ret->values[i] = (guint16)value;
    }
    return ret->address + ret->n <= 65536;
}

static void check_writes(const struct config_section *section, const char *key, char *const *writes,
                         gboolean needed, Mistakes *mistakes) {
    struct modbus_request request;
    if (needed && !*writes)
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, key,
                       "must not be empty; write ADDRESS=VALUE");
    if (g_strv_length((char **)writes) > MAX_WRITES)
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, key,
                       "has %u writes, but at most %d are possible; write consecutive registers as "
                       "ADDRESS=VALUE,VALUE",
                       g_strv_length((char **)writes), MAX_WRITES);
    for (; *writes; writes++)
        if (!parse_write(*writes, &request))
            config_mistake(mistakes, CONFIG_ERROR_VALUE, section, key,
                           "\"%s\" is not ADDRESS=VALUE or ADDRESS=VALUE,VALUE (0 to 65535; at "
                           "most %d values)",
                           *writes, MAX_WORDS);
}

/* Adds the writes of the section, which was checked before the device was opened. */
static void add_writes(struct modbus_job *job, char *const *writes) {
    for (; *writes; writes++) {
        struct modbus_request parsed = {0};
        parse_write(*writes, &parsed);
        struct modbus_request *request =
            modbus_job_add(job, MODBUS_WRITE_HOLDING, parsed.address, parsed.n);
        memcpy(request->values, parsed.values, sizeof parsed.values);
    }
}

/* Adds the last two requests of a poll: status before position, so that the position is final if
 * the status says that the drive stands. */
static void add_poll(const struct modbus_axis *priv, struct modbus_job *job) {
    enum modbus_kind kind =
        priv->read_with == INPUT ? MODBUS_READ_INPUT_REGISTERS : MODBUS_READ_HOLDING;
    modbus_job_add(job, kind, priv->status_address, 1);
    modbus_job_add(job, kind, priv->position.address, priv->position.bits == BITS_32 ? 2 : 1);
}

static gboolean has_bit(const struct modbus_job *job, int bit) {
    return bit >= 0 && (job->requests[job->n - 2].values[0] >> bit & 1);
}

static void on_polled(const struct modbus_job *job, const GError *error, gpointer data);

static void poll_now(Axis *axis) {
    struct modbus_axis *priv = axis->device.priv;
    struct modbus_job job = {0};
    gint64 now = clock_now_us(axis->device.clock);
    if (priv->polling)
        return;
    clock_cancel(axis->device.clock, &priv->timer);
    priv->polling = TRUE;
    priv->polled_us = now;
    if (*priv->watchdog && now - priv->fed_us >= (gint64)(priv->watchdog_ms * 500)) {
        priv->fed_us = now;
        add_writes(&job, priv->watchdog);
    }
    add_poll(priv, &job);
    modbus_bus_start(priv->bus, &priv->link, &job, MODBUS_POLL, DEADLINE_MS, on_polled, axis);
}

static void axis_on_timer(gpointer data) {
    Axis *axis = data;
    ((struct modbus_axis *)axis->device.priv)->timer = 0;
    poll_now(axis);
}

static void poll_later(Axis *axis) {
    struct modbus_axis *priv = axis->device.priv;
    double ms = priv->phase == STANDING ? MAX(IDLE_MS, priv->poll_ms) : priv->poll_ms;
    if (*priv->watchdog)
        ms = MIN(ms, priv->watchdog_ms);
    if (priv->own.address >= 0)
        ms = MIN(ms, (double)modbus_watchdog_period_us(&priv->own) / 1000);
    clock_cancel(axis->device.clock, &priv->timer);
    priv->timer = clock_call_in(axis->device.clock, (gint64)(ms * 1000), axis_on_timer, axis);
}

static void on_commanded(const struct modbus_job *job, const GError *error, gpointer data);

static void axis_command(Axis *axis, enum phase phase, struct modbus_job *job) {
    struct modbus_axis *priv = axis->device.priv;
    priv->phase = phase;
    job->tag = priv->last_command = (priv->last_command + 1) & G_MAXINT;
    priv->n_commands++;
    priv->n_unheard = 0;
    priv->left_home = priv->was_still = FALSE;
    priv->still_us = priv->progress_us = priv->heard_us = clock_now_us(axis->device.clock);
    if (phase == STOPPING)
        modbus_bus_skip(priv->bus, axis, -1);
    modbus_bus_start(priv->bus, &priv->link, job,
                     phase == STOPPING ? MODBUS_URGENT : MODBUS_COMMAND,
                     phase == STOPPING ? DEADLINE_MS : COMMAND_MS, on_commanded, axis);
}

/* Reports a fault. The class then stops the drive, whatever the drive is doing. Call it last,
 * because the listener may close the axis. */
static void report_fault(Axis *axis, GError *error) {
    struct modbus_axis *priv = axis->device.priv;
    priv->phase = STANDING;
    error_details_add_subject(&error, axis->device.who);
    axis_report(axis, AXIS_FAULT, error);
}

static void on_commanded(const struct modbus_job *job, const GError *error, gpointer data) {
    Axis *axis = data;
    struct modbus_axis *priv = axis->device.priv;
    priv->n_commands--;
    if (job->skipped) /* skipped by a stop, which follows */
        return;
    priv->still_us = priv->progress_us = priv->heard_us = clock_now_us(axis->device.clock);
    if (priv->n_commands == 0)
        poll_now(axis);
    /* The failure of an earlier command is no longer relevant. */
    if (error && priv->phase != STANDING && job->tag == priv->last_command)
        report_fault(axis, g_error_copy(error));
}

static void axis_finish(Axis *axis, enum axis_event event) {
    struct modbus_axis *priv = axis->device.priv;
    priv->phase = STANDING;
    axis_report(axis, event, NULL);
}

static void stalled(Axis *axis, const char *format, ...) G_GNUC_PRINTF(2, 3);
static void stalled(Axis *axis, const char *format, ...) {
    va_list args;
    va_start(args, format);
    GError *error =
        error_details_new_valist(DEVICE_ERROR, DEVICE_ERROR_STALLED, NULL, format, args);
    va_end(args);
    report_fault(axis, error);
}

static gboolean is_at(const struct modbus_axis *priv, gint64 steps) {
    gint64 tolerance = MAX(1, (gint64)(priv->tolerance_deg * fabs(priv->steps_per_deg)));
    return ABS(priv->steps - steps) <= tolerance;
}

static gboolean is_past(const Axis *axis, gint64 since_us, double ms) {
    return (double)(clock_now_us(axis->device.clock) - since_us) > ms * 1000;
}

static void check_moving(Axis *axis, const struct modbus_job *job, gboolean moving) {
    struct modbus_axis *priv = axis->device.priv;
    double at = to_deg(priv, priv->steps), target = to_deg(priv, priv->target_steps);
    if (!moving && is_at(priv, priv->target_steps))
        axis_finish(axis, AXIS_ARRIVED);
    else if (!moving && is_past(axis, priv->still_us, priv->start_ms))
        stalled(axis,
                "it stands at %.3f° instead of %.3f°%s" ERROR_ADVICE
                "check what blocks it, then home it",
                at, target, has_bit(job, priv->limit_bit) ? ", at a limit switch" : "");
    else if (moving && is_past(axis, priv->progress_us, priv->stall_ms))
        stalled(axis,
                "stalled at %.3f° on its way to %.3f°: no progress for %g ms" ERROR_ADVICE
                "check what blocks it, then home it",
                at, target, priv->stall_ms);
}

/* Ends a homing when the drive stands and has its reference. It has the reference if the homed bit
 * is set, or at position 0 if the drive has no such bit. The reference may be left from an earlier
 * homing, so the drive must first move or lose it, or stand for start_ms. A drive that stands for
 * start_ms without a reference has a fault. */
static void check_homing(Axis *axis, const struct modbus_job *job, gboolean moving) {
    struct modbus_axis *priv = axis->device.priv;
    gboolean homed = priv->homed_bit < 0 ? is_at(priv, 0) : has_bit(job, priv->homed_bit);
    gboolean rested = is_past(axis, priv->still_us, priv->start_ms);
    priv->left_home |= moving || !homed;
    if (!moving && homed && (priv->left_home || rested))
        axis_finish(axis, AXIS_HOMED);
    else if (!moving && rested)
        stalled(axis,
                "its homing ended without a reference, at %.3f°" ERROR_ADVICE
                "check the reference switch",
                to_deg(priv, priv->steps));
}

static void check_standing(Axis *axis, const struct modbus_job *job, gint64 before_steps) {
    struct modbus_axis *priv = axis->device.priv;
    if (!axis_is_homed(axis) || axis_is_moving(axis))
        return;
    if (priv->homed_bit >= 0 && !has_bit(job, priv->homed_bit))
        report_fault(axis,
                     device_error_new(
                         DEVICE_ERROR_DISCONNECTED, NULL,
                         "the drive has lost its reference, as after a loss of power" ERROR_ADVICE
                         "home it"));
    else if (!is_at(priv, before_steps))
        report_fault(
            axis,
            device_error_new(DEVICE_ERROR_STALLED, NULL,
                             "it stood at %.3f° and is now at %.3f° without a command" ERROR_ADVICE
                             "check what moved it, then home it",
                             to_deg(priv, before_steps), to_deg(priv, priv->steps)));
}

static void axis_evaluate(Axis *axis, const struct modbus_job *job) {
    struct modbus_axis *priv = axis->device.priv;
    gint64 before = priv->steps;
    gboolean moving = has_bit(job, priv->moving_bit), was_faulty = priv->faulty;
    priv->steps = axis_join(priv, job->requests[job->n - 1].values, priv->position.bits);
    priv->faulty = has_bit(job, priv->fault_bit);
    if (priv->steps != before)
        priv->progress_us = clock_now_us(axis->device.clock);
    if (moving)
        priv->still_us = clock_now_us(axis->device.clock);
    /* A drive that was stopped by its own watchdog reports a fault, but stands still. */
    gboolean halted = priv->phase == STOPPING && !moving && !axis_is_homed(axis);
    if (priv->faulty && !halted &&
        (priv->phase != STANDING || (!was_faulty && axis_is_homed(axis))))
        stalled(axis,
                "the drive reports a fault (status 0x%04x) at %.3f°" ERROR_ADVICE
                "see its display, then home it",
                job->requests[job->n - 2].values[0], to_deg(priv, priv->steps));
    else if (priv->phase == MOVING)
        check_moving(axis, job, moving);
    else if (priv->phase == HOMING)
        check_homing(axis, job, moving);
    else if (priv->phase == STANDING)
        check_standing(axis, job, before);
    /* The drive stood still in two polls in a row. At the first of them, a motion that was
     * commanded shortly before may not have begun. */
    else if (!moving && priv->was_still)
        axis_finish(axis, AXIS_STOPPED);
    else
        priv->was_still = !moving;
}

/* The drive moves whether it is polled or not. A late answer therefore does not end a move. */
static void on_polled(const struct modbus_job *job, const GError *error, gpointer data) {
    Axis *axis = data;
    struct modbus_axis *priv = axis->device.priv;
    priv->polling = FALSE;
    /* The answer is older than the commands. The last command polls again. */
    if (priv->n_commands > 0)
        return;
    poll_later(axis);
    if (error) {
        priv->n_unheard++;
        if (priv->phase != STANDING && priv->n_unheard >= MIN_UNHEARD &&
            is_past(axis, priv->heard_us, priv->lost_ms))
            report_fault(axis, g_error_copy(error));
        return;
    }
    priv->n_unheard = 0;
    priv->heard_us = clock_now_us(axis->device.clock);
    if (priv->phase == MOVING) {
        const gint64 steps = axis_join(priv, job->requests[job->n - 1].values, priv->position.bits);
        axis_report_answer(axis, to_deg(priv, steps), priv->polled_us, priv->heard_us);
    }
    if (priv->n_commands == 0) /* the listener may have stopped the axis */
        axis_evaluate(axis, job);
}

/* Adds a write of the speed if the register has another value. */
static void axis_set_speed(struct modbus_axis *priv, struct modbus_job *job, double deg_s) {
    if (priv->speed.address < 0 || deg_s == priv->speed_deg_s)
        return;
    add_number(priv, job, &priv->speed, MAX(1, llround(deg_s * priv->speed_scale)));
    priv->speed_deg_s = deg_s;
}

static gboolean modbus_axis_home(Axis *axis, GError **error) {
    struct modbus_axis *priv = axis->device.priv;
    struct modbus_job job = {0};
    if (priv->faulty)
        add_writes(&job, priv->clear);
    priv->speed_deg_s = 0; /* unknown now, because a write may have failed */
    axis_set_speed(priv, &job, priv->motion.speed_deg_s);
    add_writes(&job, priv->home);
    axis_command(axis, HOMING, &job);
    return TRUE;
}

static gboolean modbus_axis_turn(Axis *axis, double target_deg, double speed_deg_s,
                                 GError **error) {
    struct modbus_axis *priv = axis->device.priv;
    struct modbus_job job = {0};
    double steps = round((target_deg - priv->home_deg) * priv->steps_per_deg);
    double limit = priv->target.bits == BITS_32 ? G_MAXINT32 : G_MAXINT16;
    if (fabs(steps) > limit)
        return device_error_set(
            error, DEVICE_ERROR_RANGE, axis->device.who,
            "%g° is %.0f steps, but target_register holds at most %.0f" ERROR_ADVICE
            "home the axis, or correct target_bits",
            target_deg, steps, limit);
    priv->target_steps = (gint64)steps;
    axis_set_speed(priv, &job, speed_deg_s);
    add_number(priv, &job, &priv->target, priv->target_steps);
    add_writes(&job, priv->start);
    axis_command(axis, MOVING, &job);
    return TRUE;
}

static gboolean modbus_axis_move(Axis *axis, double target_deg, GError **error) {
    const struct modbus_axis *priv = axis->device.priv;
    return modbus_axis_turn(axis, target_deg, priv->motion.speed_deg_s, error);
}

static gboolean modbus_axis_stop(Axis *axis, GError **error) {
    struct modbus_axis *priv = axis->device.priv;
    struct modbus_job job = {0};
    add_writes(&job, priv->stop);
    axis_command(axis, STOPPING, &job);
    return TRUE;
}

static double axis_position(Axis *axis) {
    const struct modbus_axis *priv = axis->device.priv;
    return to_deg(priv, priv->steps);
}

static void axis_check_range(const struct config_section *section, const char *key, double value,
                             int bits, Mistakes *mistakes) {
    if (fabs(value) > (bits == BITS_32 ? G_MAXINT32 : G_MAXUINT16))
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, key,
                       "the value for the drive, %.0f, does not fit into %s bits; write a smaller "
                       "scale, or more bits for the register",
                       value, bits_choices[bits]);
}

static void axis_check(gconstpointer given, const struct config_section *section,
                       Mistakes *mistakes) {
    const struct modbus_axis *priv = given;
    if (priv->steps_per_deg == 0)
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "steps_per_deg", "must not be 0");
    if (!priv->motion.wraps && priv->motion.min_deg >= priv->motion.max_deg)
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "min_deg",
                       "%g is not below max_deg, %g", priv->motion.min_deg, priv->motion.max_deg);
    axis_check_range(section, "speed_scale", priv->motion.speed_deg_s * priv->speed_scale,
                     priv->speed.bits, mistakes);
    axis_check_range(section, "accel_scale", priv->motion.accel_deg_s2 * priv->accel_scale,
                     priv->accel.bits, mistakes);
    check_writes(section, "setup", priv->setup, FALSE, mistakes);
    check_writes(section, "start", priv->start, TRUE, mistakes);
    check_writes(section, "home", priv->home, TRUE, mistakes);
    check_writes(section, "stop", priv->stop, TRUE, mistakes);
    check_writes(section, "clear", priv->clear, FALSE, mistakes);
    check_writes(section, "watchdog", priv->watchdog, FALSE, mistakes);
    if (priv->own.address >= 0)
        modbus_watchdog_check(&priv->own, &priv->link, section, G_MAXUINT16, mistakes);
    modbus_link_check(&priv->link, section, mistakes);
}

/* Names the target register, because one drive may turn several axes, each with separate
 * registers. */
static void axis_needs(gconstpointer given, GPtrArray *to) {
    const struct modbus_axis *priv = given;
    g_ptr_array_add(to, modbus_address_of("the axis with target_register", priv->target.address,
                                          priv->link.bus, priv->link.unit));
}

/* Sets the drive up and reads its position. */
static gboolean axis_open_axis(Axis *axis, GError **error) {
    struct modbus_axis *priv = axis->device.priv;
    struct modbus_job job = {0};
    priv->bus = modbus_bus_get(&priv->link, &axis->device, error);
    if (!priv->bus)
        return FALSE;
    add_writes(&job, priv->setup);
    if (priv->speed.address >= 0)
        add_number(priv, &job, &priv->speed, llround(priv->motion.speed_deg_s * priv->speed_scale));
    if (priv->accel.address >= 0)
        add_number(priv, &job, &priv->accel,
                   llround(priv->motion.accel_deg_s2 * priv->accel_scale));
    add_poll(priv, &job);
    if (!modbus_bus_do(priv->bus, &priv->link, &job, DEADLINE_MS, error) ||
        !modbus_watchdog_arm(&priv->own, priv->bus, &priv->link, error)) {
        error_details_add_subject(error, axis->device.who);
        g_clear_pointer(&priv->bus, modbus_bus_unref);
        return FALSE;
    }
    priv->steps = axis_join(priv, job.requests[job.n - 1].values, priv->position.bits);
    priv->faulty = has_bit(&job, priv->fault_bit);
    axis->motion = priv->motion;
    priv->speed_deg_s = priv->motion.speed_deg_s;
    /* Without a register for the speed, the axis turns at a fixed speed. */
    if (priv->speed.address >= 0) {
        axis->motion.report_ms = priv->poll_ms + 2 * priv->stamp_ms;
        axis->motion.stamp_ms = priv->stamp_ms;
    }
    poll_later(axis);
    return TRUE;
}

static void axis_close_axis(Axis *axis) {
    struct modbus_axis *priv = axis->device.priv;
    struct modbus_job job = {0};
    clock_cancel(axis->device.clock, &priv->timer);
    modbus_bus_cancel(priv->bus, axis);
    if (priv->phase != STANDING || priv->n_commands > 0 || axis_safety(axis) != DEVICE_SAFE) {
        add_writes(&job, priv->stop);
        modbus_bus_do(priv->bus, &priv->link, &job, DEADLINE_MS, NULL);
    }
    g_clear_pointer(&priv->bus, modbus_bus_unref);
}

const struct axis_driver modbus_axis_driver = {
    .info = {"axis", "modbus-axis",
             "A positioning drive on a Modbus line, described by its registers", options,
             sizeof(struct modbus_axis), axis_check, axis_needs},
    .open = axis_open_axis,
    .close = axis_close_axis,
    .home = modbus_axis_home,
    .move = modbus_axis_move,
    .turn = modbus_axis_turn,
    .stop = modbus_axis_stop,
    .position = axis_position,
};
