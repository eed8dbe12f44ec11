#include "robust.h"

#include <glib.h>
#include <math.h>
#include <stdlib.h>

#define NORMAL 1.4826

int robust_by_value(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double middle_of_three(double a, double b, double c) {
    return MAX(MIN(a, b), MIN(MAX(a, b), c));
}

/* Returns the ninther (Tukey 1978) of the values from first to before end: the median of three
 * medians, each of three values. */
static double guess_median(const double *values, int first, int end) {
    double middles[3];
    const int step = (end - first - 1) / 8;
    for (int i = 0; i < 3; i++) {
        const double *from = values + first + 3 * i * step;
        middles[i] = middle_of_three(from[0], from[step], from[2 * step]);
    }
    return middle_of_three(middles[0], middles[1], middles[2]);
}

/* Moves the values below the pivot to the front of first … end − 1. If equal is TRUE, values equal
 * to the pivot are moved as well. Returns the index behind the values that were moved. There is no
 * branch in the loop, because a processor would mispredict half of its turns. */
static int partition(double *values, int first, int end, double pivot, gboolean equal) {
    int next = first;
    for (int i = first; i < end; i++) {
        const double value = values[i];
        values[i] = values[next];
        values[next] = value;
        next += equal ? value <= pivot : value < pivot;
    }
    return next;
}

/* Quickselect (Hoare 1961). If a pivot is not a number, the values that are left are sorted. */
double robust_select(double *values, int n, int k) {
    int first = 0, end = n;
    while (end - first > 8) {
        const double pivot = guess_median(values, first, end);
        if (isnan(pivot))
            break;
        const int less = partition(values, first, end, pivot, FALSE);
        if (k < less) {
            end = less;
            continue;
        }
        first = partition(values, less, end, pivot, TRUE);
        if (k < first)
            return values[k];
    }
    qsort(values + first, (gsize)end - (gsize)first, sizeof *values, robust_by_value);
    return values[k];
}

double robust_median(double *values, int n) {
    const double upper = robust_select(values, n, n / 2);
    if (n % 2)
        return upper;
    double lower = values[0];
    for (int i = 1; i < n / 2; i++)
        lower = MAX(lower, values[i]);
    return 0.5 * (lower + upper);
}

double robust_spread(const double *values, int n, double middle) {
    g_autofree double *sizes = g_new(double, n);
    for (int i = 0; i < n; i++)
        sizes[i] = fabs(values[i] - middle);
    return NORMAL * robust_median(sizes, n);
}

double robust_shrink(double seen, double error, double known) {
    return seen * known * known / (known * known + error * error);
}
