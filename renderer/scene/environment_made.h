/*
 * Environments that are computed rather than read. Radiance is relative to a lamp of brightness 1
 * (viewer.h).
 *
 * "studio": soft boxes in a dim room. The radiance of the room is ENVIRONMENT_ROOM (1 + cos θ). A
 * box is a rectangle of even radiance at distance 1 that faces the origin. Its solid angle is 4
 * atan (ab / √(1 + a² + b²)), with a and b half its width and height.
 *
 * "overcast": the standard overcast sky, L (θ) = L_z (1 + 2 cos θ) / 3 (Moon & Spencer 1942), over
 * a ground that reflects a fifth of its light. A white diffuser that faces the zenith has the
 * radiance 1: E / π = 7/9 L_z = 1.
 */
#pragma once

#include "environment.h"

struct environment_box {
    double theta_deg, phi_deg; /* direction of the centre of the box */
    /* at distance 1; the width is across the meridian of the box, and the height along it */
    double half_width, half_height;
    double radiance; /* replaces the radiance of the room */
    float rgb[3];    /* tint; the radiance is multiplied by it */
};

#define ENVIRONMENT_BOXES 4
#define ENVIRONMENT_ROOM  0.08 /* radiance of the studio's walls at the horizon */
#define ENVIRONMENT_FLOOR 0.2  /* reflectance of the ground below the overcast sky */

/* The boxes do not overlap. */
extern const struct environment_box environment_studio[ENVIRONMENT_BOXES];

/* Computes an environment. Returns NULL if name is not one of environment_names. Free it with
 * environment_free(). */
struct environment *environment_make(const char *name);
