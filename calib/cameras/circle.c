/* To find a circle of a board, an ellipse with a blurred edge is fitted to the grey values I around
 * the edge:
 *   I = (1 + gx·x + gy·y) · (a + b·erf(s / √2σ)),  s = (q − 1) · q / |LᵀL d|,  q = |L d|.
 *
 * (x, y) = d is the pixel minus the centre. L is 2 × 2, lower triangular, with |L d| = 1 on the
 * ellipse. s is the distance from the ellipse to first order. a is the mean of black and white, and
 * b is half their difference; b is positive for dark circles. σ is the blur, and (gx, gy) is a
 * gradient of light. */
#include "corner.h"

#include <cminpack.h>
#include <math.h>

enum { AT_X, AT_Y, L_XX, L_YX, L_YY, LEVEL, CONTRAST, GRADIENT_X, GRADIENT_Y, BLUR, N };

#define MAX_PIXELS 6000
#define MIN_PIXELS 40
#define EDGE_PX    7 /* largest distance of the used pixels from the expected edge */
/* Outside the circle, the used pixels lie within this share of the gap to the next circle. */
#define BETWEEN   0.4
#define MAX_CALLS (60 * (N + 1))
#define TOLERANCE 1e-7

struct pixels {
    int n;
    double x[MAX_PIXELS], y[MAX_PIXELS], value[MAX_PIXELS]; /* x, y from the expected centre */
};

/* Computes the residual of each pixel, for cminpack. */
static int residuals(void *data, int m, int n, const double *p, double *ret, int flag) {
    const struct pixels *pixels = data;
    for (int i = 0; i < m; i++) {
        const double x = pixels->x[i] - p[AT_X], y = pixels->y[i] - p[AT_Y];
        const double u = p[L_XX] * x, v = p[L_YX] * x + p[L_YY] * y, q = hypot(u, v);
        const double slope = hypot(p[L_XX] * u + p[L_YX] * v, p[L_YY] * v);
        const double s = slope > 0 ? (q - 1) * q / slope : -G_MAXFLOAT;
        const double light = 1 + p[GRADIENT_X] * x + p[GRADIENT_Y] * y;
        ret[i] = light * (p[LEVEL] + p[CONTRAST] * erf(s * M_SQRT1_2 / p[BLUR])) - pixels->value[i];
    }
    return 0;
}

/* Collects pixels near the expected edge, and sets the initial parameters. The ellipse is the image
 * of the circle under the derivative m of the guess: |L d| = |m⁻¹ d| / radius. Returns FALSE if too
 * few of these pixels lie in the picture, or if they show no edge. */
