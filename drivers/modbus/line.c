#include "line.h"

#include "address.h"
#include "drivers/recording.h"
#include "serial.h"

#include <errno.h>
#include <gio/gio.h>
#include <linux/sockios.h>
#include <modbus/modbus.h>
#include <poll.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#define FIRST_BACKOFF_US 50000
/* Longest pause between two attempts to connect. It is shorter than the time limit of a job, so
 * that each job makes an attempt. */
#define MAX_BACKOFF_US 1000000
#define BUSY_PAUSE_US  20000
/* Longest time that an attempt with MODBUS_ONCE waits for a TCP connection. If the first packet is
 * lost, the kernel repeats it only after 1 s, which is too late for an "off". Every eighth attempt
 * waits until the deadline, because the host may be far away. */
#define QUICK_CONNECT_US 400000
#define PATIENT_EVERY    8
/* Silence, in ms, after which no more bytes of a damaged answer are expected. It is longer than 3.5
 * characters at 300 baud. */
#define SILENCE_MS 20

struct modbus_line {
    struct modbus_link link;
    modbus_t *context;
    /* Lock of a serial line. The line keeps the lock while it is disconnected. NULL for TCP, and
     * for a line that was never connected. */
    Lock *lock;
    /* A second descriptor of a serial line. Its lock keeps other programs away. -1 if there is
     * none. */
    int taken;
    gboolean connected;
    gboolean owed; /* the answer to an earlier request may still come */
    gint64 backoff_us, next_attempt_us;
    enum modbus_effort effort;
    const gint *waiting; /* atomic; see modbus_line_set_effort() */
    guint n_quick;       /* failed attempts with MODBUS_ONCE since the last connection */
    struct modbus_counts counts;
};

static gboolean is_tcp(const struct modbus_line *line) {
    return modbus_is_tcp(line->link.bus);
}

static void set_timeout(struct modbus_line *line, gint64 us) {
    us = CLAMP(us, 1000, 60 * G_USEC_PER_SEC);
    modbus_set_response_timeout(line->context, (guint32)(us / G_USEC_PER_SEC),
                                (guint32)(us % G_USEC_PER_SEC));
}

struct modbus_line *modbus_line_new(const struct modbus_link *link, GError **error) {
    struct modbus_line *line = g_new0(struct modbus_line, 1);
    line->link = *link;
    line->link.bus = g_strdup(link->bus);
    line->backoff_us = FIRST_BACKOFF_US;
    line->taken = -1;
    if (is_tcp(line)) {
        g_autoptr(GSocketConnectable) address = g_network_address_parse(link->bus + 4, 502, NULL);
        GNetworkAddress *network = (GNetworkAddress *)address;
        g_autofree char *port =
            g_strdup_printf("%u", network ? g_network_address_get_port(network) : 0);
        if (network)
            line->context = modbus_new_tcp_pi(g_network_address_get_hostname(network), port);
    } else {
        line->context =
            modbus_new_rtu(link->bus, link->baud, "NEO"[link->parity], 8, link -> stop_bits);
    }
    if (line->context) {
        guint32 us = (guint32)(link->timeout_ms * 1000);
        modbus_set_byte_timeout(line->context, us / G_USEC_PER_SEC, us % G_USEC_PER_SEC);
        return line;
    }
    device_error_set(error, DEVICE_ERROR_DISCONNECTED, NULL,
                     "\"%s\" is not a Modbus line" ERROR_ADVICE "write /dev/NAME or tcp:HOST:PORT",
                     link->bus);
    modbus_line_free(line);
    return NULL;
}

static void line_let_go(struct modbus_line *line) {
    if (line->taken >= 0)
        close(line->taken);
    line->taken = -1;
}

void modbus_line_set_effort(struct modbus_line *line, enum modbus_effort effort,
                            const gint *waiting) {
    line->effort = effort;
    line->waiting = waiting;
}

static void line_disconnect(struct modbus_line *line) {
    if (line->connected)
        modbus_close(line->context);
    line_let_go(line);
    line->connected = line->owed = FALSE;
}

void modbus_line_free(struct modbus_line *line) {
    if (!line)
        return;
    line_disconnect(line);
    lock_release(line->lock);
    if (line->context)
        modbus_free(line->context);
    g_free(line->link.bus);
    g_free(line);
}

/* Locks a serial line. An adapter that was plugged in again may have another device number, and
 * the lock is then replaced. A port that does not exist needs no lock, because it cannot be opened.
 */
