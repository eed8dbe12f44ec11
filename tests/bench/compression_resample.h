/* The part of bench_compression on eigen-BRDFs on a grid: what that costs at and between the
 * measured directions, against interpolation of the measured ones by nine pairs. */
#pragma once

#include <glib.h>

/* sessions: a material and the same from directions between, pair by pair. Returns what a program
 * does. */
int bench_resample(char *const *sessions, int clusters, int components, gboolean json);
