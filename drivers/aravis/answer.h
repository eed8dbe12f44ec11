/* Converts a buffer that a camera has sent to a Frame: which frame it is, when it was exposed,
 * and its pixels. */
#pragma once

#include "device.h"

struct answer_state {
    const struct aravis_limits *limits;
    struct aravis_clock clock;
    gint64 asked_us; /* when the clock was last read */
    gint64 exposure_us;
    guint64 shot;
    gint64 sent_us; /* when the trigger that waits for its frame was sent */
    guint64 base, last_raw;
    gboolean stamp_is_end;
};

void answer_begin(struct answer_state *state); /* the camera is armed: ids may restart */

/* NULL without an error: the frame was exposed ret_before_us before the trigger, so it is not the
 * answer. NULL with an error: its size or format is not the one that was set up, or a value has
 * more bits. */
Frame *answer_frame(struct answer_state *state, ArvBuffer *buffer, gint64 *ret_before_us,
                    GError **error);
