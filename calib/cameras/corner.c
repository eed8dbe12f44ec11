#include "corner.h"

#include "pictures/vision.h"

#include <lapacke.h>
#include <math.h>
#include <string.h>

/* Model of the grey values I at (x, y) around a corner at (0, 0):
 *   I = (1 + gx·x + gy·y) · (a + b·F(e₁, e₂)),  eᵢ = erf(lᵢ / √2σ).
 *
 * a is the level, b is the contrast, and σ is the blur. l₁, l₂ are the distances from the two
 * edges. Where black squares touch, F = e₁e₂. Where two edges end, l is positive inside, and F = (1
 * + e₁)(1 + e₂)/2 − 1.
 *
 * The gradient of light (gx, gy) multiplies black and white equally. An additive gradient would
 * shift the corner by some thousandths of a pixel where the contrast varies. */
enum { AT_X, AT_Y, TURN_1, TURN_2, LEVEL, GRADIENT_X, GRADIENT_Y, CONTRAST, BLUR, N };

#define MAX_PIXELS  1600
#define MIN_PIXELS  30
#define REACH_PX    11   /* half the side of the largest window around the corner */
#define REACH       0.44 /* half the side of the window, relative to a square */
#define GUARD_PX    0.9  /* smallest distance from edges that do not belong to the corner */
#define NEAR_PX     0.25
#define STEPS       30
#define MIN_BLUR_PX 0.2 /* smallest blur; the pixel's own width blurs more than that */

/* For lateral colour, red and blue pixels each have a separate level, contrast and blur. */
enum { RED, BLUE, GREEN, OWN = 3, ALL = N + 2 * OWN };
#define MIN_COLOURED 8 /* smallest number of red and of blue pixels of a corner */
#define MIN_SPARE    10

struct pixels {
    int n;
    double x[MAX_PIXELS], y[MAX_PIXELS], value[MAX_PIXELS]; /* x, y from the guess */
    double sign;    /* +1: white where both distances have the same sign */
    gboolean ended; /* the edges end in the corner */
    /* Only for lateral colour: RED, BLUE or GREEN of each pixel, and its position relative to the
     * centre. */
    guint8 colour[MAX_PIXELS];
    double across[MAX_PIXELS], down[MAX_PIXELS];
};

/* Gives the direction from a marker's corner into the marker: +1 or −1 along the board's x and
 * y. */
static void inwards(const struct board *board, int id, double ret[2]) {
    double corners[4][2];
    board_marker_mm(board, id / 4, corners);
    for (int k = 0; k < 2; k++) /* 2 is the opposite corner */
        ret[k] = corners[(id + 2) % 4][k] > corners[id % 4][k] ? 1 : -1;
}

/* Returns whether a pixel shows only the border of the marker or the board outside the marker, for
 * the corner of a marker in a grid of markers. Inside a marker only the border is certainly black,
 * so a pixel must lie in the border or outside the marker. dx, dy are positive inside the marker.
 * is_clear() (below) is for the corners of squares. */
static gboolean is_clear_of_marker(const struct board *board, double dx, double dy,
                                   const double guard_mm[2]) {
    const int bits = vision_dictionary(board->dictionary, NULL), border = board_border(board);
    const double depth = board->marker_mm * border / (bits + 2 * border);
    const double gap = board->square_mm - board->marker_mm;
    const double d[2] = {dx, dy};
    gboolean in_border = FALSE;
    for (int k = 0; k < 2; k++) {
        const double outside = MAX(REACH * gap, MIN(gap / 2, gap - 3 * guard_mm[k]));
        if (d[k] > REACH * board->marker_mm || d[k] < -outside)
            return FALSE;
        in_border |= d[k] < depth - guard_mm[k];
    }
    return in_border;
}

/* Returns whether a pixel shows only the four squares that meet at the corner, and is nearer to
 * this corner than to others. Corners that share pixels would share errors. dx, dy are relative to
 * the corner, in mm. */
