/*
 * The rig's geometry: positions of cameras, lamps, lasers and axes, and functions of them.
 * Nominal values come from the rig file, measured ones from calibration; both have this struct
 * and this file format.
 *
 * Rig frame: millimetres, right-handed, origin on the turntable's axis in the plane of its top, z
 * up. Sample frame: rotates with the turntable; at turntable angle τ (counter-clockwise seen from
 * above) a point p of the sample is at Rz(τ) p in the rig, if the bearing is perfect (struct
 * rig_wobble). A fixed camera at azimuth φ_c is seen
 * by the sample at φ_c − τ; a lamp on the arc at arc angle α is seen at φ = α − τ, one that stands
 * by itself at azimuth φ_l at φ_l − τ.
 *
 * A rig may lack turntable and arc: an axis that is not there stands at 0.
 *
 * A camera arm is an axis that carries cameras, a light probe one that carries lamps. They stop at
 * the angles that the rig file lists. Here each stop of a camera (or lamp) counts as a camera (or
 * lamp) of its own, named NAME@ANGLE, with a position that is calibrated separately. Stops of one
 * device follow each other. See swing.h.
 *
 * Pure functions over plain data: any thread.
 */
#pragma once

#include <glib.h>

#include "base/vec.h"
#include "lens.h"

#define RIG_MAX_CAMERAS   31 /* stops counted; bit 31 of a set of cameras has other uses */
#define RIG_MAX_LAMPS     128
#define RIG_MIN_RESPONSE  1e-6 /* DN/s per W/(sr m²), as in a rig file */
#define RIG_MAX_RESPONSE  1e12
#define RIG_MAX_INTENSITY 1e6  /* W/sr */
#define RIG_MAX_STRETCH   0.5  /* largest relative stretch of a sweep, in both directions */
#define RIG_MAX_BEND      1.0  /* rad: largest bend of a laser's sheet, in both directions */
#define RIG_MAX_LATERAL   0.05 /* largest lateral colour, in both directions */
#define RIG_MAX_LASERS    16
#define RIG_MAX_FIDUCIALS 16
#define RIG_NAME          32

struct rig_camera {
    char name[RIG_NAME];
    int width, height;
    int lens; /* enum rig_lens */
    double fx_px, fy_px, cx_px, cy_px;
    double k1, k2, k3, p1, p2, k4, k5, k6;
    /* By how much more the lens magnifies red, green and blue light about (cx, cy) than the
     * parameters above say, which are those of the mean of a colour filter's pixels; within ±
     * RIG_MAX_LATERAL. 0: it has no lateral colour, or none is known. */
    double lateral_colour[3];
    struct mat3 rotation; /* camera = rotation · rig + translation_mm */
    struct vec3 translation_mm;
    double vignetting; /* relative response 1 − vignetting·(r/r_corner)², r from (cx, cy) */
    double response; /* DN per second per W·sr⁻¹·m⁻² of radiance, before vignetting, at 0 dB */
    int on_arm; /* 1: the camera arm carries it; its pose here is that with the arm at arm_deg */
    double arm_deg;
    int stop; /* number of the stop among those of its device, from 0; 0 if it has only one */
};

/* The true rotation of the light arc: by arc angle α + zero about an axis through centre_mm,
 * which is the rig's z rotated by the rotation vector (tilt_x, tilt_y, 0). All 0: about the
 * turntable's axis, as designed. */
struct rig_arc {
    double zero_rad;
    double tilt_rad[2];
    double centre_mm[2]; /* intersection of the axis with z = 0 */
};

/* A lamp on the light arc, or one that stands by itself (fixed): its position and aim are given in
 * the frame of its carrier, the arc's (at α + zero = 0 it stands over +x) or the rig's. Radiant
 * intensity in direction d: intensity · max(0, cos(d, aim))^n. */
