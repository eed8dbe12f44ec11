/*
 * This module gives calibration the functions of OpenCV that it needs, behind a C interface:
 * markers, chessboards, circles, homographies, initial camera parameters. No exception leaves these
 * functions. An error of OpenCV becomes a PICTURE_FILE_ERROR_FAILED.
 *
 * Pixel coordinates are as in rig.h: the centre of the top left pixel is (0, 0). Any thread may
 * call the functions.
 */
#pragma once

#include "picture.h"

G_BEGIN_DECLS

/* Looks up a dictionary of markers by its lower-case name without "DICT_": "4x4_50" … "7x7_1000",
 * "aruco_original", "apriltag_16h5" … "apriltag_36h11". Returns the number of cells across a
 * marker, without the black border, or 0 if the name is unknown. ret_markers gets the number of
 * markers, and may be NULL. */
int vision_dictionary(const char *name, int *ret_markers);
/* Gives the bits of the marker with the number id, row by row, where 1 is white. A marker has cells
 * × cells bits (vision_dictionary()). Returns FALSE if the dictionary is unknown or has no marker
 * with this number. */
gboolean vision_marker_bits(const char *dictionary, int id, guint8 *ret_bits);

struct vision_marker {
    int id;
    double corners_px[4][2]; /* clockwise in the picture, from the marker's own top left corner */
};
/* Finds markers. border is the width of the markers' black border, in cells. If mirrored is TRUE,
 * finds mirrored markers. Returns a GArray of struct vision_marker, or NULL on error. */
GArray *vision_find_markers(const struct picture *picture, const char *dictionary, int border,
                            gboolean mirrored, GError **error);

/* Finds the inner corners of a chessboard of columns × rows squares, row by row. Their order may
 * begin at either end of the board. Returns FALSE without an error if there is no chessboard. */
gboolean vision_find_chessboard(const struct picture *picture, int columns, int rows,
                                double *ret_xy_px, GError **error);

/* Finds the inner corners of the largest chessboard in the picture, which must have at least 3 × 3
 * inner corners. Returns doubles x, y, row by row, and the number of corners in a row and in a
 * column. Rows may run in any direction. Returns NULL without an error if there is no
 * chessboard. */
GArray *vision_measure_chessboard(const struct picture *picture, int *ret_columns, int *ret_rows,
                                  GError **error);

/* Finds the centres of all round spots: of bright spots if bright is TRUE, otherwise of dark spots.
 * Returns doubles x, y, or NULL on error. */
GArray *vision_find_spots(const struct picture *picture, gboolean bright, GError **error);

/* Finds a grid of columns × rows circles, row by row. Dark circles on a bright ground are searched
 * for first, then bright circles on a dark ground. If staggered is TRUE, every second row is
 * shifted by half the distance between two circles of a row. Returns FALSE without an error if
 * there is no grid. */
gboolean vision_find_circles(const struct picture *picture, int columns, int rows,
                             gboolean staggered, double *ret_xy_px, GError **error);

/* Computes a robust homography (row by row, last element 1) from n pairs of points. ret_good gets n
 * values: 1 for a pair that agrees with the homography within tolerance_px, otherwise 0. Returns
 * FALSE if no homography was found. */
gboolean vision_homography(const double *from_xy, const double *to_xy_px, int n,
                           double tolerance_px, double ret_h[9], guint8 *ret_good);

/* Computes a homography like vision_homography(), but from at most max_samples random samples of
 * four pairs instead of 2000. The function may miss a homography if less than half of the pairs
 * agree with it. */
gboolean vision_try_homography(const double *from_xy, const double *to_xy_px, int n,
                               double tolerance_px, int max_samples, double ret_h[9],
                               guint8 *ret_good);

/* Computes an initial focal length without distortion (Zhang 2000) from n_views views of a flat
 * target (x, y in mm, z = 0). points[v] has n[v] × 4 numbers: x_mm, y_mm, x_px, y_px.
 *
 * If guess_px is above 0, a second computation starts from this focal length. The result that fits
 * the points better is returned. Without a guess, views that are tilted by less than about 2°
 * hardly determine the focal length. Returns FALSE with an error if no focal length above 0 is
 * found. */
gboolean vision_start_camera(const double *const *points, const int *n, int n_views,
                             double guess_px, int width, int height, double ret_focal_px[2],
                             GError **error);

/* Computes the pose of a flat target: camera = rotation · target + shift. A plane has two
 * solutions; the one with the smaller reprojection error is returned. points has n × 4 numbers:
 * x_mm, y_mm, and x / z, y / z of the viewing ray in the camera's frame. Returns FALSE if there are
 * fewer than 4 points or no solution. */
gboolean vision_pose(const double *points, int n, double ret_rotation[9], double ret_shift_mm[3]);

G_END_DECLS
