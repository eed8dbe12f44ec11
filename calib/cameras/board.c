/* Specification and geometry of calibration boards. Corner positions: x = (column − columns/2) ·
 * square, y = (rows/2 − row) · square, from the centre of the board. */
#include "board.h"

#include "pictures/vision.h"

#include <math.h>
#include <string.h>

#define MAX_MM 2000

G_DEFINE_QUARK(board_error, board_error)

static gboolean refuse(const char *spec, GError **error, const char *why) {
    g_set_error(
        error, BOARD_ERROR, BOARD_ERROR_SPEC,
        "board “%s”: %s; write 8x8,square=9,marker=6.75,dictionary=4x4_50,thickness=3 (mm), "
        "or without marker for a chessboard",
        spec, why);
    return FALSE;
}

static gboolean board_check(const struct board *board, const char *spec, GError **error) {
    int markers = 0;

    if (!(board->square_mm > 0))
        return refuse(spec, error, "the size of a square is missing or 0; give square=MM");
    if (board->marker_mm == 0)
        return TRUE;
    if (board->marker_mm >= 0.95 * board->square_mm || board->marker_mm < 0.3 * board->square_mm)
        return refuse(spec, error, "a marker must be 0.3 to 0.95 times as large as a square");
    if (!vision_dictionary(board->dictionary, &markers))
        return refuse(spec, error,
                      "unknown dictionary; known ones are 4x4_50 … 7x7_1000 and aruco_original");
    if (board->columns * board->rows / 2 > markers)
        return refuse(spec, error,
                      "the dictionary has fewer markers than the board has white "
                      "squares; choose a larger dictionary or fewer squares");
    return TRUE;
}

gboolean board_parse(struct board *board, const char *spec, GError **error) {
    g_auto(GStrv) words = g_strsplit(spec, ",", 16);
    g_auto(GStrv) sides = g_strsplit(words[0] ? words[0] : "", "x", 3);
    struct board parsed = {.dictionary = "4x4_50"};
    guint64 columns, rows;

    if (g_strv_length(sides) != 2 ||
        !g_ascii_string_to_unsigned(sides[0], 10, 3, BOARD_MAX_SQUARES, &columns, NULL) ||
        !g_ascii_string_to_unsigned(sides[1], 10, 3, BOARD_MAX_SQUARES, &rows, NULL))
        return refuse(spec, error, "does not begin with columns x rows, 3 to 40 squares each");
    parsed.columns = (int)columns;
    parsed.rows = (int)rows;
    for (char **word = words + 1; *word; word++) {
        g_auto(GStrv) pair = g_strsplit(*word, "=", 2);
        const char *key = pair[0] && pair[1] ? pair[0] : "", *value = *key ? pair[1] : NULL;
        double *mm = g_str_equal(key, "square")      ? &parsed.square_mm
                     : g_str_equal(key, "marker")    ? &parsed.marker_mm
                     : g_str_equal(key, "thickness") ? &parsed.thickness_mm
                                                     : NULL;
        if (mm) {
            char *end;
            *mm = g_ascii_strtod(value, &end);
            if (end != value && *end == '\0' && *mm >= 0 && *mm <= MAX_MM)
                continue;
            g_autofree char *why = g_strdup_printf("%s is not a number of millimetres", key);
            return refuse(spec, error, why);
        }
        if (!g_str_equal(key, "dictionary")) {
            g_autofree char *why = g_strdup_printf(
                "unknown key in \"%s\"; choose from: square=, marker=, dictionary=, thickness=",
                *word);
            return refuse(spec, error, why);
        }
        g_strlcpy(parsed.dictionary, value, sizeof parsed.dictionary);
    }
    if (!board_check(&parsed, spec, error))
        return FALSE;
    *board = parsed;
    return TRUE;
}