struct rig_lamp {
    char name[RIG_NAME];
    struct vec3 position_mm;
    struct vec3 aim; /* unit */
    double exponent;
    double intensity; /* W·sr⁻¹ along aim */
    int fixed;        /* 1: it stands by itself; the arc does not move it */
    int on_probe; /* 1: the probe carries it; its position here is that with the probe at probe_deg
                   */
    double probe_deg;
    int stop; /* number of the stop, as for a camera */
};

/* A line laser on the light arc, or one that stands by itself (fixed), as a lamp: a sheet of light
 * through position that rotates about an axis in that sheet. At sweep angle s the sheet's normal is
 * `normal` rotated about axis by s·(1 + stretch) (right-handed). All in its carrier's frame.
 *
 * The optics that spread a beam to a line bend it: rays that leave at an angle to the middle of the
 * line also leave the plane. With t the tangent of the angle between a ray's projection and the
 * sheet's middle (t = a / r for a point a along the axis and r away from it), the ray lies
 * bend_rad·t² further about the axis than the plane. A parabola whose vertex is elsewhere differs
 * from this one by a rotation about the beam and by another zero, which axis and normal describe.
 */
struct rig_laser {
    char name[RIG_NAME];
    struct vec3 position_mm;
    struct vec3 axis;   /* unit: tangential, so that the line lies across the sweep */
    struct vec3 normal; /* unit, at s = 0, perpendicular to axis; at s = 0 the sheet goes through
                           the origin (nominally) */
    double stretch;     /* relative excess of the true over the commanded sweep angle, within ±
                           RIG_MAX_STRETCH */
    double bend_rad;    /* 0: the sheet is a plane; within ± RIG_MAX_BEND */
    int fixed;
};

/* A fiducial: a matt white disc, level next to the sample and fixed to the turntable. Its picture
 * measures a lamp's output and whether a camera or the turntable's zero has moved (fiducials.h). */
struct rig_fiducial {
    char name[RIG_NAME];
    struct vec3 centre_mm; /* of its face, sample frame */
    double radius_mm;
    double reflectance[3]; /* at the cameras' red, green, blue */
};

/* The axis of a camera arm, in the rig frame, or of a light probe, in the frame of its lamps: a
 * line. What the arm or probe carries turns about this line by its angle (right-handed). */
struct rig_swing {
    struct vec3 axis; /* unit; 0: the rig has no such axis */
    struct vec3 centre_mm;
};

#define RIG_WOBBLE_HARMONICS 4
#define RIG_MAX_WOBBLE_RAD   0.02 /* of each coefficient */

/* The wobble of the turntable's bearing: its axis is tilted by a rotation vector (x, y, 0) that is
 * a function of the turntable's angle τ, and the sample's point p is at W(τ) Rz(τ) p. Of harmonic k
 * = 1, 2, … x = c cos kτ + s sin kτ with {c, s} in [0] and [1], and y likewise in [2] and [3]. The
 * axis itself is the mean: there is no harmonic 0. All 0: a perfect bearing. */
struct rig_wobble {
    double rad[RIG_WOBBLE_HARMONICS][4];
};

struct rig {
    char id[64]; /* identifies the rig; a calibration of another one is refused */
    struct rig_camera cameras[RIG_MAX_CAMERAS];
    int n_cameras;
    struct rig_lamp lamps[RIG_MAX_LAMPS];
    int n_lamps;
    struct rig_laser lasers[RIG_MAX_LASERS];
    int n_lasers;
    struct rig_arc arc;
    struct rig_swing arm, probe;
    struct rig_wobble wobble;
    struct rig_fiducial fiducials[RIG_MAX_FIDUCIALS];
    int n_fiducials;
    double arc_radius_mm; /* radius of the arc's inner edge; 0: there is no arc */
    double arc_width_mm;  /* width of arc and lamps, which hide parts of a camera's frame */
};

/* The number of a camera's first stop, and of a lamp's. Cameras (lamps) for which it is the same
 * are stops of one device. */
static inline int rig_camera_unit(const struct rig *rig, int camera) {
    return camera - rig->cameras[camera].stop;
}
static inline int rig_lamp_unit(const struct rig *rig, int lamp) {
    return lamp - rig->lamps[lamp].stop;
}

