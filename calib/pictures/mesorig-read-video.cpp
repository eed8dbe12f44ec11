/* mesorig-read-video runs OpenCV's videoio and FFmpeg for other programs; see picture_child.h. */
#include "video.h"

#include "base/input_file.h"

#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

#include <array>
#include <cstring>
#include <unistd.h>

/* limit of the memory for the frames that are kept; MIN_KEPT frames may exceed it */
#define MAX_BYTES (256 << 20)
#define MIN_KEPT  16u
#define CPU_S     3600 /* processor time for one video */

namespace {

/* Returns the mean squared gradient divided by the variance, both at half size, which has less
 * noise. */
double sharpness_of(const cv::Mat &grey) {
    cv::Mat half, dx, dy;
    cv::Scalar mean, deviation;
    cv::resize(grey, half, {}, 0.5, 0.5, cv::INTER_AREA);
    cv::Sobel(half, dx, CV_32F, 1, 0);
    cv::Sobel(half, dy, CV_32F, 0, 1);
    cv::meanStdDev(half, mean, deviation);
    const double n = (double)half.total(), variance = deviation[0] * deviation[0];
    return variance > 0 ? (dx.dot(dx) + dy.dot(dy)) / n / variance : 0;
}

/* Merges windows in pairs. Each pair keeps its sharper frame. */
void merge_windows(GArray *frames) {
    for (guint i = 0; i + 1 < frames->len; i++) {
        auto *a = &g_array_index(frames, struct video_frame, i);
        const auto *b = &g_array_index(frames, struct video_frame, i + 1);
        g_array_remove_index(frames, a->sharpness >= b->sharpness ? i + 1 : i);
    }
}

/* Keeps a frame if it opens a window, or is sharper than the frame that was kept of its window.
 * `every` is the length of a window in frames. */
void take(struct video *video, const cv::Mat &grey, int every) {
    const gsize n = grey.total();
    struct video_frame frame = {video->n_frames, sharpness_of(grey), nullptr};
    struct video_frame *last =
        video->frames->len
            ? &g_array_index(video->frames, struct video_frame, video->frames->len - 1)
            : nullptr;
    const bool opens = video->n_frames % every == 0;
    video->n_frames++;
    if (!opens && last && last->sharpness >= frame.sharpness)
        return;
    frame.grey = g_new(guint8, n);
    for (int y = 0; y < grey.rows; y++)
        std::memcpy(frame.grey + (gsize)y * (gsize)grey.cols, grey.ptr<guint8>(y),
                    (gsize)grey.cols);
    if (!opens && last) {
        g_free(last->grey);
        *last = frame;
    } else
        g_array_append_val(video->frames, frame);
}

bool read_all(cv::VideoCapture &from, struct video *video, guint most, VideoProgress progress,
              gpointer data, const char *path, GError **error) {
    const int n = (int)std::max(from.get(cv::CAP_PROP_FRAME_COUNT), 0.0);
    int every = 1;
    for (cv::Mat frame; from.read(frame);) {
        cv::Mat grey = frame;
        if (frame.channels() == 3)
            cv::cvtColor(frame, grey, cv::COLOR_BGR2GRAY);
        if (grey.type() != CV_8U || grey.empty())
            break;
        if (video->n_frames == 0) {
            video->width = grey.cols;
            video->height = grey.rows;
            most = std::min(most, std::max((guint)(MAX_BYTES / grey.total()), MIN_KEPT));
        }
        if (grey.cols != video->width || grey.rows != video->height) {
            g_set_error(error, PICTURE_FILE_ERROR, PICTURE_FILE_ERROR_IO,
                        "%s: frame %d has %d × %d pixels, but the first frame has %d × %d; convert "
                        "the video to one size",
                        path, video->n_frames, grey.cols, grey.rows, video->width, video->height);
            return false;
        }
        /* If a frame would open one window too many, windows are merged in pairs. The number of
         * windows is even then, so that all windows have the same length. */
        if (video->n_frames % every == 0 && video->frames->len >= most - most % 2) {
            merge_windows(video->frames);
            every *= 2;
        }
        take(video, grey, every);
        if (progress && !progress(video->n_frames, std::max(n, video->n_frames), data, error))
            return false;
    }
    if (video->frames->len == 0)
        g_set_error(error, PICTURE_FILE_ERROR, PICTURE_FILE_ERROR_IO,
                    "%s: no frame of the video can be read; copy the file again, or convert it",
                    path);
    return video->frames->len > 0;
}

#define HEAD_BYTES 200 /* a packet of MPEG-TS and the start of the next one */

/* Returns whether the first bytes of a file are those of a video. FFmpeg also reads other formats.
 * For instance, a playlist or a list of files would make it open everything that the list names,
 * even on the network. */
bool is_video(int fd) {
    static const struct {
        int at, n;
        const char *bytes;
    } starts[] = {{8, 4, "AVI "},   {4, 4, "ftyp"},
                  {4, 4, "moov"},   {4, 4, "mdat"},
                  {4, 4, "wide"},   {4, 4, "free"},
                  {4, 4, "skip"},   {0, 4, "\x1a\x45\xdf\xa3"},
                  {0, 4, "OggS"},   {0, 4, "\x30\x26\xb2\x75"},
                  {0, 3, "FLV"},    {0, 9, "YUV4MPEG2"},
                  {0, 3, "\0\0\1"}, {0, 4, "\0\0\0\1"}};
    std::array<char, HEAD_BYTES> head{};
    if (pread(fd, head.data(), head.size(), 0) <= 0)
        return false;
    for (const auto &start : starts)
        if (std::memcmp(head.data() + start.at, start.bytes, (gsize)start.n) == 0)
            return true;
    /* MPEG-TS: packets of 188 bytes, or of 192 with a time before each. */
    return (head[0] == 0x47 && head[188] == 0x47) || (head[4] == 0x47 && head[196] == 0x47);
}

/* Opens a video with FFmpeg or OpenCV's Motion JPEG reader. Other backends may interpret a path as
 * a URL or a pipeline. */
bool open_video(cv::VideoCapture &capture, const char *path) {
    for (int by : {cv::CAP_FFMPEG, cv::CAP_OPENCV_MJPEG})
        if (capture.open(path, by)) {
            capture.set(cv::CAP_PROP_ORIENTATION_AUTO, 0);
            return true;
        }
    return false;
}

gboolean tell(int done, int n, gpointer, GError **) {
    picture_child_tell(done, n);
    return TRUE;
}

gboolean read_video(const struct picture_job *job, GError **error) {
    /* The video is opened by its descriptor, because the path may lead to another file by now. */
    g_autofree char *name = g_strdup_printf("/proc/self/fd/%d", job->fd);
    struct video video = {};
    video.frames = g_array_new(FALSE, FALSE, sizeof(struct video_frame));
    try {
        cv::VideoCapture capture;
        if (!is_video(job->fd) || !open_video(capture, name)) {
            g_set_error(error, PICTURE_FILE_ERROR, PICTURE_FILE_ERROR_IO,
                        "%s is not a folder of pictures, and not a video that can be read; give "
                        "such a folder, or save the video as MP4 or AVI",
                        job->path);
            return FALSE;
        }
        if (!input_file_check_pixels(job->path, (guint64)capture.get(cv::CAP_PROP_FRAME_WIDTH),
                                     (guint64)capture.get(cv::CAP_PROP_FRAME_HEIGHT), job->length,
                                     error) ||
            !read_all(capture, &video, (guint)std::max(job->most, 2), tell, nullptr, job->path,
                      error))
            return FALSE;
    } catch (const std::exception &e) {
        g_set_error(error, PICTURE_FILE_ERROR, PICTURE_FILE_ERROR_FAILED,
                    "%s: the video cannot be read (%s); copy the file again, or convert it",
                    job->path, e.what());
        return FALSE;
    }
    const struct video_head head = {video.width, video.height, video.n_frames, video.frames->len};
    bool ok = picture_child_write(&head, sizeof head);
    for (guint i = 0; ok && i < head.n_kept; i++) {
        const auto *frame = &g_array_index(video.frames, struct video_frame, i);
        ok = picture_child_write(frame, sizeof *frame) &&
             picture_child_write(frame->grey, (gsize)head.width * (gsize)head.height);
    }
    return ok;
}

} // namespace

int main(int argc, char **argv) {
    picture_child_main(argc, argv, CPU_S, read_video);
}
