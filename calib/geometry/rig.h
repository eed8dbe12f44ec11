/*
 * This module has the geometry of a rig: the positions of cameras, lamps, lasers and axes, and
 * functions of these positions. Nominal values come from the rig file, and measured values from
 * calibration. Both are kept in struct rig and in its file format.
 *
 * The rig frame is right-handed and in millimetres. Its origin is on the turntable's axis in the
 * plane of the turntable's top, and z is up. The sample frame rotates with the turntable. At the
 * turntable angle τ (counter-clockwise seen from above) a point p of the sample frame is at Rz(τ) p
 * in the rig frame, if the bearing is perfect (struct rig_wobble). In the sample frame, a fixed
 * camera at azimuth φ_c is at φ_c − τ, a lamp on the arc at arc angle α is at α − τ, and a lamp
 * that stands by itself at azimuth φ_l is at φ_l − τ.
 *
 * A rig need not have a turntable or an arc. An axis that the rig does not have stands at 0.
 *
 * A camera arm is an axis that carries cameras, and a light probe is an axis that carries lamps.
 * They stop at the angles that the rig file lists. Here each stop of a camera (or lamp) counts as a
 * separate camera (or lamp), named NAME@ANGLE, whose position is calibrated separately. The stops
 * of one device follow each other. See swing.h.
 *
 * The functions are pure, and any thread may call them.
 */
#pragma once

#include <glib.h>

#include "base/camera_set.h"
#include "base/vec.h"
#include "lens.h"

#define RIG_MAX_CAMERAS   CAMERA_SET_MAX /* each stop counts */
#define RIG_MAX_LAMPS     1024           /* each stop counts */
#define RIG_MIN_RESPONSE  1e-6 /* smallest response that a rig file may give, DN/s per W/(sr m²) */
#define RIG_MAX_RESPONSE  1e12
#define RIG_MAX_INTENSITY 1e6  /* largest radiant intensity of a lamp, W/sr */
#define RIG_MAX_STRETCH   0.5  /* largest absolute value of rig_laser.stretch */
#define RIG_MAX_BEND      1.0  /* largest absolute value of rig_laser.bend_rad */
#define RIG_MAX_LATERAL   0.05 /* largest absolute value of rig_camera.lateral_colour */
#define RIG_MAX_LASERS    16
#define RIG_MAX_FIDUCIALS 16
#define RIG_NAME          32

struct rig_camera {
    char name[RIG_NAME];
    int width, height;
    int lens; /* enum rig_lens */
    double fx_px, fy_px, cx_px, cy_px;
    double k1, k2, k3, p1, p2, k4, k5, k6;
    /* Relative excess of the magnification of red, green and blue light about (cx, cy), within ±
     * RIG_MAX_LATERAL. It is relative to the parameters above, which hold for the mean over the
     * pixels of all colours. 0 means that there is no lateral colour, or that it is unknown. */
    double lateral_colour[3];
    struct mat3 rotation; /* camera = rotation · rig + translation_mm */
    struct vec3 translation_mm;
    double vignetting; /* relative response 1 − vignetting·(r/r_corner)², r from (cx, cy) */
    double response; /* DN per second per W·sr⁻¹·m⁻² of radiance, before vignetting, at 0 dB */
    /* 1 if the camera arm carries the camera; the pose above is then for the arm at arm_deg */
    int on_arm;
    double arm_deg;
    int stop; /* number of the stop within its device, from 0; 0 if the device has only one */
};

/* The true rotation of the light arc. At arc angle α the arc is rotated by α + zero about an axis
 * through centre_mm. The direction of this axis is the rig's z, rotated by the rotation vector
 * (tilt_x, tilt_y, 0). If all values are 0, the arc turns about the turntable's axis, as
 * designed. */
struct rig_arc {
    double zero_rad;
    double tilt_rad[2];
    double centre_mm[2]; /* intersection of the axis with z = 0 */
};

/* A lamp on the light arc, or a lamp that stands by itself (fixed). The position and aim of a lamp
 * on the arc are given in the arc's frame, in which the arc stands over +x. The position and aim of
 * a fixed lamp are given in the rig frame. The radiant intensity in the direction d is intensity ·
 * max(0, cos(d, aim))^exponent. */
