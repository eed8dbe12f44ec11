/* Finds the size of a board from its print. For a chessboard, OpenCV searches for corners and
 * extends the grid as far as it can. For markers, several numbers of columns are tried. A marker's
 * number tells its place on the board, and with the right number of columns these places fit the
 * picture by one homography. For circles, the spots form a full rectangle. The board must also end
 * at this size. A larger board of this print would be dark at certain places outside the board that
 * was found. These places must be light on all four sides. */
#include "board_size.h"

#include "pictures/vision.h"
#include "spot_grid.h"

#include <math.h>
#include <string.h>

#define MAX_EXAMINED 8 /* largest number of pictures that are examined */
/* number of pictures that must show the same other size of a board of squares */
#define AGREE 2
/* The same number for grids of markers or circles, whose print has no outer edge. */
#define AGREE_GRIDS 3
/* Each picture that shows a third size, neither the given size nor that of the agreeing pictures,
 * raises the number of agreeing pictures by this number. */
#define AGREE_MORE 2
/* pictures are reduced to at most this longer side before they are examined */
#define MAX_PX     1000
#define MARKERS_PX 2000 /* the same limit for boards with markers, whose cells are small */
/* If the board has no markers, pictures whose longer side exceeds LARGE · MAX_PX are examined
 * before the search, because a failed search takes seconds in them. */
#define LARGE 1.5

#define OUTSIDE 0.2 /* distance of tested places from the edge of the squares, in squares */
/* distance of tested places from the centre of the next circle, in radii of a circle */
#define NEAR_EDGE 0.6
/* black and white are taken from within this distance of a place, in squares */
#define NEAR       1.1
#define EDGE_REACH 0.35 /* half the length in which an edge is searched, in squares */
#define EDGE_STEPS 35
#define EDGE_OFF   0.08 /* largest deviation of the edge from its place, in squares */
#define STEPS      8    /* points of the print per square */
#define LEAST      0.5  /* smallest local contrast, relative to the contrast in the whole board */
#define WHITE      0.6  /* smallest level of a light place; 0: local black, 1: local white */
#define MAX_WHITE  1.6  /* largest level of a light place */
#define CLOSED     0.9  /* smallest share of light places on each side if the board ends there */
#define CONTINUED  0.85 /* share of dark places on a side from which the board goes on there */
#define MIN_SPOTS  8    /* smallest number of markers that can show a size */
#define AGREEING   0.9  /* smallest share of the visible markers that fit the size found */
/* largest number of markers that fit another size, relative to those that fit the size found */
#define ALONE 0.7
/* Largest number of random samples of four corners that are tried for a homography. A size that
 * fewer than AGREEING · ALONE = 63 % of the markers fit does not matter. If 63 % of the corners are
 * right, one sample in six has four right corners. */
#define MAX_SAMPLES 200
#define TOLERANCE   0.12 /* tolerance of the homography, in marker sides */
#define ANY_PX      1e6  /* tolerance of a homography that accepts all points */

/* A place next to the board where the next column or row would be dark. */
struct outside {
    double x, y; /* mm, board frame */
    int side;    /* side of the board: 0 top, 1 right, 2 bottom, 3 left */
    /* If TRUE, the place is instead on the board's edge next to a black square, where black must
     * end. */
    gboolean is_edge;
};

static void add_outside(GArray *to, double x, double y, int side, gboolean is_edge) {
    const struct outside place = {x, y, side, is_edge};
    g_array_append_val(to, place);
}

/* Adds the places beyond a side of a board of squares or markers. Where the next cell of a larger
 * board would be dark, the place is in this cell. Where that cell would be light, the place is on
 * the edge of the black square inside the board. */
