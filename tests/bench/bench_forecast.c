/*
 * The expected error of the material so far (processing/partial) against the true one. Each SESSION
 * has all pictures, and a part of its shots is used: in random order, in the planned order, or in
 * the order of another session of the same directions (--order, such as one with sampling =
 * adaptive). The true error is ‖predicted − measured‖ / ‖measured‖ over all texels, where pictures
 * that are used have no error and measured are those of the session, or of the same session
 * captured without noise (--quiet). Names of --order and --quiet are next to the session.
 */
#include "bench.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "partial/partial_forecast.h"
#include "partial/shared_exponent.h"

static char *order_name, *quiet_name, *parts_list = "0.1;0.25;0.4;0.6";
static int seeds = 3;
static gboolean planned;
static const GOptionEntry entries[] = {
    {"seeds", 0, 0, G_OPTION_ARG_INT, &seeds, "Number of random orders; default 3", "N"},
    {"planned", 0, 0, G_OPTION_ARG_NONE, &planned, "Use the planned order", NULL},
    {"order", 0, 0, G_OPTION_ARG_STRING, &order_name, "Use the order of this session", "NAME"},
    {"quiet", 0, 0, G_OPTION_ARG_STRING, &quiet_name, "Compare with this session", "NAME"},
    {"parts", 0, 0, G_OPTION_ARG_STRING, &parts_list,
     "Use these parts of the shots; default 0.1;0.25;0.4;0.6", "X;…"},
    {NULL},
};

static Partial *open_all(const char *session) {
    g_autoptr(GError) error = NULL;
    Partial *partial = partial_open(session, &error);
    bench_check(error);
    g_autoptr(GArray) pairs = g_array_new(FALSE, FALSE, sizeof(int));
    g_autofree char *problem = NULL;
    partial_read(partial, partial_n_pairs(partial), pairs, &problem, &error);
    bench_check(error);
    if (problem)
        bench_fail(1, "%s", problem);
    return partial;
}

static Partial *open_beside(const char *session, const char *name) {
    g_autofree char *folder = g_path_get_dirname(session);
    g_autofree char *path = g_strdup_printf("%s/%s.session", folder, name);
    return open_all(path);
}

/* Lists the measured pairs by their numbers: a shot, or whatever decides the order. */
struct place {
    gint64 number;
    int pair;
};
static int by_number(const void *a, const void *b) {
    const struct place *p = a, *q = b;
    return p->number != q->number ? (p->number > q->number) - (p->number < q->number)
                                  : p->pair - q->pair;
}

/* Returns the pairs in the order in which they are taken: seed −1 is the order of shots. */
static int *list_pairs(const Partial *partial, const int *groups, int seed, int *ret_n) {
    const int n_pairs = partial_n_pairs(partial);
    g_autofree struct place *places = g_new(struct place, n_pairs);
    g_autoptr(GHashTable) drawn = g_hash_table_new(NULL, NULL);
    g_autoptr(GRand) random = g_rand_new_with_seed((guint32)seed);
    int n = 0;
    for (int pair = 0; pair < n_pairs; pair++) {
        if (!partial_picture(partial, pair))
            continue;
        gpointer key = GINT_TO_POINTER(groups[pair]);
        if (seed >= 0 && !g_hash_table_contains(drawn, key))
            g_hash_table_insert(drawn, key, GINT_TO_POINTER((int)(g_rand_int(random) >> 1)));
        places[n++] = (struct place){
            seed < 0 ? groups[pair] : GPOINTER_TO_INT(g_hash_table_lookup(drawn, key)), pair};
    }
    qsort(places, (gsize)n, sizeof *places, by_number);
    int *ret = g_new0(int, n + 1);
    for (int i = 0; i < n; i++)
        ret[i] = places[i].pair;
    *ret_n = n;
    return ret;
}

/* Returns Σ (picture − truth)² of a picture, or Σ truth² without a picture. */
static double squares(GBytes *picture, GBytes *truth) {
    gsize bytes;
    const guint32 *to = g_bytes_get_data(truth, &bytes);
    const guint32 *from = picture ? g_bytes_get_data(picture, NULL) : NULL;
    double sum = 0;
    for (gsize i = 0; i < bytes / sizeof *to; i++) {
        float a[3] = {0, 0, 0}, b[3];
        shared_exponent_unpack(to[i], b);
        if (from)
            shared_exponent_unpack(from[i], a);
        for (int c = 0; c < 3; c++)
            sum += pow((double)(a[c] - b[c]), 2);
    }
    return sum;
}

