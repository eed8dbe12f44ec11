/* Finds likely reasons why a session's products contain few or implausible values. */
#pragma once

#include "session/session.h"

/* Appends sentences (g_free()) about likely mistakes. Most sentences state a measured number, and
 * the key of a configuration file to change. The sentences are about
 *   - the session's suspicions (session_suspicions())
 *   - lasers that see too small a share of the texels
 *   - views that are dark or saturated
 *   - cameras whose response was not given
 * Reads the headers of the products, one light of each view, and some frames and sweeps.
 *
 * calibration is the text of the calibration with which the session was processed, or NULL for the
 * session's own calibration. has_btf says whether there is a BTF. mdf_coverage is the share of
 * texels that a laser saw, over all views; it is 1 if there is no MDF.
 *
 * Fails if the session, its texts or its rows cannot be read. Files of frames and products that
 * cannot be read are left out. */
gboolean causes_find(const char *directory, const char *calibration, gboolean has_btf,
                     double mdf_coverage, GPtrArray *ret, GError **error);
