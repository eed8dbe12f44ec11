/*
 * Where a line laser stands and how its sheet of light sweeps, from where its line lies on planes
 * of known, different heights (Wang et al. 2005 §3.2). A sweep's peak times say at which sweep
 * angle the sheet goes through the point of the plane that a pixel sees; all of a laser's sweeps,
 * from all angles of the arc, are adjusted together to one sheet that turns about one axis. What
 * single steps differ from that is told, so that a sweep that does not run evenly is seen.
 *
 * All sheets of a sweep go through its axis: along it nothing tells where the source is, which
 * stays where it nominally was.
 *
 * Pure; any thread.
 */
#pragma once

#include "geometry/rig.h"

#define LASER_ERROR laser_error_quark()
GQuark laser_error_quark(void);
enum laser_error {
    LASER_ERROR_PICTURES,   /* a laser is not seen well enough */
    LASER_ERROR_DEGENERATE, /* planes of one height only, too few steps */
    LASER_ERROR_SWEEP,      /* a sweep turns the other way, or much further or less, than told */
};

struct laser_point {
    int sweep; /* picture: number of the sweep's file, for messages */
    int laser, camera;
    double arc_rad, sweep_rad; /* commanded */
    struct vec3 point_mm;      /* rig frame */
    double sigma_mm;           /* across the sheet */
    float aside[4];            /* mm that x and y of the point change by, a pixel across and down */
};

struct laser_step { /* one step of one sweep against the model */
    int laser;
    double arc_rad, sweep_rad;
    double tilt_rad;  /* of the sheet about its axis, as the two heights tell */
    double offset_mm; /* of the sheet, in the middle between the heights */
    int points;
};

struct laser_result {
    struct rig rig; /* with lasers and the arc's axis as found */
    gboolean seen[RIG_MAX_LASERS];
    /* Standard errors of the source across the axis (along it nothing is told), of axis, sweep's
     * zero and stretch. */
    double source_error_mm[RIG_MAX_LASERS];
    double axis_error_rad[RIG_MAX_LASERS], zero_error_rad[RIG_MAX_LASERS],
        stretch_error[RIG_MAX_LASERS];
    double rms_mm[RIG_MAX_LASERS];                /* of points from their sheets */
    int points[RIG_MAX_LASERS];                   /* used */
    double tilt_error_rad[2], centre_error_mm[2]; /* of the arc */
    double rms_all_mm, sigma;
    int n_used, degrees_of_freedom;
    guint8 *rejected; /* a point; owned */
    GArray *steps;    /* struct laser_step; owned */
};

/* What cameras may look aside, standard deviation: it is adjusted too, so that the one that sees
 * the planes best counts most. */
#define LASER_CAMERA_PX 0.1

/* How well the arc's axis is known beforehand, standard deviations. Lines on planes tell it better
 * than lamps do, as far as the sweeps' arc angles go round. */
struct laser_arc {
    double tilt_rad, centre_mm;
};

/* rig: calibrated cameras, lasers and arc as they are known. sweep_names: of the points' sweeps,
 * for messages. */
gboolean laser_fit(const struct rig *rig, const struct laser_point *points, int n,
                   const struct laser_arc *arc, const char *const *sweep_names,
                   struct laser_result *ret, GError **error);
void laser_result_clear(struct laser_result *result);

/* A sweep as one camera saw it: peak times as sweep_finish() left them, −1 where there is none;
 * frame k was taken at from + k·step. */
struct laser_sweep {
    int sweep, laser, camera;
    double arc_rad, from_rad, step_rad;
    double plane_mm;  /* height of the plane that was swept */
    double radius_mm; /* of its part about the turntable's axis that is looked at */
    const float *peak, *width;
    gsize most; /* points to take, spread over the picture */
};

/* Appends struct laser_point. Returns how many. */
int laser_points(const struct rig *rig, const struct laser_sweep *sweep, GArray *points);
