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

struct highlight {
    double x_px, y_px;
    double sigma_px;               /* standard deviation of x and of y */
    double xx_px2, xy_px2, yy_px2; /* how far its light extends: second moments */
    double energy;                 /* sum of squares above the background */
    gboolean saturated;
};

/* The middle of the lamp's mirror image within radius_px of a point: of the spot that is largest
 * and brightest, as far as it is not saturated by its light, else by its border. Specks and streaks
 * do not count. NULL, or why there is none to believe in, g_free(). most_px: spots of more pixels
 * are no mirror image. */
char *highlight_find(const struct picture *picture, double x_px, double y_px, double radius_px,
                     double most_px, struct highlight *ret);