char *board_spec(const struct board *board) {
    char square[G_ASCII_DTOSTR_BUF_SIZE], marker[G_ASCII_DTOSTR_BUF_SIZE],
        thickness[G_ASCII_DTOSTR_BUF_SIZE];

    g_ascii_formatd(square, sizeof square, "%.10g", board->square_mm);
    g_ascii_formatd(marker, sizeof marker, "%.10g", board->marker_mm);
    g_ascii_formatd(thickness, sizeof thickness, "%.10g", board->thickness_mm);
    if (board->marker_mm == 0)
        return g_strdup_printf("%dx%d,square=%s,thickness=%s", board->columns, board->rows, square,
                               thickness);
    return g_strdup_printf("%dx%d,square=%s,marker=%s,dictionary=%s,thickness=%s", board->columns,
                           board->rows, square, marker, board->dictionary, thickness);
}

gboolean board_check_upright(const struct board *board, GError **error) {
    g_autofree char *spec = board_spec(board);

    if (board->marker_mm > 0 || (board->columns + board->rows) % 2 == 1)
        return TRUE;
    return refuse(spec, error,
                  "a chessboard looks the same upside down unless one of columns and rows is odd "
                  "and the other even, so that pictures do not say which way it lies; photographs "
                  "of it (--images) give a lens");
}

int board_n_corners(const struct board *board) {
    return (board->columns - 1) * (board->rows - 1);
}

/* The origin is the centre of the board, y points up. */
void board_corner_mm(const struct board *board, int id, double ret_xy_mm[2]) {
    const int column = id % (board->columns - 1) + 1, row = id / (board->columns - 1) + 1;

    ret_xy_mm[0] = (column - board->columns / 2.0) * board->square_mm;
    ret_xy_mm[1] = (board->rows / 2.0 - row) * board->square_mm;
}

/* Number of white squares above a row. */
static int whites_before(const struct board *board, int row) {
    return row * (board->columns / 2) + (board->columns % 2 ? row / 2 : 0);
}

static int marker_of(const struct board *board, int column, int row) {
    return whites_before(board, row) + column / 2;
}

gboolean board_marker_square(const struct board *board, int marker, int *ret_column, int *ret_row) {
    if (board->marker_mm == 0 || marker < 0)
        return FALSE;
    for (int row = 0; row < board->rows; row++)
        for (int column = row % 2 ? 0 : 1; column < board->columns; column += 2)
            if (marker_of(board, column, row) == marker) {
                *ret_column = column;
                *ret_row = row;
                return TRUE;
            }
    return FALSE;
}

/* Printed value at a point of the board frame; bits: n × n of each marker, which a border of one
 * black cell surrounds. */
static double board_value_at(const struct board *board, const guint8 *bits, int n, double x_mm,
                             double y_mm) {
    const double x = x_mm / board->square_mm + board->columns / 2.0;
    const double y = board->rows / 2.0 - y_mm / board->square_mm;
    const int column = (int)floor(x), row = (int)floor(y);

    if (x < 0 || y < 0 || column >= board->columns || row >= board->rows)
        return -1;
    const gboolean white = (column + row + board->white_first) % 2 == 1;
    if (!white || board->marker_mm == 0)
        return white;
    const double size = board->marker_mm / board->square_mm;
    const double u = (x - column - 0.5) / size + 0.5, v = (y - row - 0.5) / size + 0.5;
    if (u < 0 || v < 0 || u >= 1 || v >= 1)
        return 1;
    const int i = (int)floor(v * (n + 2)) - 1, j = (int)floor(u * (n + 2)) - 1;
    return i >= 0 && j >= 0 && i < n && j < n &&
           bits[(marker_of(board, column, row) * n + i) * n + j];
}

void board_values(const struct board *board, const double *xy_mm, int n, float *ret) {
    const int markers = board->marker_mm > 0 ? whites_before(board, board->rows) : 0;
    const int size = markers > 0 ? vision_dictionary(board->dictionary, NULL) : 0;
    g_autofree guint8 *bits = g_new0(guint8, (gsize)(size * size) * (gsize)markers + 1);

    for (int i = 0; i < markers; i++)
        vision_marker_bits(board->dictionary, i, bits + i * size * size);
    for (int i = 0; i < n; i++)
        ret[i] = (float)board_value_at(board, bits, size, xy_mm[2 * i], xy_mm[2 * i + 1]);
}
