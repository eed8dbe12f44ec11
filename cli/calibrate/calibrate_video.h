/*
 * Photographs of a board from a video: frames that are sharp, that show the board, and in which it
 * lies at places that are far from each other.
 *
 * A homography is fitted to the corners found; the place of a board is where it puts the four outer
 * corners. The frame with the most corners is chosen first, and then, one after the other, the
 * frame whose board is farthest from the boards of all chosen frames: the distance is the RMS over
 * the four corners. Boards nearer to each other than a share of the picture's width count as one
 * board that was held still, and of its frames the sharpest is taken.
 */
#pragma once

#include "base/work.h"
#include "cameras/board.h"
#include "pictures/video.h"

typedef struct calibrate_video {
    Video *video;
    char *path, *checksum;
    GArray *chosen; /* guint, of video->frames, in order */
    int n_seen;     /* frames of those kept that show the board */
} CalibrateVideo;

/* NULL: none of its frames shows the board, or it cannot be read. */
struct calibrate_video *calibrate_video_read(const char *path, const struct board *board,
                                             const struct work *work, GError **error);
void calibrate_video_free(struct calibrate_video *video); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(CalibrateVideo, calibrate_video_free)

/* "PATH#FRAME" of a chosen frame; g_free(). */
char *calibrate_video_name(const struct calibrate_video *video, guint i);
struct picture *calibrate_video_picture(const struct calibrate_video *video, guint i);
