/* Reads the points that the views of an MDF measured, with normals. export_surface.h exports these
 * points. */
#pragma once

#include "base/vec.h"
#include "base/work.h"
#include "session/session.h"

struct surface_point {
    /* at_mm: position in the sample frame
     * normal: unit vector towards the camera's side of the surface */
    struct vec3 at_mm, normal;
    /* cosine of the angle between the normal and the direction to the camera, divided by the square
     * of the point's standard error in texels */
    float weight;
    int view; /* position of the view's part in the MDF's file, from 0 */
};

struct surface {
    struct session_grid grid;
    int n_views;
    double texel_mm;
    GArray *points; /* of struct surface_point */
};

/* Reads products/mdf.exr of a session. Predicted values and texels without a normal are left out.
 * Call surface_clear() even after an error. The progress stage is "points". */
gboolean surface_points_read(const char *session, const struct work *work, struct surface *ret,
                             GError **error);
void surface_clear(struct surface *surface);
