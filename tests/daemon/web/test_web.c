/* mesorig-web: what it shows, what it refuses, and its page in a browser. */
#include "directions/directions.h"
#include "lib/browser.h"
#include "lib/direction.h"
#include "lib/ok.h"
#include "lib/operator.h"
#include "lib/process.h"
#include "lib/test.h"
#include "lib/web_site.h"

#include <json-glib/json-glib.h>
#include <libsoup/soup.h>
#include <math.h>
#include <string.h>

#define REQUESTS 300 /* of the fuzzer; MESORIG_WEB_REQUESTS in the environment: more */
#define SEED     20261122

static JsonParser *read_json(const struct site *site, const char *path) {
    g_autofree char *text = NULL;
    JsonParser *parser = json_parser_new();
    g_assert_cmpuint(site_ask(site, "GET", path, NULL, &text), ==, 200);
    ok(json_parser_load_from_data(parser, text, -1, ERR));
    return parser;
}

static char *state_of(const struct site *site) {
    g_autoptr(JsonParser) parser = read_json(site, "api/v1/state");
    JsonObject *object = json_node_get_object(json_parser_get_root(parser));
    return g_strdup(json_object_get_string_member(object, "state"));
}

TEST(shows) {
    struct site *site = site_new(0, NULL);
    g_autofree char *page = NULL, *picture = NULL;
    g_assert_cmpuint(site_ask(site, "GET", "", NULL, &page), ==, 200);
    assert_has(page, "<title>Mesorig</title>");
    g_autofree char *closed = state_of(site);
    g_assert_cmpstr(closed, ==, "closed");
    g_assert_cmpuint(site_ask(site, "GET", "api/v1/cameras/cam30.png", NULL, NULL), ==, 404);
    site_capture(site);

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
    g_assert_cmpuint(site_ask(site, "GET", "api/v1/cameras/cam30.png", NULL, &picture), ==, 200);
    g_assert_cmpmem(picture, 4, "\x89PNG", 4);
    g_assert_cmpuint(site_ask(site, "GET", "api/v1/cameras/nobody.png", NULL, NULL), ==, 404);
    g_assert_cmpuint(site_ask(site, "GET", "api/v1/", NULL, NULL), ==, 404);
    g_assert_cmpuint(site_ask(site, "GET", "etc/passwd", NULL, NULL), ==, 404);
    site_free(site);
}

/* Every answer is as the OpenAPI description of the server says, and the Python client gets it. */
TEST(description) {
    struct site *site = site_new(SITE_SESSIONS | SITE_QUEUE, NULL);
    const char *const argv[] = {"/usr/bin/python3",
                                SOURCE_DIR "/tests/daemon/web/check_description", site->uri,
                                SITE_TOKEN, NULL};
    site_capture(site);
    g_autofree char *said = process_text(0, argv);
    assert_has(said, "check_description: 42 operations");
    site_free(site);
}

static void wait_for_state(const struct site *site, const char *wanted) {
    g_autofree char *state = NULL;
    for (int i = 0; i < 10 * SITE_WAIT_S; i++) {
        g_free(state);
        state = state_of(site);
        if (g_str_equal(state, wanted))
            return;
        g_usleep(G_USEC_PER_SEC / 10);
    }
    g_error("within %d s the state was not %s, but %s", SITE_WAIT_S, wanted, state);
}

/* The daemon is killed and started again at its address: the server says so, and finds it. */
TEST(comes_back) {
    struct site *site = site_new(0, NULL);
    g_autofree char *away = NULL, *refused = NULL;
    site_capture(site);
    g_assert_cmpuint(site_ask(site, "GET", "api/v1/cameras/cam30.png", NULL, NULL), ==, 200);
    g_subprocess_force_exit(site->daemon);
    g_subprocess_wait(site->daemon, NULL, NULL);
    g_clear_object(&site->daemon);
    wait_for_state(site, "away");
    g_usleep(3 * G_USEC_PER_SEC); /* it has been looked for in vain */
    g_assert_cmpuint(site_ask(site, "GET", "api/v1/state", NULL, &away), ==, 200);
    assert_has(away, "no mesorigd answers at unix:path=");
    assert_has(away, site->bus);
    g_assert_cmpuint(
        site_ask(site, "POST", "api/v1/safe", "Authorization: Bearer " SITE_TOKEN, &refused), >=,
        400);
    assert_has(refused, site->bus);
    g_assert_cmpuint(site_ask(site, "GET", "api/v1/cameras/cam30.png", NULL, NULL), >=, 400);

    site_start_daemon(site);
    wait_for_state(site, "closed");
    g_autofree char *other = g_strconcat(site->run->directory, "/other.session", NULL);
    operator_does(site->run, 0, "capture", "--address", site->bus, site->run->rig, site->run->conf,
                  "-o", other, NULL);
    wait_for_state(site, "done");
    g_assert_cmpuint(site_ask(site, "GET", "api/v1/cameras/cam30.png", NULL, NULL), ==, 200);
    site_free(site);
}

