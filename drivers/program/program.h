/*
 * A program that is a device: it runs as long as the device is open, and answers requests on its
 * standard input by lines on its standard output. docs/build-a-rig/programs.md is the
 * specification, and message.h has the lines.
 *
 * A program has one request at a time. The others wait here, until each is sent or its time is
 * over. "stop" is sent immediately, also while another request runs. A program that does not answer
 * in time, or sends something else than answers and events, is killed. All its requests then fail.
 * The next request starts it again, with "hello" and "open" before that request. While nothing else
 * is to be sent, the program gets a "ping" each second, so that its death is noticed soon.
 *
 * mesorig-run-program.c runs the program with few rights, and ends it when this process ends.
 *
 * All functions belong to the main loop's thread. Only program_await(), program_ask() and
 * program_close() wait, each until a deadline.
 */
#pragma once

#include "process.h"

#include "drivers/device.h"

#include <json-glib/json-glib.h>

typedef struct Program Program;

/* The entries of a driver's option table for a program. at is the offset of the struct
 * program_command in the driver's private data. */
/* clang-format off */
#define PROGRAM(at, field) ((at) + G_STRUCT_OFFSET(struct program_command, field))
#define PROGRAM_OPTIONS(at)                                                                        \
    {"program", OPTION_PATH, NULL, 0, 0, NULL, NULL, PROGRAM(at, path),                            \
     "The program"},                                                                               \
    {"arguments", OPTION_STRINGS, NULL, 0, 0, "", NULL, PROGRAM(at, arguments),                    \
     "Its arguments"},                                                                             \
    {"start_s", OPTION_DOUBLE, "s", 0.1, 60, "5", NULL, PROGRAM(at, start_s),                      \
     "Time that it may take to start and to open its device"}
/* clang-format on */

/* program_check(), for a driver's check(), adds a mistake if the program cannot be run.
 * program_need(), for a driver's needs(), appends the program with its arguments. */
void program_check(const struct program_command *command, const struct config_section *section,
                   Mistakes *mistakes);
void program_need(const struct program_command *command, GPtrArray *to);

/* Time in which any request but "hello", "open" and "trigger" must be answered. It is shorter than
 * the deadline of the classes, so that the error of the program is reported. */
#define PROGRAM_ANSWER_MS 1500

/* Time without any request after which a program that can "silence" makes its device safe and
 * ends. */
#define PROGRAM_SILENCE_MS 10000

enum program_turn {
    PROGRAM_IN_TURN,
    PROGRAM_FIRST,   /* before all requests that are PROGRAM_IN_TURN */
    PROGRAM_AT_ONCE, /* like PROGRAM_FIRST, but sent even while another request runs */
};

struct program_answer {
    JsonObject *values;  /* NULL with an error */
    const GError *error; /* begins with class and name of the device */
    int tag;             /* tag of the request */
    gboolean overtaken;  /* program_overtake() was called after the request was sent */
};

/* Called from the main loop, once for each request. It is not called after program_close(). The
 * function may close the program. */
typedef void (*ProgramAnswer)(const struct program_answer *answer, gpointer data);

struct program_request {
    const char *method;
    JsonObject *params; /* program_call() and program_ask() take ownership; may be NULL */
    int timeout_ms;     /* longest time until the answer; 0 means PROGRAM_ANSWER_MS */
    enum program_turn turn;
    /* After the answer, the program is asked with "get". The answer to this "get" becomes the
     * answer of the request. Requests that have both read_back and PROGRAM_FIRST are answered in
     * the order in which they were made. */
    gboolean read_back;
    int tag; /* chosen by the driver, and repeated in the answer */
};

/* The functions that tell a driver what its program does. They are called from the main loop.
 * Each of them may close the program. */
struct program_listener {
    /* The program was started, has opened its device, and has then ended or was killed. answered is
     * TRUE if requests were waiting; their errors were delivered just before. The program is not
     * started again before the next request. May be NULL. */
    void (*lost)(const GError *error, gboolean answered, gpointer data);
    /* The program has sent an event. May be NULL. */
    void (*event)(const char *event, JsonObject *values, gpointer data);
    ProgramAnswer answer;
    gpointer data;
};

/* Starts the program of a device. folder is the folder for its pictures, or NULL. command and
 * device must live until program_close(). Takes a lock (drivers/lock.h). Returns NULL with an error
 * on failure. */
Program *program_new(const struct program_command *command, struct device *device,
                     const char *folder, GError **error);

/* Waits until the program has opened its device, and sets the identity of the device. Returns
 * the answer to "open", which the Program owns, or NULL with an error. */
JsonObject *program_await(Program *program, GError **error);

/* Makes a request and waits for its answer. Returns NULL on error. The caller owns the answer. */
JsonObject *program_ask(Program *program, const struct program_request *request, GError **error);

/* Sets the listener that is told of answers, events and the end of the program. With NULL,
 * nothing is told any more, and requests that were not sent are dropped without an answer. */
void program_listen(Program *program, const struct program_listener *listener);

/* Makes a request. The listener gets the answer. */
void program_call(Program *program, const struct program_request *request);

/* Says that a later request replaces the requests with this tag. Of these, the requests that were
 * not sent are never sent, and end with DEVICE_ERROR_BUSY. The requests that were sent are answered
 * as usual, but `overtaken` is TRUE in their answers. */
void program_overtake(Program *program, int tag);

/* Returns whether the program lists `what`, such as "silence", among its capabilities in its answer
 * to "hello". */
gboolean program_can(const Program *program, const char *what);

/* Completes an error that message.h or pgm.h has set about an answer. Adds the path of the program
 * and the name of its device to the error. Also adds advice if the error has none. */
void program_name_error(const Program *program, GError **error);

/* Makes the error of an event "lost", from the values of the event. */
GError *program_lost_error(const Program *program, JsonObject *values);

/* Sends "close", and waits until the program has ended. Kills a program that does not end in
 * time. NULL is ignored. */
void program_close(Program *program);
