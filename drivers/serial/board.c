#include "board_private.h"
#include "port.h"

#include "drivers/recording.h"
#include "modbus/address.h"

#include <errno.h>
#include <gio/gio.h>
#include <glib-unix.h>
#include <math.h>
#include <poll.h>
#include <string.h>
#include <unistd.h>

#define MAX_LINE 512 /* a longer line is noise */
#define IDLE_MS  100 /* period of the timer in the phase READY */
/* if the timer is late by more, this program could not run in that time */
#define MIN_LATE_US 20000
#define WAIT_MS     5 /* longest wait for input in open() and close() */

const char *const gcode_dialects[] = {"grbl", "marlin", "klipper", NULL};

static GHashTable *boards; /* maps a key to a GcodeBoard */

static void wake(GcodeBoard *board, double ms);

static gboolean is_same(const struct gcode_link *a, const struct gcode_link *b) {
    return a->baud == b->baud && a->dialect == b->dialect && a->answer_ms == b->answer_ms &&
           a->boot_ms == b->boot_ms;
}

static gboolean is_same_port(const char *a, const char *b) {
    g_autofree char *one = modbus_address_name(a), *two = modbus_address_name(b);
    return strcmp(one, two) == 0;
}

void gcode_link_check(const struct gcode_link *link, const struct config_section *section,
                      Mistakes *mistakes) {
    static const struct option table[] = {GCODE_LINK_OPTIONS, {NULL}};
    static const char *const any[] = {"*", NULL};
    gsize n;
    const struct config_section *sections = config_sections(section->config, &n);
    for (gsize i = 0; i < n && &sections[i] != section; i++) {
        struct gcode_link other = {0};
        g_autoptr(Mistakes) theirs = mistakes_new();
        const char *port = config_value(&sections[i], "port", NULL);
        if (sections[i].broken || !port || !is_same_port(port, link->port) ||
            !options_read(&(struct option_target){table, &other}, 1, &sections[i], any, theirs))
            continue;
        const gboolean same = is_same(&other, link);
        options_clear(table, &other);
        if (same)
            continue;
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "port",
                       "[%s], in line %d, opens %s with other settings; make baud, dialect, "
                       "answer_ms and boot_ms the same",
                       sections[i].group, sections[i].line, link->port);
        return;
    }
}

static void line_free(gpointer data) {
    struct gcode_line *line = data;
    g_free(line->text);
    g_free(line);
}

void gcode_board_forget_lines(GcodeBoard *board) {
    g_queue_clear_full(&board->unsent, line_free);
    g_queue_clear_full(&board->sent, line_free);
    board->n_unanswered = 0;
    board->asked = FALSE;
}

void gcode_board_close(GcodeBoard *board) {
    if (board->source)
        g_source_remove(board->source);
    board->source = 0;
    if (board->fd >= 0)
        close(board->fd);
    board->fd = -1;
    board->phase = CLOSED;
    board->active = NULL;
    board->n_at = 0;
    g_string_truncate(board->input, 0);
    gcode_board_forget_lines(board);
}

/* Notes that a request or a stop has ended. Takes ownership of error. */
static void end_client(GcodeClient *client, GError *error) {
    client->request = NO_REQUEST;
    client->stops = FALSE;
    client->has_ended = TRUE;
    if (error) {
        g_clear_error(&client->error);
        client->error = error;
    }
    wake(client->board, 0);
}

void gcode_board_end_request(GcodeBoard *board, GError *error) {
    g_autoptr(GError) owned = error;
    GcodeClient *active = board->active;
    board->active = NULL;
    board->phase = READY;
    if (!active)
        return;
    const enum request ended = active->request;
    for (guint i = 0; i < board->clients->len; i++) {
        GcodeClient *client = board->clients->pdata[i];
        if (client == active || (ended == HOME_ALL && client->request == HOME_ALL))
            end_client(client, error ? g_error_copy(error) : NULL);
    }
}

void gcode_board_ready(GcodeBoard *board) {
    board->phase = READY;
    for (guint i = 0; i < board->clients->len; i++) {
        GcodeClient *client = board->clients->pdata[i];
        if (client->stops)
            end_client(client, NULL);
    }
    wake(board, 0);
}

