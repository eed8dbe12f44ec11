/* What progress writes into a log: nothing for a stage that ends immediately, and few lines for a
 * long one. */
#include "common/progress.h"
#include "common/work.h"

#include "lib/process.h"
#include "lib/test.h"

#include <fcntl.h>
#include <string.h>
#include <unistd.h>

static GString *told;

static void keep(const char *text) {
    g_string_append(told, text);
}

static int lines(void) {
    int n = 0;
    for (const char *at = told->str; *at; at++)
        n += *at == '\n';
    return n;
}

TEST(short) {
    Progress *progress = progress_new("short");
    for (int i = 0; i <= 12; i++)
        progress_show(progress, i / 12.0, "12", i == 12);
    progress_free(progress);
    g_assert_cmpstr(told->str, ==, "");
}

TEST(long) {
    Progress *progress = progress_new("long");
    progress_show(progress, 0.1, "the first", FALSE);
    g_assert_cmpint(lines(), ==, 0);
    g_usleep(1100000);
    progress_show(progress, 0.2, "after a second", FALSE);
    g_assert_cmpstr(told->str, ==, "long: 20 %, after a second\n");
    for (int i = 0; i < 100; i++)
        progress_show(progress, 0.2 + i / 200.0, "soon after", FALSE);
    g_assert_cmpint(lines(), ==, 1);
    progress_show(progress, 1, "its end", TRUE);
    assert_has(told->str, "long: 100 %, its end\n");
    g_assert_cmpint(lines(), ==, 2);
    progress_free(progress);
}

static gboolean tell_again(const struct work *work, gpointer data, GError **error) {
    struct work_progress progress = {"again", 1, 64, -1};
    work->progress(&progress, work->data);
    g_usleep(1100000);
    progress.done = 2;
    work->progress(&progress, work->data);
    progress.done = 64;
    for (int i = 0; i < 100; i++)
        work->progress(&progress, work->data);
    return TRUE;
}

/* Work whose end is reported repeatedly while the next stage runs: there is one line when the work
 * ends, and this line stays, without a time left. */
TEST(again) {
    double seconds;
    g_string_truncate(told, 0);
    g_assert_true(cli_work_run(tell_again, NULL, &seconds, NULL));
    g_test_message("%s", told->str);
    g_assert_cmpint(lines(), ==, 3);
}

BEFORE_TESTS {
    told = g_string_new(NULL);
    /* The output is a log, even if the test itself runs in a terminal. */
    const int null = open("/dev/null", O_WRONLY);
    g_assert_cmpint(dup2(null, STDERR_FILENO), ==, STDERR_FILENO);
    close(null);
    g_set_printerr_handler(keep);
}

AFTER_TESTS {
    g_string_free(told, TRUE);
}
