/* This file has the specification and the geometry of calibration boards. With the origin at the
 * centre of the board, the middle of a cell is at x = (column + ½ − columns/2) · square, y =
 * (rows/2 − row − ½) · square. */
#include "board.h"

#include "pictures/vision.h"

#include <math.h>
#include <string.h>

#define MAX_MM 2000

G_DEFINE_QUARK(board_error, board_error)

static gboolean refuse(const char *spec, GError **error, const char *why) {
    g_set_error(error, BOARD_ERROR, BOARD_ERROR_SPEC,
                "board “%s”: %s; examples (lengths in mm) are "
                "8x8,square=9,marker=6.75,dictionary=4x4_50,thickness=3 for a ChArUco board, "
                "8x7,square=9 for a chessboard, 6x6,marker=22,gap=6.6 for a grid of markers, and "
                "7x5,spacing=20,circle=10 for circles",
                spec, why);
    return FALSE;
}

/* Returns the number of white squares above a row, which is also the number of markers there. */
static int whites_before(const struct board *board, int row) {
    /* With an odd number of columns, every second row has one more white square than the others.
     * `more` is the number of such rows above. */
    const int more = board->white_first ? (row + 1) / 2 : row / 2;
    return row * (board->columns / 2) + (board->columns % 2 ? more : 0);
}

static gboolean board_check(const struct board *board, double gap_mm, const char *spec,
                            GError **error) {
    const gboolean circles = board->print == BOARD_CIRCLES || board->print == BOARD_STAGGERED;
    const int needed = board->print == BOARD_MARKERS ? board->columns * board->rows
                                                     : whites_before(board, board->rows);
    int markers = 0;

    if (board->print == BOARD_MARKERS ? board->marker_mm == 0 || gap_mm < 0.1 * board->marker_mm
                                      : !(board->square_mm > 0))
        return refuse(
            spec, error,
            board->print == BOARD_MARKERS
                ? "a grid of markers needs marker=MM, and gap=MM of at least a tenth of marker"
            : circles ? "circles need spacing=MM, the distance between rows, above 0"
                      : "squares need square=MM, the side of a square, above 0");
    if (circles)
        return (board->circle_mm >= 0.1 * board->square_mm &&
                board->circle_mm <= 0.95 * board->square_mm) ||
               refuse(spec, error,
                      "circle=MM, the diameter of a circle, must be 0.1 to 0.95 times spacing=MM");
    if (board->marker_mm == 0)
        return TRUE;
    if (board->print == BOARD_CHARUCO &&
        (board->marker_mm >= 0.95 * board->square_mm || board->marker_mm < 0.3 * board->square_mm))
        return refuse(spec, error,
                      "marker=MM must be at least 0.3 times and less than 0.95 times square=MM");
    if (!vision_dictionary(board->dictionary, &markers))
        return refuse(spec, error,
                      "unknown dictionary; known ones are 4x4_50 … 7x7_1000, aruco_original and "
                      "apriltag_16h5, apriltag_25h9, apriltag_36h10, apriltag_36h11");
    if (needed <= markers)
        return TRUE;
    g_autofree char *why = g_strdup_printf("the dictionary %s has %d markers, but the board needs "
                                           "%d; choose a larger dictionary or a smaller board",
                                           board->dictionary, markers, needed);
    return refuse(spec, error, why);
}

/* Sets the value of a key that takes words, such as grid=kalibr. Returns FALSE if the key or the
 * word is unknown. */
static gboolean board_take_word(struct board *to, const char *key, const char *value) {
    static const struct {
        const char *value;
        enum board_print print;
    } grids[] = {{"opencv", BOARD_MARKERS},
                 {"kalibr", BOARD_MARKERS},
                 {"symmetric", BOARD_CIRCLES},
                 {"staggered", BOARD_STAGGERED}};

    if (g_str_equal(key, "dictionary"))
        return g_strlcpy(to->dictionary, value, sizeof to->dictionary) > 0;
    if (g_str_equal(key, "first")) {
        to->white_first = g_str_equal(value, "white");
        return to->white_first || g_str_equal(value, "black");
    }
    for (gsize i = 0; g_str_equal(key, "grid") && i < G_N_ELEMENTS(grids); i++)
        if (g_str_equal(value, grids[i].value)) {
            to->print = grids[i].print;
            to->kalibr = g_str_equal(value, "kalibr");
            return TRUE;
        }
    return FALSE;
}

