/* Finds a board in a picture. The points that the detector finds (corners of markers, a whole
 * chessboard, or circles) give a map from the board to the picture. The map is a homography with
 * local corrections, because lens distortion bends the board's image. The map predicts every
 * corner, and corner.c fits each of them. If the geometry is known, the predicted print is first
 * correlated with the picture. */
#include "board_find.h"

#include "pictures/vision.h"

#include <math.h>
#include <string.h>

#define MIN_CORNERS  4
#define TOLERANCE_PX 3.0 /* largest deviation of a marker from a homography */
/* Largest deviation of a marker from a homography, in sides of a marker. The larger of TOLERANCE_PX
 * and this limit applies. */
#define TOLERANCE 0.15
#define BESIDE    2.1 /* largest distance of neighbouring markers, in squares */
/* Largest deviation of a neighbour from its predicted place, in sides of a marker. */
#define BESIDE_OFF     0.25
#define ANY_PX         1e6 /* tolerance of a homography that accepts all points */
#define STEPS_A_SQUARE 8   /* points along each side of a square that are compared in the search */
/* Smallest correlation with the print at which a board counts as found. */
#define MIN_FIT 0.45
#define STEP_MM 0.01 /* step of numerical derivatives */
/* The local correction of the homography is a weighted linear fit to the detector's points.
 *   REACH   length over which the weights fall off, in squares
 *   RIDGE   damping of the fit's slope, as a share of the sum of weights
 *   FEWEST  smallest sum of weights for which a correction is made */
#define REACH  1.0
#define RIDGE  0.05
#define FEWEST 1e-3

static GArray *refuse(GError **error, const char *format, ...) G_GNUC_PRINTF(2, 3);

static GArray *refuse(GError **error, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    g_propagate_error(error, g_error_new_valist(BOARD_ERROR, BOARD_ERROR_SPEC, format, arguments));
    va_end(arguments);
    return NULL;
}

/* Computes the even part of the projection f at the point `at` for the step h: ½ (f(at + h) + f(at
 * − h)) − f(at). To second order it is ½ hᵀ f″ h. Returns FALSE if one of the points cannot be
 * projected. */
static gboolean even_part(BoardProject project, gboolean straight, gconstpointer data,
                          const double at[2], const double step[2], double ret[2]) {
    const double there[2] = {at[0] + step[0], at[1] + step[1]};
    const double opposite[2] = {at[0] - step[0], at[1] - step[1]};
    double a[2], b[2], m[2];
    if (!project(there, straight, a, data) || !project(opposite, straight, b, data) ||
        !project(at, straight, m, data))
        return FALSE;
    for (int k = 0; k < 2; k++)
        ret[k] = (a[k] + b[k]) / 2 - m[k];
    return TRUE;
}

/* Computes the derivative of the picture's x, y (rows) with respect to the board's x, y (columns),
 * in px/mm, by finite differences. Returns FALSE if a point cannot be projected. */
static gboolean slopes(BoardProject project, gboolean straight, gconstpointer data,
                       const double at[2], double ret[2][2]) {
    const double right[2] = {at[0] + STEP_MM, at[1]}, up[2] = {at[0], at[1] + STEP_MM};
    double px[2], dx[2], dy[2];
    if (!project(at, straight, px, data) || !project(right, straight, dx, data) ||
        !project(up, straight, dy, data))
        return FALSE;
    for (int k = 0; k < 2; k++) {
        ret[k][0] = (dx[k] - px[k]) / STEP_MM;
        ret[k][1] = (dy[k] - px[k]) / STEP_MM;
    }
    return TRUE;
}

/* Solves a·x = b by Cramer's rule. Returns FALSE if a is singular. */
static gboolean solve3(double a[3][3], const double b[3], double ret[3]) {
    const double det = a[0][0] * (a[1][1] * a[2][2] - a[1][2] * a[2][1]) -
                       a[0][1] * (a[1][0] * a[2][2] - a[1][2] * a[2][0]) +
                       a[0][2] * (a[1][0] * a[2][1] - a[1][1] * a[2][0]);
    for (int k = 0; k < 3; k++) {
        double m[3][3];
        memcpy(m, a, sizeof m);
        for (int i = 0; i < 3; i++)
            m[i][k] = b[i];
        ret[k] = (m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
                  m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
                  m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0])) /
                 det;
    }
    return fabs(det) > 1e-9;
}

