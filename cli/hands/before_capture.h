/* The steps before a capture begins. Trial pictures choose the exposures that are "auto"
 * (auto_exposure.h). Before a long session, test shots are taken (guard.h). */
#pragma once

#include "common/link.h"

struct before_capture {
    const char *rig_path;
    /* Path and content of the session file. If session_text is NULL, the content is read from the
     * file. */
    const char *session, *session_text;
    const char *calibration; /* path; NULL for the calibration that the rig file names */
    /* content of the calibration file; NULL if it is to be read from the file */
    const char *calibration_text;
    gboolean yes; /* continue even if the test shots give warnings */
    /* Is set to TRUE if there are warnings and no part of the rig is calibrated. May be NULL. */
    gboolean *ret_uncalibrated;
};

/* Chooses exposures and takes test shots, and prints each warning. *ret_chosen is set to the value
 * of the option "chosen" of the method Start, or to NULL. Free it with g_free(). Does nothing and
 * returns TRUE while the rig is busy, or if the rig file or the session file cannot be parsed.
 *
 * Returns FALSE with an error if:
 * - the test shots give warnings and `yes` is FALSE,
 * - no exposure is suitable,
 * - a device has failed,
 * - the calibration has a mistake,
 * - the session file has "auto", and its plan has a mistake.
 *
 * Other mistakes are not reported here, because the method Start reports them. */
gboolean before_capture(Link *link, const struct before_capture *what, char **ret_chosen,
                        GError **error);