struct rig_lamp {
    char name[RIG_NAME];
    struct vec3 position_mm;
    struct vec3 aim; /* unit */
    double exponent;
    double intensity; /* W·sr⁻¹ along aim */
    int fixed;        /* 1 if the lamp stands by itself, so that the arc does not move it */
    /* 1 if the probe carries the lamp; the position above is then for probe_deg */
    int on_probe;
    double probe_deg;
    int stop; /* number of the stop within its device, from 0; 0 if the device has only one */
};

/* A line laser on the light arc, or one that stands by itself (fixed): a sheet of light through
 * position_mm that rotates about an axis in the sheet. At the sweep angle s the normal of the sheet
 * is `normal` rotated about axis by s·(1 + stretch) (right-handed). All values are in the frame of
 * the carrier, as for a lamp.
 *
 * The optics that spread a beam to a line also bend the line, so that rays at an angle to the
 * middle of the line leave the plane. Let t be the tangent of the angle between a ray and the
 * middle of the sheet, seen along the normal. For a point at the distance a along the axis from the
 * laser, and at the distance r from the axis, t = a / r. The ray is the ray of the plane, rotated
 * about the axis by bend_rad·t² (right-handed). A parabola with another vertex differs from this
 * one by a rotation about the beam and by another zero, which axis and normal describe. */
struct rig_laser {
    char name[RIG_NAME];
    struct vec3 position_mm;
    /* Unit vector. Nominally it is horizontal and perpendicular to the azimuth of the laser, so
     * that the line lies across the sweep. */
    struct vec3 axis;
    /* Unit, perpendicular to axis: the normal at s = 0. Nominally, the sheet goes through the
     * origin at s = 0. */
    struct vec3 normal;
    /* Relative excess of the true over the commanded sweep angle, within ± RIG_MAX_STRETCH. */
    double stretch;
    double bend_rad; /* within ± RIG_MAX_BEND; 0 if the sheet is a plane */
    int fixed;
};

/* A fiducial: a matt white disc that lies level next to the sample and is fixed to the turntable.
 * Its pictures show the output of a lamp, and whether a camera or the turntable's zero has moved
 * (fiducials.h). */
struct rig_fiducial {
    char name[RIG_NAME];
    struct vec3 centre_mm; /* centre of its face, sample frame */
    double radius_mm;
    double reflectance[3]; /* for the cameras' red, green and blue */
};

/* The axis of a camera arm, in the rig frame, or of a light probe, in the frame of its lamps. The
 * axis is a line. The carried devices turn about this line by the angle of the arm or probe
 * (right-handed). */
struct rig_swing {
    struct vec3 axis; /* unit; 0 if the rig has no arm or probe */
    struct vec3 centre_mm;
};

#define RIG_WOBBLE_HARMONICS 4
#define RIG_MAX_WOBBLE_RAD   0.02 /* largest absolute value of a coefficient */

/* The wobble of the turntable's bearing. The axis is tilted by a rotation W(τ) with the rotation
 * vector (x, y, 0), which is a function of the turntable's angle τ. A point p of the sample is at
 * W(τ) Rz(τ) p. Harmonic k = 1, 2, … adds c cos kτ + s sin kτ to x, with c in [0] and s in [1]. The
 * coefficients of y are in [2] and [3]. There is no harmonic 0, because the axis of the rig frame
 * is the mean axis. If all coefficients are 0, the bearing is perfect. */
struct rig_wobble {
    double rad[RIG_WOBBLE_HARMONICS][4];
};

struct rig {
    char id[64]; /* identifies the rig; a calibration with another id is refused */
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
    double arc_radius_mm; /* radius of the arc's inner edge; 0 if there is no arc */
    double arc_width_mm;  /* width of arc and lamps, which may hide a part of a picture */
};

/* rig_camera_unit() returns the index of the first stop of the device to which a camera belongs.
 * rig_lamp_unit() does the same for a lamp. Cameras (or lamps) with the same result are stops of
 * one device. */