/* Computes the second-order terms s of a map that removes the lens distortion near a point of the
 * picture. To first order, the map changes nothing.
 *
 * f and g are the projections with and without distortion, and J and S are their first derivatives.
 * Three steps h on the board are taken. Each of them moves the point by (x, y) = J h in the
 * picture, and gives the equation J S⁻¹ ½ hᵀ g″ h − ½ hᵀ f″ h = s₀ x² + s₁ x y + s₂ y². Both
 * projections include perspective, which keeps edges straight, so only distortion remains.
 *
 * On failure the terms stay 0. */
static void straighten(const struct board *board, BoardProject project, gconstpointer data,
                       const double at[2], struct corner_guess *to) {
    const double h = 0.3 * board->square_mm, steps[3][2] = {{h, 0}, {0, h}, {h, h}};
    double s[2][2], a[3][3], b[2][3];
    const double(*j)[2] = to->px_a_mm;
    if (!slopes(project, TRUE, data, at, s))
        return;
    const double det = s[0][0] * s[1][1] - s[0][1] * s[1][0];
    for (int i = 0; i < 3; i++) {
        double bent[2], even[2];
        if (!even_part(project, FALSE, data, at, steps[i], bent) ||
            !even_part(project, TRUE, data, at, steps[i], even))
            return;
        const double u = (s[1][1] * even[0] - s[0][1] * even[1]) / det;
        const double v = (s[0][0] * even[1] - s[1][0] * even[0]) / det;
        const double x = j[0][0] * steps[i][0] + j[0][1] * steps[i][1];
        const double y = j[1][0] * steps[i][0] + j[1][1] * steps[i][1];
        for (int k = 0; k < 2; k++)
            b[k][i] = j[k][0] * u + j[k][1] * v - bent[k];
        a[i][0] = x * x;
        a[i][1] = x * y;
        a[i][2] = y * y;
    }
    double found[2][3];
    if (solve3(a, b[0], found[0]) && solve3(a, b[1], found[1]))
        memcpy(to->straighten, found, sizeof found);
}

/* Computes the centre of the image of a circle minus the image of the circle's centre, to second
 * order of the radius r: Q (r, 0) + Q (0, r), where Q is the even part of the projection. For
 * perspective, f (h) = J h (1 − c·h) with a constant vector c. With a unit vector u, the image of
 * the point r u is then J (r u − r² c), apart from a displacement along the curve. */
static void put_off_centre(const struct board *board, BoardProject project, gconstpointer data,
                           const double at[2], struct corner_guess *to) {
    const double r = board->circle_mm / 2, right[2] = {r, 0}, up[2] = {0, r};
    double a[2], b[2];
    if (!even_part(project, FALSE, data, at, right, a) ||
        !even_part(project, FALSE, data, at, up, b))
        return;
    to->off_centre_px[0] = a[0] + b[0];
    to->off_centre_px[1] = a[1] + b[1];
}

/* Predicts position and scale of all corners. If shift_px is not NULL, it is added to the
 * positions, and the curvature of the edges is predicted as well. Corners that project() refuses
 * are left 0. */
static void guess_all(const struct board *board, BoardProject project, gconstpointer data,
                      const double shift_px[2], struct corner_guess *guesses) {
    const int n = board_n_corners(board);
    memset(guesses, 0, sizeof *guesses * (gsize)n);
    for (int id = 0; id < n; id++) {
        struct corner_guess *to = &guesses[id];
        double at[2], px[2], slope[2][2];
        board_corner_mm(board, id, at);
        if (!project(at, FALSE, px, data) || !slopes(project, FALSE, data, at, slope))
            continue;
        to->x_px = px[0] + (shift_px ? shift_px[0] : 0);
        to->y_px = px[1] + (shift_px ? shift_px[1] : 0);
        memcpy(to->px_a_mm, slope, sizeof slope);
        if (board->circle_mm > 0)
            put_off_centre(board, project, data, at, to);
        if (shift_px)
            straighten(board, project, data, at, to);
    }
}

