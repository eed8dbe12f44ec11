/*
 * Finds the plane of a laser that stands still, from photographs of a calibration board on which
 * its line is visible. In each photograph the board's pose follows from its corners. The pixels of
 * the line, projected onto the board, lie in the plane. The plane is determined if the lines of the
 * photographs do not all lie on one straight line.
 *
 * Two numbers of each photograph are adjusted: the distances of two points of its line from the
 * plane. Their covariance includes the line's scatter, and the error of the board's pose, which
 * moves both points. Photographs that contradict the others are left out. If there are only
 * LASER_PLANE_MIN photographs, none is left out.
 *
 * The errors of the camera's parameters are the same in all photographs. The covariance of the
 * plane includes the covariance of these parameters as well. If the photographs scatter more than
 * their errors explain, the plane's covariance is increased.
 *
 * The functions are pure, and any thread may call them.
 */
#pragma once

#include "calibration/calibration.h"
#include "laser_line.h"

#define LASER_PLANE_MIN 3 /* smallest number of photographs */

#define LASER_PLANE_ERROR laser_plane_error_quark()
GQuark laser_plane_error_quark(void);
enum laser_plane_error {
    /* There are too few photographs, the line or the board in one of them cannot be measured, the
     * photographs contradict each other, or the errors of the camera are too large. */
    LASER_PLANE_ERROR_PICTURES,
    /* The lines in the photographs determine no plane, or the tilt of the plane has a standard
     * error above 1°. */
    LASER_PLANE_ERROR_DEGENERATE,
};

struct laser_photograph {
    const char *name;      /* for messages */
    const GArray *corners; /* struct corner */
    const GArray *dots;    /* struct laser_dot */
};

struct laser_plane {
    struct rig_plane plane;  /* rig frame: n·x = d; n points away from the camera */
    struct vec3 point_mm;    /* point of the plane in the middle of the lines */
    struct vec3 along;       /* unit vector: the mean direction of the lines */
    double covariance[4][4]; /* covariance of n_x, n_y, n_z and d (mm) */
    double offset_error_mm;  /* standard error of the plane at point_mm */
    /* standard error of the normal, in the direction in which it is largest */
    double tilt_error_rad;
    /* RMS distance of the lines from the plane. expected_rms_mm is the value that the errors of the
     * lines would cause. */
    double rms_mm, expected_rms_mm;
    double spread_mm; /* RMS distance of the lines' points from the straight line nearest to them */
    /* Number of photographs that were used, and number of dots in these photographs. */
    int used, dots;
    /* RMS distance of each photograph's line from the plane, also if it was left out */
    double *off_mm;
    gboolean *left_out; /* one flag per photograph */
};

/* Fits the plane. `errors` has the errors of the camera's parameters. If `errors` is NULL, or
 * errors->known is FALSE, the camera counts as exact. Returns NULL with a LASER_PLANE_ERROR if the
 * plane is refused. A plane is also refused if it uses at most half of the photographs. */
struct laser_plane *laser_plane_fit(const struct rig_camera *camera,
                                    const struct calibration_camera *errors,
                                    const struct board *board,
                                    const struct laser_photograph *photographs, int n,
                                    GError **error);
void laser_plane_free(struct laser_plane *plane); /* NULL is ignored */
typedef struct laser_plane LaserPlane;
G_DEFINE_AUTOPTR_CLEANUP_FUNC(LaserPlane, laser_plane_free)
