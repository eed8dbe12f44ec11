/*
 * This module computes the ray optics of the simulated rig, with the true lenses, lamps and laser
 * sheets. The code is written independently of calib/, so that an error in either of them shows as
 * a difference.
 *
 * Units are millimetres and radians. Positions are in the rig frame, or in a frame that is turned
 * about z. The functions are pure, except that optics_sense() fills a table at its first call.
 */
#pragma once

#include "drivers/frame.h"

#include <math.h>

struct v3 {
    double x, y, z;
};

static inline struct v3 v3(double x, double y, double z) {
    return (struct v3){x, y, z};
}
static inline struct v3 v3_mad(struct v3 a, double s, struct v3 b) { /* a·s + b */
    return v3(a.x * s + b.x, a.y * s + b.y, a.z * s + b.z);
}
static inline struct v3 v3_minus(struct v3 a, struct v3 b) {
    return v3(a.x - b.x, a.y - b.y, a.z - b.z);
}
static inline double v3_dot(struct v3 a, struct v3 b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
static inline struct v3 v3_cross(struct v3 a, struct v3 b) {
    return v3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}
static inline struct v3 v3_norm(struct v3 a) {
    double s = 1 / sqrt(v3_dot(a, a));
    return v3(a.x * s, a.y * s, a.z * s);
}
static inline struct v3 v3_turn_z(struct v3 a, double c, double s) {
    return v3(c * a.x - s * a.y, s * a.x + c * a.y, a.z);
}

struct optics_camera {
    int width, height, bits;
    enum cfa cfa;
    double focal_px, centre_x_px, centre_y_px; /* (0, 0) is the centre of the top left pixel */
    /* distorted = ideal·(1 + k1 r² + k2 r⁴) + a tangential part with p1 and p2. r is the tangent of
     * the angle to the optical axis. */
    double k1, k2, p1, p2;
    struct v3 centre_mm, right, down, forward;
    double blur_px; /* standard deviation of the blur of the lens */
    /* The response is multiplied by 1 − vignetting·(r/r_corner)². r is measured from
     * (centre_x_px, centre_y_px). */
    double vignetting;
    /* the response is proportional to cos^falloff of the angle to the optical axis */
    double falloff;
    double response;  /* DN·s⁻¹ per W·sr⁻¹·m⁻² on the axis at 0 dB */
    double colour[3]; /* relative response behind each filter */
    double black_level, full_well_e, read_noise_e;
    /* of the sensor: a linear value x reads as x·(1 − curvature·x/(full scale − black)) */
    double curvature;
    /* Lateral chromatic aberration: the picture in red light is magnified by 1 + lateral_colour,
     * and the picture in blue light by 1 − lateral_colour. */
    double lateral_colour;
    double veiling_glare; /* share of the picture's mean light that is added to every pixel */
    /* share by which the signal is larger in the right half of the sensor */
    double half_gain_step;
    double column_offset; /* standard deviation of the columns' offsets, as a share of full scale */
    guint64 columns_key;  /* seed of the columns' offsets */
};

/* Places a camera at a point so that it looks at the origin. The camera's vector `right` is e_φ at
 * this point: the direction in which the azimuth φ increases. */
void optics_camera_place(struct optics_camera *camera, double theta, double phi,
                         double distance_mm);

/* Turns the camera about its vectors right, down and forward, in this order. */
void optics_camera_turn(struct optics_camera *camera, double rx, double ry, double rz);

/* Returns the vector a turned by an angle about a unit axis. */
struct v3 optics_spin(struct v3 a, struct v3 axis, double angle);

/* Returns the magnification of the picture in a given light, relative to the picture in green
 * light. weights are the relative responses of the red, green and blue filters to this light. For
 * example, (1, 0, 0) is light that passes only the red filter. */
double optics_magnification(const struct optics_camera *camera, const double weights[3]);

/* Returns the unit viewing ray through a point of the picture, for green light. */
struct v3 optics_ray(const struct optics_camera *camera, double x_px, double y_px);

/* Returns the response at a point of the picture behind a filter, in DN·s⁻¹ per W·sr⁻¹·m⁻². */
double optics_response(const struct optics_camera *camera, double x_px, double y_px,
                       enum cfa_colour colour);

/* The true rotation of the light arc. At the arc angle α, the arc has a frame with its origin at
 * centre_mm. The axes of the frame are x, y and z, turned by α + zero about z. */
struct optics_arc {
    double zero;
    struct v3 centre_mm, x, y, z; /* `x`, `y`, `z` are perpendicular unit vectors */
    gboolean crooked;             /* the arc deviates from its nominal axis */
};

/* Tilts the axis z of the arc: by the angle towards_x towards x, and by the angle towards_y towards
 * y. */
void optics_arc_lean(struct optics_arc *arc, double towards_x, double towards_y);
struct v3 optics_arc_direction(const struct optics_arc *arc, double angle, struct v3 v);
struct v3 optics_arc_point(const struct optics_arc *arc, double angle, struct v3 p);

/* The movement of a camera arm with its cameras, or of a light probe with its lamps. Cameras or
 * lamps turn about a line. The angle is that of the arm or probe + zero. */
struct optics_swing {
    struct v3 axis, centre_mm; /* the line has the direction `axis` and goes through centre_mm */
    double zero;
};
struct v3 optics_swing_direction(const struct optics_swing *swing, double angle, struct v3 v);
struct v3 optics_swing_point(const struct optics_swing *swing, double angle, struct v3 p);

struct optics_lamp {
    struct v3 position_mm, aim; /* aim is a unit vector */
    /* `intensity`: radiant intensity along `aim`, in W·sr⁻¹. In other directions, it is multiplied
     * by cos^exponent of the angle to `aim`. */
    double exponent, intensity;
};

/* Returns the irradiance on a surface that faces the lamp, in W·m⁻². */
double optics_lamp_irradiance(const struct optics_lamp *lamp, struct v3 point_mm);

/* A sheet of light that turns about a line. The line goes through position_mm and has the direction
 * `axis`. At the sweep angle `start`, the sheet contains `forward`, and its normal is axis ×
 * forward. */
struct optics_laser {
    struct v3 position_mm, axis, forward; /* `axis` and `forward` are perpendicular unit vectors */
    double start;                         /* sweep angle at which the sheet contains `forward` */
    double sigma; /* standard deviation of the Gaussian profile, as a sweep angle */
    double fan;   /* full angle of the sheet, within which the light is even */
    double power_w;
    /* response of the three filters to the laser's wavelength, relative to white light */
    double colour[3];
    /* Curvature of the sheet, in radians. Let t be the tangent of an angle from `forward`, measured
     * in the sheet. At this angle, the sheet lies as if it had turned further by bend·t². */
    double bend;
};

/* Returns the sweep angle at which the middle of the sheet's profile goes through point_mm. */
double optics_laser_angle(const struct optics_laser *laser, struct v3 point_mm);

/* Returns the irradiance at the middle of the laser's line, on a surface that faces the laser, in
 * W·m⁻². Returns 0 outside of the fan. */
double optics_laser_peak(const struct optics_laser *laser, struct v3 point_mm);

/* Adds the light that lens and sensor scatter over the whole picture. Each pixel gets veiling_glare
 * times the mean of all pixels behind the same filter. */
void optics_add_glare(const struct optics_camera *camera, float *rate);

/* Sets ret_pixels to what a sensor reads, in DN, for a picture of rates in DN·s⁻¹. This includes
 * photon and read noise, black level, offsets of columns, gain of the two halves, saturation and
 * ADC.
 *
 * If rate is NULL, the picture is dark. If noise is FALSE, there is no photon noise and no read
 * noise. key is the seed of the random numbers. */
void optics_sense(const struct optics_camera *camera, const float *rate, double exposure_s,
                  double gain_db, gboolean noise, guint64 key, guint16 *ret_pixels);
