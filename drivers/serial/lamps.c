/*
 * Lamps on a serial LED controller (docs/build-a-rig/led-controller.md).
 *
 * Every request is answered with the levels of all lamps. A switch succeeds only if the answer
 * shows the wanted level. A request without an answer is sent up to N_TRIES times in all. "Off" is
 * sent before every "on" and ping, and without waiting for their answers. "Off" of all lamps is
 * also sent before "off" of one lamp. An "on" is not sent again after an "off" of its lamp.
 *
 * While a lamp is lit, the controller is pinged, so that its watchdog keeps the lamp on. A lamp
 * counts as lit only from its confirmed "on" to its next command.
 */
#include "devices.h"
#include "lamp_line.h"
#include "port.h"

#include "drivers/lock.h"
#include "drivers/recording.h"
#include "modbus/address.h"

#include <errno.h>
#include <gio/gio.h>
#include <glib-unix.h>
#include <math.h>
#include <poll.h>
#include <string.h>
#include <unistd.h>

#define N_TRIES         3
#define PINGS           4   /* number of pings in the time of the controller's watchdog */
#define TICK_MS         10  /* period of the timer while a request is under way */
#define CLOSE_ANSWER_MS 150 /* longest time for an answer to each of the N_TRIES of close() */
#define MIN_WATCHDOG_MS 500

struct request {
    enum lamp_request what;
    int index; /* LAMP_SET: the lamp; LAMP_OFF: −1 */
    int level;
    int number; /* 0 before it was sent */
    int n_sent;
    gint64 due_us;       /* deadline of the answer */
    gboolean not_again;  /* an "off" of the lamp has followed */
    gboolean ended;      /* the result is to be reported */
    gboolean waited_for; /* a function waits for the request; its result is not reported */
    GError *error;
};

enum lamp_state { LAMP_DARK, LAMP_LIT, LAMP_UNKNOWN };

struct serial_lamps {
    char *port;
    int baud;
    double answer_ms, boot_ms, warm_up_s;
    struct option_doubles levels;

    LampBank *bank;
    Lock *lock;
    int fd; /* −1 if the port is not open */
    guint source, timer;
    GString *input;
    gboolean skips;  /* input is discarded up to the next end of line */
    GQueue requests; /* of struct request, in the order of the set() calls */
    int number;      /* number of the last request */
    int n, watchdog_ms;
    gint64 fed_us; /* time when the last request was sent */
    /* State of each lamp, as the answer to its last command has confirmed it. */
    enum lamp_state states[LAMP_LINE_MAX_LAMPS];
    GError *lost; /* to be reported */
};

#define FIELD(name) G_STRUCT_OFFSET(struct serial_lamps, name)

static const struct option options[] = {
    {"port", OPTION_STRING, .offset = FIELD(port),
     .help = "Serial port of the controller, such as a link in /dev/serial/by-id"},
    {"baud", OPTION_INT, NULL, 9600, 4000000, "115200", NULL, FIELD(baud), "Speed of the port"},
    {"levels", OPTION_DOUBLES, NULL, 1, 255, "255", NULL, FIELD(levels),
     "Brightness of the lamps that are on: one number for all lamps, or one for each lamp. Below "
     "255 most controllers switch the lamp on and off hundreds of times in a second"},
    {"answer_ms", OPTION_DOUBLE, "ms", 20, 400, "300", NULL, FIELD(answer_ms),
     "How long an answer may take. A line is sent up to three times"},
    {"boot_ms", OPTION_DOUBLE, "ms", 100, 60000, "5000", NULL, FIELD(boot_ms),
     "How long the controller may take to answer after its port was opened"},
    {"warm_up_s", OPTION_DOUBLE, "s", 0, 36000, "0", NULL, FIELD(warm_up_s),
     "Time from switching on until the output is stable"},
    {NULL},
};

static void request_free(gpointer data) {
    struct request *request = data;
    g_clear_error(&request->error);
    g_free(request);
}

static gboolean is_on(const struct request *request) {
    return request->what == LAMP_SET && request->level > 0;
}

static gboolean is_off(const struct request *request) {
    return request->what == LAMP_OFF || (request->what == LAMP_SET && request->level == 0);
}

