/* A random choice of one of n items, with probabilities proportional to given weights. Any thread
 * may call the functions that take a const pointer, because they do not change the struct. */
#pragma once

#include <glib.h>

struct trace_choice {
    gsize n;
    double *sums; /* n + 1 cumulative weights, from 0 to 1 */
};

/* Initializes a choice. Returns FALSE if all weights are 0. Weights must be finite and not
 * negative. */
gboolean trace_choice_init(struct trace_choice *choice, const double *weights, gsize n);
void trace_choice_clear(struct trace_choice *choice);

/* Returns the item for a random number in [0, 1). */
gsize trace_choice_draw(const struct trace_choice *choice, double random);
/* Returns the probability of item k. */
double trace_choice_share(const struct trace_choice *choice, gsize k);
