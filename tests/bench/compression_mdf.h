/* bench_compression --mdf. */
#pragma once

#include <glib.h>

/* Of sessions (NULL-ended). Returns an exit status. */
int bench_mdf_compression(char **sessions, gboolean json);
