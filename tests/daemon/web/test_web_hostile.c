/* mesorig-web in a network with an attacker: what the server reads, stores and keeps waiting is
 * limited, and all other clients can call for the safe state. */
#include "lib/test.h"
#include "lib/web_site.h"

#include <signal.h>
#include <string.h>
#include <sys/resource.h>

#include "web/web_door.h"
#include "web/web_log.h"

#define MANY 1000 /* connections of an attacker */
#define MORE_RSS                                                                                   \
    (40 << 10) /* KiB that its memory may grow by; a sanitizer keeps what was freed                \
                */
#define RIGHT      "Authorization: Bearer " SITE_TOKEN "\r\n"
#define STRANGER   "127.0.0.2"
#define HALF       "POST /api/v1/safe HTTP/1.1\r\nHost: "
#define ASK_SAFE   "POST /api/v1/safe HTTP/1.1\r\nHost: $\r\nContent-Length: 0\r\n\r\n"
#define ASK_EVENTS "GET /api/v1/events HTTP/1.1\r\nHost: $\r\n\r\n"

static GPtrArray *sockets_new(void) {
    return g_ptr_array_new_with_free_func(g_object_unref);
}

static long server_rss_kib(const struct site *site) {
    g_autofree char *path =
        g_strdup_printf("/proc/%s/status", g_subprocess_get_identifier(site->server));
    g_autofree char *text = NULL;
    g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
    return atol(strstr(text, "VmRSS:") + 6);
}

static int server_descriptors(const struct site *site) {
    g_autofree char *path =
        g_strdup_printf("/proc/%s/fd", g_subprocess_get_identifier(site->server));
    g_autoptr(GDir) dir = g_dir_open(path, 0, NULL);
    int n = 0;
    while (g_dir_read_name(dir))
        n++;
    return n;
}

static char *read_log(const struct site *site) {
    char *text = NULL;
    return g_file_get_contents(site->log, &text, NULL, NULL) ? text : g_strdup("");
}

/* The status of a request from this machine. */
static guint status_of(const struct site *site, const char *request) {
    g_autofree char *answer = site_converse(site, "127.0.0.1", request);
    return site_status(answer);
}

/* Sends n bytes, or as many as the server takes until it closes. */
static gsize send_much(GSocket *socket, gsize n) {
    static const char bytes[1 << 16];
    gsize sent = 0;
    while (sent < n) {
        const gssize now = g_socket_send(socket, bytes, sizeof bytes, NULL, NULL);
        if (now <= 0)
            break;
        sent += (gsize)now;
    }
    return sent;
}

static char *with_name(const struct site *site, const char *request) {
    g_autoptr(GString) text = g_string_new(request);
    g_autofree char *name = g_strdup_printf("127.0.0.1:%u", site->port);
    g_string_replace(text, "$", name, 0);
    return g_strdup(text->str);
}

static GSocket *begin(const struct site *site, const char *from, const char *request) {
    GSocket *socket = site_dial(site, from);
    g_autofree char *text = with_name(site, request);
    site_send(socket, text);
    return socket;
}

