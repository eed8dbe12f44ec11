#include "program.h"

#include "drivers/lock.h"
#include "drivers/recording.h"
#include "message.h"

#include <errno.h>
#include <glib-unix.h>
#include <poll.h>
#include <string.h>
#include <unistd.h>

#define PING_US   G_USEC_PER_SEC
#define END_MS    1000 /* time that a program has to end after "close", or after it was killed */
#define READ_SIZE 16384

enum state {
    DOWN,     /* there is no process */
    STARTING, /* "hello" and "open" are not answered yet */
    READY,
    ENDING, /* the process was killed or has ended, and on_end() was not called yet */
};

struct call {
    Program *program;
    char *method;
    JsonObject *params;
    int timeout_ms;
    enum program_turn turn;
    gboolean read_back;
    int tag;
    /* Number of the request in the order of the requests. The "get" that reads back has the number
     * of its request. */
    guint64 number;
    gboolean is_read_back; /* the "get" after a request that was answered */
    guint64 id;            /* id of the request in its message; 0 if it was not sent */
    gboolean overtaken;
    /* Takes the answer. NULL means that the listener gets it. */
    void (*take)(struct call *call, JsonObject *values, const GError *error);
    gpointer data;
    guint deadline;
};

struct Program {
    int refs;
    gboolean closed;
    Clock *clock;          /* owned, because it is also used after the device was closed */
    struct device *device; /* not owned; valid until the program is closed */
    const struct program_command *command;
    char *folder;
    Lock *lock;
    struct program_listener listener;
    enum state state;
    struct program_process process;
    guint out_source, socket_source;
    GByteArray *line;     /* output that was read and not taken yet */
    GQueue starting;      /* of struct call: "hello" and "open" */
    GQueue waiting, sent; /* of struct call */
    GQueue dropped;       /* of struct call: replaced before they were sent; pump() ends them */
    guint64 last_id, n_calls;
    guint pump, ping, start, ending;
    JsonObject *hello, *opened; /* answers of the program to "hello" and "open" */
    /* why the program was killed or has ended, until that is reported */
    GError *failure;
};

static Program *ref(Program *program) {
    program->refs++;
    return program;
}

static void unref(Program *program) {
    if (--program->refs > 0)
        return;
    g_byte_array_unref(program->line);
    clock_unref(program->clock);
    g_free(program->folder);
    g_free(program);
}

G_DEFINE_AUTOPTR_CLEANUP_FUNC(Program, unref)

static void call_free(gpointer data) {
    struct call *call = data;
    clock_cancel(call->program->clock, &call->deadline);
    g_clear_pointer(&call->params, json_object_unref);
    g_free(call->method);
    g_free(call);
}

static const char *name_of(const Program *program) {
    return program->command->path;
}

void program_name_error(const Program *program, GError **error) {
    if (error && *error && (*error)->domain == DEVICE_ERROR && !error_details_advice(*error)) {
        GError *named = device_error_new((enum device_error)(*error)->code, program->device->who,
                                         "%s %s" ERROR_ADVICE
                                         "correct the program (see docs/build-a-rig/programs.md)",
                                         name_of(program), (*error)->message);
        g_error_free(*error);
        *error = named;
        return;
    }
    g_prefix_error(error, "%s ", name_of(program));
    error_details_add_subject(error, program->device->who);
}

GError *program_lost_error(const Program *program, JsonObject *values) {
    g_autofree char *message = message_text(values, "message");
    return device_error_new(DEVICE_ERROR_PROTOCOL, program->device->who, "its program reports: %s",
                            message);
}

static void fail(Program *program, GError *error);
static void pump(Program *program);

static void on_pump(gpointer data) {
    Program *program = data;
    program->pump = 0;
    pump(program);
}

static void pump_later(Program *program) {
    if (program->pump == 0)
        program->pump = clock_call_in(program->clock, 0, on_pump, program);
}

/* Ends a call that is in no queue any more: delivers the answer or the error, and frees the
 * call. Call it last, because the listener may close the program. */
