/* Normal deviates: mean 0, standard deviation 1. */
#pragma once

#include <glib.h>
#include <math.h>

/* Returns a nearly normal deviate: the sum of twelve uniform numbers, less 6. */
static inline double deviate_sum(GRand *rand) {
    double sum = -6;
    for (int i = 0; i < 12; i++)
        sum += g_rand_double(rand);
    return sum;
}

/* Returns a normal deviate by the method of Box and Muller. */
static inline double deviate_normal(GRand *rand) {
    const double u = 1 - g_rand_double(rand), v = g_rand_double(rand);
    return sqrt(-2 * log(u)) * cos(2 * G_PI * v);
}
