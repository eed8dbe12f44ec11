#include "bus_schedule.h"

#include <math.h>

#define LONGEST_GAP_S 4.0

static const char *const method_names[BUS_METHODS] = {
    [BUS_SET_LASER] = "SetLaser", [BUS_SET_LAMP] = "SetLamp",  [BUS_MOVE_AXIS] = "MoveAxis",
    [BUS_HOME_AXIS] = "HomeAxis", [BUS_SNAP] = "Snap",         [BUS_SAFE_STATE] = "SafeState",
    [BUS_RELEASE] = "Release",    [BUS_START] = "Start",       [BUS_RESUME] = "Resume",
    [BUS_PAUSE] = "Pause",        [BUS_CONTINUE] = "Continue", [BUS_ABORT] = "Abort",
    [BUS_CLOSE_RIG] = "CloseRig", [BUS_OPEN_RIG] = "OpenRig",  [BUS_GET_ALL] = "GetAll",
};

/* How often each is drawn. Sessions take most of a life's time and are begun in one life of five.
 */
static const int method_weights[BUS_METHODS] = {
    [BUS_SET_LASER] = 12, [BUS_SET_LAMP] = 8,   [BUS_MOVE_AXIS] = 4, [BUS_HOME_AXIS] = 3,
    [BUS_SNAP] = 1,       [BUS_SAFE_STATE] = 4, [BUS_RELEASE] = 6,   [BUS_START] = 3,
    [BUS_RESUME] = 1,     [BUS_PAUSE] = 1,      [BUS_CONTINUE] = 1,  [BUS_ABORT] = 1,
    [BUS_CLOSE_RIG] = 1,  [BUS_OPEN_RIG] = 1,   [BUS_GET_ALL] = 1,
};

static const char *const lasers[] = {"laser30", "laser60"};
static const char *const lamps[] = {"lamp30", "lamp60"};
static const char *const axes[] = {"turntable", "arc", "sweep30", "sweep60"};
static const char *const cameras[] = {"cam30", "cam60"};

const char *bus_schedule_method(enum bus_method method) {
    return method_names[method];
}

const char *bus_schedule_device(enum bus_method method, int device) {
    return method == BUS_SET_LASER                              ? lasers[device]
           : method == BUS_SET_LAMP                             ? lamps[device]
           : method == BUS_MOVE_AXIS || method == BUS_HOME_AXIS ? axes[device]
           : method == BUS_SNAP                                 ? cameras[device]
                                                                : "";
}

/* Evenly on a scale of logarithms. */
static double draw_log(GRand *random, double least, double most) {
    return exp(g_rand_double_range(random, log(least), log(most)));
}

G_GNUC_PRINTF(3, 4)
static void add_line(struct bus_schedule *schedule, const char *section, const char *format, ...) {
    if (schedule->n_lines == BUS_MAX_LINES)
        return;
    struct device_fault *line = &schedule->lines[schedule->n_lines++];
    va_list args;
    va_start(args, format);
    line->section = section;
    g_vsnprintf(line->line, sizeof line->line, format, args);
    va_end(args);
}

/* A command whose answer is lost, and a line that is dead after it. */
static void draw_line(GRand *random, struct bus_schedule *schedule) {
    static const char *const sections[] = {"[laser laser30]", "[laser laser60]", "[lamps bank]",
                                           "[axis turntable]", "[axis sweep60]"};
    const char *section = sections[g_rand_int_range(random, 0, G_N_ELEMENTS(sections))];
    const int at = g_rand_int_range(random, 1, 7);
    const double dead_s = g_rand_int_range(random, 0, 4) ? draw_log(random, 0.05, 8) : 0;
    const double latency_s = g_rand_int_range(random, 0, 3) ? 0.005 : draw_log(random, 0.001, 1.5);
    add_line(schedule, section, "fault_unheard = %d", at);
    add_line(schedule, section, "fault_dead_s = %.3f", dead_s);
    add_line(schedule, section, "latency_ms = %.1f", latency_s * 1e3);
    schedule->dead_s = MAX(schedule->dead_s, dead_s);
    schedule->latency_s = MAX(schedule->latency_s, latency_s);
}

static enum bus_method draw_method(GRand *random, gboolean sessions) {
    int weights = 0;
    gsize i = 0;
    for (gsize k = 0; k < BUS_METHODS; k++)
        weights += method_weights[k];
    for (int drawn = g_rand_int_range(random, 0, weights); drawn >= method_weights[i]; i++)
        drawn -= method_weights[i];
    if (!sessions && (i == BUS_START || i == BUS_RESUME))
        return BUS_SET_LASER;
    return (enum bus_method)i;
}

static enum bus_action draw_action(GRand *random) {
    const int drawn = g_rand_int_range(random, 0, 20);
    return drawn < 13    ? STEP_CALL
           : drawn < 15  ? STEP_CLOSE
           : drawn == 15 ? STEP_DEAF
           : drawn == 16 ? STEP_HEARS
           : drawn == 17 ? STEP_FLOOD
                         : STEP_FLASH;
}

