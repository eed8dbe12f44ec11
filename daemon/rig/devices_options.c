#include "devices_options.h"

#include "devices_private.h"

#include <string.h>

static const char *const clock_choices[] = {"real", "virtual", NULL};

#define RIG(member) G_STRUCT_OFFSET(struct rig_fields, member)
const struct option devices_rig_options[] = {
    {"id", OPTION_STRING, .offset = RIG(id),
     .help = "Name of this rig; a calibration of another one is refused"},
    {"clock", OPTION_CHOICE, .fallback = "real", .choices = clock_choices, .offset = RIG(clock),
     .help = "Virtual time jumps to the next event; for simulated devices only"},
    {"calibration", OPTION_STRING, .fallback = "", .offset = RIG(calibration),
     .help = "The rig's calibration file, relative to this file; without it, the geometry and "
             "light of this file are used"},
    {"calibration_days", OPTION_DOUBLE, "days", 0, 100000, "30", .offset = RIG(calibration_days),
     .help = "Age from which the calibration of a part causes a warning"},
    {"arc_radius_mm", OPTION_DOUBLE, "mm", 0, 100000, "0", .offset = RIG(arc_radius_mm),
     .help = "Radius of the light arc's inner edge; a rig with [axis arc] must have it"},
    {"arm_axis_theta_deg", OPTION_DOUBLE, "degrees", 0, 180, "90",
     .offset = RIG(arm_axis_theta_deg),
     .help = "Polar angle of the axis of [axis arm]; 0 is straight above, 90 is level. The axis "
             "goes through the middle of the turntable's top, and the arm carries cameras"},
    {"arm_axis_phi_deg", OPTION_DOUBLE, "degrees", -360, 360, "90", .offset = RIG(arm_axis_phi_deg),
     .help = "Azimuth of that axis. The arm turns counter-clockwise, seen from the point to which "
             "the axis points: about an axis at azimuth 90 it lowers a camera at azimuth 0"},
    {"probe_axis_theta_deg", OPTION_DOUBLE, "degrees", 0, 180, "90",
     .offset = RIG(probe_axis_theta_deg),
     .help = "Polar angle of the axis of [axis probe], which carries lamps"},
    {"probe_axis_phi_deg", OPTION_DOUBLE, "degrees", -360, 360, "90",
     .offset = RIG(probe_axis_phi_deg),
     .help = "Azimuth of that axis; if the arc carries the probe, its value with the arc at 0"},
    {"arc_width_mm", OPTION_DOUBLE, "mm", 0, 10000, "0", .offset = RIG(arc_width_mm),
     .help = "Width of the light arc with its lamps, and of lamps and cameras that are not on it; "
             "it determines which rays of cameras and lamps they block"},
    {NULL},
};

#define PLACE(member) G_STRUCT_OFFSET(struct place_fields, member)
#define THETA                                                                                      \
    {                                                                                              \
        "theta_deg", OPTION_DOUBLE, "degrees", 0, 89.9,                                            \
            .offset = PLACE(theta_deg), .help = "Polar angle of its position; 0 is straight above" \
    }
#define DISTANCE                                                                                   \
    {                                                                                              \
        "distance_mm", OPTION_DOUBLE, "mm", 1, 100000,                                             \
            .offset = PLACE(distance_mm),                                                          \
            .help = "Distance from the middle of the turntable's top, at which it points"          \
    }
#define AZIMUTH                                                                                    \
    {                                                                                              \
        "phi_deg", OPTION_DOUBLE, "degrees", -360, 360, "0",                                       \
            .offset = PLACE(phi_deg),                                                              \
            .help = "Azimuth of a fixed position, counter-clockwise seen from above; without "     \
                    "this key the arc carries it"                                                  \
    }

const struct option devices_axis_options[] = {
    {LAYOUT_PARK_KEY, OPTION_DOUBLE, "degrees", -36000, 36000, "0", .offset = PLACE(park_deg),
     .help = "Position to which the axis moves when the queue of sessions is empty; default: the "
             "reference position"},
    {NULL},
};

