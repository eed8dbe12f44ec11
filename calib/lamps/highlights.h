/*
 * This module finds a lamp's mirror image in glossy balls, as the centroid of the bright spot near
 * the expected position. The functions are pure, and any thread may call them.
 */
#pragma once

#include "lamps.h"

struct highlight_picture {
    const struct picture *picture; /* linear grey */
    /* numbers of the picture, lamp and camera, copied to the sights */
    int index, lamp, camera;
    double turntable_rad, arc_rad;
};

/* Appends a struct lamp_sight for each ball that shows the lamp. If a ball should show the lamp but
 * has no usable spot, appends a text "picture: reason" to rejected. reach_mm is the largest
 * distance of a ball from its position in the target. Returns FALSE if the picture's size is not
 * the camera's. */
gboolean highlights_measure(const struct rig *rig, const struct lamp_target *target,
                            const struct highlight_picture *from, double reach_mm, GArray *sights,
                            GPtrArray *rejected, GError **error);

struct highlight {
    double x_px, y_px;
    double sigma_px;               /* standard deviation of x and of y */
    double xx_px2, xy_px2, yy_px2; /* second moments of the spot's light */
    /* sum of the squares of the spot's values above the background */
    double energy;
    gboolean saturated;
};

/* A highlight_mean is the mean of the square roots of n photographs under different lamps. It shows
 * what the photographs have in common. */
struct highlight_mean {
    const struct picture *root;
    int n;
};

/* Finds the lamp's mirror image within radius_px of a point: the centroid of the spot with the
 * largest energy. A saturated spot is less accurate, because only its border determines its
 * position.
 *
 * These spots are not taken for the lamp:
 * - specks, streaks, and spots larger than max_px;
 * - spots that other photographs also show (dust, windows, lamps of the room), if `mean` is not
 *   NULL and shows at least two other photographs.
 *
 * Returns NULL on success. Otherwise returns the reason, such as "is not wholly in the picture", to
 * which the caller prefixes the name of the ball. Free it with g_free(). */
char *highlight_find(const struct picture *picture, const struct highlight_mean *mean, double x_px,
                     double y_px, double radius_px, double max_px, struct highlight *ret);
