/* The benches share their command line, failures, results, times and quantiles. */
#pragma once

#include <glib.h>

/* Sets the locale and reads the options, and --json. A wrong command line ends the program with
 * status 2. arguments is the text of --help for the arguments after the options, or NULL. */
void bench_parse(int *argc, char ***argv, const GOptionEntry *entries, const char *arguments);

/* Ends the program and says why, after its name. */
void bench_fail(int status, const char *format, ...) G_GNUC_PRINTF(2, 3) G_GNUC_NORETURN;
void bench_check(const GError *error); /* with status 1, unless error is NULL */

/* Results. A bench describes each value once, and the printer writes tables of text, or JSON with
 * --json:
 *
 *     bench_begin(NULL);
 *     bench_put("%d{texels}", 64);
 *     bench_begin_list("ways");
 *     bench_row(NULL, "%-8s{way} %.2f{ms}", "grid", 1.5);
 *     bench_row(NULL, "%-8s{way} %.2f{ms}", "pairs", 9.25);
 *     bench_end();
 *     bench_end();
 *
 *     texels                  {"texels": 64,
 *     64                       "ways": [{"way": "grid", "ms": 1.50},
 *     ways                              {"way": "pairs", "ms": 9.25}]}
 *       way         ms
 *       grid      1.50
 *       pairs     9.25
 *
 * A conversion is one of printf() for strings, integers (also %zu and those of 64 bits) and
 * doubles, and is followed by the key of the value in braces. Both forms have the same digits.
 * Numbers that are not finite are null. An object that is too wide for a row of a table has a line
 * for each value.
 *
 * Within an object the key is the name of a value, and of a row of the table. It is NULL within a
 * list and at the top. */
void bench_begin(const char *key); /* an object */
void bench_begin_list(const char *key);
void bench_end(void);

/* Adds values to the object that is open. */
void bench_put(const char *format, ...) G_GNUC_PRINTF(1, 2);
void bench_put_boolean(const char *key, gboolean value);
/* Adds one value whose key is of and what, one after the other, or an array. format: of one double,
 * without a key. */
void bench_put_double(const char *of, const char *what, const char *format, double value);
void bench_put_doubles(const char *key, const char *format, const double *values, int n);

/* Adds an object of these values. */
void bench_row(const char *key, const char *format, ...) G_GNUC_PRINTF(2, 3);

double bench_now_s(void); /* wall time, from any start */
double bench_cpu_s(void); /* CPU time of all threads of this process */

double bench_time_quantile(double *values, int n, double q); /* sorts values */

struct bench_times {
    double median, p99;
};
struct bench_times bench_times(double *values, int n); /* sorts values */