/* Sets the board's print from the keys. Returns FALSE if the keys contradict each other. */
static gboolean board_take_print(struct board *to, double gap_mm, double spacing_mm) {
    const gboolean circles = spacing_mm > 0 || to->circle_mm > 0, grid = to->print != 0;

    if (circles && !grid)
        to->print = BOARD_CIRCLES;
    else if (gap_mm > 0 && !grid)
        to->print = BOARD_MARKERS;
    else if (!grid)
        to->print = to->marker_mm > 0 ? BOARD_CHARUCO : BOARD_CHESSBOARD;
    const gboolean round = to->print == BOARD_CIRCLES || to->print == BOARD_STAGGERED;
    const gboolean squares = to->print == BOARD_CHESSBOARD || to->print == BOARD_CHARUCO;
    if ((to->square_mm > 0 && !squares) || (to->white_first && !squares) || circles != round ||
        (gap_mm > 0) != (to->print == BOARD_MARKERS) || (round && to->marker_mm > 0))
        return FALSE;
    if (!squares)
        to->square_mm = round ? spacing_mm : to->marker_mm + gap_mm;
    if (!*to->dictionary)
        g_strlcpy(to->dictionary, to->kalibr ? "apriltag_36h11" : "4x4_50", sizeof to->dictionary);
    return TRUE;
}

gboolean board_parse(struct board *board, const char *spec, GError **error) {
    g_auto(GStrv) words = g_strsplit(spec, ",", 16);
    g_auto(GStrv) sides = g_strsplit(words[0] ? words[0] : "", "x", 3);
    struct board parsed = {0};
    double gap_mm = 0, spacing_mm = 0;
    const struct {
        const char *key;
        double *mm;
    } lengths[] = {{"square", &parsed.square_mm}, {"marker", &parsed.marker_mm},
                   {"circle", &parsed.circle_mm}, {"gap", &gap_mm},
                   {"spacing", &spacing_mm},      {"thickness", &parsed.thickness_mm}};
    guint64 columns, rows;

    if (g_strv_length(sides) != 2 ||
        !g_ascii_string_to_unsigned(sides[0], 10, 2, BOARD_MAX_SQUARES, &columns, NULL) ||
        !g_ascii_string_to_unsigned(sides[1], 10, 2, BOARD_MAX_SQUARES, &rows, NULL))
        return refuse(spec, error, "it must begin with COLUMNSxROWS, 2 to 40 each");
    parsed.columns = (int)columns;
    parsed.rows = (int)rows;
    for (char **word = words + 1; *word; word++) {
        g_auto(GStrv) pair = g_strsplit(*word, "=", 2);
        const char *key = pair[0] && pair[1] ? pair[0] : "", *value = *key ? pair[1] : NULL;
        double *mm = NULL;
        for (gsize i = 0; i < G_N_ELEMENTS(lengths); i++)
            if (g_str_equal(key, lengths[i].key))
                mm = lengths[i].mm;
        if (mm) {
            char *end;
            *mm = g_ascii_strtod(value, &end);
            if (end != value && *end == '\0' && *mm >= 0 && *mm <= MAX_MM)
                continue;
            g_autofree char *why =
                g_strdup_printf("%s is not a number from 0 to %d (mm)", key, MAX_MM);
            return refuse(spec, error, why);
        }
        if (*key && board_take_word(&parsed, key, value))
            continue;
        g_autofree char *why = g_strdup_printf(
            "unknown key or value in \"%s\"; choose from: square=, marker=, gap=, spacing=, "
            "circle=, dictionary=, thickness=, first=black, first=white, grid=opencv, "
            "grid=kalibr, grid=symmetric, grid=staggered",
            *word);
        return refuse(spec, error, why);
    }
    if (!board_take_print(&parsed, gap_mm, spacing_mm))
        return refuse(spec, error,
                      "its keys do not go together: a board of squares has square=, a grid of "
                      "markers has marker= and gap=, and circles have spacing= and circle=");
    if (parsed.print < BOARD_MARKERS && (columns < 3 || rows < 3))
        return refuse(spec, error, "a board has at least 3 × 3 squares");
    if (!board_check(&parsed, gap_mm, spec, error))
        return FALSE;
    *board = parsed;
    return TRUE;
}

static void board_add_mm(GString *to, const char *key, double mm) {
    char text[G_ASCII_DTOSTR_BUF_SIZE];
    g_string_append_printf(to, ",%s=%s", key, g_ascii_formatd(text, sizeof text, "%.10g", mm));
}

