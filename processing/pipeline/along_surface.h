/* A session in new view directions, predicted along the surface (mdf/reprojection.h). The new
 * directions may be denser than those of the source, and may lie outside of the measured ones. The
 * source must have an MDF. The result is a session as import.h makes it, with a BTF, eigen-maps and
 * an MDF, but without frames. Its nominal directions are exact. Its views are like those of cameras
 * that are far away: each texel is seen from the same direction.
 *
 * Values under a new light are mixed linearly from those of up to four measured lights
 * (directions.h). Beyond the measured lights, values fall with the cosine. Lights are assumed to
 * have their nominal directions for all texels.
 *
 * In the MDF (pipeline.h), channel D is the predicted distance, −1 where no view sees anything. M,
 * O and S are −1 and N is 0, because nothing was measured. P is 3 or 0. If no view sees the surface
 * of a texel, its values are mixed from the views' values at the same texel, and have the flag
 * BTF_FLAG_PREDICTED (btf.h).
 *
 * Each part of the BTF has the attributes of pipeline.h, and also
 *   resample.directions      string: name of the set
 *   resample.from            string: path of the session
 *   resample.along_surface   int: 1 */
#pragma once

#include "base/work.h"
#include "btf/btf_directions.h"
#include "formats/import.h"

struct along_surface_result {
    struct import_result made;
    int n_views, n_lights; /* of the source */
    /* numbers of texels of the source, summed over its pictures (btf_matrix.h) */
    gint64 holes, bounds, predicted;
    /* texels: number of texels of all new views
     * unseen: number of texels whose surface no measured view sees */
    gint64 texels, unseen;
};

/* Predicts the views and lights `to` of a session, and writes them as a new session to path. `to`
 * is NULL for the session's own nominal directions. path must not exist. work must not be NULL.
 * memory is the maximum number of bytes of the source's values to keep, 0 if not limited
 * (btf_matrix.h). Progress stages are "read", "surface", "import" and "eigenmaps".
 *
 * The error is
 * - DATA_ERROR_INCOMPLETE if the session has no MDF or no BTF,
 * - DATA_ERROR_EXISTS if path exists,
 * - DATA_ERROR_INVALID if MDF and BTF differ in their texels,
 * - otherwise an error of the functions that read the session, or of import_material(). */
gboolean along_surface_predict(const char *session, const char *path,
                               const struct btf_directions *to, gint64 memory,
                               const struct work *work, struct along_surface_result *ret,
                               GError **error);
