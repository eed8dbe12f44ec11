/* Checks of an axis: “move” is answered when the motion begins, “get” says where the axis is and
 * whether it moves, and “stop” brakes. */
#include "checks.h"

#include "program/message.h"

#include <math.h>

#define MAX_DEG  1e9
#define POLL_MS  100 /* time between two “get” requests, as in the driver */
#define HOMING_S 60  /* time to home, in addition to the time of two moves over the whole range */
#define STOP_S   5 /* time until the axis stands after “stop”, in addition to the time of braking */

struct state {
    double deg;
    gboolean moving, homed;
};

static gboolean get_state(struct bench *bench, struct state *ret) {
    g_autoptr(JsonObject) values = NULL;
    g_autoptr(GError) error = NULL;
    if (!bench_ask(bench, "get", NULL, &values))
        return FALSE;
    return (message_number(values, "deg", -MAX_DEG, MAX_DEG, &ret->deg, &error) &&
            message_boolean(values, "moving", &ret->moving, &error) &&
            message_boolean(values, "homed", &ret->homed, &error)) ||
           bench_fail(bench, "see the table of requests in docs/build-a-rig/programs.md",
                      "“deg”, “moving” and “homed”", "the program %s", error->message);
}

/* Sends “get” every POLL_MS until the axis stands. Fails if the axis still moves after limit_s. */
static gboolean await_still(struct bench *bench, double limit_s, const char *after,
                            struct state *ret) {
    const gint64 deadline_us = g_get_monotonic_time() + (gint64)(limit_s * 1e6);
    while (get_state(bench, ret)) {
        if (!ret->moving)
            return TRUE;
        if (g_get_monotonic_time() > deadline_us) {
            g_autofree char *expected =
                g_strdup_printf("“moving” is false %.1f s after %s", limit_s, after);
            return bench_fail(bench,
                              "answer “moving” with what the axis does, or give its true "
                              "--speed-deg-s and --accel-deg-s2",
                              expected, "it is still true, at %.3f°", ret->deg);
        }
        bench_pass(bench, POLL_MS);
    }
    return FALSE;
}

static double way_deg(const struct bench *bench) {
    return bench->motion.max_deg - bench->motion.min_deg;
}

/* Time in which the axis moves by an angle. */
static double time_s(const struct bench *bench, double deg) {
    return fabs(deg) / bench->motion.speed_deg_s +
           bench->motion.speed_deg_s / bench->motion.accel_deg_s2;
}

static double at(const struct bench *bench, double fraction) {
    return bench->motion.min_deg + fraction * way_deg(bench);
}

static JsonObject *move_params(const struct bench *bench) {
    JsonObject *params = json_object_new();
    json_object_set_double_member(params, "speed_deg_s", bench->motion.speed_deg_s);
    json_object_set_double_member(params, "accel_deg_s2", bench->motion.accel_deg_s2);
    return params;
}

static JsonObject *to_params(const struct bench *bench, double deg) {
    JsonObject *params = move_params(bench);
    json_object_set_double_member(params, "deg", deg);
    return params;
}

/* Opens the program, and waits until the axis stands. */
static gboolean ready(struct bench *bench) {
    struct state state;
    return bench_ready(bench) && await_still(bench, STOP_S + time_s(bench, 0), "“stop”", &state);
}

static gboolean home(struct bench *bench) {
    JsonObject *params = move_params(bench);
    struct state state;
    json_object_set_boolean_member(params, "home", TRUE);
    if (!bench_do(bench, "move", params) ||
        !await_still(bench, HOMING_S + 2 * time_s(bench, way_deg(bench)), "“move” with home",
                     &state))
        return FALSE;
    return state.homed ||
           bench_fail(bench,
                      "keep “moving” true until the axis stands at its reference, and “homed” "
                      "from then on",
                      "“homed” is true when the axis stands after “move” with home",
                      "it is false, at %.3f°", state.deg);
}

/* Opens the program, and homes the axis unless it knows its position. */
static gboolean ready_homed(struct bench *bench) {
    struct state state;
    return ready(bench) && get_state(bench, &state) && (state.homed || home(bench));
}

/* Begins a move. Fails if the axis is then neither moving nor at its target. */
static gboolean begin_move(struct bench *bench, double deg) {
    struct state before, state;
    if (!get_state(bench, &before) || !bench_do(bench, "move", to_params(bench, deg)) ||
        !get_state(bench, &state))
        return FALSE;
    const double left_deg = fabs(state.deg - deg);
    return state.moving || left_deg <= bench->motion.tolerance_deg ||
           bench_fail(bench, "answer “moving” with true from the answer to “move” on",
                      "“moving” is true after the answer to “move”",
                      "it is false, %.3f° before the target", left_deg);
}