static gboolean is_clear(const struct board *board, double sign, double dx, double dy,
                         const double guard_mm[2]) {
    const double margin = (board->square_mm - board->marker_mm) / 2;
    const double reach = REACH * board->square_mm;
    const double half = board->square_mm / 2;
    if (fabs(dx) > MAX(reach, MIN(half, board->square_mm - 3 * guard_mm[0])) ||
        fabs(dy) > MAX(reach, MIN(half, board->square_mm - 3 * guard_mm[1])))
        return FALSE;
    if (board->marker_mm == 0 || dx * dy * sign < 0)
        return TRUE;
    return fabs(dx) < margin - guard_mm[0] || fabs(dy) < margin - guard_mm[1];
}

/* Returns the second-order correction of lens distortion (struct corner_guess). */
static double straightened(const double by[3], double x, double y) {
    return by[0] * x * x + by[1] * x * y + by[2] * y * y;
}

/* Records the colour of pixel number to->n, which is at x, y of the picture. Its position is that
 * of green light from the same point. */
static void take_colour(const struct picture *picture, const struct corner_guess *guess,
                        const struct corner_lateral *lateral, int x, int y, struct pixels *to) {
    const char filter = picture->cfa[2 * (y & 1) + (x & 1)];
    const int k = filter == 'r' ? RED : filter == 'b' ? BLUE : GREEN, i = to->n;
    const double larger = k == GREEN ? 0 : lateral->larger[k];
    to->colour[i] = (guint8)k;
    to->across[i] = (x - lateral->centre_px[0]) / (1 + larger);
    to->down[i] = (y - lateral->centre_px[1]) / (1 + larger);
    to->x[i] = to->across[i] + lateral->centre_px[0] - guess->x_px;
    to->y[i] = to->down[i] + lateral->centre_px[1] - guess->y_px;
}

/* Collects the clear pixels around the guess. back is the derivative of the board's x, y with
 * respect to the picture's. lateral is the lateral colour to correct, or NULL. Returns FALSE if too
 * few of these pixels lie in the picture. */
static gboolean gather(const struct picture *picture, const struct board *board, int id,
                       const struct corner_guess *guess, const double back[2][2],
                       const struct corner_lateral *lateral, struct pixels *to) {
    const double guard_mm[2] = {GUARD_PX * hypot(back[0][0], back[0][1]),
                                GUARD_PX * hypot(back[1][0], back[1][1])};
    const int middle_x = (int)lround(guess->x_px), middle_y = (int)lround(guess->y_px);
    double into[2] = {0, 0};
    int wanted = 0;
    if (board->print == BOARD_MARKERS)
        inwards(board, id, into);
    to->n = 0;
    for (int y = middle_y - REACH_PX; y <= middle_y + REACH_PX; y++)
        for (int x = middle_x - REACH_PX; x <= middle_x + REACH_PX; x++) {
            const double px = x - guess->x_px, py = y - guess->y_px;
            const double dx = back[0][0] * px + back[0][1] * py;
            const double dy = back[1][0] * px + back[1][1] * py;
            if (board->print == BOARD_MARKERS
                    ? !is_clear_of_marker(board, into[0] * dx, into[1] * dy, guard_mm)
                    : !is_clear(board, to->sign, dx, dy, guard_mm))
                continue;
            wanted++;
            if (x < 0 || y < 0 || x >= picture->width || y >= picture->height)
                continue;
            const float value = picture->values[(gsize)y * (gsize)picture->width + (gsize)x];
            if (!isfinite(value) || to->n == MAX_PIXELS)
                continue;
            to->x[to->n] = px;
            to->y[to->n] = py;
            if (lateral)
                take_colour(picture, guess, lateral, x, y, to);
            const double at_x = to->x[to->n], at_y = to->y[to->n];
            to->x[to->n] += straightened(guess->straighten[0], at_x, at_y);
            to->y[to->n] += straightened(guess->straighten[1], at_x, at_y);
            to->value[to->n++] = (double)value;
        }
    return to->n >= MIN_PIXELS && to->n > 0.7 * wanted;
}

