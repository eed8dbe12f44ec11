/* The ranks of an MPI program as a team that compresses together. One thread. */
#pragma once

#include "processing/lpca_team.h"

/* Of MPI_COMM_WORLD, once MPI is initialised. An error of MPI ends all ranks. */
struct lpca_team mpi_team(void);
