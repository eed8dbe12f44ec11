#pragma once

#include "common/record.h"

/* Makes the products of a session with the session's own calibration, shows progress, and adds the
 * result to the record. `told` is TRUE if the calibration has already been printed. It is then not
 * printed again, unless some products may have been made with another calibration. Returns
 * CLI_DONE. On failure, returns CLI_FAILED and sets error. An imported session cannot be
 * processed. */
int process_session(const char *directory, gboolean told, Record *to, GError **error);
