/* Statistics that a few wild values do not move. Any thread. */
#pragma once

/* Of n ≥ 1 values, which it sorts; of an even number the mean of the two in the middle. */
double robust_median(double *values, int n);

/* How far values usually are from a middle: 1.4826 times the median of distances, which of normal
 * deviates is their standard deviation. */
double robust_spread(const double *values, int n, double middle);

/* Tukey's weight, from 1 to 0: what is further off than 4.685 times the usual residual does not
 * count. */
double robust_biweight(double residual, double scale);

/* Of something that was seen with a standard error, and is known to be 0 up to a standard
 * deviation: what is most likely. */
double robust_shrink(double seen, double error, double known);
