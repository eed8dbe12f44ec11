/* mesorig-web: a calibration from the page, step by step, and requests that it must refuse. All
 * steps are in web_tour.c. */
#include "lib/browser.h"
#include "lib/demo_part.h"
#include "lib/ok.h"
#include "lib/operator.h"
#include "lib/process.h"
#include "lib/test.h"
#include "lib/web_site.h"

#include <glib/gstdio.h>
#include <signal.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define RIGHT "Authorization: Bearer " SITE_TOKEN
#define FIND  "api/v1/calibrations/rig/find?step="
#define BOARD DEMO_PART_BOARD

static void write_files(const char *folder) {
    demo_part_write(folder);
    demo_part_write_session(folder, "board.conf",
                            "width_mm=72\nheight_mm=72\ntexels=8\nreference_mm=3\ndepth_mm=3",
                            "30:5; 60:5", "30:1", NULL, "exposures_us=8000");
    demo_part_write_session(folder, "session.conf",
                            "width_mm=50\nheight_mm=50\ntexels=8\nreference_mm=2.2\ndepth_mm=2.2",
                            "30:1; 60:1", "30:1", NULL, "exposures_us=8000");
    demo_part_lay(folder, DEMO_BOARD_FLAT, 0);
}

/* Captures the target that lies on the turntable, from the page. */
static void capture(Browser *browser, const char *session) {
    g_autofree char *listed =
        g_strdup_printf("document.getElementById('step-list').textContent.includes('%s')", session);
    browser_press(browser, "step-capture");
    browser_wait(browser, listed);
    browser_wait(browser, "document.getElementById('state').textContent == 'done'");
}

/* Searches the pictures, and waits for the answer. */
static void find(Browser *browser, const char *condition) {
    browser_press(browser, "step-find");
    browser_wait(browser, "document.getElementById('step-state').textContent == "
                          "'The pictures are being searched …'");
    browser_wait(browser, "document.getElementById('step-state').textContent != "
                          "'The pictures are being searched …'");
    browser_wait(browser, condition);
}

static char *text_of(const struct site *site, const char *name) {
    g_autofree char *path = g_build_filename(site->run->directory, name, NULL);
    char *text = NULL;
    g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
    return text;
}

/* Returns whether the marks of a page lie in its pictures, and are near the places that the
 * calibration predicts. */
static void check_page(const char *page, int least, double most_px) {
    int n = 0, width = 0, height = 0;
    double worst_px = 0;
    for (const char *at = page; (at = strchr(at, '<')); at++) {
        double x, y, px;
        if (sscanf(at, "<svg viewBox=\"0 0 %d %d\"", &width, &height) == 2 || width == 0)
            continue;
        if (sscanf(at, "<circle cx=\"%lf\" cy=\"%lf\"", &x, &y) == 2) {
            g_assert_true(x > 0 && x < width && y > 0 && y < height);
            n++;
        }
        if (sscanf(at, "<br>%*d found, %lf px RMS", &px) == 1)
            worst_px = MAX(worst_px, px);
    }
    g_test_message("%d marks, at most %.3f px RMS", n, worst_px);
    g_assert_cmpint(n, >, least);
    g_assert_cmpfloat(worst_px, >, 0);
    g_assert_cmpfloat(worst_px, <, most_px);
}

/* The cameras: a board, pictures without a board, a result that stays, the report, and a capture
 * with the calibration. */
