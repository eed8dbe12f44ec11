#include "gcode_private.h"

#include <errno.h>
#include <gio/gio.h>
#include <glib-unix.h>
#include <glib/gstdio.h>
#include <math.h>
#include <poll.h>
#include <string.h>
#include <termios.h>
#include <unistd.h>

#define MIN_HOMING_US 20000

struct gcode_out {
    gint64 at_us;
    char *text;
};

static void out_free(gpointer data) {
    struct gcode_out *out = data;
    g_free(out->text);
    g_free(out);
}

void gcode_say(VirtualGcode *board, const char *format, ...) {
    va_list args;
    struct gcode_out *out = g_new0(struct gcode_out, 1);
    va_start(args, format);
    g_autofree char *text = g_strdup_vprintf(format, args);
    va_end(args);
    out->text =
        g_strconcat(board->faults.noise ? "\x7f\xffzz<Idle|MPos:1.2\r\n" : "", text, "\r\n", NULL);
    out->at_us = g_get_monotonic_time() + board->faults.late_ms * (gint64)1000;
    if (board->faults.late_ok_ms > 0 && g_str_has_prefix(text, "ok")) {
        board->late_until_us = out->at_us + board->faults.late_ok_ms * (gint64)1000;
        board->faults.late_ok_ms = 0;
    }
    out->at_us = MAX(out->at_us, board->late_until_us);
    g_queue_push_tail(&board->out, out);
}

/* Sends the lines whose time has come, changed by the faults that are set. */
static void flush_out(VirtualGcode *board) {
    struct gcode_out *out;
    while ((out = g_queue_peek_head(&board->out)) && out->at_us <= g_get_monotonic_time()) {
        g_autoptr(GString) bytes = g_string_new(NULL);
        g_queue_pop_head(&board->out);
        for (const char *at = out->text; *at; at++) {
            board->n_sent++;
            if (board->faults.lose_sent > 0 && board->n_sent % (guint)board->faults.lose_sent == 0)
                continue;
            const gboolean damaged = board->faults.damage_sent > 0 &&
                                     board->n_sent % (guint)board->faults.damage_sent == 0;
            g_string_append_c(bytes, damaged ? (char)(*at ^ 0x15) : *at);
        }
        if (!board->faults.cut && !board->faults.silent && board->terminal.wire >= 0 &&
            write(board->terminal.wire, bytes->str, bytes->len) < 0)
            tcflush(board->terminal.wire, TCIOFLUSH);
        out_free(out);
    }
}

static double travelled(double way, double v, double a, double t) {
    if (t <= 0)
        return 0;
    v = MIN(v, sqrt(a * way));
    const double ramp = v / a, left = MAX(0, way / v + ramp - t);
    if (t <= ramp)
        return a * t * t / 2;
    return left <= ramp ? way - a * left * left / 2 : v * (t - ramp / 2);
}

/* Returns the duration of a motion over `way` with the top speed v and the acceleration a, as
 * travelled() describes it. */
static double duration_s(double way, double v, double a) {
    return way >= v * v / a ? way / v + v / a : 2 * sqrt(way / a);
}

/* Returns the distance travelled since the motion began. */
static double travelled_at(const VirtualGcode *board, gint64 now_us) {
    const double t = (double)(now_us - board->start_us) * 1e-6;
    if (now_us >= board->end_us)
        return board->way;
    return board->motion == GCODE_BRAKING
               ? board->units_s * t - board->units_s2 * t * t / 2
               : travelled(board->way, board->units_s, board->units_s2, t);
}

double gcode_speed(const VirtualGcode *board, gint64 now_us) {
    if (board->motion != GCODE_MOVING && board->motion != GCODE_BRAKING &&
        board->motion != GCODE_HOMING)
        return 0;
    return (travelled_at(board, now_us + 500) - travelled_at(board, now_us - 500)) * 1e3;
}

static void begin_block(VirtualGcode *board, gint64 start_us) {
    const struct gcode_block *block = &board->blocks[0];
    double square = 0;
    for (int i = 0; i < board->options.n_axes; i++) {
        board->from[i] = board->state.at[i];
        board->to[i] = block->to[i];
        square += pow(board->to[i] - board->from[i], 2);
    }
    const double v = MIN(block->units_s, board->options.units_s), a = board->options.units_s2;
    board->way = sqrt(square);
    board->units_s = v;
    board->units_s2 = a;
    board->motion = GCODE_MOVING;
    board->start_us = start_us;
    board->end_us = start_us + (gint64)(duration_s(board->way, v, a) * 1e6);
}

static void pop_block(VirtualGcode *board) {
    board->n_blocks--;
    memmove(board->blocks, board->blocks + 1, (gsize)board->n_blocks * sizeof *board->blocks);
}

