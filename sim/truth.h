/*
 * The tests' door to the simulated world's own truth: exact distances and reflectances by ray
 * tracing. In a library of its own (mesorig_truth) that only tests and the demo's report link to.
 */
#pragma once

#include "world.h"

struct truth_grid { /* texels of the reference plane, as in processing/pipeline.h, said again */
    int width, height;
    double width_mm, height_mm, reference_mm;
};

/* True position of a camera's centre in the sample frame, for turntable angle commanded, backlash
 * and position errors aside. */
void truth_view_centre_mm(World *world, int camera, double turntable_deg, double ret[3]);

/* Distance in mm along the true viewing ray of each texel's centre from the reference plane to the
 * surface (turntable included); and, if ret_edge is given, whether a depth edge (a step of more
 * than half a texel) lies within one texel. */
void truth_mdf(World *world, int camera, double turntable_deg, const struct truth_grid *grid,
               float *ret_distance_mm, guint8 *ret_edge);

/* How many of the given laser positions (arc angle, laser) light the surface point each texel
 * shows. */
void truth_laser_seen(World *world, int camera, double turntable_deg, const struct truth_grid *grid,
                      const double *arc_deg, const int *laser, int n, guint8 *ret_seen);

/* Reflectance as in processing/pipeline.h, R G B interleaved, averaged over each texel's area with
 * samples² rays. */
void truth_btf(World *world, int camera, int lamp, double turntable_deg, double arc_deg,
               const struct truth_grid *grid, int samples, float *ret_rgb);
