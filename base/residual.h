/*
 * Compares a residual of a calibration with the value that the noise of its data explains. A
 * residual that is clearly larger has a physical cause that the model does not describe.
 */
#pragma once

struct residual {
    const char *of; /* beginning of the warning, such as "the light sheet of “left”" */
    /* RMS of the residuals; expected is the RMS that noise explains, or 0 if it is not known */
    double value, expected;
    const char *unit;   /* "mm"; "" for ratios */
    const char *causes; /* possible causes, the most likely first: "a bent sheet, speckle" */
};

/* Maximum ratio of a residual to its expected value that is explained by noise. */
#define RESIDUAL_LIMIT 2.0

/* Returns a sentence for the user that names the residual, its expected value and the causes. Free
 * it with g_free(). Returns NULL if the residual is at most RESIDUAL_LIMIT times its expected
 * value, or if the expected value is not known. */
char *residual_warning(const struct residual *residual);

/* Returns the part of the residual that noise does not explain, √(value² − expected²), in its unit.
 * It is 0 if the residual is at most its expected value, or if the expected value is not known. */
double residual_excess(const struct residual *residual);