static gboolean lock_serial(struct modbus_line *line, GError **error) {
    g_autofree char *key = lock_key_of_node("serial", line->link.bus);
    if (!key || (line->lock && strcmp(lock_key(line->lock), key) == 0))
        return TRUE;
    Lock *lock = lock_take(key, LOCK_ALONE, line->link.bus, error);
    if (!lock)
        return FALSE;
    lock_release(line->lock);
    line->lock = lock;
    return TRUE;
}

/* Opens a serial line. If libmodbus fails with EINVAL, changes the settings of the line and tries
 * again (modbus_serial_unsettle()). Returns -1 and sets errno on failure. */
static int open_serial(struct modbus_line *line) {
    line->taken = modbus_serial_take(line->link.bus);
    if (line->taken < 0)
        return -1;
    int done = modbus_connect(line->context);
    if (done < 0 && errno == EINVAL) {
        modbus_serial_unsettle(line->taken);
        done = modbus_connect(line->context);
    }
    int why = errno;
    if (done < 0)
        line_let_go(line);
    errno = why;
    return done;
}

static void back_off(struct modbus_line *line) {
    line->next_attempt_us = g_get_monotonic_time() + line->backoff_us;
    line->backoff_us = MIN(2 * line->backoff_us, MAX_BACKOFF_US);
}

static gboolean try_connect(struct modbus_line *line, gint64 deadline_us, GError **error) {
    if (!is_tcp(line) && !lock_serial(line, error)) {
        back_off(line);
        return FALSE;
    }
    gint64 now = g_get_monotonic_time();
    gboolean quick = line->effort == MODBUS_ONCE && ++line->n_quick % PATIENT_EVERY != 0;
    set_timeout(line, quick ? MIN(deadline_us - now, QUICK_CONNECT_US) : deadline_us - now);
    errno = 0;
    if ((is_tcp(line) ? modbus_connect(line->context) : open_serial(line)) == 0) {
        line->connected = TRUE;
        line->backoff_us = FIRST_BACKOFF_US;
        line->n_quick = 0;
        modbus_flush(line->context);
        return TRUE;
    }
    int why = errno;
    /* libmodbus does not set errno for an unknown host name: `why` is then 0, or the errno of the
     * attempt before. */
    back_off(line);
    if (why == EWOULDBLOCK && !is_tcp(line)) {
        g_autofree char *holder = modbus_serial_holder(line->link.bus);
        const gboolean daemon = holder && g_str_has_prefix(holder, "mesorigd ");
        return device_error_set(
            error, DEVICE_ERROR_BUSY, NULL, "cannot open %s: %s uses it" ERROR_ADVICE "%s",
            line->link.bus, holder ? holder : "another program",
            daemon ? "use that daemon instead (commands find it by --address or --bus), or end it"
                   : "end that program");
    }
    return device_error_set(error, DEVICE_ERROR_DISCONNECTED, NULL,
                            "cannot open %s: %s" ERROR_ADVICE "check %s", line->link.bus,
                            why ? modbus_strerror(why) : "no such host",
                            is_tcp(line) ? "address, power and network cable"
                                         : "its name, its cable and who may use it");
}

gboolean modbus_line_connect(struct modbus_line *line, gint64 deadline_us, GError **error) {
    g_autoptr(GError) last = NULL;
    if (line->effort == MODBUS_ONCE && !line->connected)
        return try_connect(line, deadline_us, error);
    while (!line->connected) {
        gint64 now = g_get_monotonic_time();
        /* Make at least one attempt, even if this program was suspended until the deadline. */
        if ((last || line->next_attempt_us > now) &&
            MAX(now, line->next_attempt_us) >= deadline_us) {
            if (last)
                g_propagate_error(error, g_steal_pointer(&last));
            else
                device_error_set(
                    error, DEVICE_ERROR_DISCONNECTED, NULL,
                    "there is no connection to %s; the next attempt follows later" ERROR_ADVICE
                    "check the device's power and cable",
                    line->link.bus);
            return FALSE;
        }
        if (line->next_attempt_us > now)
            g_usleep((gulong)(line->next_attempt_us - now));
        g_clear_error(&last);
        try_connect(line, deadline_us, &last);
    }
    return TRUE;
}

static gboolean line_is_readable(struct modbus_line *line, int wait_ms) {
    struct pollfd fd = {.fd = modbus_get_socket(line->context), .events = POLLIN};
    return poll(&fd, 1, wait_ms) > 0;
}