/* Updates the position to the present time. When a block has ended, begins the next block. */
static void advance(VirtualGcode *board) {
    const gint64 now = g_get_monotonic_time();
    for (;;) {
        if (board->motion == GCODE_STANDING && board->n_blocks > 0)
            begin_block(board, now);
        if (board->motion == GCODE_STANDING || board->motion == GCODE_HELD)
            return;
        const double part = board->way > 0 ? travelled_at(board, now) / board->way : 1;
        for (int i = 0; i < board->options.n_axes; i++)
            board->state.at[i] = board->from[i] + part * (board->to[i] - board->from[i]);
        if (now < board->end_us)
            return;
        const enum gcode_motion ended = board->motion;
        board->motion = GCODE_STANDING;
        if (ended == GCODE_BRAKING)
            board->motion = GCODE_HELD;
        else if (ended == GCODE_MOVING)
            pop_block(board);
        else
            board->language->homing_ended(board);
    }
}

void gcode_planned(const VirtualGcode *board, double *ret) {
    const gsize size = sizeof board->state.at;
    memcpy(ret, board->n_blocks > 0 ? board->blocks[board->n_blocks - 1].to : board->state.at,
           size);
}

void gcode_add_block(VirtualGcode *board, const double *to, double units_s) {
    g_return_if_fail(board->n_blocks < GCODE_BLOCKS);
    struct gcode_block *block = &board->blocks[board->n_blocks++];
    memcpy(block->to, to, sizeof block->to);
    /* Round to whole steps of the motor. */
    for (int i = 0; i < board->options.n_axes; i++)
        block->to[i] = round(to[i] * board->options.steps) / board->options.steps;
    block->units_s = units_s;
    advance(board);
}

gboolean gcode_extend(VirtualGcode *board, const double *to, double units_s, gint64 delay_us) {
    const gint64 now = g_get_monotonic_time();
    advance(board);
    if (board->motion == GCODE_STANDING && board->n_blocks == 0) {
        gcode_add_block(board, to, units_s);
        if (board->motion == GCODE_MOVING) {
            board->start_us += delay_us;
            board->end_us += delay_us;
        }
        return TRUE;
    }
    double square = 0, along = 0;
    for (int i = 0; i < board->options.n_axes; i++) {
        square += pow(to[i] - board->from[i], 2);
        along += (to[i] - board->to[i]) * (board->to[i] - board->from[i]);
    }
    /* The motion can be prolonged if braking has not begun, if the new end lies further in the
     * direction of the motion, and if the speed is the same. */
    const gint64 ramp_us =
        (gint64)(MIN(board->units_s / board->units_s2, sqrt(board->way / board->units_s2)) * 1e6);
    if (board->motion != GCODE_MOVING || along < 0 || now > board->end_us - ramp_us ||
        units_s != board->blocks[0].units_s)
        return FALSE;
    memcpy(board->to, to, sizeof board->to);
    memcpy(board->blocks[0].to, to, sizeof board->blocks[0].to);
    board->way = sqrt(square);
    board->end_us =
        board->start_us + (gint64)(duration_s(board->way, board->units_s, board->units_s2) * 1e6);
    return TRUE;
}

void gcode_brake(VirtualGcode *board) {
    const gint64 now = g_get_monotonic_time();
    advance(board);
    if (board->motion != GCODE_MOVING) {
        if (board->motion == GCODE_STANDING)
            board->motion = GCODE_HELD;
        return;
    }
    const double v = MAX(gcode_speed(board, now), 0), a = board->options.units_s2;
    double left = 0;
    for (int i = 0; i < board->options.n_axes; i++)
        left += pow(board->to[i] - board->state.at[i], 2);
    left = sqrt(left);
    const double way = MIN(v * v / (2 * a), left);
    for (int i = 0; i < board->options.n_axes; i++) {
        board->from[i] = board->state.at[i];
        board->to[i] = left > 0 ? board->from[i] + way / left * (board->to[i] - board->from[i])
                                : board->from[i];
    }
    board->way = way;
    board->units_s = v;
    board->units_s2 = way > 0 ? v * v / (2 * way) : a;
    board->motion = GCODE_BRAKING;
    board->start_us = now;
    board->end_us = now + (v > 0 ? (gint64)(v / board->units_s2 * 1e6) : 0);
}

void gcode_resume(VirtualGcode *board) {
    if (board->motion == GCODE_HELD)
        board->motion = GCODE_STANDING; /* advance() begins the rest of the block */
}

gboolean gcode_abort(VirtualGcode *board) {
    advance(board);
    const gboolean moved = board->motion == GCODE_MOVING || board->motion == GCODE_BRAKING ||
                           board->motion == GCODE_HOMING;
    board->motion = GCODE_STANDING;
    board->n_blocks = 0;
    board->state.n_aborted += moved;
    return moved;
}

