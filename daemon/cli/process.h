#pragma once

#include "command/record.h"

/* Makes the products of a session, with progress. calibration: the text of one to take in place of
 * the session's own, or NULL. Returns an exit code; error is set if it failed. */
int process_session(const char *directory, const char *calibration, gboolean follow, Record *to,
                    GError **error);
