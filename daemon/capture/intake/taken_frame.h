/* A frame on its way from the camera into the session. The sequencer fills the struct when it
 * accepts the frame. The capture sets the time in the member `row`, the intake adds the file, and
 * the session stores `row`. A part that keeps a copy of the struct takes a reference of the
 * frame. */
#pragma once

#include "drivers/frame.h"
#include "session/session.h"

struct taken_frame {
    const struct session_shot *shot;
    int sub; /* index of the frame among those of its camera in this shot */
    Frame *frame;
    /* The row of the database for the camera's part of the shot. These members are set when the
     * frame is accepted: shot, camera, turned, turntable_deg, and retakes, which is the number of
     * retakes of this camera in this shot so far. */
    struct session_frame row;
};
