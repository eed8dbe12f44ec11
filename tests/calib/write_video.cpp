#include "write_video.h"

#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

void write_video(const char *path, const guint8 *frames, int n_frames, int width, int height) {
    cv::VideoWriter to(path, cv::CAP_OPENCV_MJPEG, cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), 25,
                       {width, height});
    g_assert_true(to.isOpened());
    to.set(cv::VIDEOWRITER_PROP_QUALITY, 95);
    for (int i = 0; i < n_frames; i++) {
        const cv::Mat grey(height, width, CV_8U,
                           (void *)(frames + (gsize)i * (gsize)width * (gsize)height));
        cv::Mat bgr;
        cv::cvtColor(grey, bgr, cv::COLOR_GRAY2BGR);
        to.write(bgr);
    }
}
