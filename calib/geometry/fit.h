/*
 * This module solves robust non-linear least squares by the method of Levenberg and Marquardt, with
 * rejection of outliers, priors of parameters, and the covariance of the result.
 *
 * Each observation may depend on only a few parameters, such as those of one lamp and of one angle.
 * Parameters that share no observation are then differentiated at the same time (Curtis, Powell and
 * Reid 1974), so that hundreds of parameters cost as much as a dozen.
 *
 * The functions are pure, and any thread may call them.
 */
#pragma once

#include <glib.h>

/* residual of an observation that cannot be predicted */
#define FIT_LOST 1e3
/* Computes the residuals of all observations, each divided by its standard deviation. If an
 * observation cannot be predicted, for example because it is behind a camera, all its residuals are
 * FIT_LOST. */
typedef void (*FitFunc)(const double *parameters, double *ret_residuals, gconstpointer data);

struct fit {
    int n_parameters;
    int n_observations;
    int dimension; /* residuals per observation, 1 or 2; they are rejected together */
    FitFunc residuals;
    gconstpointer data;
    /* Observations whose residual exceeds this many robust standard deviations are rejected. */
    double reject;
    /* n_observations × n_depends: the indexes of the parameters that each observation depends on,
     * filled up with −1. A parameter is in the same column for all of its observations. If depends
     * is NULL, every observation depends on all parameters. */
    const int *depends;
    int n_depends;
    /* Priors of the parameters, n_parameters each: mean and standard deviation. A parameter whose
     * standard deviation is 0 has no prior. If known_sigma is NULL, no parameter has a prior. The
     * standard deviations are not scaled by the residuals of the observations. */
    const double *known, *known_sigma;
    /* The initial parameters are those of an earlier solution with nearly the same priors: outliers
     * are rejected from the beginning. */
    gboolean is_near;
};

struct fit_result {
    double *covariance; /* n_parameters²; row and column of an undetermined parameter are 0 */
    double *residuals;  /* n_observations × dimension, at the solution */
    guint8 *rejected;   /* one flag per observation */
    int n_used;         /* number of observations that were not rejected */
    int degrees_of_freedom;
    /* √(χ² per degree of freedom) of the observations used. The covariance includes this factor. */
    double sigma;
    /* Index of a parameter that the observations and priors do not determine. It is −1 if there is
     * no such parameter, and 0 if no degree of freedom is left. */
    int undetermined;
};

/* Minimises from the given parameters, which must be close to the solution, and writes the
 * solution into them. Returns FALSE if there is no observation, if an initial residual is not
 * finite, or if the numbers of residuals and priors together do not exceed the number of
 * parameters. After FALSE, ret holds nothing that must be freed. */
gboolean fit_solve(const struct fit *fit, double *parameters, struct fit_result *ret);
void fit_result_clear(struct fit_result *result);

/* Returns the standard error of a parameter, which is infinite if it is not determined. */
double fit_error(const struct fit *fit, const struct fit_result *result, int parameter);

/* Compare two doubles, and two floats, for qsort(). */
int fit_compare(gconstpointer a, gconstpointer b);
int fit_compare_floats(gconstpointer a, gconstpointer b);
