/* Option tables of the sections from which the layout of the rig is read, and the structs that they
 * fill. */
#pragma once

#include "base/options.h"
#include "lamp_places.h"

struct rig_fields {
    char *id, *calibration;
    int clock;
    double calibration_days, arc_radius_mm, arc_width_mm;
    double arm_axis_theta_deg, arm_axis_phi_deg, probe_axis_theta_deg, probe_axis_phi_deg;
};
extern const struct option devices_rig_options[];

struct place_fields { /* place of a lamp, camera, laser or axis */
    char *bank, *sweep, *mount_of;
    int index, width, height;
    double theta_deg, phi_deg, distance_mm, exponent, intensity, focal_px, response;
    double k1, k2, k3, p1, p2, vignetting;
    struct option_doubles arm_deg, probe_deg; /* angles of arm or probe at the stops */
    double park_deg;                          /* only for an axis */
};
extern const struct option devices_lamp_options[], devices_camera_options[],
    devices_laser_options[], devices_mount_options[], devices_axis_options[];

extern const struct option devices_bank_options[];

struct mark_fields {
    double x_mm, y_mm, z_mm, radius_mm;
    struct option_doubles reflectance;
};
extern const struct option devices_mark_options[];
