#include "board.h"
#include "devices.h"

#include "modbus/address.h"

#include <float.h>
#include <math.h>

enum phase { STANDING, HOMING, MOVING, STOPPING };

struct gcode_axis {
    struct gcode_link link;
    struct axis_motion motion;
    double units_per_deg, home_deg, tolerance_deg, poll_ms, stamp_ms;
    int letter, homing;

    GcodeClient *client;
    enum phase phase;
    gboolean watched;   /* the axis is homed */
    double home_units;  /* position in units of the board when the axis is at home_deg */
    double units;       /* position that was reported last */
    double rest_units;  /* position at the end of the last motion */
    int n_moved;        /* number of reports in a row that differ from rest_units */
    gboolean on_target; /* the axis stands at target_deg, within its tolerance */
    double target_deg;
};

#define FIELD(name) G_STRUCT_OFFSET(struct gcode_axis, name)

static const char *const letters[] = {"X", "Y", "Z", "A", "B", "C", NULL};
static const char *const homings[] = {"all", "axis", "here", NULL};

static const struct option options[] = {
    GCODE_LINK_OPTIONS,
    {"letter", OPTION_CHOICE, NULL, 0, 0, "X", letters, FIELD(letter),
     "Letter of the axis on the board"},
    {"units_per_deg", OPTION_DOUBLE, NULL, -1e6, 1e6, NULL, NULL, FIELD(units_per_deg),
     "Units of the board, which calls them millimetres, in a degree of the axis; negative: the "
     "board counts in the opposite direction"},
    AXIS_MOTION_OPTIONS(FIELD(motion), NULL, NULL),
    AXIS_HOMING_OPTION(FIELD(motion)),
    {"homing", OPTION_CHOICE, NULL, 0, 0, "all", homings, FIELD(homing),
     "all: the board homes all of its axes together ($H, G28). axis: it homes this axis ($HX, "
     "G28 X), which GRBL itself cannot do. here: no switch, the present position is home_deg"},
    {"home_deg", OPTION_DOUBLE, "deg", -36000, 36000, "0", NULL, FIELD(home_deg),
     "Position at the end of homing"},
    {"tolerance_deg", OPTION_DOUBLE, "deg", 0.0001, 10, "0.01", NULL, FIELD(tolerance_deg),
     "Largest distance from the target at which the axis counts as arrived"},
    {"poll_ms", OPTION_DOUBLE, "ms", 5, 250, "20", NULL, FIELD(poll_ms),
     "Time between two questions for the position while the axis moves"},
    {"stamp_ms", OPTION_DOUBLE, "ms", 0.1, 1000, "10", NULL, FIELD(stamp_ms),
     "With motion = continuous: largest error of the time of a position. An answer that takes more "
     "than twice as long is ignored"},
    {NULL},
};

static double to_deg(const struct gcode_axis *priv, double units) {
    return priv->home_deg + (units - priv->home_units) / priv->units_per_deg;
}

static void watch(struct gcode_axis *priv, gboolean watched) {
    priv->watched = watched;
    priv->n_moved = 0;
    gcode_client_watch(priv->client, watched);
}

/* Reports a fault. Call it last, because the listener may close the axis. Takes ownership of
 * error. */
static void fault(Axis *axis, GError *error) {
    struct gcode_axis *priv = axis->device.priv;
    priv->phase = STANDING;
    priv->on_target = FALSE;
    watch(priv, FALSE);
    error_details_add_subject(&error, axis->device.who);
    axis_report(axis, AXIS_FAULT, error);
}

static void on_ended(gpointer data, const GError *error) {
    Axis *axis = data;
    struct gcode_axis *priv = axis->device.priv;
    const enum phase ended = priv->phase;
    if (error) {
        fault(axis, g_error_copy(error));
        return;
    }
    priv->phase = STANDING;
    priv->rest_units = priv->units;
    priv->n_moved = 0;
    if (ended == STOPPING) {
        axis_report(axis, AXIS_STOPPED, NULL);
    } else if (ended == HOMING) {
        priv->home_units = priv->units;
        priv->target_deg = priv->home_deg;
        priv->on_target = TRUE;
        watch(priv, TRUE);
        axis_report(axis, AXIS_HOMED, NULL);
    } else if (fabs(to_deg(priv, priv->units) - priv->target_deg) <= priv->tolerance_deg) {
        priv->on_target = TRUE;
        axis_report(axis, AXIS_ARRIVED, NULL);
    } else {
        fault(axis, device_error_new(DEVICE_ERROR_STALLED, NULL,
                                     "it stands at %.3f° instead of %.3f°" ERROR_ADVICE
                                     "check the cable, and that tolerance_deg is more than a step "
                                     "of the motor, then home it",
                                     to_deg(priv, priv->units), priv->target_deg));
    }
}

