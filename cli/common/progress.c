#include "progress.h"

#include "cli.h"

#include <math.h>
#include <stdio.h>
#include <sys/ioctl.h>
#include <unistd.h>

#define INTERVAL_US   100000
#define FIRST_LINE_US (1 * G_USEC_PER_SEC)
#define NEXT_LINE_US  (10 * G_USEC_PER_SEC)
#define LONGEST_BAR   40
#define SHORTEST_BAR  8

struct Progress {
    char *what;
    gboolean tty, utf8, drawn;
    /* Times of the first call and of the last drawing; 0 if there was none. */
    gint64 begun_us, shown_us;
    char *above; /* text above the bar */
    /* Number of lines of `above`, and number of these lines that are on the terminal now. */
    int above_lines, above_drawn;
};

Progress *progress_new(const char *what) {
    Progress *progress = g_new0(Progress, 1);
    progress->what = g_strdup(what);
    progress->tty = isatty(STDERR_FILENO);
    progress->utf8 = g_get_charset(NULL);
    return progress;
}

void progress_end(Progress *progress) {
    if (progress->drawn)
        fputc('\n', stderr);
    progress->drawn = FALSE;
    progress->above_drawn = 0;
}

/* Erases the bar and the text above it. */
static void erase(Progress *progress) {
    if (progress->drawn)
        fputs("\r\033[K", stderr);
    if (progress->drawn && progress->above_drawn > 0)
        fprintf(stderr, "\033[%dA\033[J", progress->above_drawn);
    progress->drawn = FALSE;
    progress->above_drawn = 0;
}

void progress_set_above(Progress *progress, const char *text, int lines) {
    if (!progress->tty || cli_json || g_strcmp0(text, progress->above) == 0)
        return;
    erase(progress);
    g_free(progress->above);
    progress->above = g_strdup(text);
    progress->above_lines = lines;
    progress->shown_us = 0;
}

void progress_free(Progress *progress) {
    if (!progress)
        return;
    progress_end(progress);
    g_free(progress->what);
    g_free(progress->above);
    g_free(progress);
}

static void append_bar(GString *line, int width, double fraction, gboolean utf8) {
    static const char *const eighths[] = {" ", "▏", "▎", "▍", "▌", "▋", "▊", "▉"};
    const int full = (int)(fraction * width * 8);
    g_string_append(line, utf8 ? "▕" : "[");
    for (int i = 0; i < width; i++) {
        const int here = full - 8 * i;
        if (here >= 8)
            g_string_append(line, utf8 ? "█" : "#");
        else
            g_string_append(line, utf8 && here > 0 ? eighths[here] : " ");
    }
    g_string_append(line, utf8 ? "▏ " : "] ");
}

/* Draws the bar and the text next to it and, if it was erased, the text above it. The bar takes the
 * width that the text leaves. Commas separate the parts of the text. If the text is too long, its
 * last parts are left out, because a line that wraps could not be overwritten. */
static void draw(Progress *progress, double fraction, const char *text) {
    struct winsize size;
    const int columns =
        ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0 ? size.ws_col : 80;
    g_autoptr(GString) line = g_string_new(NULL);
    g_string_append_printf(line, "%s %3d %% ", progress->what, (int)floor(fraction * 100));
    const int free_columns = columns - 1 - (int)g_utf8_strlen(line->str, -1) - 3;
    g_autofree char *fits = g_strdup(text);
    for (char *comma; (int)g_utf8_strlen(fits, -1) + SHORTEST_BAR > free_columns &&
                      (comma = g_strrstr(fits, ", "));)
        *comma = '\0';
    const int room = free_columns - (int)g_utf8_strlen(fits, -1);
    append_bar(line, CLAMP(room, SHORTEST_BAR, LONGEST_BAR), fraction, progress->utf8);
    g_string_append(line, fits);
    g_autofree char *cut =
        g_utf8_substring(line->str, 0, MIN(columns - 1, (int)g_utf8_strlen(line->str, -1)));
    /* fputs() is used because g_printerr() would replace the control characters of the text. */
    if (progress->above_drawn == 0 && progress->above_lines > 0) {
        erase(progress);
        fputs(progress->above, stderr);
        progress->above_drawn = progress->above_lines;
    }
    fputs("\r", stderr);
    g_printerr("%s", cut);
    fputs("\033[K", stderr);
    progress->drawn = TRUE;
}

void progress_show(Progress *progress, double fraction, const char *text, gboolean now) {
    const gint64 now_us = g_get_monotonic_time();
    fraction = isfinite(fraction) ? CLAMP(fraction, 0, 1) : 0;
    if (cli_json)
        return;
    if (progress->tty) {
        if (!now && now_us < progress->shown_us + INTERVAL_US)
            return;
        progress->shown_us = now_us;
        draw(progress, fraction, text);
        return;
    }
    /* If the output is not a terminal, prints the first line when a second has passed, and a
     * further line after each stage and every ten seconds. */
    if (progress->begun_us == 0)
        progress->begun_us = now_us;
    const gboolean first = progress->shown_us == 0;
    if (first ? now_us >= progress->begun_us + FIRST_LINE_US
              : now || now_us >= progress->shown_us + NEXT_LINE_US) {
        progress->shown_us = now_us;
        g_printerr("%s: %d %%, %s\n", progress->what, (int)floor(fraction * 100), text);
    }
}

void progress_line(Progress *progress, const char *format, ...) {
    va_list arguments;
    if (cli_json)
        return;
    va_start(arguments, format);
    g_autofree char *text = g_strdup_vprintf(format, arguments);
    va_end(arguments);
    erase(progress);
    g_print("%s\n", text);
    fflush(stdout);
}
