/*
 * Evaluates the marks on the turntable during a capture: each lamp's output, which the session
 * stores, and whether a camera or the turntable has moved since the calibration. Main loop's
 * thread.
 */
#pragma once

#include "capture_private.h"
#include "fiducials/fiducials.h"

/* Checks the fiducials of a shot once all of its cameras have delivered, and records the lamp's
 * output. Returns NULL, or a text (g_free()) that says what has moved in this shot and the one
 * before: then the shot must not be committed. Nor must it be if the session cannot store the
 * output: then NULL is returned, and error is set. */
char *capture_marks_check(Capture *capture, const struct flight *flight, GError **error);

/* Forgets the marks of earlier shots. */
void capture_marks_forget(Capture *capture);

/* The user continues although something has moved: do not report that again. */
void capture_marks_accept(Capture *capture);