static gboolean covers(const struct request *request, int i) {
    return request->what == LAMP_OFF || (request->what == LAMP_SET && request->index == i);
}

static gboolean overlap(const struct request *a, const struct request *b) {
    return (a->what == LAMP_OFF && b->what != LAMP_PING) ||
           (b->what == LAMP_OFF && a->what != LAMP_PING) ||
           (a->what == LAMP_SET && b->what == LAMP_SET && a->index == b->index);
}

static int level_of(const struct serial_lamps *lamps, int index) {
    return (int)lround(lamps->levels.values[lamps->levels.n > 1 ? index : 0]);
}

static void on_timer(gpointer data);

static void wake(struct serial_lamps *lamps, double ms) {
    Clock *clock = lamps->bank->device.clock;
    clock_cancel(clock, &lamps->timer);
    lamps->timer = clock_call_in(clock, (gint64)(ms * 1000), on_timer, lamps);
}

/* Notes the result of a request. Takes ownership of error. */
static void end(struct serial_lamps *lamps, struct request *request, GError *error) {
    const gboolean failed = error != NULL;
    request->ended = TRUE;
    request->error = error;
    for (int i = 0; i < lamps->n && failed; i++)
        if (covers(request, i))
            lamps->states[i] = LAMP_UNKNOWN;
}

static void lose(struct serial_lamps *lamps, GError *error) {
    for (int i = 0; i < lamps->n; i++)
        lamps->states[i] = LAMP_UNKNOWN;
    if (lamps->lost)
        g_error_free(error);
    else
        lamps->lost = error;
}

static gboolean any_lit(const struct serial_lamps *lamps) {
    for (int i = 0; i < lamps->n; i++)
        if (lamps->states[i] == LAMP_LIT)
            return TRUE;
    return FALSE;
}

/* Ends all requests, because the controller cannot be reached. */
static void fail_all(struct serial_lamps *lamps, const GError *error) {
    for (GList *l = lamps->requests.head; l; l = l->next) {
        struct request *request = l->data;
        if (!request->ended)
            end(lamps, request, g_error_copy(error));
    }
    if (any_lit(lamps))
        lose(lamps, g_error_copy(error));
}

static void close_port(struct serial_lamps *lamps) {
    if (lamps->source)
        g_source_remove(lamps->source);
    lamps->source = 0;
    if (lamps->fd >= 0)
        close(lamps->fd);
    lamps->fd = -1;
}

static void unplugged(struct serial_lamps *lamps, const char *why) {
    g_autoptr(GError) error = device_error_new(
        DEVICE_ERROR_DISCONNECTED, lamps->bank->device.who,
        "%s: the LED controller was unplugged or its port has failed (%s)" ERROR_ADVICE
        "plug it in again",
        lamps->port, why);
    close_port(lamps);
    fail_all(lamps, error);
}

static struct recording_bus bus_of(const struct serial_lamps *lamps) {
    return (struct recording_bus){"serial", lamps->port};
}

static void send(struct serial_lamps *lamps, struct request *request) {
    const gint64 now = clock_now_us(lamps->bank->device.clock);
    if (request->number == 0) {
        lamps->number = lamps->number % 0xffff + 1;
        request->number = lamps->number;
    }
    g_autofree char *line =
        lamp_line_request(request->number, request->what, request->index, request->level);
    request->n_sent++;
    request->due_us = now + (gint64)(lamps->answer_ms * 1000);
    lamps->fed_us = now;
    recording_text(bus_of(lamps), RECORDING_SENT, line, strlen(line));
    /* If the port takes nothing, the deadline of the answer shows it. */
    if (write(lamps->fd, line, strlen(line)) != (gssize)strlen(line))
        g_debug("%s: %s", lamps->port, g_strerror(errno));
}

/* Returns the rank of a request. A request waits while a request of the same or a higher rank is
 * under way. */
static int rank(const struct request *request) {
    return request->what == LAMP_OFF ? 2 : is_off(request) ? 1 : 0;
}