/* Lengths that are none, or too large; and 64 MB that follow them. */
TEST(lengths) {
    static const struct {
        const char *headers, *body;
        guint status;
    } all[] = {
        {"Content-Length: 4096\r\n", NULL, 405}, /* is read */
        {"Content-Length: 4097\r\n", NULL, 413},
        {"Content-Length: 18446744073709551615\r\n", NULL, 413},
        {"Content-Length: 18446744073709551616\r\n", NULL, 413},
        {"Content-Length: -1\r\n", NULL, 413},
        {"Content-Length: +3\r\n", "abc", 413},
        {"Content-Length: 0x3\r\n", "abc", 400},
        {"Content-Length: 3\r\nContent-Length: 3\r\n", "abc", 413},
        {"Content-Length: 3, 3\r\n", "abc", 400},
        {"Transfer-Encoding: chunked\r\n", "3\r\nabc\r\n0\r\n\r\n", 413},
    };
    struct site *site = site_new(SITE_RIG, NULL);
    char body[4098] = {0};
    memset(body, 'x', sizeof body - 1);
    for (gsize i = 0; i < G_N_ELEMENTS(all); i++) {
        g_autofree char *request =
            g_strdup_printf("POST /api/v1/none HTTP/1.1\r\nHost: $\r\n%s\r\n", all[i].headers);
        g_autoptr(GSocket) socket = begin(site, "127.0.0.1", request);
        /* Of a length that is none the body may never end: the client does. */
        site_send(socket, all[i].body ? all[i].body : body + (i == 0 ? 1 : 0));
        g_socket_shutdown(socket, FALSE, TRUE, NULL);
        g_autofree char *answer = site_receive(socket, NULL);
        const guint status = site_status(answer);
        g_test_message("%s: %u", all[i].headers, status);
        g_assert_cmpuint(status, ==, all[i].status);
    }
    const long before_kib = server_rss_kib(site);
    g_autoptr(GPtrArray) sockets = sockets_new();
    for (int i = 0; i < 8; i++) {
        GSocket *socket = begin(site, STRANGER,
                                "POST /api/v1/none HTTP/1.1\r\nHost: $\r\n"
                                "Content-Length: 18446744073709551615\r\n\r\n");
        g_ptr_array_add(sockets, socket);
        /* The kernel's buffers of both sides take some MB. */
        g_assert_cmpuint(send_much(socket, 64 << 20), <, 32 << 20);
    }
    g_assert_cmpint(server_rss_kib(site), <, before_kib + MORE_RSS);
    /* A header without an end. */
    g_autoptr(GSocket) header = begin(site, STRANGER, "GET / HTTP/1.1\r\nHost: $\r\nX: ");
    g_assert_cmpuint(send_much(header, 64 << 20), <, 32 << 20);
    g_assert_cmpint(server_rss_kib(site), <, before_kib + MORE_RSS);
    g_assert_cmpuint(status_of(site, ASK_SAFE), ==, 200);
    site_free(site);
}

/* Heads that libsoup 3.2 loses memory with (their path), 48 kB each. A sanitizer's run counts what
 * is lost when the server ends; this counts what it keeps. */
TEST(malformed_heads) {
    static const struct {
        const char *headers;
        guint status;
    } all[] = {{"Host: $\r\nContent-Length: 0x3\r\n", 400},
               {"Host: $\r\nContent-Length: 3, 3\r\n", 400},
               {"Host: $\r\nContent-Length:\r\n abc\r\n", 400},
               {"Host: $\r\nTransfer-Encoding: gzip\r\n", 501},
               {"Host: $/\r\n", 400}};
    struct site *site = site_new(SITE_RIG, NULL);
    g_autofree char *path = g_strnfill(48 << 10, 'x');
    long before_kib = 0;
    for (int i = 0; i < 600; i++) {
        const gsize k = (gsize)i % G_N_ELEMENTS(all);
        /* Empty lines before a request are none of its head's end. */
        g_autofree char *request = g_strdup_printf("%sGET /%s HTTP/1.1\r\n%s\r\n",
                                                   i % 2 ? "\r\n" : "", path, all[k].headers);
        g_assert_cmpuint(status_of(site, request), ==, all[k].status);
        if (i == 100)
            before_kib = server_rss_kib(site);
    }
    const long more_kib = server_rss_kib(site) - before_kib;
    g_test_message("500 heads: %ld KiB more", more_kib);
    g_assert_cmpint(more_kib, <, 500L * 48 / 4);
    /* A head that comes byte by byte, and one that ends too early. */
    g_autofree char *whole = with_name(site, "GET /api/v1/state HTTP/1.1\nHost: $\n\n");
    g_autoptr(GSocket) slow = site_dial(site, "127.0.0.1");
    for (const char *at = whole; *at; at++)
        site_send(slow, (char[]){*at, '\0'});
    g_autofree char *answer = site_receive(slow, NULL);
    g_assert_cmpuint(site_status(answer), ==, 200);
    g_autoptr(GSocket) cut = begin(site, "127.0.0.1", "GET / HTTP/1.1\r\nHost: $\r\n");
    g_socket_shutdown(cut, FALSE, TRUE, NULL);
    g_autofree char *refused = site_receive(cut, NULL);
    g_assert_cmpuint(site_status(refused), ==, 400);
    g_autofree char *large = g_strdup_printf("GET / HTTP/1.1\r\nX: %s%s", path, path);
    g_autoptr(GSocket) endless = begin(site, "127.0.0.1", large);
    g_autofree char *too_large = site_receive(endless, NULL);
    g_assert_cmpuint(site_status(too_large), ==, 431);
    site_free(site);
}