/* The stream begins with the state, and then has the events, pictures and changes of the capture.
 */
TEST(streams) {
    struct site *site = site_new(SITE_SHOWS, NULL);
    g_autofree char *uri = g_strconcat(site->uri, "api/v1/events", NULL);
    g_autoptr(SoupMessage) message = soup_message_new("GET", uri);
    g_autoptr(GError) error = NULL;
    g_autoptr(GInputStream) body = soup_session_send(site->http, message, NULL, &error);
    g_assert_no_error(error);
    g_autoptr(GDataInputStream) lines = g_data_input_stream_new(body);
    gboolean captured = FALSE, event = FALSE, picture = FALSE, done = FALSE;
    for (int i = 0; i < 10000 && !(event && picture && done); i++) {
        g_autofree char *line = ok(g_data_input_stream_read_line(lines, NULL, NULL, ERR));
        g_assert_nonnull(line);
        event = event || strcmp(line, "event: event") == 0;
        picture = picture || strcmp(line, "event: picture") == 0;
        done = done || strstr(line, "\"shots_done\": 13");
        if (!captured && g_str_has_prefix(line, "data: ")) {
            assert_has(line, "\"state\": \"closed\"");
            captured = TRUE;
            site_capture(site);
        }
    }
    site_free(site);
}

TEST(refuses) {
    static const struct {
        const char *method, *path, *header;
        guint status;
    } all[] = {
        {"POST", "api/v1/pause", NULL, 401},
        {"POST", "api/v1/release", NULL, 401},
        /* Whoever sees the page may stop the rig. */
        {"POST", "api/v1/safe", NULL, 200},
        {"POST", "api/v1/safe", "Origin: http://evil.example", 403},
        {"POST", "api/v1/safe", "Origin: null", 403},
        {"POST", "api/v1/safe", "Sec-Fetch-Site: cross-site", 403},
        {"GET", "api/v1/safe", "Authorization: Bearer " SITE_TOKEN, 405},
        {"GET", "api/v1/state", "Host: evil.example", 421},
        {"GET", "api/v1/state", "Host: localhost.evil.example:80", 421},
        {"GET", "api/v1/state", "Origin: http://evil.example", 403},
        {"DELETE", "api/v1/state", NULL, 405},
        {"POST", "", NULL, 405},
        /* Nothing is captured: the daemon's answer comes back. */
        {"POST", "api/v1/pause", "Authorization: Bearer " SITE_TOKEN, 409},
    };
    struct site *site = site_new(SITE_RIG, NULL), *blind = site_new(SITE_RIG | SITE_SHOWS, NULL),
                *strict = site_new(SITE_RIG | SITE_SAFE_NEEDS_TOKEN, NULL);
    for (gsize i = 0; i < G_N_ELEMENTS(all); i++) {
        g_autofree char *said = NULL;
        const guint status = site_ask(site, all[i].method, all[i].path, all[i].header, &said);
        g_test_message("%s %s %s: %u %s", all[i].method, all[i].path,
                       all[i].header ? all[i].header : "", status, said);
        g_assert_cmpuint(status, ==, all[i].status);
        if (status != 200)
            assert_has(said, "{\"error\": ");
    }
    static const char right[] = "Authorization: Bearer " SITE_TOKEN;
    g_assert_cmpuint(site_ask(blind, "POST", "api/v1/pause", right, NULL), ==, 403);
    g_assert_cmpuint(site_ask(blind, "POST", "api/v1/safe", NULL, NULL), ==, 200);
    g_assert_cmpuint(site_ask(strict, "POST", "api/v1/safe", NULL, NULL), ==, 401);
    g_assert_cmpuint(site_ask(strict, "POST", "api/v1/safe", right, NULL), ==, 200);
    site_free(site);
    site_free(blind);
    site_free(strict);
}

