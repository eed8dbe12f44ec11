/*
 * A camera, a line laser and a lamp that are computed by separate formulas, for tests of
 * processing. Nothing here calls calib/.
 */
#pragma once

#include "geometry/rig.h"

#include <math.h>
#include <string.h>

double analytic_dot(const double *a, const double *b);

/* Computes Rz(angle) · (x, y, z). */
void analytic_turn(const double *a, double angle, double *ret);

/* A camera that looks at the origin from a polar angle. */
struct pinhole {
    int width, height;
    double theta, distance_mm, focal_px;
    double azimuth;   /* of the camera, radians */
    double off_px[2]; /* offset of the principal point from the middle of the picture */
    double k1; /* distortion: a point at r from the principal point is shown at r (1 + k1 r²),
                  in focal lengths */
};

void pinhole_eye(const struct pinhole *p, double *eye);
void pinhole_project(const struct pinhole *p, const double *point, double *ret_x, double *ret_y);
void pinhole_ray(const struct pinhole *p, double x, double y, double *ret);
struct rig_camera pinhole_to_rig(const struct pinhole *p, const char *name);

/* A line laser on the arc. At sweep angle 0 its sheet contains the origin. It sweeps about a
 * horizontal axis. */
struct line_laser {
    double theta, distance_mm;
};

void line_laser_position(const struct line_laser *laser, double arc, double *ret);

/* Returns the sweep angle at which the sheet contains a point: the angle between the beam and the
 * line to the point, in the plane perpendicular to the axis. The beam turns about +y, from the side
 * of the zenith to the other side of the sample. */
double line_laser_sweep(const struct line_laser *laser, double arc, const double *point);
struct rig_laser line_laser_to_rig(const struct line_laser *laser, const char *name);

/* A lamp on the arc that aims at the origin. Its intensity decreases with cos^exponent of the angle
 * to the aim. */
struct arc_lamp {
    double theta, distance_mm, intensity;
    double exponent;
};

struct rig_lamp arc_lamp_to_rig(const struct arc_lamp *lamp, const char *name);
