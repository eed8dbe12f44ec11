/* Of measured times. */
#pragma once

#include <glib.h>
#include <stdlib.h>

static inline int quantile_compare(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Sorts values. */
static inline double quantile(double *values, int n, double q) {
    qsort(values, (gsize)n, sizeof *values, quantile_compare);
    return values[(int)(q * (n - 1))];
}