/* This BoardProject computes x' = H x in homogeneous coordinates. data is H, row by row. straight
 * has no effect. */
static gboolean by_homography(const double xy_mm[2], gboolean straight, double ret_xy_px[2],
                              gconstpointer data) {
    const double *h = data;
    const double w = h[6] * xy_mm[0] + h[7] * xy_mm[1] + h[8];
    if (!(w > 1e-9))
        return FALSE;
    ret_xy_px[0] = (h[0] * xy_mm[0] + h[1] * xy_mm[1] + h[2]) / w;
    ret_xy_px[1] = (h[3] * xy_mm[0] + h[4] * xy_mm[1] + h[5]) / w;
    return TRUE;
}

struct map {            /* a map from the board to the picture */
    double h[9];        /* homography */
    double reach_mm;    /* length over which the weights of points fall off (by_map()) */
    int n;              /* number of points that were found */
    const double *from; /* n × 2: places of these points on the board, mm */
    /* n × 2: place in the picture minus the place predicted by the homography */
    const double *off_px;
};

/* If straight is FALSE, this BoardProject adds a local linear correction to the homography. data is
 * a struct map. The correction is fitted to the deviations eᵢ of nearby points xᵢ. At x it is e₀,
 * where e₀ and E minimise Σ wᵢ |e₀ + E (xᵢ − x) − eᵢ|² + ridge |E|² with wᵢ = exp(−|xᵢ − x|² / 2
 * reach²). The ridge keeps E small where the points do not determine it. */
static gboolean by_map(const double xy_mm[2], gboolean straight, double ret_xy_px[2],
                       gconstpointer data) {
    const struct map *map = data;
    double a[3][3] = {{0}}, b[2][3] = {{0}}, found[3];
    if (!by_homography(xy_mm, straight, ret_xy_px, map->h))
        return FALSE;
    for (int i = 0; !straight && i < map->n; i++) {
        const double x = (map->from[2 * i] - xy_mm[0]) / map->reach_mm;
        const double y = (map->from[2 * i + 1] - xy_mm[1]) / map->reach_mm;
        const double row[3] = {1, x, y}, w = exp(-0.5 * (x * x + y * y));
        for (int k = 0; k < 3; k++) {
            for (int l = 0; l < 3; l++)
                a[k][l] += w * row[k] * row[l];
            b[0][k] += w * row[k] * map->off_px[2 * i];
            b[1][k] += w * row[k] * map->off_px[2 * i + 1];
        }
    }
    a[1][1] += RIDGE * a[0][0];
    a[2][2] += RIDGE * a[0][0];
    for (int k = 0; k < 2; k++)
        if (a[0][0] > FEWEST && solve3(a, b[k], found))
            ret_xy_px[k] += found[0];
    return TRUE;
}

/* Returns the tolerance of a homography in px: TOLERANCE times the mean length of the markers'
 * first edges, and at least TOLERANCE_PX. */
static double tolerance_px(const GArray *markers) {
    double sum = 0;
    for (guint i = 0; i < markers->len; i++) {
        const struct vision_marker *m = &g_array_index(markers, struct vision_marker, i);
        sum += hypot(m->corners_px[1][0] - m->corners_px[0][0],
                     m->corners_px[1][1] - m->corners_px[0][1]);
    }
    return MAX(TOLERANCE_PX, markers->len ? TOLERANCE * sum / markers->len : 0);
}

/* Returns the number of markers with at least three corners that have a flag in `good`. `good` has
 * one flag for each of n corners. */
static int board_find_agree(const guint8 *good, guint n) {
    int markers = 0;
    for (guint i = 0; i + 3 < n; i += 4)
        markers += good[i] + good[i + 1] + good[i + 2] + good[i + 3] >= 3;
    return markers;
}

/* Approximates a marker's image by a parallelogram: its derivative, px per mm, and its middle on
 * the board and in the picture. mm and px are the x, y of its four corners. */