/* Returns the angle of the normal of an edge whose image runs along (x, y). towards is a point on
 * the positive side of the edge. */
static double normal_angle(double x, double y, double towards_x, double towards_y) {
    const double nx = -y, ny = x;
    const double sign = nx * towards_x + ny * towards_y < 0 ? -1 : 1;
    return atan2(sign * ny, sign * nx);
}

/* Terms that all pixels have in common: cosine and sine of both normals, 1 / √2σ, signed
 * contrast. */
struct edges {
    double c1, s1, c2, s2, k, b;
};

/* Returns the residual of pixel i, and its derivatives d with respect to the parameters. */
static double model(const struct pixels *pixels, int i, const double p[N], const struct edges *e,
                    double d[N]) {
    const double x = pixels->x[i] - p[AT_X], y = pixels->y[i] - p[AT_Y];
    const double u1 = (e->c1 * x + e->s1 * y) * e->k, u2 = (e->c2 * x + e->s2 * y) * e->k;
    const double e1 = erf(u1), e2 = erf(u2);
    const double d1 = M_2_SQRTPI * exp(-u1 * u1), d2 = M_2_SQRTPI * exp(-u2 * u2);
    const double light = 1 + p[GRADIENT_X] * x + p[GRADIENT_Y] * y;
    /* F of the model above, and its derivatives with respect to e₁ and e₂ */
    const double f = pixels->ended ? (1 + e1) * (1 + e2) / 2 - 1 : e1 * e2;
    const double f1 = pixels->ended ? (1 + e2) / 2 : e2, f2 = pixels->ended ? (1 + e1) / 2 : e1;
    const double bk = light * e->b * e->k, print = p[LEVEL] + e->b * f;
    d[AT_X] = -bk * (d1 * e->c1 * f1 + f2 * d2 * e->c2) - p[GRADIENT_X] * print;
    d[AT_Y] = -bk * (d1 * e->s1 * f1 + f2 * d2 * e->s2) - p[GRADIENT_Y] * print;
    d[TURN_1] = bk * d1 * (e->c1 * y - e->s1 * x) * f1;
    d[TURN_2] = bk * f2 * d2 * (e->c2 * y - e->s2 * x);
    d[LEVEL] = light;
    d[GRADIENT_X] = x * print;
    d[GRADIENT_Y] = y * print;
    d[CONTRAST] = light * pixels->sign * f;
    d[BLUR] = -light * e->b * (d1 * u1 * f1 + f2 * d2 * u2) / p[BLUR];
    return light * print - pixels->value[i];
}

/* Returns the sum of squared residuals r, and computes the normal equations h · step = g with h = Σ
 * d dᵀ, g = −Σ d r. */
static double sum(const struct pixels *pixels, const double p[N], double h[N * N], double g[N]) {
    const struct edges e = {cos(p[TURN_1]), sin(p[TURN_1]),      cos(p[TURN_2]),
                            sin(p[TURN_2]), M_SQRT1_2 / p[BLUR], p[CONTRAST] * pixels->sign};
    double total = 0, d[N];
    memset(h, 0, sizeof(double) * N * N);
    memset(g, 0, sizeof(double) * N);
    for (int i = 0; i < pixels->n; i++) {
        const double r = model(pixels, i, p, &e, d);
        total += r * r;
        for (int a = 0; a < N; a++) {
            g[a] -= d[a] * r;
            for (int b = 0; b <= a; b++)
                h[a * N + b] += d[a] * d[b];
        }
    }
    for (int a = 0; a < N; a++)
        for (int b = 0; b < a; b++)
            h[b * N + a] = h[a * N + b];
    return total;
}

