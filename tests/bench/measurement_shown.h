/*
 * Determines which lit surface points are visible in a picture. Geometry says whether a laser
 * reaches a point and whether a camera sees it. However, nearly no light of a gap that is narrower
 * than a pixel arrives in the picture. The truth comes from sim/ only.
 */
#pragma once

#include "measurement_rig.h"

struct bench_positions { /* of lasers, as in truth_laser_seen() */
    const double *arc_deg;
    const int *laser;
    int n;
    gint64 exposure_us;
    int threshold_dn;
};

/* Of the texels asked for: 1 where at least one position that lights the point its centre's ray
 * ends on shows, else 0. It shows if a camera without noise has, while the middle of its sheet is
 * on that point, threshold_dn more in the pixel that the ray goes through than with the sheet far
 * away. That pixel only: cameras here do not blur, so its neighbours show what lies next to the
 * point. It may itself show other surface that is lit at the same time; that counts as showing.
 * distance_mm: the truth of each texel. */
void bench_shown(const struct bench_setup *setup, int view, double turntable_deg,
                 const struct bench_positions *positions, const float *distance_mm,
                 const guint8 *asked, guint8 *ret_shown);