static void end_call(struct call *call, JsonObject *values, const GError *error) {
    g_autoptr(Program) program = ref(call->program);
    const struct program_answer answer = {values, error, call->tag, call->overtaken};
    clock_cancel(program->clock, &call->deadline);
    if (call->take)
        call->take(call, values, error);
    else if (program->listener.answer)
        program->listener.answer(&answer, program->listener.data);
    call_free(call);
}

/* Ends a call whose time is over. If the call was sent, the program is killed. Otherwise only
 * this call fails, because the program may be busy with another request or may still be starting.
 */
static void on_deadline(gpointer data) {
    struct call *call = data;
    Program *program = call->program;
    call->deadline = 0;
    if (call->id) {
        fail(program,
             device_error_new(DEVICE_ERROR_TIMEOUT, program->device->who,
                              "%s did not answer “%s” within %d ms; it was "
                              "ended" ERROR_ADVICE "see what it has printed in the log of mesorigd",
                              name_of(program), call->method, call->timeout_ms));
        return;
    }
    g_autoptr(GError) error = device_error_new(
        DEVICE_ERROR_TIMEOUT, program->device->who, "%s %s%s", name_of(program),
        program->state == READY    ? "is still busy with another request"
        : program->state == ENDING ? "was killed, and does not end"
                                   : "has not started yet",
        program->state == READY    ? ""
        : program->state == ENDING ? ERROR_ADVICE "unplug its device"
                                   : ERROR_ADVICE "give it more time with start_s");
    g_queue_remove(&program->waiting, call);
    end_call(call, NULL, error);
}

static void set_deadline(struct call *call) {
    Clock *clock = call->program->clock;
    clock_cancel(clock, &call->deadline);
    call->deadline = clock_call_in(clock, call->timeout_ms * (gint64)1000, on_deadline, call);
}

static struct call *call_new(Program *program, const struct program_request *request) {
    struct call *call = g_new0(struct call, 1);
    *call =
        (struct call){.program = program,
                      .method = g_strdup(request->method),
                      .params = request->params,
                      .timeout_ms = request->timeout_ms ? request->timeout_ms : PROGRAM_ANSWER_MS,
                      .turn = request->turn,
                      .read_back = request->read_back,
                      .number = ++program->n_calls,
                      .tag = request->tag};
    return call;
}

static int compare_calls(gconstpointer a, gconstpointer b, gpointer unused) {
    const struct call *x = a, *y = b;
    if (x->turn != y->turn)
        return x->turn > y->turn ? -1 : 1;
    return x->number < y->number ? -1 : x->number > y->number;
}

static void enqueue(struct call *call) {
    g_queue_insert_sorted(&call->program->waiting, call, compare_calls, NULL);
    set_deadline(call);
    pump_later(call->program);
}

static struct recording_bus bus_of(const Program *program) {
    return (struct recording_bus){"program", name_of(program)};
}

/* Writes a request. If the pipe is full, the program has left 64 KiB of requests unread and is
 * killed. */
static void send_call(struct call *call) {
    Program *program = call->program;
    call->id = ++program->last_id;
    g_autofree char *line =
        message_write(call->id, call->method, call->timeout_ms, g_steal_pointer(&call->params));
    g_queue_push_tail(&program->sent, call);
    set_deadline(call);
    const gssize length = (gssize)strlen(line);
    recording_text(bus_of(program), RECORDING_SENT, line, (gsize)length);
    if (write(program->process.in, line, (gsize)length) != length && errno != EPIPE)
        fail(program, device_error_new(DEVICE_ERROR_PROTOCOL, program->device->who,
                                       "%s does not read its requests; it was ended" ERROR_ADVICE
                                       "see what it has printed in the log of mesorigd",
                                       name_of(program)));
}

static gboolean start_process(Program *program, GError **error);

/* Ends the dropped calls, starts a program that is down if a call waits for it, and sends the
 * calls that may be sent now. */