/* Minimises with Levenberg-Marquardt. Returns FALSE if it does not converge. */
static gboolean minimise(const struct pixels *pixels, double p[N], double h[N * N],
                         double *ret_total) {
    double g[N], next[N], next_h[N * N], next_g[N], damping = 1e-3;
    *ret_total = sum(pixels, p, h, g);
    for (int i = 0; i < STEPS; i++) {
        /* Make one damped step: (h + damping · diag h) · step = g. */
        double a[N * N], step[N];
        memcpy(a, h, sizeof a);
        memcpy(step, g, sizeof step);
        for (int k = 0; k < N; k++)
            a[k * N + k] *= 1 + damping;
        const gboolean solved = LAPACKE_dposv(LAPACK_COL_MAJOR, 'U', N, 1, a, N, step, N) == 0;
        for (int k = 0; k < N; k++)
            next[k] = p[k] + step[k];
        next[BLUR] = MAX(next[BLUR], MIN_BLUR_PX);
        const gboolean good = solved && next[BLUR] < 2 * CORNER_MAX_BLUR_PX && next[CONTRAST] > 0;
        const double then = good ? sum(pixels, next, next_h, next_g) : G_MAXDOUBLE;
        if (!(then < *ret_total)) {
            damping = MAX(damping, 1e-4) * 10;
            if (damping > 1e4)
                return good;
            continue;
        }
        const double moved = hypot(next[AT_X] - p[AT_X], next[AT_Y] - p[AT_Y]);
        const gboolean settled = moved < 1e-4 && *ret_total - then < 1e-5 * *ret_total;
        memcpy(p, next, sizeof next);
        memcpy(h, next_h, sizeof next_h);
        memcpy(g, next_g, sizeof next_g);
        *ret_total = then;
        damping = MAX(damping / 10, 1e-9);
        if (settled)
            return TRUE;
    }
    return FALSE;
}

/* Computes the covariance of the position: the part of variance · h⁻¹ that belongs to x and y.
 * Returns FALSE if h is singular, or if the result is not positive definite. */
static gboolean covariance(const double h[N * N], double variance, double ret[2][2]) {
    double a[N * N], b[2 * N] = {0};
    memcpy(a, h, sizeof a);
    b[AT_X] = b[N + AT_Y] = 1;
    if (LAPACKE_dposv(LAPACK_COL_MAJOR, 'U', N, 2, a, N, b, N) != 0)
        return FALSE;
    ret[0][0] = b[AT_X] * variance;
    ret[1][1] = b[N + AT_Y] * variance;
    ret[0][1] = ret[1][0] = b[AT_Y] * variance;
    return ret[0][0] > 0 && ret[1][1] > 0 && ret[0][0] * ret[1][1] - ret[0][1] * ret[1][0] > 0;
}

/* Gathers pixels and fits the model. ret_back is the derivative of the board's x, y with respect to
 * the picture's. Returns FALSE if there are too few pixels, or if the fit does not converge. */
static gboolean fit_pixels(const struct picture *picture, const struct board *board, int id,
                           const struct corner_guess *guess, const struct corner_lateral *lateral,
                           struct pixels *pixels, double p[N], double h[N * N], double *ret_total,
                           double ret_back[2][2]) {
    const int column = id % (board->columns - 1) + 1, row = id / (board->columns - 1) + 1;
    double into[2] = {1, 1};
    if (board->print == BOARD_MARKERS)
        inwards(board, id, into);
    /* +1 if the corner's upper right and lower left squares are white */
    pixels->sign = board->print == BOARD_MARKERS             ? -1
                   : (column + row + board->white_first) % 2 ? -1
                                                             : 1;
    pixels->ended = board->print == BOARD_MARKERS && !board->kalibr;
    const double(*m)[2] = guess->px_a_mm;
    const double det = m[0][0] * m[1][1] - m[0][1] * m[1][0];
    const double back[2][2] = {{m[1][1] / det, -m[0][1] / det}, {-m[1][0] / det, m[0][0] / det}};
    memcpy(ret_back, back, sizeof back);
    if (!(fabs(det) > 1e-6) || !gather(picture, board, id, guess, back, lateral, pixels))
        return FALSE;
    /* Initial parameters: edges from the guess, levels from the extremes of the pixels. */
    double low = G_MAXDOUBLE, high = -G_MAXDOUBLE;
    for (int i = 0; i < pixels->n; i++) {
        low = MIN(low, pixels->value[i]);
        high = MAX(high, pixels->value[i]);
    }
    memset(p, 0, sizeof(double) * N);
    p[TURN_1] = normal_angle(m[0][1], m[1][1], into[0] * m[0][0], into[0] * m[1][0]);
    p[TURN_2] = normal_angle(m[0][0], m[1][0], into[1] * m[0][1], into[1] * m[1][1]);
    p[LEVEL] = (low + high) / 2;
    p[CONTRAST] = (high - low) / 2;
    p[BLUR] = 0.7;
    return p[CONTRAST] > 0 && minimise(pixels, p, h, ret_total);
}