static void add_cells(const struct board *board, int side, GArray *to) {
    const int n = side % 2 ? board->rows : board->columns;
    const double s = board->square_mm, marker = board->marker_mm;
    const gboolean squares = board->print < BOARD_MARKERS;
    /* beyond is the distance of the place from the outer edge of the print's cells. For markers,
     * the place is in the middle of the next marker's border. */
    const double cell =
        marker / (vision_dictionary(board->dictionary, NULL) + 2 * board_border(board));
    const double beyond = squares ? OUTSIDE * s : (s - marker) / 2 + cell * board_border(board) / 2;
    for (int i = 0; i < n; i++) {
        const int column = side == 1 ? board->columns : side == 3 ? -1 : i;
        const int row = side == 0 ? -1 : side == 2 ? board->rows : i;
        const gboolean is_edge = squares && (column + row + 2 + board->white_first) % 2 == 1;
        for (int k = -1; k <= 1; k++) {
            double x = (column + 0.5 - board->columns / 2.0) * s;
            double y = (board->rows / 2.0 - row - 0.5) * s;
            const double along = 0.25 * k * (squares ? s : marker);
            const double in = s / 2 - (is_edge ? 0 : beyond);
            x += side % 2 == 0 ? along : side == 1 ? -in : in;
            y += side % 2 == 1 ? along : side == 0 ? -in : in;
            add_outside(to, x, y, side, is_edge);
        }
    }
}

/* Adds the places beyond a board of circles. They lie in the circles that a further row or column
 * would have, on the side of these circles that is near the board. */
static void add_circles(const struct board *board, GArray *to) {
    static const int steps[2][4][2] = {{{0, -1}, {1, 0}, {0, 1}, {-1, 0}},
                                       {{1, -1}, {1, 1}, {-1, 1}, {-1, -1}}};
    const gboolean staggered = board->print == BOARD_STAGGERED;
    const double s = board->square_mm;
    for (int id = 0; id < board_n_corners(board); id++) {
        const int row = id / board->columns, column = id % board->columns;
        for (int k = 0; k < 4; k++) {
            const int dx = steps[staggered][k][0], dy = steps[staggered][k][1];
            const int x = staggered ? 2 * column + row % 2 + dx : column + dx;
            const int wide = staggered ? 2 * board->columns : board->columns;
            if (x >= 0 && x < wide && row + dy >= 0 && row + dy < board->rows)
                continue;
            const int side = row + dy < 0 ? 0 : row + dy >= board->rows ? 2 : x < 0 ? 3 : 1;
            const double way = hypot(dx, dy) * s;
            const double share = 1 - NEAR_EDGE * board->circle_mm / 2 / way;
            double at[2];
            board_corner_mm(board, id, at);
            add_outside(to, at[0] + share * dx * s, at[1] - share * dy * s, side, FALSE);
        }
    }
}

typedef gboolean (*Project)(const double xy_mm[2], double ret_px[2], gconstpointer data);

struct print {      /* how the print looks in the picture */
    GArray *points; /* struct point, of the visible points */
    /* mean value of the black and of the white points in the picture */
    double black, white;
};

struct point {
    double x, y; /* place in the board frame, mm */
    /* the print is white here */
    gboolean white;
    /* value of the picture here */
    double seen;
};

static gboolean look(const struct picture *picture, const double px[2], double *ret) {
    const int x = (int)lround(px[0]), y = (int)lround(px[1]);
    if (!(fabs(px[0]) < 1e6) || !(fabs(px[1]) < 1e6) || x < 0 || y < 0 || x >= picture->width ||
        y >= picture->height)
        return FALSE;
    *ret = (double)picture->values[(gsize)y * (gsize)picture->width + (gsize)x];
    return isfinite(*ret);
}