static void pump(Program *program) {
    g_autoptr(Program) guard = ref(program);
    GError *error = NULL;
    while (program->dropped.length > 0 && !program->closed) {
        struct call *call = g_queue_pop_head(&program->dropped);
        g_autoptr(GError) why =
            device_error_new(DEVICE_ERROR_BUSY, program->device->who,
                             "a later “off” or “stop” came before “%s” was sent", call->method);
        end_call(call, NULL, why);
    }
    if (program->closed)
        return;
    if (program->state == DOWN && program->waiting.length > 0 && !start_process(program, &error)) {
        fail(program, error);
        return;
    }
    GQueue *queue = program->state == STARTING ? &program->starting : &program->waiting;
    while (
        (program->state == STARTING || program->state == READY) && queue->length > 0 &&
        (program->sent.length == 0 || ((struct call *)queue->head->data)->turn == PROGRAM_AT_ONCE))
        send_call(g_queue_pop_head(queue));
}

/* Ends all calls with the error program->failure. If the program was ready, then tells the listener
 * that the program is lost. */
static void tell_failure(Program *program, gboolean was_ready) {
    g_autoptr(Program) guard = ref(program);
    g_autoptr(GError) error = g_steal_pointer(&program->failure);
    GQueue failed = program->sent;
    gboolean answered = FALSE;
    struct call *call;
    g_queue_init(&program->sent);
    while ((call = g_queue_pop_head(&program->starting)))
        g_queue_push_tail(&failed, call);
    while ((call = g_queue_pop_head(&program->waiting)))
        g_queue_push_tail(&failed, call);
    while ((call = g_queue_pop_head(&failed))) {
        if (program->closed && !call->take) {
            call_free(call);
            continue;
        }
        answered |= !call->take;
        end_call(call, NULL, error);
    }
    if (was_ready && !program->closed && program->listener.lost)
        program->listener.lost(error, answered, program->listener.data);
}

static void drop_process(Program *program) {
    g_clear_handle_id(&program->out_source, g_source_remove);
    clock_cancel(program->clock, &program->ping);
    clock_cancel(program->clock, &program->start);
    program_process_close_pipes(&program->process);
}

/* Ends the program because of an error. Takes ownership of the error. Call it last. */
static void fail(Program *program, GError *error) {
    const gboolean was_ready = program->state == READY;
    g_clear_error(&program->failure);
    program->failure = error;
    if (program->state == STARTING || program->state == READY) {
        drop_process(program);
        program_process_kill(&program->process);
        program->state = ENDING;
    }
    tell_failure(program, was_ready);
}

/* Waits for the end of the process (program_process_reap()). */
static char *reap(Program *program) {
    g_clear_handle_id(&program->socket_source, g_source_remove);
    return program_process_reap(&program->process);
}

/* Takes note that the process and everything that it has started have ended. Call it last. */
static void on_end(Program *program) {
    const enum state before = program->state;
    g_autofree char *how = reap(program);
    clock_cancel(program->clock, &program->ending);
    drop_process(program);
    program->state = DOWN;
    if (before == STARTING || before == READY) {
        g_clear_error(&program->failure);
        program->failure =
            device_error_new(DEVICE_ERROR_DISCONNECTED, program->device->who,
                             "%s %s" ERROR_ADVICE "see what it has printed in the log of mesorigd",
                             name_of(program), how ? how : "has ended");
        tell_failure(program, before == READY);
        return;
    }
    pump_later(program); /* a call may wait for the next start */
}

static gboolean on_socket(gint fd, GIOCondition condition, gpointer data) {
    Program *program = data;
    program->socket_source = 0;
    on_end(program);
    return G_SOURCE_REMOVE;
}

/* Kills a process that has closed its output, but does not end. */
static void on_ending(gpointer data) {
    Program *program = data;
    program->ending = 0;
    program_process_kill(&program->process);
}

static void on_ping(gpointer data);

static void ping_later(Program *program) {
    clock_cancel(program->clock, &program->ping);
    program->ping = clock_call_in(program->clock, PING_US, on_ping, program);
}

