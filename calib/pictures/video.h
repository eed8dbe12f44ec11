/*
 * Frames of a video that are worth looking at (OpenCV's videoio, with FFmpeg). Any thread.
 *
 * A video is divided into windows of equal length, and the sharpest frame of each window is kept:
 * the one with the largest mean squared gradient, divided by the variance of the picture. A camera
 * or board that moves while the shutter is open blurs the frames; between two movements some are
 * sharp. FFmpeg runs in a program of its own (picture_child.h).
 */
#pragma once

#include "picture.h"
#include "picture_child.h"

G_BEGIN_DECLS

struct video_frame {
    int index; /* in the video, from 0 */
    double sharpness;
    guint8 *grey; /* height × width, sRGB */
};

typedef struct video {
    int width, height;
    int n_frames;   /* number of frames that were read */
    GArray *frames; /* of struct video_frame, in order */
} Video;

/* Called after each frame; n: the number that the file states, possibly wrong. FALSE ends the
 * reading. */
typedef gboolean (*VideoProgress)(int done, int n, gpointer data, GError **error);

/* Reads a whole video (AVI, MP4 and QuickTime, Matroska, MPEG, Ogg, ASF, FLV, YUV4MPEG, by its
 * first bytes, and nothing that FFmpeg would look for elsewhere), and keeps most / 2 + 1 to most
 * frames, or all of a shorter one. NULL: PICTURE_FILE_ERROR, INPUT_FILE_ERROR, or the error of
 * progress (which may be NULL). Rotation that the file asks for is ignored: pixels stay as on the
 * sensor. */
struct video *video_read(const char *path, int most, VideoProgress progress, gpointer data,
                         GError **error);
/* Between video_read() and the program: its output begins with this; then each frame that is kept,
 * and its values. */
struct video_head {
    int width, height, n_frames;
    guint n_kept;
};

/* For the program that reads: video_child.cpp. */
gboolean video_child_read(const struct picture_job *job, GError **error);
void video_free(struct video *video); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Video, video_free)

/* A kept frame, linear in light. name, checksum: as in picture.h. */
struct picture *video_picture(const struct video *video, guint i, const char *name,
                              const char *checksum);

G_END_DECLS
