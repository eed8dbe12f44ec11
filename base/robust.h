/* Robust statistics: outliers have a bounded influence. Any thread may call the functions. */
#pragma once

/* Compares two doubles, for qsort(). */
int robust_by_value(const void *a, const void *b);

/* Returns the median of n ≥ 1 values, and sorts them. For even n it is the mean of the two middle
 * values. */
double robust_median(double *values, int n);

/* Returns the robust standard deviation of n ≥ 1 values: σ = 1.4826 · median |value − middle|. For
 * normally distributed values around middle it estimates the standard deviation. */
double robust_spread(const double *values, int n, double middle);

/* Returns the weight of a residual by Tukey's biweight: w(u) = (1 − u²)² with u = residual / (4.685
 * · scale), and 0 for |u| ≥ 1. scale is the standard deviation of the residuals without
 * outliers. */
double robust_biweight(double residual, double scale);

/* Returns the posterior mean of a value, seen · known² / (known² + error²). seen is the measured
 * value, and error its standard error. The prior is a normal distribution whose mean is 0 and whose
 * standard deviation is the parameter “known”. */
double robust_shrink(double seen, double error, double known);
