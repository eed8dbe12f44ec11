/* One of n things, with a probability in proportion to a weight. Plain data; const calls by any
 * thread. */
#pragma once

#include <glib.h>

struct trace_choice {
    gsize n;
    double *sums; /* n + 1: cumulated, from 0 to 1 */
};

/* TRUE, unless all weights are 0; weights are finite and not negative. */
gboolean trace_choice_init(struct trace_choice *choice, const double *weights, gsize n);
void trace_choice_clear(struct trace_choice *choice);

/* The thing at random (in [0, 1)). */
gsize trace_choice_draw(const struct trace_choice *choice, double random);
double trace_choice_share(const struct trace_choice *choice, gsize k);
