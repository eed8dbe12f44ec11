/* Near-field correction: resamples a BTF to directions that are common to all texels. In the
 * source, each texel was seen and lit from different directions (near_field.h). Its values are
 * interpolated (direction_mesh.h) over the lights of each view, then over views. The result is a
 * session as import.h makes it, with a BTF and eigen-maps but without frames. Its nominal
 * directions are exact. An MDF is copied unchanged, because it contains the positions of its views
 * and is for the same texels.
 *
 * The accuracy is estimated from the values themselves:
 *
 *   left out   Measured values of one view (or under one light), compared with a prediction from
 *              all other views (or lights). These other views are much farther away than the
 *              displacement of a texel. At most 1024 texels are used.
 *   back       The measured values, compared with the result after it was interpolated back to the
 *              measured directions. The interpolation error counts about twice.
 *   nominal    Values without correction, as if they were measured in the nominal directions,
 *              compared with the result.
 *
 * All errors are ‖difference‖ / ‖value‖ of R, G, B, without holes and predicted pictures.
 *
 * Each part has the attributes of pipeline.h, and also
 *   resample.directions     string: name of the set
 *   resample.from           string: path of the session
 *   resample.exact          int: 0 if positions of cameras and lamps are unknown, as after an
 *                           import
 *   resample.left_out_view, resample.left_out_light, resample.back
 *                           double: the errors above, over all views
 *   resample.moved_deg      double: mean over the texels of the angle between the view and the
 *                           nearest measured view */
#pragma once

#include "base/work.h"
#include "btf/btf_directions.h"
#include "formats/import.h"

/* Results for the views at one polar angle (to a degree). */
struct near_field_correction_band {
    double theta_deg;
    int n_views;
    double left_out_view, left_out_light,
        back; /* relative errors, explained above; only for measured views */
    /* for views of the result: mean and maximum over texels of the angle to the nearest measured
     * view */
    double moved_deg, max_moved_deg;
    /* relative error, explained above; −1 if the result does not have the nominal directions */
    double nominal;
    /* share of values beyond the limit of extrapolation, whose weights are limited
     * (direction_mesh.h) */
    double held;
};

struct near_field_correction_result {
    struct import_result made;
    gboolean exact;        /* FALSE if all texels had the nominal directions */
    gboolean mdf;          /* whether there was an MDF, which was copied */
    int n_views, n_lights; /* numbers of views and lights of the source */
    int sampled;           /* number of texels of the leave-one-out test */
    /* numbers of texels of the source, summed over its pictures (btf_matrix.h) */
    gint64 holes, bounds, predicted;
    /* Arrays of struct near_field_correction_band.
     * from: for the views of the source
     * to: for the views of the result */
    GArray *from, *to;
    struct near_field_correction_band all; /* for all views; theta_deg is −1 */
    /* mean and maximum, over lights and texels, of the angle to the nearest measured light */
    double light_moved_deg, light_most_moved_deg;
};
void near_field_correction_result_clear(struct near_field_correction_result *result);

/* Resamples the BTF of a session to the directions `to`, and writes the result as a new session to
 * path. `to` is NULL for the session's own nominal directions. Progress stages are "read",
 * "resample", "import" and "eigenmaps".
 *
 * The error is DATA_ERROR_EXISTS if path exists, and DATA_ERROR_INCOMPLETE if there is no BTF or if
 * it gets further views meanwhile. Fails also if the disk has no space for the scratch files.
 *
 * The function needs the memory of some views. It temporarily needs 8 bytes on disk for each texel
 * under each pair of view and light, of the source and of the result. */
gboolean near_field_correct(const char *session, const char *path, const struct btf_directions *to,
                            const struct work *work, struct near_field_correction_result *ret,
                            GError **error);
