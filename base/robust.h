/* Robust statistics: outliers have a bounded influence. Any thread may call the functions. */
#pragma once

#include <math.h>

/* Compares two doubles, for qsort(). */
int robust_by_value(const void *a, const void *b);

/* Returns the value that has the index k after sorting n ≥ 1 values, 0 ≤ k < n. Reorders the
 * values: none before k is larger, and none behind k is smaller. This takes a time proportional to
 * n. */
double robust_select(double *values, int n, int k);

/* Returns the median of n ≥ 1 values, and reorders them. For even n it is the mean of the two
 * middle values. */
double robust_median(double *values, int n);

/* Returns the robust standard deviation of n ≥ 1 values: σ = 1.4826 · median |value − middle|. For
 * normally distributed values around middle it estimates the standard deviation. */
double robust_spread(const double *values, int n, double middle);

/* Returns the weight of a residual by Tukey's biweight: w(u) = (1 − u²)² with u = residual / (4.685
 * · scale), and 0 for |u| ≥ 1. scale is the standard deviation of the residuals without
 * outliers. */
static inline double robust_biweight(double residual, double scale) {
    const double x = residual / (4.685 * scale);
    return fabs(x) < 1 ? (1 - x * x) * (1 - x * x) : 0;
}

/* Returns the posterior mean of a value: `seen` · `known`² / (`known`² + `error`²). `seen` is the
 * measured value, and `error` is its standard error. The prior is a normal distribution with the
 * mean 0 and the standard deviation `known`. */
double robust_shrink(double seen, double error, double known);
