/* The ranks of an MPI program as a team (struct team) that compresses a BTF. Only one thread may
 * use the team. */
#pragma once

#include "base/team.h"

/* Returns the team of all ranks of MPI_COMM_WORLD. MPI must be initialised. An MPI error ends all
 * ranks. */
struct team mpi_team(void);