/* Fits the model. Returns FALSE if the fit fails, if blur, displacement or standard error is too
 * large, if the contrast is too small, or if the edges are nearly parallel. */
static gboolean do_fit(const struct picture *picture, const struct board *board, int id,
                       const struct corner_guess *guess, struct corner *ret) {
    struct pixels pixels;
    double p[N], h[N * N], total, back[2][2];
    if (!fit_pixels(picture, board, id, guess, NULL, &pixels, p, h, &total, back))
        return FALSE;
    const double variance = MAX(total / (pixels.n - N), 1e-12 * p[CONTRAST] * p[CONTRAST]);
    *ret = (struct corner){
        .id = id,
        .x_px = guess->x_px + p[AT_X] - straightened(guess->straighten[0], p[AT_X], p[AT_Y]),
        .y_px = guess->y_px + p[AT_Y] - straightened(guess->straighten[1], p[AT_X], p[AT_Y]),
        .blur_px = p[BLUR],
        .contrast = p[CONTRAST]};
    const double moved_mm = MAX(fabs(back[0][0] * p[AT_X] + back[0][1] * p[AT_Y]),
                                fabs(back[1][0] * p[AT_X] + back[1][1] * p[AT_Y]));
    return covariance(h, variance, ret->covariance_px2) && p[BLUR] < CORNER_MAX_BLUR_PX &&
           moved_mm / board->square_mm < CORNER_MAX_MOVED &&
           p[CONTRAST] > CORNER_MIN_CONTRAST * sqrt(variance) &&
           fabs(sin(p[TURN_1] - p[TURN_2])) > 0.05 &&
           ret->covariance_px2[0][0] + ret->covariance_px2[1][1] <
               CORNER_MAX_ERROR_PX * CORNER_MAX_ERROR_PX;
}

/* The pixels are selected around the guess. If the corner found is farther than NEAR_PX from the
 * guess, the fit is repeated with pixels around that corner. */
gboolean corner_fit(const struct picture *picture, const struct board *board, int id,
                    const struct corner_guess *guess, struct corner *ret) {
    struct corner_guess nearer = *guess;
    if (board->circle_mm > 0)
        return circle_fit(picture, board, id, guess, ret);
    if (!do_fit(picture, board, id, guess, ret))
        return FALSE;
    if (hypot(ret->x_px - guess->x_px, ret->y_px - guess->y_px) < NEAR_PX)
        return TRUE;
    nearer.x_px = ret->x_px;
    nearer.y_px = ret->y_px;
    return do_fit(picture, board, id, &nearer, ret);
}

GArray *corner_fit_all(const struct picture *picture, const struct board *board,
                       const struct corner_guess *guesses) {
    GArray *found = g_array_new(FALSE, FALSE, sizeof(struct corner));
    const int n = board_n_corners(board);
    for (int id = 0; id < n; id++) {
        struct corner corner;
        if (guesses[id].px_a_mm[0][0] == 0 && guesses[id].px_a_mm[0][1] == 0)
            continue;
        if (corner_fit(picture, board, id, &guesses[id], &corner))
            g_array_append_val(found, corner);
    }
    return found;
}

