/*
 * A camera, a line laser and a lamp by formulas of their own, for tests of processing: nothing here
 * calls calib/.
 */
#pragma once

#include "geometry/rig.h"

#include <math.h>
#include <string.h>

double analytic_dot(const double *a, const double *b);

/* Rz(angle) applied to (x, y, z). */
void analytic_turn(const double *a, double angle, double *ret);

/* A camera at an angle from the zenith that looks at the origin. */
struct pinhole {
    int width, height;
    double theta, distance_mm, focal_px;
    double azimuth;   /* of the camera, radians */
    double off_px[2]; /* of the principal point from the picture's middle */
    double k1; /* distortion: a point at r from the principal point is shown at r (1 + k1 r²),
                  in focal lengths */
};

void pinhole_eye(const struct pinhole *p, double *eye);
void pinhole_project(const struct pinhole *p, const double *point, double *ret_x, double *ret_y);
void pinhole_ray(const struct pinhole *p, double x, double y, double *ret);
struct rig_camera pinhole_to_rig(const struct pinhole *p, const char *name);

/* A line laser on the arc, whose sheet at sweep 0 goes through the origin and that sweeps about a
 * horizontal axis. */
struct line_laser {
    double theta, distance_mm;
};

void line_laser_position(const struct line_laser *laser, double arc, double *ret);

/* The angle between beam and line of sight to a point, in the plane across the axis: the beam turns
 * about +y, from the zenith's side of the sample to that beyond it. */
double line_laser_sweep(const struct line_laser *laser, double arc, const double *point);
struct rig_laser line_laser_to_rig(const struct line_laser *laser, const char *name);

/* A lamp on the arc, aimed at the origin; next to its aim it falls off with cos^exponent. */
struct arc_lamp {
    double theta, distance_mm, intensity;
    double exponent;
};

struct rig_lamp arc_lamp_to_rig(const struct arc_lamp *lamp, const char *name);
