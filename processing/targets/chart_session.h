/* Measures a colour chart in a session with a BTF: the reflectance of each patch. */
#pragma once

#include "radiometry/colour.h"
#include "session/session.h"

struct chart_field {              /* a disc within one patch */
    double x_mm, y_mm, radius_mm; /* in the sample frame */
    double xyz[3];
};

/* Parses lines "x_mm,y_mm,radius_mm,X,Y,Z", with Y = 1 for a perfect white. '#' begins a comment.
 * Semicolons or tabs may separate the numbers instead of commas; the numbers may then have decimal
 * commas. Returns an array of struct chart_field, or NULL with COLOUR_ERROR_FILE, whose message has
 * the path and the line. */
GArray *chart_parse(const char *text, const char *path, GError **error);

/* Measures all patches in the view nearest to the normal, under the lights nearest to 45°, which is
 * the geometry of charts (CIE 45°:0°). ret receives one element for each field.
 *
 * The error is COLOUR_ERROR_TOO_FEW if no view is within 20° of the normal, or if no light is
 * within 20° of 45°. The error is COLOUR_ERROR_FILE if a disc contains no texel. Other errors are
 * those of the functions that read the session, of session_check_products() and of
 * btf_read_view(). */
gboolean chart_session(Session *session, const GArray *fields, struct colour_patch *ret,
                       GError **error);
