/* Estimate of the disk space of a session that is being captured. It begins with the plan's
 * estimate and is corrected by the frames stored so far. Main loop's thread. */
#pragma once

#include "capture.h"
#include "session/session.h"

/* Counts the frames of earlier runs of the session, which the estimate uses as well. frames
 * contains struct session_frame. To be called once, before anything is captured. */
void capture_bytes_begin(Capture *capture, const GPtrArray *frames);

/* Counts the frames of a shot that was committed. Adds an event when the expected size of the whole
 * session differs by more than a twentieth from the size in the last event. */
void capture_bytes_add(Capture *capture, const struct session_shot *shot,
                       const struct session_frame *frames, int n);
