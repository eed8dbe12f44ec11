/* Measures a colour chart in a session with a BTF: the reflectance of each patch. */
#pragma once

#include "radiometry/colour.h"
#include "session/session.h"

struct chart_field {              /* a disc within one patch */
    double x_mm, y_mm, radius_mm; /* sample frame */
    double xyz[3];
};

/* Lines "x_mm,y_mm,radius_mm,X,Y,Z", Y = 1 for a perfect white; '#' begins a comment. Semicolons or
 * tabs may separate the numbers, which may have decimal commas then. Elements are struct
 * chart_field. NULL: COLOUR_ERROR_FILE, which names path and line. */
GArray *chart_parse(const char *text, const char *path, GError **error);

/* Measures in the view nearest to the normal under the lights nearest to 45°, the geometry of
 * charts (CIE 45°:0°). ret: one per field. */
gboolean chart_session(Session *session, const GArray *fields, struct colour_patch *ret,
                       GError **error);
