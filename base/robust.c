#include "robust.h"

#include <glib.h>
#include <math.h>
#include <stdlib.h>

#define BIWEIGHT 4.685
#define NORMAL   1.4826

int robust_by_value(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

double robust_median(double *values, int n) {
    qsort(values, (gsize)n, sizeof *values, robust_by_value);
    return 0.5 * (values[(n - 1) / 2] + values[n / 2]);
}

double robust_spread(const double *values, int n, double middle) {
    g_autofree double *sizes = g_new(double, n);
    for (int i = 0; i < n; i++)
        sizes[i] = fabs(values[i] - middle);
    return NORMAL * robust_median(sizes, n);
}

double robust_biweight(double residual, double scale) {
    const double x = residual / (BIWEIGHT * scale);
    return fabs(x) < 1 ? (1 - x * x) * (1 - x * x) : 0;
}

double robust_shrink(double seen, double error, double known) {
    return seen * known * known / (known * known + error * error);
}