void gcode_board_fail(GcodeBoard *board, GError *error) {
    g_autoptr(GError) owned = error;
    const gboolean greeting = board->phase == GREETING;
    if (greeting) {
        g_clear_error(&board->failure);
        board->failure = g_error_copy(error);
        gcode_board_close(board);
    } else {
        board->phase = READY;
    }
    for (guint i = 0; i < board->clients->len; i++) {
        GcodeClient *client = board->clients->pdata[i];
        if (client->stops || (greeting && client->request != NO_REQUEST))
            end_client(client, g_error_copy(error));
    }
}

void gcode_board_lose(GcodeBoard *board, GError *error) {
    g_autoptr(GError) owned = error;
    if (board->phase == RUNNING)
        board->phase = READY;
    board->active = NULL;
    for (guint i = 0; i < board->clients->len; i++) {
        GcodeClient *client = board->clients->pdata[i];
        if (client->request != NO_REQUEST) {
            end_client(client, g_error_copy(error));
        } else if (client->stops && client->watched) {
            g_clear_error(&client->error);
            client->error = g_error_copy(error); /* reported when the stop ends */
        } else if (client->watched) {
            client->has_lost = TRUE;
            client->error = g_error_copy(error);
        }
        client->watched = FALSE;
    }
    wake(board, 0);
}

static void unplugged(GcodeBoard *board, const char *why) {
    gcode_board_close(board);
    GError *error =
        device_error_new(DEVICE_ERROR_DISCONNECTED, NULL,
                         "%s: the board was unplugged or its port has failed (%s)" ERROR_ADVICE
                         "plug the board in again, then home its axes (mesorig home)",
                         board->link.port, why);
    for (guint i = 0; i < board->clients->len; i++) {
        GcodeClient *client = board->clients->pdata[i];
        if (client->stops)
            end_client(client, g_error_copy(error));
    }
    gcode_board_lose(board, error);
}

/* Calls ended() or lost() of one client after another. Such a callback may free its client or all
 * clients. */
static void deliver(GcodeBoard *board) {
    for (guint i = 0; i < board->clients->len;) {
        GcodeClient *client = board->clients->pdata[i];
        if (!client->has_ended && !client->has_lost) {
            i++;
            continue;
        }
        const gboolean ended = client->has_ended;
        g_autoptr(GError) error = g_steal_pointer(&client->error);
        client->has_ended = client->has_lost = FALSE;
        i = 0;
        if (ended)
            client->listener->ended(client->data, error);
        else
            client->listener->lost(client->data, error);
    }
}

static void board_unref(GcodeBoard *board) {
    if (--board->ref_count > 0)
        return;
    g_hash_table_remove(boards, board->key);
    if (g_hash_table_size(boards) == 0)
        g_clear_pointer(&boards, g_hash_table_unref);
    clock_cancel(board->clock, &board->timer);
    gcode_board_close(board);
    lock_release(board->lock);
    g_clear_error(&board->failure);
    clock_unref(board->clock);
    g_queue_clear_full(&board->history, g_free);
    g_ptr_array_unref(board->clients);
    g_string_free(board->input, TRUE);
    g_free(board->link.port);
    g_free(board->key);
    g_free(board);
}

static struct recording_bus bus_of(const GcodeBoard *board) {
    return (struct recording_bus){"serial", board->link.port};
}

void gcode_board_write(GcodeBoard *board, const char *bytes, gsize n) {
    if (board->fd < 0)
        return;
    recording_text(bus_of(board), RECORDING_SENT, bytes, n);
    /* If the port takes nothing, the deadline of the answer shows it. */
    if (write(board->fd, bytes, n) != (gssize)n)
        g_debug("%s: %s", board->link.port, g_strerror(errno));
}

/* Sends the waiting lines for which the board has space. */
static void pump(GcodeBoard *board) {
    struct gcode_line *line;
    while ((line = g_queue_peek_head(&board->unsent))) {
        const int n = (int)strlen(line->text);
        const struct gcode_line *last = g_queue_peek_tail(&board->sent);
        if (last && (line->alone || last->alone || board->dialect->one_line ||
                     board->n_unanswered + n > board->dialect->window))
            return;
        g_queue_pop_head(&board->unsent);
        g_queue_push_tail(&board->sent, line);
        line->sent_us = clock_now_us(board->clock);
        board->n_unanswered += n;
        gcode_board_write(board, line->text, (gsize)n);
    }
}

void gcode_board_send(GcodeBoard *board, const char *text, gboolean is_long) {
    struct gcode_line *line = g_new0(struct gcode_line, 1);
    line->text = g_strconcat(text, "\n", NULL);
    line->alone = *text == '$';
    line->is_long = is_long;
    g_queue_push_tail(&board->unsent, line);
    pump(board);
}