/* One request of a fuzzer: a valid one of which some bytes are others, are gone, or are many. */
static GString *fuzzed(GRand *random, guint16 port) {
    static const char *const seeds[] = {
        "GET / HTTP/1.1\r\nHost: @\r\n\r\n",
        "GET /api/v1/state HTTP/1.1\r\nHost: @\r\n\r\n",
        "GET /api/v1/cameras/cam30.png HTTP/1.1\r\nHost: @\r\n\r\n",
        "POST /api/v1/safe HTTP/1.1\r\nHost: @\r\nAuthorization: Bearer "
        "an-0123456789-tokeN\r\nContent-Length: 0\r\n\r\n",
        "POST /api/v1/abort HTTP/1.1\r\nHost: @\r\nOrigin: http://@\r\n"
        "Content-Length: 4\r\n\r\nabcd",
        "GET /api/v1/events HTTP/1.0\r\nHost: @\r\n\r\n",
        "POST /api/v1/lamps/lamp30/on?for_s=5 HTTP/1.1\r\nHost: @\r\nContent-Length: 0\r\n\r\n",
        "POST /api/v1/files/session/start?session=x HTTP/1.1\r\nHost: @\r\nAuthorization: Bearer "
        "an-0123456789-tokeN\r\nContent-Length: 0\r\n\r\n",
        "GET /api/v1/cameras/cam30/pixels.png?x=1&y=1 HTTP/1.1\r\nHost: @\r\n\r\n",
        "GET /api/v1/sessions/small/report.html HTTP/1.1\r\nHost: @\r\n\r\n",
        "POST /api/v1/continue HTTP/1.1\r\nHost: @\r\nTransfer-Encoding: chunked\r\n\r\n"
        "5\r\nabcde\r\n0\r\n\r\n",
    };
    static const char *const pieces[] = {"../", "%00", "%2e%2e/", "\r\n", "\xff", "A", ": ", "{}"};
    GString *request = g_string_new(seeds[g_rand_int_range(random, 0, G_N_ELEMENTS(seeds))]);
    g_autofree char *name = g_strdup_printf("localhost:%u", port);
    g_string_replace(request, "@", name, 0);
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

TEST(survives) {
    const char *asked = g_getenv("MESORIG_WEB_REQUESTS");
    const int n = asked ? atoi(asked) : REQUESTS;
    struct site *site = site_new(SITE_SAFE_NEEDS_TOKEN | SITE_SESSIONS, NULL);
    g_autoptr(GRand) random = g_rand_new_with_seed(SEED);
    g_autoptr(GSocketClient) client = g_socket_client_new();
    site_capture(site);
    g_autofree char *before = state_of(site);
    for (int i = 0; i < n; i++) {
        g_autoptr(GError) error = NULL;
        g_autoptr(GString) request = fuzzed(random, site->port);
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

TEST(in_browser) {
    struct site *site = site_new(0, NULL);
    Browser *browser = site_browse(site, 390, 844);
    browser_wait(browser, "document.getElementById('state').textContent == 'closed'");
    site_capture(site);
    browser_wait(browser, "document.getElementById('state').textContent == 'done'");
    browser_wait(browser, "document.getElementById('shots').textContent == '13 of 13'");
    browser_wait(browser, "[...document.querySelectorAll('#cameras img')].length == 2 && "
                          "[...document.querySelectorAll('#cameras img')].every(i => i.complete && "
                          "i.naturalWidth > 0)");
    browser_wait(browser, "document.querySelectorAll('#cameras figure > svg path').length == 6");
    browser_wait(browser, "[...document.querySelectorAll('#cameras figcaption')].every(c => "
                          "c.textContent.includes('brightened for this page'))");
    /* The pose: two cameras, lamps and lasers, and the light of the last shot. */
    browser_wait(browser, "['camera', 'lamp', 'laser'].every(c => "
                          "document.querySelectorAll(`#pose .${c}:not(.ray)`).length == 2)");
    browser_wait(browser, "/^Seen from above: turntable /.test("
                          "document.getElementById('pose-text').textContent)");
    /* Nothing shines any more. */
    browser_wait(browser, "document.querySelectorAll('#pose .on, #pose .ray').length == 0");
    browser_wait(browser, "/ lit the last shot |dark frames/.test("
                          "document.getElementById('pose-text').textContent)");
    browser_wait(browser, "document.getElementById('unsafe').hidden");
    browser_wait(browser, "document.getElementById('notice').hidden");
    browser_wait(browser, "document.querySelectorAll('#events li').length > 0");
    browser_wait(browser, "document.querySelectorAll('#devices tr').length > 4");
    /* Nothing is wider than a phone. */
    browser_wait(browser, "document.documentElement.scrollWidth <= innerWidth");
    /* The safe state needs no token, and latches; the release needs one. */
    browser_wait(browser, "document.getElementById('release').hidden");
    g_free(browser_value(browser, "document.getElementById('safe').click()"));
    browser_wait(browser, "!document.getElementById('latched').hidden");
    browser_wait(browser, "!document.getElementById('release').hidden && "
                          "document.getElementById('release').disabled");
    browser_wait(browser, "/^The rig is safe|^Not confirmed yet/.test("
                          "document.getElementById('done').textContent + "
                          "document.getElementById('answer').textContent)");
    /* A wrong token, then the right one. */
    g_free(browser_value(browser, "(sessionStorage.setItem('token', 'wrong'), act('release'))"));
    browser_wait(browser,
                 "document.getElementById('answer').textContent.startsWith('the token is wrong')");
    g_free(browser_value(browser, "document.getElementById('unlock').click()"));
    g_free(browser_value(browser, "(document.getElementById('token').value = '" SITE_TOKEN
                                  "', document.getElementById('token-form').requestSubmit())"));
    browser_wait(browser, "!document.getElementById('release').disabled");
    g_usleep(G_USEC_PER_SEC); /* after a wrong token a quarter of that must pass */
    g_free(browser_value(browser, "document.getElementById('release').click()"));
    browser_wait(browser, "document.getElementById('latched').hidden && "
                          "document.getElementById('answer').textContent == ''");
    /* The daemon goes. */
    g_subprocess_send_signal(site->daemon, SIGTERM);
    browser_wait(browser,
                 "document.getElementById('state').textContent == 'mesorigd does not answer'");
    browser_free(browser);
    site_free(site);
}

/* Returns the mean brightness of the picture of the material in 8 bits. */
#define BRIGHTNESS                                                                                 \
    "(() => { const gl = document.getElementById('material').getContext('webgl2');"                \
    " const p = new Uint8Array(4 * 128 * 128);"                                                    \
    " gl.readPixels(192, 192, 128, 128, gl.RGBA, gl.UNSIGNED_BYTE, p);"                            \
    " return p.reduce((a, b, i) => i % 4 == 3 ? a : a + b, 0) / (3 * 128 * 128); })()"

static double brightness(Browser *browser) {
    g_autofree char *text = browser_value(browser, BRIGHTNESS);
    return g_ascii_strtod(text, NULL);
}

/* Compares the page's interpolation between directions with directions.h, which mesorig-view
 * draws by. */
static void compare_interpolation(Browser *browser, const float *theta_deg, const float *phi_deg,
                                  int n) {
    g_autoptr(Directions) directions = ok(directions_new(theta_deg, phi_deg, n, ERR));
    g_autoptr(GString) places = g_string_new("[");
    g_autoptr(GString) between = g_string_new("[");
    int indices[64], n_triangles, n_pole;
    for (int i = 0; i < n; i++)
        g_string_append_printf(places, "[%g, %g],", (double)theta_deg[i], (double)phi_deg[i]);
    for (int ring = 0; ring < directions_n_rings(directions); ring++) {
        const int members = directions_ring(directions, ring, indices);
        g_string_append_c(between, '[');
        for (int i = 0; i < members; i++)
            g_string_append_printf(between, "%d,", indices[i]);
        g_string_append(between, "],");
    }
    const int *corners = directions_triangles(directions, &n_triangles);
    const int *pole = directions_pole(directions, &n_pole);
    g_string_append(between, "], [");
    for (int i = 0; i < 3 * n_triangles; i++)
        g_string_append_printf(between, "%d,", corners[i]);
    for (int step = 0; step < 60; step++) {
        const double theta = fmod(7.3 * step, 89), phi = fmod(67.9 * step, 360);
        struct direction_weights weights;
        double expected[64] = {0};
        const double fade =
            directions_fade_weights(directions, direction_of_deg(theta, phi), &weights);
        for (int k = 0; k < 4; k++)
            for (int i = 0; i < (weights.index[k] == n ? n_pole : 1); i++)
                expected[weights.index[k] == n ? pole[i] : weights.index[k]] +=
                    (double)weights.weight[k] / (weights.index[k] == n ? n_pole : 1);
        g_autofree char *expression =
            g_strdup_printf("(() => { const {shares, end} = around([%g, %g], %s], %s]);"
                            " const fade = %g <= end ? 1 : Math.cos(%g * Math.PI / 180) / "
                            "Math.cos(end * Math.PI / 180);"
                            " return `${fade} ` + Array.from({length: %d}, (_, i) => "
                            "(shares.find(([k]) => k === i) || [i, 0])[1]).join(' '); })()",
                            theta, phi, places->str, between->str, theta, theta, n);
        g_autofree char *told = browser_value(browser, expression);
        g_auto(GStrv) values = g_strsplit(told, " ", -1);
        g_assert_cmpint(g_strv_length(values), ==, n + 1);
        g_assert_cmpfloat(fabs(g_ascii_strtod(values[0], NULL) - fade), <, 1e-3);
        for (int i = 0; i < n; i++)
            g_assert_cmpfloat(fabs(g_ascii_strtod(values[i + 1], NULL) - expected[i]), <, 1e-3);
    }
}

static void compare_interpolations(Browser *browser) {
    static const float ring_theta[] = {20, 20, 20, 20, 50, 50, 50, 50, 50, 50, 50, 50},
                       ring_phi[] = {10, 100, 190, 280, 0, 45, 90, 135, 180, 225, 270, 315},
                       pole_theta[] = {0, 40, 40, 40, 40, 40},
                       pole_phi[] = {0, 0, 72, 144, 216, 288};
    float theta[24], phi[24];
    for (int i = 0; i < 24; i++) { /* a spiral, as of a dome */
        theta[i] = 3.2f * (float)i;
        phi[i] = (float)fmod(137.5 * i, 360);
    }
    compare_interpolation(browser, ring_theta, ring_phi, G_N_ELEMENTS(ring_theta));
    compare_interpolation(browser, pole_theta, pole_phi, G_N_ELEMENTS(pole_theta));
    compare_interpolation(browser, theta, phi, 24);
}

/* A rig with one view, such as a dome: the sample is seen from this view and cannot be turned. */
static void capture_one_view(struct site *site, Browser *browser) {
    static const struct change one[] = {{"[sample]", "width_mm = 30"},
                                        {"[sample]", "height_mm = 30"},
                                        {"[views]", "rings = 30:1"},
                                        {0}};
    g_autofree char *session = g_build_filename(site->run->directory, "one.session", NULL);
    small_rig_write(site->run->directory, "session.conf", one);
    operator_does(site->run, 0, "capture", "--address", site->bus, site->run->rig, site->run->conf,
                  "-o", session, NULL);
    browser_wait(browser, "document.getElementById('material-error').textContent == "
                          "'All 4 pictures are measured.'");
    browser_wait(browser, "document.getElementById('material-drag-label').hidden");
    browser_wait(browser, "/, seen from θ 30°, φ 0°: measured\\.$/.test("
                          "document.getElementById('material-text').textContent)");
    browser_wait(browser, BRIGHTNESS " > 20");
    g_free(browser_value(browser, "document.getElementById('material').dispatchEvent(new "
                                  "KeyboardEvent('keydown', {key: 'ArrowUp', shiftKey: true}))"));
    browser_wait(browser, "material.view[0] == 30");
}

/* The number of the page ends each capture once, if it is that of the material shown. A refused
 * "finish" is tried again. */
static void stop_at_goal(Browser *browser) {
    g_free(browser_value(
        browser,
        "(async () => { let tried = 0; const session = material.info.session;"
        " const stop = async () => { await stopAtGoal(); return tried; };"
        " act = async () => { tried++; return tried === 1 ? null : {}; };"
        " $('finish').disabled = false; $('good-enough-pct').value = 5; material.error = 0.04;"
        " Object.assign(state, {state: 'running', session: 'another'}); const other = await stop();"
        " state.session = session;"
        " material.error = 0.06; const worse = await stop(); material.error = 0.04;"
        " const refused = await stop(), again = await stop(), done = await stop();"
        " material.info = {...material.info, session: 'next'}; state.session = 'next';"
        " window.stops = [other, worse, refused, again, done, await stop()].join(' '); })()"));
    browser_wait(browser, "window.stops == '0 0 1 2 2 3'");
}

/* The material so far: it is drawn, follows the light by mouse and keyboard, and says what is
 * measured. */
TEST(material) {
    static const struct change small[] = {
        {"[sample]", "width_mm = 30"}, {"[sample]", "height_mm = 30"}, {0}};
    struct site *site = site_new(0, NULL);
    Browser *browser = browser_new(900, 900);
    g_autofree char *none = NULL, *told = NULL;
    g_assert_cmpuint(site_ask(site, "GET", "api/v1/material", NULL, &none), ==, 404);
    assert_has(none, "no session is captured");
    g_assert_cmpuint(site_ask(site, "GET", "api/v1/material/0", NULL, NULL), ==, 404);
    small_rig_write(site->run->directory, "session.conf", small);
    browser_open(browser, site->uri);
    browser_wait(browser, "document.getElementById('material-section').hidden");
    site_capture(site);
    browser_wait(browser, "document.getElementById('material-error').textContent == "
                          "'All 16 pictures are measured.'");
    browser_wait(browser, "material.error === 0");
    g_assert_cmpuint(site_ask(site, "GET", "api/v1/material", NULL, &told), ==, 200);
    assert_has(told, "\"measured\": 16");
    assert_has(told, "\"expected_error\": 0.0");
    assert_has(told, "\"expected_error_range\": [0.0");
    g_assert_cmpuint(site_ask(site, "GET", "api/v1/material/16", NULL, NULL), ==, 404);
    g_assert_cmpuint(site_ask(site, "GET", "api/v1/material/99999999999", NULL, NULL), ==, 404);
    compare_interpolations(browser);
    browser_wait(browser, "/: measured\\.$/.test("
                          "document.getElementById('material-text').textContent)");
    browser_wait(browser, BRIGHTNESS " > 20");
    const double before = brightness(browser);
    browser_wait(browser, "document.querySelectorAll('#material-lights .measured').length == 4");
    /* A low light: the sample is matt, so it becomes darker by the cosine. */
    g_free(browser_value(browser, "(() => { for (let i = 0; i < 10; i++) "
                                  "document.getElementById('material').dispatchEvent(new "
                                  "KeyboardEvent('keydown', {key: 'ArrowUp'})); })()"));
    browser_wait(browser, "/^Light from θ 85°/.test("
                          "document.getElementById('material-text').textContent)");
    browser_wait(browser, "material.requested.size == 0 && !material.frame");
    g_test_message("brightness %.1f, under a low light %.1f", before, brightness(browser));
    g_assert_cmpfloat(brightness(browser), <, 0.6 * before);
    /* A click in the middle of the map brings the light to the zenith. */
    g_free(browser_value(
        browser, "(() => { const m = document.getElementById('material-lights'), b = "
                 "m.getBoundingClientRect(); m.setPointerCapture = () => {}; "
                 "m.dispatchEvent(new PointerEvent('pointerdown', {clientX: b.x + b.width / 2, "
                 "clientY: b.y + b.height / 2})); })()"));
    browser_wait(browser, "/^Light from θ 0°/.test("
                          "document.getElementById('material-text').textContent)");
    browser_wait(browser, "document.documentElement.scrollWidth <= innerWidth");
    capture_one_view(site, browser);
    stop_at_goal(browser);
    browser_free(browser);
    site_free(site);
}

/* “Good enough” ends a capture that is paused by a fault. */
TEST(good_enough) {
    static const struct change gone[] = {{"[camera cam60]", "fault_disconnect_after = 9"},
                                         {"[camera cam60]", "fault_reconnect_s = 100000"},
                                         {0}};
    struct site *site = site_new(0, gone);
    g_assert_cmpuint(site_ask(site, "POST", "api/v1/finish", NULL, NULL), ==, 401);
    operator_does(site->run, 1, "capture", "--address", site->bus, site->run->rig, site->run->conf,
                  "-o", site->run->session, NULL);
    wait_for_state(site, "paused");
    g_assert_cmpuint(
        site_ask(site, "POST", "api/v1/finish", "Authorization: Bearer " SITE_TOKEN, NULL), ==,
        200);
    wait_for_state(site, "done");
    g_assert_cmpuint(
        site_ask(site, "POST", "api/v1/finish", "Authorization: Bearer " SITE_TOKEN, NULL), ==,
        409);
    site_free(site);
}

/* A camera is lost: the page says which one, and how to continue. */
TEST(faults) {
    static const struct change gone[] = {{"[camera cam60]", "fault_disconnect_after = 9"},
                                         {"[camera cam60]", "fault_reconnect_s = 100000"},
                                         {0}};
    struct site *site = site_new(0, gone);
    Browser *browser = site_browse(site, 390, 844);
    operator_does(site->run, 1, "capture", "--address", site->bus, site->run->rig, site->run->conf,
                  "-o", site->run->session, NULL);
    browser_wait(browser, "document.getElementById('state').textContent == 'paused'");
    browser_wait(browser, "!document.getElementById('notice').hidden");
    browser_wait(browser, "document.getElementById('notice-head').textContent == 'Fault: cam60'");
    browser_wait(browser, "document.getElementById('reason').textContent.includes('cam60')");
    browser_wait(browser, "document.querySelectorAll('#steps li').length == 3");
    browser_wait(browser,
                 "document.getElementById('left').textContent.endsWith('after it continues')");
    browser_wait(browser, "document.documentElement.scrollWidth <= innerWidth");
    /* Continue is there for who has the token; the camera is still gone. */
    browser_wait(browser, "document.getElementById('continue').disabled");
    g_free(
        browser_value(browser, "(sessionStorage.setItem('token', '" SITE_TOKEN "'), showState())"));
    browser_wait(browser, "!document.getElementById('continue').disabled");
    /* The light of the shot that failed is off. */
    browser_wait(browser, "document.querySelectorAll('#pose .ray').length == 0");
    browser_free(browser);
    site_free(site);
}

/* A server without a token offers the safe state only, and names commands for the rest. */
TEST(shows_only) {
    struct site *site = site_new(SITE_SHOWS, NULL);
    Browser *browser = site_browse(site, 390, 844);
    browser_wait(browser, "document.getElementById('state').textContent == 'closed'");
    browser_wait(browser, "['pause', 'continue', 'abort', 'release', 'unlock'].every(b => "
                          "document.getElementById(b).hidden)");
    browser_wait(browser, "!document.getElementById('safe').disabled");
    g_free(browser_value(browser,
                         "(state = {...state, state: 'paused', reason: 'why'}, showState())"));
    browser_wait(browser, "document.getElementById('steps').textContent == "
                          "'Run: mesorig continue.'");
    /* A laser that has not confirmed that it is off: it is said first, and drawn. */
    browser_wait(browser, "document.getElementById('unsafe').hidden");
    g_free(browser_value(
        browser, "(state = {...state, state: 'paused', unsafe: ['laser a'], light_class: 'laser', "
                 "light: 'a', places: [{class: 'laser', name: 'a', theta_deg: 30, phi_deg: 0, "
                 "carried: false}], devices: [{class: 'laser', name: 'a', driver: 'x', "
                 "health: 'unsafe: no answer'}]}, showState())"));
    browser_wait(browser, "!document.getElementById('unsafe').hidden");
    browser_wait(browser, "document.getElementById('unsafe-devices').textContent == "
                          "'laser a: no answer'");
    browser_wait(browser, "document.querySelectorAll('#pose .ray.unsafe').length == 1 && "
                          "/ a may shine /.test(document.getElementById('pose-text').textContent)");
    browser_wait(browser, "document.querySelectorAll('#devices .unsafe').length == 1");
    /* It has confirmed. */
    g_free(browser_value(browser,
                         "(state = {...state, unsafe: [], devices: [{class: 'laser', name: 'a', "
                         "driver: 'x', health: 'off'}]}, showState())"));
    browser_wait(browser, "document.getElementById('unsafe').hidden && "
                          "document.querySelectorAll('#pose .ray').length == 0");
    browser_free(browser);
    site_free(site);
}

TESTS_RUN_BY(operator_tests);

BEFORE_TESTS {
    /* So that tests/lsan.supp knows libsoup's functions, which keep no frame pointers. */
    g_setenv("ASAN_OPTIONS", "fast_unwind_on_malloc=0", TRUE);
}