static void on_pong(struct call *call, JsonObject *values, const GError *error) {
}

static void on_ping(gpointer data) {
    Program *program = data;
    program->ping = 0;
    ping_later(program);
    if (program->sent.length > 0 || program->waiting.length > 0)
        return;
    struct call *call = call_new(program, &(struct program_request){.method = "ping"});
    call->take = on_pong;
    enqueue(call);
}

static void take_event(Program *program, const struct message *message) {
    if (program->state == READY && program->listener.event)
        program->listener.event(message->event, message->values, program->listener.data);
}

/* Takes an answer. If the state is to be read back, sends "get", and otherwise ends the call.
 * Call it last. */
static void take_answer(Program *program, const struct message *message) {
    GList *l = program->sent.head;
    while (l && ((const struct call *)l->data)->id != message->id)
        l = l->next;
    if (!l)
        return; /* the request has failed meanwhile */
    struct call *call = l->data;
    g_queue_delete_link(&program->sent, l);
    pump_later(program);
    if (!message->failure && call->read_back) {
        struct call *get = call_new(
            program,
            &(struct program_request){.method = "get", .turn = PROGRAM_FIRST, .tag = call->tag});
        get->take = call->take;
        get->data = call->data;
        get->overtaken = call->overtaken;
        get->is_read_back = TRUE;
        get->number = call->number;
        call_free(call);
        enqueue(get);
        return;
    }
    g_autoptr(GError) error = NULL;
    if (message->failure)
        error = device_error_new(DEVICE_ERROR_PROTOCOL, program->device->who, "%s refused “%s”: %s",
                                 name_of(program), call->method, message->failure);
    end_call(call, message->values, error);
}

static void take_line(Program *program, const char *line, gsize length) {
    struct message message = {0};
    GError *error = NULL;
    if (!message_read(line, length, &message, &error)) {
        program_name_error(program, &error);
        fail(program, error);
        return;
    }
    if (message.event)
        take_event(program, &message);
    else if (message.id == 0)
        fail(program, device_error_new(DEVICE_ERROR_PROTOCOL, program->device->who,
                                       "%s could not read a request: %s" ERROR_ADVICE
                                       "see docs/build-a-rig/programs.md for the form of a request",
                                       name_of(program), message.failure));
    else
        take_answer(program, &message);
    message_clear(&message);
}

/* Takes the complete lines that were read. Stops when a line has closed the program, killed it
 * or started it again. */
static void take_lines(Program *program) {
    GByteArray *bytes = program->line;
    const pid_t pid = program->process.pid;
    const char *end;
    while (!program->closed && program->process.pid == pid && program->state != ENDING &&
           (end = memchr(bytes->data, '\n', bytes->len))) {
        const gsize length = (gsize)(end - (const char *)bytes->data);
        g_autofree char *line = g_strndup((const char *)bytes->data, length);
        g_byte_array_remove_range(bytes, 0, (guint)length + 1);
        take_line(program, line, length);
    }
    if (!program->closed && program->process.pid == pid && program->state != ENDING &&
        bytes->len > MESSAGE_MAX)
        fail(program,
             device_error_new(DEVICE_ERROR_PROTOCOL, program->device->who,
                              "%s sent a line of more than %d bytes; it was ended" ERROR_ADVICE
                              "end each message with a line feed",
                              name_of(program), MESSAGE_MAX));
}

/* Reads at most READ_SIZE bytes of the output, so that a program that never stops writing does
 * not block the main loop. Call it last. */
static void read_output(Program *program) {
    g_autoptr(Program) guard = ref(program);
    guint8 bytes[READ_SIZE];
    const gssize n = read(program->process.out, bytes, sizeof bytes);
    if (n < 0 && (errno == EAGAIN || errno == EINTR))
        return;
    if (n > 0) {
        recording_text(bus_of(program), RECORDING_RECEIVED, (const char *)bytes, (gsize)n);
        g_byte_array_append(program->line, bytes, (guint)n);
        take_lines(program);
        return;
    }
    /* The program has closed its output. Its process should end next, and on_end() then reports
     * how it has ended. */
    g_clear_handle_id(&program->out_source, g_source_remove);
    close(program->process.out);
    program->process.out = -1;
    program->ending = clock_call_in(program->clock, END_MS * 1000, on_ending, program);
}

