/* mesorig-web: files that it makes of sessions, and how its page shows them. */
#include "lib/browser.h"
#include "lib/operator.h"
#include "lib/process.h"
#include "lib/test.h"
#include "lib/web_site.h"

#include <glib/gstdio.h>
#include <string.h>

/* Presses the button of a file, and waits until the page shows the file. mesorigd may close the
 * session only now. Then the file is out of date, the page says so, and the button is pressed
 * again.
 */
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
        "(%s) || document.getElementById('product-state').textContent.endsWith('anew.')", shown);
    for (int i = 0; i < 5; i++) {
        g_free(browser_value(browser, click));
        browser_wait(browser, either);
        g_autofree char *value = browser_value(browser, shown);
        if (strcmp(value, "true") == 0)
            return;
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
    Browser *browser = browser_new(390, 844);
    browser_open(browser, site->uri);
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

TESTS_RUN_BY(operator_tests);
