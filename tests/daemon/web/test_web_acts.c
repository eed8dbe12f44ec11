/* mesorig-web with commands: session files and the queue, by HTTP and from the page in a browser.
 */
#include "lib/browser.h"
#include "lib/ok.h"
#include "lib/operator.h"
#include "lib/process.h"
#include "lib/test.h"
#include "lib/web_site.h"

#include <glib/gstdio.h>
#include <json-glib/json-glib.h>
#include <signal.h>
#include <string.h>
#include <unistd.h>

#define RIGHT "Authorization: Bearer " SITE_TOKEN

static JsonParser *parsed(const char *text) {
    JsonParser *parser = json_parser_new();
    ok(json_parser_load_from_data(parser, text, -1, ERR));
    return parser;
}

static JsonObject *object_of(JsonParser *parser) {
    return json_node_get_object(json_parser_get_root(parser));
}

static void wait_for(const struct site *site, const char *words) {
    site_wait(site, "api/v1/state", words, TRUE);
}

/* A session file is listed, planned as `mesorig plan` does, captured, and resumed. */
TEST(captures) {
    struct site *site = site_new(SITE_RIG | SITE_SESSIONS, NULL);
    g_autofree char *files = site_look(site, "api/v1/files");
    assert_has(files, "\"name\": \"session\"");
    g_assert_null(strstr(files, "rig"));
    g_free(site_does(site, 200, "api/v1/files/session/plan"));
    g_autofree char *said = site_does(site, 200, "api/v1/files/session/plan?session=other");
    g_autoptr(JsonParser) here = parsed(said);
    operator_does(site->run, 0, "plan", "--json", "--offline", site->run->rig, site->run->conf,
                  NULL);
    g_autoptr(JsonParser) there = parsed(site->run->out);
    JsonObject *plan = json_object_get_object_member(object_of(here), "plan");
    g_assert_true(json_object_get_boolean_member(object_of(here), "ok"));
    static const char *const keys[] = {"shots", "frames", "views", "lights", "bytes"};
    for (gsize i = 0; i < G_N_ELEMENTS(keys); i++)
        g_assert_cmpint(json_object_get_int_member(plan, keys[i]), ==,
                        json_object_get_int_member(object_of(there), keys[i]));
    g_free(site_does(site, 200, "api/v1/files/session/start?session=other"));
    wait_for(site, "\"state\": \"done\"");
    g_autofree char *other = g_build_filename(site->run->directory, "other.session", NULL);
    g_assert_true(g_file_test(other, G_FILE_TEST_IS_DIR));
    operator_does(site->run, 0, "verify", other, NULL);
    g_autofree char *sessions = site_look(site, "api/v1/sessions");
    assert_has(sessions, "\"name\": \"other\"");
    /* The same directory again: the plan and the daemon say no. */
    g_autofree char *twice = site_does(site, 200, "api/v1/files/session/plan?session=other");
    assert_has(twice, "\"ok\": false");
    g_free(site_does(site, 409, "api/v1/files/session/start?session=other"));
    site_free(site);
}

