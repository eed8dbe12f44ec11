/*
 * Delaunay triangulation of points in the plane, and the weights of the corners at any point.
 * Points that lie on common lines or circles are told apart by moving each by some 10⁻⁷, so any set
 * of one or more points will do; equal points share one place.
 */
#pragma once

#include <glib.h>

typedef struct Triangulation Triangulation; /* used by one thread at a time */

Triangulation *triangulation_new(const double *points /* n × 2 */, int n);
void triangulation_free(Triangulation *triangulation); /* NULL is ignored */

/* Barycentric within a triangle; outside of all, those of the nearest point of the border, given in
 * ret_nearest, which inside is the point itself. */
void triangulation_weights(Triangulation *triangulation, const double at[2], int ret_index[3],
                           double ret_weight[3], double ret_nearest[2]);

/* Three corners a triangle, counter-clockwise; ret_n: triangles. Those of points all but on a line
 * may be slivers. Owned by the object. */
const int *triangulation_corners(const Triangulation *triangulation, int *ret_n);