static double draw_lease_s(GRand *random) {
    static const double odd[] = {0, -1, 60, 60.001, NAN, INFINITY, 1e-9};
    if (g_rand_int_range(random, 0, 12) == 0)
        return odd[g_rand_int_range(random, 0, G_N_ELEMENTS(odd))];
    return draw_log(random, 0.05, 30);
}

static void draw_step(GRand *random, gboolean sessions, struct bus_step *step) {
    /* Each number is drawn for every step, so that what one step does with them shifts no other. */
    const gboolean at_once = g_rand_int_range(random, 0, 5) < 3;
    const double gap_s = draw_log(random, 0.001, LONGEST_GAP_S);
    const int turns = g_rand_int_range(random, -2, 4);
    const gboolean long_exposure = g_rand_int_range(random, 0, 4) == 0;
    step->after_us = at_once ? 0 : (gint64)(gap_s * 1e6);
    step->turns = MAX(turns, 0);
    step->action = draw_action(random);
    step->flash = (enum bus_flash)g_rand_int_range(random, 0, FLASHES);
    step->client = g_rand_int_range(random, 0, BUS_CLIENTS);
    step->n = g_rand_int_range(random, 2, 60);
    step->method = draw_method(random, sessions);
    if (step->action == STEP_FLASH && step->method > BUS_HOME_AXIS)
        step->method = BUS_SET_LASER;
    step->device = g_rand_int_range(random, 0, 4);
    step->on = g_rand_int_range(random, 0, 4) > 0;
    step->for_s = draw_lease_s(random);
    step->deg = g_rand_double_range(random, -14, 14);
    step->exposure_us = long_exposure ? 2000000 : 4000;
    if (step->method != BUS_MOVE_AXIS && step->method != BUS_HOME_AXIS)
        step->device %= 2;
}

void bus_schedule_make(struct bus_schedule *schedule, guint32 seed) {
    const guint32 words[] = {seed, 0x6275736c}; /* another sequence than schedule_make()'s */
    g_autoptr(GRand) random = g_rand_new_with_seed_array(words, G_N_ELEMENTS(words));
    *schedule = (struct bus_schedule){.seed = seed, .latency_s = 0.005};
    const int n_lines = g_rand_int_range(random, 0, 3);
    const gboolean sessions = g_rand_int_range(random, 0, 5) == 0;
    schedule->n_steps = g_rand_int_range(random, 6, BUS_MAX_STEPS + 1);
    schedule->check_us = (gint64)(draw_log(random, 0.02, 1) * 1e6);
    for (int i = 0; i < n_lines; i++)
        draw_line(random, schedule);
    if (g_rand_int_range(random, 0, 8) == 0) {
        add_line(schedule, "[interlock door]", "open_after_s = %d",
                 g_rand_int_range(random, 1, 30));
        add_line(schedule, "[interlock door]", "open_for_s = %d", g_rand_int_range(random, 1, 8));
    }
    for (int i = 0; i < schedule->n_steps; i++)
        draw_step(random, sessions, &schedule->steps[i]);
}

static void describe_call(GString *to, const struct bus_step *step) {
    g_string_append_printf(to, "%s %s", method_names[step->method],
                           bus_schedule_device(step->method, step->device));
    if (step->method == BUS_SET_LASER || step->method == BUS_SET_LAMP)
        g_string_append_printf(to, " %s for %g s", step->on ? "on" : "off", step->for_s);
    else if (step->method == BUS_MOVE_AXIS)
        g_string_append_printf(to, " to %.3f", step->deg);
}

static void describe_step(GString *to, const struct bus_step *step) {
    static const char *const flashes[] = {
        [FLASH_CLOSED_FIRST] = "ends, which the daemon hears first",
        [FLASH_CLOSED] = "ends before the rig is shown on it",
        [FLASH_SHOWN] = "ends before the call is handled",
        [FLASH_LOOPS] = "ends",
    };
    if (step->after_us > 0)
        g_string_append_printf(to, "  %.3f s later:", (double)step->after_us * 1e-6);
    else
        g_string_append_printf(to, "  after %d turns:", step->turns);
    switch (step->action) {
    case STEP_CLOSE:
        g_string_append_printf(to, " client %d goes\n", step->client);
        return;
    case STEP_DEAF:
        g_string_append_printf(to, " client %d stops reading\n", step->client);
        return;
    case STEP_HEARS:
        g_string_append_printf(to, " client %d reads again\n", step->client);
        return;
    case STEP_FLASH:
        g_string_append_printf(to, " a fresh connection %s: ", flashes[step->flash]);
        break;
    case STEP_FLOOD:
        g_string_append_printf(to, " client %d, %d times: ", step->client, step->n);
        break;
    default:
        g_string_append_printf(to, " client %d: ", step->client);
    }
    describe_call(to, step);
    g_string_append_c(to, '\n');
}

char *bus_schedule_describe(const struct bus_schedule *schedule) {
    GString *to = g_string_new(NULL);
    for (int i = 0; i < schedule->n_lines; i++)
        g_string_append_printf(to, "  rig: %s %s\n", schedule->lines[i].section,
                               schedule->lines[i].line);
    for (int i = 0; i < schedule->n_steps; i++)
        describe_step(to, &schedule->steps[i]);
    return g_string_free(to, FALSE);
}
