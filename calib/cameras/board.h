/*
 * Calibration boards: a chessboard, or a ChArUco board, whose white squares contain markers that
 * identify the square.
 *
 * As printed and seen from above: squares in columns and rows from the top left one, which is
 * black. Markers are numbered along rows, from the top, as in OpenCV since 4.7. Board frame:
 * millimetres, x to the right, y up, z out of the print; the origin is the centre. Inner corner
 * `id` is the (id mod (columns − 1))-th from the left and the (id div (columns − 1))-th from the
 * top.
 *
 * Pure functions except board_draw(); any thread.
 */
#pragma once

#include <glib.h>

#define BOARD_MAX_SQUARES 40 /* in a column or row */

struct board {
    int columns, rows;           /* squares */
    double square_mm, marker_mm; /* marker_mm 0: a chessboard */
    char dictionary[24];         /* as in vision.h */
    double thickness_mm;         /* height of the print above the surface that the board lies on */
    gboolean white_first; /* a chessboard whose top left square is white; only board_find() sets it,
                             of one that looks the same upside down */
};

#define BOARD_ERROR board_error_quark()
GQuark board_error_quark(void);
enum board_error {
    BOARD_ERROR_SPEC,
    BOARD_ERROR_IO,
};

/* Parses "8x8,square=9,marker=6.75,dictionary=4x4_50,thickness=3"; without marker a chessboard.
 * Defaults: dictionary 4x4_50, thickness 0. */
gboolean board_parse(struct board *board, const char *spec, GError **error);
char *board_spec(const struct board *board); /* g_free() */

/* FALSE, and BOARD_ERROR_SPEC: a chessboard whose columns and rows are both odd or both even looks
 * the same upside down. A lens can be calibrated with it, but nothing can be placed by it. */
gboolean board_check_upright(const struct board *board, GError **error);

int board_n_corners(const struct board *board);
void board_corner_mm(const struct board *board, int id, double ret_xy_mm[2]);

/* Column (from the left) and row (from the top) of a marker's square; FALSE: the board has no
 * such marker. */
gboolean board_marker_square(const struct board *board, int marker, int *ret_column, int *ret_row);

/* Printed values at n points of the board frame (n × 2, mm): 0 black … 1 white; −1 outside. */
void board_values(const struct board *board, const double *xy_mm, int n, float *ret);

/* Drawing options; margins are white. */
struct board_drawing {
    double margin_mm;
    double pixels_a_mm; /* resolution of a PNG */
};
/* Writes an SVG, PDF (true to scale) or PNG file, by the suffix of the path. */
gboolean board_draw(const struct board *board, const char *path,
                    const struct board_drawing *drawing, GError **error);
