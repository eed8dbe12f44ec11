/*
 * Evaluates the marks on the turntable during a capture: each lamp's output, which the session
 * stores, and whether a camera or the turntable has moved since the calibration. Main loop's
 * thread.
 */
#pragma once

#include "capture_private.h"
#include "fiducials/fiducials.h"

/* Of a shot whose cameras are all back. Keeps the lamp's output. Returns NULL, or what has moved in
 * this shot and the one before, g_free(): then the shot must not be committed. */
char *capture_marks_check(Capture *capture, const struct flight *flight);

/* Forgets the marks of earlier shots. */
void capture_marks_forget(Capture *capture);

/* The user continues although something has moved: do not report that again. */
void capture_marks_accept(Capture *capture);
