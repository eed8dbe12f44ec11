/* Pictures on a terminal, as sixels (coloured pixels) or as half blocks (characters such as “▀” in
 * two colours). */
#pragma once

#include <glib.h>

enum picture_way { PICTURE_NOT, PICTURE_BLOCKS, PICTURE_SIXEL };

/* Asks the terminal at a file descriptor how it can show pictures, which takes at most 0.2 s.
 * Returns PICTURE_NOT if the descriptor is not a terminal, or if the terminal does not use
 * UTF-8. */
enum picture_way picture_way(int fd);

/* Returns a picture (height × width × 3, sRGB) as text of at most the given columns and lines.
 * Pictures are never enlarged. ret_columns and ret_lines are set to the columns and lines that the
 * text takes, and may be NULL. If `way` is PICTURE_NOT or rgb is NULL, the text is empty. Free it
 * with g_free(). */
char *picture_text(const guint8 *rgb, int width, int height, enum picture_way way, int columns,
                   int lines, int *ret_columns, int *ret_lines);

/* Gives the size of the terminal at a file descriptor in characters. The size is 80 × 24 if the
 * terminal does not report it. */
void picture_terminal_size(int fd, int *ret_columns, int *ret_lines);