static void on_lost(gpointer data, const GError *error) {
    fault(data, g_error_copy(error));
}

/* Takes a position that the board has reported. A standing axis whose position differs in two
 * reports in a row has moved, for example because somebody has used the buttons of the board. A
 * single different report may be noise. */
static void on_position(gpointer data, double units, gint64 asked_us, gint64 answered_us) {
    Axis *axis = data;
    struct gcode_axis *priv = axis->device.priv;
    priv->units = units;
    if (priv->phase == MOVING)
        axis_report_answer(axis, to_deg(priv, units), asked_us, answered_us);
    if (priv->phase != STANDING || !priv->watched || gcode_client_is_dragged(priv->client))
        return;
    const double off_deg = (units - priv->rest_units) / priv->units_per_deg;
    priv->n_moved = fabs(off_deg) > priv->tolerance_deg ? priv->n_moved + 1 : 0;
    if (priv->n_moved > 1)
        gcode_client_report_lost(
            priv->client,
            device_error_new(DEVICE_ERROR_STALLED, NULL,
                             "it stood at %.3f° and is now at %.3f° without a command" ERROR_ADVICE
                             "check what moved it, then home it",
                             to_deg(priv, priv->rest_units), to_deg(priv, units)));
}

static void on_waiting(gpointer data) {
    axis_report_waiting(data);
}

static const struct gcode_listener listener = {on_position, on_ended, on_waiting, on_lost};

static gboolean with_subject(const Axis *axis, gboolean ok, GError **error) {
    if (!ok)
        error_details_add_subject(error, axis->device.who);
    return ok;
}

static gboolean home(Axis *axis, GError **error) {
    static const enum gcode_homing ways[] = {GCODE_HOME_ALL, GCODE_HOME_AXIS, GCODE_HOME_HERE};
    struct gcode_axis *priv = axis->device.priv;
    if (!with_subject(axis, gcode_client_home(priv->client, ways[priv->homing], error), error))
        return FALSE;
    priv->phase = HOMING;
    priv->watched = priv->on_target = FALSE;
    return TRUE;
}

static gboolean turn(Axis *axis, double target_deg, double speed_deg_s, GError **error) {
    struct gcode_axis *priv = axis->device.priv;
    const double scale = fabs(priv->units_per_deg);
    const double units = priv->home_units + (target_deg - priv->home_deg) * priv->units_per_deg;
    /* Boards calculate positions with single-precision floats. */
    if (fabs(units) * (double)FLT_EPSILON > priv->tolerance_deg * scale)
        return device_error_set(
            error, DEVICE_ERROR_RANGE, axis->device.who,
            "at %g° the numbers of the board are coarser than tolerance_deg" ERROR_ADVICE
            "home the axis again, or raise tolerance_deg",
            target_deg);
    if (!with_subject(axis, gcode_client_move(priv->client, units, speed_deg_s * scale, error),
                      error))
        return FALSE;
    priv->phase = MOVING;
    priv->target_deg = target_deg;
    priv->on_target = FALSE;
    return TRUE;
}

static gboolean move(Axis *axis, double target_deg, GError **error) {
    const struct gcode_axis *priv = axis->device.priv;
    return turn(axis, target_deg, priv->motion.speed_deg_s, error);
}

static double brake_s(const Axis *axis) {
    return axis->motion.speed_deg_s / axis->motion.accel_deg_s2;
}

static gboolean stop(Axis *axis, GError **error) {
    struct gcode_axis *priv = axis->device.priv;
    if (!with_subject(axis, gcode_client_stop(priv->client, brake_s(axis), error), error))
        return FALSE;
    priv->on_target &= priv->phase == STANDING;
    priv->phase = STOPPING;
    return TRUE;
}

static double position(Axis *axis) {
    const struct gcode_axis *priv = axis->device.priv;
    return priv->on_target ? priv->target_deg : to_deg(priv, priv->units);
}