gboolean gcode_board_answered(GcodeBoard *board) {
    struct gcode_line *line = g_queue_pop_head(&board->sent);
    if (!line)
        return FALSE;
    board->n_unanswered -= (int)strlen(line->text);
    line_free(line);
    /* The time limit of the next answer counts from this answer. */
    struct gcode_line *next = g_queue_peek_head(&board->sent);
    if (next)
        next->sent_us = clock_now_us(board->clock);
    pump(board);
    return TRUE;
}

gboolean gcode_board_is_answered(const GcodeBoard *board) {
    return g_queue_is_empty((GQueue *)&board->sent) && g_queue_is_empty((GQueue *)&board->unsent);
}

void gcode_board_moved(GcodeBoard *board, const double *at, int n) {
    const gint64 now = clock_now_us(board->clock);
    board->n_at = n;
    memcpy(board->at, at, (gsize)n * sizeof *at);
    for (guint i = 0; i < board->clients->len; i++) {
        GcodeClient *client = board->clients->pdata[i];
        if (client->letter < n)
            client->listener->at(client->data, at[client->letter], board->asked_us, now);
    }
}

/* Number of equal positions in a row that show that an axis stands. A position has only three
 * decimals, and noise may change one report. */
#define N_STILL 3

void gcode_board_check_still(GcodeBoard *board) {
    if (board->phase != RUNNING)
        return;
    for (guint i = 0; i < board->clients->len; i++) {
        GcodeClient *client = board->clients->pdata[i];
        if (!client->stops || client->letter >= board->n_at)
            continue;
        const double at = board->at[client->letter];
        client->n_still = client->n_still > 0 && at == client->still_at ? client->n_still + 1 : 1;
        client->still_at = at;
        if (client->n_still >= N_STILL)
            end_client(client, NULL);
    }
}

void gcode_board_begin(GcodeBoard *board, int stage, double ms) {
    board->stage = stage;
    board->stage_us = clock_now_us(board->clock);
    board->until_us = board->stage_us + (gint64)(ms * 1000);
}

gboolean gcode_board_is_past(const GcodeBoard *board, gint64 since_us, double ms) {
    return (double)(clock_now_us(board->clock) - since_us) > ms * 1000;
}

double gcode_board_poll_ms(const GcodeBoard *board, double idle_ms) {
    double ms = idle_ms;
    for (guint i = 0; i < board->clients->len; i++)
        ms = MIN(ms, ((const GcodeClient *)board->clients->pdata[i])->poll_ms);
    return ms;
}

gboolean gcode_board_was_dragged(const GcodeBoard *board, const GcodeClient *client) {
    const int letter = client->letter;
    return client->watched && client->request == NO_REQUEST && client->last_units_s > 0 &&
           letter < board->n_at && letter < board->n_before &&
           fabs(board->at[letter] - board->before[letter]) >= GCODE_SAME;
}

double gcode_board_brake_s(const GcodeBoard *board) {
    double longest = 0;
    for (guint i = 0; i < board->clients->len; i++)
        longest = MAX(longest, ((const GcodeClient *)board->clients->pdata[i])->brake_s);
    return longest;
}

gboolean gcode_board_is_watched(const GcodeBoard *board) {
    for (guint i = 0; i < board->clients->len; i++)
        if (((const GcodeClient *)board->clients->pdata[i])->watched)
            return TRUE;
    return FALSE;
}

GError *gcode_board_silence(const GcodeBoard *board, double ms) {
    if (board->killed)
        return device_error_new(DEVICE_ERROR_STALLED, NULL, "%s: %s", board->link.port,
                                board->dialect->halted);
    if (board->phase == GREETING && board->n_noise > 0)
        return device_error_new(
            DEVICE_ERROR_PROTOCOL, NULL,
            "%s: the board does not speak %s: within %g ms it sent %d other lines and no "
            "answer" ERROR_ADVICE "check baud and dialect",
            board->link.port, gcode_dialects[board->link.dialect], ms, board->n_noise);
    return device_error_new(
        DEVICE_ERROR_TIMEOUT, NULL,
        "%s: the board has not answered for %g ms" ERROR_ADVICE "check its power, %s",
        board->link.port, ms,
        board->phase == GREETING ? "the cable, baud and dialect" : "the cable and baud");
}

static void take_line(GcodeBoard *board, char *line) {
    struct gcode_answer answer;
    board->dialect->read(g_strstrip(line), &answer);
    if (answer.kind != GCODE_NONE)
        board->heard_us = clock_now_us(board->clock);
    else if (*line)
        board->n_noise++;
    board->dialect->take(board, &answer);
}