static inline int rig_camera_unit(const struct rig *rig, int camera) {
    return camera - rig->cameras[camera].stop;
}
static inline int rig_lamp_unit(const struct rig *rig, int lamp) {
    return lamp - rig->lamps[lamp].stop;
}

/* Returns the angle of the arm while a set of cameras takes pictures. All cameras of the set that
 * the arm carries must have the same angle. If the arm carries no camera of the set, the arm stands
 * at the first stop of the rig. Returns 0 if there is no arm. */
double rig_arm_deg(const struct rig *rig, struct camera_set cameras);
/* Returns the angle of the light probe while a lamp is lit: that of the lamp if the probe carries
 * it, and otherwise that of the first stop of the rig. Returns 0 if there is no probe. lamp is −1
 * if no lamp is used. */
double rig_probe_deg(const struct rig *rig, int lamp);

/* Writes the name of the device to ret: NAME for a camera or lamp NAME@ANGLE that is carried, and
 * otherwise the name itself. */
void rig_stop_device(const char *name, int is_carried, char ret[RIG_NAME]);

#define RIG_ERROR rig_error_quark()
GQuark rig_error_quark(void);
enum rig_error {
    RIG_ERROR_FORMAT, /* not a calibration file, or of another version */
    RIG_ERROR_VALUE,  /* a value is missing, not finite, or out of range */
};

/* Returns the text of the key file "calibration.conf". Numbers are restored bit for bit. Free it
 * with g_free(). */
char *rig_to_text(const struct rig *rig);
/* Reads the text of rig_to_text(). Returns FALSE with RIG_ERROR, which names path ("calibration"
 * if it is NULL). On failure rig is not changed. */
gboolean rig_from_text(struct rig *rig, const char *text, const char *path, GError **error);

/* Places a camera at eye_mm so that it looks at target_mm, both in the rig frame. The picture is
 * upright: its x axis is horizontal. */
void rig_camera_look_at(struct rig_camera *camera, struct vec3 eye_mm, struct vec3 target_mm);

struct vec3 rig_camera_centre_mm(const struct rig_camera *camera);

/* Returns the camera for light of one colour (0 … 2: red, green, blue), whose focal length includes
 * the lateral colour. */
struct rig_camera rig_camera_of_colour(const struct rig_camera *camera, int colour);

/* Projects a point of the rig frame. The result may be outside of the picture. Returns FALSE if the
 * point is behind the camera (a fisheye also sees to its side and behind itself), or if it is so
 * far from the axis that the lens model folds back. */
gboolean rig_project(const struct rig_camera *camera, struct vec3 point_mm, double *ret_x_px,
                     double *ret_y_px);

/* Returns the viewing ray of a pixel, a unit vector from the camera's centre in the rig frame. The
 * lens model is inverted to 1e-9 px. Beyond the largest radius of a fisheye, the ray at that radius
 * is returned. */
struct vec3 rig_pixel_ray(const struct rig_camera *camera, double x_px, double y_px);

/* Rotates about z. The angle +τ converts from the sample to the rig frame, and −τ from the rig to
 * the sample frame. */
struct vec3 rig_turn(struct vec3 v, double angle_rad);

/* rig_rotate(rig_rotation(a), v) has the same result as rig_turn(v, a). It saves time if many
 * points are rotated by the same angle, because rig_rotation() is then called only once. */
struct rig_rotation {
    double cosine, sine;
};
struct rig_rotation rig_rotation(double angle_rad);
static inline struct vec3 rig_rotate(struct rig_rotation by, struct vec3 v) {
    return vec3(by.cosine * v.x - by.sine * v.y, by.sine * v.x + by.cosine * v.y, v.z);
}

/* The wobble tilts the axis of the turntable by a rotation vector (x, y, 0), which depends on the
 * angle of the turntable. rig_wobble_tilt() writes x and y at an angle. rig_wobble_most_rad()
 * returns the largest length of the vector in a turn. It looks at every degree. */
void rig_wobble_tilt(const struct rig_wobble *wobble, double turntable_rad, double ret_rad[2]);
double rig_wobble_most_rad(const struct rig_wobble *wobble);

