/* The table of all checks, and the checks that all classes share. */
#include "checks.h"

#include "program/message.h"

#include <string.h>

#define SILENCE_MARGIN_MS 2000 /* time after silence_ms in which a program may still end */

#define SEE_TABLE  "see the table of requests in docs/build-a-rig/programs.md"
#define ONLY_LINES "print nothing else on standard output, and use standard error for messages"

static const char *const classes[] = {"lamps", "axis", "camera", NULL};

gboolean checks_make_unsafe(struct bench *bench) {
    return g_str_equal(bench->class_name, "lamps")  ? check_lamps_make_unsafe(bench)
           : g_str_equal(bench->class_name, "axis") ? check_axis_make_unsafe(bench)
                                                    : bench_ready(bench);
}

gboolean checks_find_safe(struct bench *bench, const char *after) {
    return bench_open(bench) &&
           (g_str_equal(bench->class_name, "lamps")  ? check_lamps_expect_off(bench, after)
            : g_str_equal(bench->class_name, "axis") ? check_axis_expect_still(bench, after)
                                                     : TRUE);
}

static gboolean is_text(JsonNode *node) {
    return node && JSON_NODE_HOLDS_VALUE(node) && json_node_get_value_type(node) == G_TYPE_STRING;
}

static gboolean is_texts(JsonNode *node) {
    JsonArray *array = JSON_NODE_HOLDS_ARRAY(node) ? json_node_get_array(node) : NULL;
    for (guint i = 0; array && i < json_array_get_length(array); i++)
        if (!is_text(json_array_get_element(array, i)))
            return FALSE;
    return array != NULL;
}

static gboolean check_hello(struct bench *bench) {
    static const char *const texts[] = {"device", "serial"};
    g_autoptr(GError) error = NULL;
    gint64 version;
    if (!bench_hello(bench))
        return FALSE;
    if (!message_integer(bench->hello, "version", 1, MESSAGE_VERSION, &version, &error))
        return bench_fail(bench, SEE_TABLE, "“version”: 1", "the program %s", error->message);
    g_autofree char *class_name = message_text(bench->hello, "class");
    if (!g_str_equal(class_name, bench->class_name)) {
        g_autofree char *expected = g_strdup_printf("“class”: “%s”", bench->class_name);
        return bench_fail(bench, SEE_TABLE, expected, "“%s”", class_name);
    }
    for (gsize i = 0; i < G_N_ELEMENTS(texts); i++)
        if (json_object_has_member(bench->hello, texts[i]) &&
            !is_text(json_object_get_member(bench->hello, texts[i])))
            return bench_fail(bench, SEE_TABLE, "texts as “device” and “serial”",
                              "“%s” is not a text", texts[i]);
    return !json_object_has_member(bench->hello, "capabilities") ||
           is_texts(json_object_get_member(bench->hello, "capabilities")) ||
           bench_fail(bench, SEE_TABLE, "an array of texts as “capabilities”", "something else");
}

static gboolean check_ping(struct bench *bench) {
    return bench_ready(bench) && bench_do(bench, "ping", NULL) && bench_do(bench, "ping", NULL);
}

static gboolean check_left_alone(struct bench *bench) {
    if (!bench_ready(bench))
        return FALSE;
    bench_end(bench);
    return checks_find_safe(bench, "“open”");
}

static JsonObject *odd_params(void) {
    return bench_params("colour", json_node_init_string(json_node_alloc(), "blue"));
}

static gboolean check_further_parameter(struct bench *bench) {
    return bench_ready(bench) && bench_do(bench, "ping", odd_params()) &&
           (g_str_equal(bench->class_name, "camera") || bench_do(bench, "get", odd_params()));
}

static gboolean check_together(struct bench *bench) {
    guint64 first_id, second_id;
    if (!bench_ready(bench))
        return FALSE;
    g_autofree char *first = bench_line(bench, "ping", NULL, &first_id);
    g_autofree char *second = bench_line(bench, "ping", NULL, &second_id);
    g_autofree char *both = g_strconcat(first, second, NULL);
    bench_write(bench, both);
    return bench_await(bench, first_id, "the first of two “ping”", PROGRAM_ANSWER_MS, NULL) &&
           bench_await(bench, second_id, "the second of two “ping”", PROGRAM_ANSWER_MS, NULL);
}

/* Waits for the answer to a wrong request. The answer must be an error, and the program must then
 * answer “ping”. */
