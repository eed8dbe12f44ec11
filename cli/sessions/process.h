#pragma once

#include "common/record.h"

/* Makes the products of a session with its own calibration, and shows progress. told is TRUE if the
 * calibration has already been printed. Returns an exit code. error is set if the products could
 * not be made. */
int process_session(const char *directory, gboolean told, Record *to, GError **error);