void gcode_begin_homing(VirtualGcode *board, guint axes) {
    const gint64 now = g_get_monotonic_time();
    const double v = board->options.units_s, a = board->options.units_s2;
    double square = 0;
    for (int i = 0; i < board->options.n_axes; i++) {
        board->from[i] = board->state.at[i];
        board->to[i] = axes >> i & 1 ? board->options.home_at : board->from[i];
        square += pow(board->to[i] - board->from[i], 2);
    }
    const double s = duration_s(MAX(sqrt(square), board->options.switch_way), v, a);
    board->way = sqrt(square);
    board->units_s = v;
    board->units_s2 = a;
    board->motion = GCODE_HOMING;
    board->homing_axes = axes;
    board->start_us = now;
    board->end_us = now + MAX((gint64)(s * 1e6), MIN_HOMING_US);
    board->state.n_homings++;
}

/* Moves the first complete received line to ret. Returns FALSE if there is none. */
gboolean gcode_take_line(VirtualGcode *board, char *ret, gsize size) {
    const char *end = strpbrk(board->rx->str, "\r\n");
    if (!end)
        return FALSE;
    const gsize n = (gsize)(end - board->rx->str);
    g_autofree char *line = g_strndup(board->rx->str, n);
    g_string_erase(board->rx, 0, (gssize)n + 1);
    g_strlcpy(ret, line, size);
    return TRUE;
}

static void boot(VirtualGcode *board, gboolean power) {
    gcode_abort(board);
    g_string_truncate(board->rx, 0);
    board->waits = FALSE;
    board->n_unanswered = 0;
    board->deaf_until_us = g_get_monotonic_time() + board->options.boot_ms * (gint64)1000;
    g_queue_clear_full(&board->out, out_free);
    board->language->boot(board, power);
    for (GList *item = board->out.head; item; item = item->next)
        ((struct gcode_out *)item->data)->at_us = board->deaf_until_us;
}

static void receive(VirtualGcode *board, const char *bytes, gssize n) {
    for (gssize i = 0; i < n; i++) {
        board->n_received++;
        if (board->faults.cut || g_get_monotonic_time() < board->deaf_until_us ||
            (board->faults.lose_received > 0 &&
             board->n_received % (guint)board->faults.lose_received == 0))
            continue;
        board->language->receive(board, bytes[i]);
    }
}

static gboolean open_wire(VirtualGcode *board) {
    board->was_open = FALSE;
    return terminal_open(&board->terminal, board->port, board->options.resets_on_open);
}

/* Resets a board with the option resets_on_open when a program opens the port. */
static void watch_opening(VirtualGcode *board, short events) {
    const gboolean is_open = !(events & POLLHUP);
    if (board->options.resets_on_open && is_open && !board->was_open)
        boot(board, TRUE);
    board->was_open = is_open;
}

static void serve(VirtualGcode *board, short events) {
    char bytes[512];
    watch_opening(board, events);
    advance(board);
    for (gssize n;
         board->terminal.wire >= 0 && (n = read(board->terminal.wire, bytes, sizeof bytes)) > 0;)
        receive(board, bytes, n);
    advance(board);
    if (g_get_monotonic_time() >= board->deaf_until_us)
        board->language->work(board);
    flush_out(board);
}

static gpointer gcode_run(gpointer data) {
    VirtualGcode *board = data;
    gboolean quit = FALSE;
    while (!quit) {
        char byte;
        g_mutex_lock(&board->mutex);
        const gboolean busy = board->motion != GCODE_STANDING || board->waits ||
                              board->rx->len > 0 || !g_queue_is_empty(&board->out) ||
                              board->options.resets_on_open;
        struct pollfd fds[] = {{board->wake[0], POLLIN, 0}, {board->terminal.wire, POLLIN, 0}};
        g_mutex_unlock(&board->mutex);
        if (poll(fds, G_N_ELEMENTS(fds), busy ? 1 : 20) < 0 && errno != EINTR)
            return NULL;
        if (fds[0].revents && read(board->wake[0], &byte, 1) < 0)
            return NULL;
        /* While no program has the port open, poll() returns at once, so a pause is made. */
        if (fds[1].revents & POLLHUP)
            g_usleep(1000);
        g_mutex_lock(&board->mutex);
        serve(board, fds[1].revents);
        quit = board->quit;
        g_mutex_unlock(&board->mutex);
    }
    return NULL;
}

static void wake(VirtualGcode *board) {
    if (write(board->wake[1], "", 1) < 0)
        g_warning("virtual G-code board: the board's thread cannot be woken: %s",
                  g_strerror(errno));
}