static gboolean move(struct bench *bench, double deg) {
    struct state before, state;
    if (!get_state(bench, &before) || !begin_move(bench, deg) ||
        !await_still(bench, 5 + 1.5 * time_s(bench, deg - before.deg), "“move”", &state))
        return FALSE;
    if (!state.homed)
        return bench_fail(bench, "answer “homed” with true as long as the position is known",
                          "“homed” stays true after a move", "it is false");
    if (fabs(state.deg - deg) <= bench->motion.tolerance_deg)
        return TRUE;
    g_autofree char *expected =
        g_strdup_printf("%.3f° ± %g° after “move”", deg, bench->motion.tolerance_deg);
    return bench_fail(bench,
                      "answer “deg” in degrees with the position at the end of the move, or give "
                      "a larger --tolerance-deg",
                      expected, "it stands at %.3f°", state.deg);
}

/* Checks that the axis stands after the program was ended by `after` and started again. The axis
 * may still be braking, so its state is read only after one and a half times the time of
 * braking. */
gboolean check_axis_expect_still(struct bench *bench, const char *after) {
    const double braking_s = bench->motion.speed_deg_s / bench->motion.accel_deg_s2;
    struct state state;
    bench_pass(bench, (int)(1500 * braking_s) + 2 * POLL_MS);
    if (!get_state(bench, &state))
        return FALSE;
    g_autofree char *expected = g_strdup_printf("the axis stands after %s", after);
    return !state.moving ||
           bench_fail(bench, "stop the axis before the program ends, and do not move it in “open”",
                      expected, "“moving” is true, at %.3f°", state.deg);
}

gboolean check_axis_get(struct bench *bench) {
    return ready(bench) && check_axis_expect_still(bench, "“stop”");
}

gboolean check_axis_home(struct bench *bench) {
    return ready(bench) && home(bench) && home(bench);
}

gboolean check_axis_moves(struct bench *bench) {
    static const double fractions[] = {0.25, 0.75, 0.5, 0.51, 0.25};
    if (!ready_homed(bench))
        return FALSE;
    for (gsize i = 0; i < G_N_ELEMENTS(fractions); i++)
        if (!move(bench, at(bench, fractions[i])))
            return FALSE;
    return TRUE;
}

gboolean check_axis_same_place(struct bench *bench) {
    return ready_homed(bench) && move(bench, at(bench, 0.4)) && move(bench, at(bench, 0.4));
}

/* Moves the axis to a quarter of the range that the checks may use, and begins to move it to three
 * quarters. */
gboolean check_axis_make_unsafe(struct bench *bench) {
    return ready_homed(bench) && move(bench, at(bench, 0.25)) && begin_move(bench, at(bench, 0.75));
}

/* Checks that an axis comes to a stand after “stop”, before the target of its move, and stays
 * there. */
static gboolean expect_stopped(struct bench *bench) {
    struct state state, later;
    if (!await_still(bench, STOP_S + time_s(bench, 0), "“stop”", &state))
        return FALSE;
    bench_pass(bench, 5 * POLL_MS);
    if (!get_state(bench, &later))
        return FALSE;
    if (later.moving || fabs(later.deg - state.deg) > bench->motion.tolerance_deg)
        return bench_fail(bench, "answer “moving” with true until the axis stands",
                          "the axis remains where it stood after “stop”",
                          "it stood at %.3f°, and half a second later it is at %.3f°", state.deg,
                          later.deg);
    return fabs(state.deg - at(bench, 0.75)) > bench->motion.tolerance_deg ||
           bench_fail(bench, "brake in “stop” instead of ending the move",
                      "the axis stops before the target of its move",
                      "it stands at the target, %.3f°", state.deg);
}

gboolean check_axis_stops(struct bench *bench) {
    const double half_s = time_s(bench, way_deg(bench) / 2) / 2;
    if (!check_axis_make_unsafe(bench))
        return FALSE;
    bench_pass(bench, (int)(1000 * MIN(half_s / 2, 2)));
    return bench_do(bench, "stop", NULL) && expect_stopped(bench) &&
           bench_do(bench, "stop", NULL) && move(bench, at(bench, 0.5));
}

/* Checks a “stop” that the program gets together with the “move” before it. */
gboolean check_axis_stop_overtakes(struct bench *bench) {
    guint64 id, stop;
    if (!ready_homed(bench) || !move(bench, at(bench, 0.25)))
        return FALSE;
    g_autofree char *first = bench_line(bench, "move", to_params(bench, at(bench, 0.75)), &id);
    g_autofree char *second = bench_line(bench, "stop", NULL, &stop);
    g_autofree char *both = g_strconcat(first, second, NULL);
    bench_write(bench, both);
    return bench_await(bench, stop, "“stop”", PROGRAM_ANSWER_MS, NULL) &&
           bench_await_any(bench, id, "“move”", PROGRAM_ANSWER_MS) && expect_stopped(bench);
}
