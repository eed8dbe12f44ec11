#include "leds.h"
#include "terminal.h"

#include <errno.h>
#include <gio/gio.h>
#include <glib-unix.h>
#include <glib/gstdio.h>
#include <poll.h>
#include <string.h>
#include <termios.h>
#include <unistd.h>

#define MAX_REQUEST 31 /* a longer line is dropped, as by the firmware */

struct out {
    gint64 at_us;
    char *text;
};

struct VirtualLeds {
    struct virtual_leds_options options;
    char *folder, *port;
    struct terminal terminal;
    int wake[2];
    GThread *thread;

    GMutex mutex; /* guards the following members */
    gboolean quit, unplugged, was_open;
    struct virtual_leds_faults faults;
    struct virtual_leds_state state;
    guint n_sent, n_received; /* numbers of bytes, for the faults */
    GQueue out;               /* of struct out */
    gint64 deaf_until_us;     /* end of booting; until then, nothing is received */
    gint64 fed_us;
    GString *rx;
};

static void out_free(gpointer data) {
    struct out *out = data;
    g_free(out->text);
    g_free(out);
}

/* Returns the checksum (CRC): the remainder of a polynomial division of the message, followed by 16
 * bits of 0. It is computed bit by bit. To begin with 0xffff, the first 16 bits of the message are
 * inverted, which gives the same result. */
static guint checksum(const char *text) {
    const gsize n = 8 * (strlen(text) + 2);
    guint remainder = 0;
    for (gsize i = 0; i < n; i++) {
        const gsize byte = i / 8;
        guint bit = byte < strlen(text) ? (guint8)text[byte] >> (7 - i % 8) & 1 : 0;
        bit ^= i < 16;
        const guint top = remainder >> 15 & 1;
        remainder = (remainder << 1 | bit) & 0xffff;
        if (top)
            remainder ^= 0x1021;
    }
    return remainder;
}

static void say(VirtualLeds *leds, const char *text) {
    struct out *out = g_new0(struct out, 1);
    out->text = g_strconcat(leds->faults.noise ? "\x7f\xffL1 00zz S 07d0 ff*00\r\n" : "", text,
                            "\r\n", NULL);
    out->at_us = g_get_monotonic_time() + leds->faults.late_ms * (gint64)1000;
    g_queue_push_tail(&leds->out, out);
}

static void answer(VirtualLeds *leds, unsigned number, char kind) {
    g_autoptr(GString) line = g_string_new(NULL);
    g_string_printf(line, "L1 %04x %c %04x ", number, kind, leds->options.dark_ms);
    for (int i = 0; i < leds->options.n; i++)
        g_string_append_printf(line, "%02x", leds->state.levels[i]);
    g_string_append_printf(line, "*%04x", checksum(line->str));
    say(leds, line->str);
}

static void set_level(VirtualLeds *leds, int i, int level) {
    const guint64 bit = G_GUINT64_CONSTANT(1) << i;
    if ((level == 0 && leds->faults.stuck & bit) || (level > 0 && leds->faults.dead & bit))
        return;
    leds->state.levels[i] = (guint8)level;
    leds->state.lit = FALSE;
    for (int k = 0; k < leds->options.n; k++)
        leds->state.lit |= leds->state.levels[k] > 0;
}

static void all_off(VirtualLeds *leds) {
    for (int i = 0; i < leds->options.n; i++)
        set_level(leds, i, 0);
}

static void execute(VirtualLeds *leds, char *line) {
    unsigned number, sum, lamp, level;
    char command, rest;
    char *star = strrchr(line, '*');
    if (!star || strlen(star) != 5 || sscanf(star + 1, "%4x%c", &sum, &rest) != 1) {
        leds->state.n_damaged++;
        return;
    }
    *star = 0;
    if (sum != checksum(line) || sscanf(line, "L1 %4x %c", &number, &command) != 2) {
        leds->state.n_damaged++;
        return;
    }
    leds->state.n_requests++;
    leds->fed_us = g_get_monotonic_time();
    if (command == 'p') {
        leds->state.n_pings++;
        answer(leds, number, 'P');
    } else if (command == 'o') {
        leds->state.n_offs++;
        all_off(leds);
        answer(leds, number, 'O');
    } else if (command == 's' && sscanf(line + 9, " %2x %2x%c", &lamp, &level, &rest) == 2 &&
               (int)lamp < leds->options.n) {
        leds->state.n_sets++;
        set_level(leds, (int)lamp, (int)level);
        answer(leds, number, 'S');
    } else {
        leds->state.n_refused++;
        answer(leds, number, 'E');
    }
}