static gboolean expect_error(struct bench *bench, guint64 id, const char *what,
                             const char *advice) {
    const struct bench_answer *answer = bench_await_any(bench, id, what, PROGRAM_ANSWER_MS);
    g_autofree char *expected = g_strdup_printf("an error as the answer to %s", what);
    if (!answer && bench->verdict.advice && !bench->ended)
        bench->verdict.advice = advice;
    if (!answer)
        return FALSE;
    if (!answer->failure)
        return bench_fail(bench, advice, expected, "a result");
    return bench_do(bench, "ping", NULL);
}

static gboolean check_unknown_method(struct bench *bench) {
    guint64 id;
    if (!bench_ready(bench))
        return FALSE;
    g_autofree char *line = bench_line(bench, "dance", NULL, &id);
    bench_write(bench, line);
    return expect_error(bench, id, "the method “dance”",
                        "answer a method that you do not know by an error");
}

static gboolean check_malformed(struct bench *bench) {
    if (!bench_ready(bench))
        return FALSE;
    bench_write(bench, "{\"jsonrpc\":\"2.0\",\"id\":\n");
    return expect_error(bench, 0, "a line that is not JSON",
                        "answer a line that is not JSON by an error with \"id\":null");
}

static gboolean check_close(struct bench *bench) {
    if (!checks_make_unsafe(bench) || !bench_do(bench, "close", NULL))
        return FALSE;
    return bench_await_end(bench, BENCH_ENDS_MS)
               ? checks_find_safe(bench, "“close”")
               : bench_fail(bench, "exit after the answer to “close”",
                            "the program ends within 1000 ms after its answer to “close”",
                            "it still runs");
}

static gboolean check_end_of_input(struct bench *bench) {
    if (!checks_make_unsafe(bench))
        return FALSE;
    bench_close_input(bench);
    return bench_await_end(bench, BENCH_ENDS_MS)
               ? checks_find_safe(bench, "the end of standard input")
               : bench_fail(bench, "exit when reading standard input gives its end",
                            "the program ends within 1000 ms after the end of standard input",
                            "it still runs");
}

static gboolean check_restart(struct bench *bench) {
    if (!checks_make_unsafe(bench))
        return FALSE;
    bench_kill(bench);
    return g_str_equal(bench->class_name, "lamps") ? check_lamps_get(bench) : check_ping(bench);
}

/* An axis is not made unsafe here, because its move would end long before silence_ms have
 * passed. */
static gboolean check_silence(struct bench *bench) {
    if (!bench_ready(bench))
        return FALSE;
    if (!bench_can(bench, "silence"))
        return bench_skip(bench, "the answer to “hello” has no capability “silence”");
    if (!g_str_equal(bench->class_name, "axis") && !checks_make_unsafe(bench))
        return FALSE;
    if (bench_await_end(bench, PROGRAM_SILENCE_MS / 2))
        return bench_fail(bench, "wait silence_ms after the last answer",
                          "the program runs during the first half of silence_ms (10000)", "it %s",
                          bench->ended);
    return bench_await_end(bench, PROGRAM_SILENCE_MS / 2 + SILENCE_MARGIN_MS)
               ? checks_find_safe(bench, "silence_ms without a request")
               : bench_fail(bench, "exit if no request comes, or do not name the capability",
                            "the program ends after silence_ms (10000) without a request",
                            "it still runs after 12000 ms");
}

/* Uses the device, because the user may have chosen only this check. If the device cannot be used,
 * the present check is skipped, because another check reports the failure. */
static gboolean use_device(struct bench *bench) {
    if (g_str_equal(bench->class_name, "camera") ? check_camera_trigger(bench)
                                                 : checks_make_unsafe(bench))
        return TRUE;
    g_autofree char *came = g_strdup(bench->verdict.came);
    bench_clear_verdict(bench);
    return bench_skip(bench, "the device could not be used: %s", came);
}

static gboolean check_events(struct bench *bench) {
    const gboolean used = use_device(bench);
    if (bench->strange_event) {
        bench_clear_verdict(bench);
        return bench_fail(bench,
                          "see the table of events in docs/build-a-rig/programs.md, and see to the "
                          "device if it has reported a fault",
                          "“lost” only if something has happened to the device, and “exposed” only "
                          "at the end of an exposure",
                          "%s", bench->strange_event);
    }
    return used && (bench->n_events > 0 || bench_skip(bench, "the program has sent no event"));
}

static gboolean check_output(struct bench *bench) {
    const gboolean used = use_device(bench);
    if (!bench->strange_line)
        return used;
    bench_clear_verdict(bench);
    return bench_fail(bench, ONLY_LINES,
                      "only answers and events on standard output, each as a line of JSON-RPC 2.0",
                      "%s", bench->strange_line);
}