char *board_spec(const struct board *board) {
    GString *to = g_string_new(NULL);

    g_string_printf(to, "%dx%d", board->columns, board->rows);
    switch (board->print) {
    case BOARD_CHESSBOARD:
    case BOARD_CHARUCO:
        board_add_mm(to, "square", board->square_mm);
        if (board->print == BOARD_CHARUCO)
            board_add_mm(to, "marker", board->marker_mm);
        break;
    case BOARD_MARKERS:
        board_add_mm(to, "marker", board->marker_mm);
        board_add_mm(to, "gap", board->square_mm - board->marker_mm);
        break;
    case BOARD_CIRCLES:
    case BOARD_STAGGERED:
        board_add_mm(to, "spacing", board->square_mm);
        board_add_mm(to, "circle", board->circle_mm);
        break;
    }
    if (board->marker_mm > 0)
        g_string_append_printf(to, ",dictionary=%s", board->dictionary);
    if (board->kalibr || board->print == BOARD_STAGGERED)
        g_string_append_printf(to, ",grid=%s", board->kalibr ? "kalibr" : "staggered");
    if (board->white_first)
        g_string_append(to, ",first=white");
    board_add_mm(to, "thickness", board->thickness_mm);
    return g_string_free(to, FALSE);
}

gboolean board_check_upright(const struct board *board, GError **error) {
    g_autofree char *spec = board_spec(board);

    if (board->marker_mm > 0 ||
        (board->print == BOARD_CHESSBOARD && (board->columns + board->rows) % 2 == 1) ||
        (board->print == BOARD_STAGGERED && board->rows % 2 == 1))
        return TRUE;
    return refuse(
        spec, error,
        board->print == BOARD_CHESSBOARD
            ? "this chessboard looks the same upside down, so pictures do not show its "
              "orientation; use an odd number of columns and an even number of rows, or the "
              "reverse; photographs of this board (--images) can only calibrate a lens"
            : "these circles look the same upside down, so pictures do not show their orientation; "
              "use an odd number of staggered rows; photographs of these circles (--images) can "
              "only calibrate a lens");
}

void board_size_mm(const struct board *board, double ret[2]) {
    const gboolean staggered = board->print == BOARD_STAGGERED;
    const double gap = board->square_mm - board->marker_mm;
    const double around = board->print != BOARD_MARKERS ? 0 : board->kalibr ? gap : -gap;

    ret[0] = (staggered ? 2 : 1) * board->columns * board->square_mm + around;
    ret[1] = board->rows * board->square_mm + around;
}

int board_n_corners(const struct board *board) {
    return board->print < BOARD_MARKERS    ? (board->columns - 1) * (board->rows - 1)
           : board->print == BOARD_MARKERS ? 4 * board->columns * board->rows
                                           : board->columns * board->rows;
}

/* Returns the middle of a cell of the grid; the origin is the centre of the board, y points up. */
static void board_cell_mm(const struct board *board, double column, double row, double ret[2]) {
    ret[0] = (column + 0.5 - board->columns / 2.0) * board->square_mm;
    ret[1] = (board->rows / 2.0 - row - 0.5) * board->square_mm;
}

void board_corner_mm(const struct board *board, int id, double ret_xy_mm[2]) {
    const int column = id % board->columns, row = id / board->columns;
    const int inner_column = id % (board->columns - 1), inner_row = id / (board->columns - 1);
    double marker[4][2];

    switch (board->print) {
    case BOARD_CHESSBOARD:
    case BOARD_CHARUCO:
        board_cell_mm(board, inner_column + 0.5, inner_row + 0.5, ret_xy_mm);
        return;
    case BOARD_MARKERS:
        board_marker_mm(board, id / 4, marker);
        ret_xy_mm[0] = marker[id % 4][0];
        ret_xy_mm[1] = marker[id % 4][1];
        return;
    case BOARD_CIRCLES:
        board_cell_mm(board, column, row, ret_xy_mm);
        return;
    case BOARD_STAGGERED: /* columns are two spacings apart */
        ret_xy_mm[0] = (2 * column + row % 2 + 0.5 - board->columns) * board->square_mm;
        ret_xy_mm[1] = (board->rows / 2.0 - row - 0.5) * board->square_mm;
        return;
    }
}

/* Returns the number of the marker in a square, or −1 if the square has no marker. */
static int marker_of(const struct board *board, int column, int row) {
    if (board->print == BOARD_MARKERS)
        return (board->kalibr ? board->rows - 1 - row : row) * board->columns + column;
    if (board->print != BOARD_CHARUCO || (column + row + board->white_first) % 2 == 0)
        return -1;
    return whites_before(board, row) + column / 2;
}

