/*
 * This module finds the line of a laser on a calibration board in a photograph. The functions are
 * pure, and any thread may call them.
 *
 * A profile across the line is the profile of the sheet of light times the print's reflectance. The
 * reflectance therefore shifts the line's middle at edges of the print. The reflectance is known
 * from a photograph without the laser, or from the colours that the laser does not have. If neither
 * is available (one grey photograph), only the parts of the line are used around which the print is
 * all white or all black.
 */
#pragma once

#include "cameras/board_find.h"
#include "geometry/rig.h"

struct laser_pose { /* pose of a board: camera = rotation · board + shift */
    struct mat3 rotation;
    struct vec3 shift_mm;
    /* Covariance of a small rotation vector ω about the camera's axes (the true rotation is
     * exp([ω]×) · rotation), and of the shift. */
    double covariance[6][6];
};

/* Fits the pose to the corners (struct corner). start is a pose near the result, or NULL. Corners
 * that the line has shifted are left out. Returns FALSE if there are too few corners, or if they
 * contradict each other. */
gboolean laser_pose_fit(const struct rig_camera *camera, const struct board *board,
                        const GArray *corners, const struct laser_pose *start,
                        struct laser_pose *ret);

/* Computes where a pixel's ray meets the board, in mm in the board's frame. Returns FALSE if the
 * ray does not meet the board's plane. */
gboolean laser_board_point(const struct rig_camera *camera, const struct laser_pose *pose,
                           double x_px, double y_px, double ret_mm[2]);

/* Computes two values for each of n pixels, from linear R, G, B (n × 3): how strongly the laser may
 * have lit the pixel, and the print's reflectance there in an arbitrary unit. `dark` is a
 * photograph of the same scene without the laser, or NULL. There are three cases:
 * - With `dark`, the strength is the largest of the three colours' differences from `dark`, and the
 *   reflectance is the mean colour of `dark`.
 * - Without `dark`, `colour` is the laser's colour, 0 … 2. The reflectance is the mean of the other
 *   two colours, and the strength is the laser's colour minus this mean.
 * - If `dark` is NULL and `colour` is −1, for grey pictures, the strength is the mean of R, G and
 *   B, and the reflectance is NAN.
 */
void laser_strength(const float *rgb, const float *dark, gsize n, int colour, float *ret,
                    float *ret_reflectance);
/* Returns the colour (0 … 2) in which the brightest pixels of a photograph differ most from grey.
 * Returns −1 if no colour differs, or if `dark` is not NULL. */
int laser_colour(const float *rgb, const float *dark, gsize n);

struct laser_dot { /* a point of the middle of the line */
    double x_px, y_px;
    double sigma_px; /* standard deviation across the line, from the noise */
};

/* Returns the line's dots (struct laser_dot), in order along it. reflectance is NULL if it is not
 * known. Returns NULL with BOARD_ERROR_SPEC and a reason, such as that no line is bright enough.
 * The caller prefixes "picture: ". */
GArray *laser_line_find(const struct picture *strength, const struct picture *reflectance,
                        const struct rig_camera *camera, const struct board *board,
                        const struct laser_pose *pose, GError **error);
