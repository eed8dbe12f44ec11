#pragma once

#include "command/record.h"

/* Makes the products of a session with its own calibration, and shows progress. Returns an exit
 * code; error is set if it failed. */
int process_session(const char *directory, Record *to, GError **error);
