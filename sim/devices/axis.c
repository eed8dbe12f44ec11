#include "devices.h"
#include "part.h"
#include "unheard.h"
#include "world/world.h"

#include <math.h>

/* interval in µs between updates of the world by a moving axis */
#define TICK_US     20000
#define MIN_TICK_US 1000

enum phase { STANDING, RINGING, MOVING, BRAKING, HOMING, STALLED };
enum stall_kind { STALL_REPORTED, STALL_SILENT };
enum part { PART_NONE, PART_TURNTABLE, PART_ARC, PART_ARM, PART_PROBE, PART_SWEEP };

struct sim_axis {
    char *world_path, *part_name;
    struct axis_motion motion;
    double home_deg, latency_ms, ringing_deg, position_error_deg;
    double fault_slip_deg;
    int error_seed, fault_slip_at, fault_stall_at, fault_stall_kind;
    struct sim_unheard unheard;

    World *world;
    enum part part;
    int laser;

    enum phase phase;
    guint timer, unanswered;
    gboolean mute; /* the axis does not answer the last command */
    int n_moves;
    gboolean stalls;
    double from_deg, to_deg, speed0_deg_s; /* `speed0_deg_s`: signed speed when braking began */
    gint64 start_us, end_us;
    double speed_deg_s; /* top speed of this movement */
    gboolean turning;   /* the movement was begun by axis_turn(), so the position is reported */
    /* `slack_deg`: angle by which the load lags behind the motor */
    double position_deg, slack_deg;
};

#define FIELD(name) G_STRUCT_OFFSET(struct sim_axis, name)

static const char *const stall_kinds[] = {"reported", "silent", NULL};

static const struct option options[] = {
    {"world", OPTION_PATH, NULL, 0, 0, "", NULL, FIELD(world_path),
     "World file whose part this axis moves; default: it moves nothing"},
    {"part", OPTION_STRING, NULL, 0, 0, "", NULL, FIELD(part_name),
     "The part that it moves: turntable, arc, arm, probe, or a laser's name for its sweep; "
     "default: the "
     "section's own name"},
    AXIS_MOTION_OPTIONS(FIELD(motion), "60", "120"),
    {"ringing_deg", OPTION_DOUBLE, "deg", 0, 10, "0.02", NULL, FIELD(ringing_deg),
     "Amplitude with which the load swings after a move"},
    {"home_deg", OPTION_DOUBLE, "deg", -36000, 36000, "0", NULL, FIELD(home_deg),
     "Position of the reference switch"},
    {"homing_s", OPTION_DOUBLE, "s", 0, 3600, "2", NULL, FIELD(motion.homing_s),
     "Duration of homing"},
    {"report_ms", OPTION_DOUBLE, "ms", 0, 1000, "20", NULL, FIELD(motion.report_ms),
     "With motion = continuous: time between two reports of the position; 0: it cannot report"},
    {"latency_ms", OPTION_DOUBLE, "ms", 0, 60000, "0", NULL, FIELD(latency_ms),
     "Delay of the reports of the axis"},
    {"position_error_deg", OPTION_DOUBLE, "deg", 0, 10, "0", NULL, FIELD(position_error_deg),
     "Largest position error; it is repeatable, a function of the position and error_seed"},
    {"error_seed", OPTION_INT, NULL, 0, G_MAXINT, "1", NULL, FIELD(error_seed),
     "Seed of the position errors"},
    {"fault_slip_deg", OPTION_DOUBLE, "deg", -360, 360, "0", NULL, FIELD(fault_slip_deg),
     "Fault: angle by which the load slips on its shaft, counter-clockwise"},
    {"fault_slip_at", OPTION_INT, NULL, 0, G_MAXINT, "0", NULL, FIELD(fault_slip_at),
     "Number of the movement in which the load slips by fault_slip_deg (taking up backlash counts "
     "as a movement); 0: before the first"},
    {"fault_stall_at", OPTION_INT, NULL, 0, G_MAXINT, "0", NULL, FIELD(fault_stall_at),
     "Fault: the n-th movement stalls half way (taking up backlash counts as a movement); 0: no "
     "movement stalls"},
    {"fault_stall_kind", OPTION_CHOICE, NULL, 0, 0, "reported", stall_kinds,
     FIELD(fault_stall_kind), "Whether the axis reports a stall, or never answers again"},
    SIM_UNHEARD_OPTIONS(FIELD(unheard)),
    {NULL},
};

