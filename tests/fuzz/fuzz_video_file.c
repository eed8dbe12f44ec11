/* Videos, which FFmpeg and OpenCV read. What FFmpeg prints of damaged ones is left out. */
#include "fuzz.h"

#include "pictures/video.h"
#include "pictures/vision.h"

#define MAX_KEPT   4
#define MAX_FRAMES 40

static gboolean fuzz_go_on(int done, int n, gpointer data, GError **error) {
    g_assert_cmpint(done, <=, n);
    if (done <= MAX_FRAMES)
        return TRUE;
    g_set_error(error, PICTURE_FILE_ERROR, PICTURE_FILE_ERROR_FAILED, "too long to fuzz");
    return FALSE;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    GError *error = NULL;
    g_setenv("OPENCV_FFMPEG_LOGLEVEL", "-8", FALSE); /* read when the first video is opened */
    g_autoptr(Video) video = video_read(fuzz_file(data, size), MAX_KEPT, fuzz_go_on, NULL, &error);
    fuzz_check(video != NULL, &error);
    if (!video)
        return 0;
    g_assert_cmpint(video->width, >, 0);
    g_assert_cmpint(video->height, >, 0);
    g_assert_cmpuint(video->frames->len, >, 0);
    g_assert_cmpuint(video->frames->len, <=, MAX_KEPT);
    for (guint i = 0; i < video->frames->len; i++) {
        g_autoptr(Picture) picture = video_picture(video, i, "fuzz", "");
        g_assert_cmpint(picture->width, ==, video->width);
        g_assert_cmpint(picture->height, ==, video->height);
    }
    return 0;
}