/* Where the arm stands while a set of cameras (bits) takes pictures: at the angle that all cameras
 * of the set have that it carries. If it carries none of them, at the rig's first stop; 0 if there
 * is no arm. */
double rig_arm_deg(const struct rig *rig, guint32 cameras);
/* Does the same for the probe and a lamp; lamp −1: no lamp. */
double rig_probe_deg(const struct rig *rig, int lamp);

/* The name of the device that a camera or lamp NAME@ANGLE is a stop of, of at most RIG_NAME. */
void rig_stop_device(const char *name, int is_carried, char ret[RIG_NAME]);

#define RIG_ERROR rig_error_quark()
GQuark rig_error_quark(void);
enum rig_error {
    RIG_ERROR_FORMAT, /* not a calibration file, or of another version */
    RIG_ERROR_VALUE,  /* a value is missing, not finite, or out of range */
};

/* Text of the key file "calibration.conf". Numbers are restored bit for bit. */
char *rig_to_text(const struct rig *rig); /* g_free() */
gboolean rig_from_text(struct rig *rig, const char *text, const char *path, GError **error);

/* Places a camera at a point, looking at another; image x points to the right when seen from
 * above. */
void rig_camera_look_at(struct rig_camera *camera, struct vec3 eye_mm, struct vec3 target_mm);

struct vec3 rig_camera_centre_mm(const struct rig_camera *camera);

/* The camera as it draws the light of one colour (0 … 2: red, green, blue), with lateral colour. */
struct rig_camera rig_camera_of_colour(const struct rig_camera *camera, int colour);

/* Projects a point of the rig frame. FALSE if it is behind the camera (a fisheye sees to its side
 * and behind it as well) or so far out that the lens model folds back; it may lie outside the
 * picture. */
gboolean rig_project(const struct rig_camera *camera, struct vec3 point_mm, double *ret_x_px,
                     double *ret_y_px);

/* The viewing ray of a pixel: from the camera's centre, unit, in the rig frame. The lens model is
 * inverted to 1e-9 px; beyond the largest radius of a fisheye it is the ray at that radius. */
struct vec3 rig_pixel_ray(const struct rig_camera *camera, double x_px, double y_px);

/* Rotates about z: from sample to rig frame by +τ, from rig to sample frame by −τ. */
struct vec3 rig_turn(struct vec3 v, double angle_rad);

/* The tilt (x, y, 0) of the turntable's axis at an angle, and the largest one over a turn. */
void rig_wobble_tilt(const struct rig_wobble *wobble, double turntable_rad, double ret_rad[2]);
double rig_wobble_most_rad(const struct rig_wobble *wobble);

/* The same rig with the turntable at an angle, in the frame in which the axis is z also at this
 * angle: cameras, arc, and what stands by itself are tilted back by the wobble. In this frame
 * the sample turns by Rz only, and what lies on the turntable is level. The arc's axis is moved to
 * first order: the error is below 1 µm for wobbles below 0.1°. ret may be rig. */
void rig_at(const struct rig *rig, double turntable_rad, struct rig *ret);
/* The inverse of rig_at(). */
void rig_back(const struct rig *rig, double turntable_rad, struct rig *ret);

/* Rotates a point or direction by sign times such a tilt: W v, or back W⁻¹ v. */
struct vec3 rig_tilt_point(const double tilt_rad[2], struct vec3 v, double sign);

/* A point of the sample in the rig frame, with wobble. */
struct vec3 rig_sample_point(const struct rig *rig, double turntable_rad, struct vec3 point_mm);

/* Transforms between the arc's frame at angle α and the rig frame. arc may be NULL here and
 * below: an ideal arc. */
struct vec3 rig_arc_point(const struct rig_arc *arc, double arc_rad, struct vec3 point_mm);
struct vec3 rig_arc_direction(const struct rig_arc *arc, double arc_rad, struct vec3 direction);
struct vec3 rig_arc_point_back(const struct rig_arc *arc, double arc_rad, struct vec3 point_mm);

