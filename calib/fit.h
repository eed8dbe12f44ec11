/*
 * Robust least squares: Levenberg and Marquardt's method (MINPACK) with observations that do not
 * fit left out, and what the rest says about how well each parameter is known.
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
    int dimension; /* residuals an observation, 1 or 2: in or out together */
    FitFunc residuals;
    gconstpointer data;
    double reject; /* observations this many times the usual residual are left out, but not */
    int n_sure;    /* the last ones: what is known beforehand */
};

struct fit_result {
    double *covariance; /* n_parameters², scaled by sigma²; a row of an undetermined one is 0 */
    double *residuals;  /* at the end, n_observations × dimension */
    guint8 *rejected;   /* n_observations */
    int n_used;         /* observations */
    int degrees_of_freedom;
    double sigma;     /* root of χ² a degree of freedom, of those used */
    int undetermined; /* the first parameter that the observations do not tell; −1: none */
};

/* Improves the parameters, which must start near enough. FALSE: there are not more residuals than
 * parameters, or a residual at the start is not finite; ret is not to be cleared then. */
gboolean fit_solve(const struct fit *fit, double *parameters, struct fit_result *ret);
void fit_result_clear(struct fit_result *result);

/* Standard error of a parameter; infinite if it is not determined. */
double fit_error(const struct fit *fit, const struct fit_result *result, int parameter);
