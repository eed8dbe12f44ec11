/*
 * A test bench for a program that “mesorig conformance” tests. The bench starts the program, sends
 * requests, and kills the program at the end. Every function that waits has a deadline.
 *
 * A check is a function that returns TRUE if the program behaves as it must. Otherwise the check
 * returns FALSE, after it has called bench_fail() or bench_skip().
 */
#pragma once

#include "program/camera.h"
#include "program/process.h"

#include <json-glib/json-glib.h>

/* time in which the program must end after "close", and after the end of its standard input */
#define BENCH_ENDS_MS   1000
#define BENCH_MAX_LAMPS 1024

/* An axis: the range of angles that the checks may use, the speed and the acceleration, and the
 * largest error of the position after a move. */
struct bench_motion {
    double min_deg, max_deg, speed_deg_s, accel_deg_s2, tolerance_deg;
};

/* The reason why a check has failed, or was skipped. */
struct bench_verdict {
    char *expected, *came; /* NULL unless the check has failed */
    const char *advice;
    char *skipped; /* NULL unless the check was skipped */
};

struct bench {
    const struct program_command *command;
    const char *class_name;
    struct bench_motion motion;
    char *folder; /* temporary folder for the program's pictures */

    struct program_process process;
    char *ended; /* says how the program has ended; NULL while it runs */
    GByteArray *line;
    GPtrArray *answers; /* of struct bench_answer, since the start */
    guint64 last_id;
    /* answers of the program to "hello" and "open"; NULL before the answer */
    JsonObject *hello, *opened;
    gint64 written_us;           /* time of the last request */
    int n_lamps;                 /* from the answer to "open" */
    struct camera_format format; /* from the answer to "open" */
    gint64 *exposures_us;        /* list to which format points */
    guint64 shot;                /* number of the last trigger */
    gint64 picture_id;           /* id of the last picture; −1 if there was none */
    guint64 trigger_id;          /* id of the last trigger */
    gint64 exposure_us;          /* of the trigger that runs; 0 if none runs */

    const char *check; /* name of the check that runs */
    struct bench_verdict verdict;

    /* The first line that no program may send, and the first event that came at a wrong time. Each
     * is a sentence that names the check, or NULL if there was none. */
    char *strange_line, *strange_event;
    int n_events; /* events with a known name */
};

struct bench_answer {
    /* id of the request; 0 for the error of a program that could not read a request, and so did not
     * know its id */
    guint64 id;
    char *failure;      /* NULL if the request did not fail */
    JsonObject *values; /* the result; NULL if the request failed */
    gint64 at_us;
    gboolean taken; /* a bench_await…() has returned this answer */
};

/* Fills a bench. command must live until bench_clear(). Makes a temporary folder. */
gboolean bench_init(struct bench *bench, const struct program_command *command, GError **error);
void bench_clear(struct bench *bench);
void bench_clear_verdict(struct bench *bench);

/* Records why the present check has failed. `expected` says what the program should have done, and
 * the text of came_format says what it has done instead. `advice` is a string literal that says
 * what the author of the program must do. If the function is called again in the same check, the
 * first reason counts. Always returns FALSE, so that a check can return its result. */
gboolean bench_fail(struct bench *bench, const char *advice, const char *expected,
                    const char *came_format, ...) G_GNUC_PRINTF(4, 5);
/* Records why the present check is skipped. Always returns FALSE. */
gboolean bench_skip(struct bench *bench, const char *format, ...) G_GNUC_PRINTF(2, 3);

/* Starts the program and sends "hello". If the program is running, it is ended before. Returns
 * FALSE with a verdict if the program cannot be started or does not answer as it must. */
gboolean bench_hello(struct bench *bench);
/* The same as bench_hello(), and then sends "open" and reads the answer to it. */
gboolean bench_open(struct bench *bench);

/* Does what bench_open() does, and then sends "stop" to lamps or to an axis. Afterwards the lamps
 * are off. An axis may still be braking. */
gboolean bench_ready(struct bench *bench);

/* Closes the input of the program, and kills the program if it does not end in time. */
void bench_end(struct bench *bench);

void bench_close_input(struct bench *bench);
void bench_kill(struct bench *bench);

/* Waits until the program has ended, and reads the rest of its output. Returns FALSE if it has not
 * ended after wait_ms. */
gboolean bench_await_end(struct bench *bench, int wait_ms);

/* Writes text to the program. If the program does not take all of the text, its input is closed,
 * and the next answer is missing. */
void bench_write(struct bench *bench, const char *text);

/* Returns the line of a request, to be freed with g_free(). *ret_id is set to the id of the
 * request, which is new. The function takes ownership of params, which may be NULL. */
char *bench_line(struct bench *bench, const char *method, JsonObject *params, guint64 *ret_id);

/* Waits for the answer to the request with this id. Returns FALSE with a verdict if no answer comes
 * within wait_ms, or if the answer is an error. method is the name of the request, for the verdict.
 * *ret_values is set to the result, to be freed with json_object_unref(). ret_values may be
 * NULL. */
gboolean bench_await(struct bench *bench, guint64 id, const char *method, int wait_ms,
                     JsonObject **ret_values);

/* Waits like bench_await(), but accepts an error as the answer too. The bench owns the answer.
 * Returns NULL with a verdict if no answer comes. id may be 0 (see struct bench_answer). */
const struct bench_answer *bench_await_any(struct bench *bench, guint64 id, const char *method,
                                           int wait_ms);

/* Sends a request, and waits for its result as bench_await() does. Takes ownership of params, which
 * may be NULL. The time limit depends on the method:
 * - command->start_s for "hello" and "open",
 * - program_camera_wait_us() for "trigger",
 * - PROGRAM_ANSWER_MS for all others. */
gboolean bench_ask(struct bench *bench, const char *method, JsonObject *params,
                   JsonObject **ret_values);
/* The same as bench_ask() for a request whose result is not needed. */
gboolean bench_do(struct bench *bench, const char *method, JsonObject *params);

/* Reads answers and events for wait_ms, or until the program has ended. */
void bench_pass(struct bench *bench, int wait_ms);

/* Returns whether the program's answer to "hello" names this capability. */
gboolean bench_can(const struct bench *bench, const char *what);

/* Returns the params of a request with one value, which is a boolean, a number or a text. */
JsonObject *bench_params(const char *name, JsonNode *value);
