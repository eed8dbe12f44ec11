/* Chooses one of n items, with a probability proportional to a weight. The struct is plain data.
 * Any thread may call the functions that take a const pointer. */
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