/* Discards all input until the line has been silent for silence_ms. Returns FALSE if any input
 * came. Gives up after three times silence_ms if the line does not become silent or has hung up. */
static gboolean await_silence(struct modbus_line *line, double silence_ms) {
    gint64 silence_us = (gint64)(silence_ms * 1000), now = g_get_monotonic_time();
    gint64 silent_from = now, limit = now + 3 * silence_us;
    gboolean silent = TRUE;
    while ((now = g_get_monotonic_time()) < MIN(silent_from + silence_us, limit)) {
        int left_ms = (int)((MIN(silent_from + silence_us, limit) - now + 999) / 1000);
        if (!line_is_readable(line, left_ms))
            continue;
        modbus_flush(line->context);
        g_usleep(1000);
        silent = FALSE;
        silent_from = g_get_monotonic_time();
    }
    return silent;
}

/* Sends a pulse as a raw request, because libmodbus has no function for it. On TCP, raw requests
 * have the transaction id 0. Returns -1 and sets errno on failure. */
static int transfer_pulse(modbus_t *context, const struct modbus_request *request) {
    guint8 ask[] = {(guint8)modbus_get_slave(context), 5,
                    (guint8)(request->address >> 8),   (guint8)request->address,
                    (guint8)(request->values[0] >> 8), (guint8)request->values[0]};
    guint8 answer[MODBUS_TCP_MAX_ADU_LENGTH];
    int header = modbus_get_header_length(context);
    if (modbus_send_raw_request(context, ask, sizeof ask) < 0)
        return -1;
    int n = modbus_receive_confirmation(context, answer);
    if (n < 0)
        return -1;
    const guint8 *unit = answer + header - 1;
    gboolean ours =
        n >= header + 2 && unit[0] == ask[0] && (header == 1 || !(answer[0] | answer[1]));
    if (ours && unit[1] == (5 | 0x80)) {
        errno = MODBUS_ENOBASE +
                CLAMP(unit[2], MODBUS_EXCEPTION_ILLEGAL_FUNCTION, MODBUS_EXCEPTION_GATEWAY_TARGET);
        return -1;
    }
    if (ours && n >= header - 1 + (int)sizeof ask && memcmp(unit, ask, sizeof ask) == 0)
        return 1;
    errno = EMBBADDATA;
    return -1;
}

static int line_transfer(modbus_t *context, struct modbus_request *request) {
    int at = request->address, n = request->n, done;
    guint8 bits[MODBUS_MAX_VALUES];
    for (int i = 0; i < n; i++)
        bits[i] = request->values[i] != 0;
    switch (request->kind) {
    case MODBUS_READ_COILS:
    case MODBUS_READ_INPUTS:
        done = (request->kind == MODBUS_READ_COILS ? modbus_read_bits
                                                   : modbus_read_input_bits)(context, at, n, bits);
        for (int i = 0; i < done; i++)
            request->values[i] = bits[i];
        return done;
    case MODBUS_READ_HOLDING:
        return modbus_read_registers(context, at, n, request->values);
    case MODBUS_READ_INPUT_REGISTERS:
        return modbus_read_input_registers(context, at, n, request->values);
    case MODBUS_WRITE_COILS:
        return n == 1 ? modbus_write_bit(context, at, bits[0])
                      : modbus_write_bits(context, at, n, bits);
    case MODBUS_WRITE_HOLDING:
        return n == 1 ? modbus_write_register(context, at, request->values[0])
                      : modbus_write_registers(context, at, n, request->values);
    case MODBUS_PULSE_COIL:
        return transfer_pulse(context, request);
    }
    g_return_val_if_reached(-1);
}

static char *request_text(const struct modbus_line *line, int unit,
                          const struct modbus_request *request) {
    static const char *const texts[] = {
        [MODBUS_READ_COILS] = "reading coil",
        [MODBUS_READ_INPUTS] = "reading discrete input",
        [MODBUS_READ_HOLDING] = "reading holding register",
        [MODBUS_READ_INPUT_REGISTERS] = "reading input register",
        [MODBUS_WRITE_COILS] = "writing coil",
        [MODBUS_WRITE_HOLDING] = "writing holding register",
        [MODBUS_PULSE_COIL] = "writing a time to coil",
    };
    return g_strdup_printf("%s unit %d, %s %d (0x%04x)", line->link.bus, unit, texts[request->kind],
                           request->address, (guint)request->address);
}

