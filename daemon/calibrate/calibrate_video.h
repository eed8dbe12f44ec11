/*
 * Photographs of a board from a video: frames that are sharp, that show the board, and in which it
 * lies at places that are far from each other.
 *
 * Where a homography of the corners found puts the board's four outer corners is where it lies. The
 * frame with most corners is chosen first, then each time that whose board is farthest from all
 * chosen ones: the distance is the RMS over the four corners. Boards nearer to each other than a
 * share of the picture's width count as one that was held still, and of its frames the sharpest is
 * taken.
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
