#include "picture.h"

#include <chafa.h>
#include <math.h>
#include <poll.h>
#include <string.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

#define ASK_WAIT_MS 200
/* Size in pixels that a cell of the terminal is assumed to have. The size of a sixel picture is
 * computed with this size. */
#define CELL_WIDTH  8
#define CELL_HEIGHT 16

/* Asks the terminal for its primary device attributes (DA1). The answer looks like "ESC [ ? 6 2 ; 4
 * ; … c". Returns whether it contains the number 4, which means that the terminal can show
 * sixels. */
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

static char *draw(const guint8 *rgb, int width, int height, gboolean sixels, int columns,
                  int lines) {
    ChafaCanvasConfig *config = chafa_canvas_config_new();
    ChafaSymbolMap *symbols = chafa_symbol_map_new();
    chafa_symbol_map_add_by_tags(symbols, CHAFA_SYMBOL_TAG_VHALF);
    chafa_canvas_config_set_symbol_map(config, symbols);
    chafa_canvas_config_set_canvas_mode(config, CHAFA_CANVAS_MODE_TRUECOLOR);
    chafa_canvas_config_set_pixel_mode(config,
                                       sixels ? CHAFA_PIXEL_MODE_SIXELS : CHAFA_PIXEL_MODE_SYMBOLS);
    chafa_canvas_config_set_preprocessing_enabled(config, FALSE);
    chafa_canvas_config_set_cell_geometry(config, CELL_WIDTH, CELL_HEIGHT);
    chafa_canvas_config_set_geometry(config, columns, lines);
    ChafaCanvas *canvas = chafa_canvas_new(config);
    chafa_canvas_draw_all_pixels(canvas, CHAFA_PIXEL_RGB8, rgb, width, height, width * 3);
    ChafaTermInfo *terminal = chafa_term_db_get_fallback_info(chafa_term_db_get_default());
    GString *text = chafa_canvas_print(canvas, terminal);
    chafa_term_info_unref(terminal);
    chafa_canvas_unref(canvas);
    chafa_canvas_config_unref(config);
    chafa_symbol_map_unref(symbols);
    g_string_append_c(text, '\n');
    return g_string_free(text, FALSE);
}

char *picture_text(const guint8 *rgb, int width, int height, enum picture_way way, int columns,
                   int lines, int *ret_columns, int *ret_lines) {
    const gboolean sixels = way == PICTURE_SIXEL;
    const gboolean empty = way == PICTURE_NOT || !rgb || width < 1 || height < 1;
    const double cell_width = sixels ? CELL_WIDTH : 1, cell_height = sixels ? CELL_HEIGHT : 2;
    const double across = width / cell_width, down = height / cell_height;
    const double scale = empty ? 0 : MIN(1, MIN(MAX(columns, 1) / across, MAX(lines, 1) / down));
    const int wide = empty ? 0 : MAX(1, (int)lround(scale * across));
    const int high = empty ? 0 : MAX(1, (int)lround(scale * down));
    if (ret_columns)
        *ret_columns = wide;
    if (ret_lines)
        *ret_lines = high;
    return empty ? g_strdup("") : draw(rgb, width, height, sixels, wide, high);
}
