/*
 * Calibration boards: a chessboard, or a ChArUco board, whose white squares hold markers that say
 * which square they are in.
 *
 * Seen from above, as printed: squares in columns and rows from the top left one, which is black.
 * Markers are numbered along rows, from the top, as OpenCV does since 4.7. Board frame:
 * millimetres, x to the right, y up, z out of the print; the origin is the middle. Inner corner
 * `id` is the (id mod (columns − 1))-th from the left and (id div (columns − 1))-th from the top.
 *
 * Pure functions but for board_draw(); any thread.
 */
#pragma once

#include <glib.h>

#define BOARD_MAX_SQUARES 40 /* in a column or row */

struct board {
    int columns, rows;           /* squares */
    double square_mm, marker_mm; /* marker_mm 0: a chessboard */
    char dictionary[24];         /* as in vision.h */
    double thickness_mm;         /* how high the print lies above what the board lies on */
};

#define BOARD_ERROR board_error_quark()
GQuark board_error_quark(void);
enum board_error {
    BOARD_ERROR_SPEC,
    BOARD_ERROR_IO,
};

/* "8x8,square=9,marker=6.75,dictionary=4x4_50,thickness=3"; without marker a chessboard. The
 * dictionary is 4x4_50 and the thickness 0 if not given. */
gboolean board_parse(struct board *board, const char *spec, GError **error);
char *board_spec(const struct board *board); /* g_free() */

int board_n_corners(const struct board *board);
void board_corner_mm(const struct board *board, int id, double ret_xy_mm[2]);

/* The square of a marker, from the left and top; FALSE: the board has no such marker. */
gboolean board_marker_square(const struct board *board, int marker, int *ret_column, int *ret_row);

/* What is printed at a point of the board frame: 0 black … 1 white; −1 outside. */
double board_value(const struct board *board, double x_mm, double y_mm);
/* The same at n points, x and y of each, in a fraction of the time. */
void board_values(const struct board *board, const double *xy_mm, int n, float *ret);

/* What to draw: millimetres, or for a PNG pixels; margins are white. */
struct board_drawing {
    double margin_mm;
    double pixels_a_mm; /* PNG only */
};
/* Writes FILE.svg, FILE.pdf (true millimetres) or FILE.png by its name's end. */
gboolean board_draw(const struct board *board, const char *path,
                    const struct board_drawing *drawing, GError **error);
