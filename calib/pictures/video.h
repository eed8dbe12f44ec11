/*
 * This module reads the sharpest frames of a video (OpenCV's videoio, with FFmpeg). Any thread may
 * call the functions.
 *
 * A video is divided into windows of equal length, and the sharpest frame of each window is kept.
 * Sharpness is the mean squared gradient divided by the variance of the picture. A camera or board
 * that moves while the shutter is open blurs the frames, but between two movements some frames are
 * sharp. FFmpeg runs in a separate program (picture_child.h).
 */
#pragma once

#include "picture.h"
#include "picture_child.h"

G_BEGIN_DECLS

struct video_frame {
    int index; /* number of the frame in the video, from 0 */
    /* mean squared gradient divided by the variance */
    double sharpness;
    guint8 *grey; /* height × width, sRGB */
};

typedef struct video {
    int width, height;
    int n_frames;   /* number of frames that were read */
    GArray *frames; /* of struct video_frame, in order */
} Video;

/* Called after each frame. `done` is the number of frames that were read. n is the number of frames
 * that the file states, or `done` if that is larger. The stated number may be wrong. Returns FALSE
 * with an error to end the reading. */
typedef gboolean (*VideoProgress)(int done, int n, gpointer data, GError **error);

/* Reads a whole video (AVI, MP4 and QuickTime, Matroska, MPEG, Ogg, ASF, FLV, YUV4MPEG). Its first
 * bytes must show one of these formats, so that FFmpeg does not open other files. A rotation in the
 * file is ignored: pixels stay as on the sensor.
 *
 * At least most / 2 + 1 and at most `most` frames are kept. There are two exceptions: of a shorter
 * video, all frames are kept; and fewer frames are kept if they would need too much memory. A
 * `most` below 2 counts as 2.
 *
 * progress may be NULL. On failure returns NULL with one of these errors:
 * - an error of input_file_open() or picture_child_run();
 * - PICTURE_FILE_ERROR_IO if the result of the program is incomplete;
 * - the error of progress. */
struct video *video_read(const char *path, int most, VideoProgress progress, gpointer data,
                         GError **error);
/* A video_head is the first part of what the separate program writes for video_read(). For each
 * frame that is kept, a struct video_frame and the values of its picture follow. */
struct video_head {
    int width, height, n_frames;
    guint n_kept;
};

void video_free(struct video *video); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Video, video_free)

/* Returns kept frame i, 0 … frames->len − 1, as a picture that is linear in light. Free it with
 * picture_free(). name and checksum are as in picture.h. */
struct picture *video_picture(const struct video *video, guint i, const char *name,
                              const char *checksum);

G_END_DECLS