static gboolean on_output(gint fd, GIOCondition condition, gpointer data) {
    read_output(data);
    return G_SOURCE_CONTINUE;
}

static void on_hello(struct call *call, JsonObject *values, const GError *error);
static void on_opened(struct call *call, JsonObject *values, const GError *error);

static void start_call(Program *program, const char *method, JsonObject *params,
                       void (*take)(struct call *, JsonObject *, const GError *)) {
    const int timeout_ms = (int)(program->command->start_s * 1000);
    const struct program_request request = {method, params, .timeout_ms = timeout_ms};
    struct call *call = call_new(program, &request);
    call->take = take;
    g_queue_push_tail(&program->starting, call);
}

static void on_start(gpointer data) {
    Program *program = data;
    program->start = 0;
    fail(program,
         device_error_new(
             DEVICE_ERROR_TIMEOUT, program->device->who,
             "%s has not started within %g s; it was ended" ERROR_ADVICE
             "see what it has printed in the log of mesorigd, or give it more time with start_s",
             name_of(program), program->command->start_s));
}

static gboolean start_process(Program *program, GError **error) {
    g_autoptr(GError) why = NULL;
    if (!program_process_start(program->command, &program->process, &why))
        return device_error_set(error, DEVICE_ERROR_DISCONNECTED, program->device->who,
                                "%s cannot be started: %s" ERROR_ADVICE
                                "check that Mesorig is installed completely, and that this "
                                "computer is not out of memory, processes or open files",
                                name_of(program), why->message);
    g_byte_array_set_size(program->line, 0);
    program->state = STARTING;
    if (program->folder)
        recording_hide(program->folder, "{folder}");
    for (char **argument = program->command->arguments; argument && *argument; argument++)
        if (**argument == '/')
            recording_hide(*argument, "{path}");
    program->out_source =
        g_unix_fd_add(program->process.out, G_IO_IN | G_IO_HUP, on_output, program);
    program->socket_source =
        g_unix_fd_add(program->process.socket, G_IO_IN | G_IO_HUP, on_socket, program);
    program->start =
        clock_call_in(program->clock, (gint64)(program->command->start_s * 1e6), on_start, program);
    JsonObject *hello = json_object_new();
    json_object_set_int_member(hello, "version", MESSAGE_VERSION);
    json_object_set_string_member(hello, "class", program->device->info->class_name);
    json_object_set_string_member(hello, "name", program->device->name);
    json_object_set_int_member(hello, "silence_ms", PROGRAM_SILENCE_MS);
    if (program->folder)
        json_object_set_string_member(hello, "folder", program->folder);
    start_call(program, "hello", hello, on_hello);
    start_call(program, "open", NULL, on_opened);
    pump_later(program);
    return TRUE;
}

static void keep(JsonObject **kept, JsonObject *values) {
    g_clear_pointer(kept, json_object_unref);
    *kept = json_object_ref(values);
}

static void on_hello(struct call *call, JsonObject *values, const GError *error) {
    Program *program = call->program;
    gint64 version;
    GError *wrong = NULL;
    if (error) {
        if (program->state == STARTING)
            fail(program, g_error_copy(error));
        return;
    }
    keep(&program->hello, values);
    g_autofree char *class_name = message_text(values, "class");
    if (message_integer(values, "version", 1, MESSAGE_VERSION, &version, &wrong) &&
        !g_str_equal(class_name, program->device->info->class_name))
        wrong = device_error_new(DEVICE_ERROR_PROTOCOL, NULL,
                                 "is of the class “%s”, not “%s”" ERROR_ADVICE
                                 "name another program, or move it to a section of its own class",
                                 class_name, program->device->info->class_name);
    if (!wrong)
        return;
    program_name_error(program, &wrong);
    fail(program, wrong);
}