/* Reads what the port has, and takes the lines that are complete. */
static void read_input(GcodeBoard *board) {
    char bytes[1024];
    while (board->fd >= 0) {
        const gssize n = read(board->fd, bytes, sizeof bytes);
        if (n < 0 && (errno == EAGAIN || errno == EINTR))
            break;
        if (n <= 0) {
            unplugged(board, n < 0 ? g_strerror(errno) : "it has hung up");
            return;
        }
        recording_text(bus_of(board), RECORDING_RECEIVED, bytes, (gsize)n);
        for (gssize i = 0; i < n; i++)
            g_string_append_c(board->input, bytes[i] ? bytes[i] : '?');
        char *end;
        while ((end = strpbrk(board->input->str, "\r\n"))) {
            const gsize length = (gsize)(end - board->input->str);
            g_autofree char *line = g_strndup(board->input->str, length);
            const gboolean whole = !board->skips && length <= MAX_LINE;
            board->skips = FALSE;
            g_string_erase(board->input, 0, (gssize)length + 1);
            if (whole)
                take_line(board, line);
            if (board->fd < 0)
                return;
        }
        if (board->input->len > MAX_LINE) {
            board->skips = TRUE;
            g_string_truncate(board->input, 0);
        }
    }
}

/* Begins to stop the board if a client has requested a stop. Otherwise starts a request that
 * waits. */
static void next_request(GcodeBoard *board) {
    gboolean stops = FALSE;
    for (guint i = 0; i < board->clients->len; i++)
        stops |= ((GcodeClient *)board->clients->pdata[i])->stops;
    if (stops) {
        board->phase = STOPPING;
        board->dialect->stop(board);
        return;
    }
    for (guint i = 0; i < board->clients->len; i++) {
        GcodeClient *client = board->clients->pdata[i];
        if (client->request == NO_REQUEST)
            continue;
        board->active = client;
        board->phase = RUNNING;
        board->dialect->start(board);
        return;
    }
}

static gboolean waits(const GcodeBoard *board, const GcodeClient *client) {
    return client->request != NO_REQUEST && client != board->active &&
           !(client->request == HOME_ALL && board->active && board->active->request == HOME_ALL);
}

/* Does what is due, without calling ended() or lost() of a client. */
static void tick(GcodeBoard *board) {
    if (board->phase == READY)
        next_request(board);
    if (board->phase != CLOSED)
        board->dialect->tick(board, clock_now_us(board->clock));
    for (guint i = 0; i < board->clients->len; i++) {
        GcodeClient *client = board->clients->pdata[i];
        if (board->phase != CLOSED && waits(board, client))
            client->listener->waits(client->data);
    }
}

/* Moves all deadlines by the time in which this program could not run. */
static void forgive(GcodeBoard *board, gint64 late_us) {
    gint64 *times[] = {&board->heard_us, &board->stage_us, &board->until_us, &board->same_us};
    if (late_us < MIN_LATE_US)
        return;
    for (gsize i = 0; i < G_N_ELEMENTS(times); i++)
        *times[i] += late_us;
    for (GList *item = board->sent.head; item; item = item->next)
        ((struct gcode_line *)item->data)->sent_us += late_us;
}

static void on_timer(gpointer data) {
    GcodeBoard *board = data;
    const gint64 late_us = clock_now_us(board->clock) - board->due_us;
    board->timer = 0;
    board->ref_count++;
    if (board->fd >= 0)
        read_input(board);
    forgive(board, late_us);
    tick(board);
    deliver(board);
    if (board->phase != CLOSED && board->timer == 0)
        wake(board, board->phase == READY ? IDLE_MS : gcode_board_poll_ms(board, IDLE_MS));
    board_unref(board);
}

static void wake(GcodeBoard *board, double ms) {
    clock_cancel(board->clock, &board->timer);
    board->due_us = clock_now_us(board->clock) + (gint64)(ms * 1000);
    board->timer = clock_call_in(board->clock, (gint64)(ms * 1000), on_timer, board);
}

static gboolean on_input(int fd, GIOCondition condition, gpointer data) {
    GcodeBoard *board = data;
    board->ref_count++;
    read_input(board);
    deliver(board);
    board_unref(board);
    return G_SOURCE_CONTINUE; /* gcode_board_close() removes the source */
}

