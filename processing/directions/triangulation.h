/*
 * Delaunay triangulation of points in the plane, and barycentric weights at any point. Each point
 * is displaced by about 10⁻⁷ so that collinear and cocircular points need no special case: any set
 * of one or more points will do, and equal points share one position.
 */
#pragma once

#include <glib.h>

typedef struct Triangulation Triangulation; /* any number of threads may ask one at once */

Triangulation *triangulation_new(const double *points /* n × 2 */, int n);
void triangulation_free(Triangulation *triangulation); /* NULL is ignored */

/* Barycentric weights within a triangle. Outside of all triangles, the weights are those of the
 * nearest point of the border, which ret_nearest gives; inside, ret_nearest is the point itself. */
void triangulation_weights(const Triangulation *triangulation, const double at[2], int ret_index[3],
                           double ret_weight[3], double ret_nearest[2]);

/* ret_n × 3 corners, counter-clockwise; ret_n: triangles. Those of nearly collinear points may be
 * slivers. Owned by the object. */
const int *triangulation_corners(const Triangulation *triangulation, int *ret_n);
