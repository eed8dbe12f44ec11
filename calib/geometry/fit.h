/*
 * Robust non-linear least squares: Levenberg-Marquardt with outlier rejection, priors of
 * parameters, and the covariance of the result.
 *
 * An observation depends on few parameters only (one lamp, one angle), and parameters that share
 * no observation are differentiated at the same time (Curtis, Powell and Reid 1974): hundreds of
 * them cost as much as a dozen.
 *
 * Pure; any thread.
 */
#pragma once

#include <glib.h>

/* Residuals of all observations, each divided by its standard deviation. An observation that
 * cannot be predicted (behind a camera, …) gets FIT_LOST in all its residuals. */
#define FIT_LOST 1e3
typedef void (*FitFunc)(const double *parameters, double *ret_residuals, gconstpointer data);

struct fit {
    int n_parameters;
    int n_observations;
    int dimension; /* residuals per observation, 1 or 2; they are rejected together */
    FitFunc residuals;
    gconstpointer data;
    double reject; /* observations whose residual exceeds this many robust standard deviations are
                      rejected */
    /* n_observations × n_depends: the parameters that each observation depends on, −1 where there
     * are fewer. A parameter is in the same column for all of its observations. NULL: every
     * observation depends on all. */
    const int *depends;
    int n_depends;
    /* Priors of the parameters: mean and standard deviation; 0: none. NULL: no priors at all. Not
     * scaled by the residuals of the observations. */
    const double *known, *known_sigma;
    /* The initial parameters are those of an earlier solution with nearly the same priors: outliers
     * are rejected from the beginning. */
    gboolean is_near;
};

struct fit_result {
    double *covariance; /* n_parameters²; a row of an undetermined one is 0 */
    double *residuals;  /* n_observations × dimension, at the solution */
    guint8 *rejected;   /* n_observations */
    int n_used;         /* observations */
    int degrees_of_freedom;
    double sigma; /* √(χ² per degree of freedom) of the observations used; the covariance includes
                     it */
    int undetermined; /* first parameter that the observations do not determine; −1: none */
};

/* Minimises from initial parameters, which must be close enough. FALSE: there are not more
 * observations and priors than parameters, or an initial residual is not finite; do not clear ret
 * then. */
gboolean fit_solve(const struct fit *fit, double *parameters, struct fit_result *ret);
void fit_result_clear(struct fit_result *result);

/* Standard error of a parameter; infinite if it is not determined. */
double fit_error(const struct fit *fit, const struct fit_result *result, int parameter);

/* Order of two doubles, and of two floats, for qsort(). */
int fit_compare(gconstpointer a, gconstpointer b);
int fit_compare_floats(gconstpointer a, gconstpointer b);
