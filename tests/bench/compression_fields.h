/* The part of bench_compression on models of a texel: errors of reflectance fields, polynomials and
 * Lafortune models (Meseth et al. 2003, Table 1), and the batch solver against others. */
#pragma once

#include <glib.h>

/* Prints one JSON object, or lines, about these sessions; what a program returns. fits: so many
 * problems of each are given to all solvers. */
int bench_fields(char *const *sessions, int fits, gboolean json);