/* Returns whether the errno `why` means that the reply is damaged, or comes from another unit or
 * transaction. */
static gboolean is_damage(int why) {
    return why == EMBBADCRC || why == EMBBADDATA || why == EMBBADSLAVE || why == EMBBADEXC ||
           why == EMBUNKEXC || why == EMBMDATA;
}

static gboolean is_exception(int why) {
    return why >= EMBXILFUN && why <= EMBXGTAR;
}

/* Returns whether the errno `why` means that the unit is busy (exceptions 5 and 6). A repetition
 * may then succeed. */
static gboolean is_busy(int why) {
    return why == EMBXSBUSY || why == EMBXACK;
}

/* Returns the number of the function of a request (Modbus Application Protocol 1.1b3, chapter 6).
 */
static guint8 function_of(const struct modbus_request *request) {
    switch (request->kind) {
    case MODBUS_READ_COILS:
        return 1;
    case MODBUS_READ_INPUTS:
        return 2;
    case MODBUS_READ_HOLDING:
        return 3;
    case MODBUS_READ_INPUT_REGISTERS:
        return 4;
    case MODBUS_WRITE_COILS:
        return request->n == 1 ? 5 : 15;
    case MODBUS_WRITE_HOLDING:
        return request->n == 1 ? 6 : 16;
    case MODBUS_PULSE_COIL:
        return 5;
    }
    g_return_val_if_reached(0);
}

/* Appends the number of bytes of the values, and the values: registers, or bits. */
static void put_values(GByteArray *to, const struct modbus_request *request, gboolean bits) {
    const guint n = (guint)request->n;
    guint8 bytes[1 + 2 * MODBUS_MAX_VALUES] = {(guint8)(bits ? (n + 7) / 8 : 2 * n)};
    for (guint i = 0; i < n && bits; i++)
        bytes[1 + i / 8] |= (guint8)((request->values[i] != 0) << i % 8);
    for (guint i = 0; i < n && !bits; i++) {
        bytes[1 + 2 * i] = (guint8)(request->values[i] >> 8);
        bytes[2 + 2 * i] = (guint8)request->values[i];
    }
    g_byte_array_append(to, bytes, 1u + bytes[0]);
}

/* Records a request or its answer: unit, function and data, without check sum and transaction. The
 * bytes are made from *request, because libmodbus does not give the bytes that were sent or
 * received. It has checked that the answer agrees with the request. */
static void record(const struct modbus_line *line, int unit, const struct modbus_request *request,
                   gboolean is_answer) {
    if (!recording_is_on())
        return;
    const guint8 function = function_of(request);
    const int n = request->n, at = request->address;
    const int value = function == 5 && request->kind != MODBUS_PULSE_COIL
                          ? (request->values[0] ? 0xff00 : 0)
                      : function == 5 || function == 6 ? request->values[0]
                                                       : n;
    const guint8 head[] = {(guint8)unit,         function,     (guint8)(at >> 8), (guint8)at,
                           (guint8)(value >> 8), (guint8)value};
    const gboolean reads = function <= 4;
    g_autoptr(GByteArray) bytes = g_byte_array_new();
    g_byte_array_append(bytes, head, is_answer && reads ? 2 : sizeof head);
    if (is_answer ? reads : function > 6)
        put_values(bytes, request, function <= 2 || function == 15);
    recording_bytes((struct recording_bus){"modbus", line->link.bus},
                    is_answer ? RECORDING_RECEIVED : RECORDING_SENT, bytes->data, bytes->len);
}

/* Records an exception of the device, or that no answer could be used. */
static void record_failure(const struct modbus_line *line, int unit,
                           const struct modbus_request *request, int why) {
    const struct recording_bus bus = {"modbus", line->link.bus};
    const guint8 exception[] = {(guint8)unit, function_of(request) | 0x80,
                                (guint8)(why - MODBUS_ENOBASE)};
    if (is_exception(why))
        recording_bytes(bus, RECORDING_RECEIVED, exception, sizeof exception);
    else
        recording_note(bus, "%s", why == ETIMEDOUT ? "no answer" : modbus_strerror(why));
}

/* Makes one attempt. Returns 0 or the errno of the failure, and leaves the line ready for the next
 * attempt. *ret_late says that an answer to an earlier request has come. */
