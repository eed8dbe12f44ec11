#include "vision.h"

#include <opencv2/aruco.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>

namespace {

/* number of random samples of a robust homography; OpenCV's default */
constexpr int MAX_SAMPLES = 2000;
constexpr int FEWEST_CIRCLES = 9; /* smallest number of circles of a grid that is searched */

/* OpenCV prints the errors that it throws; this is switched off, because the caller reports the
 * error. OpenCV must not start threads, because the callers work on several pictures at the same
 * time. */
const bool set_up = [] {
    cv::redirectError([](int, const char *, const char *, const char *, int, void *) { return 0; });
    cv::setNumThreads(0);
    return true;
}();

/* Runs work, and converts exceptions to errors. */
template <typename Work> bool guarded(GError **error, const char *what, Work work) {
    try {
        return work();
    } catch (const cv::Exception &e) {
        g_set_error(error, PICTURE_FILE_ERROR, PICTURE_FILE_ERROR_FAILED,
                    "%s: OpenCV has failed: %s; take other pictures", what, e.err.c_str());
    } catch (const std::exception &e) {
        g_set_error(error, PICTURE_FILE_ERROR, PICTURE_FILE_ERROR_FAILED, "%s: %s", what, e.what());
    }
    return false;
}

/* The order is that of OpenCV's PREDEFINED_DICTIONARY_NAME. */
const char *const dictionaries[] = {
    "4x4_50",        "4x4_100",        "4x4_250",       "4x4_1000",      "5x5_50",
    "5x5_100",       "5x5_250",        "5x5_1000",      "6x6_50",        "6x6_100",
    "6x6_250",       "6x6_1000",       "7x7_50",        "7x7_100",       "7x7_250",
    "7x7_1000",      "aruco_original", "apriltag_16h5", "apriltag_25h9", "apriltag_36h10",
    "apriltag_36h11"};
static_assert(cv::aruco::DICT_5X5_50 == 4 && cv::aruco::DICT_6X6_50 == 8 &&
              cv::aruco::DICT_7X7_50 == 12 && cv::aruco::DICT_ARUCO_ORIGINAL == 16 &&
              cv::aruco::DICT_APRILTAG_36h11 == 20);

cv::Ptr<cv::aruco::Dictionary> dictionary_of(const char *name) {
    for (gsize i = 0; i < G_N_ELEMENTS(dictionaries); i++)
        if (std::strcmp(dictionaries[i], name) == 0)
            return cv::aruco::getPredefinedDictionary((int)i);
    return {};
}

/* Converts a picture to 8 bits. The darkest 1 % of the values become 0, and the brightest 0.5 %
 * become 255. A square root gives dark values more levels, so that edges in shadow are also
 * found. */
cv::Mat to_bytes(const picture *from) {
    const cv::Mat linear(from->height, from->width, CV_32F, from->values);
    cv::Mat sorted = linear.clone().reshape(1, 1);
    cv::patchNaNs(sorted, 0);
    cv::sort(sorted, sorted, cv::SORT_EVERY_ROW | cv::SORT_ASCENDING);
    const int n = sorted.cols;
    const float low = sorted.at<float>(n / 100), high = sorted.at<float>(n - 1 - n / 200);
    cv::Mat scaled = (linear - low) / std::max(high - low, 1e-12f);
    cv::patchNaNs(scaled, 0);
    cv::max(scaled, 0, scaled);
    cv::min(scaled, 1, scaled);
    cv::sqrt(scaled, scaled);
    cv::Mat bytes;
    scaled.convertTo(bytes, CV_8U, 255);
    return bytes;
}

/* Returns the factor by which a picture is enlarged, so that markers with few pixels per cell are
 * found. */
int enlargement(const cv::Mat &m) {
    const int longest = std::max(m.cols, m.rows);
    return longest <= 400 ? 3 : longest <= 900 ? 2 : 1;
}

cv::Ptr<cv::aruco::DetectorParameters> detector(int border) {
    auto p = cv::aruco::DetectorParameters::create();
    p->markerBorderBits = border;
    p->adaptiveThreshWinSizeMin = 5;
    p->adaptiveThreshWinSizeMax = 45;
    p->adaptiveThreshWinSizeStep = 10;
    p->minMarkerPerimeterRate = 0.02;
    /* A marker is so close to the edge of its white square that the detector would otherwise merge
     * the two. */
    p->minMarkerDistanceRate = 0.005;
    p->perspectiveRemovePixelPerCell = 6;
    p->maxErroneousBitsInBorderRate = 0.25;
    p->errorCorrectionRate = 0.4;
    return p;
}

/* Finds markers in the picture enlarged by scale, and adds those whose ids are not in found yet. */
void add_markers(GArray *found, const cv::Mat &bytes, const char *dictionary, int border, int scale,
                 bool mirrored) {
    cv::Mat scaled = bytes;
    std::vector<std::vector<cv::Point2f>> corners;
    std::vector<int> ids;
    if (scale > 1)
        cv::resize(bytes, scaled, {}, scale, scale, cv::INTER_CUBIC);
    cv::aruco::detectMarkers(scaled, dictionary_of(dictionary), corners, ids, detector(border));
    for (gsize i = 0; i < ids.size(); i++) {
        struct vision_marker marker = {ids[i], {}};
        for (gsize k = 0; k < 4; k++) {
            const double x = ((double)corners[i][k].x + 0.5) / scale - 0.5;
            marker.corners_px[k][0] = mirrored ? bytes.cols - 1 - x : x;
            marker.corners_px[k][1] = ((double)corners[i][k].y + 0.5) / scale - 0.5;
        }
        guint same = 0;
        while (same < found->len &&
               g_array_index(found, struct vision_marker, same).id != marker.id)
            same++;
        if (same == found->len)
            g_array_append_val(found, marker);
    }
}

/* Finds the corners of a chessboard. If by_sectors is TRUE, a corner is found by the light and dark
 * sectors around it. Otherwise the corners are found by the outlines of the dark squares, which
 * finds boards that the first method misses. Returns FALSE if not all corners are found. */
bool find_corners(const cv::Mat &bytes, cv::Size inner, double scale, bool by_sectors,
                  double *ret_xy_px) {
    std::vector<cv::Point2f> corners;
    cv::Mat scaled = bytes;
    if (scale != 1)
        cv::resize(bytes, scaled, {}, scale, scale, scale > 1 ? cv::INTER_CUBIC : cv::INTER_AREA);
    if (!(by_sectors
              ? cv::findChessboardCornersSB(scaled, inner, corners, cv::CALIB_CB_NORMALIZE_IMAGE)
              : cv::findChessboardCorners(scaled, inner, corners)))
        return false;
    for (gsize i = 0; i < corners.size(); i++) {
        ret_xy_px[2 * i] = ((double)corners[i].x + 0.5) / scale - 0.5;
        ret_xy_px[2 * i + 1] = ((double)corners[i].y + 0.5) / scale - 0.5;
    }
    return true;
}

/* Makes a detector for blobs by area and roundness. The limits of the area follow from the
 * picture's size and the number of circles. */
cv::Ptr<cv::SimpleBlobDetector> blob_detector(const cv::Mat &bytes, int circles) {
    cv::SimpleBlobDetector::Params p;
    p.minArea = 20;
    p.maxArea = (float)bytes.total() / (float)circles;
    p.minDistBetweenBlobs = 4;
    p.minConvexity = 0.85f;
    return cv::SimpleBlobDetector::create(p);
}

bool find_circles(const cv::Mat &bytes, cv::Size many, bool staggered,
                  std::vector<cv::Point2f> &centres) {
    const int grid = staggered ? cv::CALIB_CB_ASYMMETRIC_GRID : cv::CALIB_CB_SYMMETRIC_GRID;
    const auto blobs = blob_detector(bytes, many.area());
    return cv::findCirclesGrid(bytes, many, centres, grid, blobs) ||
           cv::findCirclesGrid(bytes, many, centres, grid | cv::CALIB_CB_CLUSTERING, blobs);
}

} // namespace

