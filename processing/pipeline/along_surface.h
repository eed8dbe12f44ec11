/*
 * A session in new view directions, predicted along the surface (reprojection/reprojection.h):
 * dense from sparse, and outside of the measured views, too. Needs the session's MDF. The result is
 * a session as of import.h with a BTF, eigen-maps and an MDF, but no frames; its nominal directions
 * are exact. Views are those of cameras that are far away: each texel is seen from the same
 * direction.
 *
 * Lights: values under a new light are mixed linearly of those of up to four measured lights
 * (directions.h); beyond the measured ones they fall with the cosine. Lights count as in their
 * nominal directions for all texels.
 *
 * The MDF's channels (pipeline.h): D is the predicted distance, −1 where no view sees anything; M,
 * O and S are −1 and N is 0, since nothing was measured; P is 3 or 0. If no view sees the surface
 * of a texel, its values are mixed from the views' values at the same texel, and have the flag
 * BTF_FLAG_PREDICTED (btf.h).
 *
 * Attributes of each part of the BTF besides those of pipeline.h: resample.directions and
 * resample.from (string: name of the set, path of the session), resample.along_surface (int: 1).
 */
#pragma once

#include "base/work.h"
#include "btf/btf_directions.h"
#include "formats/import.h"

struct along_surface_result {
    struct import_result made;
    int n_views, n_lights;           /* of the source */
    gint64 holes, bounds, predicted; /* of the source (btf_matrix.h) */
    gint64 texels, unseen;           /* of all views made, and those mixed at the same texel */
};

/* to: NULL for the session's own nominal directions. path must not exist. work: not NULL. memory:
 * bytes of the source's values to keep, 0: all (btf_matrix.h). DATA_ERROR_INCOMPLETE: the session
 * has no MDF. Stages "read", "surface", "import", "eigenmaps". */
gboolean along_surface_predict(const char *session, const char *path,
                               const struct btf_directions *to, gint64 memory,
                               const struct work *work, struct along_surface_result *ret,
                               GError **error);