static int attempt(struct modbus_line *line, int unit, struct modbus_request *request,
                   gint64 deadline_us, gboolean *ret_late) {
    gboolean distrust = line->owed;
    *ret_late = FALSE;
    /* Discard input that came before the request, because it cannot be the answer. */
    if (distrust || line_is_readable(line, 0))
        *ret_late = !await_silence(line, distrust ? line->link.late_ms : SILENCE_MS) && distrust;
    gint64 left_us = deadline_us - g_get_monotonic_time();
    if (left_us <= 0)
        return ETIMEDOUT;
    set_timeout(line, MIN(left_us, (gint64)(line->link.timeout_ms * 1000)));
    modbus_set_slave(line->context, unit);
    line->owed = TRUE;
    errno = 0;
    struct modbus_request answer = *request;
    record(line, unit, request, FALSE);
    int why = line_transfer(line->context, &answer) >= 0 ? 0 : errno ? errno : EIO;
    if (why)
        record_failure(line, unit, request, why);
    else
        record(line, unit, &answer, TRUE);
    if (why && !is_exception(why)) {
        line->counts.timeouts += why == ETIMEDOUT;
        line->counts.damaged += is_damage(why);
        /* On a serial line, a complete answer that does not fit this request belongs to an earlier
         * one. Over TCP it may belong to no request. */
        *ret_late |= distrust && is_damage(why) && why != EMBBADCRC && !is_tcp(line);
        if (why == EMBBADCRC && !distrust) {
            /* No earlier answer is due, so the damaged answer belonged to this request. */
            await_silence(line, SILENCE_MS);
            line->owed = FALSE;
        } else if (why != ETIMEDOUT && !is_damage(why)) {
            line_disconnect(line);
        }
        return why;
    }
    if (distrust && !await_silence(line, line->link.late_ms)) {
        line->counts.disbelieved++;
        *ret_late = TRUE;
        return EMBBADDATA;
    }
    line->owed = FALSE;
    if (!why)
        *request = answer;
    return why;
}

static const char *damage_text(int why) {
    return why == EMBBADCRC     ? "their check sums are wrong"
           : why == EMBBADSLAVE ? "they come from another unit"
           : why == EMBMDATA    ? "they are too long"
                                : "they do not answer the request";
}

static gboolean line_give_up(const struct modbus_line *line, int unit,
                             const struct modbus_request *request, int why, int tries, int late,
                             GError **error) {
    g_autofree char *what = request_text(line, unit, request);
    if (late > 0 && (why == ETIMEDOUT || is_damage(why)))
        return device_error_set(
            error, DEVICE_ERROR_TIMEOUT, NULL,
            "%s: answers come too late (in %d of %d tries the answer to an earlier try came "
            "first)" ERROR_ADVICE
            "check whether the device or this computer is overloaded, or raise "
            "timeout_ms (%g) and late_ms (%g)",
            what, late, tries + late, line->link.timeout_ms, line->link.late_ms);
    if (why == ETIMEDOUT)
        return device_error_set(error, DEVICE_ERROR_TIMEOUT, NULL,
                                "%s: no answer within %g ms (%d tries)" ERROR_ADVICE
                                "check the power and the address of the device, and the cable",
                                what, line->link.timeout_ms, tries);
    if (is_exception(why))
        return device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                                "%s: the device refused: %s" ERROR_ADVICE
                                "check the register or coil and its value in the device's section "
                                "of the rig file",
                                what, modbus_strerror(why));
    if (is_damage(why))
        return device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                                "%s: damaged answers (%d tries): %s" ERROR_ADVICE
                                "check the cable, its termination, baud and parity",
                                what, tries, damage_text(why));
    return device_error_set(error, DEVICE_ERROR_DISCONNECTED, NULL,
                            "%s: the line was lost: %s" ERROR_ADVICE
                            "check the power of the device and the cable",
                            what, modbus_strerror(why));
}

/* Repeats a request until its deadline. An attempt that is followed by a late answer does not count
 * as a retry, because the device is alive and was only slow. */
