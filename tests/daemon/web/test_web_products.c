/* mesorig-web: files that it makes of sessions, and how its page shows them. */
#include "lib/browser.h"
#include "lib/operator.h"
#include "lib/process.h"
#include "lib/test.h"
#include "lib/web_site.h"

#include <glib/gstdio.h>
#include <string.h>

/* Presses the button of a file, and waits until the page shows the file. mesorigd may close the
 * session only now, or the frames may still be processed. Then the file is out of date or cannot be
 * made, the page says so, and the button is pressed again. */
static void show(Browser *browser, const char *product, const char *head) {
    g_autofree char *click =
        g_strdup_printf("(document.getElementById('product-state').textContent = '', "
                        "document.querySelector('[data-product=%s]').click())",
                        product);
    g_autofree char *shown =
        g_strdup_printf("document.getElementById('product-head').textContent == '%s' && "
                        "!document.getElementById('product').hidden",
                        head);
    g_autofree char *either = g_strdup_printf(
        "(%s) || /anew\\.$|could not be made/.test(document.getElementById('product-state')"
        ".textContent)",
        shown);
    for (int i = 0; i < 30; i++) {
        g_free(browser_value(browser, click));
        browser_wait(browser, either);
        g_autofree char *value = browser_value(browser, shown);
        if (strcmp(value, "true") == 0)
            return;
        g_usleep(G_USEC_PER_SEC);
    }
    g_error("the page does not show %s", head);
}

/* A session is captured and processed, and its report and its material in 3D are shown in a frame.
 * The scripts of the frame have no origin, and so no token. */
TEST(shows_sessions) {
    struct site *site = site_new(SITE_RIG | SITE_SESSIONS, NULL);
    g_autofree char *said = NULL, *headers = NULL;
    operator_does(site->run, 0, "capture", "--address", site->bus, site->run->rig, site->run->conf,
                  "-o", site->run->session, NULL);
    operator_does(site->run, 0, "process", site->run->session, NULL);
    Browser *browser = site_browse(site, 390, 844);
    browser_wait(browser, "document.querySelectorAll('#sessions .product').length == 3");
    browser_wait(browser, "document.querySelector('#sessions .product').disabled");
    site_unlock(browser);
    show(browser, "report", "Report of small");
    show(browser, "page", "3D page of small");
    browser_wait(browser, "document.documentElement.scrollWidth <= innerWidth");
    /* The document of the frame cannot be reached from this page, because its origin is another. */
    browser_wait(browser, "document.getElementById('product-frame').contentDocument === null");
    browser_free(browser);
    g_autofree char *list = site_look(site, "api/v1/products");
    assert_has(list, "\"file\": \"page.html\"");
    g_autofree char *page = site_look(site, "api/v1/sessions/small/page.html");
    assert_has(page, "<title>small");
    headers = site_converse(site, "127.0.0.1",
                            "GET /api/v1/sessions/small/report.html HTTP/1.1\r\nHost: $\r\n\r\n");
    assert_has(
        headers,
        "Content-Security-Policy: sandbox allow-scripts allow-downloads; default-src 'none'");
    /* A later change makes them old. */
    g_autofree char *products = g_build_filename(site->run->session, "products", NULL);
    g_assert_cmpint(g_utime(products, NULL), ==, 0);
    g_assert_cmpuint(site_ask(site, "GET", "api/v1/sessions/small/report.html", NULL, NULL), ==,
                     404);
    /* What cannot be made is said. */
    g_autofree char *broken = g_build_filename(site->run->directory, "broken.session", NULL);
    g_assert_cmpint(g_mkdir(broken, 0700), ==, 0);
    g_free(site_does(site, 200, "api/v1/sessions/broken/make?product=page"));
    g_free(site_does(site, 409, "api/v1/sessions/broken/make?product=page"));
    for (int i = 0; i < 10 * SITE_WAIT_S && !(said && strstr(said, "\"making\": null")); i++) {
        g_usleep(G_USEC_PER_SEC / 10);
        g_free(said);
        said = site_look(site, "api/v1/products");
    }
    assert_has(said, "\"why\": \"");
    assert_has(said, "broken");
    site_free(site);
}

static void write_dome(const char *folder) {
    static const char *const names[] = {"rig.conf", "world.conf", "session.conf"};
    for (gsize i = 0; i < G_N_ELEMENTS(names); i++) {
        g_autofree char *from = g_build_filename(SOURCE_DIR "/etc/demo/dome", names[i], NULL);
        g_autofree char *to = g_build_filename(folder, names[i], NULL), *text = NULL;
        g_assert_true(g_file_get_contents(from, &text, NULL, NULL));
        g_autoptr(GString) less = g_string_new(text);
        g_string_replace(less, "texels = 64", "texels = 16", 0);
        g_string_replace(
            less, "[lights]\ndevices = all",
            "[lights]\ndevices = dome_01; dome_09; dome_17; dome_25; dome_33; dome_41; "
            "dome_49; dome_57",
            0);
        g_assert_true(g_file_set_contents(to, less->str, -1, NULL));
    }
}

/* A dome of fixed lamps over one camera, from the plan to the material in 3D. All of it is done on
 * the page. */
TEST(dome) {
    struct site *site = site_new_of(SITE_RIG | SITE_SESSIONS, write_dome);
    Browser *browser = site_browse(site, 1280, 900);
    browser_wait(browser, "document.getElementById('file').value == 'session'");
    site_unlock(browser);
    browser_set(browser, "session-name", "shell");
    browser_press(browser, "plan");
    browser_wait(browser, "/Views1Lights8/.test("
                          "document.querySelector('#plan-answer dl')?.textContent)");
    browser_press(browser, "start");
    browser_wait(browser, "document.getElementById('state').textContent == 'done'");
    browser_wait(browser, "document.querySelectorAll('#pose .lamp').length == 64");
    browser_wait(browser, "!!document.querySelector('[data-product=page]')");
    show(browser, "page", "3D page of shell");
    show(browser, "report", "Report of shell");
    /* A dome has no lasers to calibrate. */
    browser_set(browser, "calibration-name", "dome");
    browser_press(browser, "calibrate");
    browser_wait(browser, "[...document.querySelectorAll('#calibrate-steps button')].map(b => "
                          "b.dataset.step).join() == 'cameras,lights,radiometry,report'");
    browser_wait(browser, "document.documentElement.scrollWidth <= innerWidth");
    browser_free(browser);
    site_free(site);
}

TESTS_RUN_BY(operator_tests);
