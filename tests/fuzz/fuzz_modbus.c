/* Answers on a Modbus line over TCP. What libmodbus asks of the kernel is answered here while a
 * line is at work: it connects at the same time, receives what the input says, and waits for
 * nothing. */
#include "fuzz_modbus_ask.h"

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
        const int kind = next_byte(), n = next_byte(), address = next_byte() & 0xff;
        if (!fuzz_modbus_ask(line, kind, n, address, deadline_us))
            break;
    }
    at_work = FALSE;
    modbus_line_free(line);
    return 0;
}
