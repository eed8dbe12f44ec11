/* mesorig-web: what it shows, what it refuses, and its page in a browser. */
#include "lib/browser.h"
#include "lib/operator.h"
#include "lib/process.h"

#include <json-glib/json-glib.h>
#include <libsoup/soup.h>
#include <string.h>

#define TOKEN    "an-0123456789-token"
#define REQUESTS 300 /* of the fuzzer; MESORIG_WEB_REQUESTS in the environment: more */
#define SEED     20261122
#define WAIT_S   30

/* A daemon, and a server of its rig. */
struct site {
    struct operation *run;
    GSubprocess *daemon, *server;
    char *bus, *uri;
    guint16 port;
    SoupSession *http;
};

static void site_starts_daemon(struct site *site) {
    g_autofree char *socket = g_build_filename(site->run->directory, "bus", NULL);
    site->daemon =
        process_start(G_SUBPROCESS_FLAGS_STDERR_SILENCE, NULL,
                      (const char *[]){BUILD_DIR "/bin/mesorigd", "--listen", site->bus, NULL});
    for (int i = 0; i < 10 * WAIT_S && !g_file_test(socket, G_FILE_TEST_EXISTS); i++)
        g_usleep(G_USEC_PER_SEC / 10);
}

static struct site *site_with(gboolean acts, const struct change *changes) {
    struct site *site = g_new0(struct site, 1);
    g_autoptr(GError) error = NULL;
    site->run = operator_new(changes);
    site->bus = g_strdup_printf("unix:path=%s/bus", site->run->directory);
    g_autofree char *token = g_build_filename(site->run->directory, "token", NULL);
    g_assert_true(g_file_set_contents(token, TOKEN "\n", -1, NULL));
    site_starts_daemon(site);
    site->server =
        process_start(G_SUBPROCESS_FLAGS_STDOUT_PIPE, NULL,
                      (const char *[]){BUILD_DIR "/bin/mesorig-web", "--address", site->bus,
                                       "--port", "0", acts ? "--token-file" : NULL, token, NULL});
    g_autoptr(GDataInputStream) out =
        g_data_input_stream_new(g_subprocess_get_stdout_pipe(site->server));
    site->uri = g_data_input_stream_read_line(out, NULL, NULL, &error);
    g_assert_no_error(error);
    g_assert_nonnull(site->uri);
    site->uri[strcspn(site->uri, " ")] = '\0';
    g_autoptr(GUri) uri = g_uri_parse(site->uri, G_URI_FLAGS_NONE, &error);
    g_assert_no_error(error);
    site->port = (guint16)g_uri_get_port(uri);
    site->http = soup_session_new_with_options("timeout", WAIT_S, NULL);
    return site;
}

static struct site *site_new(gboolean acts) {
    return site_with(acts, NULL);
}

static void site_free(struct site *site) {
    GSubprocess *const processes[] = {site->server, site->daemon};
    for (gsize i = 0; i < G_N_ELEMENTS(processes); i++) {
        g_subprocess_send_signal(processes[i], SIGTERM);
        g_subprocess_wait(processes[i], NULL, NULL);
        g_assert_true(g_subprocess_get_if_exited(processes[i]));
        g_assert_cmpint(g_subprocess_get_exit_status(processes[i]), ==, 0);
        g_object_unref(processes[i]);
    }
    g_object_unref(site->http);
    operator_free(site->run);
    g_free(site->bus);
    g_free(site->uri);
    g_free(site);
}

/* The small session, by the daemon that the server shows. */
static void capture(struct site *site) {
    operator_does(site->run, 0, "capture", "--address", site->bus, site->run->rig, site->run->conf,
                  "-o", site->run->session, NULL);
}

/* A request; header: "Name: value", or NULL. The status; ret (may be NULL): the body, g_free(). */
static guint ask(const struct site *site, const char *method, const char *path, const char *header,
                 char **ret) {
    g_autofree char *uri = g_strconcat(site->uri, path, NULL);
    g_autoptr(SoupMessage) message = soup_message_new(method, uri);
    g_autoptr(GError) error = NULL;
    if (header) {
        g_auto(GStrv) parts = g_strsplit(header, ": ", 2);
        soup_message_headers_replace(soup_message_get_request_headers(message), parts[0], parts[1]);
    }
    g_autoptr(GBytes) answer = soup_session_send_and_read(site->http, message, NULL, &error);
    g_assert_no_error(error);
    /* No answer may be used by pages of other sites. */
    g_assert_null(soup_message_headers_get_one(soup_message_get_response_headers(message),
                                               "Access-Control-Allow-Origin"));
    gsize length;
    const char *text = g_bytes_get_data(answer, &length);
    if (ret)
        *ret = g_strndup(text, length);
    return soup_message_get_status(message);
}

