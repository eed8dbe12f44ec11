/* Finds the surface whose slopes fit best by least squares, as Frankot & Chellappa 1988, but
 * without a periodic border. With slopes p = ∂z/∂x and q = ∂z/∂y, the width h of a texel, and j the
 * neighbour of texel i to the right in a row, or below in a column (y points up, hence the plus),
 *   min Σ_rows (z_j − z_i − h (p_i + p_j) / 2)² + Σ_columns (z_j − z_i + h (q_i + q_j) / 2)²
 * over the pairs in which both texels have slopes. The normal equations L z = b are a Poisson
 * equation with free borders. They are solved by conjugate gradients, beginning with the solution
 * on a grid of half the resolution. */
#include "integrate_normals.h"

#include <math.h>
#include <string.h>

#define STEEPEST 0.1 /* minimum z of a normal whose slope is integrated */

/* a grid of at most this many texels in each dimension is solved without a coarser grid */
#define COARSEST   8
#define ITERATIONS 400 /* maximum number of iterations on each grid */
/* the iteration ends when the residual is at most this share of the residual with all heights 0 */
#define PRECISION 1e-7

struct grid {
    const float *p, *q;
    int width, height;
    double step;
};

static gboolean joined(const struct grid *grid, gsize i, gsize j) {
    return isfinite(grid->p[i] + grid->q[i] + grid->p[j] + grid->q[j]);
}

/* Computes one side of the normal equations at the top of this file: b if slopes is TRUE, otherwise
 * L z. Each value is a sum over the pairs to which a texel belongs. If slopes is TRUE, z may be
 * NULL. */
static void apply(const struct grid *grid, const double *z, gboolean slopes, double *ret) {
    const gsize width = (gsize)grid->width, n = width * (gsize)grid->height;
    memset(ret, 0, sizeof(double) * n);
    for (gsize i = 0; i < n; i++) {
        if (i % width + 1 < width && joined(grid, i, i + 1)) {
            const double rise = ((double)grid->p[i] + (double)grid->p[i + 1]) / 2 * grid->step;
            const double d = slopes ? rise : z[i + 1] - z[i];
            ret[i] -= d;
            ret[i + 1] += d;
        }
        if (i + width < n && joined(grid, i, i + width)) {
            const double rise = -((double)grid->q[i] + (double)grid->q[i + width]) / 2 * grid->step;
            const double d = slopes ? rise : z[i + width] - z[i];
            ret[i] -= d;
            ret[i + width] += d;
        }
    }
}

static double dot(const double *a, const double *b, gsize n) {
    double sum = 0;
    for (gsize i = 0; i < n; i++)
        sum += a[i] * b[i];
    return sum;
}

/* Solves L z = b by conjugate gradients, beginning with z. L is singular, but b is orthogonal to
 * its kernel. */
static void relax(const struct grid *grid, double *z) {
    const gsize n = (gsize)grid->width * (gsize)grid->height;
    g_autofree double *r = g_new0(double, n), *along = g_new0(double, n), *l = g_new0(double, n);
    apply(grid, NULL, TRUE, r);
    const double least = PRECISION * PRECISION * dot(r, r, n);
    apply(grid, z, FALSE, l);
    for (gsize i = 0; i < n; i++)
        along[i] = r[i] -= l[i];
    double squares = dot(r, r, n);
    for (int k = 0; k < ITERATIONS && squares > least; k++) {
        apply(grid, along, FALSE, l);
        const double way = dot(along, l, n);
        if (!(way > 0))
            return;
        for (gsize i = 0; i < n; i++) {
            z[i] += squares / way * along[i];
            r[i] -= squares / way * l[i];
        }
        const double after = dot(r, r, n);
        for (gsize i = 0; i < n; i++)
            along[i] = r[i] + after / squares * along[i];
        squares = after;
    }
}

/* Averages the slopes of 2 × 2 texels. Texels without slopes do not count. The mean is NaN if none
 * of the four has slopes. */
static struct grid halve(const struct grid *grid, float *p, float *q) {
    const struct grid half = {p, q, (grid->width + 1) / 2, (grid->height + 1) / 2, 2 * grid->step};
    for (int i = 0; i < half.width * half.height; i++) {
        double sum_p = 0, sum_q = 0;
        int n = 0;
        for (int k = 0; k < 4; k++) {
            const int x = 2 * (i % half.width) + k % 2, y = 2 * (i / half.width) + k / 2;
            const gsize from = (gsize)y * (gsize)grid->width + (gsize)x;
            if (x < grid->width && y < grid->height && joined(grid, from, from)) {
                sum_p += (double)grid->p[from];
                sum_q += (double)grid->q[from];
                n++;
            }
        }
        p[i] = n ? (float)(sum_p / n) : NAN;
        q[i] = n ? (float)(sum_q / n) : NAN;
    }
    return half;
}

static void integrate_grid(const struct grid *grid, double *z) {
    const int width = (grid->width + 1) / 2, height = (grid->height + 1) / 2;
    const gsize n = (gsize)width * (gsize)height;
    if (MAX(grid->width, grid->height) > COARSEST) {
        g_autofree float *p = g_new0(float, n), *q = g_new0(float, n);
        g_autofree double *coarse = g_new0(double, n);
        const struct grid half = halve(grid, p, q);
        integrate_grid(&half, coarse);
        for (int y = 0; y < grid->height; y++)
            for (int x = 0; x < grid->width; x++) {
                /* The centre of a coarse texel is the corner where four fine texels meet. In x and
                 * in y, the centre of each fine texel is a quarter of the coarse texel's width
                 * away. */
                const int i = y / 2 * width + x / 2;
                const double dx = (x % 2 ? 0.25 : -0.25) * half.step;
                const double dy = (y % 2 ? -0.25 : 0.25) * half.step;
                const double slope = isfinite(p[i]) ? (double)p[i] * dx + (double)q[i] * dy : 0;
                z[y * grid->width + x] = coarse[i] + slope;
            }
    }
    relax(grid, z);
}

void integrate_normals(const float *p, const float *q, int width, int height, double step,
                       float *ret_z) {
    const struct grid grid = {p, q, width, height, step};
    const gsize n = (gsize)width * (gsize)height;
    g_autofree double *z = g_new0(double, n);
    double sum = 0;
    gsize known = 0;
    integrate_grid(&grid, z);
    for (gsize i = 0; i < n; i++)
        if (joined(&grid, i, i)) {
            sum += z[i];
            known++;
        }
    for (gsize i = 0; i < n; i++)
        ret_z[i] = joined(&grid, i, i) ? (float)(z[i] - sum / (double)MAX(known, 1)) : NAN;
}

void integrate_normals_of(const float *normals, int width, int height, double step, float *ret_z,
                          float *ret_known) {
    const gsize n = (gsize)width * (gsize)height;
    g_autofree float *p = g_new0(float, n), *q = g_new0(float, n);
    for (gsize i = 0; i < n; i++) {
        const float *normal = normals + 3 * i;
        const float z = MAX(normal[2], (float)STEEPEST);
        p[i] = normal[2] > 0 ? -normal[0] / z : NAN;
        q[i] = normal[2] > 0 ? -normal[1] / z : NAN;
        ret_known[i] = normal[2] > 0;
    }
    integrate_normals(p, q, width, height, step, ret_z);
    for (gsize i = 0; i < n; i++)
        if (ret_known[i] <= 0)
            ret_z[i] = 0;
}
