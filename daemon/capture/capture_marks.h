/* Evaluates the marks on the turntable (fiducials) during a capture. The marks give the light
 * output of each lamp, which the session stores. They also show whether a camera or the turntable
 * has moved since the calibration. The struct belongs to the Capture. All functions belong to the
 * main loop's thread. */
#pragma once

#include "capture_session.h"
#include "radiometry/fiducials.h"

struct capture_marks {
    struct fiducials_moved moved;     /* movements for which the session was paused */
    struct fiducials_moved suspected; /* movements that the previous shot seemed to show */
    /* One GArray of struct fiducial_seen for each of the last WINDOW shots (capture_marks.c). NULL
     * if there are none. */
    GQueue *window;
    gboolean reported; /* whether the first check of the fiducials has been reported */
};

/* Checks the fiducials of a shot when the results of all its cameras have returned, and stores the
 * lamp's output. seen is an array of struct fiducial_seen of all cameras, or NULL.
 *
 * If this shot and the previous one show that something has moved, returns a text that says what,
 * to be freed with g_free(). If the session cannot store the output, returns NULL with an error. In
 * these two cases the shot must not be stored. Otherwise returns NULL without an error. */
char *capture_marks_check(struct capture_marks *marks, const struct capture_session *session,
                          const struct session_shot *shot, GArray *seen, GError **error);

/* Forgets the marks that were seen in earlier shots, and the suspected movements. */
void capture_marks_forget(struct capture_marks *marks);

/* Call this when the user continues although something has moved. The movement is then not reported
 * again. */
void capture_marks_accept(struct capture_marks *marks, const struct capture_session *session);
