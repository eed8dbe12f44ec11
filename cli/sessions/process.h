#pragma once

#include "common/record.h"

/* Makes the products of a session with the session's own calibration, shows progress, and adds the
 * result to the record. An imported session cannot be processed. Returns CLI_DONE on success. On
 * failure, returns CLI_FAILED and sets error.
 *
 * `told` is TRUE if the calibration has already been printed. It is then printed again only if some
 * products may have been made with another calibration. */
int process_session(const char *directory, gboolean told, Record *to, GError **error);
