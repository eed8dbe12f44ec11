/* Converts a buffer that a camera has sent to a Frame: finds the number of the frame, the time of
 * its exposure, and its pixels. */
#pragma once

#include "device.h"

struct answer_state {
    const struct aravis_limits *limits;
    struct aravis_clock clock;
    gint64 asked_us; /* time when the clock was last read */
    gint64 exposure_us;
    guint64 shot;
    gint64 sent_us; /* time when the trigger that waits for its frame was sent */
    guint64 base, last_raw;
    gboolean stamp_is_end;
};

/* Call it when the camera is armed, because ids may restart. */
void answer_begin(struct answer_state *state);

/* Returns the frame. Returns NULL without an error if the frame was exposed *ret_before_us before
 * the trigger, so that it is not the answer. Returns NULL with an error if the frame's size or
 * format is not the one that was set up, or if a value has more bits than the format. */
Frame *answer_frame(struct answer_state *state, ArvBuffer *buffer, gint64 *ret_before_us,
                    GError **error);