/* A thousand half-sent requests, of one peer: neither he nor others are shut out. */
TEST(half_sent) {
    struct site *site = site_new(SITE_RIG, NULL);
    g_autoptr(GPtrArray) sockets = sockets_new();
    int most = 0;
    for (int i = 0; i < MANY; i++) {
        GSocket *socket = site_dial(site, STRANGER);
        g_socket_send(socket, HALF, strlen(HALF), NULL, NULL);
        g_ptr_array_add(sockets, socket);
        most = i % 50 == 0 ? MAX(most, server_descriptors(site)) : most;
    }
    g_autofree char *other = site_converse(site, "127.0.0.1", ASK_SAFE);
    g_autofree char *same = site_converse(site, STRANGER, ASK_SAFE);
    g_assert_cmpuint(site_status(other), ==, 200);
    g_assert_cmpuint(site_status(same), ==, 200);
    assert_has(other, "{\"safe\": ");
    g_assert_cmpint(most, <, WEB_DOOR_PEER_CONNECTIONS + 40);
    g_autofree char *log = read_log(site);
    assert_has(log, STRANGER " has 64 connections, which is the maximum");
    site_free(site);
}

/* The same from so many addresses that all places are taken. */
TEST(from_everywhere) {
    struct site *site = site_new(SITE_RIG, NULL);
    g_autoptr(GPtrArray) sockets = sockets_new();
    int most = 0;
    for (int i = 0; i < MANY; i++) {
        g_autofree char *from = g_strdup_printf("127.0.%d.%d", 1 + i / 200, 1 + i % 200);
        GSocket *socket = site_dial(site, from);
        g_socket_send(socket, HALF, strlen(HALF), NULL, NULL);
        g_ptr_array_add(sockets, socket);
        most = i % 50 == 0 ? MAX(most, server_descriptors(site)) : most;
    }
    g_assert_cmpuint(status_of(site, ASK_SAFE), ==, 200);
    g_assert_cmpint(most, <, WEB_DOOR_CONNECTIONS + 40);
    site_free(site);
}

/* Requests that the daemon does not answer, as it is stopped, do not keep places either. */
TEST(daemon_hangs) {
    struct site *site = site_new(SITE_RIG, NULL);
    g_autoptr(GPtrArray) sockets = sockets_new();
    site_capture(site);
    g_subprocess_send_signal(site->daemon, SIGSTOP);
    for (int i = 0; i < MANY / 2; i++) {
        g_autofree char *from = g_strdup_printf("127.0.1.%d", 1 + i % 200);
        g_ptr_array_add(sockets,
                        begin(site, from,
                              i % 3 == 0   ? ASK_SAFE
                              : i % 3 == 1 ? "GET /api/v1/cameras/cam30.png HTTP/1.1\r\n"
                                             "Host: $\r\n\r\n"
                                           : "POST /api/v1/pause HTTP/1.1\r\nHost: $\r\n" RIGHT
                                             "Content-Length: 0\r\n\r\n"));
    }
    g_assert_cmpuint(status_of(site, "GET /api/v1/state HTTP/1.1\r\nHost: $\r\n\r\n"), ==, 200);
    g_assert_cmpint(server_descriptors(site), <, WEB_DOOR_CONNECTIONS + 40);
    g_autoptr(GSocket) safe = begin(site, "127.0.0.1", ASK_SAFE);
    g_ptr_array_set_size(sockets, 0); /* its readers go */
    g_assert_cmpuint(status_of(site, "GET /api/v1/state HTTP/1.1\r\nHost: $\r\n\r\n"), ==, 200);
    g_subprocess_send_signal(site->daemon, SIGCONT);
    g_autofree char *answer = site_receive(safe, NULL);
    g_assert_cmpuint(site_status(answer), ==, 200);
    site_free(site);
}

