#include "team.h"

void team_part(const struct team *team, int rank, int n, int step, int *ret_first, int *ret_end) {
    const int ranks = team ? team->n_ranks : 1, blocks = (n + step - 1) / step;
    *ret_first = MIN(n, (int)((gint64)blocks * rank / ranks) * step);
    *ret_end = MIN(n, (int)((gint64)blocks * (rank + 1) / ranks) * step);
}
