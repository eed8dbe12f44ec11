/* Robust statistics: outliers have a bounded influence. Any thread. */
#pragma once

/* Compares two doubles, for qsort(). */
int robust_by_value(const void *a, const void *b);

/* Median of n ≥ 1 values, which it sorts; for even n the mean of the two middle values. */
double robust_median(double *values, int n);

/* Robust standard deviation: σ = 1.4826 · median |value − middle|. It equals the standard deviation
 * for normally distributed values. */
double robust_spread(const double *values, int n, double middle);

/* Tukey's biweight: w(u) = (1 − u²)² with u = residual / (4.685 · scale), 0 for |u| ≥ 1. */
double robust_biweight(double residual, double scale);

/* Posterior mean of a value that was measured as seen with a standard error, if its prior is normal
 * with mean 0 and standard deviation known: seen · known² / (known² + error²). */
double robust_shrink(double seen, double error, double known);
