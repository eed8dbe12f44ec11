/*
 * This module gives the true values of the simulated world: exact distances and reflectances by ray
 * tracing. It is a separate library (mesorig_truth), which only tests and the demo's report use.
 * The camera arm and the light probe are at the angles of world_set_arm() and world_set_probe().
 */
#pragma once

#include "world.h"

/* The texels of the reference plane. The simulation shares no code with processing/, so this struct
 * is defined separately. */
struct truth_grid {
    int width, height;
    double width_mm, height_mm, reference_mm;
};

/* Returns the true position of a camera's centre in the sample frame. The turntable is at the given
 * angle, without backlash and position errors. */
void truth_view_centre_mm(World *world, int camera, double turntable_deg, double ret[3]);

/* Converts a point of the sample frame to the rig frame, with the turntable at an angle. The wobble
 * of the bearing is included. */
void truth_to_rig(World *world, double turntable_deg, const double sample_mm[3],
                  double ret_rig_mm[3]);

/* The true values of a camera, in the rig frame. */
struct truth_camera {
    double centre_mm[3], right[3], down[3], forward[3];
    double focal_px, centre_px[2], k1, k2, p1, p2;
};
void truth_camera(World *world, int camera, struct truth_camera *ret);

/* Projects a point of the rig frame with the true camera, for green light, to the point ret_xy_px
 * of the picture. This point may be hidden or outside of the picture. */
void truth_project(World *world, int camera, const double point_mm[3], double ret_xy_px[2]);

struct truth_arc {       /* the true axis of the arc, in the rig frame */
    double zero_deg;     /* angle that is added to the arc's angle */
    double axis[3];      /* unit vector, upwards */
    double centre_mm[3]; /* intersection of the axis with z = 0 */
};
void truth_arc(World *world, struct truth_arc *ret);

/* The axis of the camera arm or of the light probe. The axis of the arm is in the rig frame. The
 * axis of the probe is in the frame of the probe's lamps. */
struct truth_swing {
    double zero_deg;     /* angle that is added to the angle of the arm or probe */
    double axis[3];      /* unit vector; the carried devices turn counter-clockwise about it */
    double centre_mm[3]; /* a point of the axis */
};
void truth_arm(World *world, struct truth_swing *ret);
void truth_probe(World *world, struct truth_swing *ret);

/* Sets ret_position_mm and ret_aim to the true position and aim of a lamp in the rig frame. The arc
 * is at the given angle, without backlash and position errors. ret_aim may be NULL. */
void truth_lamp(World *world, int lamp, double arc_deg, double ret_position_mm[3],
                double ret_aim[3]);
/* Returns the signal of a camera in DN per second, for a white diffuser under a lamp at full
 * output. The diffuser lies level at a point of the rig frame. colour is the filter: 0 red, 1
 * green, 2 blue. */
double truth_white(World *world, int camera, int lamp, double arc_deg, const double point_mm[3],
                   int colour);

/* The plane of a laser's sheet: the points p with normal · p = offset_mm. A bent sheet touches this
 * plane in its middle. */
struct truth_sheet {
    double normal[3], offset_mm;
    /* the sheet turns about the line through source_mm with the direction `axis` */
    double source_mm[3], axis[3];
};
/* Returns the true sheet of a laser in the rig frame, without backlash and position errors. */
void truth_laser_sheet(World *world, int laser, double arc_deg, double sweep_deg,
                       struct truth_sheet *ret);
/* Returns the sweep angle at which the middle of a laser's line goes through a point of the rig
 * frame. */
double truth_laser_sweep_deg(World *world, int laser, double arc_deg, const double point_mm[3]);

/* For each texel, sets ret_distance_mm to a distance in mm along the true viewing ray of the
 * texel's centre: from the reference plane to the surface of the sample or the turntable. It is −1
 * where the ray meets nothing.
 *
 * If ret_edge is not NULL, it is set to 1 for each texel with a depth edge within one texel, and to
 * 0 for all others. A depth edge is a step of more than half a texel. */
void truth_mdf(World *world, int camera, double turntable_deg, const struct truth_grid *grid,
               float *ret_distance_mm, guint8 *ret_edge);

/* A laser position is an arc angle and a laser; n of them are given. For each texel, ret_seen is
 * set to the number of laser positions from which the laser can light the surface point that the
 * texel shows, at any sweep angle. */
void truth_laser_seen(World *world, int camera, double turntable_deg, const struct truth_grid *grid,
                      const double *arc_deg, const int *laser, int n, guint8 *ret_seen);

/* Sets ret_rgb to the reflectance, as pipeline/pipeline.h defines it, R G B interleaved. It is
 * averaged over each texel's area with samples² rays. Edges of shadows need many rays. An example
 * is the 95th percentile of the difference to a picture of a brick wall with 4 pixels per texel: it
 * was 5.4 % with samples = 6, and 1.8 % with samples = 24. */
void truth_btf(World *world, int camera, int lamp, double turntable_deg, double arc_deg,
               const struct truth_grid *grid, int samples, float *ret_rgb);

/* The surface of the sample, without the turntable. The world owns the arrays. A vertex has
 * `stride` floats. The first three are the position in mm in the sample frame. Three floats from
 * the index `albedo` on are the diffuse albedo. */
struct truth_surface {
    const float *vertices;
    guint n_vertices, stride, albedo;
    const guint32 *triangles; /* three indexes per triangle, counter-clockwise from outside */
    guint n_triangles;
};
void truth_surface(World *world, struct truth_surface *ret);
