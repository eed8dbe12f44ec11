/*
 * Robust least squares: Levenberg and Marquardt's method with observations that do not fit left
 * out, what is known of parameters beforehand, and what all of it says about how well each is
 * known.
 *
 * An observation depends on a few parameters only (one lamp, one angle), and parameters none of
 * which share an observation are differentiated at once (Curtis, Powell and Reid 1974): hundreds
 * of them cost as much as a dozen.
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
    double reject; /* observations this many times the usual residual are left out */
    /* Which parameters each observation depends on: n_depends of them an observation, −1 where
     * there are fewer. A parameter has the same place with all of its observations. NULL: all
     * depend on all. */
    const int *depends;
    int n_depends;
    /* What parameters are known to be beforehand, and how well, standard deviations; 0: nothing.
     * NULL: nothing of any. Not scaled by what the observations turn out to be worth. */
    const double *known, *known_sigma;
};

struct fit_result {
    double *covariance; /* n_parameters²; a row of an undetermined one is 0 */
    double *residuals;  /* at the end, n_observations × dimension */
    guint8 *rejected;   /* n_observations */
    int n_used;         /* observations */
    int degrees_of_freedom;
    double sigma;     /* root of χ² a degree of freedom, of those used; errors count it in */
    int undetermined; /* the first parameter that the observations do not tell; −1: none */
};

/* Improves the parameters, which must start near enough. FALSE: there is not more to go by than
 * there are parameters, or a residual at the start is not finite; ret is not to be cleared then. */
gboolean fit_solve(const struct fit *fit, double *parameters, struct fit_result *ret);
void fit_result_clear(struct fit_result *result);

/* Standard error of a parameter; infinite if it is not determined. */
double fit_error(const struct fit *fit, const struct fit_result *result, int parameter);
