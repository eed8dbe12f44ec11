/* Random numbers that depend only on a seed, a pixel and a sample, and not on the thread. */
#pragma once

#include <glib.h>

struct trace_random {
    guint64 state;
};

/* Returns 64 random bits by SplitMix64 (Steele, Lea & Flood 2014). */
static inline guint64 trace_random_bits(struct trace_random *random) {
    guint64 z = random->state += G_GUINT64_CONSTANT(0x9e3779b97f4a7c15);
    z = (z ^ (z >> 30)) * G_GUINT64_CONSTANT(0xbf58476d1ce4e5b9);
    z = (z ^ (z >> 27)) * G_GUINT64_CONSTANT(0x94d049bb133111eb);
    return z ^ (z >> 31);
}

static inline struct trace_random trace_random_new(guint64 seed, guint64 pixel, guint64 sample) {
    struct trace_random random = {seed};
    random.state = trace_random_bits(&random) ^ (pixel * G_GUINT64_CONSTANT(0xd1342543de82ef95));
    random.state = trace_random_bits(&random) ^ (sample * G_GUINT64_CONSTANT(0xaf251af3b0f025b5));
    return random;
}

/* Returns a random multiple of 2^−24 in [0, 1). It stays below 1 when it is converted to float. */
static inline double trace_random_next(struct trace_random *random) {
    return (double)(trace_random_bits(random) >> 40) * 0x1p-24;
}