/* Names that lead out of the folder, links, files that are no text: nothing is read or made. */
TEST(stays_in_the_folder) {
    static const char *const names[] = {"..%2f0%2fsession",
                                        "..",
                                        ".",
                                        ".hidden",
                                        "%2e%2e",
                                        "%2fetc%2fpasswd",
                                        "a%2fb",
                                        "",
                                        "link",
                                        "fifo",
                                        "large",
                                        "binary",
                                        "nothing",
                                        "folder",
                                        "a%0ab",
                                        "%ff"};
    struct site *site = site_new(SITE_RIG | SITE_SESSIONS, NULL);
    const char *directory = site->run->directory;
    g_autofree char *link = g_build_filename(directory, "link.conf", NULL);
    g_autofree char *fifo = g_build_filename(directory, "fifo.conf", NULL);
    g_autofree char *large = g_build_filename(directory, "large.conf", NULL);
    g_autofree char *binary = g_build_filename(directory, "binary.conf", NULL);
    g_autofree char *folder = g_build_filename(directory, "folder.conf", NULL);
    g_autofree char *hidden = g_build_filename(directory, ".hidden.conf", NULL);
    g_autofree char *other = g_build_filename(directory, "link.session", NULL);
    g_autofree char *much = g_strnfill(300 << 10, '\n');
    g_autofree char *text = NULL;
    g_assert_cmpint(symlink(site->run->conf, link), ==, 0);
    g_assert_cmpint(symlink("/tmp", other), ==, 0);
    g_assert_cmpint(mkfifo(fifo, 0600), ==, 0);
    g_assert_cmpint(g_mkdir(folder, 0700), ==, 0);
    g_assert_true(g_file_get_contents(site->run->conf, &text, NULL, NULL));
    g_assert_true(g_file_set_contents(hidden, text, -1, NULL));
    g_autofree char *long_text = g_strconcat(text, much, NULL);
    g_assert_true(g_file_set_contents(large, long_text, -1, NULL));
    g_assert_true(g_file_set_contents(binary, "[session]\n\0\xff", 12, NULL));
    for (gsize i = 0; i < G_N_ELEMENTS(names); i++) {
        static const char *const forms[] = {"api/v1/files/%s/plan",
                                            "api/v1/files/%s/start",
                                            "api/v1/files/%s/queue",
                                            "api/v1/sessions/%s/resume",
                                            "api/v1/sessions/%s/make?product=report",
                                            "api/v1/files/session/start?session=%s"};
        for (gsize k = 0; k < G_N_ELEMENTS(forms); k++) {
            /* As the name of a new session a name of a file is allowed. */
            if (k == 5 && i >= 8 && i < 14)
                continue;
            g_autofree char *path = g_strdup_printf(forms[k], names[i]), *said = NULL;
            const guint status = site_ask(site, "POST", path, RIGHT, &said);
            g_test_message("%s: %u %s", path, status, said);
            g_assert_true(status == 404 || status == 400 || status == 405);
        }
    }
    g_autofree char *files = site_look(site, "api/v1/files");
    g_assert_cmpint(strstr(files, "\"name\"") == g_strrstr(files, "\"name\""), ==, TRUE);
    g_autofree char *sessions = site_look(site, "api/v1/sessions");
    g_assert_null(strstr(sessions, "link"));
    /* The directory of a session that is a link: the daemon sees that something is there. */
    g_free(site_does(site, 409, "api/v1/files/session/start?session=link"));
    g_autofree char *state = site_look(site, "api/v1/state");
    assert_has(state, "\"state\": \"idle\"");
    site_free(site);
}