const struct option devices_lamp_options[] = {
    {"bank", OPTION_STRING, .offset = PLACE(bank), .help = "The lamp bank that switches it"},
    {"index", OPTION_INT, NULL, 0, 1023, .offset = PLACE(index),
     .help = "Its number in the bank, from 0"},
    THETA,
    AZIMUTH,
    DISTANCE,
    {"probe_deg", OPTION_DOUBLES, "degrees", -360, 360, "0", .offset = PLACE(probe_deg),
     .help = "Angles at which [axis probe], which carries it, stops. theta_deg and phi_deg are its "
             "position with that axis at 0. Each stop is a lamp NAME@ANGLE. Without this key it is "
             "fixed"},
    {"exponent", OPTION_DOUBLE, NULL, 0, 1000, "1", .offset = PLACE(exponent),
     .help = "Its intensity falls with this power of the cosine of the angle from its axis"},
    {"intensity", OPTION_DOUBLE, "W/sr", 1e-6, RIG_MAX_INTENSITY, "1", .offset = PLACE(intensity),
     .help = "Radiant intensity along its axis"},
    {NULL},
};

#define BANK(member) G_STRUCT_OFFSET(struct bank_fields, member)
const struct option devices_bank_options[] = {
    {"count", OPTION_INT, NULL, 0, RIG_MAX_LAMPS, "0", .offset = BANK(count),
     .help = "Number of lamps of a dome. They stand on a spiral from theta_from_deg to "
             "theta_to_deg, each with an equal part of that zone of the hemisphere"},
    {"rings", OPTION_STRINGS, .fallback = "", .offset = BANK(rings),
     .help = "Rings of lamps, each as theta:count or theta:count:offset, such as 15:8; 35:16. A "
             "ring begins at azimuth 0, or at its offset, and goes counter-clockwise"},
    {"theta_deg", OPTION_DOUBLES, "degrees", 0, 89.9, "", .offset = BANK(theta_deg),
     .help = "Polar angles of the lamps of an arc. They all have the azimuth phi_deg; without "
             "phi_deg they are on the axis arc"},
    {"positions", OPTION_STRING, .fallback = "", .offset = BANK(positions),
     .help = "A file with the positions of the lamps, relative to this file: a list FILE.lp, or a "
             "table in CSV"},
    {"theta_from_deg", OPTION_DOUBLE, "degrees", 0, 89.9, "0", .offset = BANK(theta_from_deg),
     .help = "With count: upper edge of the zone; a camera overhead needs some degrees"},
    {"theta_to_deg", OPTION_DOUBLE, "degrees", 0, 89.9, "80", .offset = BANK(theta_to_deg),
     .help = "With count: lower edge of the zone"},
    {"phi_deg", OPTION_DOUBLE, "degrees", -360, 360, "0", .offset = BANK(phi_deg),
     .help = "Added to the azimuth of all lamps"},
    {"distance_mm", OPTION_DOUBLE, "mm", 0, 100000, "0", .offset = BANK(distance_mm),
     .help = "Radius of the dome, rings or arc: distance of the lamps from the middle of the "
             "turntable's top, at which they point. Must be given, except with positions in mm"},
    {"first_index", OPTION_INT, NULL, 0, 1023, "0", .offset = BANK(first_index),
     .help = "Number of the first of these lamps in the bank, from 0; the others follow it"},
    {"exponent", OPTION_DOUBLE, NULL, 0, 1000, "1", .offset = BANK(exponent),
     .help = "As in [lamp NAME], for all lamps"},
    {"intensity", OPTION_DOUBLE, "W/sr", 1e-6, RIG_MAX_INTENSITY, "1", .offset = BANK(intensity),
     .help = "As in [lamp NAME], for all lamps"},
    {NULL},
};