static void marker_frame(const double *mm, const double *px, double ret_slopes[2][2],
                         double ret_mm[2], double ret_px[2]) {
    const double u[2] = {mm[4] - mm[0], mm[5] - mm[1]}, v[2] = {mm[2] - mm[6], mm[3] - mm[7]};
    const double det = u[0] * v[1] - u[1] * v[0]; /* u, v are the diagonals on the board */
    for (int k = 0; k < 2; k++) {
        const double p = px[4 + k] - px[k], q = px[2 + k] - px[6 + k];
        ret_slopes[k][0] = (p * v[1] - q * u[1]) / det;
        ret_slopes[k][1] = (q * u[0] - p * v[0]) / det;
        ret_mm[k] = (mm[k] + mm[2 + k] + mm[4 + k] + mm[6 + k]) / 4;
        ret_px[k] = (px[k] + px[2 + k] + px[4 + k] + px[6 + k]) / 4;
    }
}

/* Returns whether two markers are neighbours on the board, and lie relative to each other in the
 * picture as printed. The vector between their middles is predicted with the mean of their
 * derivatives. Perspective and distortion change this prediction only through their third
 * derivatives. */
static gboolean are_beside(const struct board *board, const double *mm_a, const double *px_a,
                           const double *mm_b, const double *px_b) {
    double a[2][2], b[2][2], from_mm[2], from_px[2], to_mm[2], to_px[2], off[2];
    marker_frame(mm_a, px_a, a, from_mm, from_px);
    marker_frame(mm_b, px_b, b, to_mm, to_px);
    const double d[2] = {to_mm[0] - from_mm[0], to_mm[1] - from_mm[1]};
    for (int k = 0; k < 2; k++)
        off[k] =
            to_px[k] - from_px[k] - ((a[k][0] + b[k][0]) * d[0] + (a[k][1] + b[k][1]) * d[1]) / 2;
    const double side_px = sqrt(fabs(b[0][0] * b[1][1] - b[0][1] * b[1][0])) * board->marker_mm;
    return hypot(d[0], d[1]) < BESIDE * board->square_mm &&
           hypot(off[0], off[1]) < MAX(TOLERANCE_PX, BESIDE_OFF * side_px);
}

/* Finds the largest set of markers that are connected by are_beside(). This test does not depend on
 * how much the lens bends the board's image. from and to have the corners of all markers on the
 * board and in the picture. ret_good gets 1 for the corners of the set, and 0 for all others. */
static void take_piece(const struct board *board, const GArray *from, const GArray *to,
                       guint8 *ret_good) {
    const guint n = from->len / 8;
    const double *mm = (const double *)(gconstpointer)from->data;
    const double *px = (const double *)(gconstpointer)to->data;
    g_autofree guint8 *seen = g_new0(guint8, n + 1);
    g_autofree guint *queue = g_new(guint, n + 1);
    guint most = 0;
    for (guint first = 0; first < n; first++) {
        guint in = 0;
        if (seen[first])
            continue;
        seen[queue[in++] = first] = 1;
        for (guint next = 0; next < in; next++)
            for (guint i = 0; i < n; i++)
                if (!seen[i] && are_beside(board, mm + 8 * queue[next], px + 8 * queue[next],
                                           mm + 8 * i, px + 8 * i))
                    seen[queue[in++] = i] = 1;
        if (in <= most)
            continue;
        most = in;
        memset(ret_good, 0, 4 * n);
        for (guint i = 0; i < in; i++)
            memset(ret_good + 4 * queue[i], 1, 4);
    }
}

/* Computes the homography through the corners of the detected markers that agree. First, these are
 * the markers of the largest connected set (take_piece()). If this set has less than half of the
 * markers, they are instead the markers that agree with one robust homography.
 *
 * from and to get the corners of the agreeing markers on the board and in the picture, as doubles,
 * two per point. ret_n gets the number of detected markers whose ids are on the board. Returns the
 * number of markers that agree. Returns 0 if fewer than two or less than half of *ret_n agree, or
 * if no homography fits. */
