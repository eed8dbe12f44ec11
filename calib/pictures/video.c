/* A separate program reads the video. This file starts that program and takes the program's
 * result. */
#include "video.h"

#include "base/input_file.h"

#include <unistd.h>

static void clear_frame(gpointer data) {
    g_free(((struct video_frame *)data)->grey);
}

/* Reads the frames that mesorig-read-video has written. Returns FALSE if the result is
 * incomplete. */
static gboolean take_frames(GBytes *from, struct video *video) {
    struct video_head head = {0};
    gsize at = 0;
    if (!picture_child_take(from, &at, &head, sizeof head) || head.width <= 0 || head.height <= 0)
        return FALSE;
    video->width = head.width;
    video->height = head.height;
    video->n_frames = head.n_frames;
    for (guint i = 0; i < head.n_kept; i++) {
        const gsize n = (gsize)head.width * (gsize)head.height;
        struct video_frame frame = {0};
        if (!picture_child_take(from, &at, &frame, sizeof frame) || n > g_bytes_get_size(from) - at)
            return FALSE;
        frame.grey = g_new(guint8, n);
        g_array_append_val(video->frames, frame);
        if (!picture_child_take(from, &at, frame.grey, n))
            return FALSE;
    }
    return TRUE;
}

struct video *video_read(const char *path, int most, VideoProgress progress, gpointer data,
                         GError **error) {
    struct picture_job job = {.path = path, .program = "mesorig-read-video", .most = most};
    job.fd = input_file_open(path, G_MAXINT64, &job.length, error);
    if (job.fd < 0)
        return NULL;
    g_autoptr(GBytes) result = picture_child_run(&job, "FFmpeg", progress, data, error);
    close(job.fd);
    if (!result)
        return NULL;
    struct video *video = g_new0(struct video, 1);
    video->frames = g_array_new(FALSE, FALSE, sizeof(struct video_frame));
    g_array_set_clear_func(video->frames, clear_frame);
    if (take_frames(result, video))
        return video;
    g_set_error(error, PICTURE_FILE_ERROR, PICTURE_FILE_ERROR_IO,
                "%s: FFmpeg returned incomplete frames; copy the file again, or convert it to "
                "another format",
                path);
    video_free(video);
    return NULL;
}

void video_free(struct video *video) {
    if (!video)
        return;
    g_array_unref(video->frames);
    g_free(video);
}

struct picture *video_picture(const struct video *video, guint i, const char *name,
                              const char *checksum) {
    const struct video_frame *frame = &g_array_index(video->frames, struct video_frame, i);
    float light[256];
    struct picture *picture = picture_new(name, checksum, video->width, video->height);
    picture_srgb(light);
    for (gsize k = 0; k < (gsize)video->width * (gsize)video->height; k++)
        picture->values[k] = light[frame->grey[k]];
    return picture;
}