static gint64 sim_axis_to_us(double seconds) {
    return (gint64)ceil(seconds * 1e6);
}

/* Returns a pseudo-random number from −1 to 1 that depends only on value and seed. The hash uses
 * integer arithmetic, so the number is the same on every machine. */
static double hash_unit(gint64 value, int seed) {
    guint64 x = (guint64)value * 0x9e3779b97f4a7c15u + (guint64)seed * 0xbf58476d1ce4e5b9u;
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
    return (double)((x ^ (x >> 31)) >> 11) * 0x1p-52 - 1;
}

/* Returns the position error at deg. The error has two parts. One part, up to 70 % of most_deg, has
 * one period per turn, like the error of an eccentric bearing. The other part, up to 30 % of
 * most_deg, changes every 0.001°, like the error of an uneven scale. */
static double position_error_deg(double deg, double most_deg, int seed) {
    if (most_deg == 0)
        return 0;
    double turn = 2 * G_PI * deg / 360;
    double smooth = sin(turn + G_PI * hash_unit(-1, seed));
    double uneven = hash_unit(llround(deg * 1000), seed);
    return most_deg * (0.7 * smooth + 0.3 * uneven);
}

/* The position is rounded, so that a command always leads to the same bits, however many turns the
 * axis has made before. */
double sim_axis_true_deg(double deg, gboolean wraps, double most_deg, int seed) {
    if (wraps)
        deg -= 360 * floor(deg / 360);
    deg = (double)llround(deg * 1e6) / 1e6;
    if (wraps && deg >= 360)
        deg = 0;
    return deg + position_error_deg(deg, most_deg, seed);
}

static double position_now(const struct sim_axis *sim, gint64 now_us, double *ret_speed);

/* Writes the position of the load to the world. off_deg is the present deflection of the load if it
 * swings after a stop. */
static void update_world(Axis *axis, double off_deg) {
    struct sim_axis *sim = axis->device.priv;
    const gint64 now = clock_now_us(axis->device.clock);
    double speed = 0;
    double slip = sim->n_moves >= sim->fault_slip_at ? sim->fault_slip_deg : 0;
    double deg = sim_axis_true_deg(sim->position_deg, sim->motion.wraps, sim->position_error_deg,
                                   sim->error_seed) +
                 sim->slack_deg + slip + off_deg;
    if (sim->phase == MOVING || sim->phase == BRAKING)
        position_now(sim, now, &speed);
    if (sim->part == PART_TURNTABLE && speed != 0)
        world_turn_turntable(sim->world, deg, speed, now);
    else if (sim->part == PART_TURNTABLE)
        world_set_turntable(sim->world, deg);
    else if (sim->part == PART_ARC)
        world_set_arc(sim->world, deg);
    else if (sim->part == PART_ARM)
        world_set_arm(sim->world, deg);
    else if (sim->part == PART_PROBE)
        world_set_probe(sim->world, deg);
    else if (sim->part == PART_SWEEP)
        world_set_sweep(sim->world, sim->laser, deg);
}

static void go_to(struct sim_axis *sim, double deg) {
    double slack = sim->slack_deg - (deg - sim->position_deg);
    sim->slack_deg = slack < 1e-7 ? 0 : MIN(slack, sim->motion.backlash_deg);
    sim->position_deg = deg;
}

