/*
 * Exports the surface that an MDF describes, for programs that use points and maps. The texels of
 * all views become points in the sample frame in mm, with z from the top of the turntable. Normals
 * point towards the camera. Points of several views at the same place are fused. Any thread.
 */
#pragma once

#include "export.h"

enum export_surface { EXPORT_POINTS, EXPORT_HEIGHT, EXPORT_NORMALS };

struct export_surface_options {
    enum export_surface what;
    /* EXPORT_POINTS writes only points that at least this many views saw. 0 stands for 2, or for 1
     * if the MDF has only one view. */
    int min_views;
    gboolean layered; /* whether to write a map even if the structure is not a height field */
};

struct export_surface_result {
    /* seen: number of points of all views
     * points: number of points written; for a map, number of texels with a value */
    gint64 seen, points;
    /* n_views: number of views of the MDF
     * texels: number of texels of the session
     * holes: number of texels of a map without a value; 0 for EXPORT_POINTS */
    int n_views, texels, holes;
    int stacked; /* number of texels of a map with several layers */
};

/* Exports products/mdf.exr. The progress stage is "points".
 *
 * EXPORT_POINTS writes a binary PLY. Each point has x, y, z, nx, ny, nz (float), the RMS distance
 * of the fused points along the normal in mm (float) and the number of views (uchar). All points in
 * a cube whose side is the width of a texel become one point, their weighted mean. The weight of a
 * point is 1/σ² (σ: standard error of the MDF) times the cosine of the angle between the normal and
 * the direction to the camera.
 *
 * EXPORT_HEIGHT writes an EXR with a part "height" on the session's texels. Channel "Z" is the
 * median height in mm, "S" is half the interquartile range of the heights in mm, and "N" is the
 * number of points. N is 0 for a hole. If there are several layers (structure below structure), N
 * is −1, and Z is the height of the upper layer.
 *
 * EXPORT_NORMALS writes an EXR with a part "normals" and the channels "X", "Y", "Z", which are all
 * 0 in a hole.
 *
 * Both maps have the attributes mesorig.kind, texel_mm, reference_mm, holes and stacked. The export
 * of a map fails if no texel has a value. If more than a twentieth of the texels with a value have
 * several layers, the structure is not a height field. The export of a map then fails too.
 * options->layered = TRUE allows such a map. */
gboolean export_surface(const char *session, const char *file,
                        const struct export_surface_options *options, const struct work *work,
                        struct export_surface_result *ret, GError **error);