TEST(cameras) {
    struct site *site = site_new_of(SITE_RIG | SITE_SESSIONS, write_files);
    Browser *browser = site_browse(site, 390, 844);
    browser_wait(browser, "document.getElementById('file').value == 'board'");
    browser_wait(browser, "document.getElementById('calibrate').disabled");
    site_unlock(browser);
    browser_set(browser, "calibration-name", "rig");
    browser_press(browser, "calibrate");
    browser_wait(browser, "document.getElementById('step-file').value == 'board' && "
                          "document.getElementById('step-option').value == '" BOARD "' && "
                          "document.querySelectorAll('#calibrate-steps button').length == 5");
    browser_press(browser, "step-board");
    browser_wait(browser, "document.getElementById('step-board-file').offsetParent !== null");
    capture(browser, "rig-cameras-1");
    /* One position of the board is not enough: the pictures are shown, and nothing is stored. */
    find(browser, "document.getElementById('step-state').className == 'bad' && "
                  "document.getElementById('step-frame').src.endsWith('step=failed')");
    g_autofree char *failed = site_look(site, "api/v1/calibrations/rig/page.html?step=failed");
    assert_has(failed, "class=\"failure\"");
    assert_has(failed, "data:image/png");
    demo_part_lay(site->run->directory, DEMO_BOARD_LEANING, 0);
    site_reopen(site);
    capture(browser, "rig-cameras-2");
    find(browser, "/^\\d+ pictures, \\d+ corners, "
                  "[^/]*$/.test(document.getElementById('step-result').textContent) && "
                  "document.getElementById('step-frame').src.endsWith('step=cameras')");
    g_autofree char *page = site_look(site, "api/v1/calibrations/rig/page.html?step=cameras");
    check_page(page, 500, 0.3);
    g_autofree char *found = text_of(site, "rig.calibrating/cameras.calibration");
    /* Pictures without a board: the good result stays. */
    demo_part_lay(site->run->directory, DEMO_PLATE, 1);
    site_reopen(site);
    capture(browser, "rig-cameras-3");
    g_free(browser_value(browser, "document.querySelectorAll('#step-list input')[0].click()"));
    g_free(browser_value(browser, "document.querySelectorAll('#step-list input')[1].click()"));
    find(browser, "document.getElementById('step-state').className == 'bad' && "
                  "/Nothing is lost/.test(document.getElementById('step-state').textContent)");
    g_autofree char *still = text_of(site, "rig.calibrating/cameras.calibration");
    g_assert_cmpstr(still, ==, found);
    /* The report, and the calibration in use. */
    g_free(browser_value(browser, "document.querySelector('[data-step=report]').click()"));
    browser_press(browser, "step-find");
    browser_wait(browser, "document.getElementById('step-frame').src.endsWith('step=report')");
    browser_press(browser, "step-keep");
    browser_wait(browser, "document.getElementById('calibration').value == 'rig'");
    browser_wait(browser, "document.getElementById('step-keep').disabled");
    g_autofree char *kept = text_of(site, "rig.calibration");
    g_assert_cmpstr(kept, ==, found);
    browser_set(browser, "file", "session");
    browser_press(browser, "plan");
    browser_press(browser, "start");
    browser_wait(browser, "!!document.querySelector('#sessions [data-session=session]')");
    browser_wait(browser, "document.getElementById('state').textContent == 'done'");
    g_autofree char *session = g_build_filename(site->run->directory, "session.session", NULL);
    operator_does(site->run, 0, "info", session, NULL);
    assert_has(site->run->out, "rig.calibration");
    browser_wait(browser, "document.documentElement.scrollWidth <= innerWidth");
    /* Nothing replaces a calibration. */
    g_free(site_does(site, 409, "api/v1/calibrations/rig/keep"));
    g_free(site_does(site, 409, FIND "cameras&sessions=rig-cameras-1&board=" BOARD));
    g_autofree char *after = text_of(site, "rig.calibration");
    g_assert_cmpstr(after, ==, found);
    browser_free(browser);
    site_free(site);
}

