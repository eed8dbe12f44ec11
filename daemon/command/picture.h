/* Pictures on a terminal, as sixels or as half blocks. */
#pragma once

#include <glib.h>

enum picture_way { PICTURE_NOT, PICTURE_BLOCKS, PICTURE_SIXEL };

/* How the terminal at a file descriptor can show pictures: asks the terminal, for 0.2 s at most.
 * PICTURE_NOT if the descriptor is no terminal, or one without UTF-8. */
enum picture_way picture_way(int fd);

/* A picture (height × width × 3, sRGB) as text, at most so many columns wide and lines high, and
 * never enlarged. ret_columns and ret_lines (may be NULL): the columns and lines that it takes.
 * Empty for PICTURE_NOT and for no picture (rgb NULL). g_free() */
char *picture_text(const guint8 *rgb, int width, int height, enum picture_way way, int columns,
                   int lines, int *ret_columns, int *ret_lines);

/* The size of the terminal at a file descriptor; 80 × 24 if it does not tell its size. */
void picture_terminal_size(int fd, int *ret_columns, int *ret_lines);
