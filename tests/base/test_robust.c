#include "base/robust.h"
#include "lib/test.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define MOST 600

/* Values with many ties if range is small. */
static void fill(GRand *rand, double *values, int n, int range) {
    for (int i = 0; i < n; i++)
        values[i] = g_rand_int_range(rand, -range, range + 1) / 8.0;
}

/* Every index of every array of a random length is selected as if the array had been sorted. */
TEST(select) {
    double values[MOST], sorted[MOST];
    GRand *rand = g_rand_new_with_seed(1);
    for (int round = 0; round < 4000; round++) {
        const int n = g_rand_int_range(rand, 1, round % 10 == 0 ? MOST : 40);
        const int k = g_rand_int_range(rand, 0, n);
        fill(rand, values, n, round % 3 == 0 ? 3 : 100000);
        memcpy(sorted, values, sizeof *values * (gsize)n);
        qsort(sorted, (gsize)n, sizeof *sorted, robust_by_value);
        g_assert_cmpfloat(robust_select(values, n, k), ==, sorted[k]);
        g_assert_cmpfloat(values[k], ==, sorted[k]);
        for (int i = 0; i < n; i++)
            g_assert_true(i < k ? values[i] <= values[k] : values[i] >= values[k]);
        qsort(values, (gsize)n, sizeof *values, robust_by_value);
        g_assert_cmpmem(values, sizeof *values * (gsize)n, sorted, sizeof *values * (gsize)n);
    }
    g_rand_free(rand);
}

TEST(median) {
    double values[MOST], sorted[MOST];
    GRand *rand = g_rand_new_with_seed(2);
    for (int round = 0; round < 2000; round++) {
        const int n = g_rand_int_range(rand, 1, MOST);
        fill(rand, values, n, round % 2 ? 5 : 100000);
        memcpy(sorted, values, sizeof *values * (gsize)n);
        qsort(sorted, (gsize)n, sizeof *sorted, robust_by_value);
        g_assert_cmpfloat(robust_median(values, n), ==,
                          0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]));
    }
    g_rand_free(rand);
}

/* Arrays in order, in reverse order, with one value only, and with values that are not numbers end,
 * and lose no value. */
TEST(orders) {
    double values[MOST];
    for (int i = 0; i < MOST; i++)
        values[i] = i;
    g_assert_cmpfloat(robust_median(values, MOST), ==, (MOST - 1) / 2.0);
    for (int i = 0; i < MOST; i++)
        values[i] = -i;
    g_assert_cmpfloat(robust_median(values, MOST), ==, -(MOST - 1) / 2.0);
    for (int i = 0; i < MOST; i++)
        values[i] = 7;
    g_assert_cmpfloat(robust_median(values, MOST), ==, 7);
    int nan = 0;
    for (int i = 0; i < MOST; i++)
        values[i] = i % 3 ? NAN : i;
    robust_median(values, MOST);
    for (int i = 0; i < MOST; i++)
        nan += isnan(values[i]) != 0;
    g_assert_cmpint(nan, ==, MOST - MOST / 3);
}

/* 4.685 · scale is where the weight ends. */
TEST(biweight) {
    g_assert_cmpfloat(robust_biweight(0, 2), ==, 1);
    g_assert_cmpfloat(robust_biweight(4.685 * 2, 2), ==, 0);
    g_assert_cmpfloat(robust_biweight(-20, 2), ==, 0);
    g_assert_cmpfloat_with_epsilon(robust_biweight(4.685, 2), 0.5625, 1e-12);
}