static JsonParser *read_json(const struct site *site, const char *path) {
    g_autofree char *text = NULL;
    g_autoptr(GError) error = NULL;
    JsonParser *parser = json_parser_new();
    g_assert_cmpuint(ask(site, "GET", path, NULL, &text), ==, 200);
    json_parser_load_from_data(parser, text, -1, &error);
    g_assert_no_error(error);
    return parser;
}

static char *state_of(const struct site *site) {
    g_autoptr(JsonParser) parser = read_json(site, "api/v1/state");
    JsonObject *object = json_node_get_object(json_parser_get_root(parser));
    return g_strdup(json_object_get_string_member(object, "state"));
}

static void shows(void) {
    struct site *site = site_new(TRUE);
    g_autofree char *page = NULL, *picture = NULL;
    g_assert_cmpuint(ask(site, "GET", "", NULL, &page), ==, 200);
    assert_has(page, "<title>Mesorig</title>");
    g_autofree char *closed = state_of(site);
    g_assert_cmpstr(closed, ==, "closed");
    g_assert_cmpuint(ask(site, "GET", "api/v1/cameras/cam30.png", NULL, NULL), ==, 404);
    capture(site);

    g_autoptr(JsonParser) log = read_json(site, "api/v1/log");
    JsonArray *events = json_node_get_array(json_parser_get_root(log));
    g_assert_cmpuint(json_array_get_length(events), >, 0);
    g_autoptr(JsonParser) told = read_json(site, "api/v1/cameras/cam30.json");
    JsonObject *camera = json_node_get_object(json_parser_get_root(told));
    const gint64 pixels =
        json_object_get_int_member(camera, "width") * json_object_get_int_member(camera, "height");
    JsonArray *histogram = json_object_get_array_member(camera, "histogram");
    g_assert_cmpuint(json_array_get_length(histogram), ==, 3);
    for (guint c = 0; c < 3; c++) {
        JsonArray *steps = json_array_get_array_element(histogram, c);
        gint64 sum = 0;
        for (guint i = 0; i < json_array_get_length(steps); i++)
            sum += json_array_get_int_element(steps, i);
        g_assert_cmpint(sum, ==, pixels);
    }
    g_assert_cmpuint(ask(site, "GET", "api/v1/cameras/cam30.png", NULL, &picture), ==, 200);
    g_assert_cmpmem(picture, 4, "\x89PNG", 4);
    g_assert_cmpuint(ask(site, "GET", "api/v1/cameras/nobody.png", NULL, NULL), ==, 404);
    g_assert_cmpuint(ask(site, "GET", "api/v1/", NULL, NULL), ==, 404);
    g_assert_cmpuint(ask(site, "GET", "etc/passwd", NULL, NULL), ==, 404);
    site_free(site);
}

static void wait_for_state(const struct site *site, const char *wanted) {
    g_autofree char *state = NULL;
    for (int i = 0; i < 10 * WAIT_S; i++) {
        g_free(state);
        state = state_of(site);
        if (g_str_equal(state, wanted))
            return;
        g_usleep(G_USEC_PER_SEC / 10);
    }
    g_error("within %d s the state was not %s, but %s", WAIT_S, wanted, state);
}

/* The daemon is killed and started again at its address: the server says so, and finds it. */
static void comes_back(void) {
    struct site *site = site_new(TRUE);
    g_autofree char *away = NULL, *refused = NULL;
    capture(site);
    g_assert_cmpuint(ask(site, "GET", "api/v1/cameras/cam30.png", NULL, NULL), ==, 200);
    g_subprocess_force_exit(site->daemon);
    g_subprocess_wait(site->daemon, NULL, NULL);
    g_clear_object(&site->daemon);
    wait_for_state(site, "away");
    g_usleep(3 * G_USEC_PER_SEC); /* it has been looked for in vain */
    g_assert_cmpuint(ask(site, "GET", "api/v1/state", NULL, &away), ==, 200);
    assert_has(away, "no mesorigd answers at unix:path=");
    assert_has(away, site->bus);
    g_assert_cmpuint(ask(site, "POST", "api/v1/safe", "Authorization: Bearer " TOKEN, &refused), >=,
                     400);
    assert_has(refused, site->bus);
    g_assert_cmpuint(ask(site, "GET", "api/v1/cameras/cam30.png", NULL, NULL), >=, 400);

    site_starts_daemon(site);
    wait_for_state(site, "closed");
    g_autofree char *other = g_strconcat(site->run->directory, "/other.session", NULL);
    operator_does(site->run, 0, "capture", "--address", site->bus, site->run->rig, site->run->conf,
                  "-o", other, NULL);
    wait_for_state(site, "done");
    g_assert_cmpuint(ask(site, "GET", "api/v1/cameras/cam30.png", NULL, NULL), ==, 200);
    site_free(site);
}