/* Requests of which a byte comes now and then end after their time. */
TEST(slow) {
    struct site *site = site_new(SITE_RIG, NULL);
    g_autofree char *body =
        with_name(site, "POST /api/v1/none HTTP/1.1\r\nHost: $\r\nContent-Length: 4000\r\n\r\n");
    const char *const begins[] = {HALF, "", body};
    g_autoptr(GPtrArray) sockets = sockets_new();
    gboolean closed[G_N_ELEMENTS(begins)] = {FALSE};
    gsize n_closed = 0;
    for (gsize i = 0; i < G_N_ELEMENTS(begins); i++) {
        GSocket *socket = site_dial(site, "127.0.0.1");
        site_send(socket, begins[i]);
        g_socket_set_blocking(socket, FALSE);
        g_ptr_array_add(sockets, socket);
    }
    for (int i = 0; i < 8 * SITE_WAIT_S && n_closed < G_N_ELEMENTS(begins); i++) {
        g_usleep(G_USEC_PER_SEC / 4);
        for (gsize k = 0; k < G_N_ELEMENTS(begins); k++) {
            g_autoptr(GError) error = NULL;
            char answer[256];
            if (closed[k])
                continue;
            if (*begins[k])
                g_socket_send(sockets->pdata[k], "x", 1, NULL, NULL);
            const gssize got = g_socket_receive(sockets->pdata[k], answer, 255, NULL, &error);
            closed[k] = got >= 0 || !g_error_matches(error, G_IO_ERROR, G_IO_ERROR_WOULD_BLOCK);
            n_closed += closed[k];
        }
    }
    g_assert_cmpuint(n_closed, ==, G_N_ELEMENTS(begins));
    site_free(site);
}

/* Opens streams; how many of them were. */
static int open_streams(const struct site *site, const char *from, int n, GPtrArray *sockets) {
    int opened = 0;
    for (int i = 0; i < n; i++) {
        GSocket *socket = begin(site, from, ASK_EVENTS);
        g_autofree char *head = site_receive(socket, "\r\n\r\n");
        opened += site_status(head) == 200;
        g_assert_true(site_status(head) == 200 || site_status(head) == 503);
        g_ptr_array_add(sockets, socket);
    }
    return opened;
}

TEST(streams) {
    struct site *site = site_new(SITE_RIG, NULL);
    g_autoptr(GPtrArray) sockets = sockets_new(), own = sockets_new();
    g_assert_cmpint(open_streams(site, STRANGER, WEB_DOOR_STREAMS + 6, sockets), ==,
                    WEB_DOOR_PEER_STREAMS);
    g_assert_cmpint(open_streams(site, "127.0.0.1", 1, own), ==, 1);
    /* Five strangers want all that there are, and there is one for us. */
    for (int i = 3; i < 8; i++) {
        g_autofree char *from = g_strdup_printf("127.0.0.%d", i);
        open_streams(site, from, WEB_DOOR_PEER_STREAMS, sockets);
    }
    g_assert_cmpint(open_streams(site, "127.0.0.9", 1, own), ==, 1);
    g_assert_cmpuint(status_of(site, "GET / HTTP/1.1\r\nHost: $\r\n\r\n"), ==, 200);
    /* Ours are still open: they get what happens. */
    site_capture(site);
    for (guint i = 0; i < own->len; i++) {
        g_autofree char *told = site_receive(own->pdata[i], "event: event");
        assert_has(told, "event: event");
    }
    /* Those that end make room. */
    g_ptr_array_set_size(sockets, 0);
    int opened = 0;
    for (int i = 0; i < 10 * SITE_WAIT_S && opened == 0; i++) {
        opened = open_streams(site, STRANGER, 1, own);
        g_usleep(G_USEC_PER_SEC / 10);
    }
    g_assert_cmpint(opened, ==, 1);
    site_free(site);
}