static void check(gconstpointer given, const struct config_section *section, Mistakes *mistakes) {
    const struct gcode_axis *priv = given;
    if (priv->units_per_deg == 0)
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "units_per_deg", "must not be 0");
    if (!priv->motion.wraps && priv->motion.min_deg >= priv->motion.max_deg)
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "min_deg",
                       "%g is not below max_deg, %g", priv->motion.min_deg, priv->motion.max_deg);
    gcode_link_check(&priv->link, section, mistakes);
}

static void needs(gconstpointer given, GPtrArray *to) {
    const struct gcode_axis *priv = given;
    g_autofree char *port = modbus_address_name(priv->link.port);
    g_ptr_array_add(to, g_strdup_printf("axis %s of the board at %s", letters[priv->letter], port));
}

/* Compares the section with the settings that the board has reported. The times of the plan and
 * the deadlines need a board that is as fast as the section says. */
static gboolean check_limits(const Axis *axis, GError **error) {
    const struct gcode_axis *priv = axis->device.priv;
    const struct config_section *section = axis->device.section;
    const double scale = fabs(priv->units_per_deg);
    struct gcode_limits is;
    gcode_client_limits(priv->client, &is);
    if (gcode_client_is_missing(priv->client))
        return config_set_error(error, CONFIG_ERROR_VALUE, section, "letter",
                                "the board has no axis %s; choose another letter",
                                letters[priv->letter]);
    if (is.inches > 0)
        return device_error_set(error, DEVICE_ERROR_UNSUPPORTED, axis->device.who,
                                "the board reports inches" ERROR_ADVICE "set $13=0 in the board");
    if (is.homing < 0 && priv->homing != GCODE_HOME_HERE)
        return config_set_error(error, CONFIG_ERROR_VALUE, section, "homing",
                                "homing is off in the board; set $22=1 in the board, or homing = "
                                "here if it has no switches");
    if (is.units_s > 0 && priv->motion.speed_deg_s * scale > is.units_s * 1.001)
        return config_set_error(error, CONFIG_ERROR_VALUE, section, "speed_deg_s",
                                "the board allows %g deg/s; lower speed_deg_s, or raise the limit "
                                "in the board ($%d, M203, max_velocity)",
                                is.units_s / scale, 110 + priv->letter);
    if (is.units_s2 > 0 && priv->motion.accel_deg_s2 * scale > is.units_s2 * 1.001)
        return config_set_error(error, CONFIG_ERROR_VALUE, section, "accel_deg_s2",
                                "the board accelerates with %g deg/s²; lower accel_deg_s2, or "
                                "raise the acceleration in the board ($%d, M201, max_accel)",
                                is.units_s2 / scale, 120 + priv->letter);
    return TRUE;
}

static gboolean open_axis(Axis *axis, GError **error) {
    struct gcode_axis *priv = axis->device.priv;
    axis->motion = priv->motion;
    priv->client = gcode_client_new(&priv->link, priv->letter, priv->poll_ms, &axis->device,
                                    &listener, axis, error);
    if (!with_subject(axis, priv->client != NULL, error))
        return FALSE;
    device_set_identity(&axis->device, gcode_client_firmware(priv->client), NULL, priv->link.port);
    /* only GRBL says at what time an axis had the reported position */
    if (priv->link.dialect == GCODE_GRBL) {
        axis->motion.report_ms = priv->poll_ms + 2 * priv->stamp_ms;
        axis->motion.stamp_ms = priv->stamp_ms;
    }
    if (check_limits(axis, error))
        return TRUE;
    g_clear_pointer(&priv->client, gcode_client_free);
    return FALSE;
}

static void close_axis(Axis *axis) {
    struct gcode_axis *priv = axis->device.priv;
    if (priv->phase != STANDING || axis_safety(axis) != DEVICE_SAFE)
        gcode_client_stop_now(priv->client, brake_s(axis));
    g_clear_pointer(&priv->client, gcode_client_free);
}

const struct axis_driver gcode_axis_driver = {
    .info = {"axis", "gcode-axis",
             "An axis of a board that speaks G-code: GRBL, FluidNC, grblHAL, Marlin or Klipper",
             options, sizeof(struct gcode_axis), check, needs},
    .open = open_axis,
    .close = close_axis,
    .home = home,
    .move = move,
    .turn = turn,
    .stop = stop,
    .position = position,
};