int vision_dictionary(const char *name, int *ret_markers) {
    int cells = 0;
    guarded(nullptr, name, [&] {
        const auto d = dictionary_of(name);
        cells = d ? d->markerSize : 0;
        if (ret_markers)
            *ret_markers = d ? d->bytesList.rows : 0;
        return true;
    });
    return cells;
}

gboolean vision_marker_bits(const char *dictionary, int id, guint8 *ret_bits) {
    return guarded(nullptr, dictionary, [&] {
        const auto d = dictionary_of(dictionary);
        if (!d || id < 0 || id >= d->bytesList.rows)
            return false;
        const cv::Mat bits = cv::aruco::Dictionary::getBitsFromByteList(
            d->bytesList.rowRange(id, id + 1), d->markerSize);
        for (int i = 0; i < d->markerSize; i++)
            for (int j = 0; j < d->markerSize; j++)
                ret_bits[i * d->markerSize + j] = bits.at<guint8>(i, j);
        return true;
    });
}

GArray *vision_find_markers(const struct picture *picture, const char *dictionary, int border,
                            gboolean mirrored, GError **error) {
    GArray *found = g_array_new(FALSE, FALSE, sizeof(struct vision_marker));
    const bool ok = guarded(error, picture->name, [&] {
        cv::Mat bytes = to_bytes(picture);
        if (mirrored)
            cv::flip(bytes, bytes, 1);
        add_markers(found, bytes, dictionary, border, 1, mirrored);
        if (enlargement(bytes) > 1)
            add_markers(found, bytes, dictionary, border, enlargement(bytes), mirrored);
        return true;
    });
    if (!ok)
        g_clear_pointer(&found, g_array_unref);
    return found;
}

