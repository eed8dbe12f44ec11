/* Delaunay triangulation of points in the plane, and barycentric weights at any point. Each point
 * is displaced by at most 10⁻⁷ in x and y, so that cocircular points need no special case. Points
 * on a line have no triangles, but weights between neighbours. Any set of one or more points can be
 * triangulated. Equal points share one position. */
#pragma once

#include <glib.h>

/* Any number of threads may call the functions on the same object at the same time. */
typedef struct Triangulation Triangulation;

Triangulation *triangulation_new(const double *points /* n × 2 */, int n);
void triangulation_free(Triangulation *triangulation); /* NULL is ignored */

/* Computes the barycentric weights of a point. ret_index and ret_weight are the three corners and
 * their weights. Within a triangle, ret_nearest is the point itself. For a point outside of all
 * triangles, the weights are those of the nearest point of the border, and ret_nearest is that
 * nearest point. */
void triangulation_weights(const Triangulation *triangulation, const double at[2], int ret_index[3],
                           double ret_weight[3], double ret_nearest[2]);

/* Returns the indices of the corners of all triangles, counter-clockwise (*ret_n × 3), and the
 * number of triangles as *ret_n. Triangles of nearly collinear points may be very thin. The array
 * is owned by the object. */
const int *triangulation_corners(const Triangulation *triangulation, int *ret_n);
