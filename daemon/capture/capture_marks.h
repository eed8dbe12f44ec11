/*
 * What the marks on the turntable tell while a session is captured: each lamp's output, which is
 * kept with the session, and whether a camera or the turntable has moved since it was calibrated.
 * Main loop's thread.
 */
#pragma once

#include "capture_private.h"
#include "fiducials/marks.h"

/* Of a shot whose cameras are all back. Keeps the lamp's output. Returns NULL, or what has moved in
 * this shot and the one before, g_free(): then the shot must not be committed. */
char *capture_marks_check(Capture *capture, const struct flight *flight);

/* What was seen before is not looked at any more. */
void capture_marks_forget(Capture *capture);

/* The user goes on although something has moved: that is not told again. */
void capture_marks_accept(Capture *capture);
