#include "mdf_errors.h"

#include <math.h>

#define AROUND 2  /* the scatter of texels up to this number of columns and rows away is used */
#define CELLS  16 /* number of points of a cell in each dimension, for q(p) */

/* Returns ū: the mean of u over the texels around a texel, weighted by degrees of freedom. If none
 * of them has degrees of freedom, returns the texel's own u. */
static double mdf_errors_around(const struct mdf_errors_grid *grid,
                                const struct mdf_spread *spreads, int texel) {
    const int column = texel % grid->width, row = texel / grid->width;
    double sum = 0, freedom = 0;
    for (int y = MAX(row - AROUND, 0); y <= MIN(row + AROUND, grid->height - 1); y++)
        for (int x = MAX(column - AROUND, 0); x <= MIN(column + AROUND, grid->width - 1); x++) {
            const struct mdf_spread *other = &spreads[y * grid->width + x];
            if (y * grid->width + x == texel)
                continue;
            sum += other->freedom * other->frames2;
            freedom += other->freedom;
        }
    return freedom > 0 ? sum / freedom : spreads[texel].frames2;
}

/* Returns the logarithm of the likelihood of u, without terms that do not depend on k. u / ū has
 * ν degrees of freedom about a variance that follows an inverse χ² distribution with k + 2
 * degrees of freedom and mean 1. */
static double likelihood(double k, double freedom, double u, double mean) {
    const double d = k + 2;
    return lgamma((freedom + d) / 2) - lgamma(d / 2) + d / 2 * log(k * mean) -
           (freedom + d) / 2 * log(k * mean + freedom * u);
}

static double mdf_errors_k(const struct mdf_errors_grid *grid, const struct mdf_spread *spreads,
                           const double *around) {
    double best = 0, most = -INFINITY;
    for (double k = 0.25; k <= 64; k *= 2) {
        double sum = 0;
        for (int i = 0; i < grid->width * grid->height; i++)
            if (spreads[i].freedom > 0 && around[i] > 0)
                sum += likelihood(k, spreads[i].freedom, spreads[i].frames2, around[i]);
        if (sum > most) {
            most = sum;
            best = k;
        }
    }
    return best;
}

/* Computes q(p). The mean of (z(x) − z(y))² is D(|x − y|) = |x − y|^p. Hence the mean square error
 * of the interpolated value Σ w z(corner) at a point is Σ w D − ½ Σ Σ w w D. The first sum is over
 * the distances from the point to the corners, and the second over those between corners. For p
 * above 2, D is a generalised covariance, because the weights w reproduce planes. */
double mdf_errors_between(double p) {
    static const double corner[4][2] = {{0, 0}, {1, 0}, {0, 1}, {1, 1}};
    double sum = 0;
    p = fabs(p - 2) < 0.02 ? 2.02 : p; /* at p = 2, numerator and denominator are 0 */
    for (int point = 0; point < CELLS * CELLS; point++) {
        const double u = (point % CELLS + 0.5) / CELLS, v = ((int)(point / CELLS) + 0.5) / CELLS;
        const double w[4] = {(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v};
        for (int i = 0; i < 4; i++) {
            sum += w[i] * pow(hypot(u - corner[i][0], v - corner[i][1]), p);
            for (int j = 0; j < 4; j++)
                if (i != j)
                    sum -= 0.5 * w[i] * w[j] *
                           pow(hypot(corner[i][0] - corner[j][0], corner[i][1] - corner[j][1]), p);
        }
    }
    return sum / (CELLS * CELLS) / (2 * (1 - pow(2, p - 2)));
}

/* Returns p from the bends over one and over two spacings, at the texels at which both are
 * known. */
static double exponent(const struct mdf_errors_grid *grid, const struct mdf_spread *spreads) {
    double squares[2] = {0};
    for (int i = 0; i < grid->width * grid->height; i++)
        for (int axis = 0; axis < 2 && spreads[i].n > 1; axis++) {
            const struct mdf_spread *s = &spreads[i];
            if (!isfinite(s->bend_mm[axis]) || !isfinite(s->bend_mm[2 + axis]))
                continue;
            for (int k = 0; k < 2; k++)
                squares[k] += pow(s->bend_mm[2 * k + axis], 2) - s->noise_mm2[2 * k + axis];
        }
    if (!(squares[0] > 0))
        return 4;
    return squares[1] > 0 ? CLAMP(log2(squares[1] / squares[0]), 0, 4) : 0;
}

/* Returns b_x² + b_y² without noise: the mean over the texels whose bends overlap with the bend of
 * this texel. A bend of the spacing h reaches h to both sides. Two bends overlap by 1 − distance /
 * 2h. */
static double mdf_errors_bent(const struct mdf_errors_grid *grid, const struct mdf_spread *spreads,
                              int texel) {
    const int column = texel % grid->width, row = texel / grid->width;
    const int reach[2] = {(int)(2 * grid->spacing[0]), (int)(2 * grid->spacing[1])};
    double sum = 0, weights = 0;
    for (int y = MAX(row - reach[1], 0); y <= MIN(row + reach[1], grid->height - 1); y++)
        for (int x = MAX(column - reach[0], 0); x <= MIN(column + reach[0], grid->width - 1); x++) {
            const struct mdf_spread *s = &spreads[y * grid->width + x];
            const double weight = MAX(1 - abs(x - column) / (2 * grid->spacing[0]), 0) *
                                  MAX(1 - abs(y - row) / (2 * grid->spacing[1]), 0);
            if (s->n == 0)
                continue;
            for (int axis = 0; axis < 2; axis++)
                if (isfinite(s->bend_mm[axis]))
                    sum += weight * (pow(s->bend_mm[axis], 2) - s->noise_mm2[axis]);
            weights += weight;
        }
    return weights > 0 ? sum / weights : 0;
}

/* If there is only noise, squared bends without noise are as often above 0 as below. The mean of
 * only the positive ones would be too large. Therefore positive values are scaled so that the
 * mean over the texels around is the mean of all values. */
static double unbiased(const struct mdf_errors_grid *grid, const double *bent, int texel) {
    const int column = texel % grid->width, row = texel / grid->width;
    double sum = 0, above = 0;
    for (int y = MAX(row - AROUND, 0); y <= MIN(row + AROUND, grid->height - 1); y++)
        for (int x = MAX(column - AROUND, 0); x <= MIN(column + AROUND, grid->width - 1); x++) {
            sum += bent[y * grid->width + x];
            above += MAX(bent[y * grid->width + x], 0);
        }
    return above > 0 ? MAX(bent[texel], 0) * MAX(sum, 0) / above : 0;
}

void mdf_errors_find(const struct mdf_errors_grid *grid, const struct mdf_spread *spreads,
                     float *ret_error_mm) {
    const int n = grid->width * grid->height;
    g_autofree double *around = g_new0(double, n), *bent = g_new0(double, n);
    for (int i = 0; i < n; i++) {
        around[i] = mdf_errors_around(grid, spreads, i);
        bent[i] = mdf_errors_bent(grid, spreads, i);
    }
    const double k = mdf_errors_k(grid, spreads, around);
    const double between = mdf_errors_between(exponent(grid, spreads));
    for (int i = 0; i < n; i++) {
        const struct mdf_spread *s = &spreads[i];
        if (s->n < 2)
            continue;
        const double frames2 =
            (s->freedom * s->frames2 + k * around[i]) / MAX(s->freedom + k, 1e-6);
        ret_error_mm[i] = (float)sqrt(frames2 * s->unit_mm2 + between * unbiased(grid, bent, i));
    }
}
