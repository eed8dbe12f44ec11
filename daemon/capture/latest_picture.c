#include "latest_picture.h"

void latest_picture_set(struct latest_picture *latest, Frame *frame, double time_s) {
    frame_unref(latest->frame);
    latest->frame = frame_ref(frame);
    latest->time_s = time_s;
    latest->fresh = FALSE;
}

void latest_picture_clear(struct latest_picture *latest) {
    frame_unref(latest->frame);
    g_free(latest->thumbnail.rgb);
    *latest = (struct latest_picture){0};
}

const struct capture_thumbnail *latest_picture_thumbnail(struct latest_picture *latest) {
    struct capture_thumbnail *thumbnail = &latest->thumbnail;
    if (!latest->frame)
        return NULL;
    if (!latest->fresh) {
        g_free(thumbnail->rgb);
        thumbnail_make(latest->frame, &thumbnail->width, &thumbnail->height, &thumbnail->rgb);
        thumbnail->time_s = latest->time_s;
        latest->fresh = TRUE;
    }
    return thumbnail;
}