static void see_print(const struct picture *picture, const struct board *board, Project project,
                      gconstpointer data, struct print *to) {
    double size[2], sum[2] = {0, 0};
    board_size_mm(board, size);
    const double step = board->square_mm / STEPS;
    const int nx = (int)(size[0] / step), ny = (int)(size[1] / step);
    int n[2] = {0, 0};
    g_autofree double *at = g_new(double, 2 * nx * ny + 2);
    g_autofree float *values = g_new(float, nx *ny + 1);
    for (int i = 0; i < nx * ny; i++) {
        const int x = i % nx, y = i / nx;
        at[2 * i] = (x + 0.5) * step - size[0] / 2;
        at[2 * i + 1] = (y + 0.5) * step - size[1] / 2;
    }
    board_values(board, at, nx * ny, values);
    to->points = g_array_new(FALSE, FALSE, sizeof(struct point));
    for (int i = 0; i < nx * ny; i++) {
        struct point point = {at[2 * i], at[2 * i + 1], values[i] > 0.5f, 0};
        double px[2];
        if (values[i] < 0 || !project(at + 2 * i, px, data) || !look(picture, px, &point.seen))
            continue;
        sum[point.white] += point.seen;
        n[point.white]++;
        g_array_append_val(to->points, point);
    }
    to->black = n[0] ? sum[0] / n[0] : 0;
    to->white = n[1] ? sum[1] / n[1] : 0;
}

/* Outward direction of each side, in the board's frame. */
static const int outwards[4][2] = {{0, 1}, {1, 0}, {0, -1}, {-1, 0}};

/* Gives the black level and the contrast of the print near a place. Returns FALSE if black or white
 * is not visible there, or if the contrast is too small. */
static gboolean levels_near(const struct board *board, const struct print *print,
                            const struct outside *place, double *ret_black, double *ret_contrast) {
    double sum[2] = {0, 0};
    int n[2] = {0, 0};
    for (guint i = 0; i < print->points->len; i++) {
        const struct point *p = &g_array_index(print->points, struct point, i);
        if (fabs(p->x - place->x) > NEAR * board->square_mm ||
            fabs(p->y - place->y) > NEAR * board->square_mm)
            continue;
        sum[p->white] += p->seen;
        n[p->white]++;
    }
    if (!n[0] || !n[1])
        return FALSE;
    *ret_black = sum[0] / n[0];
    *ret_contrast = sum[1] / n[1] - *ret_black;
    /* The local contrast must have the sign of the contrast of the whole board, which is negative
     * for bright circles on a dark ground. */
    const double all = print->white - print->black;
    return all != 0 && *ret_contrast * (all < 0 ? -1 : 1) > LEAST * fabs(all);
}

/* Returns the level at a place: 0 for the given black, 1 for white. Returns NAN outside the
 * picture. */
static double level_at(const struct picture *picture, Project project, gconstpointer data, double x,
                       double y, double black, double contrast) {
    double px[2], seen;
    return project((const double[]){x, y}, px, data) && look(picture, px, &seen)
               ? (seen - black) / contrast
               : NAN;
}

/* Returns 1 if the place is as light as the margin of the print, or if the edge is where it should
 * be. Returns −1 if the place is dark. Returns 0 otherwise, also if the print is not visible near
 * the place. */
static int margin_at(const struct picture *picture, const struct board *board,
                     const struct print *print, const struct outside *place, Project project,
                     gconstpointer data) {
    const double s = board->square_mm;
    double black, contrast, dark = 0;
    if (!levels_near(board, print, place, &black, &contrast))
        return 0;
    if (!place->is_edge) {
        const double level = level_at(picture, project, data, place->x, place->y, black, contrast);
        return level > WHITE && level < MAX_WHITE ? 1 : level < 1 - WHITE ? -1 : 0;
    }
    for (int k = 0; k < EDGE_STEPS; k++) {
        const double u = ((k + 0.5) / EDGE_STEPS * 2 - 1) * EDGE_REACH * s;
        const double level =
            level_at(picture, project, data, place->x + u * outwards[place->side][0],
                     place->y + u * outwards[place->side][1], black, contrast);
        if (!isfinite(level))
            return 0;
        dark += level < 0.5;
    }
    return fabs(dark / EDGE_STEPS * 2 - 1) * EDGE_REACH < EDGE_OFF ? 1 : 0;
}

