/*
 * Finds a lamp's mirror image in glossy balls: the middle of the bright spot that is in sight of
 * where the ball should be. Pure; any thread.
 */
#pragma once

#include "lamps.h"

struct highlight_picture {
    const struct picture *picture; /* linear grey */
    int index, lamp, camera;       /* for sights */
    double turntable_rad, arc_rad;
};

/* Appends struct lamp_sight; and, for each ball that should show the lamp but does not tell where,
 * a text that says in which picture and why. The balls are within reach_mm of where the target has
 * them. FALSE: the picture is of another size than the camera. */
gboolean highlights_measure(const struct rig *rig, const struct lamp_target *target,
                            const struct highlight_picture *from, double reach_mm, GArray *sights,
                            GPtrArray *rejected, GError **error);

/* The middle of the brightest spot within radius_px of a point; NULL, or why there is none to
 * believe in. most_px: spots of more pixels are no mirror image. */
const char *highlight_find(const struct picture *picture, double x_px, double y_px,
                           double radius_px, double most_px, double *ret_x, double *ret_y);