TEST(refuses) {
    static const char *const paths[] = {"files/session/plan",
                                        "files/session/start",
                                        "files/session/queue",
                                        "sessions/small/resume",
                                        "queue/pause",
                                        "queue/resume",
                                        "queue/1/remove",
                                        "queue/1/move?place=1",
                                        "lamps/lamp30/on?for_s=5",
                                        "lamps/lamp30/off",
                                        "lasers/laser30/on?for_s=5",
                                        "lasers/laser30/off",
                                        "cameras/cam30/snap?exposure_us=4000",
                                        "sessions/small/make?product=report"};
    struct site *site = site_new(SITE_RIG | SITE_SESSIONS | SITE_QUEUE, NULL);
    struct site *shows = site_new(SITE_RIG | SITE_SESSIONS | SITE_SHOWS, NULL);
    struct site *bare = site_new(SITE_RIG, NULL);
    for (gsize i = 0; i < G_N_ELEMENTS(paths); i++) {
        g_autofree char *path = g_strconcat("api/v1/", paths[i], NULL);
        g_assert_cmpuint(site_ask(site, "POST", path, NULL, NULL), ==, 401);
        g_assert_cmpuint(site_ask(site, "GET", path, RIGHT, NULL), ==, 405);
        g_assert_cmpuint(site_ask(site, "POST", path, "Origin: http://evil.example", NULL), ==,
                         403);
        g_assert_cmpuint(site_ask(site, "POST", path, "Host: evil.example", NULL), ==, 421);
        g_assert_cmpuint(site_ask(shows, "POST", path, RIGHT, NULL), ==, 403);
    }
    g_free(site_does(bare, 404, "api/v1/files/session/plan"));
    g_autofree char *none = site_look(bare, "api/v1/files");
    assert_has(none, "\"folder\": false");
    g_free(site_does(site, 400, "api/v1/files/session/start?process=2"));
    g_free(site_does(site, 400, "api/v1/queue/1/move?place=0"));
    g_free(site_does(site, 404, "api/v1/queue/x/remove"));
    g_free(site_does(site, 409, "api/v1/queue/7/remove"));
    g_free(site_does(site, 400, "api/v1/lamps/lamp30/on"));
    g_free(site_does(site, 400, "api/v1/lamps/lamp30/on?for_s=16"));
    g_free(site_does(site, 400, "api/v1/lamps/lamp30/on?for_s=nan"));
    g_free(site_does(site, 400, "api/v1/lamps/lamp30/on?for_s=0"));
    g_free(site_does(site, 409, "api/v1/lamps/nobody/on?for_s=5"));
    g_free(site_does(site, 404, "api/v1/lamps/%ff/on?for_s=5"));
    g_free(site_does(site, 400, "api/v1/sessions/small/make?product=none"));
    g_free(site_does(site, 404, "api/v1/sessions/small/make?product=report"));
    g_free(site_does(site, 409, "api/v1/cameras/nobody/snap?exposure_us=4000"));
    g_free(site_does(site, 404, "api/v1/cameras/%ff/snap?exposure_us=4000"));
    g_free(site_does(site, 400, "api/v1/cameras/cam30/snap?exposure_us=-1"));
    g_autofree char *state = site_look(site, "api/v1/state");
    assert_has(state, "\"state\": \"idle\"");
    site_free(site);
    site_free(shows);
    site_free(bare);
}

TEST(queues) {
    struct site *site = site_new(SITE_RIG | SITE_SESSIONS | SITE_QUEUE, NULL);
    g_free(site_does(site, 200, "api/v1/queue/pause"));
    wait_for(site, "\"queue_state\": \"paused\"");
    g_autofree char *first = site_does(site, 200, "api/v1/files/session/queue?session=a&yes=1");
    assert_has(first, "{\"number\": 1}");
    g_free(site_does(site, 200, "api/v1/files/session/queue?session=b&yes=1"));
    g_free(site_does(site, 200, "api/v1/queue/2/move?place=1"));
    g_free(site_does(site, 200, "api/v1/queue/1/remove"));
    g_free(site_does(site, 200, "api/v1/queue/resume"));
    g_autofree char *b = g_build_filename(site->run->directory, "b.session", NULL);
    wait_for(site, "\"queue_state\": \"empty\"");
    operator_does(site->run, 0, "verify", b, NULL);
    site_free(site);
}

/* Waits until the device of this class has this health. */
static void wait_for_health(const struct site *site, const char *class_name, const char *health) {
    g_autofree char *wanted = g_strdup_printf("\"class\": \"%s\"", class_name);
    for (int i = 0; i < 10 * SITE_WAIT_S; i++) {
        g_autofree char *text = site_look(site, "api/v1/state");
        g_autoptr(JsonParser) parser = parsed(text);
        JsonArray *devices = json_object_get_array_member(object_of(parser), "devices");
        for (guint k = 0; k < json_array_get_length(devices); k++) {
            JsonObject *device = json_array_get_object_element(devices, k);
            if (g_str_equal(json_object_get_string_member(device, "class"), class_name) &&
                g_str_equal(json_object_get_string_member(device, "health"), health))
                return;
        }
        g_usleep(G_USEC_PER_SEC / 20);
    }
    g_error("within %d s no %s was “%s”", SITE_WAIT_S, class_name, health);
}