static int plane_through(const struct board *board, const GArray *found, double ret_h[9],
                         GArray *from, GArray *to, int *ret_n) {
    g_array_set_size(from, 0);
    g_array_set_size(to, 0);
    for (guint i = 0; i < found->len; i++) {
        const struct vision_marker *marker = &g_array_index(found, struct vision_marker, i);
        double corners[4][2];
        if (!board_marker_mm(board, marker->id, corners))
            continue;
        g_array_append_vals(from, corners, 8);
        g_array_append_vals(to, marker->corners_px, 8);
    }
    const guint n = from->len / 2;
    g_autofree guint8 *good = g_new0(guint8, n + 1), *all = g_new0(guint8, n + 1);
    *ret_n = (int)n / 4;
    if (n < 8)
        return 0;
    take_piece(board, from, to, good);
    if (2 * board_find_agree(good, n) < *ret_n &&
        !vision_homography((const double *)(gpointer)from->data, (const double *)(gpointer)to->data,
                           (int)n, tolerance_px(found), ret_h, good))
        return 0;
    const int agree = board_find_agree(good, n);
    for (guint i = n; i-- > 0;)
        if (!good[i]) {
            g_array_remove_range(from, 2 * i, 2);
            g_array_remove_range(to, 2 * i, 2);
        }
    return agree >= 2 && 2 * agree >= *ret_n &&
                   vision_homography((const double *)(gpointer)from->data,
                                     (const double *)(gpointer)to->data, (int)from->len / 2, ANY_PX,
                                     ret_h, all)
               ? agree
               : 0;
}

/* Computes the homography through the corners of the detected markers that agree. from and to
 * get these corners on the board and in the picture, as doubles, two per point. The markers of a
 * ChArUco board show which colour its first square has. If this colour differs from
 * board->white_first, board->white_first is changed. Returns FALSE with an error if the search
 * for markers fails, or if too few markers agree. The error then says what was found. */
static gboolean plane_of_markers(const struct picture *picture, struct board *board,
                                 double ret_h[9], GArray *from, GArray *to, GError **error) {
    const int border = board_border(board);
    g_autoptr(GArray) found = vision_find_markers(picture, board->dictionary, border, FALSE, error);
    if (!found)
        return FALSE;
    int n, other_n = 0, other_agree = 0;
    const int agree = plane_through(board, found, ret_h, from, to, &n);
    if (board->print == BOARD_CHARUCO && agree < n) {
        struct board other = *board;
        g_autoptr(GArray) other_from = g_array_new(FALSE, FALSE, sizeof(double));
        g_autoptr(GArray) other_to = g_array_new(FALSE, FALSE, sizeof(double));
        double h[9];
        other.white_first = !board->white_first;
        other_agree = plane_through(&other, found, h, other_from, other_to, &other_n);
        if (other_agree > agree) {
            *board = other;
            memcpy(ret_h, h, sizeof h);
            g_array_set_size(from, 0);
            g_array_set_size(to, 0);
            g_array_append_vals(from, other_from->data, other_from->len);
            g_array_append_vals(to, other_to->data, other_to->len);
        }
    }
    if (MAX(agree, other_agree) > 0)
        return TRUE;
    g_autoptr(GArray) mirrored =
        vision_find_markers(picture, board->dictionary, border, TRUE, NULL);
    if (mirrored && mirrored->len >= MAX(4, found->len))
        refuse(error, "the board is mirrored: flip the picture if it is flipped, or else print the "
                      "board again, because it was printed mirrored");
    else if (n >= 2)
        refuse(error,
               "%d markers were found, but they do not lie as on the board of %d × %d: the picture "
               "shows another board (correct --board), or the board is bent",
               n, board->columns, board->rows);
    else if (n == 1)
        refuse(error,
               "only one marker of the board is visible, and at least 2 are needed: show more of "
               "the board");
    else if (found->len > 0)
        refuse(error,
               "%u markers of the dictionary %s are visible, but a board of %d × %d has no markers "
               "with their numbers: correct --board",
               found->len, board->dictionary, board->columns, board->rows);
    else
        refuse(error,
               "no board is visible: no marker of the dictionary %s was found; if the picture "
               "shows the board, correct dictionary= in --board, or take a sharper, brighter "
               "picture",
               board->dictionary);
    return FALSE;
}

/* Returns whether the light and dark squares in the picture are exchanged relative to the board:
 * this is so if the corners were found in the reverse order, or if the first square has the other
 * colour. */
