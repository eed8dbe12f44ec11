#pragma once

#include "command/record.h"

/* Makes the products of a session, with progress. Returns an exit code; error is set if it failed.
 */
int process_run(const char *directory, gboolean follow, Record *to, GError **error);
