/*
 * OpenCV for calibration, behind C: markers, chessboards, initial camera parameters. No exception
 * leaves it; errors of OpenCV are PICTURE_FILE_ERROR_FAILED.
 *
 * Pixel coordinates as in rig.h: the centre of the top left pixel is (0, 0). Any thread.
 */
#pragma once

#include "picture.h"

G_BEGIN_DECLS

/* A dictionary of markers by its lower-case name without "DICT_": "4x4_50" … "7x7_1000",
 * "aruco_original", "apriltag_16h5" … "apriltag_36h11". Returns the number of cells across without
 * the black border; 0: unknown name.
 */
int vision_dictionary(const char *name, int *ret_markers);
/* Gives the cells × cells bits of a marker, row by row; 1 is white. */
gboolean vision_marker_bits(const char *dictionary, int id, guint8 *ret_bits);

struct vision_marker {
    int id;
    double corners_px[4][2]; /* clockwise in the picture from the marker's own top left */
};
/* border: width of the markers' black border, in cells. mirrored: finds mirrored markers. GArray of
 * struct vision_marker; NULL: error. */
GArray *vision_find_markers(const struct picture *picture, const char *dictionary, int border,
                            gboolean mirrored, GError **error);

/* Finds the inner corners of a chessboard, row by row, in either order. FALSE without an error:
 * there is none. */
gboolean vision_find_chessboard(const struct picture *picture, int columns, int rows,
                                double *ret_xy_px, GError **error);

/* Finds the inner corners of the largest chessboard in the picture, whatever its size, but of at
 * least 3 × 3 inner corners. Returns double x, y, row by row, and how many there are in a row and
 * in a column. Rows may run in any direction. NULL without an error: there is none. */
GArray *vision_measure_chessboard(const struct picture *picture, int *ret_columns, int *ret_rows,
                                  GError **error);

/* Finds the centres of all dark round spots, or of the bright ones. Double x, y. NULL: an error. */
GArray *vision_find_spots(const struct picture *picture, gboolean bright, GError **error);

/* Finds dark circles on a bright ground, or else bright ones on a dark ground, row by row.
 * staggered: every second row is moved by half the distance of the circles. FALSE without an error:
 * there are none. */
gboolean vision_find_circles(const struct picture *picture, int columns, int rows,
                             gboolean staggered, double *ret_xy_px, GError **error);

/* Robust homography (row by row, last element 1) of n point pairs; ret_good (n): those within
 * tolerance_px. FALSE: none was found. */
gboolean vision_homography(const double *from_xy, const double *to_xy_px, int n,
                           double tolerance_px, double ret_h[9], guint8 *ret_good);

/* Initial focal length without distortion (Zhang 2000) from n_views views of a flat target (x, y
 * in mm, z = 0). points[v]: n[v] × 4, x_mm, y_mm, x_px, y_px. */
gboolean vision_start_camera(const double *const *points, const int *n, int n_views, int width,
                             int height, double ret_focal_px[2], GError **error);

/* Pose of a flat target: camera = rotation · target + shift. Of the two solutions for a plane the
 * one with the smaller reprojection error. points: n × 4, x_mm, y_mm, and x / z, y / z of the
 * viewing ray in the camera's frame. */
gboolean vision_pose(const double *points, int n, double ret_rotation[9], double ret_shift_mm[3]);

G_END_DECLS