static gboolean is_reversed(const struct picture *picture, const struct board *board,
                            const double h[9]) {
    double sum = 0;
    for (int row = 0; row < board->rows; row++)
        for (int column = 0; column < board->columns; column++) {
            const double xy[2] = {(column + 0.5 - board->columns / 2.0) * board->square_mm,
                                  (board->rows / 2.0 - row - 0.5) * board->square_mm};
            double px[2];
            if (!by_homography(xy, FALSE, px, h))
                continue;
            const int x = (int)lround(px[0]), y = (int)lround(px[1]);
            if (x < 0 || y < 0 || x >= picture->width || y >= picture->height)
                continue;
            const double value =
                (double)picture->values[(gsize)y * (gsize)picture->width + (gsize)x];
            if (isfinite(value))
                sum += (column + row + board->white_first) % 2 ? value : -value;
        }
    return sum < 0;
}

/* Computes the homography of a chessboard, as plane_of_markers() does. A chessboard's corners have
 * no ids, so both orders are tried. The detector finds no false corners, so all of them are used,
 * even if lens distortion moves them far from a homography. If the board looks the same upside
 * down, any order is accepted, and board->white_first is set as found. */
static gboolean plane_of_chessboard(const struct picture *picture, struct board *board,
                                    double ret_h[9], GArray *from_mm, GArray *seen_px,
                                    GError **error) {
    const int n = board_n_corners(board);
    double *from = (double *)(gpointer)g_array_set_size(from_mm, 2 * (guint)n)->data;
    double *seen = (double *)(gpointer)g_array_set_size(seen_px, 2 * (guint)n)->data;
    g_autofree guint8 *good = g_new0(guint8, n);
    g_autoptr(GError) own = NULL;
    gboolean fits = FALSE; /* a homography fits the corners in at least one of the two orders */
    if (!vision_find_chessboard(picture, board->columns, board->rows, seen, &own)) {
        if (own)
            g_propagate_error(error, g_steal_pointer(&own));
        else
            refuse(
                error,
                "no chessboard of %d × %d squares is completely visible: show the whole board, or "
                "correct --board",
                board->columns, board->rows);
        return FALSE;
    }
    for (int reversed = 0; reversed < 2; reversed++) {
        for (int id = 0; id < n; id++)
            board_corner_mm(board, reversed ? n - 1 - id : id, from + 2 * id);
        if (!vision_homography(from, seen, n, ANY_PX, ret_h, good))
            continue;
        fits = TRUE;
        const gboolean unlike = is_reversed(picture, board, ret_h);
        const gboolean open = !board_check_upright(board, NULL);
        if (unlike && open)
            board->white_first = !board->white_first;
        if (!unlike || open)
            return TRUE;
    }
    refuse(error, fits ? "the light and dark squares in the picture do not lie as on the board: "
                         "correct --board"
                       : "the corners that were found on the chessboard do not lie on a plane: use "
                         "a flat board");
    return FALSE;
}

/* Computes the homography of a grid of circles, as plane_of_markers() does. Circles have no ids,
 * and in a symmetric grid the detector may begin at any corner of the grid. The order within the
 * rows is reversed if the grid would otherwise be mirrored. */
static gboolean plane_of_circles(const struct picture *picture, struct board *board,
                                 double ret_h[9], GArray *from_mm, GArray *seen_px,
                                 GError **error) {
    static const double middle[2] = {0, 0};
    const int n = board_n_corners(board), columns = board->columns;
    double *from = (double *)(gpointer)g_array_set_size(from_mm, 2 * (guint)n)->data;
    double *seen = (double *)(gpointer)g_array_set_size(seen_px, 2 * (guint)n)->data;
    g_autofree guint8 *good = g_new0(guint8, n);
    g_autoptr(GError) own = NULL;
    double m[2][2];
    if (!vision_find_circles(picture, columns, board->rows, board->print == BOARD_STAGGERED, seen,
                             &own)) {
        if (own)
            g_propagate_error(error, g_steal_pointer(&own));
        else
            refuse(error,
                   "no grid of %d × %d circles is completely visible: show the whole board, or "
                   "correct --board",
                   columns, board->rows);
        return FALSE;
    }
    for (int turned = 0; turned < 2; turned++) {
        for (int id = 0; id < n; id++)
            board_corner_mm(board, turned ? id - 2 * (id % columns) + columns - 1 : id,
                            from + 2 * id);
        if (vision_homography(from, seen, n, ANY_PX, ret_h, good) &&
            slopes(by_homography, FALSE, ret_h, middle, m) &&
            (m[0][0] * m[1][1] - m[1][0] * m[0][1] < 0 || board->print == BOARD_STAGGERED))
            return TRUE;
    }
    refuse(error, "the circles that were found do not lie on a plane: use a flat board");
    return FALSE;
}

