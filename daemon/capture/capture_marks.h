/* Evaluates the marks on the turntable during a capture. The marks give the light output of each
 * lamp, which the session stores, and show whether a camera or the turntable has moved since the
 * calibration. The struct belongs to the Capture. Main loop's thread. */
#pragma once

#include "capture_session.h"
#include "radiometry/fiducials.h"

struct capture_marks {
    struct fiducials_moved moved;     /* movements for which the session was paused */
    struct fiducials_moved suspected; /* movements that the previous shot seemed to show */
    /* one GArray of struct fiducial_seen for each of the last WINDOW shots (capture_marks.c); NULL
     * if empty */
    GQueue *window;
    gboolean reported; /* whether the first check of the fiducials has been reported */
};

/* Checks the fiducials of a shot when all of its cameras have delivered, and records the lamp's
 * output. seen is an array of struct fiducial_seen of all cameras, or NULL. Returns NULL, or a text
 * (g_free()) that says what has moved in this shot and the previous one. If a text is returned, the
 * shot must not be committed. If the session cannot store the output, the function returns NULL and
 * sets error, and the shot must not be committed either. */
char *capture_marks_check(struct capture_marks *marks, const struct capture_session *session,
                          const struct session_shot *shot, GArray *seen, GError **error);

/* Forgets the marks that were seen in earlier shots, and the suspected movements. */
void capture_marks_forget(struct capture_marks *marks);

/* Call it when the user continues although something has moved: the movement is not reported
 * again. */
void capture_marks_accept(struct capture_marks *marks, const struct capture_session *session);