/* ENDS: the picture shows that the print ends at the size of the board. GOES_ON: it shows that the
 * print goes on beyond this size. OPEN: it shows neither. */
enum end { OPEN, ENDS, GOES_ON };

/* Returns whether the picture is light OUTSIDE squares beyond a place that is on the edge of a
 * black square. */
static gboolean is_light_beyond(const struct picture *picture, const struct board *board,
                                const struct print *print, const struct outside *place,
                                Project project, gconstpointer data) {
    const double s = OUTSIDE * board->square_mm;
    double black, contrast;
    return levels_near(board, print, place, &black, &contrast) &&
           level_at(picture, project, data, place->x + s * outwards[place->side][0],
                    place->y + s * outwards[place->side][1], black, contrast) > WHITE;
}

/* Returns ENDS if places outside all four sides are light, and GOES_ON if the board goes on at one
 * side. Otherwise returns OPEN. The board goes on if places are dark where the next squares or
 * circles would be dark, and light where they would be light. */
static enum end end_of(const struct picture *picture, const struct board *board, Project project,
                       gconstpointer data) {
    g_autoptr(GArray) places = g_array_new(FALSE, FALSE, sizeof(struct outside));
    struct print print;
    int n[4] = {0}, edges[4] = {0}, light[4] = {0}, dark[4] = {0}, beyond[4] = {0};
    if (board->circle_mm > 0)
        add_circles(board, places);
    for (int side = 0; side < 4 && !(board->circle_mm > 0); side++)
        add_cells(board, side, places);
    see_print(picture, board, project, data, &print);
    for (guint i = 0; i < places->len; i++) {
        const struct outside *place = &g_array_index(places, struct outside, i);
        const int margin = margin_at(picture, board, &print, place, project, data);
        n[place->side]++;
        edges[place->side] += place->is_edge;
        beyond[place->side] +=
            place->is_edge && is_light_beyond(picture, board, &print, place, project, data);
        light[place->side] += margin > 0;
        dark[place->side] += margin < 0;
    }
    g_array_unref(print.points);
    gboolean ends = TRUE;
    for (int side = 0; side < 4; side++) {
        if (n[side] > edges[side] && beyond[side] >= CONTINUED * edges[side] &&
            dark[side] >= CONTINUED * (n[side] - edges[side]))
            return GOES_ON;
        ends &= n[side] > 0 && light[side] >= CLOSED * n[side];
    }
    return ends ? ENDS : OPEN;
}

/* Corners in columns and rows. Positions between and beyond them are interpolated by parabolas
 * through three corners in each direction. The parabolas follow perspective and distortion. */
struct corner_grid {
    const struct board *board;
    /* x, y of each corner in the picture, row by row */
    const double *xy;
    int columns, rows; /* columns and rows of corners */
};

static void parabola(double at, int n, int *ret_first, double ret[3]) {
    const int first = CLAMP((int)floor(at + 0.5) - 1, 0, n - 3);
    const double t = at - first;
    *ret_first = first;
    ret[0] = (t - 1) * (t - 2) / 2;
    ret[1] = t * (2 - t);
    ret[2] = t * (t - 1) / 2;
}

static gboolean by_corner_grid(const double xy_mm[2], double ret_px[2], gconstpointer data) {
    const struct corner_grid *grid = data;
    const struct board *board = grid->board;
    double u[3], v[3];
    int i, j;
    parabola(xy_mm[0] / board->square_mm + board->columns / 2.0 - 1, grid->columns, &i, u);
    parabola(board->rows / 2.0 - xy_mm[1] / board->square_mm - 1, grid->rows, &j, v);
    ret_px[0] = ret_px[1] = 0;
    for (int k = 0; k < 9; k++) {
        const double *at = grid->xy + (gsize)2 * (gsize)((j + k / 3) * grid->columns + i + k % 3);
        ret_px[0] += u[k % 3] * v[k / 3] * at[0];
        ret_px[1] += u[k % 3] * v[k / 3] * at[1];
    }
    return TRUE;
}

