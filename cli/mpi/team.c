#include "team.h"

#include <mpi.h>
#include <string.h>

/* maximum number of elements per call, because MPI counts elements in an int */
#define PIECE ((gsize)1 << 26)

static void team_sum(void *values, gsize n, gsize size, MPI_Datatype type) {
    for (gsize i = 0; i < n; i += PIECE)
        MPI_Allreduce(MPI_IN_PLACE, (guint8 *)values + i * size, (int)MIN(PIECE, n - i), type,
                      MPI_SUM, MPI_COMM_WORLD);
}

static void sum_floats(const struct team *team, float *values, gsize n) {
    team_sum(values, n, sizeof *values, MPI_FLOAT);
}

static void sum_doubles(const struct team *team, double *values, gsize n) {
    team_sum(values, n, sizeof *values, MPI_DOUBLE);
}

static void team_share(const struct team *team, void *all, const gsize *starts) {
    for (int rank = 0; rank < team->n_ranks; rank++)
        for (gsize i = starts[rank]; i < starts[rank + 1]; i += PIECE)
            MPI_Bcast((guint8 *)all + i, (int)MIN(PIECE, starts[rank + 1] - i), MPI_BYTE, rank,
                      MPI_COMM_WORLD);
}

static void deal(const struct team *team, int root, const float *all, const gsize *starts,
                 float *ret_mine) {
    for (int rank = 0; rank < team->n_ranks; rank++)
        for (gsize i = starts[rank]; i < starts[rank + 1]; i += PIECE) {
            const int n = (int)MIN(PIECE, starts[rank + 1] - i);
            float *to = ret_mine + (i - starts[rank]);
            if (team->rank == root && rank == root)
                memcpy(to, all + i, sizeof(float) * (gsize)n);
            else if (team->rank == root)
                MPI_Send(all + i, n, MPI_FLOAT, rank, 0, MPI_COMM_WORLD);
            else if (team->rank == rank)
                MPI_Recv(to, n, MPI_FLOAT, root, 0, MPI_COMM_WORLD, MPI_STATUS_IGNORE);
        }
}

struct team mpi_team(void) {
    struct team team = {
        .sum_floats = sum_floats, .sum_doubles = sum_doubles, .share = team_share, .deal = deal};
    MPI_Comm_rank(MPI_COMM_WORLD, &team.rank);
    MPI_Comm_size(MPI_COMM_WORLD, &team.n_ranks);
    return team;
}
