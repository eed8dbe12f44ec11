/* Pictures on a terminal, as sixels or as half blocks. */
#pragma once

#include <glib.h>

enum picture_way { PICTURE_NOT, PICTURE_BLOCKS, PICTURE_SIXEL };

/* Finds how the terminal at a file descriptor can show pictures by asking the terminal, which takes
 * at most 0.2 s. Returns PICTURE_NOT if the descriptor is not a terminal, or if the terminal does
 * not use UTF-8. */
enum picture_way picture_way(int fd);

/* Returns a picture (height × width × 3, sRGB) as text of at most the given columns and lines.
 * Pictures are never enlarged. ret_columns and ret_lines (may be NULL) are the columns and lines
 * that the text takes. The text is empty for PICTURE_NOT and if rgb is NULL. g_free() */
char *picture_text(const guint8 *rgb, int width, int height, enum picture_way way, int columns,
                   int lines, int *ret_columns, int *ret_lines);

/* Gives the size of the terminal at a file descriptor; 80 × 24 if the terminal does not report its
 * size. */
void picture_terminal_size(int fd, int *ret_columns, int *ret_lines);
