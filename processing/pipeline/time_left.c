#include "time_left.h"

#include <glib.h>

double time_left_s(const struct time_left *now) {
    double sum_s = 0;
    int all = 0;
    for (int stage = 0; stage < TIME_LEFT_STAGES; stage++) {
        if (now->left[stage] > 0 && now->made[stage] == 0)
            return -1;
        if (now->left[stage] > 0)
            sum_s += now->task_s[stage] / now->made[stage] * now->left[stage];
        all += now->left[stage];
    }
    /* Of the last views, that no others follow, the slowest has k/(k + 1) of its time left. */
    return sum_s / MIN(all + 1, now->n_threads) + now->after_s;
}

int time_left_view(int k, int n) {
    int step = MAX((int)(n * 0.618), 1); /* near the golden section: the k-th lies in a gap */
    for (;; step++) {
        int a = step, b = n;
        while (b > 0) {
            const int rest = a % b;
            a = b;
            b = rest;
        }
        if (a == 1) /* no divisor in common */
            return (int)((gint64)k * step % n);
    }
}