/* Requests without a token, with names that lead out of the folder, and links. */
TEST(refuses) {
    static const char *const names[] = {"..", "..%2f0", "%2fetc", ".hidden",
                                        "",   "a%2fb",  "%ff",    "a%0ab"};
    static const char *const forms[] = {"api/v1/calibrations/%s/find?step=board&board=" BOARD,
                                        "api/v1/calibrations/%s/keep",
                                        FIND "cameras&board=" BOARD "&sessions=%s",
                                        FIND "lights&sessions=small&target=%s",
                                        "api/v1/files/session/plan?calibration=%s",
                                        "api/v1/files/session/start?calibration=%s"};
    struct site *site = site_new(SITE_RIG | SITE_SESSIONS, NULL);
    const char *directory = site->run->directory;
    g_autofree char *small = g_build_filename(directory, "small.session", NULL);
    g_autofree char *draft = g_build_filename(directory, "link.calibrating", NULL);
    g_autofree char *linked = g_build_filename(directory, "link2.calibration", NULL);
    g_autofree char *elsewhere = g_build_filename(operator_folder(), "elsewhere", NULL);
    g_assert_cmpint(g_mkdir(small, 0700), ==, 0);
    g_assert_cmpint(g_mkdir(elsewhere, 0700), ==, 0);
    g_assert_cmpint(symlink(elsewhere, draft), ==, 0);
    g_assert_cmpint(symlink("/etc/passwd", linked), ==, 0);
    for (gsize f = 0; f < G_N_ELEMENTS(forms); f++) {
        for (gsize i = 0; i < G_N_ELEMENTS(names); i++) {
            g_autofree char *path = g_strdup_printf(forms[f], names[i]), *said = NULL;
            const guint status = site_ask(site, "POST", path, RIGHT, &said);
            g_test_message("%s: %u %s", path, status, said);
            g_assert_true(status == 404 || status == 400 || status == 405);
        }
        g_autofree char *good = g_strdup_printf(forms[f], "small");
        g_assert_cmpuint(site_ask(site, "POST", good, NULL, NULL), ==, 401);
        g_assert_cmpuint(site_ask(site, "GET", good, RIGHT, NULL), ==, 405);
        g_assert_cmpuint(site_ask(site, "POST", good, "Origin: http://evil.example", NULL), ==,
                         403);
    }
    /* A draft that is a link is not followed; a calibration that is a link is not read. */
    g_free(site_does(site, 409, "api/v1/calibrations/link/find?step=board&board=" BOARD));
    g_free(site_does(site, 409, "api/v1/calibrations/link2/keep"));
    g_free(site_does(site, 404, "api/v1/files/session/start?calibration=link2"));
    g_autoptr(GDir) dir = ok(g_dir_open(elsewhere, 0, ERR));
    g_assert_null(g_dir_read_name(dir));
    /* Queries that lack something. */
    g_free(site_does(site, 409, FIND "cameras&sessions=small"));
    g_free(site_does(site, 409, FIND "cameras&board=" BOARD));
    g_free(site_does(site, 409, FIND "lights&sessions=small"));
    g_free(site_does(site, 409, FIND "radiometry&sessions=small"));
    g_free(site_does(site, 400, FIND "cameras&board=&sessions=small"));
    g_free(site_does(site, 400, FIND "radiometry&sessions=small&reflectance=2"));
    g_free(site_does(site, 400, FIND "board&reflectance=2&board=" BOARD));
    g_free(site_does(site, 400, FIND "nothing"));
    g_free(site_does(site, 409, FIND "report"));
    g_free(site_does(site, 409, "api/v1/calibrations/rig/keep"));
    g_free(site_does(site, 404, FIND "lights&sessions=small&target=nothing"));
    g_assert_cmpuint(site_ask(site, "GET", "api/v1/calibrations/rig/page.html?step=x", NULL, NULL),
                     ==, 400);
    g_assert_cmpuint(
        site_ask(site, "GET", "api/v1/calibrations/link/page.html?step=report", NULL, NULL), ==,
        404);
    g_assert_cmpuint(site_ask(site, "GET", "api/v1/calibrations/rig/board.pdf", NULL, NULL), ==,
                     404);
    /* A board that is none, and a session without pictures: mesorig says so. */
    g_free(site_does(site, 200, FIND "board&board=--help"));
    site_wait(site, "api/v1/calibrations", "\"working\": null", TRUE);
    site_wait(site, "api/v1/calibrations", "\"step\": \"board\", \"why\": ", TRUE);
    g_free(site_does(site, 200, FIND "cameras&sessions=small&board=" BOARD));
    site_wait(site, "api/v1/calibrations", "\"step\": \"cameras\", \"why\": ", TRUE);
    g_autofree char *rig = g_build_filename(directory, "rig.calibration", NULL);
    g_assert_false(g_file_test(rig, G_FILE_TEST_EXISTS));
    site_free(site);
}