static struct request *next_request(const struct serial_lamps *lamps) {
    struct request *next = NULL;
    int under_way = -1;
    for (const GList *l = lamps->requests.head; l; l = l->next) {
        struct request *request = l->data;
        if (request->ended)
            continue;
        if (request->number > 0)
            under_way = MAX(under_way, rank(request));
        else if (!next || rank(request) > rank(next))
            next = request;
    }
    return next && rank(next) > under_way ? next : NULL;
}

static void pump(struct serial_lamps *lamps) {
    struct request *next;
    while (lamps->fd >= 0 && (next = next_request(lamps)))
        send(lamps, next);
}

static struct request *add(struct serial_lamps *lamps, enum lamp_request what, int index,
                           int level) {
    struct request *request = g_new0(struct request, 1);
    *request = (struct request){.what = what, .index = index, .level = level};
    g_queue_push_tail(&lamps->requests, request);
    for (int i = 0; i < lamps->n; i++)
        if (covers(request, i))
            lamps->states[i] = LAMP_UNKNOWN;
    return request;
}

/* Keeps an earlier "on" from undoing an "off". An "on" that was not sent yet ends. An "on" that was
 * sent is not sent again. */
static void overtake(struct serial_lamps *lamps, const struct request *off) {
    for (GList *l = lamps->requests.head; l; l = l->next) {
        struct request *request = l->data;
        if (request->ended || !is_on(request) || !overlap(request, off))
            continue;
        request->not_again = TRUE;
        if (request->number == 0)
            end(lamps, request,
                device_error_new(
                    DEVICE_ERROR_BUSY, lamps->bank->device.who,
                    "“on” of lamp %d was given up, because “off” came before the lamp was on",
                    request->index));
    }
}

static GError *silence(const struct serial_lamps *lamps, const struct request *request) {
    return device_error_new(DEVICE_ERROR_TIMEOUT, lamps->bank->device.who,
                            "%s: the LED controller has not answered to %d lines within %g ms "
                            "each" ERROR_ADVICE "check its power, its cable and baud",
                            lamps->port, request->n_sent, lamps->answer_ms);
}

/* Handles each request whose answer is overdue: sends it again, or ends it. */
static void check_deadlines(struct serial_lamps *lamps) {
    const gint64 now = clock_now_us(lamps->bank->device.clock);
    for (GList *l = lamps->requests.head; l; l = l->next) {
        struct request *request = l->data;
        if (request->ended || request->number == 0 || now < request->due_us)
            continue;
        if (request->n_sent < N_TRIES && !request->not_again && lamps->fd >= 0) {
            send(lamps, request);
            continue;
        }
        g_autoptr(GError) error = silence(lamps, request);
        if (request->not_again) { /* the "off" after it shows whether the controller answers */
            end(lamps, request, g_steal_pointer(&error));
            continue;
        }
        fail_all(lamps, error);
        return;
    }
}

/* Returns why an answer does not confirm a request, or NULL if it does. */
static GError *check_answer(const struct serial_lamps *lamps, const struct request *request,
                            const struct lamp_answer *answer) {
    const char *who = lamps->bank->device.who;
    static const enum lamp_answer_kind kinds[] = {
        [LAMP_PING] = LAMP_ANSWER_PING, [LAMP_OFF] = LAMP_ANSWER_OFF, [LAMP_SET] = LAMP_ANSWER_SET};
    if (answer->kind != kinds[request->what])
        return device_error_new(DEVICE_ERROR_PROTOCOL, who,
                                "%s: the LED controller refuses the command" ERROR_ADVICE
                                "check that its firmware is that of contrib/led-controller",
                                lamps->port);
    if (lamps->n > 0 && answer->n != lamps->n)
        return device_error_new(DEVICE_ERROR_PROTOCOL, who,
                                "%s: the LED controller has %d lamps now, and had %d" ERROR_ADVICE
                                "check which controller is plugged in",
                                lamps->port, answer->n, lamps->n);
    for (int i = 0; i < answer->n; i++) {
        const int level = request->what == LAMP_SET ? request->level : 0;
        if (covers(request, i) && answer->levels[i] != level)
            return device_error_new(DEVICE_ERROR_PROTOCOL, who,
                                    "lamp %d was set to %d, but %s reports %d" ERROR_ADVICE
                                    "check the wiring of the lamp's output",
                                    i, level, lamps->port, answer->levels[i]);
    }
    return NULL;
}