static gboolean by_plane(const double xy_mm[2], double ret_px[2], gconstpointer data) {
    const double *h = data;
    const double w = h[6] * xy_mm[0] + h[7] * xy_mm[1] + h[8];
    if (!(w > 1e-9))
        return FALSE;
    ret_px[0] = (h[0] * xy_mm[0] + h[1] * xy_mm[1] + h[2]) / w;
    ret_px[1] = (h[3] * xy_mm[0] + h[4] * xy_mm[1] + h[5]) / w;
    return TRUE;
}

/* Like end_of(), for a chessboard. corners are doubles x, y, row by row. Sets board->white_first as
 * the picture shows it. Returns OPEN if there are fewer than 3 columns or rows of corners. */
static enum end end_of_chessboard(const struct picture *picture, struct board *board,
                                  const GArray *corners) {
    const struct corner_grid grid = {board, (const double *)(gconstpointer)corners->data,
                                     board->columns - 1, board->rows - 1};
    struct print print;
    if (grid.columns < 3 || grid.rows < 3)
        return OPEN;
    board->white_first = FALSE;
    see_print(picture, board, by_corner_grid, &grid, &print);
    g_array_unref(print.points);
    board->white_first = print.white < print.black;
    return end_of(picture, board, by_corner_grid, &grid);
}

static enum end measure_chessboard(const struct picture *picture, struct board *board) {
    int columns, rows;
    g_autoptr(GArray) corners = vision_measure_chessboard(picture, &columns, &rows, NULL);
    if (!corners)
        return GOES_ON;
    board->columns = columns + 1;
    board->rows = rows + 1;
    return end_of_chessboard(picture, board, corners);
}

/* Computes the homography from corners of a board to their places in the picture. If ids is NULL,
 * the corners are all corners in order. */
static gboolean plane_of(const struct board *board, const int *ids, const double *places, int n,
                         double ret_h[9]) {
    g_autofree double *from = g_new(double, 2 * n);
    g_autofree guint8 *good = g_new(guint8, n);
    for (int i = 0; i < n; i++)
        board_corner_mm(board, ids ? ids[i] : i, from + 2 * i);
    return vision_homography(from, places, n, ANY_PX, ret_h, good);
}

static enum end measure_circles(const struct picture *picture, struct board *board) {
    for (int bright = 0; bright < 2; bright++) {
        g_autoptr(GArray) spots = vision_find_spots(picture, bright, NULL);
        int columns, rows;
        double h[9];
        g_autoptr(GArray) grid =
            spots ? spot_grid_find(spots, board->print == BOARD_STAGGERED, &columns, &rows) : NULL;
        if (!grid)
            continue;
        board->columns = columns;
        board->rows = rows;
        return columns <= BOARD_MAX_SQUARES && rows <= BOARD_MAX_SQUARES &&
                       plane_of(board, NULL, (const double *)(gconstpointer)grid->data,
                                columns * rows, h)
                   ? end_of(picture, board, by_plane, h)
                   : GOES_ON;
    }
    return GOES_ON;
}

/* Returns the number of markers whose places on the board fit the picture by one homography.
 * Returns 0 if fewer than MIN_SPOTS of the markers found are on the board, or if no homography
 * fits. ret_h gets the homography. *ret_rows gets the number of rows up to the last marker that
 * fits. */