/* Let θ be the corner's own parameters: p, and level, contrast and blur of red and of blue pixels.
 * A larger magnification c_k of colour k moves the light of a pixel outwards. This has the same
 * effect as a displacement of the corner that is proportional to the pixel's distance from the
 * centre.
 *
 * To first order, the residual r of a pixel of colour k changes by row · dθ + shift dc_k, where row
 * and shift are its derivatives. θ is eliminated from the normal equations. With H = Σ row rowᵀ,
 * b_k = Σ shift row, g = −Σ r row, s_k = −Σ shift r and A_kk = Σ shift², the change is the solution
 * of (A − bᵀ H⁻¹ b) dc = s − bᵀ H⁻¹ g. */
gboolean corner_lateral(const struct picture *picture, const struct board *board, int id,
                        const struct corner_guess *guess, struct corner_lateral *lateral) {
    struct pixels pixels;
    double p[N], fitted[N * N], total, back[2][2], d[N];
    double h[ALL * ALL] = {0}, rhs[3 * ALL] = {0}, square[2] = {0}, right[2] = {0};
    double b[2][ALL], g[ALL];
    int n[3] = {0};
    if (board->circle_mm > 0 ||
        !fit_pixels(picture, board, id, guess, lateral, &pixels, p, fitted, &total, back))
        return FALSE;
    const struct edges e = {cos(p[TURN_1]), sin(p[TURN_1]),      cos(p[TURN_2]),
                            sin(p[TURN_2]), M_SQRT1_2 / p[BLUR], p[CONTRAST] * pixels.sign};
    for (int i = 0; i < pixels.n; i++) {
        const double r = model(&pixels, i, p, &e, d);
        const int k = pixels.colour[i];
        double row[ALL] = {0};
        memcpy(row, d, sizeof d);
        n[k]++;
        if (k != GREEN) {
            const double shift = d[AT_X] * pixels.across[i] + d[AT_Y] * pixels.down[i];
            row[N + OWN * k] = d[LEVEL];
            row[N + OWN * k + 1] = d[CONTRAST];
            row[N + OWN * k + 2] = d[BLUR];
            square[k] += shift * shift;
            right[k] -= shift * r;
            for (int a = 0; a < ALL; a++)
                rhs[k * ALL + a] += shift * row[a];
        }
        /* LAPACK reads only this triangle of h. */
        for (int a = 0; a < ALL; a++) {
            rhs[2 * ALL + a] -= row[a] * r;
            for (int c = 0; c <= a; c++)
                h[a * ALL + c] += row[a] * row[c];
        }
    }
    if (n[RED] < MIN_COLOURED || n[BLUE] < MIN_COLOURED || pixels.n < ALL + MIN_SPARE)
        return FALSE;
    memcpy(b, rhs, sizeof b);
    memcpy(g, rhs + 2 * ALL, sizeof g);
    if (LAPACKE_dposv(LAPACK_COL_MAJOR, 'U', ALL, 3, h, ALL, rhs, ALL) != 0)
        return FALSE;
    for (int a = 0; a < ALL; a++)
        total -= g[a] * rhs[2 * ALL + a];
    const double variance = MAX(total / (pixels.n - ALL), 1e-12 * p[CONTRAST] * p[CONTRAST]);
    for (int k = 0; k < 2; k++) {
        double to[2] = {0, 0};
        to[k] = square[k];
        for (int a = 0; a < ALL; a++) {
            right[k] -= b[k][a] * rhs[2 * ALL + a];
            for (int c = 0; c < 2; c++)
                to[c] -= b[k][a] * rhs[c * ALL + a];
        }
        lateral->right[k] += right[k] / variance;
        for (int c = 0; c < 2; c++)
            lateral->normal[k][c] += to[c] / variance;
    }
    return TRUE;
}
