/* The latest picture of a camera, and its thumbnail. The thumbnail is made only when somebody looks
 * at it. The pictures belong to the Capture. All functions belong to the main loop's thread. */
#pragma once

#include "thumbnail.h"

struct latest_picture {
    Frame *frame; /* NULL before the first picture */
    double time_s;
    gboolean fresh; /* whether the thumbnail was made from frame */
    struct capture_thumbnail thumbnail;
};

/* Takes a reference of the frame. */
void latest_picture_set(struct latest_picture *latest, Frame *frame, double time_s);
void latest_picture_clear(struct latest_picture *latest);

/* Returns the thumbnail of the latest picture, or NULL before the first picture. Valid until the
 * next call of a function above. */
const struct capture_thumbnail *latest_picture_thumbnail(struct latest_picture *latest);