static int count_on_plane(const struct board *board, const GArray *found, double ret_h[9],
                          int *ret_rows) {
    const int n = (int)found->len;
    g_autofree double *from = g_new(double, 8 * n), *to = g_new(double, 8 * n);
    g_autofree guint8 *good = g_new0(guint8, 4 * n);
    double side = 0;
    int on = 0, known = 0;
    g_autofree int *rows = g_new0(int, n);
    for (int i = 0; i < n; i++) {
        const struct vision_marker *m = &g_array_index(found, struct vision_marker, i);
        double mm[4][2];
        int column;
        if (!board_marker_square(board, m->id, &column, &rows[known]) ||
            !board_marker_mm(board, m->id, mm))
            continue;
        memcpy(from + (gsize)8 * (gsize)known, mm, sizeof mm);
        memcpy(to + (gsize)8 * (gsize)known++, m->corners_px, sizeof m->corners_px);
        side += hypot(m->corners_px[1][0] - m->corners_px[0][0],
                      m->corners_px[1][1] - m->corners_px[0][1]);
    }
    *ret_rows = 0;
    if (known < MIN_SPOTS ||
        !vision_try_homography(from, to, 4 * known, MAX(2, TOLERANCE * side / known), MAX_SAMPLES,
                               ret_h, good))
        return 0;
    for (int i = 0; i < known; i++) {
        if (good[4 * i] + good[4 * i + 1] + good[4 * i + 2] + good[4 * i + 3] < 3)
            continue;
        on++;
        /* Kalibr counts rows from the bottom. */
        *ret_rows = MAX(*ret_rows, board->kalibr ? board->rows - rows[i] : rows[i] + 1);
    }
    return on;
}

/* The number of rows does not change where markers lie relative to each other, but it changes the
 * centre of the print. So the largest possible number of rows is assumed first. */
static enum end measure_markers(const struct picture *picture, struct board *board) {
    g_autoptr(GArray) found =
        vision_find_markers(picture, board->dictionary, board_border(board), FALSE, NULL);
    struct board best = *board;
    int most = 0, second = 0, rows;
    double h[9];
    if (!found || found->len < MIN_SPOTS)
        return GOES_ON;
    for (int k = 0; k < 2 * BOARD_MAX_SQUARES; k++) {
        struct board tried = *board;
        tried.columns = k / 2 + 1;
        tried.white_first = k % 2;
        tried.rows = BOARD_MAX_SQUARES;
        if (tried.columns < 2 || (tried.print == BOARD_CHARUCO && tried.columns < 3) ||
            (tried.print == BOARD_MARKERS && k % 2))
            continue;
        const int on = count_on_plane(&tried, found, h, &rows);
        second = MAX(second, MIN(on, most));
        if (on <= most)
            continue;
        most = on;
        best = tried;
        best.rows = rows;
    }
    if (most < AGREEING * found->len || second > ALONE * most || best.rows < 2)
        return GOES_ON;
    *board = best;
    return count_on_plane(board, found, h, &rows) > 0 ? end_of(picture, board, by_plane, h)
                                                      : GOES_ON;
}

static int max_px(const struct board *board) {
    return board->marker_mm > 0 ? MARKERS_PX : MAX_PX;
}

/* Averages blocks of factor × factor pixels, so that the longer side has at most the given number
 * of pixels. */
static struct picture *reduce(const struct picture *from, int most) {
    const int factor = (MAX(from->width, from->height) + most - 1) / most;
    const int width = from->width / factor, height = from->height / factor;
    struct picture *to = picture_new(from->name, from->checksum, width, height);
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++) {
            float sum = 0;
            for (int k = 0; k < factor * factor; k++)
                sum += from->values[(gsize)(y * factor + k / factor) * (gsize)from->width +
                                    (gsize)(x * factor + k % factor)];
            to->values[(gsize)y * (gsize)width + (gsize)x] = sum / (float)(factor * factor);
        }
    return to;
}

/* Returns whether the print looks the same with columns and rows exchanged. */
static gboolean is_exchangeable(const struct board *board) {
    return board->print == BOARD_CHESSBOARD || board->print == BOARD_CIRCLES;
}

