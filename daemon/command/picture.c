#include "picture.h"

#include <poll.h>
#include <string.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

#define ASK_WAIT_MS 200
/* Size of a terminal's cell if it does not report one: for the size of a sixel picture. */
#define CELL_WIDTH  8
#define CELL_HEIGHT 16
#define LEVELS      6 /* of each colour in a sixel picture */

/* The primary device attributes (DA1): "ESC [ ? 6 2 ; 4 ; … c", where 4 stands for sixels. */
static gboolean has_sixels(int fd) {
    struct termios before, raw;
    char answer[128] = "";
    gsize n = 0;
    if (tcgetattr(STDIN_FILENO, &before) != 0)
        return FALSE;
    raw = before;
    raw.c_lflag &= ~(tcflag_t)(ICANON | ECHO);
    tcsetattr(STDIN_FILENO, TCSANOW, &raw);
    struct pollfd input = {.fd = STDIN_FILENO, .events = POLLIN};
    if (write(fd, "\033[c", 3) == 3)
        while (n < sizeof answer - 1 && !strchr(answer, 'c') && poll(&input, 1, ASK_WAIT_MS) > 0) {
            const gssize got = read(STDIN_FILENO, answer + n, sizeof answer - 1 - n);
            if (got <= 0)
                break;
            n += (gsize)got;
            answer[n] = '\0';
        }
    tcsetattr(STDIN_FILENO, TCSANOW, &before);
    return g_regex_match_simple("^\\x1b\\[\\?\\d+(;\\d+)*;4(;\\d+)*c", answer, 0, 0);
}

enum picture_way picture_way(int fd) {
    if (!isatty(fd) || !g_get_charset(NULL))
        return PICTURE_NOT;
    return isatty(STDIN_FILENO) && tcgetpgrp(STDIN_FILENO) == getpgrp() && has_sixels(fd)
               ? PICTURE_SIXEL
               : PICTURE_BLOCKS;
}

void picture_terminal_size(int fd, int *ret_columns, int *ret_lines) {
    struct winsize size;
    const gboolean known = ioctl(fd, TIOCGWINSZ, &size) == 0 && size.ws_col > 0;
    *ret_columns = known ? size.ws_col : 80;
    *ret_lines = known && size.ws_row > 0 ? size.ws_row : 24;
}

/* Means over squares of side pixels. */
static guint8 *shrink(const guint8 *rgb, int width, int side, int to_width, int to_height) {
    guint8 *ret = g_new(guint8, (gsize)to_width * (gsize)to_height * 3);
    for (int y = 0; y < to_height; y++)
        for (int x = 0; x < to_width; x++)
            for (gsize c = 0; c < 3; c++) {
                guint sum = 0;
                for (int k = 0; k < side * side; k++)
                    sum += rgb[((gsize)(y * side + k / side) * (gsize)width +
                                (gsize)(x * side + k % side)) *
                                   3 +
                               c];
                ret[((gsize)y * (gsize)to_width + (gsize)x) * 3 + c] =
                    (guint8)(sum / (guint)(side * side));
            }
    return ret;
}

/* Two pixels a cell, in 24-bit colours: the upper half block over a background. */
static void append_blocks(GString *to, const guint8 *rgb, int width, int height) {
    for (int y = 0; y < height; y += 2) {
        for (int x = 0; x < width; x++) {
            const guint8 *up = &rgb[((gsize)y * (gsize)width + (gsize)x) * 3];
            const guint8 *low = y + 1 < height ? up + (gsize)width * 3 : up;
            g_string_append_printf(to, "\033[38;2;%d;%d;%dm\033[48;2;%d;%d;%dm▀", up[0], up[1],
                                   up[2], low[0], low[1], low[2]);
        }
        g_string_append(to, "\033[0m\n");
    }
}

/* Sixels: bands of six rows, each drawn once for every colour that it has. */
static void append_sixels(GString *to, const guint8 *rgb, int width, int height) {
    g_string_append_printf(to, "\033Pq\"1;1;%d;%d", width, height);
    for (int c = 0; c < LEVELS * LEVELS * LEVELS; c++)
        g_string_append_printf(to, "#%d;2;%d;%d;%d", c, c / (LEVELS * LEVELS) * 100 / (LEVELS - 1),
                               c / LEVELS % LEVELS * 100 / (LEVELS - 1),
                               c % LEVELS * 100 / (LEVELS - 1));
    g_autofree guint8 *bits = g_new(guint8, width);
    for (int top = 0; top < height; top += 6) {
        for (int c = 0; c < LEVELS * LEVELS * LEVELS; c++) {
            gboolean any = FALSE;
            memset(bits, 0, (gsize)width);
            for (int y = top; y < MIN(top + 6, height); y++)
                for (int x = 0; x < width; x++) {
                    const guint8 *p = &rgb[((gsize)y * (gsize)width + (gsize)x) * 3];
                    const int r = (p[0] * (LEVELS - 1) + 127) / 255,
                              g = (p[1] * (LEVELS - 1) + 127) / 255,
                              b = (p[2] * (LEVELS - 1) + 127) / 255;
                    if ((r * LEVELS + g) * LEVELS + b != c)
                        continue;
                    bits[x] |= (guint8)(1 << (y - top));
                    any = TRUE;
                }
            if (!any)
                continue;
            g_string_append_printf(to, "#%d", c);
            for (int x = 0; x < width; x++)
                g_string_append_c(to, (char)(63 + bits[x]));
            g_string_append_c(to, '$');
        }
        g_string_append_c(to, '-');
    }
    g_string_append(to, "\033\\\n");
}

char *picture_text(const guint8 *rgb, int width, int height, enum picture_way way, int columns,
                   int lines, int *ret_columns, int *ret_lines) {
    GString *text = g_string_new(NULL);
    const gboolean blocks = way == PICTURE_BLOCKS;
    const int cell_width = blocks ? 1 : CELL_WIDTH, cell_height = blocks ? 2 : CELL_HEIGHT;
    const int across = MAX(columns, 1) * cell_width, down = MAX(lines, 1) * cell_height;
    const int side = MAX(MAX((width + across - 1) / across, (height + down - 1) / down), 1);
    const int to_width = width / side, to_height = height / side;
    const gboolean empty = way == PICTURE_NOT || !rgb || to_width < 1 || to_height < 1;
    if (ret_columns)
        *ret_columns = empty ? 0 : (to_width + cell_width - 1) / cell_width;
    if (ret_lines)
        *ret_lines = empty ? 0 : (to_height + cell_height - 1) / cell_height;
    if (empty)
        return g_string_free(text, FALSE);
    g_autofree guint8 *small = shrink(rgb, width, side, to_width, to_height);
    (blocks ? append_blocks : append_sixels)(text, small, to_width, to_height);
    return g_string_free(text, FALSE);
}
