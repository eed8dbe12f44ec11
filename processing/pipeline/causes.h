/* Why a session's products hold little. */
#pragma once

#include "pipeline.h"

/* Appends sentences (g_free()) about likely mistakes, each with a number and the key to change: no
 * texels, or few, that a laser saw; views that are dark or saturated; a camera whose response was
 * not given. Reads the headers of the products, a light of each view, and some frames. calibration:
 * the text that the session was processed with; NULL: its own. */
gboolean pipeline_causes(const char *directory, const char *calibration,
                         const struct pipeline_result *result, GPtrArray *ret, GError **error);
