/* Estimate of the disk space of a session that is being captured: the plan's at first, then
 * corrected by the frames stored so far. Main loop's thread. */
#pragma once

#include "capture.h"
#include "session/session.h"

/* Counts the frames of earlier runs of the session (frames: of struct session_frame): the estimate
 * uses them, too. To be called once, before anything is captured. */
void capture_bytes_begin(Capture *capture, const GPtrArray *frames);

/* The frames of a shot were committed. Adds an event when the expected size of the whole session
 * differs by more than a twentieth from the one that was told last. */
void capture_bytes_add(Capture *capture, const struct session_shot *shot,
                       const struct session_frame *frames, int n);
