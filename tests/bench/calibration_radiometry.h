/* The radiometric part of bench_calibration. */
#pragma once

#include <glib.h>

/* Measures with worlds of n seeds; a JSON object of its figures, g_free(). verbose: tells them as
 * they come. */
char *bench_radiometry(int n_seeds, gboolean verbose);