/* Returns the rig with the turntable at an angle, in the frame in which the tilted axis is z.
 * Cameras, the arc, the axes of arm and probe, and devices that stand by themselves are tilted back
 * by the wobble. In this frame the sample turns only by Rz, and an object that lies flat on the
 * turntable is level. The arc's tilt is corrected to first order only: the wobble's tilt is
 * subtracted. The error of this is below 1 µm for wobbles below 0.1°. ret may be rig. */
void rig_at(const struct rig *rig, double turntable_rad, struct rig *ret);

/* Rotates a point or direction by a tilt: to W v if sign is 1, and to W⁻¹ v if sign is −1. */
struct vec3 rig_tilt_point(const double tilt_rad[2], struct vec3 v, double sign);

/* Converts a point from the sample frame to the rig frame. The wobble of the turntable is taken
 * into account. */
struct vec3 rig_sample_point(const struct rig *rig, double turntable_rad, struct vec3 point_mm);

/* rig_arc_point() and rig_arc_direction() transform from the arc's frame at the angle arc_rad to
 * the rig frame. rig_arc_point_back() transforms from the rig frame to the arc's frame. Here and
 * below, arc may be NULL, which means an ideal arc. */
struct vec3 rig_arc_point(const struct rig_arc *arc, double arc_rad, struct vec3 point_mm);
struct vec3 rig_arc_direction(const struct rig_arc *arc, double arc_rad, struct vec3 direction);
struct vec3 rig_arc_point_back(const struct rig_arc *arc, double arc_rad, struct vec3 point_mm);

/* Returns a lamp's position in the rig frame with the arc at an angle. The angle has no effect for
 * fixed lamps. */
struct vec3 rig_lamp_position_mm(const struct rig_arc *arc, const struct rig_lamp *lamp,
                                 double arc_rad);
/* Returns the unit vector of a lamp's aim in the rig frame with the arc at an angle. */
struct vec3 rig_lamp_aim(const struct rig_arc *arc, const struct rig_lamp *lamp, double arc_rad);
/* Transforms a point of the rig frame to the frame in which the lamp's position is given. */
struct vec3 rig_lamp_point_back(const struct rig_arc *arc, const struct rig_lamp *lamp,
                                double arc_rad, struct vec3 point_mm);

/* Returns the irradiance at a point, on a plane perpendicular to the direction of the lamp, in
 * W·m⁻². It is 0 behind the lamp. */
double rig_lamp_irradiance(const struct rig_arc *arc, const struct rig_lamp *lamp, double arc_rad,
                           struct vec3 point_mm);

/* Returns the lamp as it stands with the arc at an angle: a fixed lamp with exactly the same light.
 * Computing this once saves time if there are many points at the same angle. */
struct rig_lamp rig_lamp_placed(const struct rig_arc *arc, const struct rig_lamp *lamp,
                                double arc_rad);

struct vec3 rig_laser_position_mm(const struct rig_arc *arc, const struct rig_laser *laser,
                                  double arc_rad);
struct vec3 rig_laser_axis(const struct rig_arc *arc, const struct rig_laser *laser,
                           double arc_rad);

/* Returns the laser as it stands with the arc at an angle: a fixed laser with the same sheets.
 * Computing this once saves time if there are many points at the same angle. */
struct rig_laser rig_laser_placed(const struct rig_arc *arc, const struct rig_laser *laser,
                                  double arc_rad);

/* A plane: the points p of the rig frame with normal · p = offset_mm. rig_laser_sheet() returns the
 * plane of a laser's sheet of light, without the bend of the sheet. */
struct rig_plane {
    struct vec3 normal; /* unit */
    double offset_mm;
};
struct rig_plane rig_laser_sheet(const struct rig_arc *arc, const struct rig_laser *laser,
                                 double arc_rad, double sweep_rad);

/* Returns the angle by which the sweep angle must be increased so that the plane of
 * rig_laser_sheet() contains the light of the bent sheet at a point near the plane: bend_rad·t² /
 * (1 + stretch), with the t of struct rig_laser. It is 0 for a flat sheet. */
double rig_laser_bent_rad(const struct rig_arc *arc, const struct rig_laser *laser, double arc_rad,
                          struct vec3 point_mm);