TEST(names) {
    static const struct {
        const char *head;
        guint status;
    } all[] = {
        {"GET / HTTP/1.1\r\nHost: $\r\n", 200},
        {"GET / HTTP/1.1\r\nHOST: $\r\n", 200},
        {"GET / HTTP/1.1\r\nHost: $\r\nHost: $\r\n", 421},
        {"GET / HTTP/1.1\r\nHost: evil.example\r\nHost: $\r\n", 421},
        {"GET / HTTP/1.1\r\nHost: $\r\nHost: evil.example\r\n", 421},
        {"GET / HTTP/1.1\r\nHost: localhost:x@evil.example\r\n", 421},
        {"GET / HTTP/1.1\r\nHost: localhost:1@127.0.0.1:8470\r\n", 421},
        {"GET / HTTP/1.1\r\nHost: x:y@$\r\n", 421},
        {"GET / HTTP/1.1\r\nHost: localhost\r\n", 421},
        {"GET / HTTP/1.1\r\nHost: localhost:1\r\n", 421},
        {"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n", 421},
        {"GET / HTTP/1.1\r\nHost: $, $\r\n", 400},
        {"GET / HTTP/1.1\r\nHost: \r\n", 421},
        {"GET / HTTP/1.0\r\n", 421},
        {"GET http://evil.example/ HTTP/1.1\r\nHost: $\r\n", 421},
        {"GET http://$/ HTTP/1.1\r\nHost: $\r\n", 200},
        {"GET / HTTP/1.1\r\nHost: $\r\nOrigin: http://$\r\n", 200},
        {"GET / HTTP/1.1\r\nHost: $\r\nOrigin: https://$\r\n", 403},
        {"GET / HTTP/1.1\r\nHost: $\r\nOrigin: http://$\r\nOrigin: http://$\r\n", 403},
        {"GET / HTTP/1.1\r\nHost: $\r\nOrigin: http://127.0.0.1:1\r\n", 403},
        {"GET / HTTP/1.1\r\nHost: $\r\nOrigin: http://127.0.0.1\r\n", 403},
        {"GET / HTTP/1.1\r\nHost: $\r\nOrigin: http://$.evil.example\r\n", 403},
        {"POST /api/v1/safe HTTP/1.1\r\nHost: $\r\nOrigin: http://127.0.0.1:1\r\n", 403},
        {"POST /api/v1/safe HTTP/1.1\r\nHost: $\r\nOrigin: null\r\n", 403},
        {"POST /api/v1/safe HTTP/1.1\r\nHost: $\r\nSec-Fetch-Site: same-site\r\n", 403},
        {"POST /api/v1/safe HTTP/1.1\r\nHost: $\r\nOrigin: http://$\r\n", 200},
        /* Not a hundred times the same part of it. */
        {"GET / HTTP/1.1\r\nHost: $\r\nRange: bytes=0-9,0-9,0-9\r\n", 200},
    };
    struct site *site = site_new(SITE_RIG, NULL);
    for (gsize i = 0; i < G_N_ELEMENTS(all); i++) {
        g_autofree char *request = g_strconcat(all[i].head, "\r\n", NULL);
        const guint status = status_of(site, request);
        g_test_message("%s: %u", all[i].head, status);
        g_assert_cmpuint(status, ==, all[i].status);
    }
    /* localhost is another name than 127.0.0.1, and a page of one is none of the other. */
    g_autofree char *localhost =
        g_strdup_printf("GET / HTTP/1.1\r\nHost: localhost:%u\r\n\r\n", site->port);
    g_assert_cmpuint(status_of(site, localhost), ==, 200);
    g_autofree char *mixed = g_strdup_printf(
        "GET / HTTP/1.1\r\nHost: $\r\nOrigin: http://localhost:%u\r\n\r\n", site->port);
    g_assert_cmpuint(status_of(site, mixed), ==, 403);
    site_free(site);
}

