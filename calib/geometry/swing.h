/*
 * This module computes with the axes that carry cameras (the camera arm) or lamps (the light
 * probe), and with the stops of these axes (rig.h).
 *
 * With the axis at the angle β, a point that it carries is at p(β) = c + R(a, β) (p(0) − c), where
 * a is the direction of the axis (unit), c a point on it, and R(a, β) the right-handed rotation by
 * β about a.
 *
 * The functions are pure, and any thread may call them.
 */
#pragma once

#include "rig.h"

/* These functions return a point, or a direction, after the swing has turned by a further angle. */
struct vec3 rig_swing_point(const struct rig_swing *swing, double angle_rad, struct vec3 point_mm);
struct vec3 rig_swing_direction(const struct rig_swing *swing, double angle_rad,
                                struct vec3 direction);
/* Moves a camera as its arm moves it when the arm turns by a further angle. */
void rig_swing_camera(const struct rig_swing *swing, double angle_rad, struct rig_camera *camera);

/* An axis as a least squares fit to the poses of the stops, and the deviations of the poses from
 * this axis. */
struct rig_swing_fit {
    struct rig_swing swing;
    int n_pairs;          /* number of pairs of stops of one camera */
    double angle_rms_rad; /* RMS deviation of the pairs' rotations from rotations about the axis */
    double position_rms_mm; /* RMS deviation of the camera centres from circles about the axis */
    /* mean angle about the axis from the cameras' nominal centres to those found */
    double zero_rad;
};

/* Finds the arm's axis from the poses of its cameras. `known` is the set of the cameras whose pose
 * is known. zero_rad is measured from the cameras of nominal.
 *
 * From stop j to stop k of one camera, the camera has turned by S = R_kᵀ R_j, a rotation about a by
 * β_k − β_j, and its centres obey (I − S) c = C_k − S C_j. a is the direction of the sum of the
 * rotation vectors of S, with the sign of β_k − β_j, over all pairs of stops. c is the least
 * squares solution nearest to the origin.
 *
 * Returns FALSE if no camera is known at two stops that are at least 1° apart, or if the poses
 * determine no direction or no point of the axis. ret then holds no usable values. */
gboolean rig_swing_fit(const struct rig *rig, struct camera_set known, const struct rig *nominal,
                       struct rig_swing_fit *ret);
