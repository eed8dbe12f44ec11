/*
 * The true values of the simulated world for tests: exact distances and reflectances by ray
 * tracing. They are in a separate library (mesorig_truth), to which only tests and the demo's
 * report link. The camera arm and the light probe are where world_set_arm() and world_set_probe()
 * have put them.
 */
#pragma once

#include "world.h"

/* texels of the reference plane. The struct is defined again, because the simulation shares no code
 * with processing. */
struct truth_grid {
    int width, height;
    double width_mm, height_mm, reference_mm;
};

/* Gives the true position of a camera's centre in the sample frame, at the commanded turntable
 * angle. Backlash and position errors are ignored. */
void truth_view_centre_mm(World *world, int camera, double turntable_deg, double ret[3]);

/* Gives the position in the rig frame of a point of the sample frame with the turntable at an
 * angle, including the wobble of its bearing. */
void truth_to_rig(World *world, double turntable_deg, const double sample_mm[3],
                  double ret_rig_mm[3]);

/* The true parameters of a camera, in the rig frame. */
struct truth_camera {
    double centre_mm[3], right[3], down[3], forward[3];
    double focal_px, centre_px[2], k1, k2, p1, p2;
};
void truth_camera(World *world, int camera, struct truth_camera *ret);

/* Projects a point of the rig frame by the true camera, for green light. The point may be hidden or
 * outside of the picture. */
void truth_project(World *world, int camera, const double point_mm[3], double ret_xy_px[2]);

struct truth_arc {       /* the true axis of the arc, in the rig frame */
    double zero_deg;     /* added to the arc's angle */
    double axis[3];      /* unit vector, upwards */
    double centre_mm[3]; /* intersection of the axis with z = 0 */
};
void truth_arc(World *world, struct truth_arc *ret);

/* A camera arm in the rig frame, or a light probe in the frame of its lamps. */
struct truth_swing {
    double zero_deg;     /* added to its angle */
    double axis[3];      /* unit vector; the devices on it turn counter-clockwise about it */
    double centre_mm[3]; /* a point of the axis */
};
void truth_arm(World *world, struct truth_swing *ret);
void truth_probe(World *world, struct truth_swing *ret);

/* Give the true positions of a lamp, or of a laser sheet, with the arc at an angle, in the rig
 * frame. Backlash and position errors are ignored. ret_aim may be NULL. */
void truth_lamp(World *world, int lamp, double arc_deg, double ret_position_mm[3],
                double ret_aim[3]);
/* Returns a camera's signal for a horizontal white diffuser at a point of the rig frame, under a
 * lamp at full output: DN per second behind the filter of a colour (0 … 2: red, green, blue). */
double truth_white(World *world, int camera, int lamp, double arc_deg, const double point_mm[3],
                   int colour);

/* points p with normal · p = offset_mm; a bent sheet touches this plane in its middle */
struct truth_sheet {
    double normal[3], offset_mm;
    double source_mm[3], axis[3]; /* the axis about which the sheet turns contains the source */
};
void truth_laser_sheet(World *world, int laser, double arc_deg, double sweep_deg,
                       struct truth_sheet *ret);
/* Returns the sweep angle at which the middle of a laser's line goes through a point of the rig
 * frame. */
double truth_laser_sweep_deg(World *world, int laser, double arc_deg, const double point_mm[3]);

/* Gives the distance in mm from the reference plane to the surface (turntable included) along the
 * true viewing ray of each texel's centre. ret_edge, if not NULL, says whether a depth edge (a step
 * of more than half a texel) is within one texel. */
void truth_mdf(World *world, int camera, double turntable_deg, const struct truth_grid *grid,
               float *ret_distance_mm, guint8 *ret_edge);

/* Counts the given laser positions (arc angle, laser) that light the surface point that each texel
 * shows. */
void truth_laser_seen(World *world, int camera, double turntable_deg, const struct truth_grid *grid,
                      const double *arc_deg, const int *laser, int n, guint8 *ret_seen);

/* Computes reflectance as in pipeline/pipeline.h, R G B interleaved, averaged over each texel's
 * area with samples² rays. Edges of shadows need many samples. On a brick wall, the 95th percentile
 * of the difference from a picture with 4 pixels per texel was 5.4 % with 6 samples and 1.8 % with
 * 24. */
void truth_btf(World *world, int camera, int lamp, double turntable_deg, double arc_deg,
               const struct truth_grid *grid, int samples, float *ret_rgb);

/* The surface of the sample, without the turntable. Borrowed; valid as long as the world lives. A
 * vertex has stride floats: position in mm in the sample frame at 0, diffuse albedo at albedo. */
struct truth_surface {
    const float *vertices;
    guint n_vertices, stride, albedo;
    const guint32 *triangles; /* three for each triangle, counter-clockwise seen from outside */
    guint n_triangles;
};
void truth_surface(World *world, struct truth_surface *ret);
