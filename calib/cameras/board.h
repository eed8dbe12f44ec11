/*
 * Calibration boards, of five prints:
 *
 *   chessboard  squares, the top left one black;
 *   ChArUco     a chessboard with an ArUco or AprilTag marker in each white square. The marker
 *               identifies the square. Markers are numbered along rows, from the top. In boards of
 *               OpenCV before 4.6 with an even number of rows, and in those of calib.io, the top
 *               left square is white (white_first);
 *   markers     markers in columns and rows with white gaps (OpenCV's GridBoard): numbered along
 *               rows, from the top. Kalibr's AprilTag grids (kalibr) are numbered along rows from
 *               the bottom. The markers of such a grid are upside down and have a border of two
 *               cells, and black squares touch the corners of the markers;
 *   circles     dark circles in columns and rows, or bright ones on a dark ground;
 *   staggered   circles in rows. Every second row is moved right by half the distance of two
 *               neighbours (OpenCV's asymmetric grid).
 *
 * The board frame is in millimetres, as printed and seen from above: x to the right, y up, z out of
 * the print. The origin is the centre of the print.
 *
 * A corner of a board is a point that can be found in pictures. Corners have these ids:
 *
 *   chessboard, ChArUco  inner corners of the squares, along rows from the top left;
 *   markers              corners of the markers: 4 · marker + 0 … 3, clockwise from the marker's
 *                        own top left one;
 *   circles, staggered   centres of the circles, along rows from the top left.
 *
 * The functions except board_draw() are pure. Any thread may call all functions.
 */
#pragma once

#include <glib.h>

#define BOARD_MAX_SQUARES 40 /* largest number of squares in a column or row */

enum board_print {
    BOARD_CHESSBOARD,
    BOARD_CHARUCO,
    BOARD_MARKERS,
    BOARD_CIRCLES,
    BOARD_STAGGERED,
};

struct board {
    enum board_print print;
    /* columns: number of squares, markers or circles in a row. rows: number of rows. */
    int columns, rows;
    /* Side of a square. For markers, the side of a marker plus the gap. For circles, the distance
     * between rows, which in a staggered grid is half the distance of neighbours in a row. */
    double square_mm;
    double marker_mm;    /* side of a marker; 0 without markers */
    double circle_mm;    /* diameter of a circle; 0 without circles */
    char dictionary[24]; /* name of a dictionary in vision.h; used only with markers */
    gboolean kalibr;     /* the markers are printed as Kalibr prints them */
    double thickness_mm; /* height of the print above the surface that the board lies on */
    /* The top left square is white. board_find() accepts either colour for a chessboard that looks
     * the same upside down. */
    gboolean white_first;
};

#define BOARD_ERROR board_error_quark()
GQuark board_error_quark(void);
enum board_error {
    BOARD_ERROR_SPEC,
    BOARD_ERROR_IO,
};

/* Parses one of these texts, with lengths in mm:
 *   "8x6,square=9,first=white"                             a chessboard,
 *   "8x8,square=9,marker=6.75,dictionary=4x4_50,first=…"   a ChArUco board,
 *   "6x6,marker=22,gap=6.6,dictionary=6x6_250,grid=opencv" markers, OpenCV's or grid=kalibr,
 *   "7x5,spacing=20,circle=10"                             circles,
 *   "4x11,spacing=20,circle=12,grid=staggered"             staggered circles,
 * and "thickness=3" after each. Defaults: dictionary 4x4_50 (apriltag_36h11 with grid=kalibr),
 * first black, thickness 0. Returns FALSE with BOARD_ERROR_SPEC if spec is not valid; board is then
 * not changed. */
gboolean board_parse(struct board *board, const char *spec, GError **error);
/* returns a text for board_parse(); free it with g_free() */
char *board_spec(const struct board *board);

/* Returns FALSE with BOARD_ERROR_SPEC if the board looks the same upside down. Such boards are
 * - a chessboard whose numbers of columns and rows are both odd or both even;
 * - a symmetric grid of circles;
 * - a staggered grid of circles with an even number of rows.
 * Such a board can calibrate a lens, but not the position of anything. */
gboolean board_check_upright(const struct board *board, GError **error);

/* Gives width and height of the print in mm, without a margin. */
void board_size_mm(const struct board *board, double ret[2]);

/* Returns the number of corners. Their ids are 0 … n − 1. */
int board_n_corners(const struct board *board);
/* Gives the position of a corner in the board frame. */
void board_corner_mm(const struct board *board, int id, double ret_xy_mm[2]);

/* Gives column (from the left) and row (from the top) of a marker. Returns FALSE if the board has
 * no such marker. */
gboolean board_marker_square(const struct board *board, int marker, int *ret_column, int *ret_row);

/* Gives a marker's corners, clockwise from its own top left one. Returns FALSE if the board has no
 * such marker. */
gboolean board_marker_mm(const struct board *board, int marker, double ret_xy_mm[4][2]);

/* Returns the width of the black border of markers, in cells. */
int board_border(const struct board *board);

/* Gives the printed values at n points of the board frame (n × 2, mm), from 0 for black to 1 for
 * white. Outside the board the value is −1. */
void board_values(const struct board *board, const double *xy_mm, int n, float *ret);

/* Options of board_draw(). */
struct board_drawing {
    /* width of the white margin on each side */
    double margin_mm;
    double pixels_a_mm; /* pixels per millimetre of a PNG; SVG and PDF do not use it */
};
/* Writes an SVG, PDF (true to scale) or PNG file. The path must end in .svg, .pdf or .png. Returns
 * FALSE with BOARD_ERROR_SPEC if the path ends otherwise, or if a PNG would have too many pixels.
 * Returns FALSE with BOARD_ERROR_IO if the file cannot be written. */
gboolean board_draw(const struct board *board, const char *path,
                    const struct board_drawing *drawing, GError **error);