/* One row per line, in the order in which the checks are run. */
// clang-format off
static const struct check checks[] = {
    {"hello", NULL, NULL, "“hello” is answered with version and class", check_hello},
    {"open", NULL, "hello", "“open” is answered with all its values", bench_open},
    {"ping", NULL, "open", "“ping” is answered", check_ping},
    {"two-lines", NULL, "ping", "two requests that arrive together are both answered", check_together},
    {"further-parameter", NULL, "ping", "a parameter that is not known is ignored", check_further_parameter},
    {"unknown-method", NULL, "ping", "a method that is not known is answered by an error", check_unknown_method},
    {"malformed-line", NULL, "ping", "a line that is not JSON is answered by an error", check_malformed},
    {"get", "lamps", "open", "“get” has a value for each lamp, and all are off after “stop”", check_lamps_get},
    {"left-alone", "lamps", "get", "“open” leaves the lamps as they are", check_left_alone},
    {"set", "lamps", "left-alone", "“set” switches its lamp and no other", check_lamps_set},
    {"stop", "lamps", "set", "“stop” switches all lamps off", check_lamps_stop},
    {"stop-overtakes", "lamps", "stop", "a “set” has no effect after the answer to a “stop” that came after it", check_lamps_stop_overtakes},
    {"get", "axis", "open", "“get” has position and state, and the axis stands after “stop”", check_axis_get},
    {"left-alone", "axis", "get", "“open” leaves the axis as it is", check_left_alone},
    {"home", "axis", "left-alone", "“move” with home ends at the reference", check_axis_home},
    {"move", "axis", "home", "“move” is answered when the motion begins, and ends at its target", check_axis_moves},
    {"same-place", "axis", "move", "a move to where the axis stands ends", check_axis_same_place},
    {"stop", "axis", "move", "“stop” is answered while the axis moves, and brakes it", check_axis_stops},
    {"stop-overtakes", "axis", "stop", "a “stop” that comes together with “move” brakes as well", check_axis_stop_overtakes},
    {"trigger", "camera", "open", "“trigger” is answered with a picture as “open” has described it", check_camera_trigger},
    {"pictures", "camera", "trigger", "three pictures in a row are new, and their numbers grow", check_camera_pictures},
    {"exposures", "camera", "pictures", "a picture takes as long as its exposure", check_camera_exposures},
    {"gain", "camera", "trigger", "the capability “gain”: a picture with 6 dB", check_camera_gain},
    {"stop", "camera", "pictures", "the capability “stop”: a picture is given up, and the next one is taken", check_camera_stop},
    {"close", "lamps", "set", "after “close” the lamps are off and the program ends", check_close},
    {"close", "axis", "move", "after “close” the axis stands and the program ends", check_close},
    {"close", "camera", "open", "after “close” the program ends", check_close},
    {"end-of-input", "lamps", "set", "at the end of standard input the lamps go off and the program ends", check_end_of_input},
    {"end-of-input", "axis", "move", "at the end of standard input the axis stops and the program ends", check_end_of_input},
    {"end-of-input", "camera", "open", "at the end of standard input the program ends", check_end_of_input},
    {"restart", "lamps", "stop", "after a kill the program starts again and finds its device", check_restart},
    {"restart", "axis", "move", "after a kill the program starts again and finds its device", check_restart},
    {"restart", "camera", "open", "after a kill the program starts again and finds its device", check_restart},
    {"silence", "lamps", "set", "the capability “silence”: without requests the lamps go off and the program ends", check_silence},
    {"silence", NULL, "open", "the capability “silence”: without requests the program ends", check_silence},
    {"events", NULL, "open", "events come when they may", check_events},
    {"output", NULL, "open", "standard output has nothing but lines of JSON-RPC 2.0", check_output},
    {NULL},
};
// clang-format on

const struct check *checks_all(void) {
    return checks;
}

gboolean checks_has(const struct check *check, const char *class_name) {
    /* Several rows may have the same name. If a class has a row of its own, the row for all classes
     * does not belong to it. */
    for (const struct check *other = checks; !check->class_name && other->name; other++)
        if (other != check && g_str_equal(other->name, check->name) &&
            g_strcmp0(other->class_name, class_name) == 0)
            return FALSE;
    return !check->class_name || g_str_equal(check->class_name, class_name);
}

const char *checks_find_class(struct bench *bench) {
    const char *found = NULL;
    bench->check = "hello";
    for (const char *const *asked = classes; *asked && !found; asked++) {
        bench->class_name = *asked;
        g_autofree char *class_name =
            bench_hello(bench) ? message_text(bench->hello, "class") : NULL;
        for (const char *const *known = classes; class_name && *known; known++)
            if (g_str_equal(class_name, *known))
                found = *known;
        bench_end(bench);
        bench_clear_verdict(bench);
    }
    return found;
}
