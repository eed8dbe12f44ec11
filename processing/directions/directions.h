/* Interpolation over a set of measured directions. For any direction of the hemisphere, these
 * functions give up to four measured directions and their weights. The weights are non-negative,
 * sum to 1 and are continuous in the direction. At a measured direction they are (1, 0, 0, 0).
 *
 * A rig measures rings: polar angles, each with any number of azimuths and any offset. The azimuths
 * of a ring may be slightly uneven. Rings are interpolated bilinearly in θ and φ. Above the topmost
 * ring the interpolation goes towards the pole. The value at the pole is the measured one, or the
 * mean of the topmost ring if the pole was not measured. Any other set of directions is
 * triangulated (Delaunay, in the stereographic plane). Outside the range of the measured
 * directions, the value at the nearest point of that range is used.
 *
 * Tables over the hemisphere are square. A direction is first scaled to |x| + |y| + z = 1. Its
 * coordinates in the square are then a = x + y and b = x − y, both in [−1, 1]. */
#pragma once

#include "base/vec.h"
#include <glib.h>

#define DIRECTIONS_ERROR directions_error_quark()
GQuark directions_error_quark(void);
enum directions_error {
    /* no directions, too many directions, or an angle that is not finite or below the horizon */
    DIRECTIONS_ERROR_RANGE,
};

#define DIRECTIONS_MAX 65000

struct direction_weights {
    /* indices of measured directions, 0 … n − 1; the index n stands for the pole
     * (directions_pole()) */
    int index[4];
    float weight[4];
};

/* Any number of threads may call the functions on the same object at the same time. */
typedef struct Directions Directions;

/* Makes an object for n directions, 1 … DIRECTIONS_MAX. Each θ must be 0 … 90°, and each φ must be
 * finite. If not, returns NULL with DIRECTIONS_ERROR_RANGE. */
Directions *directions_new(const float *theta_deg, const float *phi_deg, int n, GError **error);
/* Makes an object whose directions are triangulated even if they form rings, so that at most three
 * of them have a weight for any direction. */
Directions *directions_new_triangulated(const float *theta_deg, const float *phi_deg, int n,
                                        GError **error);
/* Returns the corners of all triangles (*ret_n × 3), as indices of directions, and the number of
 * triangles as *ret_n. Seen from outside of the hemisphere, the corners are counter-clockwise.
 * *ret_n is 0 if the directions form rings or lie on one plane through the nadir. The array is
 * owned by the object. */
const int *directions_triangles(const Directions *directions, int *ret_n);
/* Returns the number of rings, which is 0 if the directions are triangulated. */
int directions_n_rings(const Directions *directions);
/* Gives the indices of the directions of a ring, sorted by azimuth, and returns their number. Ring
 * 0 is the topmost one. ret must have space for the indices of all directions. */
int directions_ring(const Directions *directions, int ring, int *ret);
void directions_free(Directions *directions); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Directions, directions_free)

/* Returns the directions whose mean is the value at the pole (index n). If no weights refer to the
 * pole, returns NULL and sets *ret_n to 0. The array is owned by the object. */
const int *directions_pole(const Directions *directions, int *ret_n);

/* Gives the weights of the measured directions for a direction (a unit vector). A direction below
 * the horizon is clamped to the horizon. */
void directions_weights(const Directions *directions, struct vec3 direction,
                        struct direction_weights *ret);

/* Returns the factor by which reflectance, which contains n·l, falls from the nearest measured
 * light to this direction. Within the range of the measured directions the factor is 1. Outside of
 * the range it is cos θ / cos θ_nearest, and below the horizon 0. */
double directions_fade(const Directions *directions, struct vec3 direction);

/* Does the work of both functions: returns directions_fade(), and computes directions_weights() as
 * *ret. */
double directions_fade_weights(const Directions *directions, struct vec3 direction,
                               struct direction_weights *ret);

/* The directions are n lights. ret_share (n) gets the weight that each light has in the reflectance
 * (1/π) ∫ BTF dω under a sky of uniform radiance. */
void directions_sky(const Directions *directions, float *ret_share);

/* Returns the unit vector at (a, b) of the square. */
struct vec3 directions_from_square(double a, double b);

/* Returns the ratio of a small solid angle to the area of the square that it covers at (a, b). */
double directions_square_density(double a, double b);
