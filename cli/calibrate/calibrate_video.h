/*
 * This module chooses frames of a video that are used as photographs of a board. The frames are
 * sharp and show the board at places that are far from each other.
 *
 * A homography is fitted to the corners that were found. It gives the positions of the board's four
 * outer corners, which are called the place of the board. The distance of two places is the RMS
 * over the four corners.
 *
 * The frame with the most corners is chosen first. Each further choice is the frame whose board is
 * farthest from the boards of all chosen frames. Places that are closer to each other than a
 * certain part of the picture's width count as one, because the board was then held still. Of the
 * frames at one place, the sharpest is taken.
 */
#pragma once

#include "base/work.h"
#include "cameras/board.h"
#include "pictures/video.h"

typedef struct calibrate_video {
    Video *video;
    char *path, *checksum;
    GArray *chosen; /* chosen frames: their indices in video->frames, ascending, as guint */
    int n_seen;     /* number of searched frames that show the board */
} CalibrateVideo;

/* Returns NULL with an error if no frame of the video shows the board, or if the video cannot be
 * read. */
struct calibrate_video *calibrate_video_read(const char *path, const struct board *board,
                                             const struct work *work, GError **error);
void calibrate_video_free(struct calibrate_video *video); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(CalibrateVideo, calibrate_video_free)

/* Returns the name "PATH#FRAME" of chosen frame i. Free it with g_free(). */
char *calibrate_video_name(const struct calibrate_video *video, guint i);
/* Returns chosen frame i as linear grey values, under the name of calibrate_video_name(). Free it
 * with picture_free(). */
struct picture *calibrate_video_picture(const struct calibrate_video *video, guint i);