/* Fits all corners at the places that the homography map->h and the points predict. from and seen
 * have the points on the board and in the picture, as doubles, two per point. The caller sets
 * map->h, and this function sets the other members of map. */
static GArray *fit_by_map(const struct picture *picture, const struct board *board, struct map *map,
                          const GArray *from, const GArray *seen) {
    g_autofree struct corner_guess *guesses = g_new0(struct corner_guess, board_n_corners(board));
    g_autofree double *off_px = g_new0(double, from->len + 2);
    map->reach_mm = REACH * board->square_mm;
    map->n = (int)from->len / 2;
    map->from = (const double *)(gconstpointer)from->data;
    map->off_px = off_px;
    for (int i = 0; i < map->n; i++)
        if (by_homography(map->from + 2 * i, FALSE, off_px + 2 * i, map->h))
            for (int k = 0; k < 2; k++)
                off_px[2 * i + k] = g_array_index(seen, double, 2 * i + k) - off_px[2 * i + k];
    guess_all(board, by_map, map, NULL, guesses);
    return corner_fit_all(picture, board, guesses);
}

GArray *board_find(const struct picture *picture, const struct board *specified, gboolean fine,
                   GError **error) {
    static const double middle[2] = {0, 0};
    struct board own = *specified, *board = &own;
    double m[2][2];
    struct map map;
    g_autoptr(GArray) from = g_array_new(FALSE, FALSE, sizeof(double));
    g_autoptr(GArray) seen = g_array_new(FALSE, FALSE, sizeof(double));
    if (!(board->marker_mm > 0   ? plane_of_markers
          : board->circle_mm > 0 ? plane_of_circles
                                 : plane_of_chessboard)(picture, board, map.h, from, seen, error))
        return NULL;
    if (board->print == BOARD_CHARUCO && board->white_first != specified->white_first && !fine)
        return refuse(error, "the board's top left square is %s: %s --board",
                      board->white_first ? "white" : "black",
                      board->white_first ? "add first=white to" : "take first=white out of");
    /* The picture's y points down, so the determinant is negative unless the picture is flipped. */
    if (!slopes(by_homography, FALSE, map.h, middle, m) ||
        m[0][0] * m[1][1] - m[1][0] * m[0][1] > 0)
        return refuse(error, "the board is mirrored: flip the picture if it is flipped, or else "
                             "print the board again, because it was printed mirrored");
    g_autoptr(GArray) corners = fit_by_map(picture, board, &map, from, seen);
    /* Fit again from the corners of the first fit, which are more accurate than the detector's
     * points. */
    if (fine) {
        g_array_set_size(from, 2 * corners->len);
        g_array_set_size(seen, 2 * corners->len);
        for (guint i = 0; i < corners->len; i++) {
            const struct corner *corner = &g_array_index(corners, struct corner, i);
            board_corner_mm(board, corner->id, &g_array_index(from, double, 2 * i));
            g_array_index(seen, double, 2 * i) = corner->x_px;
            g_array_index(seen, double, 2 * i + 1) = corner->y_px;
        }
        g_array_unref(corners);
        corners = fit_by_map(picture, board, &map, from, seen);
    }
    if (corners->len >= MIN_CORNERS)
        return g_steal_pointer(&corners);
    const char *what = board->circle_mm > 0            ? "circles"
                       : board->print == BOARD_MARKERS ? "markers"
                                                       : "squares";
    return refuse(error,
                  "only %u %s of the board are clear enough, and at least %d are needed; more "
                  "light, a sharper focus or larger %s help",
                  corners->len, board->circle_mm > 0 ? what : "corners", MIN_CORNERS, what);
}

struct points { /* points of a board in a picture: their pixels, and the printed values there */
    int n;
    int *x, *y;
    float *value;
};

