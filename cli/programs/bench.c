#include "bench.h"

#include "program/message.h"

#include <errno.h>
#include <glib/gstdio.h>
#include <poll.h>
#include <string.h>
#include <unistd.h>

#define READ_SIZE 16384
/* First id of a request. It is not 1, so that a program fails that counts by itself instead of
 * repeating the id of the request. */
#define FIRST_ID 7001
#define ID_STEP  3

static void answer_free(gpointer data) {
    struct bench_answer *answer = data;
    g_free(answer->failure);
    g_clear_pointer(&answer->values, json_object_unref);
    g_free(answer);
}

gboolean bench_init(struct bench *bench, const struct program_command *command, GError **error) {
    *bench = (struct bench){.command = command,
                            .process = {.in = -1, .out = -1, .socket = -1},
                            .line = g_byte_array_new(),
                            .answers = g_ptr_array_new_with_free_func(answer_free),
                            .last_id = FIRST_ID};
    bench->folder = g_dir_make_tmp("mesorig-conformance-XXXXXX", error);
    return bench->folder != NULL;
}

void bench_clear_verdict(struct bench *bench) {
    g_clear_pointer(&bench->verdict.expected, g_free);
    g_clear_pointer(&bench->verdict.came, g_free);
    g_clear_pointer(&bench->verdict.skipped, g_free);
    bench->verdict.advice = NULL;
}

/* Forgets the program that has ended. */
static void forget(struct bench *bench) {
    g_clear_pointer(&bench->ended, g_free);
    g_clear_pointer(&bench->hello, json_object_unref);
    g_clear_pointer(&bench->opened, json_object_unref);
    g_clear_pointer(&bench->exposures_us, g_free);
    g_byte_array_set_size(bench->line, 0);
    g_ptr_array_set_size(bench->answers, 0);
    bench->exposure_us = 0;
    bench->picture_id = -1;
}

static void empty_folder(const struct bench *bench) {
    g_autoptr(GDir) dir = g_dir_open(bench->folder, 0, NULL);
    for (const char *name; dir && (name = g_dir_read_name(dir));) {
        g_autofree char *path = g_build_filename(bench->folder, name, NULL);
        g_remove(path);
    }
}

void bench_clear(struct bench *bench) {
    bench_end(bench);
    forget(bench);
    bench_clear_verdict(bench);
    g_clear_pointer(&bench->line, g_byte_array_unref);
    g_clear_pointer(&bench->answers, g_ptr_array_unref);
    g_clear_pointer(&bench->strange_line, g_free);
    g_clear_pointer(&bench->strange_event, g_free);
    if (bench->folder) {
        empty_folder(bench);
        g_rmdir(bench->folder);
    }
    g_clear_pointer(&bench->folder, g_free);
}

gboolean bench_fail(struct bench *bench, const char *advice, const char *expected,
                    const char *came_format, ...) {
    va_list arguments;
    if (bench->verdict.came)
        return FALSE; /* the first reason counts */
    va_start(arguments, came_format);
    bench->verdict.came = g_strdup_vprintf(came_format, arguments);
    va_end(arguments);
    bench->verdict.expected = g_strdup(expected);
    bench->verdict.advice = advice;
    return FALSE;
}

gboolean bench_skip(struct bench *bench, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    bench->verdict.skipped = g_strdup_vprintf(format, arguments);
    va_end(arguments);
    return FALSE;
}

/* Notes a line that no program may send. */
static void note_line(struct bench *bench, const char *what) {
    if (!bench->strange_line)
        bench->strange_line = g_strdup_printf("in the check “%s” it %s", bench->check, what);
}

static void note_event(struct bench *bench, const char *format, ...) G_GNUC_PRINTF(2, 3);

static void note_event(struct bench *bench, const char *format, ...) {
    va_list arguments;
    if (bench->strange_event)
        return;
    va_start(arguments, format);
    g_autofree char *text = g_strdup_vprintf(format, arguments);
    va_end(arguments);
    bench->strange_event = g_strdup_printf("in the check “%s” %s", bench->check, text);
}

static void take_event(struct bench *bench, const struct message *message) {
    const gboolean lost = g_str_equal(message->event, "lost");
    const gint64 early_us = bench->written_us + bench->exposure_us - g_get_monotonic_time();
    bench->n_events += lost || g_str_equal(message->event, "exposed");
    if (lost) {
        g_autofree char *text = message_text(message->values, "message");
        note_event(bench, "came “lost”: %s", *text ? text : "without a message");
    } else if (g_str_equal(message->event, "exposed") && bench->exposure_us == 0)
        note_event(bench, "“exposed” came while no trigger ran");
    else if (g_str_equal(message->event, "exposed") && early_us > 0)
        note_event(bench, "“exposed” came %.1f ms before the exposure of %.1f ms can have ended",
                   (double)early_us / 1000, (double)bench->exposure_us / 1000);
}