gboolean vision_find_chessboard(const struct picture *picture, int columns, int rows,
                                double *ret_xy_px, GError **error) {
    return guarded(error, picture->name, [&] {
        const cv::Mat bytes = to_bytes(picture);
        const cv::Size inner = {columns - 1, rows - 1};
        const double enlarged = enlargement(bytes);
        return find_corners(bytes, inner, enlarged, true, ret_xy_px) ||
               (enlarged > 1 && find_corners(bytes, inner, 1, true, ret_xy_px)) ||
               find_corners(bytes, inner, 0.5, true, ret_xy_px) ||
               find_corners(bytes, inner, 1, false, ret_xy_px);
    });
}

GArray *vision_measure_chessboard(const struct picture *picture, int *ret_columns, int *ret_rows,
                                  GError **error) {
    GArray *found = nullptr;
    guarded(error, picture->name, [&] {
        const double scale = enlargement(cv::Mat(picture->height, picture->width, CV_8U));
        cv::Mat scaled = to_bytes(picture), meta;
        std::vector<cv::Point2f> corners;
        if (scale > 1)
            cv::resize(scaled, scaled, {}, scale, scale, cv::INTER_CUBIC);
        if (!cv::findChessboardCornersSB(scaled, {3, 3}, corners,
                                         cv::CALIB_CB_NORMALIZE_IMAGE | cv::CALIB_CB_LARGER,
                                         meta) ||
            corners.size() != meta.total())
            return false;
        *ret_columns = meta.cols;
        *ret_rows = meta.rows;
        found = g_array_new(FALSE, FALSE, sizeof(double));
        for (const auto &corner : corners) {
            const double xy[2] = {((double)corner.x + 0.5) / scale - 0.5,
                                  ((double)corner.y + 0.5) / scale - 0.5};
            g_array_append_vals(found, xy, 2);
        }
        return true;
    });
    return found;
}

GArray *vision_find_spots(const struct picture *picture, gboolean bright, GError **error) {
    GArray *found = g_array_new(FALSE, FALSE, sizeof(double));
    const bool ok = guarded(error, picture->name, [&] {
        cv::Mat bytes = to_bytes(picture);
        std::vector<cv::KeyPoint> spots;
        if (bright)
            cv::bitwise_not(bytes, bytes);
        blob_detector(bytes, FEWEST_CIRCLES)->detect(bytes, spots);
        for (const auto &spot : spots) {
            const double xy[2] = {(double)spot.pt.x, (double)spot.pt.y};
            g_array_append_vals(found, xy, 2);
        }
        return true;
    });
    if (!ok)
        g_clear_pointer(&found, g_array_unref);
    return found;
}

gboolean vision_find_circles(const struct picture *picture, int columns, int rows,
                             gboolean staggered, double *ret_xy_px, GError **error) {
    return guarded(error, picture->name, [&] {
        cv::Mat bytes = to_bytes(picture);
        for (int inverted = 0; inverted < 2; inverted++) {
            std::vector<cv::Point2f> centres;
            if (find_circles(bytes, {columns, rows}, staggered, centres)) {
                for (gsize i = 0; i < centres.size(); i++) {
                    ret_xy_px[2 * i] = (double)centres[i].x;
                    ret_xy_px[2 * i + 1] = (double)centres[i].y;
                }
                return true;
            }
            cv::bitwise_not(bytes, bytes);
        }
        return false;
    });
}

gboolean vision_homography(const double *from_xy, const double *to_xy_px, int n,
                           double tolerance_px, double ret_h[9], guint8 *ret_good) {
    return vision_try_homography(from_xy, to_xy_px, n, tolerance_px, MAX_SAMPLES, ret_h, ret_good);
}

