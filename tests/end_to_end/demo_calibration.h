/*
 * Compares a calibration of a simulated rig, or the rig file, with the truth of the world. The zero
 * of the azimuth is a convention (cameras/cameras.h), so one is first turned to the other.
 */
#pragma once

#include "calibration/calibration.h"
#include "world/truth.h"

struct demo_errors {          /* the worst of all, but for rms and median */
    double camera_px;         /* where points of 50 × 50 × 10 mm are seen, RMS */
    double camera_deg;        /* direction from the origin */
    double camera_pct;        /* distance from there, relative */
    double axis_mm, axis_deg; /* of the turntable */
    double lamp_deg,
        lamp_pct;        /* direction and distance from the origin, at many angles of the arc */
    double arc_zero_deg; /* what all lamps' azimuths are off by together */
    double sheet_deg, sheet_mm;       /* laser sheets, where they go through the sample */
    double light_median, light_worst; /* of what cameras show of white under lamps, relative */
};

/* steps: of which laser sheets are looked at; n of them. */
struct demo_step {
    int laser;
    double arc_deg, sweep_deg;
};

void demo_errors_of(World *world, const struct calibration *calibration,
                    const struct demo_step *steps, int n, struct demo_errors *ret);

/* By how much the sample frame that a calibration has agreed on is turned from the world's. */
double demo_azimuth_rad(World *world, const struct rig *rig);