/* Locks the port. An adapter that was plugged in again may have another device number, and the lock
 * is then replaced. A port that does not exist cannot be opened and needs no lock. */
static gboolean lock_port(GcodeBoard *board, GError **error) {
    g_autofree char *key = lock_key_of_node("serial", board->link.port);
    if (!key || (board->lock && strcmp(lock_key(board->lock), key) == 0))
        return TRUE;
    Lock *lock = lock_take(key, LOCK_ALONE, board->link.port, error);
    if (!lock)
        return FALSE;
    lock_release(board->lock);
    board->lock = lock;
    return TRUE;
}

/* Opens the port and begins to greet the board. */
static gboolean connect_port(GcodeBoard *board, GError **error) {
    if (!lock_port(board, error))
        return FALSE;
    board->fd = serial_port_open(board->link.port, board->link.baud, error);
    if (board->fd < 0)
        return FALSE;
    board->source = g_unix_fd_add(board->fd, G_IO_IN | G_IO_HUP | G_IO_ERR, on_input, board);
    board->phase = GREETING;
    board->n_noise = board->n_at = board->n_wco = board->alarm = board->n_owed = 0;
    board->skips = board->held = FALSE;
    board->heard_us = clock_now_us(board->clock);
    memset(board->limits, 0, sizeof board->limits);
    board->dialect->greet(board);
    wake(board, 0);
    return TRUE;
}

/* Works without the main loop as long as the board stays in `phase`. Returns at until_us at the
 * latest. If stops is not NULL, returns as soon as the stop of that client has ended. */
static void work(GcodeBoard *board, enum phase phase, const GcodeClient *stops, gint64 until_us) {
    while (board->phase == phase && (!stops || stops->stops) &&
           clock_now_us(board->clock) < until_us) {
        struct pollfd fd = {.fd = board->fd, .events = POLLIN};
        if (poll(&fd, 1, WAIT_MS) > 0)
            read_input(board);
        tick(board);
    }
}

static GcodeBoard *board_new(const struct gcode_link *link, const char *key, Clock *clock) {
    static const struct dialect *const dialects[] = {&gcode_grbl, &gcode_marlin, &gcode_klipper};
    GcodeBoard *board = g_new0(GcodeBoard, 1);
    board->key = g_strdup(key);
    board->link = *link;
    board->link.port = g_strdup(link->port);
    board->dialect = dialects[link->dialect];
    board->clock = clock_ref(clock);
    board->clients = g_ptr_array_new();
    board->input = g_string_new(NULL);
    board->fd = -1;
    g_hash_table_insert(boards, board->key, board);
    return board;
}

static GcodeBoard *board_get(const struct gcode_link *link, const struct device *device,
                             GError **error) {
    if (!device_check_real_clock(device, error))
        return NULL;
    if (!boards)
        boards = g_hash_table_new(g_str_hash, g_str_equal);
    g_autofree char *key = modbus_address_name(link->port);
    GcodeBoard *board = g_hash_table_lookup(boards, key);
    if (board && !is_same(&board->link, link)) {
        config_set_error(error, CONFIG_ERROR_VALUE, device->section, "port",
                         "another section opens %s with other settings; make baud, dialect, "
                         "answer_ms and boot_ms the same",
                         link->port);
        return NULL;
    }
    if (!board)
        board = board_new(link, key, device->clock);
    board->ref_count++;
    return board;
}

GcodeClient *gcode_client_new(const struct gcode_link *link, int letter, double poll_ms,
                              const struct device *device, const struct gcode_listener *listener,
                              gpointer data, GError **error) {
    GcodeBoard *board = board_get(link, device, error);
    if (!board)
        return NULL;
    GcodeClient *client = g_new0(GcodeClient, 1);
    client->board = board;
    client->letter = letter;
    client->poll_ms = poll_ms;
    client->listener = listener;
    client->data = data;
    g_ptr_array_add(board->clients, client);
    GError *failed = NULL;
    if (board->phase == CLOSED && !connect_port(board, &failed)) {
        g_propagate_error(error, failed);
        gcode_client_free(client);
        return NULL;
    }
    /* The dialect has deadlines for the greeting. This deadline is for a port that never becomes
     * silent. */
    work(board, GREETING, NULL,
         clock_now_us(board->clock) +
             (gint64)((2 * link->boot_ms + 8 * link->answer_ms + 4000) * 1000));
    if (board->phase == GREETING)
        gcode_board_fail(board, gcode_board_silence(board, link->boot_ms));
    if (board->phase != CLOSED)
        return client;
    g_propagate_error(error, board->failure ? g_error_copy(board->failure)
                                            : gcode_board_silence(board, link->boot_ms));
    gcode_client_free(client);
    return NULL;
}

