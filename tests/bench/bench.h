/* What the benches share: their command line, their failures, times and quantiles. */
#pragma once

#include <glib.h>

/* Sets the locale and reads the options. A command line that is not understood ends the program
 * with status 2. arguments: what follows the options, for --help; or NULL. */
void bench_parse(int *argc, char ***argv, const GOptionEntry *entries, const char *arguments);

/* Ends the program and says why, after its name. */
void bench_fail(int status, const char *format, ...) G_GNUC_PRINTF(2, 3) G_GNUC_NORETURN;
void bench_check(const GError *error); /* with status 1, unless error is NULL */

double bench_now_s(void); /* wall time, from any start */
double bench_cpu_s(void); /* CPU time of all threads of this process */

double bench_time_quantile(double *values, int n, double q); /* sorts values */

struct bench_times {
    double median, p99;
};
struct bench_times bench_times(double *values, int n); /* sorts values */