/* The stream begins with the state, and tells the capture's events, pictures and changes. */
static void streams(void) {
    struct site *site = site_new(FALSE);
    g_autofree char *uri = g_strconcat(site->uri, "api/v1/events", NULL);
    g_autoptr(SoupMessage) message = soup_message_new("GET", uri);
    g_autoptr(GError) error = NULL;
    g_autoptr(GInputStream) body = soup_session_send(site->http, message, NULL, &error);
    g_assert_no_error(error);
    g_autoptr(GDataInputStream) lines = g_data_input_stream_new(body);
    gboolean captured = FALSE, event = FALSE, picture = FALSE, done = FALSE;
    for (int i = 0; i < 10000 && !(event && picture && done); i++) {
        g_autofree char *line = g_data_input_stream_read_line(lines, NULL, NULL, &error);
        g_assert_no_error(error);
        g_assert_nonnull(line);
        event = event || strcmp(line, "event: event") == 0;
        picture = picture || strcmp(line, "event: picture") == 0;
        done = done || strstr(line, "\"shots_done\": 13");
        if (!captured && g_str_has_prefix(line, "data: ")) {
            assert_has(line, "\"state\": \"closed\"");
            captured = TRUE;
            capture(site);
        }
    }
    site_free(site);
}

static void refuses(void) {
    static const struct {
        const char *method, *path, *header;
        guint status;
    } all[] = {
        {"POST", "api/v1/safe", NULL, 401},
        {"POST", "api/v1/safe", "Authorization: Bearer an-0123456789-tokem", 401},
        {"POST", "api/v1/safe", "Authorization: Basic " TOKEN, 401},
        {"POST", "api/v1/safe", "Origin: http://evil.example", 403},
        {"POST", "api/v1/safe", "Origin: null", 403},
        {"POST", "api/v1/safe", "Sec-Fetch-Site: cross-site", 403},
        {"GET", "api/v1/safe", "Authorization: Bearer " TOKEN, 405},
        {"GET", "api/v1/state", "Host: evil.example", 421},
        {"GET", "api/v1/state", "Host: localhost.evil.example:80", 421},
        {"GET", "api/v1/state", "Origin: http://evil.example", 403},
        {"GET", "api/v1/state", "Host: localhost", 200},
        {"DELETE", "api/v1/state", NULL, 405},
        {"POST", "", NULL, 405},
        /* Nothing is captured: the daemon's answer comes back. */
        {"POST", "api/v1/pause", "Authorization: Bearer " TOKEN, 409},
    };
    struct site *site = site_new(TRUE), *blind = site_new(FALSE);
    for (gsize i = 0; i < G_N_ELEMENTS(all); i++) {
        g_autofree char *said = NULL;
        const guint status = ask(site, all[i].method, all[i].path, all[i].header, &said);
        g_test_message("%s %s %s: %u %s", all[i].method, all[i].path,
                       all[i].header ? all[i].header : "", status, said);
        g_assert_cmpuint(status, ==, all[i].status);
        if (status != 200)
            assert_has(said, "{\"error\": ");
    }
    /* A server without a token only shows. */
    g_assert_cmpuint(ask(blind, "POST", "api/v1/safe", "Authorization: Bearer " TOKEN, NULL), ==,
                     403);
    site_free(site);
    site_free(blind);
}