/* A light goes off by command, at the end of its lease, in the safe state, and when the server
 * ends. */
TEST(lights) {
    struct site *site = site_new(SITE_RIG, NULL);
    g_free(site_does(site, 200, "api/v1/lamps/lamp30/on?for_s=15"));
    wait_for_health(site, "lamps", "1 on");
    g_free(site_does(site, 200, "api/v1/lamps/lamp30/off"));
    wait_for_health(site, "lamps", "off");
    const gint64 begun = g_get_monotonic_time();
    g_free(site_does(site, 200, "api/v1/lasers/laser30/on?for_s=1"));
    wait_for_health(site, "laser", "on");
    g_free(site_does(site, 200, "api/v1/lasers/laser30/on?for_s=2"));
    wait_for_health(site, "laser", "off");
    /* laser60 was off all the time: ask until both are. */
    site_wait(site, "api/v1/state", "\"health\": \"on\"", FALSE);
    g_assert_cmpint(g_get_monotonic_time() - begun, >=, 2 * G_USEC_PER_SEC);
    g_free(site_does(site, 200, "api/v1/lamps/lamp30/on?for_s=15"));
    g_assert_cmpuint(site_ask(site, "POST", "api/v1/safe", NULL, NULL), ==, 200);
    wait_for_health(site, "lamps", "off");
    g_free(site_does(site, 409, "api/v1/lamps/lamp30/on?for_s=15"));
    g_free(site_does(site, 200, "api/v1/release"));
    g_free(site_does(site, 200, "api/v1/lamps/lamp30/on?for_s=15"));
    g_subprocess_send_signal(site->server, SIGTERM);
    g_subprocess_wait(site->server, NULL, NULL);
    operator_does(site->run, 0, "status", "--address", site->bus, NULL);
    for (int i = 0; i < 20 && strstr(site->run->out, "1 on"); i++) {
        g_usleep(G_USEC_PER_SEC / 10);
        operator_does(site->run, 0, "status", "--address", site->bus, NULL);
    }
    g_assert_null(strstr(site->run->out, "1 on"));
    site_free(site);
}

/* The values are those that `mesorig snap` prints, and the pixels are those of its file. */
TEST(pictures) {
    static const char *const keys[] = {"mean_dn", "max_dn", "focus"};
    struct site *site = site_new(SITE_RIG, NULL);
    g_autofree char *none = NULL, *png = NULL, *pixels = NULL;
    g_assert_cmpuint(site_ask(site, "GET", "api/v1/cameras/cam30/snap.png", NULL, NULL), ==, 404);
    g_free(site_does(site, 200, "api/v1/lamps/lamp30/on?for_s=15"));
    g_autofree char *said = site_does(site, 200, "api/v1/cameras/cam30/snap?exposure_us=4000");
    g_free(site_does(site, 200, "api/v1/lamps/lamp30/off"));
    g_autoptr(JsonParser) here = parsed(said);
    operator_does(site->run, 0, "snap", "--address", site->bus, "cam30", "-e", "4000", "--lamp",
                  "lamp30", "--json", NULL);
    g_autoptr(JsonParser) there = parsed(site->run->out);
    for (gsize i = 0; i < G_N_ELEMENTS(keys); i++) {
        const double a = json_object_get_double_member(object_of(here), keys[i]);
        const double b = json_object_get_double_member(object_of(there), keys[i]);
        g_test_message("%s: %g, %g", keys[i], a, b);
        g_assert_cmpfloat(b, >, 0);
        g_assert_cmpfloat_with_epsilon(a / b, 1, 0.1); /* the noise differs */
    }
    JsonArray *histogram = json_object_get_array_member(object_of(here), "histogram");
    gint64 sum = 0;
    for (guint i = 0; i < json_array_get_length(histogram); i++)
        sum += json_array_get_int_element(histogram, i);
    g_assert_cmpint(sum, ==, 32 * 32);
    g_assert_cmpuint(site_ask(site, "GET", "api/v1/cameras/cam30/snap.png", NULL, &png), ==, 200);
    g_assert_cmpmem(png, 4, "\x89PNG", 4);
    g_assert_cmpuint(
        site_ask(site, "GET", "api/v1/cameras/cam30/pixels.png?x=9&y=65536", NULL, &pixels), ==,
        200);
    g_assert_cmpmem(pixels, 4, "\x89PNG", 4);
    g_assert_cmpuint(site_ask(site, "GET", "api/v1/cameras/cam30/pixels.png?x=-1&y=0", NULL, NULL),
                     ==, 400);
    g_assert_cmpuint(site_ask(site, "GET", "api/v1/cameras/cam30/pixels.png?x=nan&y=0", NULL, NULL),
                     ==, 400);
    g_assert_cmpuint(site_ask(site, "GET", "api/v1/cameras/cam60/snap.png", NULL, NULL), ==, 404);
    site_free(site);
}