/* Returns the distance after t seconds of a move over d degrees with a trapezoidal speed profile.
 * Sets *ret_speed to the speed at this time. Distance and speed are positive. */
static double sim_axis_travelled(const struct sim_axis *sim, double d, double t,
                                 double *ret_speed) {
    double a = sim->motion.accel_deg_s2, v = MIN(sim->speed_deg_s, sqrt(a * d));
    double ramp = v / a, total = d / v + ramp;
    double left = MAX(0, total - t);
    *ret_speed = MIN(v, a * MIN(t, left));
    if (t <= ramp)
        return a * t * t / 2;
    if (left <= ramp)
        return d - a * left * left / 2;
    return v * (t - ramp / 2);
}

/* Returns the position of the drive at now_us. The phase must be MOVING or BRAKING. Sets *ret_speed
 * to the signed speed of a moving drive. If the drive brakes or its motion has ended, *ret_speed is
 * 0. */
static double position_now(const struct sim_axis *sim, gint64 now_us, double *ret_speed) {
    double t = (double)(now_us - sim->start_us) * 1e-6, speed = 0;
    double sign = sim->to_deg < sim->from_deg ? -1 : 1;
    *ret_speed = 0;
    if (now_us >= sim->end_us)
        return sim->to_deg;
    if (sim->phase == BRAKING)
        return sim->from_deg + sim->speed0_deg_s * t - sign * sim->motion.accel_deg_s2 * t * t / 2;
    double way = sim_axis_travelled(sim, fabs(sim->to_deg - sim->from_deg), t, &speed);
    *ret_speed = sign * speed;
    return sim->from_deg + sign * way;
}

static void sim_axis_on_timer(gpointer data);

static void wake_at(Axis *axis, gint64 at_us) {
    struct sim_axis *sim = axis->device.priv;
    clock_cancel(axis->device.clock, &sim->timer);
    sim->timer = clock_call_at(axis->device.clock, at_us, sim_axis_on_timer, axis);
}

static gint64 latency_us(const struct sim_axis *sim) {
    return sim_axis_to_us(sim->latency_ms / 1000);
}

static gboolean is_mute(const Axis *axis) {
    const struct sim_axis *sim = axis->device.priv;
    return sim->mute || sim_unheard_is_dead(&sim->unheard, axis->device.clock);
}

static void stall(Axis *axis) {
    struct sim_axis *sim = axis->device.priv;
    sim->phase = STALLED;
    update_world(axis, 0); /* the load stands still */
    if (sim->fault_stall_kind == STALL_SILENT || is_mute(axis))
        return;
    axis_report(axis, AXIS_FAULT,
                device_error_new(DEVICE_ERROR_STALLED, axis->device.who,
                                 "stalled at %.3f° on its way to %.3f°" ERROR_ADVICE
                                 "check what blocks the axis",
                                 sim->position_deg, sim->to_deg));
}

static void sim_axis_finish(Axis *axis) {
    struct sim_axis *sim = axis->device.priv;
    enum axis_event event = sim->phase == HOMING    ? AXIS_HOMED
                            : sim->phase == BRAKING ? AXIS_STOPPED
                                                    : AXIS_ARRIVED;
    if (sim->phase == HOMING)
        sim->slack_deg = 0;
    sim->phase = STANDING;
    if (event == AXIS_ARRIVED && sim->motion.settle_ms > 0 && sim->ringing_deg > 0) {
        sim->phase = RINGING;
        update_world(axis, sim->ringing_deg);
        wake_at(axis,
                clock_now_us(axis->device.clock) + sim_axis_to_us(sim->motion.settle_ms / 1000));
    } else {
        update_world(axis, 0);
    }
    if (!is_mute(axis))
        axis_report(axis, event, NULL);
}

static gint64 tick_us(const struct sim_axis *sim) {
    return sim->turning ? MAX((gint64)(sim->motion.report_ms * 1000), MIN_TICK_US) : TICK_US;
}