static gboolean gather(const struct picture *picture, const struct board *board,
                       const struct corner_guess *guess, struct pixels *to, double p[N]) {
    const double(*m)[2] = guess->px_a_mm;
    const double det = m[0][0] * m[1][1] - m[0][1] * m[1][0], radius = board->circle_mm / 2;
    const double away = (board->print == BOARD_STAGGERED ? M_SQRT2 : 1) * board->square_mm;
    const double most = 1 + BETWEEN * (away - 2 * radius) / radius; /* in radii of the circle */
    if (!(fabs(det) > 1e-6))
        return FALSE;
    const double back[2][2] = {{m[1][1] / det / radius, -m[0][1] / det / radius},
                               {-m[1][0] / det / radius, m[0][0] / det / radius}};
    const double mxx = back[0][0] * back[0][0] + back[1][0] * back[1][0];
    const double mxy = back[0][0] * back[0][1] + back[1][0] * back[1][1];
    const double myy = back[0][1] * back[0][1] + back[1][1] * back[1][1];
    const int reach_x = (int)ceil(radius * most * hypot(m[0][0], m[0][1]));
    const int reach_y = (int)ceil(radius * most * hypot(m[1][0], m[1][1]));
    const double cx = guess->x_px + guess->off_centre_px[0];
    const double cy = guess->y_px + guess->off_centre_px[1];
    double sum[2] = {0, 0}, n[2] = {0, 0};
    int wanted = 0;
    to->n = 0;
    for (int y = (int)cy - reach_y; y <= (int)cy + reach_y + 1; y++)
        for (int x = (int)cx - reach_x; x <= (int)cx + reach_x + 1; x++) {
            const double dx = x - cx, dy = y - cy;
            const double q = sqrt(mxx * dx * dx + 2 * mxy * dx * dy + myy * dy * dy);
            const double slope = hypot(mxx * dx + mxy * dy, mxy * dx + myy * dy);
            if (q > most || fabs(q - 1) * q > EDGE_PX * slope)
                continue;
            wanted++;
            if (x < 0 || y < 0 || x >= picture->width || y >= picture->height)
                continue;
            const float value = picture->values[(gsize)y * (gsize)picture->width + (gsize)x];
            if (!isfinite(value) || to->n == MAX_PIXELS)
                continue;
            to->x[to->n] = dx;
            to->y[to->n] = dy;
            to->value[to->n++] = (double)value;
            sum[q > 1] += (double)value;
            n[q > 1]++;
        }
    if (to->n < MIN_PIXELS || to->n < 0.7 * wanted || n[0] == 0 || n[1] == 0)
        return FALSE;
    p[AT_X] = p[AT_Y] = p[GRADIENT_X] = p[GRADIENT_Y] = 0;
    p[L_YY] = sqrt(myy);
    p[L_YX] = mxy / p[L_YY];
    p[L_XX] = sqrt(MAX(mxx - p[L_YX] * p[L_YX], 1e-12));
    p[LEVEL] = (sum[0] / n[0] + sum[1] / n[1]) / 2;
    p[CONTRAST] = (sum[1] / n[1] - sum[0] / n[0]) / 2;
    p[BLUR] = 0.7;
    return p[CONTRAST] != 0;
}

gboolean circle_fit(const struct picture *picture, const struct board *board, int id,
                    const struct corner_guess *guess, struct corner *ret) {
    g_autofree struct pixels *pixels = g_new(struct pixels, 1);
    double p[N], diag[N], qtf[N], wa[3][N];
    int pivot[N], calls;
    if (!gather(picture, board, guess, pixels, p))
        return FALSE;
    const int n = pixels->n;
    g_autofree double *off = g_new(double, 2 * n), *jacobian = g_new(double, n *N);
    const int info =
        lmdif(residuals, pixels, n, N, p, off, TOLERANCE, TOLERANCE, 0, MAX_CALLS, 0, diag, 1, 1, 0,
              &calls, jacobian, n, pivot, qtf, wa[0], wa[1], wa[2], off + n);
    double squares = 0;
    for (int i = 0; i < n; i++)
        squares += off[i] * off[i];
    const double variance = MAX(squares / (n - N), 1e-12 * p[CONTRAST] * p[CONTRAST]);
    const double moved = hypot(p[AT_X], p[AT_Y]) * sqrt(fabs(p[L_XX] * p[L_YY]));
    if (info < 1 || info > 4 || !isfinite(moved))
        return FALSE;
    /* jacobian gets (JᵀJ)⁻¹, column by column with a stride of n */
    covar(N, jacobian, n, pivot, 1e-14, wa[0]);
    *ret = (struct corner){.id = id,
                           .x_px = guess->x_px + p[AT_X],
                           .y_px = guess->y_px + p[AT_Y],
                           .blur_px = fabs(p[BLUR]),
                           .contrast = fabs(p[CONTRAST])};
    for (int a = 0; a < 2; a++)
        for (int b = 0; b < 2; b++)
            ret->covariance_px2[a][b] = variance * jacobian[a * n + b];
    const double(*c)[2] = ret->covariance_px2;
    return ret->blur_px < CORNER_MAX_BLUR_PX &&
           moved * board->circle_mm / 2 < CORNER_MAX_MOVED * board->square_mm &&
           ret->contrast > CORNER_MIN_CONTRAST * sqrt(variance) && c[0][0] > 0 && c[1][1] > 0 &&
           c[0][0] * c[1][1] > c[0][1] * c[1][0] &&
           c[0][0] + c[1][1] < CORNER_MAX_ERROR_PX * CORNER_MAX_ERROR_PX;
}
