/* The steps before a capture begins: exposures that are "auto" are chosen from trial pictures
 * (auto_exposure.h), and test shots are taken before a long session (guard.h). */
#pragma once

#include "common/link.h"

struct before_capture {
    const char *rig_path;
    /* Path and content of the session file. If session_text is NULL, the file is read. */
    const char *session, *session_text;
    const char *calibration;      /* path; NULL for the calibration that the rig file names */
    const char *calibration_text; /* content of that file; NULL if it is to be read */
    gboolean yes;                 /* continue even if the test shots give warnings */
    /* Set to TRUE if there are warnings and no part of the rig is calibrated. May be NULL. */
    gboolean *ret_uncalibrated;
};

/* Chooses exposures and takes test shots, and prints each warning. Does nothing while the rig is
 * busy, or if the rig file or the session file cannot be parsed. *ret_chosen is the value
 * of the option "chosen" of the method Start, or NULL; g_free(). Returns FALSE with an error if the
 * test shots give warnings and `yes` is FALSE, if no exposure is suitable, or if a device has
 * failed. Also returns FALSE if the calibration, or the plan of a session file with "auto", has a
 * mistake. Other mistakes are not reported here, because Start reports them. */
gboolean before_capture(Link *link, const struct before_capture *what, char **ret_chosen,
                        GError **error);