static void take_line(struct bench *bench, const char *line, gsize length) {
    struct message message = {0};
    g_autoptr(GError) error = NULL;
    if (!message_read(line, length, &message, &error)) {
        note_line(bench, error->message);
        return;
    }
    if (!message.is_2_0)
        note_line(bench, "sent a message without \"jsonrpc\":\"2.0\"");
    if (message.event)
        take_event(bench, &message);
    else {
        struct bench_answer *answer = g_new0(struct bench_answer, 1);
        for (guint i = 0; message.id && i < bench->answers->len; i++)
            if (((const struct bench_answer *)bench->answers->pdata[i])->id == message.id)
                note_line(bench, "answered the same request twice");
        if (message.id && message.id == bench->trigger_id)
            bench->exposure_us = 0; /* no “exposed” may come after it */
        if (message.id > bench->last_id || (message.id && message.id < FIRST_ID))
            note_line(bench, "answered an id that no request has");
        answer->id = message.id;
        answer->failure = g_strdup(message.failure);
        answer->values = message.values ? json_object_ref(message.values) : NULL;
        answer->at_us = g_get_monotonic_time();
        g_ptr_array_add(bench->answers, answer);
    }
    message_clear(&message);
}

static void take_lines(struct bench *bench) {
    GByteArray *bytes = bench->line;
    const char *end;
    while (bytes->len > 0 && (end = memchr(bytes->data, '\n', bytes->len))) {
        const gsize length = (gsize)(end - (const char *)bytes->data);
        g_autofree char *line = g_strndup((const char *)bytes->data, length);
        g_byte_array_remove_range(bytes, 0, (guint)length + 1);
        take_line(bench, line, length);
    }
    if (bytes->len > MESSAGE_MAX) {
        take_line(bench, (const char *)bytes->data, bytes->len);
        g_byte_array_set_size(bytes, 0);
    }
}

/* Reads what the program has written. Returns FALSE if it has closed its output. */
static gboolean read_output(struct bench *bench) {
    guint8 bytes[READ_SIZE];
    const gssize n = read(bench->process.out, bytes, sizeof bytes);
    if (n < 0)
        return errno == EAGAIN || errno == EINTR;
    g_byte_array_append(bench->line, bytes, (guint)n);
    take_lines(bench);
    return n > 0;
}

/* Waits for output or for the end of the program, until the deadline. */
static void step(struct bench *bench, gint64 deadline_us) {
    struct pollfd ready[] = {{bench->process.out, POLLIN, 0}, {bench->process.socket, POLLIN, 0}};
    const gint64 left_us = deadline_us - g_get_monotonic_time();
    if (left_us <= 0 || poll(ready, 2, (int)(left_us / 1000) + 1) <= 0)
        return;
    if (ready[0].revents && !read_output(bench)) {
        close(bench->process.out);
        bench->process.out = -1;
    } else if (!ready[0].revents && ready[1].revents) {
        g_autofree char *how = program_process_reap(&bench->process);
        bench->ended = g_strdup(how ? how : "has ended");
    }
}

void bench_pass(struct bench *bench, int wait_ms) {
    const gint64 deadline_us = g_get_monotonic_time() + wait_ms * (gint64)1000;
    while (!bench->ended && bench->process.pid && g_get_monotonic_time() < deadline_us)
        step(bench, deadline_us);
}

gboolean bench_await_end(struct bench *bench, int wait_ms) {
    bench_pass(bench, wait_ms);
    return !bench->process.pid;
}

void bench_close_input(struct bench *bench) {
    if (bench->process.in >= 0)
        close(bench->process.in);
    bench->process.in = -1;
}

void bench_kill(struct bench *bench) {
    program_process_kill(&bench->process);
    bench_await_end(bench, BENCH_ENDS_MS);
}

void bench_end(struct bench *bench) {
    bench_close_input(bench);
    if (!bench_await_end(bench, BENCH_ENDS_MS))
        bench_kill(bench);
    program_process_close_pipes(&bench->process);
    /* The runner is the process that has started the program. It ends when its socket is closed. If
     * the kernel does not let the program die, the runner stays behind. */
    if (bench->process.socket >= 0)
        close(bench->process.socket);
    bench->process = (struct program_process){.in = -1, .out = -1, .socket = -1};
}

void bench_write(struct bench *bench, const char *text) {
    const gsize length = strlen(text);
    bench->written_us = g_get_monotonic_time();
    if (bench->process.in >= 0 && write(bench->process.in, text, length) != (gssize)length)
        bench_close_input(bench); /* the answer is then missing */
}

static int deadline_ms(const struct bench *bench, const char *method) {
    const gboolean starts = g_str_equal(method, "hello") || g_str_equal(method, "open");
    if (g_str_equal(method, "trigger"))
        return (int)(program_camera_wait_us(&bench->format, bench->exposure_us) / 1000);
    return starts ? (int)(bench->command->start_s * 1000) : PROGRAM_ANSWER_MS;
}