/* From the page alone: a plan, a capture, a session in the queue. On a desktop, then on a phone. */
static void capture_from_page(int width, int height) {
    struct site *site = site_new(SITE_RIG | SITE_SESSIONS | SITE_QUEUE, NULL);
    Browser *browser = site_browse(site, width, height);
    browser_wait(browser, "document.getElementById('state').textContent == 'idle'");
    browser_wait(browser, "document.getElementById('file').value == 'session'");
    browser_wait(browser, "document.getElementById('plan').disabled");
    site_unlock(browser);
    browser_wait(browser, "document.getElementById('start').disabled");
    browser_press(browser, "plan");
    browser_wait(browser, "/Time.*On disk.*Shots13/.test("
                          "document.querySelector('#plan-answer dl')?.textContent)");
    /* Another name needs another plan. */
    browser_set(browser, "session-name", "from page");
    browser_wait(browser, "document.getElementById('start').disabled");
    browser_press(browser, "plan");
    browser_press(browser, "start");
    browser_wait(browser, "document.getElementById('state').textContent == 'done'");
    browser_wait(browser, "document.getElementById('sessions').textContent.includes('from page')");
    g_autofree char *made = g_build_filename(site->run->directory, "from page.session", NULL);
    operator_does(site->run, 0, "verify", made, NULL);
    browser_press(browser, "queue-pause");
    browser_wait(browser, "document.getElementById('queue-pause').disabled");
    browser_set(browser, "session-name", "queued");
    browser_press(browser, "plan");
    browser_press(browser, "enqueue");
    browser_wait(browser, "document.querySelectorAll('#queue li').length == 1");
    g_free(browser_value(browser, "document.querySelector('#queue button').click()"));
    browser_wait(browser, "document.querySelectorAll('#queue li').length == 0");
    /* A mistake is shown, and Start stays disabled. */
    browser_set(browser, "session-name", "from page");
    browser_press(browser, "plan");
    browser_wait(browser, "document.querySelector('#plan-answer .mistakes') && "
                          "document.getElementById('start').disabled");
    browser_wait(browser, "document.documentElement.scrollWidth <= innerWidth");
    browser_wait(browser, "document.getElementById('answer').textContent == ''");
    browser_free(browser);
    site_free(site);
}

/* A lamp from the page: on, renewed beyond its lease, off; off when the page is left or a capture
 * begins; and off at the end of the lease when the renewals do not arrive. */