void gcode_client_free(GcodeClient *client) {
    if (!client)
        return;
    GcodeBoard *board = client->board;
    g_ptr_array_remove(board->clients, client);
    if (board->active == client) { /* close() has already tried to stop its motion */
        board->active = NULL;
        if (board->phase == RUNNING)
            board->phase = READY;
    }
    g_clear_error(&client->error);
    g_free(client);
    board_unref(board);
}

void gcode_client_limits(const GcodeClient *client, struct gcode_limits *ret) {
    *ret = client->board->limits[client->letter];
}

gboolean gcode_client_is_missing(const GcodeClient *client) {
    return client->board->n_at > 0 && client->letter >= client->board->n_at;
}

gboolean gcode_client_is_dragged(const GcodeClient *client) {
    const GcodeClient *active = client->board->active;
    return active && active != client && active->request == HOME_ALL;
}

const char *gcode_client_firmware(const GcodeClient *client) {
    return client->board->firmware;
}

/* Begins a request of the client. Drops the result of an earlier request or stop, because it has
 * lost its meaning. */
static void begin_request(GcodeClient *client, enum request request) {
    client->request = request;
    client->stops = client->has_ended = FALSE;
    g_clear_error(&client->error);
    wake(client->board, 0);
}

gboolean gcode_client_move(GcodeClient *client, double units, double units_s, GError **error) {
    GcodeBoard *board = client->board;
    if (board->killed) {
        g_propagate_error(error, gcode_board_silence(board, 0));
        return FALSE;
    }
    if (board->phase == CLOSED)
        return device_error_set(error, DEVICE_ERROR_DISCONNECTED, NULL,
                                "%s: the board is not connected" ERROR_ADVICE
                                "plug it in, then home it",
                                board->link.port);
    begin_request(client, MOVE);
    client->target = units;
    client->units_s = client->last_units_s = units_s;
    return TRUE;
}

gboolean gcode_client_home(GcodeClient *client, enum gcode_homing homing, GError **error) {
    static const enum request requests[] = {HOME_ALL, HOME_AXIS, HOME_HERE};
    GcodeBoard *board = client->board;
    if (board->phase == CLOSED && !connect_port(board, error))
        return FALSE;
    begin_request(client, requests[homing]);
    client->watched = FALSE;
    return TRUE;
}

gboolean gcode_client_stop(GcodeClient *client, double brake_s, GError **error) {
    GcodeBoard *board = client->board;
    GcodeClient *active = board->active;
    if (board->phase == CLOSED && board->killed) {
        end_client(client, NULL);
        return TRUE;
    }
    if (board->phase == CLOSED && !connect_port(board, error))
        return FALSE;
    const gboolean another = active && active != client;
    begin_request(client, NO_REQUEST);
    client->stops = TRUE;
    client->n_still = 0;
    client->brake_s = brake_s;
    if (another && active->request == MOVE)
        return TRUE; /* gcode_board_check_still() confirms the stop by the reported positions */
    if (another)
        gcode_board_end_request(
            board, device_error_new(DEVICE_ERROR_STALLED, NULL,
                                    "%s: its homing was stopped together with another axis of the "
                                    "board" ERROR_ADVICE "home it",
                                    board->link.port));
    if (board->phase == RUNNING || board->phase == READY) {
        board->active = NULL;
        board->phase = STOPPING;
        board->dialect->stop(board);
    }
    return TRUE;
}

void gcode_client_stop_now(GcodeClient *client, double brake_s) {
    GcodeBoard *board = client->board;
    if (!gcode_client_stop(client, brake_s, NULL))
        return;
    const gint64 until =
        clock_now_us(board->clock) +
        (gint64)((4 * board->link.answer_ms + 1500 * brake_s + board->link.boot_ms) * 1000);
    while (client->stops && board->phase != CLOSED && clock_now_us(board->clock) < until)
        work(board, board->phase, client, until);
}

void gcode_client_report_lost(GcodeClient *client, GError *error) {
    if (client->has_ended || client->has_lost || !client->watched) {
        g_error_free(error);
        return;
    }
    client->watched = FALSE;
    client->has_lost = TRUE;
    client->error = error;
    wake(client->board, 0);
}

void gcode_client_watch(GcodeClient *client, gboolean watched) {
    client->watched = watched;
}
