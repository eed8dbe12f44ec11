#include "compression_parts.h"

#include "bench.h"

#include <glib/gstdio.h>
#include <math.h>
#include <stdio.h>
#include <sys/resource.h>
#include <unistd.h>

static const int ranks_of[] = {1, 2, 4};
#define RUNS ((int)G_N_ELEMENTS(ranks_of))

struct run {
    double real_s, processor_s; /* of all processes together */
    double error;               /* of the result */
};

/* Of children that have ended. */
static double children_s(void) {
    struct rusage usage;
    getrusage(RUSAGE_CHILDREN, &usage);
    return (double)(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) +
           1e-6 * (double)(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
}

static gboolean parse_error(const char *text, double *ret) {
    const char *at = g_strstr_len(text, -1, "\"error\":");
    *ret = at ? g_ascii_strtod(at + 8, NULL) : NAN;
    return at != NULL;
}

static gboolean measure(int ranks, const char *session, int clusters, int components,
                        const char *output, struct run *ret, GError **error) {
    g_autofree char *n = g_strdup_printf("%d", ranks), *text = NULL;
    g_autofree char *k = g_strdup_printf("%d", clusters), *c = g_strdup_printf("%d", components);
    const char *const argv[] = {
        MPIEXEC, "--oversubscribe", "-n", n,    COMPRESS_MPI, session,  "-k", k, "--components",
        c,       "--threads",       "1",  "-o", output,       "--json", NULL};
    int status = 0;
    const double before = children_s();
    const gint64 begun = g_get_monotonic_time();
    if (!g_spawn_sync(NULL, (char **)argv, NULL, G_SPAWN_DEFAULT, NULL, NULL, &text, NULL, &status,
                      error) ||
        !g_spawn_check_wait_status(status, error))
        return FALSE;
    ret->real_s = (double)(g_get_monotonic_time() - begun) / G_USEC_PER_SEC;
    ret->processor_s = children_s() - before;
    if (!parse_error(text, &ret->error))
        g_set_error(error, G_SPAWN_ERROR, G_SPAWN_ERROR_FAILED, "no error in “%s”", text);
    return isfinite(ret->error);
}

/* Speed and work against one process. */
static void print_runs(const struct run *runs) {
    bench_begin(NULL);
    bench_begin_list("runs");
    for (int i = 0; i < RUNS; i++) {
        const struct run *run = &runs[i];
        bench_row(NULL,
                  "%d{ranks} %.3f{real_s} %.3f{speed_up} %.3f{processor_s} %.3f{work} %.6f{error}",
                  ranks_of[i], run->real_s, runs[0].real_s / run->real_s, run->processor_s,
                  run->processor_s / runs[0].processor_s, run->error);
    }
    bench_end();
    bench_end();
}

int bench_ranks(const char *session, int clusters, int components) {
    g_autoptr(GError) error = NULL;
    g_autofree char *output =
        g_strdup_printf("%s/bench_ranks_%d.exr", g_get_tmp_dir(), (int)getpid());
    struct run runs[G_N_ELEMENTS(ranks_of)];
    for (int i = 0; !error && i < RUNS; i++)
        measure(ranks_of[i], session, clusters, components, output, &runs[i], &error);
    g_unlink(output);
    if (error)
        fprintf(stderr, "%s\n", error->message);
    else
        print_runs(runs);
    return error != NULL;
}
