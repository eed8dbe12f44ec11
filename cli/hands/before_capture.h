/* What is done before a capture begins: exposures that are "auto" are chosen by pictures on trial
 * (auto_exposure.h), and test shots are taken before a long session (guard.h). */
#pragma once

#include "common/link.h"

struct before_capture {
    const char *rig_path;
    const char *session, *session_text; /* path; text NULL: that file is read */
    const char *calibration;            /* path; NULL: that which the rig file names */
    const char *calibration_text;       /* NULL: that file is read */
    gboolean yes;                       /* go on whatever test shots say */
    gboolean *ret_uncalibrated; /* NULL, or set to TRUE if a warning says that nothing is calibrated
                                 */
};

/* Does nothing while the rig is busy. ret_chosen: for Start's option chosen, g_free(), or NULL.
 * FALSE: the test shots, of which each warning is printed, predict that the capture would be
 * spoilt; or a device has failed, or a file is wrong. Mistakes of a session file without "auto" are
 * not reported: Start does that. */
gboolean before_capture(Link *link, const struct before_capture *what, char **ret_chosen,
                        GError **error);
