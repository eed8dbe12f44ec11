/*
 * A BTF in directions that are the same for all of its texels. Each texel was seen and lit from
 * directions of its own (near_field.h); from those its values are interpolated (direction_mesh.h),
 * over the lights of each view and then over views. The result is a session as import.h makes them,
 * with a BTF and eigen-maps and without frames, whose nominal directions are the exact ones. An MDF
 * is copied as it is: it says itself where its views were taken from, on the same texels.
 *
 * How far to believe it is measured on the values themselves:
 *
 *   left out   what was measured from one view (under one light), predicted by all others; the next
 *              are much farther away than what a texel has to be moved by. Of every fourth texel
 *              and so on, so that they are a thousand or less.
 *   back       what the result says in the directions each texel was measured in, against what was
 *              measured: moved there and back, so that interpolation errs about twice
 *   nominal    what is read for a direction without all this, against the result
 *
 * All are ‖difference‖ / ‖value‖ of R, G, B, without holes and what was made of other lights'
 * pictures. Attributes of each part beside those of pipeline.h:
 * resample.directions, resample.from (string: the set's name, the session's path), resample.exact
 * (int: 0 if it was not known where cameras and lamps were, as after an import), and (double)
 * resample.left_out_view, resample.left_out_light, resample.back of the whole, resample.moved_deg
 * of the view: mean over the texels.
 */
#pragma once

#include "base/work.h"
#include "btf/btf_directions.h"
#include "formats/import.h"

/* Views of an elevation (to a degree). */
struct near_field_correction_band {
    double theta_deg;
    int n_views;
    double left_out_view, left_out_light, back; /* of those that were measured */
    double moved_deg, most_moved_deg; /* of those in the result: to the texel's nearest one */
    double nominal;                   /* −1: the directions asked for are others */
    double held; /* of values in the result: that lie beyond what is extrapolated */
};

struct near_field_correction_result {
    struct import_result made;
    gboolean exact;                  /* FALSE: all texels had the nominal directions */
    gboolean mdf;                    /* there was one; it is the result's, too */
    int n_views, n_lights;           /* that it was made from */
    int sampled;                     /* texels that were predicted without one direction */
    gint64 holes, bounds, predicted; /* in what it was made from (btf_matrix.h) */
    GArray *from, *to; /* of struct near_field_correction_band; those measured, those made */
    struct near_field_correction_band all; /* θ −1 */
    double light_moved_deg, light_most_moved_deg;
};
void near_field_correction_result_clear(struct near_field_correction_result *result);

/* to: NULL: the session's own nominal directions. path must not exist. Takes the memory of some
 * views, and 8 bytes on disk for each value and direction, of source and result, while it runs.
 * Stages "read", "resample", "import", "eigenmaps". */
gboolean near_field_correct(const char *session, const char *path, const struct btf_directions *to,
                            const struct work *work, struct near_field_correction_result *ret,
                            GError **error);