/* One request of a fuzzer: a valid one of which some bytes are others, are gone, or are many. */
static GString *fuzzed(GRand *random) {
    static const char *const seeds[] = {
        "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n",
        "GET /api/v1/state HTTP/1.1\r\nHost: localhost\r\n\r\n",
        "GET /api/v1/cameras/cam30.png HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
        "POST /api/v1/safe HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer "
        "an-0123456789-tokeN\r\nContent-Length: 0\r\n\r\n",
        "POST /api/v1/abort HTTP/1.1\r\nHost: localhost\r\nOrigin: http://localhost\r\n"
        "Content-Length: 4\r\n\r\nabcd",
        "GET /api/v1/events HTTP/1.0\r\nHost: [::1]\r\n\r\n",
        "POST /api/v1/continue HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n"
        "5\r\nabcde\r\n0\r\n\r\n",
    };
    static const char *const pieces[] = {"../", "%00", "%2e%2e/", "\r\n", "\xff", "A", ": ", "{}"};
    GString *request = g_string_new(seeds[g_rand_int_range(random, 0, G_N_ELEMENTS(seeds))]);
    for (int n = g_rand_int_range(random, 1, 6); n > 0 && request->len > 0; n--) {
        const gssize at = g_rand_int_range(random, 0, (gint32)request->len);
        switch (g_rand_int_range(random, 0, 4)) {
        case 0:
            request->str[at] = (char)g_rand_int_range(random, 0, 256);
            break;
        case 1: {
            const gssize length = g_rand_int_range(random, 1, 20);
            g_string_erase(request, at, MIN((gssize)request->len - at, length));
            break;
        }
        case 2:
            g_string_insert(request, at, pieces[g_rand_int_range(random, 0, G_N_ELEMENTS(pieces))]);
            break;
        default: {
            g_autofree char *many = g_strnfill((gsize)g_rand_int_range(random, 1, 20000), 'A');
            g_string_insert(request, at, many);
        }
        }
    }
    return request;
}

static void survives(void) {
    const char *asked = g_getenv("MESORIG_WEB_REQUESTS");
    const int n = asked ? atoi(asked) : REQUESTS;
    struct site *site = site_new(TRUE);
    g_autoptr(GRand) random = g_rand_new_with_seed(SEED);
    g_autoptr(GSocketClient) client = g_socket_client_new();
    capture(site);
    g_autofree char *before = state_of(site);
    for (int i = 0; i < n; i++) {
        g_autoptr(GError) error = NULL;
        g_autoptr(GString) request = fuzzed(random);
        g_autoptr(GSocketConnection) connection =
            g_socket_client_connect_to_host(client, "127.0.0.1", site->port, NULL, &error);
        g_assert_no_error(error);
        GSocket *socket = g_socket_connection_get_socket(connection);
        GOutputStream *out = g_io_stream_get_output_stream(G_IO_STREAM(connection));
        char answer[4096];
        g_output_stream_write_all(out, request->str, request->len, NULL, NULL, NULL);
        g_socket_shutdown(socket, FALSE, TRUE, NULL);
        /* Streams do not end. */
        g_socket_set_timeout(socket, 1);
        if (g_rand_boolean(random))
            g_input_stream_read(g_io_stream_get_input_stream(G_IO_STREAM(connection)), answer,
                                sizeof answer, NULL, NULL);
    }
    /* It lives, and no call has reached the rig. */
    g_autofree char *after = state_of(site);
    g_assert_cmpstr(after, ==, before);
    g_autoptr(JsonParser) log = read_json(site, "api/v1/log");
    JsonArray *events = json_node_get_array(json_parser_get_root(log));
    for (guint i = 0; i < json_array_get_length(events); i++)
        g_assert_cmpstr(
            json_object_get_string_member(json_array_get_object_element(events, i), "level"), ==,
            "info");
    site_free(site);
}

