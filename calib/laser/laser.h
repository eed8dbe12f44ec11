/*
 * Calibrates the position of a line laser and the axis of its sweep from its line on planes of
 * known, different heights (Wang et al. 2005 §3.2). The peak times of a sweep give the sweep
 * angle at which the sheet passes through the point of the plane that a pixel sees. All sweeps of
 * a laser, at all angles of the arc, are adjusted together to one sheet that rotates about one
 * axis. The deviations of single steps are reported, so that an uneven sweep is noticed.
 *
 * All sheets of a sweep contain its axis: the position of the source along the axis is
 * undetermined and stays nominal.
 *
 * Pure; any thread.
 */
#pragma once

#include "geometry/rig.h"

#define LASER_ERROR laser_error_quark()
GQuark laser_error_quark(void);
enum laser_error {
    LASER_ERROR_PICTURES,   /* too few points of a laser */
    LASER_ERROR_DEGENERATE, /* planes of one height only, or too few steps */
    LASER_ERROR_SWEEP,   /* the direction of a sweep is reversed, or its range differs much from the
                            commanded one */
    LASER_ERROR_MISTAKE, /* the given facts about the sweeps are wrong; the message says which */
};

struct laser_point {
    int sweep; /* number of the sweep's file, for messages */
    int laser, camera;
    double arc_rad, sweep_rad; /* commanded */
    struct vec3 point_mm;      /* rig frame */
    double sigma_mm;           /* standard deviation across the sheet */
    float shift[4]; /* derivative of the point's x and y (mm) by the camera's offset (px), across
                       and down */
    float noise_mm; /* standard deviation across the sheet by noise only; 0: not known */
    float line_rad; /* standard deviation of the line's profile, as a sweep angle; 0: not known */
};

struct laser_step { /* deviation of one step of one sweep from the model */
    int laser;
    double arc_rad, sweep_rad;
    double tilt_rad;  /* of the sheet about its axis, from the two heights */
    double offset_mm; /* of the sheet, midway between the heights */
    int points;
};

struct laser_result {
    struct rig rig; /* with lasers and the arc's axis as estimated */
    gboolean seen[RIG_MAX_LASERS];
    /* Standard errors of the source across the axis (along it the position is undetermined), of
     * the axis, and of the sweep's zero and stretch. */
    double source_error_mm[RIG_MAX_LASERS];
    double axis_error_rad[RIG_MAX_LASERS], zero_error_rad[RIG_MAX_LASERS],
        stretch_error[RIG_MAX_LASERS];
    double bend_error_rad[RIG_MAX_LASERS]; /* also of a bend that is not significant */
    /* The errors above that are mostly those of the arc's axis as it was known before, and not of
     * the measurement: position, axis, zero, stretch. */
    gboolean from_prior[RIG_MAX_LASERS][4];
    struct rig_sheet_errors sheet[RIG_MAX_LASERS]; /* with what noise does not explain of the RMS */
    double sheet_error_mm[RIG_MAX_LASERS];         /* RMS over the points, from sheet */
    double rms_mm[RIG_MAX_LASERS];                /* RMS distance of the points from their sheets */
    double expected_mm[RIG_MAX_LASERS];           /* RMS by noise only; 0: not known */
    double line_rad[RIG_MAX_LASERS];              /* median of the points'; 0: not known */
    int points[RIG_MAX_LASERS];                   /* number of points that were used */
    double tilt_error_rad[2], centre_error_mm[2]; /* standard errors of the arc */
    double rms_all_mm, sigma;
    int n_used, degrees_of_freedom;
    guint8 *rejected; /* one flag per point; owned */
    GArray *steps;    /* struct laser_step; owned */
};

/* Standard deviation of the pointing error of cameras. This error is a parameter of the fit, so
 * that the camera with the best view of the planes has the largest weight. */
#define LASER_CAMERA_PX 0.1

/* Prior of the arc's axis, standard deviations. Lines on planes determine it better than lamps do
 * if the sweeps' arc angles cover a large range. */
struct laser_arc {
    double tilt_rad, centre_mm;
};

/* Estimates lasers and arc. rig: calibrated cameras, nominal lasers and arc. sweep_names: of the
 * points' sweeps, for messages. If another height of one plane explains the lines three times
 * better, that is LASER_ERROR_MISTAKE with the height. */
gboolean laser_fit(const struct rig *rig, const struct laser_point *points, int n,
                   const struct laser_arc *arc, const char *const *sweep_names,
                   struct laser_result *ret, GError **error);
/* Whether the sweeps agree with the rig file about as well as unadjusted devices do. FALSE: one
 * mistake explains them five times better: the arc turns the other way, its angles are in radians,
 * two lasers or two planes are exchanged. laser_fit() calls it, and after the fit also compares
 * positions, since only these distinguish lasers at nearly the same angle. */
gboolean laser_check_mistakes(const struct rig *rig, const struct laser_point *points, int n,
                              const char *const *sweep_names, GError **error);
void laser_result_clear(struct laser_result *result);

/* A sweep seen by one camera: peak times of sweep_finish(), −1 where there is none; frame k was
 * taken at sweep angle from + k·step. */
struct laser_plate_sweep {
    int sweep, laser, camera;
    double arc_rad, from_rad, step_rad;
    double plane_mm;  /* height of the plane */
    double radius_mm; /* radius of its used part about the turntable's axis */
    const float *peak, *width;
    gsize most; /* number of points to take, spread over the picture */
};

/* Appends struct laser_point. Returns their number. */
int laser_points(const struct rig *rig, const struct laser_plate_sweep *sweep, GArray *points);