VirtualGcode *virtual_gcode_new(const struct virtual_gcode_options *options, GError **error) {
    static const struct gcode_language *const languages[] = {
        &gcode_language_grbl, &gcode_language_marlin, &gcode_language_klipper};
    VirtualGcode *board = g_new0(VirtualGcode, 1);
    board->options = *options;
    board->language = languages[options->language];
    board->terminal = (struct terminal)TERMINAL_CLOSED;
    board->wake[0] = board->wake[1] = -1;
    board->rx = g_string_new(NULL);
    g_mutex_init(&board->mutex);
    board->folder = g_dir_make_tmp("mesorig-gcode-XXXXXX", error);
    board->port = board->folder ? g_build_filename(board->folder, "port", NULL) : NULL;
    if (!board->folder || !g_unix_open_pipe(board->wake, FD_CLOEXEC, error)) {
        virtual_gcode_free(board);
        return NULL;
    }
    if (!open_wire(board)) {
        g_set_error(
            error, G_IO_ERROR, g_io_error_from_errno(errno),
            "virtual G-code board: no pseudo-terminal can be opened: %s; close other programs",
            g_strerror(errno));
        virtual_gcode_free(board);
        return NULL;
    }
    boot(board, TRUE);
    board->deaf_until_us = 0;
    /* A real board starts before a program opens its port, so the program does not see the
     * greeting. */
    g_queue_clear_full(&board->out, out_free);
    board->thread = g_thread_new("virtual-gcode", gcode_run, board);
    return board;
}

void virtual_gcode_free(VirtualGcode *board) {
    if (!board)
        return;
    if (board->thread) {
        g_mutex_lock(&board->mutex);
        board->quit = TRUE;
        g_mutex_unlock(&board->mutex);
        wake(board);
        g_thread_join(board->thread);
    }
    terminal_close(&board->terminal);
    for (int i = 0; i < 2; i++)
        if (board->wake[i] >= 0)
            close(board->wake[i]);
    if (board->port)
        g_unlink(board->port);
    if (board->folder)
        g_rmdir(board->folder);
    g_queue_clear_full(&board->out, out_free);
    g_string_free(board->rx, TRUE);
    g_mutex_clear(&board->mutex);
    g_free(board->folder);
    g_free(board->port);
    g_free(board);
}

const char *virtual_gcode_port(const VirtualGcode *board) {
    return board->port;
}

void virtual_gcode_fail(VirtualGcode *board, const struct virtual_gcode_faults *faults) {
    g_mutex_lock(&board->mutex);
    board->faults = *faults;
    g_mutex_unlock(&board->mutex);
}

void virtual_gcode_press(VirtualGcode *board, int axis, gboolean pressed) {
    g_mutex_lock(&board->mutex);
    board->pressed[axis] = pressed;
    if (pressed && board->options.language == VIRTUAL_GRBL)
        grbl_press(board);
    g_mutex_unlock(&board->mutex);
    wake(board);
}

void virtual_gcode_set_door(VirtualGcode *board, gboolean open) {
    g_mutex_lock(&board->mutex);
    board->door = open;
    grbl_set_door(board);
    g_mutex_unlock(&board->mutex);
    wake(board);
}

void virtual_gcode_press_hold(VirtualGcode *board) {
    virtual_gcode_receive(board, "!");
}

void virtual_gcode_reset(VirtualGcode *board) {
    g_mutex_lock(&board->mutex);
    boot(board, TRUE);
    g_mutex_unlock(&board->mutex);
    wake(board);
}

void virtual_gcode_unplug(VirtualGcode *board) {
    g_mutex_lock(&board->mutex);
    terminal_unplug(&board->terminal);
    g_unlink(board->port);
    g_mutex_unlock(&board->mutex);
    wake(board);
}

void virtual_gcode_plug(VirtualGcode *board) {
    g_mutex_lock(&board->mutex);
    if (!open_wire(board))
        g_warning("virtual G-code board: no pseudo-terminal can be opened: %s", g_strerror(errno));
    g_mutex_unlock(&board->mutex);
    wake(board);
}

void virtual_gcode_push(VirtualGcode *board, int axis, double units) {
    g_mutex_lock(&board->mutex);
    board->state.at[axis] += units;
    g_mutex_unlock(&board->mutex);
}

void virtual_gcode_send(VirtualGcode *board, const char *line) {
    g_mutex_lock(&board->mutex);
    gcode_say(board, "%s", line);
    g_mutex_unlock(&board->mutex);
    wake(board);
}

void virtual_gcode_receive(VirtualGcode *board, const char *bytes) {
    g_mutex_lock(&board->mutex);
    receive(board, bytes, (gssize)strlen(bytes));
    g_mutex_unlock(&board->mutex);
    wake(board);
}

void virtual_gcode_state(VirtualGcode *board, struct virtual_gcode_state *ret) {
    g_mutex_lock(&board->mutex);
    advance(board);
    board->state.moving = board->motion != GCODE_STANDING && board->motion != GCODE_HELD;
    board->state.alarm = board->alarm != 0;
    *ret = board->state;
    g_mutex_unlock(&board->mutex);
}