/* A client that sends wrong tokens must wait, even with the right token. Other clients need not.
 * The log reports it in few lines. */
TEST(tokens) {
    static const char wrong[] = "POST /api/v1/pause HTTP/1.1\r\nHost: $\r\nAuthorization: Bearer "
                                "an-0123456789-tokem\r\nContent-Length: 0\r\n\r\n";
    static const char right[] =
        "POST /api/v1/pause HTTP/1.1\r\nHost: $\r\n" RIGHT "Content-Length: 0\r\n\r\n";
    struct site *site = site_new(SITE_RIG, NULL);
    int refused = 0;
    for (int failures = 0; failures < 5;) {
        g_autofree char *answer = site_converse(site, STRANGER, wrong);
        const guint status = site_status(answer);
        g_assert_true(status == 401 || status == 429);
        failures += status == 401;
        refused += status == 429;
        if (status == 429)
            assert_has(answer, "Retry-After: ");
    }
    g_assert_cmpint(refused, >, 0);
    /* After the fifth one 4 s: the right one is not looked at either. */
    g_autofree char *early = site_converse(site, STRANGER, right);
    g_assert_cmpuint(site_status(early), ==, 429);
    /* Others, and the safe state, are as ever. 409: nothing is captured. */
    g_autofree char *other = site_converse(site, "127.0.0.1", right);
    g_assert_cmpuint(site_status(other), ==, 409);
    g_autofree char *safe = site_converse(site, STRANGER, ASK_SAFE);
    g_assert_cmpuint(site_status(safe), ==, 200);
    guint status = 429;
    for (int i = 0; i < 10 * SITE_WAIT_S && status == 429; i++) {
        g_autofree char *late = site_converse(site, STRANGER, right);
        status = site_status(late);
        g_usleep(G_USEC_PER_SEC / 10);
    }
    g_assert_cmpuint(status, ==, 409);
    g_autofree char *log = read_log(site);
    assert_has(log, STRANGER " has sent a wrong token, number 5 in a row");
    /* Many strangers: few lines. */
    for (int i = 0; i < 3 * WEB_LOG_LINES; i++) {
        g_autofree char *from = g_strdup_printf("127.0.4.%d", 1 + i);
        g_autofree char *answer = site_converse(site, from, wrong);
        g_assert_cmpuint(site_status(answer), ==, 401);
    }
    g_free(log);
    log = read_log(site);
    g_auto(GStrv) lines = g_strsplit(log, "\n", -1);
    g_assert_cmpuint(g_strv_length(lines), <, 2 * WEB_LOG_LINES + 4); /* of two minutes at most */
    site_free(site);
}

TESTS_RUN_BY(operator_tests);

BEFORE_TESTS {
    struct rlimit limit;
    g_setenv("ASAN_OPTIONS", "fast_unwind_on_malloc=0:quarantine_size_mb=8", TRUE);
    g_assert_cmpint(getrlimit(RLIMIT_NOFILE, &limit), ==, 0);
    limit.rlim_cur = MIN(limit.rlim_max, 4 * MANY);
    g_assert_cmpint(setrlimit(RLIMIT_NOFILE, &limit), ==, 0);
}
