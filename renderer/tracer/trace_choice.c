#include "trace_choice.h"

gboolean trace_choice_init(struct trace_choice *choice, const double *weights, gsize n) {
    double sum = 0.0;
    *choice = (struct trace_choice){n, g_new0(double, n + 1)};
    for (gsize k = 0; k < n; k++) {
        sum += weights[k];
        choice->sums[k + 1] = sum;
    }
    for (gsize k = 0; k < n && sum > 0.0; k++)
        choice->sums[k + 1] /= sum;
    return sum > 0.0;
}

void trace_choice_clear(struct trace_choice *choice) {
    g_clear_pointer(&choice->sums, g_free);
    choice->n = 0;
}

gsize trace_choice_draw(const struct trace_choice *choice, double random) {
    gsize low = 0, high = choice->n;
    while (high - low > 1) {
        const gsize middle = low + (high - low) / 2;
        if (choice->sums[middle] <= random)
            low = middle;
        else
            high = middle;
    }
    return low;
}

double trace_choice_share(const struct trace_choice *choice, gsize k) {
    return choice->sums[k + 1] - choice->sums[k];
}
