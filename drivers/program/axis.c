/* An axis that a program moves. The program answers "move" and "stop" immediately. The driver
 * repeats "get", which returns the position and whether the axis still moves, until the axis
 * stands. */
#include "devices.h"
#include "message.h"
#include "program.h"

#include <math.h>

#define POLL_US  (100 * 1000) /* time between two "get" while the axis moves */
#define CLOSE_MS 500          /* longest time that close() waits for the answer to "stop" */
#define MAX_DEG  1e9

enum phase { STANDING, HOMING, MOVING, STOPPING };

struct program_axis {
    struct program_command command;
    struct axis_motion motion;
    double tolerance_deg;
    Program *program;
    enum phase phase;
    /* Number of commands so far. It is the tag of the requests of the last command, so the answers
     * to earlier commands are recognised. */
    int n_commands;
    gboolean told; /* the fault of the last command was reported */
    double target_deg, position_deg;
    guint timer;
};

struct status {
    double deg;
    gboolean moving, homed;
};

#define FIELD(name) G_STRUCT_OFFSET(struct program_axis, name)

static const struct option options[] = {
    PROGRAM_OPTIONS(FIELD(command)),
    AXIS_MOTION_OPTIONS(FIELD(motion), NULL, NULL),
    AXIS_HOMING_OPTION(FIELD(motion)),
    {"tolerance_deg", OPTION_DOUBLE, "deg", 0, 10, "0.05", NULL, FIELD(tolerance_deg),
     "Largest difference between the target of a move and the position that the program reports "
     "at its end"},
    {NULL},
};

static gboolean read_status(const Axis *axis, JsonObject *values, struct status *ret,
                            GError **error) {
    const struct program_axis *priv = axis->device.priv;
    if (message_number(values, "deg", -MAX_DEG, MAX_DEG, &ret->deg, error) &&
        message_boolean(values, "moving", &ret->moving, error) &&
        message_boolean(values, "homed", &ret->homed, error))
        return TRUE;
    program_name_error(priv->program, error);
    return FALSE;
}

/* Reports a fault. Call it last, because the listener may close the axis. Takes ownership of the
 * error. */
static void fault(Axis *axis, GError *error) {
    struct program_axis *priv = axis->device.priv;
    clock_cancel(axis->device.clock, &priv->timer);
    priv->phase = STANDING;
    priv->told = TRUE;
    axis_report(axis, AXIS_FAULT, error);
}

static void ended(Axis *axis, enum axis_event event) {
    struct program_axis *priv = axis->device.priv;
    priv->phase = STANDING;
    axis_report(axis, event, NULL);
}

static void poll_status(gpointer data) {
    Axis *axis = data;
    struct program_axis *priv = axis->device.priv;
    priv->timer = 0;
    program_call(
        priv->program,
        &(struct program_request){.method = "get", .turn = PROGRAM_FIRST, .tag = priv->n_commands});
}

/* Takes the state of an axis that stands. */
static void take_end(Axis *axis, const struct status *status) {
    struct program_axis *priv = axis->device.priv;
    const double off = status->deg - priv->target_deg;
    if (priv->phase == STOPPING)
        ended(axis, AXIS_STOPPED);
    else if (priv->phase == HOMING && status->homed)
        ended(axis, AXIS_HOMED);
    else if (priv->phase == HOMING)
        fault(axis, device_error_new(DEVICE_ERROR_STALLED, axis->device.who,
                                     "homing ended at %.3f° without a reference" ERROR_ADVICE
                                     "check the reference switch, then home the axis",
                                     status->deg));
    else if (fabs(off) <= priv->tolerance_deg)
        ended(axis, AXIS_ARRIVED);
    else
        fault(axis, device_error_new(DEVICE_ERROR_STALLED, axis->device.who,
                                     "it stands at %.3f° instead of %.3f°" ERROR_ADVICE
                                     "check that it turns freely, then home it",
                                     status->deg, priv->target_deg));
}

static void on_answer(const struct program_answer *answer, gpointer data) {
    Axis *axis = data;
    struct program_axis *priv = axis->device.priv;
    struct status status;
    GError *error = answer->error ? g_error_copy(answer->error) : NULL;
    if (answer->tag != priv->n_commands || priv->phase == STANDING) {
        g_clear_error(&error);
        return; /* it answers an earlier command */
    }
    if (error || !read_status(axis, answer->values, &status, &error)) {
        fault(axis, error);
        return;
    }
    priv->position_deg = status.deg;
    if (status.moving)
        priv->timer = clock_call_in(axis->device.clock, POLL_US, poll_status, axis);
    else
        take_end(axis, &status);
}

