/* Pictures on a terminal, progress bars, and the lines above them. */
#include <poll.h>
#include <pty.h>
#include <stdio.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "common/picture.h"
#include "common/progress.h"
#include "common/work.h"
#include "lib/test.h"

static int count(const char *text, const char *piece) {
    int n = 0;
    for (const char *at = text; (at = strstr(at, piece)); at += strlen(piece))
        n++;
    return n;
}

/* Two rows of pixels a line, in half blocks of two colours. */
TEST(blocks) {
    enum { WIDTH = 4, HEIGHT = 3 };
    guint8 rgb[WIDTH * HEIGHT * 3];
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        rgb[3 * i] = i < WIDTH ? 250 : 10;
        rgb[3 * i + 1] = 20;
        rgb[3 * i + 2] = 30;
    }
    int columns = 0, lines = 0;
    g_autofree char *text =
        picture_text(rgb, WIDTH, HEIGHT, PICTURE_BLOCKS, 80, 24, &columns, &lines);
    g_assert_cmpint(columns, ==, WIDTH);
    g_assert_cmpint(lines, ==, 2);
    g_auto(GStrv) rows = g_strsplit(text, "\n", -1);
    g_assert_cmpuint(g_strv_length(rows), ==, 3);
    int low[3], up[3];
    const char *first = strstr(rows[0], "\033[38;2;");
    g_assert_nonnull(first);
    g_assert_cmpint(sscanf(first, "\033[38;2;%d;%d;%d;48;2;%d;%d;%dm▄", &low[0], &low[1], &low[2],
                           &up[0], &up[1], &up[2]),
                    ==, 6);
    g_assert_cmpint(up[0], >, 2 * low[0]);
    g_assert_cmpint(ABS(up[1] - 20) + ABS(low[1] - 20) + ABS(up[2] - 30) + ABS(low[2] - 30), <=, 8);
    for (int i = 0; i < 2; i++)
        g_assert_true(g_str_has_suffix(rows[i], "\033[0m"));
}

/* Too large for the terminal: means of squares, within the columns and lines. */
TEST(shrunk) {
    enum { WIDTH = 60, HEIGHT = 40 };
    guint8 rgb[WIDTH * HEIGHT * 3];
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        rgb[3 * i] = (guint8)(i % WIDTH < WIDTH / 2 ? 0 : 200);
        rgb[3 * i + 1] = (guint8)(i % 2 ? 0 : 100);
        rgb[3 * i + 2] = 7;
    }
    for (int wide = 1; wide < 70; wide++)
        for (int high = 1; high < 25; high++) {
            int columns = 0, lines = 0;
            g_autofree char *text =
                picture_text(rgb, WIDTH, HEIGHT, PICTURE_BLOCKS, wide, high, &columns, &lines);
            g_assert_cmpint(columns, <=, wide);
            g_assert_cmpint(lines, <=, high);
            g_assert_cmpint(count(text, "\n"), ==, lines);
            g_assert_cmpint(count(text, "▀") + count(text, "▄"), ==, lines * columns);
        }
    g_autofree char *text = picture_text(rgb, WIDTH, HEIGHT, PICTURE_BLOCKS, 6, 24, NULL, NULL);
    int grey[2];
    for (int right = 0; right < 2; right++) { /* the same in both lines */
        const char *begin = right ? "[38;2;200;" : "[38;2;0;", *at = strstr(text, begin);
        g_assert_cmpint(count(text, begin), ==, 2);
        g_assert_cmpint(sscanf(at + strlen(begin), "%d;%d", &grey[0], &grey[1]), ==, 2);
        g_assert_cmpint(ABS(grey[0] - 50), <=, 2);
        g_assert_cmpint(grey[1], ==, 7);
    }
}

TEST(others) {
    static const guint8 rgb[3 * 8 * 8] = {0};
    int columns = 1, lines = 1;
    g_autofree char *none = picture_text(rgb, 8, 8, PICTURE_NOT, 80, 24, &columns, &lines);
    g_autofree char *missing = picture_text(NULL, 0, 0, PICTURE_BLOCKS, 80, 24, NULL, NULL);
    g_autofree char *sixels = picture_text(rgb, 8, 8, PICTURE_SIXEL, 80, 24, NULL, NULL);
    g_assert_cmpstr(none, ==, "");
    g_assert_cmpint(columns + lines, ==, 0);
    g_assert_cmpstr(missing, ==, "");
    g_assert_true(g_str_has_prefix(sixels, "\033P0;1;0q"));
    g_assert_true(g_str_has_suffix(sixels, "\033\\\n"));
}

