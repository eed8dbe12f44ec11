/* Long work of the command line's own process: progress, and Ctrl-C that cancels it. */
#pragma once

#include "base/work.h"

typedef gboolean (*CliWork)(const struct work *work, gpointer data, GError **error);

/* Runs func in the calling thread, and shows a bar or lines of JSON. ret_seconds (may be NULL): how
 * long func took. */
gboolean cli_work_run(CliWork func, gpointer data, double *ret_seconds, GError **error);