static void sim_axis_on_timer(gpointer data) {
    Axis *axis = data;
    struct sim_axis *sim = axis->device.priv;
    gint64 now = clock_now_us(axis->device.clock);
    double speed;
    sim->timer = 0;
    if (sim->phase == RINGING) {
        sim->phase = STANDING;
        update_world(axis, 0);
        return;
    }
    if (sim->phase == MOVING && sim->stalls && now >= (sim->start_us + sim->end_us) / 2) {
        stall(axis);
        return;
    }
    if (now >= sim->end_us + latency_us(sim)) {
        go_to(sim, sim->to_deg);
        sim_axis_finish(axis);
        return;
    }
    if (sim->phase != HOMING) {
        go_to(sim, position_now(sim, now, &speed));
        update_world(axis, 0);
    }
    gint64 next = now < sim->end_us ? MIN(now + tick_us(sim), sim->end_us) : now + tick_us(sim);
    wake_at(axis, MIN(next, sim->end_us + latency_us(sim)));
    if (sim->turning && sim->phase == MOVING && !is_mute(axis))
        axis_report_position(axis, sim->position_deg, now);
}

static void sim_axis_start(Axis *axis, enum phase phase, double to_deg, double seconds) {
    struct sim_axis *sim = axis->device.priv;
    gint64 now = clock_now_us(axis->device.clock);
    sim->phase = phase;
    sim->from_deg = sim->position_deg;
    sim->to_deg = to_deg;
    sim->start_us = now;
    sim->end_us = now + sim_axis_to_us(seconds);
    wake_at(axis, MIN(now + tick_us(sim), sim->end_us + latency_us(sim)));
}

static void sim_axis_on_unanswered(gpointer data) {
    Axis *axis = data;
    ((struct sim_axis *)axis->device.priv)->unanswered = 0;
    axis_report(axis, AXIS_FAULT, sim_unheard_error(&axis->device));
}

/* Returns whether the axis carries out a command. If the axis does not answer the command, the
 * driver reports a fault after SIM_UNHEARD_US. */
static gboolean sim_axis_obeys(Axis *axis) {
    struct sim_axis *sim = axis->device.priv;
    Clock *clock = axis->device.clock;
    gboolean answers, obeys = sim_unheard_obeys(&sim->unheard, clock, &answers);
    clock_cancel(clock, &sim->unanswered);
    sim->mute = !answers;
    if (!answers)
        sim->unanswered = clock_call_in(clock, SIM_UNHEARD_US, sim_axis_on_unanswered, axis);
    return obeys;
}

static gboolean sim_axis_home(Axis *axis, GError **error) {
    struct sim_axis *sim = axis->device.priv;
    if (!sim_axis_obeys(axis))
        return TRUE;
    sim->stalls = sim->turning = FALSE;
    sim_axis_start(axis, HOMING, sim->home_deg, sim->motion.homing_s);
    return TRUE;
}

static void sim_axis_go(Axis *axis, double target_deg, double v, gboolean turning) {
    struct sim_axis *sim = axis->device.priv;
    double d = fabs(target_deg - sim->position_deg), a = sim->motion.accel_deg_s2;
    if (!sim_axis_obeys(axis))
        return;
    sim->stalls = ++sim->n_moves == sim->fault_stall_at;
    sim->speed_deg_s = v;
    sim->turning = turning;
    sim_axis_start(axis, MOVING, target_deg, d >= v * v / a ? d / v + v / a : 2 * sqrt(d / a));
}

static gboolean sim_axis_move(Axis *axis, double target_deg, GError **error) {
    const struct sim_axis *sim = axis->device.priv;
    sim_axis_go(axis, target_deg, sim->motion.speed_deg_s, FALSE);
    return TRUE;
}

static gboolean sim_axis_turn(Axis *axis, double target_deg, double speed_deg_s, GError **error) {
    sim_axis_go(axis, target_deg, speed_deg_s, TRUE);
    return TRUE;
}

