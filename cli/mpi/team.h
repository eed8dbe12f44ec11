/* The ranks of an MPI program as a team that compresses together. One thread. */
#pragma once

#include "base/team.h"

/* The team of all ranks of MPI_COMM_WORLD; MPI must be initialised. An MPI error ends all ranks. */
struct team mpi_team(void);
