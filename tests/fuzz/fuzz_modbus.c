/* Answers on a Modbus line over TCP. What libmodbus asks of the kernel is answered here while a
 * line is at work: it connects at the same time, receives what the input says, and waits for
 * nothing. */
#include "fuzz.h"

#include "modbus/line.h"

#include <dlfcn.h>
#include <errno.h>
#include <netdb.h>
#include <poll.h>
#include <string.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <unistd.h>

#define REQUESTS 6

static gboolean at_work;
static const uint8_t *script;
static size_t left;
static size_t answer_left; /* of the answer to the last request; 0: it is silent */

static int next_byte(void) {
    return left > 0 ? (left--, *script++) : -1;
}

#define REAL(name) ((typeof(&name))dlsym(RTLD_NEXT, #name))

int connect(int fd, const struct sockaddr *address, socklen_t length) {
    return at_work ? 0 : REAL(connect)(fd, address, length);
}

/* An answer is as long as its first byte says. */
ssize_t send(int fd, const void *bytes, size_t n, int flags) {
    if (!at_work)
        return REAL(send)(fd, bytes, n, flags);
    const int length = next_byte();
    answer_left = length < 0 ? 0 : MIN((size_t)length, left);
    return (ssize_t)n;
}

ssize_t recv(int fd, void *to, size_t n, int flags) {
    if (!at_work)
        return REAL(recv)(fd, to, n, flags);
    if (answer_left == 0) {
        errno = EAGAIN;
        return left == 0 ? 0 : -1;
    }
    answer_left = MIN(answer_left, left); /* the next request has taken its bytes */
    n = MIN(n, answer_left);
    memcpy(to, script, n);
    script += n;
    left -= n;
    answer_left -= n;
    return (ssize_t)n;
}

int select(int n, fd_set *to_read, fd_set *to_write, fd_set *special, struct timeval *limit) {
    if (!at_work)
        return REAL(select)(n, to_read, to_write, special, limit);
    return answer_left > 0 || left == 0; /* at the end of the input it hangs up */
}

int poll(struct pollfd *fds, nfds_t n, int timeout_ms) {
    if (!at_work)
        return REAL(poll)(fds, n, timeout_ms);
    return answer_left > 0;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static const enum modbus_kind kinds[] = {
        MODBUS_READ_COILS,  MODBUS_READ_INPUTS,   MODBUS_READ_HOLDING, MODBUS_READ_INPUT_REGISTERS,
        MODBUS_WRITE_COILS, MODBUS_WRITE_HOLDING, MODBUS_PULSE_COIL};
    const struct modbus_link link = {
        .bus = (char[]){"tcp:127.0.0.1:502"}, .unit = 1, .timeout_ms = 1, .retries = 1};
    GError *error = NULL;
    struct modbus_line *line = modbus_line_new(&link, &error);
    g_assert_no_error(error);
    script = data;
    left = size;
    answer_left = 0;
    at_work = TRUE;
    for (int i = 0; i < REQUESTS && left > 0; i++) {
        const gint64 deadline_us = g_get_monotonic_time() + 100000;
        const int kind = next_byte() % (int)G_N_ELEMENTS(kinds), n = next_byte();
        struct modbus_request request = {
            .kind = kinds[kind],
            .address = next_byte() & 0xff,
            .n = kinds[kind] == MODBUS_PULSE_COIL ? 1 : 1 + (n & 63) % MODBUS_MAX_VALUES,
            .verify = n >= 0 && (n & 64) && kinds[kind] != MODBUS_PULSE_COIL};
        gboolean ok = modbus_line_connect(line, deadline_us, &error);
        fuzz_check(ok, &error);
        if (!ok)
            break;
        ok = modbus_line_do(line, link.unit, &request, deadline_us, &error);
        fuzz_check(ok, &error);
        const gboolean bits = kinds[kind] == MODBUS_READ_COILS || kinds[kind] == MODBUS_READ_INPUTS;
        for (int k = 0; ok && bits && k < request.n; k++)
            g_assert_cmpint(request.values[k], <=, 1);
    }
    at_work = FALSE;
    modbus_line_free(line);
    return 0;
}