char *bench_line(struct bench *bench, const char *method, JsonObject *params, guint64 *ret_id) {
    bench->last_id += ID_STEP;
    if (ret_id)
        *ret_id = bench->last_id;
    return message_write(bench->last_id, method, deadline_ms(bench, method), params);
}

static struct bench_answer *find_answer(const struct bench *bench, guint64 id) {
    for (guint i = 0; i < bench->answers->len; i++) {
        struct bench_answer *answer = bench->answers->pdata[i];
        if (answer->id == id && !answer->taken)
            return answer;
    }
    return NULL;
}

const struct bench_answer *bench_await_any(struct bench *bench, guint64 id, const char *method,
                                           int wait_ms) {
    const gint64 deadline_us = g_get_monotonic_time() + wait_ms * (gint64)1000;
    struct bench_answer *answer;
    while (!(answer = find_answer(bench, id)) && !bench->ended && bench->process.pid &&
           g_get_monotonic_time() < deadline_us)
        step(bench, deadline_us);
    if (answer) {
        answer->taken = TRUE;
        return answer;
    }
    g_autofree char *expected = g_strdup_printf("an answer to %s within %d ms", method, wait_ms);
    if (bench->ended)
        bench_fail(bench,
                   "see what the program has printed. It is started in the folder /, so give it "
                   "whole paths",
                   expected, "the program %s", bench->ended);
    else
        bench_fail(bench,
                   "answer with the id of the request, write the end of the line, and flush "
                   "standard output",
                   expected, "no answer with its id");
    return NULL;
}

gboolean bench_await(struct bench *bench, guint64 id, const char *method, int wait_ms,
                     JsonObject **ret_values) {
    const struct bench_answer *answer = bench_await_any(bench, id, method, wait_ms);
    if (!answer)
        return FALSE;
    if (answer->failure) {
        g_autofree char *expected = g_strdup_printf("a result of %s", method);
        return bench_fail(bench, "see the table of requests in docs/build-a-rig/programs.md",
                          expected, "the error “%s”", answer->failure);
    }
    if (ret_values)
        *ret_values = json_object_ref(answer->values);
    return TRUE;
}

gboolean bench_ask(struct bench *bench, const char *method, JsonObject *params,
                   JsonObject **ret_values) {
    guint64 id;
    const int wait_ms = deadline_ms(bench, method);
    g_autofree char *line = bench_line(bench, method, params, &id);
    g_autofree char *quoted = g_strdup_printf("“%s”", method);
    bench_write(bench, line);
    return bench_await(bench, id, quoted, wait_ms, ret_values);
}

gboolean bench_do(struct bench *bench, const char *method, JsonObject *params) {
    return bench_ask(bench, method, params, NULL);
}

static gboolean start(struct bench *bench) {
    g_autoptr(GError) error = NULL;
    bench_end(bench);
    forget(bench);
    empty_folder(bench);
    return program_process_start(bench->command, &bench->process, &error) ||
           bench_fail(bench, "give the path of a program, and make it executable",
                      "the program starts", "%s", error->message);
}

gboolean bench_hello(struct bench *bench) {
    JsonObject *params = json_object_new();
    json_object_set_int_member(params, "version", MESSAGE_VERSION);
    json_object_set_string_member(params, "class", bench->class_name);
    json_object_set_string_member(params, "name", "test");
    json_object_set_int_member(params, "silence_ms", PROGRAM_SILENCE_MS);
    json_object_set_string_member(params, "folder", bench->folder);
    if (start(bench))
        return bench_ask(bench, "hello", params, &bench->hello);
    json_object_unref(params);
    return FALSE;
}

/* Reads the answer to "open". */
static gboolean read_opened(struct bench *bench, GError **error) {
    gint64 n = 0;
    if (g_str_equal(bench->class_name, "lamps") &&
        !message_integer(bench->opened, "lamps", 1, BENCH_MAX_LAMPS, &n, error))
        return FALSE;
    bench->n_lamps = (int)n;
    return !g_str_equal(bench->class_name, "camera") ||
           program_camera_read_format(bench->opened, &bench->format, &bench->exposures_us, error);
}

gboolean bench_open(struct bench *bench) {
    g_autoptr(GError) error = NULL;
    if (!bench_hello(bench) || !bench_ask(bench, "open", NULL, &bench->opened))
        return FALSE;
    return read_opened(bench, &error) ||
           bench_fail(bench, "see the table of requests in docs/build-a-rig/programs.md",
                      "an answer to “open” with all its values", "the program %s", error->message);
}

gboolean bench_ready(struct bench *bench) {
    return bench_open(bench) &&
           (g_str_equal(bench->class_name, "camera") || bench_do(bench, "stop", NULL));
}

gboolean bench_can(const struct bench *bench, const char *what) {
    return bench->hello && message_has(bench->hello, "capabilities", what);
}

JsonObject *bench_params(const char *name, JsonNode *value) {
    JsonObject *params = json_object_new();
    json_object_set_member(params, name, value);
    return params;
}
