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

/* Returns the true position of a camera's centre in the sample frame, at the commanded turntable
 * angle, without backlash and position errors. */
void truth_view_centre_mm(World *world, int camera, double turntable_deg, double ret[3]);

/* Converts the point sample_mm of the sample frame to the point ret_rig_mm of the rig frame, with
 * the turntable at an angle. This includes the wobble of the bearing. */
void truth_to_rig(World *world, double turntable_deg, const double sample_mm[3],
                  double ret_rig_mm[3]);

/* The true values of a camera, in the rig frame. */
struct truth_camera {
    double centre_mm[3], right[3], down[3], forward[3];
    double focal_px, centre_px[2], k1, k2, p1, p2;
};
void truth_camera(World *world, int camera, struct truth_camera *ret);

/* Projects a point of the rig frame with the true camera, for green light. ret_xy_px is the point
 * in the picture. The point may be hidden or outside of the picture. */
void truth_project(World *world, int camera, const double point_mm[3], double ret_xy_px[2]);

struct truth_arc {       /* the true axis of the arc, in the rig frame */
    double zero_deg;     /* angle that is added to the arc's angle */
    double axis[3];      /* unit vector, upwards */
    double centre_mm[3]; /* intersection of the axis with z = 0 */
};
void truth_arc(World *world, struct truth_arc *ret);

/* The axis of the camera arm in the rig frame, or the axis of the light probe in the frame of its
 * lamps. */
struct truth_swing {
    double zero_deg;     /* angle that is added to the angle of the arm or probe */
    double axis[3];      /* unit vector; the carried devices turn counter-clockwise about it */
    double centre_mm[3]; /* a point of the axis */
};
void truth_arm(World *world, struct truth_swing *ret);
void truth_probe(World *world, struct truth_swing *ret);

/* Sets ret_position_mm and ret_aim to the true position and aim of a lamp in the rig frame, with
 * the arc at an angle, without backlash and position errors. ret_aim may be NULL. */
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
    double source_mm[3], axis[3]; /* the sheet turns about a line through source_mm along axis */
};
/* Returns the true sheet of a laser in the rig frame, without backlash and position errors. */
void truth_laser_sheet(World *world, int laser, double arc_deg, double sweep_deg,
                       struct truth_sheet *ret);
/* Returns the sweep angle at which the middle of a laser's line goes through a point of the rig
 * frame. */
double truth_laser_sweep_deg(World *world, int laser, double arc_deg, const double point_mm[3]);

/* For each texel, sets ret_distance_mm to the distance along the true viewing ray of the texel's
 * centre, from the reference plane to the surface of the sample or the turntable, in mm. The
 * distance is −1 where the ray meets nothing. If ret_edge is not NULL, it receives 1 for each texel
 * that has a depth edge (a step of more than half a texel) within one texel, and otherwise 0. */
void truth_mdf(World *world, int camera, double turntable_deg, const struct truth_grid *grid,
               float *ret_distance_mm, guint8 *ret_edge);

/* For each texel, ret_seen is the number of laser positions from which a laser can light the
 * surface point that the texel shows, at any sweep angle. A laser position is an arc angle and a
 * laser. n positions are given. */
void truth_laser_seen(World *world, int camera, double turntable_deg, const struct truth_grid *grid,
                      const double *arc_deg, const int *laser, int n, guint8 *ret_seen);

/* Sets ret_rgb to the reflectance as in pipeline/pipeline.h, R G B interleaved. The reflectance is
 * averaged over each texel's area with samples² rays. Edges of shadows need many rays: on a brick
 * wall, the 95th percentile of the difference to a picture with 4 pixels per texel was 5.4 % with 6
 * samples and 1.8 % with 24. */
void truth_btf(World *world, int camera, int lamp, double turntable_deg, double arc_deg,
               const struct truth_grid *grid, int samples, float *ret_rgb);

/* The surface of the sample, without the turntable. The world owns the arrays. A vertex has stride
 * floats. The first three floats of a vertex are the position in mm in the sample frame. Three
 * floats from the index `albedo` on are the diffuse albedo. */
struct truth_surface {
    const float *vertices;
    guint n_vertices, stride, albedo;
    const guint32 *triangles; /* three indexes per triangle, counter-clockwise from outside */
    guint n_triangles;
};
void truth_surface(World *world, struct truth_surface *ret);
