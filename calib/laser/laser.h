/*
 * Calibrates the position of a line laser and the axis of its sweep from its line on planes of
 * known, different heights (Wang et al. 2005 §3.2). The peak times of a sweep give the sweep angle
 * at which the sheet passes through the point of the plane that a pixel sees. All sweeps of a
 * laser, at all angles of the arc, are adjusted together to one sheet that rotates about one axis.
 * The deviations of single steps are reported, so that an uneven sweep is noticed.
 *
 * All sheets of a sweep contain its axis. The position of the source along the axis is therefore
 * undetermined and stays nominal.
 *
 * The functions are pure, and any thread may call them.
 */
#pragma once

#include "geometry/rig.h"

#define LASER_ERROR laser_error_quark()
GQuark laser_error_quark(void);
enum laser_error {
    LASER_ERROR_PICTURES,   /* one laser, or all together, have too few points */
    LASER_ERROR_DEGENERATE, /* all planes of a laser have one height, or the sweeps do not determine
                               an unknown value */
    LASER_ERROR_SWEEP,   /* the direction of a sweep is reversed, or its range differs much from the
                            commanded one */
    LASER_ERROR_MISTAKE, /* the given facts about the sweeps are wrong; the message says which */
};

struct laser_point {
    int sweep; /* number of the sweep's file, for messages */
    int laser, camera;
    double arc_rad, sweep_rad; /* commanded angles of arc and sweep */
    struct vec3 point_mm;      /* rig frame */
    double sigma_mm; /* assumed standard deviation of the point's distance from the sheet */
    /* Derivatives of the point's x and y (mm) with respect to an offset of the camera's picture to
     * the right and down (px): ∂x/∂right, ∂x/∂down, ∂y/∂right, ∂y/∂down. */
    float shift[4];
    float noise_mm; /* standard deviation that camera noise alone causes; 0 if not known */
    float line_rad; /* standard deviation of the line's profile, as a sweep angle; 0 if not known */
};

struct laser_step { /* deviation of one step of one sweep from the model */
    int laser;
    double arc_rad, sweep_rad;
    double tilt_rad;  /* rotation of the sheet about its axis, from the two heights */
    double offset_mm; /* displacement of the sheet, midway between the heights */
    int points;
};

struct laser_result {
    struct rig rig; /* the rig with the estimated lasers and axis of the arc */
    gboolean seen[RIG_MAX_LASERS];
    /* Standard errors:
     *   source_error_mm  position of the source across the axis; the position along the axis is
     *                    undetermined
     *   axis_error_rad   direction of the axis
     *   zero_error_rad   zero of the sweep
     *   stretch_error    stretch of the sweep */
    double source_error_mm[RIG_MAX_LASERS];
    double axis_error_rad[RIG_MAX_LASERS], zero_error_rad[RIG_MAX_LASERS],
        stretch_error[RIG_MAX_LASERS];
    /* standard error of the bend, also if the bend is not significant */
    double bend_error_rad[RIG_MAX_LASERS];
    /* Flags for position [0], axis [1], zero [2] and stretch [3]. A flag is TRUE if more than a
     * quarter of the variance comes from the prior of the arc's axis instead of the measurement. */
    gboolean from_prior[RIG_MAX_LASERS][4];
    /* Errors of the sheets. They include the part of the RMS residual that noise does not
     * explain. */
    struct rig_sheet_errors sheet[RIG_MAX_LASERS];
    /* standard deviation of the sheet's displacement at a point, computed from `sheet`: RMS over
     * the used points */
    double sheet_error_mm[RIG_MAX_LASERS];
    double rms_mm[RIG_MAX_LASERS];      /* RMS distance of the points from their sheets */
    double expected_mm[RIG_MAX_LASERS]; /* RMS caused by noise only; 0 if not known */
    /* median of line_rad of the points; 0 if not known */
    double line_rad[RIG_MAX_LASERS];
    int points[RIG_MAX_LASERS];                   /* number of points that were used */
    double tilt_error_rad[2], centre_error_mm[2]; /* standard errors of the arc's axis */
    /* RMS distance of all used points from their sheets. sigma is the RMS of these distances, each
     * divided by its expected standard deviation. */
    double rms_all_mm, sigma;
    int n_used, degrees_of_freedom;
    guint8 *rejected; /* one flag per point; owned */
    GArray *steps;    /* struct laser_step; owned */
};

/* Standard deviation of the pointing error of cameras. This error is a parameter of the fit, so
 * that the camera with the best view of the planes has the largest weight. */
#define LASER_CAMERA_PX 0.1

/* Prior of the arc's axis, as standard deviations. If the sweeps' arc angles cover a large range,
 * lines on planes determine the axis better than lamps do. */
struct laser_arc {
    double tilt_rad, centre_mm;
};

/* Estimates lasers and arc. `rig` has calibrated cameras, and nominal lasers and arc. `arc` is the
 * prior of the arc's axis. sweep_names[i] is the name of the sweep whose number (laser_point.sweep)
 * is i, for messages. If another height of one plane explains the lines three times better, the
 * error is LASER_ERROR_MISTAKE and names the height. Call laser_result_clear() after success. */
gboolean laser_fit(const struct rig *rig, const struct laser_point *points, int n,
                   const struct laser_arc *arc, const char *const *sweep_names,
                   struct laser_result *ret, GError **error);
/* Looks for one of these mistakes in the description of the sweeps: the arc turns the other way,
 * the angles of the arc are in radians, or two lasers or two planes are exchanged. Returns FALSE
 * with an error if the sweeps agree with the rig file at least five times better when one of these
 * mistakes is corrected.
 *
 * laser_fit() calls this function before its fit. After the fit, laser_fit() also compares the
 * positions of the lasers with the rig file, because only positions distinguish lasers at nearly
 * the same angle. */
gboolean laser_check_mistakes(const struct rig *rig, const struct laser_point *points, int n,
                              const char *const *sweep_names, GError **error);
void laser_result_clear(struct laser_result *result);

/* A sweep seen by one camera. peak has the peak times of sweep_finish(), and −1 where there is no
 * peak. Frame k was taken at the sweep angle from_rad + k · step_rad. */
struct laser_plate_sweep {
    int sweep, laser, camera;
    double arc_rad, from_rad, step_rad;
    double plane_mm;  /* height of the plane */
    double radius_mm; /* radius of the used part of the plane about the turntable's axis */
    /* Peak time of each pixel, and standard deviation of the profile at each pixel, in frames.
     * width may be NULL. */
    const float *peak, *width;
    gsize most; /* maximum number of points to take; they are spread over the picture */
};

/* Appends a struct laser_point for each point that is taken. Returns the number of these points. */
int laser_points(const struct rig *rig, const struct laser_plate_sweep *sweep, GArray *points);
