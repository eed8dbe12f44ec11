/* S-matrices, their inverse, and what noise does to pictures that are taken with them: against
 * their definition, and against a sensor whose electrons are drawn one exposure at a time. */
#include "multiplex/multiplex.h"

#include <math.h>

static const int orders[] = {3,  7,  11, 15, 19, 23, 31,  35,  43, 47,
                             59, 63, 67, 71, 79, 83, 103, 107, 127};

/* S Sᵀ = (n + 1)/4 · (I + J): its eigenvalues are ((n + 1)/2)², once, and (n + 1)/4. */
static void test_multiplex_matrix(void) {
    for (gsize i = 0; i < G_N_ELEMENTS(orders); i++) {
        const int n = orders[i];
        g_assert_cmpint(multiplex_order(n), ==, n);
        for (int k = 0; k < n; k++) {
            g_assert_true(multiplex_lit(n, k, k));
            for (int l = 0; l < n; l++) {
                int common = 0;
                for (int j = 0; j < n; j++)
                    common += multiplex_lit(n, k, j) && multiplex_lit(n, l, j);
                g_assert_cmpint(common, ==, k == l ? (n + 1) / 2 : (n + 1) / 4);
            }
        }
    }
    g_assert_cmpint(multiplex_order(2), ==, 0);
    g_assert_cmpint(multiplex_order(14), ==, 11);
    g_assert_cmpint(multiplex_order(42), ==, 35);
    g_assert_cmpint(multiplex_order(1000), ==, 127);
}

/* Pictures of lamps, lit together, and taken apart again. More pixels than are solved at once. */
static void test_multiplex_solve(void) {
    enum { PIXELS = 4096 + 77 };
    g_autoptr(GRand) random = g_rand_new_with_seed(20);
    for (gsize i = 0; i < G_N_ELEMENTS(orders); i += 3) {
        const int n = orders[i];
        g_autofree float *truth = g_new(float, (gsize)n *PIXELS);
        g_autofree float *values = g_new0(float, (gsize)n *PIXELS);
        float *pictures[MULTIPLEX_MOST];
        for (int k = 0; k < n * PIXELS; k++)
            truth[k] = (float)g_rand_double_range(random, 0, 100);
        for (int k = 0; k < n; k++) {
            pictures[k] = values + (gsize)k * PIXELS;
            for (int p = 0; p < PIXELS; p++) {
                double sum = 0;
                for (int j = 0; j < n; j++)
                    sum += multiplex_lit(n, k, j) ? (double)truth[j * PIXELS + p] : 0;
                pictures[k][p] = (float)sum;
            }
        }
        multiplex_solve(n, pictures, PIXELS);
        for (int k = 0; k < n * PIXELS; k++)
            g_assert_cmpfloat(fabsf(values[k] - truth[k]), <, 1e-3F);
    }
}

/* A standard normal number. */
static double multiplex_normal(GRand *random) {
    const double u = 1 - g_rand_double(random);
    return sqrt(-2 * log(u)) * cos(2 * G_PI * g_rand_double(random));
}

/* Poisson, by counting exponential waiting times. */
static double multiplex_electrons(GRand *random, double mean) {
    double left = mean;
    int n = -1;
    for (; left > 0; n++)
        left += log(1 - g_rand_double(random));
    return MAX(n, 0);
}

/* The variance of lamps' pictures over many exposures of one pixel: light in electrons an exposure
 * of each lamp, and a read noise in electrons; exposed for a part of it. */
static double multiplex_measured(int n, double part, double light_e, double read_e, int times) {
    g_autoptr(GRand) random = g_rand_new_with_seed((guint32)n);
    g_autofree float *values = g_new(float, (gsize)n *(gsize)times);
    float *pictures[MULTIPLEX_MOST];
    double sum = 0;
    for (int k = 0; k < n; k++) {
        pictures[k] = values + (gsize)k * (gsize)times;
        double lit_e = 0; /* lamps differ, and their mean is light_e */
        for (int j = 0; j < n; j++)
            if (multiplex_lit(n, k, j))
                lit_e += light_e * 2 * (j + 0.5) / n;
        for (int t = 0; t < times; t++)
            pictures[k][t] = (float)((multiplex_electrons(random, lit_e * part) +
                                      read_e * multiplex_normal(random)) /
                                     part);
    }
    multiplex_solve(n, pictures, (gsize)times);
    for (int k = 0; k < n; k++)
        for (int t = 0; t < times; t++)
            sum += pow((double)pictures[k][t] - light_e * 2 * (k + 0.5) / n, 2);
    return sum / n / times;
}

/* What the formula says, and whether the part that is chosen by it keeps the noise. */
static void test_multiplex_noise(void) {
    const struct {
        int n;
        double light_e, read_e;
    } cases[] = {{3, 0.5, 20}, {7, 4, 8}, {15, 2, 10}, {15, 60, 5}, {31, 1, 12}};
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        const int n = cases[i].n, times = 20000 / n;
        const double floor = pow(cases[i].read_e, 2), slope = cases[i].light_e;
        /* The relative error of a variance of N numbers is √(2/N). */
        const double bound = 5 * sqrt(2.0 / (n * times));
        const double whole = multiplex_measured(n, 1, cases[i].light_e, cases[i].read_e, times);
        g_assert_cmpfloat(fabs(whole / multiplex_part_variance(n, 1, floor, slope) - 1), <, bound);
        const double part = multiplex_part(n, floor, slope);
        const double same = multiplex_measured(n, part, cases[i].light_e, cases[i].read_e, times);
        g_assert_cmpfloat(fabs(same / (floor + slope) - 1), <, bound);
    }
}

/* Read noise alone: a part of 2√n/(n + 1). Photons alone: twice the time, for ever more lamps. */
static void test_multiplex_limits(void) {
    for (gsize i = 0; i < G_N_ELEMENTS(orders); i++) {
        const int n = orders[i];
        g_assert_cmpfloat(fabs(multiplex_part(n, 7, 0) - 2 * sqrt(n) / (n + 1)), <, 1e-12);
        g_assert_cmpfloat(fabs(multiplex_part(n, 0, 7) - 2.0 * n / (n + 1)), <, 1e-12);
        g_assert_cmpfloat(fabs(multiplex_variance(n) - 4.0 * n / ((n + 1.0) * (n + 1.0))), <,
                          1e-15);
    }
    g_assert_cmpfloat(multiplex_part(1, 3, 5), ==, 1);
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/multiplex/matrix", test_multiplex_matrix);
    g_test_add_func("/multiplex/solve", test_multiplex_solve);
    g_test_add_func("/multiplex/noise", test_multiplex_noise);
    g_test_add_func("/multiplex/limits", test_multiplex_limits);
    return g_test_run();
}