/* What a function writes to a terminal of 60 columns, in a process of its own. */
static char *on_terminal(void (*draw)(void)) {
    const struct winsize size = {.ws_row = 20, .ws_col = 60};
    GString *text = g_string_new(NULL);
    char bytes[4096];
    gssize got;
    int terminal, status;
    const pid_t child = forkpty(&terminal, NULL, NULL, &size);
    g_assert_cmpint(child, >=, 0);
    if (child == 0) {
        draw();
        fflush(stdout);
        fflush(stderr);
        _exit(0);
    }
    struct pollfd input = {.fd = terminal, .events = POLLIN};
    while (poll(&input, 1, 10000) > 0 && (got = read(terminal, bytes, sizeof bytes)) > 0)
        g_string_append_len(text, bytes, got);
    g_assert_cmpint(waitpid(child, &status, 0), ==, child);
    g_assert_cmpint(status, ==, 0);
    close(terminal);
    return g_string_free(text, FALSE);
}

static void draw_above(void) {
    Progress *progress = progress_new("capture");
    progress_set_above(progress, "picture\npose\n", 2);
    progress_show(progress, 0.1, "one", TRUE);
    progress_show(progress, 0.2, "two", TRUE); /* what stands above stays */
    progress_line(progress, "an event");
    progress_show(progress, 0.3, "three", TRUE); /* and is drawn again below the event */
    progress_set_above(progress, "picture\nanother pose\n", 2);
    progress_show(progress, 0.4, "four", TRUE);
    progress_free(progress);
}

TEST(above) {
    g_autofree char *text = on_terminal(draw_above);
    const char *places[] = {"picture\r\npose\r\n",
                            "one",
                            "two",
                            "\033[2A\033[J",
                            "an event\r\n",
                            "picture\r\npose\r\n",
                            "three",
                            "\033[2A\033[J",
                            "picture\r\nanother pose\r\n",
                            "four"};
    const char *at = text;
    for (gsize i = 0; i < G_N_ELEMENTS(places); i++) {
        at = strstr(at, places[i]);
        if (!at)
            g_error("“%s” is missing, or not where it should be, in “%s”", places[i], text);
        at += strlen(places[i]);
    }
    g_assert_cmpint(count(text, "picture"), ==, 3);
    g_assert_cmpint(count(text, "\033[J"), ==, 2);
}

static gboolean some_stages(const struct work *work, gpointer data, GError **error) {
    static const struct work_progress all[] = {
        {"nothing", 0, 0, -1}, {"first", 1, 2, 9}, {"first", 2, 2, 5}, {"second", 1, 1, 3}};
    for (gsize i = 0; i < G_N_ELEMENTS(all); i++)
        work->progress(&all[i], work->data);
    return TRUE;
}

static void draw_stages(void) {
    cli_work_run(some_stages, NULL, NULL, NULL);
}

/* A stage with nothing to do has no bar, and a bar that stays does not show the time that was left.
 */
TEST(stages) {
    g_autofree char *text = on_terminal(draw_stages);
    g_auto(GStrv) lines = g_strsplit(text, "\r\n", -1);
    g_assert_cmpuint(g_strv_length(lines), ==, 3); /* the last one is empty */
    g_assert_cmpstr(lines[2], ==, "");
    g_assert_null(strstr(text, "nothing"));
    g_assert_nonnull(strstr(lines[0], "5.0 s left"));
    for (int i = 0; i < 2; i++) {
        const char *last = strrchr(lines[i], '\r'); /* what is drawn over the rest */
        g_assert_nonnull(last);
        g_assert_nonnull(strstr(last, i == 0 ? "first" : "second"));
        g_assert_nonnull(strstr(last, i == 0 ? "2/2\033[K" : "1/1\033[K"));
    }
}
