/*
 * Calibration boards, of five prints:
 *
 *   chessboard  squares, the top left one black;
 *   ChArUco     a chessboard with an ArUco or AprilTag marker in each white square, which
 *               identifies it. Markers are numbered along rows, from the top. In boards of
 *               OpenCV before 4.6 with an even number of rows, and in those of calib.io, the top
 *               left square is white (white_first);
 *   markers     markers in columns and rows with white gaps (OpenCV's GridBoard): numbered along
 *               rows, from the top. Kalibr's AprilTag grids (kalibr) are numbered along rows from
 *               the bottom; their markers stand on their heads and have a border of two cells, and
 *               black squares touch the corners of the markers;
 *   circles     dark circles in columns and rows, or bright ones on a dark ground;
 *   staggered   circles of which every second row is moved right by half the distance of two
 *               neighbours (OpenCV's asymmetric grid).
 *
 * Board frame: millimetres, as printed and seen from above: x to the right, y up, z out of the
 * print; the origin is the centre. A board's corners are, by id,
 *   of a chessboard or ChArUco board the inner corners, along rows from the top left;
 *   of markers their corners: 4 · marker + 0 … 3, clockwise from the marker's own top left one;
 *   of circles their centres, along rows from the top left.
 *
 * Pure functions except board_draw(); any thread.
 */
#pragma once

#include <glib.h>

#define BOARD_MAX_SQUARES 40 /* in a column or row */

enum board_print {
    BOARD_CHESSBOARD,
    BOARD_CHARUCO,
    BOARD_MARKERS,
    BOARD_CIRCLES,
    BOARD_STAGGERED,
};

struct board {
    enum board_print print;
    int columns, rows; /* squares, markers, or circles of one row and rows of them */
    double square_mm; /* side of a square; markers: a marker and a gap; circles: from one row to the
                         next, which is half the distance of neighbours in a staggered row */
    double marker_mm; /* side of a marker; 0: there are none */
    double circle_mm; /* diameter of a circle; 0: there are none */
    char dictionary[24];  /* name of a dictionary of vision.h */
    gboolean kalibr;      /* markers are printed as Kalibr prints them */
    double thickness_mm;  /* height of the print above the surface that the board lies on */
    gboolean white_first; /* the top left square is white. board_find() finds that out where a
                             chessboard looks the same upside down */
};

#define BOARD_ERROR board_error_quark()
GQuark board_error_quark(void);
enum board_error {
    BOARD_ERROR_SPEC,
    BOARD_ERROR_IO,
};

/* Parses, with lengths in mm,
 *   "8x6,square=9,first=white"                             a chessboard,
 *   "8x8,square=9,marker=6.75,dictionary=4x4_50,first=…"   a ChArUco board,
 *   "6x6,marker=22,gap=6.6,dictionary=6x6_250,grid=opencv" markers, OpenCV's or grid=kalibr,
 *   "7x5,spacing=20,circle=10"                             circles,
 *   "4x11,spacing=20,circle=12,grid=staggered"             staggered circles,
 * and "thickness=3" after each. Defaults: dictionary 4x4_50 (apriltag_36h11 with grid=kalibr),
 * first black, thickness 0. */
gboolean board_parse(struct board *board, const char *spec, GError **error);
char *board_spec(const struct board *board); /* g_free() */

/* FALSE, and BOARD_ERROR_SPEC: the board looks the same upside down (a chessboard whose columns and
 * rows are both odd or both even, circles unless they are an odd number of staggered rows). A lens
 * can be calibrated with it, but nothing can be placed by it. */
gboolean board_check_upright(const struct board *board, GError **error);

/* Width and height of the print, without a margin. */
void board_size_mm(const struct board *board, double ret[2]);

int board_n_corners(const struct board *board);
void board_corner_mm(const struct board *board, int id, double ret_xy_mm[2]);

/* Column (from the left) and row (from the top) of a marker; FALSE: there is no such marker. */
gboolean board_marker_square(const struct board *board, int marker, int *ret_column, int *ret_row);

/* A marker's corners, clockwise from its own top left one; FALSE: the board has no such marker. */
gboolean board_marker_mm(const struct board *board, int marker, double ret_xy_mm[4][2]);

/* Width of the black border of markers, in cells. */
int board_border(const struct board *board);

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