static void receive(VirtualLeds *leds, const char *bytes, gsize n) {
    for (gsize i = 0; i < n; i++) {
        char byte = bytes[i];
        const guint count = ++leds->n_received;
        const struct virtual_leds_faults *faults = &leds->faults;
        if (faults->cut || g_get_monotonic_time() < leds->deaf_until_us ||
            (faults->lose_received > 0 && count % (guint)faults->lose_received == 0))
            continue;
        if (faults->damage_received > 0 && count % (guint)faults->damage_received == 0)
            byte ^= 0x01;
        if (byte != '\n' && byte != '\r') {
            g_string_append_c(leds->rx, byte);
            continue;
        }
        if (leds->rx->len > MAX_REQUEST)
            leds->state.n_damaged++;
        else if (leds->rx->len > 0)
            execute(leds, leds->rx->str);
        g_string_truncate(leds->rx, 0);
    }
}

static void boot(VirtualLeds *leds) {
    const guint64 stuck = leds->faults.stuck;
    /* all outputs are dark in a reset, so the fault `stuck` does not apply meanwhile */
    leds->faults.stuck = 0;
    all_off(leds);
    leds->faults.stuck = stuck;
    leds->state.n_resets++;
    g_string_truncate(leds->rx, 0);
    g_queue_clear_full(&leds->out, out_free);
    leds->deaf_until_us = g_get_monotonic_time() + leds->options.boot_ms * (gint64)1000;
    answer(leds, 0, 'R');
    ((struct out *)g_queue_peek_tail(&leds->out))->at_us = leds->deaf_until_us;
}

/* Sends the lines whose time has come, changed by the faults that are set. */
static void flush_out(VirtualLeds *leds) {
    struct out *out;
    const struct virtual_leds_faults *faults = &leds->faults;
    while ((out = g_queue_peek_head(&leds->out)) && out->at_us <= g_get_monotonic_time()) {
        g_autoptr(GString) bytes = g_string_new(NULL);
        g_queue_pop_head(&leds->out);
        for (const char *at = out->text; *at; at++) {
            const guint count = ++leds->n_sent;
            if (faults->lose_sent > 0 && count % (guint)faults->lose_sent == 0)
                continue;
            const gboolean damaged =
                faults->damage_sent > 0 && count % (guint)faults->damage_sent == 0;
            g_string_append_c(bytes, damaged ? (char)(*at ^ 0x01) : *at);
        }
        if (!faults->cut && !faults->silent && leds->terminal.wire >= 0 &&
            write(leds->terminal.wire, bytes->str, bytes->len) < 0)
            tcflush(leds->terminal.wire, TCIOFLUSH);
        out_free(out);
    }
}

static gboolean open_wire(VirtualLeds *leds) {
    leds->was_open = FALSE;
    return terminal_open(&leds->terminal, leds->port, leds->options.resets_on_open);
}

static void serve(VirtualLeds *leds, short events) {
    char bytes[512];
    const gboolean is_open = !(events & POLLHUP);
    if (leds->options.resets_on_open && is_open && !leds->was_open)
        boot(leds);
    leds->was_open = is_open;
    for (gssize n;
         leds->terminal.wire >= 0 && (n = read(leds->terminal.wire, bytes, sizeof bytes)) > 0;)
        receive(leds, bytes, (gsize)n);
    if (leds->state.lit &&
        g_get_monotonic_time() - leds->fed_us > leds->options.dark_ms * (gint64)1000) {
        all_off(leds);
        leds->state.n_watchdog += !leds->state.lit;
    }
    flush_out(leds);
}

static gpointer leds_run(gpointer data) {
    VirtualLeds *leds = data;
    gboolean quit = FALSE;
    while (!quit) {
        char byte;
        g_mutex_lock(&leds->mutex);
        const gboolean busy =
            leds->state.lit || !g_queue_is_empty(&leds->out) || leds->options.resets_on_open;
        struct pollfd fds[] = {{leds->wake[0], POLLIN, 0}, {leds->terminal.wire, POLLIN, 0}};
        g_mutex_unlock(&leds->mutex);
        if (poll(fds, G_N_ELEMENTS(fds), busy ? 2 : 20) < 0 && errno != EINTR)
            return NULL;
        if (fds[0].revents && read(leds->wake[0], &byte, 1) < 0)
            return NULL;
        /* While no program has the port open, poll() returns at once, so a pause is made. */
        if (fds[1].revents & POLLHUP)
            g_usleep(1000);
        g_mutex_lock(&leds->mutex);
        if (leds->unplugged)
            terminal_unplug(&leds->terminal);
        else if (leds->terminal.wire < 0 && !open_wire(leds))
            g_warning("virtual LED controller: no pseudo-terminal can be opened: %s",
                      g_strerror(errno));
        serve(leds, leds->terminal.wire == fds[1].fd ? fds[1].revents : POLLHUP);
        quit = leds->quit;
        g_mutex_unlock(&leds->mutex);
    }
    return NULL;
}

