/*
 * Axes that carry cameras (the camera arm) or lamps (the light probe), and their stops (rig.h).
 *
 * A point that the axis carries is at p(β) = c + R(a, β) (p(0) − c) with the axis at the angle β, a
 * being its direction (unit), c a point of it, and R(a, β) the right-handed rotation by β about a.
 *
 * Pure functions over plain data: any thread.
 */
#pragma once

#include "rig.h"

struct vec3 rig_swing_point(const struct rig_swing *swing, double angle_rad, struct vec3 point_mm);
struct vec3 rig_swing_direction(const struct rig_swing *swing, double angle_rad,
                                struct vec3 direction);
/* Moves a camera as its arm does that turns on by an angle. */
void rig_swing_camera(const struct rig_swing *swing, double angle_rad, struct rig_camera *camera);

/* The axis as a least squares fit to the poses of its stops, and how far they are from it. */
struct rig_swing_fit {
    struct rig_swing swing;
    int n_pairs;            /* of stops of one camera */
    double angle_rms_rad;   /* between the rotations of pairs and those about the axis, */
    double position_rms_mm; /* and between the centres of their cameras */
    double zero_rad;        /* by which the cameras stand on from the nominal ones, in the mean */
};

/* The axis that the poses of an arm's cameras tell: of those that are known (bits), every pair of
 * stops j, k of one camera has turned by S = R_kᵀ R_j between them, about a by β_k − β_j, and its
 * centres obey (I − S) c = C_k − S C_j. a is the mean of the rotation vectors of S, c the least
 * squares solution nearest to the origin. nominal: for the zero. FALSE: no camera is known at two
 * stops that are 1° or more apart. */
gboolean rig_swing_fit(const struct rig *rig, guint32 known, const struct rig *nominal,
                       struct rig_swing_fit *ret);