const struct option devices_camera_options[] = {
    THETA,
    {"phi_deg", OPTION_DOUBLE, "degrees", -360, 360, .offset = PLACE(phi_deg),
     .help = "Azimuth of its position, counter-clockwise seen from above; for a camera overhead, "
             "its rotation"},
    DISTANCE,
    {"arm_deg", OPTION_DOUBLES, "degrees", -360, 360, "0", .offset = PLACE(arm_deg),
     .help = "Angles at which [axis arm], which carries it, stops. theta_deg and phi_deg are its "
             "position with that axis at 0. Each stop is a camera NAME@ANGLE. Without this key it "
             "is fixed"},
    {"width", OPTION_INT, "px", 1, 65536, .offset = PLACE(width), .help = "Width of its pictures"},
    {"height", OPTION_INT, "px", 1, 65536, .offset = PLACE(height),
     .help = "Height of its pictures"},
    {"focal_px", OPTION_DOUBLE, "px", 1, 1e6, .offset = PLACE(focal_px), .help = "Focal length"},
    {"response", OPTION_DOUBLE, "DN/s per W/(sr m²)", RIG_MIN_RESPONSE, RIG_MAX_RESPONSE, "1",
     .offset = PLACE(response),
     .help = "Counts per second for a radiance of one, at a gain of 0 dB"},
    {"k1", OPTION_DOUBLE, NULL, -100, 100, "0", .offset = PLACE(k1), .help = "Radial distortion"},
    {"k2", OPTION_DOUBLE, NULL, -100, 100, "0", .offset = PLACE(k2), .help = "Radial distortion"},
    {"k3", OPTION_DOUBLE, NULL, -100, 100, "0", .offset = PLACE(k3), .help = "Radial distortion"},
    {"p1", OPTION_DOUBLE, NULL, -10, 10, "0", .offset = PLACE(p1), .help = "Tangential distortion"},
    {"p2", OPTION_DOUBLE, NULL, -10, 10, "0", .offset = PLACE(p2), .help = "Tangential distortion"},
    {"vignetting", OPTION_DOUBLE, NULL, 0, 0.99, "0", .offset = PLACE(vignetting),
     .help = "Part of the response that is lost in the corners"},
    {NULL},
};

const struct option devices_laser_options[] = {
    {"sweep", OPTION_STRING, .offset = PLACE(sweep), .help = "The axis that sweeps its line"},
    {"mount_of", OPTION_STRING, .fallback = "", .offset = PLACE(mount_of),
     .help = "The laser that is mounted here by hand; such a section gives only the place"},
    THETA,
    AZIMUTH,
    DISTANCE,
    {NULL},
};

const struct option devices_mount_options[] = {
    {"mount_of", OPTION_STRING, .offset = PLACE(mount_of),
     .help = "The laser that is mounted here by hand"},
    THETA,
    AZIMUTH,
    DISTANCE,
    {NULL},
};

#define MARK(member) G_STRUCT_OFFSET(struct mark_fields, member)
const struct option devices_mark_options[] = {
    {"x_mm", OPTION_DOUBLE, "mm", -10000, 10000, .offset = MARK(x_mm),
     .help = "x of its middle, with the turntable at 0"},
    {"y_mm", OPTION_DOUBLE, "mm", -10000, 10000, .offset = MARK(y_mm),
     .help = "y of its middle, with the turntable at 0"},
    {"z_mm", OPTION_DOUBLE, "mm", -1000, 1000, "0", .offset = MARK(z_mm),
     .help = "Height of its face above the turntable's top"},
    {"radius_mm", OPTION_DOUBLE, "mm", 0.1, 1000, .offset = MARK(radius_mm),
     .help = "Radius of its face"},
    {"reflectance", OPTION_DOUBLES, NULL, 0.01, 2, "0.9", .offset = MARK(reflectance),
     .help = "Reflectance of its face: one value, or three for red, green and blue"},
    {NULL},
};

const struct option *devices_section_options(const char *class_name) {
    static const struct {
        const char *class_name;
        const struct option *options;
    } tables[] = {{"rig", devices_rig_options},       {"axis", devices_axis_options},
                  {"lamps", devices_bank_options},    {"lamp", devices_lamp_options},
                  {"camera", devices_camera_options}, {"laser", devices_laser_options},
                  {"mark", devices_mark_options}};

    for (gsize i = 0; i < G_N_ELEMENTS(tables); i++)
        if (g_str_equal(class_name, tables[i].class_name))
            return tables[i].options;
    return NULL;
}
