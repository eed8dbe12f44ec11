/*
 * Interpolation over a set of measured directions: for any direction of the hemisphere, up to four
 * measured ones and their weights. Weights are non-negative, sum to 1, are continuous in the
 * direction, and are (1, 0, 0, 0) at a measured direction.
 *
 * Sets of rings (those of a rig: polar angles, each with any number and offset of azimuths, which
 * are at most a little uneven) are interpolated bilinearly in θ and φ; above the topmost ring
 * towards the pole, whose value is the mean of that ring unless a direction was measured there. Any
 * other set is triangulated (Delaunay, in the stereographic plane). Beyond the measured directions
 * the nearest value is kept.
 *
 * The hemisphere is stored in square tables: (a, b) in [−1, 1]² are x + y and x − y of the
 * direction scaled to |x| + |y| + z = 1.
 */
#pragma once

#include "base/vec.h"
#include <glib.h>

#define DIRECTIONS_ERROR directions_error_quark()
GQuark directions_error_quark(void);
enum directions_error {
    DIRECTIONS_ERROR_RANGE, /* none, too many, not a number, or below the horizon */
};

#define DIRECTIONS_MAX 65000

struct direction_weights {
    int index[4]; /* of the measured directions; n for the pole, see directions_pole() */
    float weight[4];
};

typedef struct Directions Directions; /* any number of threads may ask one at once */

Directions *directions_new(const float *theta_deg, const float *phi_deg, int n, GError **error);
/* Triangulates the directions even if they form rings, so that three of them stand for any
 * direction, not four. */
Directions *directions_new_triangulated(const float *theta_deg, const float *phi_deg, int n,
                                        GError **error);
void directions_free(Directions *directions); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Directions, directions_free)

gboolean directions_are_rings(const Directions *directions);

/* The directions whose mean is the value at the pole (index n); *ret_n is 0 if no weights refer to
 * the pole. Owned by the object. */
const int *directions_pole(const Directions *directions, int *ret_n);

/* direction: a unit vector; below the horizon it is clamped to it. */
void directions_weights(const Directions *directions, struct vec3 direction,
                        struct direction_weights *ret);

/* The factor by which reflectance, which contains n·l, falls from the nearest measured light to
 * this direction: 1 within the measured ones, beyond them cos θ / cos θ_nearest, 0 below the
 * horizon. */
double directions_fade(const Directions *directions, struct vec3 direction);

/* Both at once. */
double directions_fade_weights(const Directions *directions, struct vec3 direction,
                               struct direction_weights *ret);

/* The weight of each of the n directions in the reflectance under a sky of even radiance,
 * (1/π) ∫ BTF dω. */
void directions_sky(const Directions *directions, float *ret_share);

struct vec3 directions_from_square(double a, double b);

/* Solid angle per area of the square at (a, b). */
double directions_square_density(double a, double b);
