/*
 * The format, frame rate and memory-mapped buffers of a node. The functions belong to the main
 * loop's thread.
 *
 * Errors are DEVICE_ERROR, and begin with the name of the camera.
 */
#pragma once

#include "node.h"

struct video_request {
    const char *format; /* four characters, or empty for the best format for measuring */
    int width, height;  /* 0 keeps the present size */
    double frame_rate;  /* 0 keeps the present rate */
};

struct video_setup {
    const struct video_format *format;
    int width, height;
    gsize stride, bytes; /* stride: bytes from row to row; bytes: bytes of a complete frame */
    gint64 interval_us;  /* time from frame to frame */
    gboolean full_range; /* luma is from 0 to 255 rather than 16 to 235 */
};

/* Sets exactly the requested format and size, and the requested frame rate within 5 %. If the
 * device does not offer the format or the size, the error lists the formats or sizes that it
 * offers. */
gboolean video_setup_apply(const struct video_node *node, const struct video_request *request,
                           struct video_setup *ret, GError **error);

/* Returns the data rate in 10⁶ bytes per second. */
double video_setup_mb_s(const struct video_setup *setup);

#define VIDEO_BUFFERS 4

struct video_stream {
    struct {
        guint8 *data;
        gsize size;
    } buffers[VIDEO_BUFFERS];
    int n; /* number of buffers that are mapped */
};

/* Allocates and queues the buffers, each of at least setup->bytes, and starts the stream. */
gboolean video_stream_start(struct video_stream *stream, const struct video_node *node,
                            const struct video_setup *setup, GError **error);
/* Stops the stream. A zeroed stream, which was never started, is allowed. */
void video_stream_stop(struct video_stream *stream, const struct video_node *node);

/* Takes a filled buffer. Returns 1 if there is one, 0 if there is none yet, and -1 with errno on
 * failure. After the caller has read the data, it calls video_stream_give_back(). For both types of
 * node, ret->bytesused is the length of the frame, and ret->m.offset is the start of the frame in
 * the buffer. */
int video_stream_take(const struct video_stream *stream, const struct video_node *node,
                      struct v4l2_buffer *ret);
void video_stream_give_back(const struct video_node *node, const struct v4l2_buffer *buffer);