static gboolean sim_axis_stop(Axis *axis, GError **error) {
    struct sim_axis *sim = axis->device.priv;
    double speed, a = sim->motion.accel_deg_s2;
    if (!sim_axis_obeys(axis))
        return TRUE;
    /* If a stall is silent, the stalled axis does not answer either. */
    gboolean stands = sim->phase == STANDING || sim->phase == RINGING ||
                      (sim->phase == STALLED && sim->fault_stall_kind == STALL_REPORTED);
    if (sim->phase == HOMING || stands) { /* homing is slow, so the axis stops immediately */
        sim->slack_deg = sim->phase == HOMING ? 0 : sim->slack_deg;
        sim_axis_start(axis, BRAKING, sim->position_deg, 0);
    } else if (sim->phase == MOVING) {
        go_to(sim, position_now(sim, clock_now_us(axis->device.clock), &speed));
        sim->speed0_deg_s = speed;
        sim_axis_start(axis, BRAKING, sim->position_deg + speed * fabs(speed) / (2 * a),
                       fabs(speed) / a);
    }
    return TRUE;
}

static double sim_axis_position(Axis *axis) {
    struct sim_axis *sim = axis->device.priv;
    double speed;
    if (sim->phase == MOVING || sim->phase == BRAKING)
        return position_now(sim, clock_now_us(axis->device.clock), &speed);
    return sim->position_deg;
}

static void sim_axis_check(gconstpointer given, const struct config_section *section,
                           Mistakes *mistakes) {
    static const char *const parts[] = {"turntable", "arc", "arm", "probe", NULL};
    const struct sim_axis *sim = given;
    if (!sim->motion.wraps &&
        (sim->home_deg < sim->motion.min_deg || sim->home_deg > sim->motion.max_deg))
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "home_deg",
                       "%g is outside of min_deg to max_deg: give a value from %g to %g",
                       sim->home_deg, sim->motion.min_deg, sim->motion.max_deg);
    sim_part_check(section, sim->world_path, "part", sim->part_name, "laser", parts, mistakes);
}

static gboolean sim_axis_open_axis(Axis *axis, GError **error) {
    struct sim_axis *sim = axis->device.priv;
    const char *name = *sim->part_name ? sim->part_name : axis->device.name;
    axis->motion = sim->motion;
    if (!*sim->world_path)
        return TRUE;
    sim->world = world_get(sim->world_path, error);
    if (!sim->world)
        return FALSE;
    sim->laser = world_find_laser(sim->world, name);
    sim->part = g_str_equal(name, "turntable") ? PART_TURNTABLE
                : g_str_equal(name, "arc")     ? PART_ARC
                : g_str_equal(name, "arm")     ? PART_ARM
                : g_str_equal(name, "probe")   ? PART_PROBE
                                               : PART_SWEEP;
    return TRUE;
}

static void sim_axis_close_axis(Axis *axis) {
    struct sim_axis *sim = axis->device.priv;
    double speed;
    clock_cancel(axis->device.clock, &sim->timer);
    clock_cancel(axis->device.clock, &sim->unanswered);
    if (sim->phase == MOVING || sim->phase == BRAKING)
        go_to(sim, position_now(sim, clock_now_us(axis->device.clock), &speed));
    /* If the axis has not moved since it was opened, it stays where an earlier program left it. */
    if (sim->phase != STANDING)
        update_world(axis, 0);
    g_clear_pointer(&sim->world, world_unref);
}

const struct axis_driver sim_axis_driver = {
    .info = {"axis", "sim-axis",
             "An axis of the simulated world, with backlash and position errors", options,
             sizeof(struct sim_axis), sim_axis_check},
    .open = sim_axis_open_axis,
    .close = sim_axis_close_axis,
    .home = sim_axis_home,
    .move = sim_axis_move,
    .turn = sim_axis_turn,
    .stop = sim_axis_stop,
    .position = sim_axis_position,
};