gboolean vision_try_homography(const double *from_xy, const double *to_xy_px, int n,
                               double tolerance_px, int max_samples, double ret_h[9],
                               guint8 *ret_good) {
    return n >= 4 && guarded(nullptr, "homography", [&] {
               const cv::Mat from(n, 1, CV_64FC2, (void *)from_xy),
                   to(n, 1, CV_64FC2, (void *)to_xy_px);
               cv::Mat good;
               const cv::Mat h =
                   cv::findHomography(from, to, cv::RANSAC, tolerance_px, good, max_samples);
               if (h.empty())
                   return false;
               std::memcpy(ret_h, h.ptr<double>(), sizeof(double) * 9);
               for (int i = 0; i < n; i++)
                   ret_good[i] = good.at<guint8>(i);
               return true;
           });
}

/* Fits the focal length, from the homographies of the views or from a guess above 0. Returns the
 * RMS error in px, or infinity if the result is no number above 0. */
static double fit_focal(const std::vector<std::vector<cv::Point3f>> &target,
                        const std::vector<std::vector<cv::Point2f>> &seen, cv::Size size,
                        double guess_px, double ret_focal_px[2]) {
    cv::Mat camera, distortion;
    std::vector<cv::Mat> turns, shifts;
    int flags = cv::CALIB_FIX_ASPECT_RATIO | cv::CALIB_ZERO_TANGENT_DIST | cv::CALIB_FIX_K1 |
                cv::CALIB_FIX_K2 | cv::CALIB_FIX_K3;
    if (guess_px > 0) {
        camera = (cv::Mat_<double>(3, 3) << guess_px, 0, (size.width - 1) / 2.0, 0, guess_px,
                  (size.height - 1) / 2.0, 0, 0, 1);
        flags |= cv::CALIB_USE_INTRINSIC_GUESS;
    }
    const double rms =
        cv::calibrateCamera(target, seen, size, camera, distortion, turns, shifts, flags);
    ret_focal_px[0] = camera.at<double>(0, 0);
    ret_focal_px[1] = camera.at<double>(1, 1);
    return std::isfinite(ret_focal_px[0]) && ret_focal_px[0] > 0 && std::isfinite(rms)
               ? rms
               : std::numeric_limits<double>::infinity();
}

gboolean vision_start_camera(const double *const *points, const int *n, int n_views,
                             double guess_px, int width, int height, double ret_focal_px[2],
                             GError **error) {
    return guarded(error, "initial focal length from the photographs", [&] {
        std::vector<std::vector<cv::Point3f>> target((gsize)n_views);
        std::vector<std::vector<cv::Point2f>> seen((gsize)n_views);
        for (int v = 0; v < n_views; v++)
            for (int i = 0; i < n[v]; i++) {
                const double *p = points[v] + 4 * i;
                target[(gsize)v].emplace_back((float)p[0], (float)p[1], 0.0f);
                seen[(gsize)v].emplace_back((float)p[2], (float)p[3]);
            }
        double guessed_px[2], rms = std::numeric_limits<double>::infinity();
        try {
            rms = fit_focal(target, seen, {width, height}, 0, ret_focal_px);
        } catch (const cv::Exception &) {
            if (!(guess_px > 0))
                throw;
        }
        if (guess_px > 0) {
            const double other = fit_focal(target, seen, {width, height}, guess_px, guessed_px);
            if (other < rms) {
                rms = other;
                std::memcpy(ret_focal_px, guessed_px, sizeof guessed_px);
            }
        }
        if (std::isfinite(rms))
            return true;
        throw std::runtime_error("the focal length is not a number above 0; "
                                 "photograph the board at other tilts");
    });
}

gboolean vision_pose(const double *points, int n, double ret_rotation[9], double ret_shift_mm[3]) {
    return n >= 4 && guarded(nullptr, "pose", [&] {
               cv::Mat target(n, 1, CV_64FC3), seen(n, 1, CV_64FC2);
               for (int i = 0; i < n; i++) {
                   target.at<cv::Vec3d>(i) = {points[4 * i], points[4 * i + 1], 0};
                   seen.at<cv::Vec2d>(i) = {points[4 * i + 2], points[4 * i + 3]};
               }
               std::vector<cv::Mat> turns, shifts;
               cv::solvePnPGeneric(target, seen, cv::Matx33d::eye(), cv::noArray(), turns, shifts,
                                   false, cv::SOLVEPNP_IPPE);
               if (turns.empty())
                   return false;
               cv::Mat rotation;
               cv::Rodrigues(turns[0], rotation);
               std::memcpy(ret_rotation, rotation.ptr<double>(), sizeof(double) * 9);
               std::memcpy(ret_shift_mm, shifts[0].ptr<double>(), sizeof(double) * 3);
               return true;
           });
}
