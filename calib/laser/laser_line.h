/*
 * The line of a laser on a calibration board in a photograph. Pure; any thread.
 *
 * A profile across the line is that of the sheet of light times the print's reflectance, which
 * shifts its middle at edges of the print. The reflectance is known from the photograph without the
 * laser, or from the colours that the laser does not have. Where neither is there (one grey
 * photograph), only pieces of the line are used around which the print is white or black
 * throughout.
 */
#pragma once

#include "cameras/board_find.h"
#include "geometry/rig.h"

struct laser_pose { /* of a board: camera = rotation · board + shift */
    struct mat3 rotation;
    struct vec3 shift_mm;
    /* Of a small rotation vector ω about the camera's axes (the true rotation is exp([ω]×) ·
     * rotation) and of the shift. */
    double covariance[6][6];
};

/* Fits the pose to the corners (struct corner). start: NULL, or a pose near it. Corners that the
 * line has moved are left out. FALSE: the corners contradict each other. */
gboolean laser_pose_fit(const struct rig_camera *camera, const struct board *board,
                        const GArray *corners, const struct laser_pose *start,
                        struct laser_pose *ret);

/* Where a pixel's ray meets the board, mm in the board's frame; FALSE: it does not. */
gboolean laser_board_point(const struct rig_camera *camera, const struct laser_pose *pose,
                           double x_px, double y_px, double ret_mm[2]);

/* From linear values R, G, B (n × 3): how strongly the laser may have lit each pixel, and the
 * print's reflectance there in any unit. dark: the same scene without the laser, which is
 * subtracted, and is the reflectance; NULL: there is no such photograph. colour: the laser's, 0 …
 * 2, less the mean of the others, which is the reflectance; −1: of grey pictures, whose reflectance
 * is NAN. */
void laser_strength(const float *rgb, const float *dark, gsize n, int colour, float *ret,
                    float *ret_reflectance);
/* The colour in which the brightest pixels of a photograph differ most from grey; −1: in none. */
int laser_colour(const float *rgb, const float *dark, gsize n);

struct laser_dot { /* the middle of the line */
    double x_px, y_px;
    double sigma_px; /* from the noise, across the line */
};

/* The line's dots, in order along it (struct laser_dot). reflectance: NULL if it is not known.
 * NULL: BOARD_ERROR_SPEC, a reason that is to follow "picture: ", such as that no line is bright
 * enough. */
GArray *laser_line_find(const struct picture *strength, const struct picture *reflectance,
                        const struct rig_camera *camera, const struct board *board,
                        const struct laser_pose *pose, GError **error);
