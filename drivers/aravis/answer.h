/* Converts a buffer that a camera has sent to a Frame: finds the number of the frame, the time of
 * its exposure, and its pixels. */
#pragma once

#include "device.h"

struct answer_state {
    const struct aravis_limits *limits;
    struct aravis_clock clock;
    gint64 asked_us; /* time when the camera's clock was last read */
    gint64 exposure_us;
    guint64 shot;   /* Frame.shot of the next frame */
    gint64 sent_us; /* time when the trigger that waits for its frame was sent */
    /* `base` is added to the camera's ids. `last_raw` is the last id as the camera sent it. */
    guint64 base, last_raw;
    gboolean stamp_is_end; /* the camera's time stamps are those of the end of the exposure */
};

/* Forgets the ids of earlier frames. Call it when the camera is armed, because ids may restart.
 */
void answer_begin(struct answer_state *state);

/* Returns the frame. If data was lost, all pixels are 0 and `incomplete` is TRUE.
 *
 * Returns NULL without an error if the frame is too old. With a camera that has a clock, this means
 * that the exposure began before the trigger by more than the uncertainty of the clocks. With a
 * camera without a clock, it means that the frame began to arrive before the trigger.
 * *ret_before_us is then the time from that beginning to the trigger.
 *
 * Returns NULL with an error if the frame has another size or format than the camera was set to, if
 * it has too few bytes, or if a value has more than limits->bits bits. */
Frame *answer_frame(struct answer_state *state, ArvBuffer *buffer, gint64 *ret_before_us,
                    GError **error);