/* Position and aim in the rig frame with the arc at an angle, which does not matter to fixed
 * lamps. */
struct vec3 rig_lamp_position_mm(const struct rig_arc *arc, const struct rig_lamp *lamp,
                                 double arc_rad);
/* Transforms a point of the rig frame to the frame in which the lamp's position is given. */
struct vec3 rig_lamp_point_back(const struct rig_arc *arc, const struct rig_lamp *lamp,
                                double arc_rad, struct vec3 point_mm);

/* Irradiance on a plane perpendicular to the direction of the lamp, W·m⁻². */
double rig_lamp_irradiance(const struct rig_arc *arc, const struct rig_lamp *lamp, double arc_rad,
                           struct vec3 point_mm);

struct vec3 rig_laser_position_mm(const struct rig_arc *arc, const struct rig_laser *laser,
                                  double arc_rad);
struct vec3 rig_laser_axis(const struct rig_arc *arc, const struct rig_laser *laser,
                           double arc_rad);

/* The sheet of light without its bend: points p of the rig frame with normal · p = offset_mm. */
struct rig_plane {
    struct vec3 normal; /* unit */
    double offset_mm;
};
struct rig_plane rig_laser_sheet(const struct rig_arc *arc, const struct rig_laser *laser,
                                 double arc_rad, double sweep_rad);

/* By how much the sweep angle must be increased so that the plane of rig_laser_sheet() contains the
 * sheet's light at a point near it: bend_rad·t² / (1 + stretch). 0 for a flat sheet. */
double rig_laser_bent_rad(const struct rig_arc *arc, const struct rig_laser *laser, double arc_rad,
                          struct vec3 point_mm);

/* The sweep angle at which the sheet, bent as it is, contains a point. */
double rig_laser_sweep_rad(const struct rig_arc *arc, const struct rig_laser *laser, double arc_rad,
                           struct vec3 point_mm);

/* Errors of a laser's calibration as they move its sheet near the sample: by how much the sheet is
 * displaced across itself at a point, towards larger sweep angles, is linear in these parameters.
 * Gradients count from the rig's origin. */
enum rig_sheet_parameter {
    RIG_SHEET_OFFSET, /* mm */
    RIG_SHEET_ALONG,  /* rad: by position along the laser's axis */
    RIG_SHEET_ACROSS, /* rad: by position along the sheet's normal at sweep angle 0 */
    RIG_SHEET_BEAM,   /* rad: by position along the beam */
    RIG_SHEET_BEND,   /* of bend_rad */
    RIG_SHEET_PARAMETERS,
};
struct rig_sheet_errors {
    double covariance[RIG_SHEET_PARAMETERS][RIG_SHEET_PARAMETERS];
};

/* The displacement of the sheet at a point, in mm by a unit of each parameter. */
void rig_laser_sheet_lever(const struct rig_arc *arc, const struct rig_laser *laser, double arc_rad,
                           struct vec3 point_mm, double ret[RIG_SHEET_PARAMETERS]);

/* Its standard deviation, √(jᵀ C j) with j the lever. */
double rig_laser_sheet_error_mm(const struct rig_arc *arc, const struct rig_laser *laser,
                                double arc_rad, const struct rig_sheet_errors *errors,
                                struct vec3 point_mm);

/* Free width between the light arc and the cone of sight from a camera to a disc of radius_mm
 * around the origin; negative: the arc stands in the picture. The arc is a half-circle band of
 * arc_radius_mm in the plane of azimuth α, from α over the zenith down to the horizon at α only (a
 * quarter circle). G_MAXDOUBLE if no part of the arc can be in the way. */
double rig_arc_clearance_mm(const struct rig *rig, int camera, double arc_rad, double radius_mm);

/* Spherical angles of a direction: θ from +z in [0, π], φ from +x, counter-clockwise in [0, 2π). */
void rig_angles(struct vec3 direction, double *ret_theta_rad, double *ret_phi_rad);
struct vec3 rig_direction(double theta_rad, double phi_rad);
