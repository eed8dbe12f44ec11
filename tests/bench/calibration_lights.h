/* The part of bench_calibration that is about lamps, the light arc and laser sheets. */
#pragma once

#include <glib.h>

/* Simulated rigs with noise, distortion and position errors, whose cameras look aside
 * by some 0.04 px: the largest errors of each world. Returns a JSON object, to be freed with
 * g_free(); tell: a line a world too. */
char *bench_lights(int n_seeds, gboolean tell);