static void on_lost(const GError *error, gboolean answered, gpointer data) {
    Axis *axis = data;
    const struct program_axis *priv = axis->device.priv;
    if (!priv->told)
        fault(axis, g_error_copy(error));
}

static void on_event(const char *event, JsonObject *values, gpointer data) {
    Axis *axis = data;
    const struct program_axis *priv = axis->device.priv;
    if (g_str_equal(event, "lost"))
        fault(axis, program_lost_error(priv->program, values));
}

/* Starts a motion or a stop. Drops an earlier command that was not sent. */
static void start(Axis *axis, enum phase phase, const char *method, JsonObject *params) {
    struct program_axis *priv = axis->device.priv;
    const struct program_request request = {.method = method,
                                            .params = params,
                                            .turn = phase == STOPPING ? PROGRAM_AT_ONCE
                                                                      : PROGRAM_IN_TURN,
                                            .read_back = TRUE,
                                            .tag = priv->n_commands + 1};
    clock_cancel(axis->device.clock, &priv->timer);
    program_overtake(priv->program, priv->n_commands);
    priv->n_commands++;
    priv->phase = phase;
    priv->told = FALSE;
    program_call(priv->program, &request);
}

static JsonObject *motion_of(const struct program_axis *priv) {
    JsonObject *params = json_object_new();
    json_object_set_double_member(params, "speed_deg_s", priv->motion.speed_deg_s);
    json_object_set_double_member(params, "accel_deg_s2", priv->motion.accel_deg_s2);
    return params;
}

static gboolean home(Axis *axis, GError **error) {
    JsonObject *params = motion_of(axis->device.priv);
    json_object_set_boolean_member(params, "home", TRUE);
    start(axis, HOMING, "move", params);
    return TRUE;
}

static gboolean move(Axis *axis, double target_deg, GError **error) {
    struct program_axis *priv = axis->device.priv;
    JsonObject *params = motion_of(priv);
    json_object_set_double_member(params, "deg", target_deg);
    priv->target_deg = target_deg;
    start(axis, MOVING, "move", params);
    return TRUE;
}

static gboolean stop(Axis *axis, GError **error) {
    start(axis, STOPPING, "stop", NULL);
    return TRUE;
}

static double position(Axis *axis) {
    return ((const struct program_axis *)axis->device.priv)->position_deg;
}

/* Reads the state when the axis is opened. Stops an axis that already moves. */
static gboolean read_first(Axis *axis, GError **error) {
    struct program_axis *priv = axis->device.priv;
    struct status status;
    g_autoptr(JsonObject) values =
        program_ask(priv->program, &(struct program_request){.method = "get"}, error);
    if (!values || !read_status(axis, values, &status, error))
        return FALSE;
    priv->position_deg = status.deg;
    if (!status.moving)
        return TRUE;
    g_autoptr(JsonObject) stopped =
        program_ask(priv->program, &(struct program_request){.method = "stop"}, error);
    return stopped != NULL;
}

static gboolean open_axis(Axis *axis, GError **error) {
    struct program_axis *priv = axis->device.priv;
    const struct program_listener listener = {on_lost, on_event, on_answer, axis};
    axis->motion = priv->motion;
    priv->program = program_new(&priv->command, &axis->device, NULL, error);
    if (!priv->program)
        return FALSE;
    if (!program_await(priv->program, error) || !read_first(axis, error)) {
        g_clear_pointer(&priv->program, program_close);
        return FALSE;
    }
    program_listen(priv->program, &listener);
    return TRUE;
}

static void close_axis(Axis *axis) {
    struct program_axis *priv = axis->device.priv;
    clock_cancel(axis->device.clock, &priv->timer);
    program_listen(priv->program, NULL);
    if (priv->phase != STANDING || axis_safety(axis) != DEVICE_SAFE) {
        JsonObject *stopped =
            program_ask(priv->program,
                        &(struct program_request){"stop", NULL, CLOSE_MS, PROGRAM_AT_ONCE}, NULL);
        g_clear_pointer(&stopped, json_object_unref);
    }
    g_clear_pointer(&priv->program, program_close);
}

static void check(gconstpointer given, const struct config_section *section, Mistakes *mistakes) {
    program_check(&((const struct program_axis *)given)->command, section, mistakes);
}

static void needs(gconstpointer given, GPtrArray *to) {
    program_need(&((const struct program_axis *)given)->command, to);
}

const struct axis_driver program_axis_driver = {
    .info = {"axis", "program-axis",
             "An axis that a program of yours moves (docs/build-a-rig/programs.md)", options,
             sizeof(struct program_axis), check, needs},
    .open = open_axis,
    .close = close_axis,
    .home = home,
    .move = move,
    .stop = stop,
    .position = position,
};
