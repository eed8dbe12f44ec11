/* Several lamps at once against one at a time, by a sensor whose electrons are drawn one exposure
 * at a time: how large the noise is at equal time, and what time equal noise takes. */
#include "bench.h"
#include "multiplex/multiplex.h"

#include <math.h>

static double draw_normal(GRand *random) {
    const double u = 1 - g_rand_double(random);
    return sqrt(-2 * log(u)) * cos(2 * G_PI * g_rand_double(random));
}

/* Photons of many are as good as normal. */
static double draw_photons(GRand *random, double mean) {
    double left = mean;
    int n = -1;
    if (mean > 200)
        return rint(mean + sqrt(mean) * draw_normal(random));
    for (; left > 0; n++)
        left += log(1 - g_rand_double(random));
    return MAX(n, 0);
}

/* RMS error of lamps' pictures, in electrons of a whole exposure; all lamps are equal. */
static double measure_rms(GRand *random, int n, double part, double light_e, double read_e,
                          int times) {
    g_autofree float *values = g_new(float, (gsize)n *(gsize)times);
    float *pictures[MULTIPLEX_MOST];
    const int lit = (n + 1) / 2;
    double sum = 0;
    for (int k = 0; k < n; k++) {
        pictures[k] = values + (gsize)k * (gsize)times;
        for (int t = 0; t < times; t++)
            pictures[k][t] = (float)((draw_photons(random, lit * light_e * part) +
                                      read_e * draw_normal(random)) /
                                     part);
    }
    if (n > 1)
        multiplex_solve(n, pictures, (gsize)times);
    for (int i = 0; i < n * times; i++)
        sum += pow((double)values[i] - light_e, 2);
    return sqrt(sum / n / times);
}

int main(int argc, char **argv) {
    static const double reads_e[] = {2, 4, 40}, lights_e[] = {1, 4, 16, 100, 1000, 10000};
    static const int orders[] = {7, 15, 31, 63};
    gboolean json = FALSE;
    int values = 200000;
    const GOptionEntry entries[] = {
        {"json", 0, 0, G_OPTION_ARG_NONE, &json, "One JSON object", NULL},
        {"values", 0, 0, G_OPTION_ARG_INT, &values, "Values of each figure, default 200000", "N"},
        {NULL}};
    bench_parse(&argc, &argv, entries, NULL);
    if (values < 1000 || argc > 1)
        bench_fail(2, "bad arguments");
    g_autoptr(GRand) random = g_rand_new_with_seed(1);
    const char *before = "";
    g_print("%s",
            json ? "{\"multiplex\": ["
                 : "lamps read_e light_e  noise at equal time  time at equal noise  noise then\n");
    for (gsize r = 0; r < G_N_ELEMENTS(reads_e); r++)
        for (gsize l = 0; l < G_N_ELEMENTS(lights_e); l++) {
            const double alone = measure_rms(random, 1, 1, lights_e[l], reads_e[r], values);
            for (gsize k = 0; k < G_N_ELEMENTS(orders); k++) {
                const int n = orders[k];
                const double part = multiplex_part(n, reads_e[r] * reads_e[r], lights_e[l]);
                const double same =
                    measure_rms(random, n, 1, lights_e[l], reads_e[r], values / n) / alone;
                const double then =
                    measure_rms(random, n, part, lights_e[l], reads_e[r], values / n) / alone;
                if (json)
                    g_print("%s{\"lamps\": %d, \"read_e\": %g, \"light_e\": %g, "
                            "\"noise_at_equal_time\": %.3f, \"time_at_equal_noise\": %.3f, "
                            "\"noise_then\": %.3f}",
                            before, n, reads_e[r], lights_e[l], same, part, then);
                else
                    g_print("%5d %6g %7g %20.3f %20.3f %11.3f\n", n, reads_e[r], lights_e[l], same,
                            part, then);
                before = ", ";
            }
        }
    g_print("%s", json ? "]}\n" : "");
    return 0;
}
