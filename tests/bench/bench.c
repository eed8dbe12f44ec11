#include "bench.h"

#include <locale.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

void bench_parse(int *argc, char ***argv, const GOptionEntry *entries, const char *arguments) {
    g_autoptr(GOptionContext) context = g_option_context_new(arguments);
    GError *error = NULL;
    setlocale(LC_CTYPE, "");
    g_option_context_add_main_entries(context, entries, NULL);
    if (!g_option_context_parse(context, argc, argv, &error))
        bench_fail(2, "%s", error->message);
}

void bench_fail(int status, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    g_autofree char *message = g_strdup_vprintf(format, arguments);
    va_end(arguments);
    fprintf(stderr, "%s: %s\n", g_get_prgname(), message);
    exit(status);
}

void bench_check(const GError *error) {
    if (error)
        bench_fail(1, "%s", error->message);
}

double bench_now_s(void) {
    return (double)g_get_monotonic_time() / G_USEC_PER_SEC;
}

double bench_cpu_s(void) {
    return (double)clock() / CLOCKS_PER_SEC;
}

static int by_value(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

double bench_time_quantile(double *values, int n, double q) {
    qsort(values, (gsize)n, sizeof *values, by_value);
    return values[(int)(q * (n - 1))];
}

struct bench_times bench_times(double *values, int n) {
    const double median = bench_time_quantile(values, n, 0.5);
    return (struct bench_times){median, bench_time_quantile(values, n, 0.99)};
}
