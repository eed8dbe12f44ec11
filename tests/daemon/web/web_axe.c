/* The page of mesorig-web against the rules of axe-core, in each step from the plan to the report,
 * on a desktop and on a phone. AXE is the path of axe.min.js. No rule may be violated. */
#include "lib/browser.h"
#include "lib/ok.h"
#include "lib/operator.h"
#include "lib/test.h"
#include "lib/web_site.h"

#include <string.h>

static void check(Browser *browser, const char *step) {
    g_autofree char *axe = NULL;
    ok(g_file_get_contents(AXE, &axe, NULL, ERR));
    g_autofree char *load = g_strdup_printf("(() => {%s\nreturn 1;})()", axe);
    g_free(browser_value(browser, load));
    g_free(browser_value(
        browser,
        "(window.found = '', axe.run(document, {iframes: false}).then(result => {"
        "window.found = `${result.passes.length} passes\\n` + result.violations.map(each => "
        "`${each.id}: ${each.help}: ${each.nodes.map(node => node.target).join(', ')}`)"
        ".join('\\n'); }))"));
    browser_wait(browser, "window.found != ''");
    g_autofree char *found = browser_value(browser, "window.found");
    g_test_message("%s: %s", step, found);
    /* A page of which nothing was checked has no violation either. */
    g_assert_cmpint(atoi(found), >, 20);
    const char *violations = strchr(found, '\n') + 1;
    if (*violations)
        g_error("%s: %s", step, violations);
}

static void go_through(int width, int height) {
    struct site *site = site_new(SITE_RIG | SITE_SESSIONS | SITE_QUEUE, NULL);
    Browser *browser = site_browse(site, width, height);
    browser_wait(browser, "document.getElementById('file').value == 'session'");
    check(browser, "without the token");
    browser_press(browser, "unlock");
    check(browser, "token");
    site_unlock(browser);
    browser_press(browser, "plan");
    browser_wait(browser, "!document.getElementById('start').disabled");
    browser_press(browser, "light-on");
    browser_wait(browser, "document.getElementById('light-state').textContent == 'lamp30 is on.'");
    browser_press(browser, "snap");
    browser_wait(browser, "!document.getElementById('snap-answer').hidden");
    browser_set(browser, "calibration-name", "rig");
    browser_press(browser, "calibrate");
    browser_press(browser, "step-board");
    browser_wait(browser, "!document.getElementById('step-board-file').hidden");
    check(browser, "plan, light, picture, step of a calibration");
    browser_press(browser, "light-off");
    browser_press(browser, "start");
    browser_wait(browser, "document.getElementById('state').textContent == 'done'");
    browser_wait(browser, "!!document.querySelector('[data-product=report]')");
    browser_press(browser, "queue-pause");
    browser_press(browser, "plan");
    browser_wait(browser, "!!document.querySelector('#plan-answer .mistakes')");
    check(browser, "done, and a session that cannot be captured");
    g_free(browser_value(browser, "document.querySelector('[data-product=report]').click()"));
    browser_wait(browser, "!document.getElementById('product').hidden || "
                          "document.getElementById('product-state').textContent.endsWith('anew.')");
    check(browser, "report");
    browser_press(browser, "safe");
    browser_wait(browser, "!document.getElementById('latched').hidden");
    check(browser, "safe state");
    browser_free(browser);
    site_free(site);
}

TEST(desktop) {
    go_through(1280, 900);
}

TEST(phone) {
    go_through(390, 844);
}

TESTS_RUN_BY(operator_tests);