/* Measures the number of columns and rows of the board in the picture. Returns ENDS if the board
 * has this size, OPEN if it has at least this size, and GOES_ON if the size was not found or the
 * board goes on beyond it. */
static enum end measure(const struct picture *picture, const struct board *given, int *ret_columns,
                        int *ret_rows) {
    g_autoptr(Picture) small = reduce(picture, max_px(given));
    struct board board = *given;
    const enum end end = (board.marker_mm > 0   ? measure_markers
                          : board.circle_mm > 0 ? measure_circles
                                                : measure_chessboard)(small, &board);
    const gboolean wide = given->columns >= given->rows;
    const gboolean turned = is_exchangeable(given) && (board.columns >= board.rows) != wide;
    *ret_columns = turned ? board.rows : board.columns;
    *ret_rows = turned ? board.columns : board.rows;
    return end;
}

gboolean board_measure(const struct picture *picture, const struct board *given, int *ret_columns,
                       int *ret_rows) {
    return measure(picture, given, ret_columns, ret_rows) == ENDS;
}

struct sighting {
    char *name; /* name of the picture */
    int columns, rows;
};

struct board_census {
    struct board given;
    GMutex lock;
    /* TRUE if the given size is right, or if MAX_EXAMINED pictures were examined */
    gboolean settled;
    int examined;
    GArray *sightings; /* elements: struct sighting, of pictures that show another size */
};

static void clear_sighting(gpointer data) {
    g_free(((struct sighting *)data)->name);
}

struct board_census *board_census_new(const struct board *given) {
    struct board_census *census = g_new0(struct board_census, 1);
    census->given = *given;
    g_mutex_init(&census->lock);
    census->sightings = g_array_new(FALSE, FALSE, sizeof(struct sighting));
    g_array_set_clear_func(census->sightings, clear_sighting);
    return census;
}

void board_census_free(struct board_census *census) {
    if (!census)
        return;
    g_mutex_clear(&census->lock);
    g_array_unref(census->sightings);
    g_free(census);
}

static gboolean is_settled(struct board_census *census) {
    g_mutex_lock(&census->lock);
    const gboolean settled = census->settled;
    g_mutex_unlock(&census->lock);
    return settled;
}

static gboolean refuse_size(const struct board *given, const struct sighting *a,
                            const struct sighting *b, GError **error) {
    struct board board = *given;
    board.columns = a->columns;
    board.rows = a->rows;
    g_autofree char *right = board_spec(&board), *said = board_spec(given);
    g_autofree char *count =
        board.print < BOARD_MARKERS
            ? g_strdup_printf("%d × %d inner corners = %d × %d squares", a->columns - 1,
                              a->rows - 1, a->columns, a->rows)
            : g_strdup_printf("%d × %d %s", a->columns, a->rows,
                              board.print == BOARD_MARKERS ? "markers" : "circles");
    g_set_error(error, BOARD_ERROR, BOARD_ERROR_SPEC,
                "--board %s: the pictures show %s (%s and %s); give --board %s", said, count,
                a->name, b->name, right);
    return FALSE;
}

/* Counts an examined picture. columns and rows are the size of the board in the picture; columns is
 * 0 if this size is not known. Holds the lock meanwhile. Returns FALSE with an error if enough
 * pictures have shown the same size, and this is not the given one. */
static gboolean add_sighting(struct board_census *census, const char *name, int columns, int rows,
                             GError **error) {
    gboolean ok = TRUE;
    g_mutex_lock(&census->lock);
    census->examined++;
    census->settled |= census->examined >= MAX_EXAMINED ||
                       (columns == census->given.columns && rows == census->given.rows);
    if (columns > 0 && !census->settled) {
        const struct sighting seen = {g_strdup(name), columns, rows};
        const struct sighting *first = NULL;
        int same = 1, needed = census->given.print < BOARD_MARKERS ? AGREE : AGREE_GRIDS;
        for (guint i = 0; i < census->sightings->len; i++) {
            const struct sighting *other = &g_array_index(census->sightings, struct sighting, i);
            const gboolean agrees = other->columns == columns && other->rows == rows;
            first = agrees && !first ? other : first;
            same += agrees;
            needed += agrees ? 0 : AGREE_MORE;
        }
        if (first && same >= needed)
            ok = refuse_size(&census->given, first, &seen, error);
        g_array_append_val(census->sightings, seen);
    }
    g_mutex_unlock(&census->lock);
    return ok;
}

