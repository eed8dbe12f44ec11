/*
 * Exports the structure measured by an MDF, for programs that use points and maps: the texels of
 * all views as points of the sample frame in mm (z from the turntable's top), with normals
 * towards the camera, fused. Any thread.
 */
#pragma once

#include "export.h"

enum export_surface { EXPORT_POINTS, EXPORT_HEIGHT, EXPORT_NORMALS };

struct export_surface_options {
    enum export_surface what;
    int min_views; /* points that fewer views saw are left out; 0: 2, or 1 if there is one view */
    gboolean layered; /* write a map even if the structure is not a height field */
};

struct export_surface_result {
    gint64 seen, points; /* points of all views; points written (maps: texels with a value) */
    int n_views, texels, holes;
    int stacked; /* texels with structure below structure */
};

/* From products/mdf.exr. EXPORT_POINTS: a binary PLY, of each point x, y, z, nx, ny, nz (float),
 * its spread in mm (float, over the views) and views (uchar); points of all views in a cube of a
 * texel's width are one, their mean weighted by the MDF's standard errors and by how much they face
 * the camera.
 *
 * EXPORT_HEIGHT: an EXR, a part "height" on the session's texels: "Z" the median height in mm, "N"
 * of how many points, 0: a hole, −1: there is more below, and Z is of the upper; "S" their spread
 * in mm. EXPORT_NORMALS: a part "normals", "X", "Y", "Z", all 0 where there is none. Attributes of
 * both: mesorig.kind, texel_mm, reference_mm, holes, stacked.
 *
 * Where more than a twentieth of the texels has structure below structure it is not a height field,
 * and maps are refused unless asked for. */
gboolean export_surface(const char *session, const char *file,
                        const struct export_surface_options *options, const struct work *work,
                        struct export_surface_result *ret, GError **error);