static void on_opened(struct call *call, JsonObject *values, const GError *error) {
    Program *program = call->program;
    if (error) {
        if (program->state == STARTING)
            fail(program, g_error_copy(error));
        return;
    }
    g_autofree char *device = message_text(program->hello, "device");
    g_autofree char *serial = message_text(program->hello, "serial");
    keep(&program->opened, values);
    device_set_identity(program->device, device, serial, name_of(program));
    clock_cancel(program->clock, &program->start);
    program->state = READY;
    ping_later(program);
    pump_later(program);
}

void program_check(const struct program_command *command, const struct config_section *section,
                   Mistakes *mistakes) {
    if (!g_file_test(command->path, G_FILE_TEST_IS_EXECUTABLE) ||
        g_file_test(command->path, G_FILE_TEST_IS_DIR))
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "program",
                       "%s is not a program that can be run; give its path, and make it executable",
                       command->path);
}

static char *words_of(const struct program_command *command) {
    g_autofree char *arguments = command->arguments ? g_strjoinv(" ", command->arguments) : NULL;
    return g_strdup_printf("the program %s%s%s", command->path, arguments && *arguments ? " " : "",
                           arguments ? arguments : "");
}

void program_need(const struct program_command *command, GPtrArray *to) {
    g_ptr_array_add(to, words_of(command));
}

Program *program_new(const struct program_command *command, struct device *device,
                     const char *folder, GError **error) {
    g_autofree char *words = words_of(command);
    if (!device_check_real_clock(device, error))
        return NULL;
    Lock *lock = lock_take(words, LOCK_ALONE, words, error);
    if (!lock) {
        error_details_add_subject(error, device->who);
        return NULL;
    }
    Program *program = g_new0(Program, 1);
    *program = (struct Program){.refs = 1,
                                .clock = clock_ref(device->clock),
                                .device = device,
                                .command = command,
                                .folder = g_strdup(folder),
                                .lock = lock,
                                .process = {.in = -1, .out = -1, .socket = -1},
                                .line = g_byte_array_new()};
    if (start_process(program, error))
        return program;
    program_close(program);
    return NULL;
}

void program_listen(Program *program, const struct program_listener *listener) {
    struct call *call;
    program->listener = listener ? *listener : (struct program_listener){0};
    while (!listener && (call = g_queue_pop_head(&program->waiting)))
        call_free(call);
}

void program_call(Program *program, const struct program_request *request) {
    enqueue(call_new(program, request));
}

void program_overtake(Program *program, int tag) {
    for (GList *l = program->sent.head; l; l = l->next) {
        struct call *call = l->data;
        call->overtaken |= call->tag == tag && !call->take;
    }
    for (GList *l = program->waiting.head, *next; l; l = next) {
        struct call *call = l->data;
        next = l->next;
        if (call->tag != tag || call->take)
            continue;
        call->overtaken = TRUE;
        if (call->is_read_back)
            continue;
        g_queue_delete_link(&program->waiting, l);
        clock_cancel(program->clock, &call->deadline);
        g_queue_push_tail(&program->dropped, call);
        pump_later(program);
    }
}

gboolean program_can(const Program *program, const char *what) {
    return program->hello && message_has(program->hello, "capabilities", what);
}

/* Waits until *done is TRUE, outside of the main loop. Returns FALSE at the deadline or if
 * poll() fails. */
static gboolean await(Program *program, const gboolean *done, gint64 deadline_us) {
    while (!*done) {
        const gint64 left_us = deadline_us - clock_now_us(program->clock);
        if (left_us <= 0)
            return FALSE;
        if (program->pump) {
            clock_cancel(program->clock, &program->pump);
            pump(program);
            continue;
        }
        struct pollfd ready[] = {{program->process.out, POLLIN, 0},
                                 {program->process.socket, POLLIN, 0}};
        if (poll(ready, 2, (int)(left_us / 1000) + 1) < 0 && errno != EINTR)
            return FALSE;
        if (ready[0].revents)
            read_output(program);
        else if (ready[1].revents)
            on_end(program);
    }
    return TRUE;
}