/* Reports the lamps as lost if the level of a lamp has changed without a command. */
static void check_others(struct serial_lamps *lamps, const struct lamp_answer *answer) {
    for (int i = 0; i < lamps->n; i++) {
        const enum lamp_state state = lamps->states[i];
        const int level = state == LAMP_LIT ? level_of(lamps, i) : 0;
        if (state == LAMP_UNKNOWN || answer->levels[i] == level)
            continue;
        lose(lamps, device_error_new(DEVICE_ERROR_PROTOCOL, lamps->bank->device.who,
                                     "lamp %d was at %d, but %s reports %d without a "
                                     "command" ERROR_ADVICE
                                     "check the power of the controller, and what else uses it",
                                     i, level, lamps->port, answer->levels[i]));
        return;
    }
}

static gboolean is_last(const struct serial_lamps *lamps, const struct request *request, int i) {
    for (const GList *l = lamps->requests.tail; l; l = l->prev)
        if (covers(l->data, i))
            return l->data == request;
    return FALSE;
}

/* Takes the answer to a request. First ends the earlier requests to the same lamps. If both are
 * "off", the earlier one gets the same result. Any other earlier request ends as not answered. */
static void take_answer(struct serial_lamps *lamps, struct request *request,
                        const struct lamp_answer *answer) {
    g_autoptr(GError) error = check_answer(lamps, request, answer);
    for (GList *l = lamps->requests.head; l->data != request; l = l->next) {
        struct request *older = l->data;
        if (older->ended || !overlap(older, request))
            continue;
        if (is_off(older) && is_off(request))
            end(lamps, older, error ? g_error_copy(error) : NULL);
        else
            end(lamps, older,
                device_error_new(DEVICE_ERROR_TIMEOUT, lamps->bank->device.who,
                                 "“on” of lamp %d was not answered before “off”", older->index));
    }
    const gboolean ok = !error;
    end(lamps, request, g_steal_pointer(&error));
    if (ok && lamps->n == 0)
        lamps->n = answer->n;
    for (int i = 0; i < lamps->n && ok; i++)
        if (covers(request, i) && is_last(lamps, request, i))
            lamps->states[i] = is_on(request) ? LAMP_LIT : LAMP_DARK;
    lamps->watchdog_ms = answer->watchdog_ms;
    if (ok)
        check_others(lamps, answer);
}

static void take_line(struct serial_lamps *lamps, const char *line) {
    struct lamp_answer answer;
    lamp_line_read(line, &answer);
    if (answer.kind == LAMP_ANSWER_RESET && any_lit(lamps))
        lose(lamps, device_error_new(DEVICE_ERROR_DISCONNECTED, lamps->bank->device.who,
                                     "%s: the LED controller was reset, so its lamps are "
                                     "off" ERROR_ADVICE "check its power",
                                     lamps->port));
    for (GList *l = lamps->requests.head; l && answer.number > 0; l = l->next) {
        struct request *request = l->data;
        if (request->number == answer.number && !request->ended) {
            take_answer(lamps, request, &answer);
            if (request->what == LAMP_PING && request->error && any_lit(lamps))
                lose(lamps, g_error_copy(request->error));
            return;
        }
    }
}

/* Reads what the port has, and takes the lines that are complete. */
static void read_input(struct serial_lamps *lamps) {
    char bytes[512];
    while (lamps->fd >= 0) {
        const gssize n = read(lamps->fd, bytes, sizeof bytes);
        if (n < 0 && (errno == EAGAIN || errno == EINTR))
            return;
        if (n <= 0) {
            unplugged(lamps, n < 0 ? g_strerror(errno) : "it has hung up");
            return;
        }
        recording_text(bus_of(lamps), RECORDING_RECEIVED, bytes, (gsize)n);
        for (gssize i = 0; i < n; i++) {
            if (bytes[i] == '\n' || bytes[i] == '\r') {
                if (!lamps->skips)
                    take_line(lamps, lamps->input->str);
                lamps->skips = FALSE;
                g_string_truncate(lamps->input, 0);
            } else if (lamps->input->len < LAMP_LINE_SIZE) {
                g_string_append_c(lamps->input, bytes[i] ? bytes[i] : '?');
            } else {
                lamps->skips = TRUE;
            }
        }
    }
}