VirtualLeds *virtual_leds_new(const struct virtual_leds_options *options, GError **error) {
    g_autofree char *folder = g_dir_make_tmp("mesorig-leds-XXXXXX", error);
    if (!folder)
        return NULL;
    VirtualLeds *leds = g_new0(VirtualLeds, 1);
    leds->options = *options;
    leds->folder = g_steal_pointer(&folder);
    leds->port = g_build_filename(leds->folder, "port", NULL);
    leds->terminal = (struct terminal)TERMINAL_CLOSED;
    leds->rx = g_string_new(NULL);
    g_mutex_init(&leds->mutex);
    boot(leds);
    leds->state.n_resets = 0;
    if (!g_unix_open_pipe(leds->wake, FD_CLOEXEC, error)) {
        leds->wake[0] = leds->wake[1] = -1;
    } else if (!open_wire(leds)) {
        g_set_error(
            error, G_IO_ERROR, g_io_error_from_errno(errno),
            "virtual LED controller: no pseudo-terminal can be opened: %s; close other programs",
            g_strerror(errno));
    } else {
        leds->thread = g_thread_new("virtual-leds", leds_run, leds);
        return leds;
    }
    virtual_leds_free(leds);
    return NULL;
}

static void wake(VirtualLeds *leds) {
    if (write(leds->wake[1], "", 1) < 0)
        g_warning("virtual LED controller: the controller's thread cannot be woken: %s",
                  g_strerror(errno));
}

void virtual_leds_free(VirtualLeds *leds) {
    if (!leds)
        return;
    if (leds->thread) {
        g_mutex_lock(&leds->mutex);
        leds->quit = TRUE;
        g_mutex_unlock(&leds->mutex);
        wake(leds);
        g_thread_join(leds->thread);
    }
    terminal_close(&leds->terminal);
    for (int i = 0; i < 2; i++)
        if (leds->wake[i] >= 0)
            close(leds->wake[i]);
    g_queue_clear_full(&leds->out, out_free);
    g_string_free(leds->rx, TRUE);
    g_unlink(leds->port);
    g_rmdir(leds->folder);
    g_mutex_clear(&leds->mutex);
    g_free(leds->port);
    g_free(leds->folder);
    g_free(leds);
}

const char *virtual_leds_port(const VirtualLeds *leds) {
    return leds->port;
}

void virtual_leds_fail(VirtualLeds *leds, const struct virtual_leds_faults *faults) {
    g_mutex_lock(&leds->mutex);
    leds->faults = *faults;
    g_mutex_unlock(&leds->mutex);
}

void virtual_leds_reset(VirtualLeds *leds) {
    g_mutex_lock(&leds->mutex);
    boot(leds);
    g_mutex_unlock(&leds->mutex);
    wake(leds);
}

static void set_unplugged(VirtualLeds *leds, gboolean unplugged) {
    g_mutex_lock(&leds->mutex);
    leds->unplugged = unplugged;
    g_mutex_unlock(&leds->mutex);
    wake(leds);
    /* Wait until the thread has opened or closed the wire. */
    for (gboolean done = FALSE; !done; g_usleep(1000)) {
        g_mutex_lock(&leds->mutex);
        done = (leds->terminal.wire < 0) == unplugged;
        g_mutex_unlock(&leds->mutex);
    }
}

void virtual_leds_unplug(VirtualLeds *leds) {
    set_unplugged(leds, TRUE);
}

void virtual_leds_plug(VirtualLeds *leds) {
    set_unplugged(leds, FALSE);
}

void virtual_leds_send(VirtualLeds *leds, const char *line) {
    g_mutex_lock(&leds->mutex);
    say(leds, line);
    g_mutex_unlock(&leds->mutex);
    wake(leds);
}

void virtual_leds_receive(VirtualLeds *leds, const char *bytes) {
    g_mutex_lock(&leds->mutex);
    receive(leds, bytes, strlen(bytes));
    g_mutex_unlock(&leds->mutex);
    wake(leds);
}

void virtual_leds_state(VirtualLeds *leds, struct virtual_leds_state *ret) {
    g_mutex_lock(&leds->mutex);
    *ret = leds->state;
    g_mutex_unlock(&leds->mutex);
}
