/* The way of a new user through the page of mesorig-web, on a desktop and on a phone: a calibration
 * with all steps, a plan with it, and a capture. With the variable MESORIG_PICTURES it writes
 * the pictures of docs/operate/web.md into that folder. It takes some minutes, so that it is no
 * test of CTest. */
#include "calibration/calibration.h"
#include "lib/browser.h"
#include "lib/demo_part.h"
#include "lib/ok.h"
#include "lib/operator.h"
#include "lib/test.h"
#include "lib/web_site.h"

#include <string.h>

static void write_files(const char *folder) {
    g_autofree char *poles = NULL, *to = g_build_filename(folder, "poles.conf", NULL);
    demo_part_write(folder);
    demo_part_write_targets(folder);
    demo_part_write_plate(folder, "plate1.conf", 1);
    demo_part_write_plate(folder, "plate8.conf", 8);
    demo_part_write_session(folder, "session.conf",
                            "width_mm=50\nheight_mm=50\ntexels=64\nreference_mm=2.2\ndepth_mm=2.2",
                            "30:4; 60:6", "30:6; 60:8", NULL, "exposures_us=4000;16000");
    ok(g_file_get_contents(SOURCE_DIR "/etc/demo/poles.conf", &poles, NULL, ERR));
    ok(g_file_set_contents(to, poles, -1, ERR));
}

/* Writes a picture of the page from this element on, for the documents. */
static void picture(Browser *browser, const char *id, const char *name, gboolean phone) {
    const char *folder = g_getenv("MESORIG_PICTURES");
    if (!folder)
        return;
    g_autofree char *file = g_strdup_printf("web_%s%s.jpg", name, phone ? "_phone" : "");
    g_autofree char *path = g_build_filename(folder, file, NULL);
    browser_picture(browser, id, path);
}

static void capture(Browser *browser, const struct site *site, const char *file,
                    enum demo_target target, double height_mm, const char *session) {
    g_autofree char *listed =
        g_strdup_printf("document.getElementById('step-list').textContent.includes('%s')", session);
    demo_part_lay(site->run->directory, target, height_mm);
    site_reopen(site);
    browser_set(browser, "step-file", file);
    browser_press(browser, "step-capture");
    browser_wait(browser, listed);
    browser_wait(browser, "document.getElementById('state').textContent == 'done'");
}

static void find(Browser *browser, const char *step, gboolean phone) {
    g_autofree char *ready =
        g_strdup_printf("document.getElementById('step-frame').src.endsWith('step=%s') && "
                        "document.getElementById('step-state').textContent == ''",
                        step);
    browser_press(browser, "step-find");
    browser_wait(browser, "document.getElementById('step-state').textContent == "
                          "'The pictures are being searched …'");
    for (int i = 0; i < 3; i++) /* radiometry takes long with sanitizers */
        browser_wait(browser, "document.getElementById('step-state').textContent != "
                              "'The pictures are being searched …'");
    browser_wait(browser, ready);
    browser_wait(browser, "document.documentElement.scrollWidth <= innerWidth");
    picture(browser, strcmp(step, "report") == 0 ? "step-head" : "step-result", step, phone);
}

/* Opens the page of the site and gives it the token. */
static Browser *browse(struct site *site, int width, int height) {
    Browser *browser = site_browse(site, width, height);
    browser_wait(browser, "document.getElementById('file').value == 'board'");
    site_unlock(browser);
    return browser;
}

static void go_through(int width, int height) {
    const gboolean phone = width < 600;
    struct site *site = site_new_of(SITE_RIG | SITE_SESSIONS, write_files);
    Browser *browser = browse(site, width, height);
    browser_set(browser, "calibration-name", "rig");
    browser_press(browser, "calibrate");
    picture(browser, "calibrate-head", "calibrate", phone);
    capture(browser, site, "board", DEMO_BOARD_FLAT, 0, "rig-cameras-1");
    capture(browser, site, "board", DEMO_BOARD_LEANING, 0, "rig-cameras-2");
    find(browser, "cameras", phone);
    browser_press(browser, "step-next");
    capture(browser, site, "lights", DEMO_POLES, 0, "rig-lights-1");
    find(browser, "lights", phone);
    browser_press(browser, "step-next");
    capture(browser, site, "plate1", DEMO_PLATE, 1, "rig-laser-1");
    capture(browser, site, "plate8", DEMO_PLATE, 8, "rig-laser-2");
    find(browser, "laser", phone);
    browser_press(browser, "step-next");
    capture(browser, site, "tile", DEMO_TILE, 0, "rig-radiometry-1");
    find(browser, "radiometry", phone);
    browser_press(browser, "step-next");
    find(browser, "report", phone);
    browser_press(browser, "step-keep");
    browser_wait(browser, "document.getElementById('calibration').value == 'rig'");
    g_autofree char *path = g_build_filename(site->run->directory, "rig.calibration", NULL);
    g_autoptr(Calibration) found = ok(calibration_read(path, ERR));
    for (int i = 0; i < CALIBRATION_PARTS; i++)
        g_assert_true(found->parts[i].done);
    /* A plan with it. */
    browser_set(browser, "file", "session");
    browser_press(browser, "plan");
    browser_wait(browser, "!document.getElementById('start').disabled");
    picture(browser, "capture-head", "plan", phone);
    browser_free(browser);
    site_free(site);
}

/* A capture, while the material appears. */
static void capture_sample(int width, int height) {
    const gboolean phone = width < 600;
    struct site *site = site_new_of(SITE_RIG | SITE_SESSIONS, write_files);
    Browser *browser = browse(site, width, height);
    browser_set(browser, "file", "session");
    browser_press(browser, "plan");
    browser_press(browser, "start");
    browser_wait(browser, "!document.getElementById('material-section').hidden");
    browser_wait(browser, "/^[2-9]\\d of/.test(document.getElementById('shots').textContent)");
    browser_press(browser, "pause");
    browser_wait(browser, "document.getElementById('state').textContent == 'paused'");
    picture(browser, "material-section", "material", phone);
    browser_press(browser, "continue");
    browser_wait(browser, "document.getElementById('state').textContent == 'running'");
    picture(browser, "session", "progress", phone);
    browser_wait(browser, "document.getElementById('state').textContent == 'done'");
    browser_wait(browser, "!!document.querySelector('[data-product=report]')");
    /* A report is out of date as soon as a further frame is processed. */
    for (gboolean shown = FALSE; !shown;) {
        g_free(browser_value(browser, "(document.getElementById('product-state').textContent = '', "
                                      "document.querySelector('[data-product=report]').click())"));
        browser_wait(browser,
                     "!document.getElementById('product').hidden || "
                     "document.getElementById('product-state').textContent.endsWith('anew.')");
        g_autofree char *value =
            browser_value(browser, "!document.getElementById('product').hidden");
        shown = strcmp(value, "true") == 0;
    }
    picture(browser, "sessions-head", "sessions", phone);
    browser_wait(browser, "document.documentElement.scrollWidth <= innerWidth");
    browser_free(browser);
    site_free(site);
}

TEST(desktop) {
    go_through(1280, 900);
}

TEST(phone) {
    go_through(390, 844);
}

TEST(capture_on_a_desktop) {
    capture_sample(1280, 900);
}

TEST(capture_on_a_phone) {
    capture_sample(390, 844);
}

TESTS_RUN_BY(operator_tests);