/* Returns the sweep angle at which the bent sheet contains a point. */
double rig_laser_sweep_rad(const struct rig_arc *arc, const struct rig_laser *laser, double arc_rad,
                           struct vec3 point_mm);

/* A laser with the arc at an angle. The functions rig_laser_pose_…() return exactly the values of
 * the functions rig_laser_…(), but take the sines and cosines of the arc's angle only once for many
 * points. laser is not copied.
 *
 * position_mm, axis and normal are in the rig frame. normal is that of the sheet at sweep angle 0.
 * across is axis × normal in the frame of the laser's carrier, which is the arc or the rig. */
struct rig_arc_pose {
    struct rig_rotation turn;
    struct rig_tilt {
        struct vec3 axis;
        double cosine, sine;
    } tilt;
    struct vec3 centre_mm;
};
struct rig_laser_pose {
    const struct rig_laser *laser;
    struct rig_arc_pose arc;
    struct vec3 position_mm, axis, normal, across;
};
struct rig_laser_pose rig_laser_pose(const struct rig_arc *arc, const struct rig_laser *laser,
                                     double arc_rad);
struct rig_plane rig_laser_pose_sheet(const struct rig_laser_pose *pose, double sweep_rad);
double rig_laser_pose_bent_rad(const struct rig_laser_pose *pose, struct vec3 point_mm);
double rig_laser_pose_sweep_rad(const struct rig_laser_pose *pose, struct vec3 point_mm);

/* Parameters of the errors of a laser's calibration near the sample. The displacement of the sheet
 * at a point, perpendicular to the sheet and towards larger sweep angles, is linear in these
 * parameters. The gradients are relative to the rig's origin. */
enum rig_sheet_parameter {
    RIG_SHEET_OFFSET, /* constant displacement, mm */
    RIG_SHEET_ALONG,  /* gradient along the laser's axis, rad */
    RIG_SHEET_ACROSS, /* gradient along the sheet's normal at sweep angle 0, rad */
    RIG_SHEET_BEAM,   /* gradient along the beam, rad */
    RIG_SHEET_BEND,   /* error of bend_rad */
    RIG_SHEET_PARAMETERS,
};
/* Covariance of the parameters of a sheet, in the order of enum rig_sheet_parameter. */
struct rig_sheet_errors {
    double covariance[RIG_SHEET_PARAMETERS][RIG_SHEET_PARAMETERS];
};

/* Both functions compute the lever: the displacement of the sheet at a point, in mm per unit of
 * each parameter. rig_laser_pose_lever() does so for a struct rig_laser_pose. */
void rig_laser_sheet_lever(const struct rig_arc *arc, const struct rig_laser *laser, double arc_rad,
                           struct vec3 point_mm, double ret[RIG_SHEET_PARAMETERS]);

void rig_laser_pose_lever(const struct rig_laser_pose *pose, struct vec3 point_mm,
                          double ret[RIG_SHEET_PARAMETERS]);

/* Returns the standard deviation, in mm, of the displacement of the sheet at a point: √(jᵀ C j)
 * with the lever j and the covariance C. */
double rig_laser_sheet_error_mm(const struct rig_arc *arc, const struct rig_laser *laser,
                                double arc_rad, const struct rig_sheet_errors *errors,
                                struct vec3 point_mm);

/* Returns the free width, in mm, between the light arc and the cone of sight from a camera to a
 * disc of radius_mm around the origin. This width is negative if the arc stands in the way. With α
 * = arc_rad, the arc is a band with the radius arc_radius_mm in the vertical plane of azimuth α. It
 * is a quarter circle, from the zenith down to the horizon at azimuth α. Returns G_MAXDOUBLE if no
 * part of the arc can be in the way. */
double rig_arc_clearance_mm(const struct rig *rig, int camera, double arc_rad, double radius_mm);

/* Convert between a direction and its spherical angles: θ from +z in [0, π], and φ from +x,
 * counter-clockwise in [0, 2π). */
void rig_angles(struct vec3 direction, double *ret_theta_rad, double *ret_phi_rad);
struct vec3 rig_direction(double theta_rad, double phi_rad);