/* Projects a grid of points of the board to the picture, and looks up their printed values. The
 * caller frees the members of to. */
static void gather_points(const struct board *board, BoardProject project, gconstpointer data,
                          struct points *to) {
    const int nx = board->columns * STEPS_A_SQUARE, ny = board->rows * STEPS_A_SQUARE;
    to->x = g_new(int, nx *ny);
    to->y = g_new(int, nx *ny);
    to->value = g_new(float, nx *ny);
    g_autofree double *at = g_new(double, 2 * nx * ny);
    to->n = 0;
    for (int j = 0; j < ny; j++)
        for (int i = 0; i < nx; i++) {
            const double step = board->square_mm / STEPS_A_SQUARE;
            const double xy[2] = {(i + 0.5 - nx / 2.0) * step, (j + 0.5 - ny / 2.0) * step};
            double px[2];
            if (!project(xy, FALSE, px, data) || !(fabs(px[0]) < 1e6) || !(fabs(px[1]) < 1e6))
                continue;
            to->x[to->n] = (int)lroundf((float)px[0]);
            to->y[to->n] = (int)lroundf((float)px[1]);
            memcpy(at + 2 * to->n++, xy, sizeof xy);
        }
    board_values(board, at, to->n, to->value);
}

/* Returns the Pearson correlation of the printed values u with the values v of the picture, shifted
 * by (dx, dy) pixels: (Σuv − ΣuΣv/n) / √((Σu² − (Σu)²/n)(Σv² − (Σv)²/n)). n is the number of points
 * that lie in the picture. Returns −1 if u or v is constant, if n is at most 100, or if n is at
 * most a fifth of all points. */
static double correlate(const struct picture *picture, const struct points *points, int dx,
                        int dy) {
    double n = 0, a = 0, b = 0, aa = 0, bb = 0, ab = 0;
    for (int i = 0; i < points->n; i++) {
        const int x = points->x[i] + dx, y = points->y[i] + dy;
        if (x < 0 || y < 0 || x >= picture->width || y >= picture->height)
            continue;
        const double u = (double)points->value[i];
        const double v = (double)picture->values[(gsize)y * (gsize)picture->width + (gsize)x];
        n++;
        a += u;
        b += v;
        aa += u * u;
        bb += v * v;
        ab += u * v;
    }
    const double spread = (aa - a * a / n) * (bb - b * b / n);
    return n > points->n / 5.0 && n > 100 && spread > 0 ? (ab - a * b / n) / sqrt(spread) : -1;
}

GArray *board_find_near(const struct picture *picture, const struct board *board,
                        BoardProject project, gconstpointer data, double reach_px,
                        double *ret_fit) {
    struct points points;
    double shift[2] = {0, 0};
    g_autofree struct corner_guess *guesses = g_new0(struct corner_guess, board_n_corners(board));
    gather_points(board, project, data, &points);
    /* Try all shifts, and take the shift with the largest correlation. */
    const int reach = (int)ceil(reach_px);
    *ret_fit = -1;
    for (int dy = -reach; dy <= reach; dy++)
        for (int dx = -reach; dx <= reach; dx++) {
            const double fit = correlate(picture, &points, dx, dy);
            if (fit <= *ret_fit)
                continue;
            *ret_fit = fit;
            shift[0] = dx;
            shift[1] = dy;
        }
    g_free(points.x);
    g_free(points.y);
    g_free(points.value);
    if (*ret_fit < MIN_FIT)
        return NULL;
    guess_all(board, project, data, shift, guesses);
    return corner_fit_all(picture, board, guesses);
}

int board_lateral(const struct picture *picture, const struct board *board, BoardProject project,
                  gconstpointer data, const guint8 *wanted, struct corner_lateral *lateral) {
    static const double still[2] = {0, 0};
    const int n = board_n_corners(board);
    g_autofree struct corner_guess *guesses = g_new0(struct corner_guess, n);
    int added = 0;
    guess_all(board, project, data, still, guesses);
    for (int id = 0; id < n; id++)
        if (wanted[id] && (guesses[id].px_a_mm[0][0] != 0 || guesses[id].px_a_mm[0][1] != 0))
            added += corner_lateral(picture, board, id, &guesses[id], lateral);
    return added;
}