static void measure(Partial *partial, const Partial *quiet, const char *name, const char *order,
                    const int *pairs, int n, double part) {
    g_autoptr(GError) error = NULL;
    const int n_pairs = partial_n_pairs(partial);
    struct partial_sample *sample = partial_sample(partial, &error);
    bench_check(error);
    g_autofree gboolean *taken = g_new0(gboolean, n_pairs);
    sample->n_measured = (int)(part * n);
    for (int i = 0; i < sample->n_measured; i++)
        taken[pairs[i]] = TRUE;
    for (int row = 0; row < 3 * sample->n_probes; row++)
        for (int pair = 0; pair < n_pairs; pair++)
            if (!taken[pair])
                sample->values[(gsize)row * (gsize)n_pairs + (gsize)pair] = NAN;
    const double begun = bench_cpu_s();
    g_autoptr(PartialForecast) forecast = partial_forecast_new(sample, NULL, NULL, &error);
    bench_check(error);
    const double cpu_s = bench_cpu_s() - begun;
    double off = 0, energy = 0, pictures_s = 0;
    for (int pair = 0; pair < n_pairs; pair++) {
        GBytes *truth = partial_picture(quiet, pair);
        if (!truth)
            continue;
        energy += squares(NULL, truth);
        if (taken[pair])
            continue;
        const double before = bench_cpu_s();
        g_autoptr(GBytes) picture = partial_forecast_picture(forecast, partial, pair);
        pictures_s += bench_cpu_s() - before;
        off += squares(picture, truth);
    }
    const double is = sqrt(off / energy), expected = partial_forecast_error(forecast);
    double range[2];
    partial_forecast_error_range(forecast, range);
    bench_row(NULL,
              "%-10s{material} %-8s{order} %5.2f{part} %8.4f{expected} %8.4f{true} %6.3f{ratio} "
              "%8.4f{low} %8.4f{high} %d{within} %6.2f{cpu_s} %6.2f{picture_ms}",
              name, order, part, expected, is, expected / is, range[0], range[1],
              is >= range[0] && is <= range[1], cpu_s,
              1000 * pictures_s / MAX(n - sample->n_measured, 1));
    fflush(stdout);
    partial_sample_free(sample);
}

static void measure_parts(Partial *partial, const Partial *quiet, const char *name,
                          const char *order, const int *pairs, int n) {
    g_auto(GStrv) parts = g_strsplit(parts_list, ";", -1);
    for (int i = 0; parts[i]; i++)
        measure(partial, quiet, name, order, pairs, n, g_ascii_strtod(parts[i], NULL));
}

static void measure_session(const char *session) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Partial) partial = open_all(session);
    g_autoptr(Partial) quiet = quiet_name ? open_beside(session, quiet_name) : NULL;
    g_autofree char *folder = g_path_get_dirname(session), *name = g_path_get_basename(folder);
    struct partial_sample *sample = partial_sample(partial, &error);
    bench_check(error);
    int n;
    for (int seed = 0; seed < seeds; seed++) {
        g_autofree int *pairs = list_pairs(partial, sample->pairs->groups, seed, &n);
        measure_parts(partial, quiet ? quiet : partial, name, "random", pairs, n);
    }
    if (planned) {
        g_autofree int *pairs = list_pairs(partial, sample->pairs->groups, -1, &n);
        measure_parts(partial, quiet ? quiet : partial, name, "planned", pairs, n);
    }
    if (order_name) {
        g_autoptr(Partial) other = open_beside(session, order_name);
        struct partial_sample *of = partial_sample(other, &error);
        bench_check(error);
        g_autofree int *pairs = list_pairs(other, of->pairs->groups, -1, &n);
        measure_parts(partial, quiet ? quiet : partial, name, order_name, pairs, n);
        partial_sample_free(of);
    }
    partial_sample_free(sample);
}

int main(int argc, char **argv) {
    bench_parse(&argc, &argv, entries, "SESSION…");
    bench_begin_list(NULL);
    for (int i = 1; i < argc; i++)
        measure_session(argv[i]);
    bench_end();
}