/* Reports one result. A caller does nothing afterwards, because the listener may close the bank. */
static void deliver(struct serial_lamps *lamps) {
    LampBank *bank = lamps->bank;
    for (GList *l = lamps->requests.head; l; l = l->next) {
        struct request *request = l->data;
        if (!request->ended || request->waited_for)
            continue;
        g_queue_delete_link(&lamps->requests, l);
        const gboolean on = is_on(request), ping = request->what == LAMP_PING;
        const int index = request->index;
        GError *error = g_steal_pointer(&request->error);
        request_free(request);
        wake(lamps, 0);
        if (ping)
            g_clear_error(&error); /* the lamps are lost, which is reported */
        else
            lamps_report(bank, index, on, error);
        return;
    }
    if (lamps->lost)
        lamps_lost(bank, g_steal_pointer(&lamps->lost));
}

static void feed(struct serial_lamps *lamps) {
    const gint64 now = clock_now_us(lamps->bank->device.clock);
    if (any_lit(lamps) && lamps->fd >= 0 && g_queue_is_empty(&lamps->requests) &&
        now - lamps->fed_us >= lamps->watchdog_ms * (gint64)1000 / PINGS)
        add(lamps, LAMP_PING, -1, 0);
}

static void on_timer(gpointer data) {
    struct serial_lamps *lamps = data;
    lamps->timer = 0;
    read_input(lamps); /* answers that came while this program could not run */
    check_deadlines(lamps);
    feed(lamps);
    pump(lamps);
    if (!g_queue_is_empty(&lamps->requests) || any_lit(lamps))
        wake(lamps, TICK_MS);
    deliver(lamps);
}

static gboolean on_input(int fd, GIOCondition condition, gpointer data) {
    struct serial_lamps *lamps = data;
    read_input(lamps);
    wake(lamps, 0);
    return G_SOURCE_CONTINUE; /* close_port() removes the source */
}

/* Opens and locks the port. An adapter that was plugged in again may have another device number,
 * and the lock is then replaced. */
static gboolean open_port(struct serial_lamps *lamps, GError **error) {
    g_autofree char *key = lock_key_of_node("serial", lamps->port);
    if (key && !(lamps->lock && strcmp(lock_key(lamps->lock), key) == 0)) {
        Lock *lock = lock_take(key, LOCK_ALONE, lamps->port, error);
        if (!lock)
            return FALSE;
        lock_release(lamps->lock);
        lamps->lock = lock;
    }
    lamps->fd = serial_port_open(lamps->port, lamps->baud, error);
    if (lamps->fd < 0)
        return FALSE;
    g_string_truncate(lamps->input, 0);
    lamps->skips = FALSE;
    lamps->source = g_unix_fd_add(lamps->fd, G_IO_IN | G_IO_HUP | G_IO_ERR, on_input, lamps);
    return TRUE;
}

static gboolean set_lamp(LampBank *bank, int index, gboolean on, GError **error) {
    struct serial_lamps *lamps = bank->device.priv;
    const enum lamp_request what = index < 0 ? LAMP_OFF : LAMP_SET;
    if (lamps->fd < 0 && !open_port(lamps, error)) {
        error_details_add_subject(error, bank->device.who);
        return FALSE;
    }
    const struct request *request = add(lamps, what, index, on ? level_of(lamps, index) : 0);
    if (!on)
        overtake(lamps, request);
    pump(lamps);
    wake(lamps, 0);
    return TRUE;
}

/* Sends a request and waits for its answer, without the main loop. */
static gboolean ask(struct serial_lamps *lamps, enum lamp_request what, GError **error) {
    struct request *request = add(lamps, what, -1, 0);
    request->waited_for = TRUE;
    pump(lamps);
    while (!request->ended) {
        struct pollfd fd = {.fd = lamps->fd, .events = POLLIN};
        poll(&fd, 1, TICK_MS);
        read_input(lamps);
        check_deadlines(lamps);
        if (lamps->fd < 0 && !request->ended)
            end(lamps, request,
                device_error_new(DEVICE_ERROR_DISCONNECTED, lamps->bank->device.who,
                                 "%s: the port was closed before the answer came" ERROR_ADVICE
                                 "plug the LED controller in again",
                                 lamps->port));
    }
    g_queue_remove(&lamps->requests, request);
    const gboolean ok = !request->error;
    if (!ok)
        g_propagate_error(error, g_steal_pointer(&request->error));
    request_free(request);
    return ok;
}

