/* mesorig test --report: what the page says of the small rig, what it does not say, and that a
 * phone shows it. */
#include "lib/browser.h"
#include "lib/ok.h"
#include "lib/operator.h"
#include "lib/test.h"
#include "lib/text_file.h"

#include "hands/test_report.h"

#include <math.h>
#include <string.h>

static int count(const char *in, const char *what) {
    int n = 0;
    for (; (in = strstr(in, what)); in += strlen(what))
        n++;
    return n;
}

static void assert_lacks(const char *in, const char *what) {
    if (strstr(in, what))
        g_error("“%s” is in the page", what);
}

/* Tests a rig. Returns the page; g_free(). */
static char *tested(struct operation *run, int code, char **ret_path) {
    char *path = g_build_filename(run->directory, "page.html", NULL);
    operator_does(run, code, "test", "--rig", run->rig, "--report", path, NULL);
    char *html = text_file_read(path);
    *ret_path = path;
    return html;
}

TEST(small_rig) {
    struct operation *run = operator_new(NULL);
    g_autofree char *path = NULL;
    g_autofree char *html = tested(run, 0, &path);
    assert_has(html, "<h1>Test of the rig small</h1>");
    assert_has(html, "together: <span class=\"pass\">pass</span>");
    g_assert_cmpint(count(html, "<td class=\"pass\">pass</td>"), ==, 11);
    g_assert_cmpint(count(html, "<td class=\"n\">5.0000°</td>"), ==, 8); /* commanded and reached */
    g_assert_cmpint(count(html, "<td>read back</td>"), ==, 4);
    g_assert_cmpint(count(html, "src=\"data:image/png;base64,"), ==, 2);
    g_assert_cmpint(count(html, "<svg role=\"img\" aria-label=\"Histogram of cam"), ==, 2);
    assert_has(html, "<h3>cam30</h3>");
    assert_has(html, "cam30 under lamp30, 10000 µs");
    assert_has(html, "<th>Size</th><td>32 × 32 pixels of 12 bits, rggb</td>");
    assert_has(html, "mesorig-recording 1\n");
    assert_has(html, "[axis turntable] move to 5.0000\n");
    /* A stranger learns nothing about the computer. */
    assert_lacks(html, run->directory);
    assert_lacks(html, "http://");
    assert_lacks(html, "https://");
    if (strlen(g_get_host_name()) >= 4)
        assert_lacks(html, g_get_host_name());
    operator_free(run);
}

TEST(faults) {
    struct operation *run =
        operator_new((const struct change[]){{"[lamps bank]", "fault_dead = lamp60"}, {0}});
    g_autofree char *path = NULL;
    g_autofree char *html = tested(run, 1, &path);
    assert_has(html, "together: <span class=\"failure\">failure</span>");
    g_assert_cmpint(count(html, "<td class=\"failure\">failure</td><th>lamp lamp60</th>"), ==, 1);
    assert_has(html, "10 of 11 as they should be");
    operator_free(run);
}

TEST(phone) {
    struct operation *run = operator_new(NULL);
    g_autofree char *path = NULL;
    g_autofree char *html = tested(run, 0, &path);
    g_autofree char *uri = g_filename_to_uri(path, NULL, NULL);
    Browser *browser = browser_new(390, 800);
    browser_open(browser, uri);
    browser_wait(browser, "document.readyState == 'complete'");
    static const struct {
        const char *expression, *value;
    } cases[] = {
        {"document.documentElement.scrollWidth <= window.innerWidth", "true"},
        {"performance.getEntriesByType('resource').filter(r => !r.name.startsWith('data:')).length",
         "0"},
        {"[...document.images].filter(i => i.complete && i.naturalWidth >= 16).length", "2"},
        {"document.querySelectorAll('svg rect').length > 10", "true"},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        g_autofree char *value = browser_value(browser, cases[i].expression);
        if (strcmp(value, cases[i].value) != 0)
            g_error("%s: %s, not %s", cases[i].expression, value, cases[i].value);
    }
    browser_free(browser);
    operator_free(run);
}

/* Two pictures with independent noise of a known deviation, and a change of brightness. */
TEST(noise) {
    g_autoptr(GRand) rand = g_rand_new_with_seed(7);
    g_autoptr(Frame) a = frame_new(400, 300), b = frame_new(400, 300), other = frame_new(300, 400);
    const double sigma_dn = 20;
    for (int i = 0; i < 400 * 300; i++)
        for (int k = 0; k < 2; k++) {
            double sum = -6; /* of 12 uniform numbers: deviation 1 */
            for (int j = 0; j < 12; j++)
                sum += g_rand_double(rand);
            (k ? b : a)->pixels[i] =
                (guint16)lround(1000 + 2 * (i % 400) + 30 * k + sigma_dn * sum);
        }
    g_assert_cmpfloat_with_epsilon(test_noise_dn(a, b), sigma_dn, 0.02 * sigma_dn);
    g_assert_cmpfloat(test_noise_dn(a, a), ==, 0);
    g_assert_true(isnan(test_noise_dn(a, other)));
}

TESTS_RUN_BY(operator_tests);
