/* Evaluates the marks on the turntable during a capture. They give the output of each lamp, which
 * the session stores, and show whether a camera or the turntable has moved since the calibration.
 * Main loop's thread. */
#pragma once

#include "capture_private.h"
#include "radiometry/fiducials.h"

/* Checks the fiducials of a shot when all of its cameras have delivered, and records the lamp's
 * output. Returns NULL, or a text (g_free()) that says what has moved in this shot and the previous
 * one. If a text is returned, the shot must not be committed. If the session cannot store the
 * output, the function returns NULL and sets error, and the shot must not be committed either. */
char *capture_marks_check(Capture *capture, const struct flight *flight, GError **error);

/* Forgets the marks of earlier shots. */
void capture_marks_forget(Capture *capture);

/* The user continues although something has moved: the movement is not reported again. */
void capture_marks_accept(Capture *capture);