/* Sends pings until the controller answers or boot_ms have passed. */
static gboolean greet(struct serial_lamps *lamps, GError **error) {
    Clock *clock = lamps->bank->device.clock;
    const gint64 until_us = clock_now_us(clock) + (gint64)(lamps->boot_ms * 1000);
    g_autoptr(GError) failed = NULL;
    do {
        g_clear_error(&failed);
        if (ask(lamps, LAMP_PING, &failed))
            return TRUE;
    } while (lamps->fd >= 0 && clock_now_us(clock) < until_us);
    g_propagate_error(error, g_steal_pointer(&failed));
    return FALSE;
}

static void leave(struct serial_lamps *lamps) {
    clock_cancel(lamps->bank->device.clock, &lamps->timer);
    close_port(lamps);
    g_queue_clear_full(&lamps->requests, request_free);
    g_clear_error(&lamps->lost);
    g_string_free(g_steal_pointer(&lamps->input), TRUE);
    g_clear_pointer(&lamps->lock, lock_release);
}

static gboolean check_controller(struct serial_lamps *lamps, GError **error) {
    const LampBank *bank = lamps->bank;
    if (lamps->levels.n != 1 && lamps->levels.n != lamps->n)
        return config_set_error(error, CONFIG_ERROR_VALUE, bank->device.section, "levels",
                                "has %d numbers, but the controller has %d lamps; give one number "
                                "or one for each lamp",
                                lamps->levels.n, lamps->n);
    if (lamps->watchdog_ms < MIN_WATCHDOG_MS)
        return device_error_set(error, DEVICE_ERROR_PROTOCOL, bank->device.who,
                                "%s: the LED controller switches its lamps off after %d ms, which "
                                "is too soon" ERROR_ADVICE "set DARK_MS in its firmware to 2000",
                                lamps->port, lamps->watchdog_ms);
    return TRUE;
}

static gboolean open_lamps(LampBank *bank, GError **error) {
    struct serial_lamps *lamps = bank->device.priv;
    if (!device_check_real_clock(&bank->device, error))
        return FALSE;
    lamps->bank = bank;
    lamps->fd = -1;
    lamps->input = g_string_new(NULL);
    for (int i = 0; i < LAMP_LINE_MAX_LAMPS; i++)
        lamps->states[i] = LAMP_UNKNOWN;
    /* Switch off first, even if the section has mistakes. */
    if (open_port(lamps, error) && greet(lamps, error) && ask(lamps, LAMP_OFF, error) &&
        check_controller(lamps, error)) {
        bank->n = lamps->n;
        bank->warm_up_s = lamps->warm_up_s;
        bank->watchdog_s = lamps->watchdog_ms / 1000.0;
        device_set_identity(&bank->device, "LED controller", NULL, lamps->port);
        return TRUE;
    }
    leave(lamps);
    return FALSE;
}

static void close_lamps(LampBank *bank) {
    struct serial_lamps *lamps = bank->device.priv;
    g_queue_clear_full(&lamps->requests, request_free);
    lamps->answer_ms = MIN(lamps->answer_ms, CLOSE_ANSWER_MS);
    if (lamps->fd >= 0)
        ask(lamps, LAMP_OFF, NULL);
    leave(lamps);
}

static void needs(gconstpointer given, GPtrArray *to) {
    g_autofree char *name = modbus_address_name(((const struct serial_lamps *)given)->port);
    g_ptr_array_add(to, g_strdup_printf("serial port %s", name));
}

const struct lamps_driver serial_lamps_driver = {
    .info =
        {"lamps", "serial-lamps",
         "Lamps on a serial LED controller such as an Arduino (docs/build-a-rig/led-controller.md)",
         options, sizeof(struct serial_lamps), NULL, needs},
    .open = open_lamps,
    .close = close_lamps,
    .set = set_lamp,
};
