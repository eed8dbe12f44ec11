/* Finds likely reasons why a session's products contain few or implausible values. */
#pragma once

#include "session/session.h"

/* Appends sentences (g_free()) about likely mistakes, each with a number and the key to change.
 * They cover the session's suspicions (session_suspicions()), texels that no laser saw or only few
 * did, views that are dark or saturated, and a camera whose response was not given. Reads the
 * headers of the products, one light of each view, and some frames. calibration is the text of the
 * calibration with which the session was processed, or NULL for the session's own. has_btf says
 * whether there is a BTF. mdf_coverage is the share of the texels of all views that were measured;
 * 1 if there is no MDF. Fails only if the session, its texts or its rows cannot be read; files of
 * frames and products that cannot be read are left out. */
gboolean causes_find(const char *directory, const char *calibration, gboolean has_btf,
                     double mdf_coverage, GPtrArray *ret, GError **error);
