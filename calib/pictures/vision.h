/*
 * What OpenCV does for calibration, behind C: reading ordinary photographs, markers, chessboards, a
 * first guess at a camera. No exception comes out; what OpenCV objects to is VISION_ERROR_FAILED.
 *
 * Pixel coordinates as in rig.h: the centre of the top left pixel is (0, 0). Any thread.
 */
#pragma once

#include "picture.h"

G_BEGIN_DECLS

#define VISION_ERROR vision_error_quark()
GQuark vision_error_quark(void);
enum vision_error {
    VISION_ERROR_IO,     /* a picture cannot be read */
    VISION_ERROR_FAILED, /* OpenCV has said no */
};

/* JPEG, PNG or TIFF, as grey. Files of 8 bits are taken to be sRGB and made linear, others to be
 * linear; 1 is white. Not turned as EXIF may say: pixels stay where the sensor has them. */
struct picture *vision_read(const char *path, GError **error);

/* The same in colour: height × width × 3 (R, G, B), g_free(). ret_grey: all three are the one. */
gboolean vision_read_colour(const char *path, int *ret_width, int *ret_height, gboolean *ret_grey,
                            float **ret_rgb, GError **error);

/* A dictionary of markers by its name in lower case without "DICT_": "4x4_50" … "7x7_1000",
 * "aruco_original". Its cells across, black border aside; 0: there is none of that name. */
int vision_dictionary(const char *name, int *ret_markers);
/* cells × cells bits of a marker, row by row, 1 is white. */
gboolean vision_marker_bits(const char *dictionary, int id, guint8 *ret_bits);

struct vision_marker {
    int id;
    double corners_px[4][2]; /* clockwise in the picture from the marker's own top left */
};
/* mirrored: looks for markers as a mirror shows them. GArray of struct vision_marker; NULL: error.
 */
GArray *vision_find_markers(const struct picture *picture, const char *dictionary,
                            gboolean mirrored, GError **error);

/* Inner corners of a chessboard, row by row; which end is first is not known. FALSE without an
 * error: there is none. */
gboolean vision_find_chessboard(const struct picture *picture, int columns, int rows,
                                double *ret_xy_px, GError **error);

/* The plane-to-picture map (row by row, last element 1) that most of n point pairs agree with;
 * ret_good[i] is set for those within tolerance_px. FALSE: no map was found. */
gboolean vision_homography(const double *from_xy, const double *to_xy_px, int n,
                           double tolerance_px, double ret_h[9], guint8 *ret_good);

/* Zhang's start from n_views views of a flat target (x, y in mm, z = 0): focal length and
 * principal point, no distortion. points[v] has n[v] rows of x_mm, y_mm, x_px, y_px. */
gboolean vision_start_camera(const double *const *points, const int *n, int n_views, int width,
                             int height, double ret_focal_px[2], double ret_centre_px[2],
                             GError **error);

/* Pose of a flat target before a camera without distortion: camera = rotation · target + shift. The
 * better of the two solutions a plane has, by reprojection. points as above. */
gboolean vision_pose(const double *points, int n, const double focal_px[2],
                     const double centre_px[2], double ret_rotation[9], double ret_shift_mm[3]);

G_END_DECLS
