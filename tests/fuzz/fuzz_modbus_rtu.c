/* Answers on a serial Modbus line (RTU), behind libmodbus: a pseudo-terminal at whose other end a
 * thread answers each request with the next piece of the input. Of an answer whose first byte is
 * odd the checksum is made right, so that its contents are reached. */
#include "fuzz_modbus_ask.h"

#include <fcntl.h>
#include <gio/gio.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <unistd.h>

#define REQUESTS    4
#define MAX_BYTES   260 /* of an answer; a frame has at most 256 */
#define PATIENCE_MS 1000

static struct {
    GAsyncQueue *answers; /* of GBytes; the thread's */
    int master, slave;
    int ends[2]; /* a pipe: closed, the thread ends */
} serial;

/* Modbus over Serial Line 1.02 §6.2.2. */
static guint16 crc_of(const guint8 *bytes, size_t n) {
    guint16 crc = 0xffff;
    for (size_t i = 0; i < n; i++) {
        crc ^= bytes[i];
        for (int bit = 0; bit < 8; bit++)
            crc = (guint16)(crc & 1 ? crc >> 1 ^ 0xa001 : crc >> 1);
    }
    return crc;
}

static gpointer serial_answer(gpointer data) {
    struct pollfd fds[2] = {{.fd = serial.master, .events = POLLIN},
                            {.fd = serial.ends[0], .events = POLLIN}};
    guint8 request[512];
    while (poll(fds, 2, -1) > 0 && !fds[1].revents) {
        if (read(serial.master, request, sizeof request) <= 0)
            break;
        g_autoptr(GBytes) answer = g_async_queue_try_pop(serial.answers);
        gsize n = 0;
        const guint8 *bytes = answer ? g_bytes_get_data(answer, &n) : NULL;
        if (n > 0 && write(serial.master, bytes, n) < 0)
            break;
    }
    return NULL;
}

static void serial_open(void) {
    struct termios raw;
    serial.master = posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC);
    g_assert_cmpint(serial.master, >=, 0);
    g_assert_true(grantpt(serial.master) == 0 && unlockpt(serial.master) == 0);
    serial.slave = open(ptsname(serial.master), O_RDWR | O_NOCTTY | O_CLOEXEC);
    g_assert_cmpint(serial.slave, >=, 0);
    g_assert_cmpint(tcgetattr(serial.slave, &raw), ==, 0);
    cfmakeraw(&raw);
    g_assert_cmpint(tcsetattr(serial.slave, TCSANOW, &raw), ==, 0);
    g_assert_cmpint(pipe(serial.ends), ==, 0);
    serial.answers = g_async_queue_new_full((GDestroyNotify)g_bytes_unref);
}

/* Each answer is as long as half of its first byte. */
static void serial_queue(const uint8_t *data, size_t size) {
    while (size > 0) {
        const uint8_t head = *data++;
        guint8 answer[MAX_BYTES];
        size--;
        size_t n = MIN((size_t)head / 2, size);
        memcpy(answer, data, n);
        data += n;
        size -= n;
        if (head & 1) {
            const guint16 crc = crc_of(answer, n);
            answer[n++] = (guint8)crc;
            answer[n++] = (guint8)(crc >> 8);
        }
        g_async_queue_push(serial.answers, g_bytes_new(answer, n));
    }
}

static void serial_ask(const char *path, const uint8_t *heads) {
    g_autofree char *bus = g_strdup(path);
    const struct modbus_link link = {.bus = bus,
                                     .baud = 115200,
                                     .stop_bits = 1,
                                     .unit = 1,
                                     .timeout_ms = 2,
                                     .late_ms = 2,
                                     .retries = 1};
    GError *error = NULL;
    struct modbus_line *line = modbus_line_new(&link, &error);
    g_assert_no_error(error);
    for (int i = 0; i < REQUESTS && g_async_queue_length(serial.answers) > 0; i++) {
        const gint64 deadline_us = g_get_monotonic_time() + PATIENCE_MS * 1000;
        if (!fuzz_modbus_ask(line, heads[2 * i], heads[2 * i + 1], 11, deadline_us))
            break;
    }
    modbus_line_free(line);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (size < 2 * REQUESTS)
        return 0;
    serial_open();
    serial_queue(data + 2 * REQUESTS, size - 2 * REQUESTS);
    GThread *thread = g_thread_new("answers", serial_answer, NULL);
    serial_ask(ptsname(serial.master), data);
    close(serial.ends[1]);
    g_thread_join(thread);
    close(serial.ends[0]);
    close(serial.slave);
    close(serial.master);
    g_async_queue_unref(serial.answers);
    return 0;
}