struct asked {
    gboolean done;
    JsonObject *values;
    GError *error;
};

static void on_asked(struct call *call, JsonObject *values, const GError *error) {
    struct asked *asked = call->data;
    asked->done = TRUE;
    asked->values = values ? json_object_ref(values) : NULL;
    asked->error = error ? g_error_copy(error) : NULL;
}

JsonObject *program_ask(Program *program, const struct program_request *request, GError **error) {
    struct asked asked = {0};
    struct call *call = call_new(program, request);
    const gint64 limit_us = clock_now_us(program->clock) +
                            call->timeout_ms * (gint64)(request->read_back ? 2000 : 1000);
    call->take = on_asked;
    call->data = &asked;
    enqueue(call);
    if (!await(program, &asked.done, limit_us))
        fail(program,
             device_error_new(DEVICE_ERROR_TIMEOUT, program->device->who,
                              "%s did not answer “%s” within %d ms; it was "
                              "ended" ERROR_ADVICE "see what it has printed in the log of mesorigd",
                              name_of(program), request->method,
                              request->timeout_ms ? request->timeout_ms : PROGRAM_ANSWER_MS));
    if (asked.error)
        g_propagate_error(error, asked.error);
    return asked.values;
}

JsonObject *program_await(Program *program, GError **error) {
    struct asked asked = {0};
    const gint64 limit_us =
        clock_now_us(program->clock) + (gint64)(program->command->start_s * 1e6);
    /* Any request waits until the program has started. */
    struct call *call = call_new(
        program, &(struct program_request){.method = "ping",
                                           .timeout_ms = PROGRAM_ANSWER_MS +
                                                         (int)(program->command->start_s * 1000)});
    call->take = on_asked;
    call->data = &asked;
    enqueue(call);
    if (!await(program, &asked.done, limit_us)) {
        clock_cancel(program->clock, &program->start);
        on_start(program);
    }
    g_clear_pointer(&asked.values, json_object_unref);
    if (!asked.error)
        return program->opened;
    g_propagate_error(error, asked.error);
    return NULL;
}

static gboolean await_end(Program *program, int wait_ms) {
    const gint64 limit_us = clock_now_us(program->clock) + wait_ms * (gint64)1000;
    while (program->process.socket >= 0 && clock_now_us(program->clock) < limit_us) {
        struct pollfd ready = {program->process.socket, POLLIN, 0};
        if (poll(&ready, 1, (int)((limit_us - clock_now_us(program->clock)) / 1000) + 1) > 0)
            g_free(reap(program));
    }
    return program->process.socket < 0;
}

static void clear(GQueue *queue) {
    g_queue_clear_full(queue, call_free);
}

void program_close(Program *program) {
    if (!program)
        return;
    program_listen(program, NULL);
    if (program->state == READY) {
        JsonObject *closed =
            program_ask(program, &(struct program_request){"close", NULL, END_MS}, NULL);
        g_clear_pointer(&closed, json_object_unref);
    }
    program->closed = TRUE;
    drop_process(program); /* at the end of its input, the program makes its device safe and ends */
    if (!await_end(program, program->state == ENDING ? 0 : END_MS)) {
        program_process_kill(&program->process);
        await_end(program, END_MS);
    }
    g_clear_handle_id(&program->socket_source, g_source_remove);
    if (program->process.socket >= 0)
        close(program->process.socket);
    clear(&program->starting);
    clear(&program->waiting);
    clear(&program->sent);
    clear(&program->dropped);
    clock_cancel(program->clock, &program->pump);
    clock_cancel(program->clock, &program->ending);
    g_clear_error(&program->failure);
    g_clear_pointer(&program->hello, json_object_unref);
    g_clear_pointer(&program->opened, json_object_unref);
    g_clear_pointer(&program->lock, lock_release);
    unref(program);
}