gboolean board_marker_square(const struct board *board, int marker, int *ret_column, int *ret_row) {
    if (board->marker_mm == 0 || marker < 0)
        return FALSE;
    for (int row = 0; row < board->rows; row++)
        for (int column = 0; column < board->columns; column++)
            if (marker_of(board, column, row) == marker) {
                *ret_column = column;
                *ret_row = row;
                return TRUE;
            }
    return FALSE;
}

gboolean board_marker_mm(const struct board *board, int marker, double ret_xy_mm[4][2]) {
    static const int right[4] = {-1, 1, 1, -1}, up[4] = {1, 1, -1, -1};
    double at[2];
    int column, row;

    if (!board_marker_square(board, marker, &column, &row))
        return FALSE;
    board_cell_mm(board, column, row, at);
    for (int k = 0; k < 4; k++) {
        const int own = board->kalibr ? (k + 2) % 4 : k;
        ret_xy_mm[k][0] = at[0] + right[own] * board->marker_mm / 2;
        ret_xy_mm[k][1] = at[1] + up[own] * board->marker_mm / 2;
    }
    return TRUE;
}

int board_border(const struct board *board) {
    return board->kalibr ? 2 : 1;
}

/* Returns the printed value of a marker at u, v: 0 for black, 1 for white. u (to the right) and v
 * (downwards) are measured from the top left corner of the print, in sides of the marker. bits are
 * the n × n cells inside the border. */
static double marker_value(const struct board *board, const guint8 *bits, int n, double u,
                           double v) {
    const int border = board_border(board), all = n + 2 * border;
    const int i = (int)floor((board->kalibr ? 1 - v : v) * all) - border;
    const int j = (int)floor((board->kalibr ? 1 - u : u) * all) - border;
    return i >= 0 && j >= 0 && i < n && j < n && bits[i * n + j];
}

static gboolean in_circle(const struct board *board, double x_mm, double y_mm) {
    for (int id = 0; id < board_n_corners(board); id++) {
        double at[2];
        board_corner_mm(board, id, at);
        if (hypot(x_mm - at[0], y_mm - at[1]) < board->circle_mm / 2)
            return TRUE;
    }
    return FALSE;
}

/* Returns the printed value at a point of the board frame, or −1 outside the board. bits has n × n
 * cells for each marker. */
static double board_value_at(const struct board *board, const guint8 *bits, int n, double x_mm,
                             double y_mm) {
    double size[2];

    board_size_mm(board, size);
    if (!(fabs(x_mm) < size[0] / 2) || !(fabs(y_mm) < size[1] / 2))
        return -1;
    if (board->circle_mm > 0)
        return !in_circle(board, x_mm, y_mm);
    const double x = x_mm / board->square_mm + board->columns / 2.0;
    const double y = board->rows / 2.0 - y_mm / board->square_mm;
    const int column = CLAMP((int)floor(x), 0, board->columns - 1);
    const int row = CLAMP((int)floor(y), 0, board->rows - 1);
    const int marker = marker_of(board, column, row);
    if (board->print != BOARD_MARKERS && marker < 0)
        return (column + row + board->white_first) % 2 == 1;
    /* side of a marker divided by board->square_mm */
    const double part = board->marker_mm / board->square_mm;
    const double u = (x - column - 0.5) / part + 0.5, v = (y - row - 0.5) / part + 0.5;
    const gboolean beside = u < 0 || u >= 1, above = v < 0 || v >= 1;
    if (beside || above)
        return !(board->kalibr && beside && above);
    return marker_value(board, bits + (gsize)(marker * n * n), n, u, v);
}

void board_values(const struct board *board, const double *xy_mm, int n, float *ret) {
    const int markers = board->print == BOARD_CHARUCO   ? whites_before(board, board->rows)
                        : board->print == BOARD_MARKERS ? board->columns * board->rows
                                                        : 0;
    const int size = markers > 0 ? vision_dictionary(board->dictionary, NULL) : 0;
    g_autofree guint8 *bits = g_new0(guint8, (gsize)(size * size) * (gsize)markers + 1);

    for (int i = 0; i < markers; i++)
        vision_marker_bits(board->dictionary, i, bits + i * size * size);
    for (int i = 0; i < n; i++)
        ret[i] = (float)board_value_at(board, bits, size, xy_mm[2 * i], xy_mm[2 * i + 1]);
}
