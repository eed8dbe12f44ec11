/* Checks of lamps: “get” says what is lit, “set” switches one lamp, and “stop” switches all lamps
 * off. */
#include "checks.h"

#include "program/message.h"

#include <string.h>

/* Maximum number of lamps that are switched. If there are more lamps, these are spread evenly over
 * all. */
#define MOST_LAMPS 16

#define READ_BACK "check the wiring, and answer “get” with what is read from the device"

/* Asks which lamps are on. */
static gboolean get_lamps(struct bench *bench, gboolean *ret_on) {
    g_autoptr(JsonObject) values = NULL;
    g_autoptr(GError) error = NULL;
    if (!bench_ask(bench, "get", NULL, &values))
        return FALSE;
    return message_booleans(values, "on", bench->n_lamps, ret_on, &error) ||
           bench_fail(bench, "answer with as many values as “open” has said",
                      "“on”: true or false for each lamp", "the program %s", error->message);
}

static JsonObject *switch_params(int lamp, gboolean on) {
    JsonObject *params = json_object_new();
    json_object_set_int_member(params, "index", lamp);
    json_object_set_boolean_member(params, "on", on);
    return params;
}

/* Checks that exactly the lamps that are TRUE in `wanted` are on. */
static gboolean expect_lamps(struct bench *bench, const gboolean *wanted, const char *after,
                             const char *advice) {
    g_autofree gboolean *on = g_new0(gboolean, bench->n_lamps);
    if (!get_lamps(bench, on))
        return FALSE;
    for (int i = 0; i < bench->n_lamps; i++) {
        if (on[i] == wanted[i])
            continue;
        g_autofree char *expected =
            g_strdup_printf("lamp %d is %s after %s", i, wanted[i] ? "on" : "off", after);
        return bench_fail(bench, advice, expected, "“get” says that it is %s",
                          on[i] ? "on" : "off");
    }
    return TRUE;
}

static gboolean expect_off(struct bench *bench, const char *after, const char *advice) {
    g_autofree gboolean *none = g_new0(gboolean, bench->n_lamps);
    return expect_lamps(bench, none, after, advice);
}

gboolean check_lamps_expect_off(struct bench *bench, const char *after) {
    return expect_off(bench, after,
                      "switch all lamps off before the program ends, and switch none in “open”");
}

gboolean check_lamps_get(struct bench *bench) {
    return bench_ready(bench) && expect_off(bench, "“stop”", READ_BACK);
}

/* Returns the index of the n-th of the lamps that are switched, counted from 0. Returns −1 if fewer
 * lamps are switched. */
static int chosen(const struct bench *bench, int n) {
    const int n_chosen = MIN(bench->n_lamps, MOST_LAMPS);
    return n >= n_chosen ? -1 : n == 0 ? 0 : n * (bench->n_lamps - 1) / (n_chosen - 1);
}

/* Sends the same “set” twice. The second one must have no effect, because the lamp is then already
 * in the wanted state. */
static gboolean switch_twice(struct bench *bench, int lamp, gboolean on, gboolean *wanted) {
    g_autofree char *after =
        g_strdup_printf("“set” with index %d and on %s", lamp, on ? "true" : "false");
    wanted[lamp] = on;
    for (int i = 0; i < 2; i++)
        if (!bench_do(bench, "set", switch_params(lamp, on)) ||
            !expect_lamps(bench, wanted, after, READ_BACK))
            return FALSE;
    return TRUE;
}

/* Switches the lamps on one after the other. Each time, the lamp before is still on, and is then
 * switched off. */
gboolean check_lamps_set(struct bench *bench) {
    if (!bench_ready(bench))
        return FALSE;
    g_autofree gboolean *wanted = g_new0(gboolean, bench->n_lamps);
    int before = -1, lamp;
    for (int n = 0; (lamp = chosen(bench, n)) >= 0; before = lamp, n++)
        if (!switch_twice(bench, lamp, TRUE, wanted) ||
            (before >= 0 && !switch_twice(bench, before, FALSE, wanted)))
            return FALSE;
    return switch_twice(bench, before, FALSE, wanted);
}

static gboolean light_all(struct bench *bench) {
    int lamp;
    for (int n = 0; (lamp = chosen(bench, n)) >= 0; n++)
        if (!bench_do(bench, "set", switch_params(lamp, TRUE)))
            return FALSE;
    return TRUE;
}

gboolean check_lamps_make_unsafe(struct bench *bench) {
    return bench_ready(bench) && light_all(bench);
}

gboolean check_lamps_stop(struct bench *bench) {
    return check_lamps_make_unsafe(bench) && bench_do(bench, "stop", NULL) &&
           expect_off(bench, "“stop”", READ_BACK) && bench_do(bench, "stop", NULL) &&
           expect_off(bench, "the second “stop”", READ_BACK);
}

/* Checks a “stop” that the program gets together with the “set” before it. */
gboolean check_lamps_stop_overtakes(struct bench *bench) {
    guint64 set, stop;
    if (!bench_ready(bench))
        return FALSE;
    g_autofree char *first = bench_line(bench, "set", switch_params(0, TRUE), &set);
    g_autofree char *second = bench_line(bench, "stop", NULL, &stop);
    g_autofree char *both = g_strconcat(first, second, NULL);
    bench_write(bench, both);
    return bench_await(bench, stop, "“stop”", PROGRAM_ANSWER_MS, NULL) &&
           expect_off(bench, "a “stop” that came after “set”", READ_BACK) &&
           bench_await_any(bench, set, "“set”", PROGRAM_ANSWER_MS) &&
           expect_off(bench, "the answer to the “set” that “stop” has overtaken", READ_BACK);
}
