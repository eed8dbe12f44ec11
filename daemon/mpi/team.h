/* The ranks of an MPI program as a team that compresses together. One thread. */
#pragma once

#include "base/team.h"

/* Of MPI_COMM_WORLD, once MPI is initialised. An error of MPI ends all ranks. */
struct team mpi_team(void);
