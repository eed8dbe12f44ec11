/* This file is a module that is loaded at run time; see picture_codecs.h. */
#include "picture_codecs.h"

#include <opencv2/imgcodecs.hpp>

#include <cstring>

namespace {

bool decode(const guint8 *bytes, gsize length, enum picture_channels channels,
            struct picture_pixels *ret) {
    const cv::Mat from(1, (int)length, CV_8U, const_cast<guint8 *>(bytes));
    const int colours = channels == PICTURE_GREY ? cv::IMREAD_GRAYSCALE : cv::IMREAD_ANYCOLOR;
    /* IMREAD_UNCHANGED cannot be combined with other flags. It also ignores the orientation. */
    const cv::Mat m =
        cv::imdecode(from, channels == PICTURE_ALPHA
                               ? cv::IMREAD_UNCHANGED
                               : colours | cv::IMREAD_ANYDEPTH | cv::IMREAD_IGNORE_ORIENTATION);
    if (m.empty() || (m.channels() != 1 && m.channels() != 3 && m.channels() != 4) ||
        (m.depth() != CV_8U && m.depth() != CV_16U && m.depth() != CV_32F))
        return false;
    const int bits = m.depth() == CV_8U ? 8 : m.depth() == CV_16U ? 16 : 0;
    *ret = {m.cols, m.rows, m.channels(), bits, g_malloc(m.total() * m.elemSize())};
    const gsize row = (gsize)m.cols * m.elemSize();
    for (int y = 0; y < m.rows; y++)
        std::memcpy((guint8 *)ret->values + (gsize)y * row, m.ptr(y), row);
    return true;
}

} // namespace

extern "C" PictureCodecsDecode picture_codecs_decode;

gboolean picture_codecs_decode(const guint8 *bytes, gsize length, enum picture_channels channels,
                               struct picture_pixels *ret, char **ret_what) {
    *ret_what = nullptr;
    /* OpenCV prints the errors that it throws. This handler prevents that, because the caller
     * reports the error. */
    cv::redirectError([](int, const char *, const char *, const char *, int, void *) { return 0; });
    try {
        return decode(bytes, length, channels, ret);
    } catch (const cv::Exception &e) {
        *ret_what = g_strdup_printf("OpenCV: %s", e.err.c_str());
    } catch (const std::exception &e) {
        *ret_what = g_strdup(e.what());
    }
    return FALSE;
}
