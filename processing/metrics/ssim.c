/* SSIM from five local means: of x, y, x², y² and x·y. */
#include "ssim.h"

#include "psnr.h"

#include <math.h>

#define SIGMA 1.5
#define C_1   (0.01 * 0.01)
#define C_2   (0.03 * 0.03)

enum { X, Y, XX, YY, XY, MEANS };

/* Returns the SSIM of one window from its five means (Wang et al. 2004 eq. 13). */
static double similarity(const double m[MEANS]) {
    const double var_x = m[XX] - m[X] * m[X], var_y = m[YY] - m[Y] * m[Y];
    const double covariance = m[XY] - m[X] * m[Y];
    return (2 * m[X] * m[Y] + C_1) * (2 * covariance + C_2) /
           ((m[X] * m[X] + m[Y] * m[Y] + C_1) * (var_x + var_y + C_2));
}

static void make_window(double ret[SSIM_WINDOW]) {
    double sum = 0;
    for (int k = 0; k < SSIM_WINDOW; k++) {
        const double x = (k - (SSIM_WINDOW - 1) * 0.5) / SIGMA;
        ret[k] = exp(-x * x / 2);
        sum += ret[k];
    }
    for (int k = 0; k < SSIM_WINDOW; k++)
        ret[k] /= sum;
}

/* Computes, for each column and channel, the weighted means over the SSIM_WINDOW rows from row
 * on. */
static void average_rows(const float *x, const float *y, int width, int row,
                         const double window[SSIM_WINDOW], double (*ret)[MEANS]) {
    for (int i = 0; i < 3 * width; i++) {
        double *m = ret[i];
        for (int k = 0; k < MEANS; k++)
            m[k] = 0;
        for (int k = 0; k < SSIM_WINDOW; k++) {
            const gsize at = (gsize)(row + k) * 3 * (gsize)width + (gsize)i;
            const double a = x[at], b = y[at], w = window[k];
            m[X] += w * a;
            m[Y] += w * b;
            m[XX] += w * a * a;
            m[YY] += w * b * b;
            m[XY] += w * a * b;
        }
    }
}

double ssim(const float *reference, const float *test, int width, int height) {
    const gsize n = 3 * (gsize)width * (gsize)height;
    const int across = width - SSIM_WINDOW + 1, down = height - SSIM_WINDOW + 1;
    if (across < 1 || down < 1)
        return NAN;
    double window[SSIM_WINDOW] = {0}, sum = 0;
    g_autofree float *x = g_new(float, n), *y = g_new(float, n);
    g_autofree double(*columns)[MEANS] = g_malloc0_n(3 * (gsize)width, sizeof *columns);
    make_window(window);
    psnr_show(reference, n, x);
    psnr_show(test, n, y);
    for (int row = 0; row < down; row++) {
        average_rows(x, y, width, row, window, columns);
        for (int i = 0; i < 3 * across; i++) {
            double m[MEANS] = {0};
            for (int k = 0; k < SSIM_WINDOW; k++)
                for (int j = 0; j < MEANS; j++)
                    m[j] += window[k] * columns[i + 3 * k][j];
            sum += similarity(m);
        }
    }
    return sum / (3.0 * across * down);
}
