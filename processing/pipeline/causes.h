/* Why a session's products hold little. */
#pragma once

#include "pipeline.h"

/* Appends sentences (g_free()) with what is missing, a number, and the key to change: no texel, or
 * few, seen by a laser; views that are dark or saturated; a camera's response that nobody gave.
 * Reads the headers of the products, a light of each view, and some frames. calibration: the text
 * that the session was processed with; NULL: its own. */
gboolean pipeline_causes(const char *directory, const char *calibration,
                         const struct pipeline_result *result, GPtrArray *ret, GError **error);