/* Two clients at the same time: one of them is refused, and so is a step after an end of the
 * server. */
TEST(one_at_a_time) {
    struct site *site = site_new(SITE_RIG | SITE_SESSIONS, NULL);
    g_autofree char *small = g_build_filename(site->run->directory, "small.session", NULL);
    g_autofree char *second = g_build_filename(site->run->directory, "other.calibrating", NULL);
    g_assert_cmpint(g_mkdir(small, 0700), ==, 0);
    g_free(site_does(site, 200, FIND "board&board=" BOARD));
    g_free(site_does(site, 409, FIND "board&board=" BOARD));
    g_free(site_does(site, 409, "api/v1/calibrations/other/find?step=board&board=" BOARD));
    g_free(site_does(site, 409, "api/v1/sessions/small/make?product=report"));
    g_assert_false(g_file_test(second, G_FILE_TEST_EXISTS));
    site_wait(site, "api/v1/calibrations", "\"working\": null", TRUE);
    site_wait(site, "api/v1/calibrations", "board.pdf", TRUE);
    g_autofree char *pdf = NULL;
    g_assert_cmpuint(site_ask(site, "GET", "api/v1/calibrations/rig/board.pdf", NULL, &pdf), ==,
                     200);
    g_assert_true(g_str_has_prefix(pdf, "%PDF-"));
    /* The server ends while a step is computed. site_free() checks its exit code. */
    g_free(site_does(site, 200, FIND "board&board=" BOARD));
    site_free(site);
}

/* The daemon dies while a target is captured. The step says how many shots are there, and the
 * session is continued. */
TEST(daemon_dies) {
    struct site *site = site_new_of(SITE_RIG | SITE_SESSIONS, write_files);
    g_free(site_does(site, 200, "api/v1/files/board/start?session=rig-cameras-1"));
    site_wait(site, "api/v1/state", "\"shots_done\": 0", FALSE);
    g_subprocess_send_signal(site->daemon, SIGKILL);
    g_subprocess_wait(site->daemon, NULL, NULL);
    g_object_unref(site->daemon);
    site_wait(site, "api/v1/state", "\"state\": \"away\"", TRUE);
    g_free(site_does(site, 409, "api/v1/files/board/start?session=rig-cameras-2"));
    g_free(site_does(site, 200, FIND "cameras&sessions=rig-cameras-1&board=" BOARD));
    site_wait(site, "api/v1/calibrations", "mesorig resume", TRUE);
    g_autofree char *socket = g_build_filename(site->run->directory, "bus", NULL);
    g_unlink(socket);
    site_start_daemon(site);
    site_wait(site, "api/v1/state", "\"state\": \"away\"", FALSE);
    site_open(site);
    g_free(site_does(site, 200, "api/v1/sessions/rig-cameras-1/resume"));
    site_wait(site, "api/v1/state", "\"state\": \"done\"", TRUE);
    g_autofree char *session =
        g_build_filename(site->run->directory, "rig-cameras-1.session", NULL);
    operator_does(site->run, 0, "verify", session, NULL);
    site_free(site);
}

TESTS_RUN_BY(operator_tests);

BEFORE_TESTS {
    /* So that tests/lsan.supp knows libsoup's functions, which keep no frame pointers. */
    g_setenv("ASAN_OPTIONS", "fast_unwind_on_malloc=0", TRUE);
}