TEST(lights_of_the_page) {
    struct site *site = site_new(SITE_RIG | SITE_SESSIONS, NULL);
    Browser *browser = site_browse(site, 390, 844);
    browser_wait(browser, "document.querySelectorAll('#light option').length == 4");
    browser_wait(browser, "document.getElementById('light-on').disabled");
    site_unlock(browser);
    browser_press(browser, "light-on");
    browser_wait(browser, "document.getElementById('light-state').textContent == 'lamp30 is on.'");
    wait_for_health(site, "lamps", "1 on");
    g_usleep(11 * G_USEC_PER_SEC); /* longer than both leases */
    wait_for_health(site, "lamps", "1 on");
    browser_press(browser, "light-off");
    browser_wait(browser, "document.getElementById('light-state').textContent == 'lamp30 is off.'");
    wait_for_health(site, "lamps", "off");
    browser_press(browser, "light-on");
    browser_wait(browser, "document.getElementById('light-state').textContent == 'lamp30 is on.'");
    browser_open(browser, "about:blank");
    wait_for_health(site, "lamps", "off");
    /* Renewals that the server does not get, and a page that cannot say “off”. */
    browser_open(browser, site->uri);
    browser_wait(browser, "document.querySelectorAll('#light option').length == 4");
    browser_press(browser, "light-on");
    browser_wait(browser, "document.getElementById('light-state').textContent == 'lamp30 is on.'");
    g_free(browser_value(browser, "(window.fetch = () => new Promise(() => {}), 1)"));
    wait_for_health(site, "lamps", "off");
    /* The safe state by the button, while a light is on. */
    browser_open(browser, "about:blank");
    browser_open(browser, site->uri);
    browser_wait(browser, "document.querySelectorAll('#light option').length == 4");
    browser_press(browser, "light-on");
    browser_wait(browser, "document.getElementById('light-state').textContent == 'lamp30 is on.'");
    browser_press(browser, "safe");
    wait_for_health(site, "lamps", "off");
    browser_wait(browser, "document.getElementById('light-on').disabled && "
                          "document.getElementById('light-off').disabled && "
                          "!document.getElementById('safe').disabled");
    browser_wait(browser, "document.documentElement.scrollWidth <= innerWidth");
    browser_free(browser);
    site_free(site);
}

/* A picture under a lamp that was switched on from the page. */
TEST(live_view) {
    struct site *site = site_new(SITE_RIG, NULL);
    Browser *browser = site_browse(site, 390, 844);
    browser_wait(browser, "document.querySelectorAll('#snap-camera option').length == 2");
    browser_wait(browser, "document.getElementById('snap').disabled");
    site_unlock(browser);
    browser_press(browser, "snap");
    browser_wait(browser,
                 "/Focustoo dark/.test(document.getElementById('snap-values').textContent)");
    browser_press(browser, "light-on");
    browser_wait(browser, "document.getElementById('light-state').textContent == 'lamp30 is on.'");
    browser_press(browser, "snap");
    browser_wait(browser, "/Mean[1-9]\\d* of \\d+ DN.*Focus\\d/.test("
                          "document.getElementById('snap-values').textContent)");
    browser_wait(browser, "['snap-picture', 'snap-pixels'].every(i => "
                          "document.getElementById(i).complete && "
                          "document.getElementById(i).naturalWidth > 0)");
    browser_wait(browser, "document.getElementById('snap-pixels').naturalWidth == 32");
    browser_wait(browser, "document.querySelectorAll('#snap-histogram path').length == 64");
    browser_press(browser, "light-off");
    browser_wait(browser, "document.documentElement.scrollWidth <= innerWidth");
    browser_free(browser);
    site_free(site);
}

TEST(page_on_a_desktop) {
    capture_from_page(1280, 900);
}

TEST(page_on_a_phone) {
    capture_from_page(390, 844);
}

TESTS_RUN_BY(operator_tests);

BEFORE_TESTS {
    /* So that tests/lsan.supp knows libsoup's functions, which keep no frame pointers. */
    g_setenv("ASAN_OPTIONS", "fast_unwind_on_malloc=0", TRUE);
}
