/* How a local PCA by several processes gets faster with their number. */
#pragma once

#include <glib.h>

/* Runs mesorig-compress-mpi on a session with 1 and 2 processes of one thread, and prints real time
 * and processor time of each. 0 if it worked. */
int bench_ranks(const char *session, int clusters, int components, gboolean json);