static gboolean repeat(struct modbus_line *line, int unit, struct modbus_request *request,
                       gint64 deadline_us, GError **error) {
    gint64 try_us = (gint64)((line->link.late_ms + line->link.timeout_ms) * 1000);
    for (int tries = 0, late = 0;;) {
        gboolean is_late;
        if (!modbus_line_connect(line, deadline_us, error))
            return FALSE;
        gint64 began_us = g_get_monotonic_time();
        int why = attempt(line, unit, request, deadline_us, &is_late);
        if (why == 0)
            return TRUE;
        /* An attempt takes longer than try_us if this program was suspended, as on a busy
         * computer. That time does not count, because no answer could be read in it. */
        deadline_us += MAX(g_get_monotonic_time() - began_us - try_us, 0);
        gboolean final = is_exception(why) && !is_busy(why);
        /* This program may have been suspended during the first attempt. Its failure then proves
         * nothing, so a second attempt gets the same time. */
        if (tries + late == 0)
            deadline_us = MAX(deadline_us, g_get_monotonic_time() + try_us);
        /* Wait once more for a late answer, which proves that the device is alive. */
        if (!is_late && why == ETIMEDOUT && tries == line->link.retries && tries > 0)
            is_late = !await_silence(line, line->link.late_ms);
        late += is_late;
        tries += !is_late;
        if (line->effort == MODBUS_ONCE || (line->waiting && g_atomic_int_get(line->waiting) != 0))
            final = final || !is_busy(why);
        if (final || tries > line->link.retries || g_get_monotonic_time() >= deadline_us)
            return line_give_up(line, unit, request, why, tries, late, error);
        if (is_busy(why))
            g_usleep(BUSY_PAUSE_US);
    }
}

static gboolean is_read(enum modbus_kind kind) {
    return kind <= MODBUS_READ_INPUT_REGISTERS;
}

static gboolean line_compare(const struct modbus_line *line, int unit,
                             const struct modbus_request *wanted, const struct modbus_request *read,
                             GError **error) {
    for (int i = 0; i < read->n; i++) {
        if (wanted->values[i] == read->values[i])
            continue;
        g_autofree char *what = request_text(line, unit, wanted);
        if (is_read(wanted->kind))
            return device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                                    "%s: address %d should hold %d, but reads as %d" ERROR_ADVICE
                                    "check whether the board lost its power or its connection, and "
                                    "what else writes this value",
                                    what, read->address + i, wanted->values[i], read->values[i]);
        return device_error_set(
            error, DEVICE_ERROR_PROTOCOL, NULL,
            "%s: %d was written to address %d, which reads back as %d" ERROR_ADVICE
            "check what else writes this value",
            what, wanted->values[i], read->address + i, read->values[i]);
    }
    return TRUE;
}

/* Closes a connection on which the peer's kernel acknowledges nothing, for example after the cable
 * was cut. Such a connection recovers only when this kernel repeats its packets, with pauses that
 * double. A new connection is faster. Data that the old connection has not delivered must never
 * arrive, because it may be an "on". */
static void give_up_connection(struct modbus_line *line) {
    const struct linger discard = {1, 0};
    int fd = modbus_get_socket(line->context), unacknowledged = 0;
    if (!line->connected || !is_tcp(line) || ioctl(fd, SIOCOUTQ, &unacknowledged) != 0 ||
        unacknowledged == 0)
        return;
    setsockopt(fd, SOL_SOCKET, SO_LINGER, &discard, sizeof discard);
    line_disconnect(line);
}

gboolean modbus_line_do(struct modbus_line *line, int unit, struct modbus_request *request,
                        gint64 deadline_us, GError **error) {
    const struct modbus_request wanted = *request;
    if (line->effort == MODBUS_ONCE)
        give_up_connection(line);
    if (!repeat(line, unit, request, deadline_us, error))
        return FALSE;
    if (!request->verify)
        return TRUE;
    if (is_read(request->kind))
        return line_compare(line, unit, &wanted, request, error);
    if (request->kind == MODBUS_PULSE_COIL) {
        struct modbus_request coil = {.kind = MODBUS_READ_COILS, .address = request->coil, .n = 1};
        g_autofree char *what = request_text(line, unit, request);
        return repeat(line, unit, &coil, deadline_us, error) &&
               (coil.values[0] ||
                device_error_set(
                    error, DEVICE_ERROR_PROTOCOL, NULL,
                    "%s: the time %d was written, but coil %d reads as off" ERROR_ADVICE
                    "check that the board supports switching coils on for a time in this way",
                    what, request->values[0], request->coil));
    }
    struct modbus_request back = *request;
    back.kind = request->kind == MODBUS_WRITE_COILS ? MODBUS_READ_COILS : MODBUS_READ_HOLDING;
    return repeat(line, unit, &back, deadline_us, error) &&
           line_compare(line, unit, request, &back, error);
}

void modbus_line_counts(const struct modbus_line *line, struct modbus_counts *ret) {
    *ret = line->counts;
}
