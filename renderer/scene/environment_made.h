/*
 * Environments that are computed instead of read. Radiance is relative to a lamp of brightness 1
 * (viewer.h).
 *
 * "studio": soft boxes in a dim room, whose radiance is ENVIRONMENT_ROOM (1 + cos θ). A box is a
 * rectangle at distance 1 that faces the origin, of even radiance. Its solid angle is 4 atan (ab /
 * √(1 + a² + b²)), with a and b half its width and height.
 *
 * "overcast": the standard overcast sky, L (θ) = L_z (1 + 2 cos θ) / 3 (Moon & Spencer 1942), over
 * a ground that reflects a fifth of its light. It gives a white diffuser that faces the zenith the
 * radiance 1: E / π = 7/9 L_z = 1.
 */
#pragma once

#include "environment.h"

struct environment_box {
    double theta_deg, phi_deg;      /* direction of its centre */
    double half_width, half_height; /* across, and along the meridian */
    double radiance;                /* in place of the room's */
    float rgb[3];                   /* tint, on which the radiance is multiplied */
};

#define ENVIRONMENT_BOXES 4
#define ENVIRONMENT_ROOM  0.08 /* radiance of the studio's walls at the horizon */
#define ENVIRONMENT_FLOOR 0.2  /* reflectance of the ground below the overcast sky */

extern const struct environment_box environment_studio[ENVIRONMENT_BOXES]; /* none overlap */

/* NULL: none of environment_names. environment_free() */
struct environment *environment_make(const char *name);