/* Returns whether the board that was found goes on beyond its corners. */
static gboolean goes_on(const struct board *given, const struct picture *picture,
                        const GArray *corners) {
    const int n = (int)corners->len;
    struct board board = *given;
    g_autoptr(GArray) places = g_array_new(FALSE, FALSE, sizeof(double));
    g_autofree int *ids = g_new(int, n);
    double h[9];
    for (int i = 0; i < n; i++) {
        const struct corner *corner = &g_array_index(corners, struct corner, i);
        g_array_append_vals(places, (const double[]){corner->x_px, corner->y_px}, 2);
        ids[i] = corner->id;
    }
    if (given->print == BOARD_CHESSBOARD)
        return n == board_n_corners(given) && end_of_chessboard(picture, &board, places) == GOES_ON;
    return plane_of(&board, ids, (const double *)(gconstpointer)places->data, n, h) &&
           end_of(picture, &board, by_plane, h) == GOES_ON;
}

/* Measures the board in a picture and adds the sighting. searched is TRUE if the search for the
 * given board in this picture has failed, or has found a board that goes on beyond its corners. */
static gboolean examine(struct board_census *census, const struct picture *picture,
                        gboolean searched, GError **error) {
    const struct board *given = &census->given;
    int columns = 0, rows = 0;
    const enum end end = measure(picture, given, &columns, &rows);
    /* If a chessboard has as many inner corners as the given board should have squares, the user
     * has counted corners. This size is accepted even if the margin is narrow or the outer
     * squares are cut off. */
    const gboolean counted_corners = given->print == BOARD_CHESSBOARD && end == OPEN &&
                                     columns == given->columns + 1 && rows == given->rows + 1;
    /* A board of the given size that does not go on is the given board. */
    const gboolean as_given = end == OPEN && columns == given->columns && rows == given->rows;
    if (end != ENDS && !counted_corners && !as_given)
        columns = rows = 0;
    /* The board that was found may be another one. The given board may stand beside it, so search
     * for the given board as well. */
    if (columns > 0 && !searched && (columns != given->columns || rows != given->rows)) {
        g_autoptr(Picture) small = reduce(picture, max_px(given));
        g_autoptr(GArray) corners = board_find(small, given, FALSE, NULL);
        if (corners && !goes_on(given, small, corners)) {
            columns = given->columns;
            rows = given->rows;
        }
    }
    return add_sighting(census, picture->name, columns, rows, error);
}

gboolean board_census_before(struct board_census *census, const struct picture *picture,
                             gboolean *ret_more, GError **error) {
    const gboolean large =
        census->given.marker_mm == 0 && MAX(picture->width, picture->height) > LARGE * MAX_PX;
    *ret_more = FALSE;
    if (!large || is_settled(census))
        return TRUE;
    if (!examine(census, picture, FALSE, error))
        return FALSE;
    *ret_more = !is_settled(census);
    return TRUE;
}

gboolean board_census_after(struct board_census *census, const struct picture *picture,
                            const GArray *corners, GError **error) {
    if (is_settled(census))
        return TRUE;
    if (!corners || goes_on(&census->given, picture, corners))
        return examine(census, picture, TRUE, error);
    g_mutex_lock(&census->lock);
    census->settled = TRUE;
    g_mutex_unlock(&census->lock);
    return TRUE;
}