static void in_browser(void) {
    struct site *site = site_new(TRUE);
    Browser *browser = browser_new(390, 844);
    browser_open(browser, site->uri);
    browser_wait(browser, "document.getElementById('state').textContent == 'closed'");
    capture(site);
    browser_wait(browser, "document.getElementById('state').textContent == 'done'");
    browser_wait(browser, "document.getElementById('shots').textContent == '13 of 13'");
    browser_wait(browser, "[...document.querySelectorAll('#cameras img')].length == 2 && "
                          "[...document.querySelectorAll('#cameras img')].every(i => i.complete && "
                          "i.naturalWidth > 0)");
    browser_wait(browser, "document.querySelectorAll('#cameras figure > svg path').length == 6");
    /* The pose: two cameras, lamps and lasers, and the light of the last shot. */
    browser_wait(browser, "['camera', 'lamp', 'laser'].every(c => "
                          "document.querySelectorAll(`#pose .${c}:not(.ray)`).length == 2)");
    browser_wait(browser, "/^Seen from above: turntable /.test("
                          "document.getElementById('pose-text').textContent)");
    browser_wait(browser,
                 "['on', 'ray'].every(c => document.querySelectorAll(`#pose .${c}`).length == "
                 "Number(document.getElementById('pose-text').textContent.includes('shines')))");
    browser_wait(browser, "document.getElementById('notice').hidden");
    browser_wait(browser, "document.querySelectorAll('#events li').length > 0");
    browser_wait(browser, "document.querySelectorAll('#devices tr').length > 4");
    /* Nothing is wider than a phone. */
    browser_wait(browser, "document.documentElement.scrollWidth <= innerWidth");
    browser_wait(browser, "document.getElementById('safe').disabled");
    /* A wrong token, then the right one. */
    g_free(browser_value(browser, "(sessionStorage.setItem('token', 'wrong'), act('safe'))"));
    browser_wait(
        browser,
        "document.getElementById('answer').textContent == 'the token is missing or wrong'");
    g_free(browser_value(browser, "document.getElementById('unlock').click()"));
    g_free(browser_value(browser, "(document.getElementById('token').value = '" TOKEN
                                  "', document.getElementById('token-form').requestSubmit())"));
    browser_wait(browser, "!document.getElementById('safe').disabled");
    g_free(browser_value(browser, "document.getElementById('safe').click()"));
    browser_wait(browser, "document.getElementById('answer').textContent == ''");
    /* The daemon goes. */
    g_subprocess_send_signal(site->daemon, SIGTERM);
    browser_wait(browser,
                 "document.getElementById('state').textContent == 'mesorigd does not answer'");
    browser_free(browser);
    site_free(site);
}

/* A camera goes: the page says which, and how to go on. */
static void faults(void) {
    static const struct change gone[] = {{"[camera cam60]", "fault_disconnect_after = 9"},
                                         {"[camera cam60]", "fault_reconnect_s = 100000"},
                                         {0}};
    struct site *site = site_with(TRUE, gone);
    Browser *browser = browser_new(390, 844);
    browser_open(browser, site->uri);
    operator_does(site->run, 1, "capture", "--address", site->bus, site->run->rig, site->run->conf,
                  "-o", site->run->session, NULL);
    browser_wait(browser, "document.getElementById('state').textContent == 'paused'");
    browser_wait(browser, "!document.getElementById('notice').hidden");
    browser_wait(browser, "document.getElementById('notice-head').textContent == 'Fault: cam60'");
    browser_wait(browser, "document.getElementById('reason').textContent.includes('cam60')");
    browser_wait(browser, "document.querySelectorAll('#steps li').length == 3");
    browser_wait(browser,
                 "document.getElementById('left').textContent.endsWith('once it goes on')");
    browser_wait(browser, "document.documentElement.scrollWidth <= innerWidth");
    /* Continue is there for who has the token; the camera is still gone. */
    browser_wait(browser, "document.getElementById('continue').disabled");
    g_free(browser_value(browser, "(sessionStorage.setItem('token', '" TOKEN "'), showState())"));
    browser_wait(browser, "!document.getElementById('continue').disabled");
    /* The light of the shot that failed. */
    browser_wait(browser, "document.querySelectorAll('#pose .ray').length == 1 || "
                          "document.getElementById('pose-text').textContent.includes('dark')");
    browser_free(browser);
    site_free(site);
}

/* A server without a token offers no buttons, and names commands instead. */
static void shows_only(void) {
    struct site *site = site_new(FALSE);
    Browser *browser = browser_new(390, 844);
    browser_open(browser, site->uri);
    browser_wait(browser, "document.getElementById('state').textContent == 'closed'");
    browser_wait(browser, "document.getElementById('actions').hidden");
    g_free(browser_value(browser,
                         "(state = {...state, state: 'paused', reason: 'why'}, showState())"));
    browser_wait(browser, "document.getElementById('steps').textContent == "
                          "'Run: mesorig continue to go on.'");
    browser_free(browser);
    site_free(site);
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    /* So that tests/lsan.supp knows libsoup's functions, which keep no frame pointers. */
    g_setenv("ASAN_OPTIONS", "fast_unwind_on_malloc=0", TRUE);
    g_test_add_func("/web/shows", shows);
    g_test_add_func("/web/streams", streams);
    g_test_add_func("/web/comes-back", comes_back);
    g_test_add_func("/web/refuses", refuses);
    g_test_add_func("/web/survives", survives);
    g_test_add_func("/web/faults", faults);
    g_test_add_func("/web/in-browser", in_browser);
    g_test_add_func("/web/shows-only", shows_only);
    return operator_tests();
}
