/*
 * These functions measure the error of a codec at directions that it has not seen. Some views and
 * lights of a BTF are left out, and the remaining BTF is encoded. The model is then evaluated at
 * the directions that were left out, in the same way as a renderer evaluates it between the
 * measured directions (place.h). The result is compared with the measured values. Any thread.
 *
 * The error is that of the codec and of the interpolation together. If the model is the remaining
 * BTF itself (material_btf_codec), the error is that of the interpolation only.
 */
#pragma once

#include "codec_geometry.h"
#include "compare.h"

/* The views and lights that are left out, as ascending indices. If n_views is 0, no view is left
 * out. If n_lights is 0, no light is left out. If both are 0, the error is that at the measured
 * directions. */
struct held_out {
    int n_views, n_lights;
    int *views, *lights;
    /* geometry of the whole BTF (codec_geometry.h), so that a model of a codec with `geometric` is
     * evaluated at the true directions of each texel; NULL if it is not known. Borrowed */
    const struct codec_geometry *geometry;
};

#define HELD_OUT_MIN_KEPT 3 /* minimum number of directions that can be triangulated */

/* Returns how many of n directions are left out by default: a tenth, rounded up. Returns 0 if fewer
 * than HELD_OUT_MIN_KEPT directions would be kept. */
int held_out_default(gsize n);

/* Draws n_views views and n_lights lights. The same seed gives the same directions. The error is
 * DATA_ERROR_INVALID if fewer than HELD_OUT_MIN_KEPT views or lights would be kept. Free with
 * held_out_clear(). */
gboolean held_out_draw(const struct btf_layout *layout, int n_views, int n_lights, guint32 seed,
                       struct held_out *ret, GError **error);
void held_out_clear(struct held_out *held);

/* Copies a BTF, with values in memory, without the views and lights of held. btf_matrix_free() */
struct btf_matrix *held_out_rest(const struct btf_matrix *btf, const struct held_out *held);

/* Returns the geometry of held_out_rest(): without the views and lights of held, and without the
 * points that these views measured. codec_geometry_free() */
struct codec_geometry *held_out_rest_geometry(const struct codec_geometry *geometry,
                                              const struct held_out *held);

/* Compares a model of held_out_rest() with btf at the pairs of a view that was left out and a light
 * that was left out. If no view was left out, all views are compared. If no light was left out, all
 * lights are compared. views and lights of the result are in the order of held->views and
 * held->lights.
 *
 * If the view or the light of a pair is on or below the horizon, the value of the model is 0.
 * Progress stages are those of compare_materials(). Fails if the directions of the model cannot be
 * triangulated, if a value is infinite or NaN, or if the work is cancelled. */
struct comparison *held_out_compare(const struct btf_matrix *btf, const struct held_out *held,
                                    const Material *model, const struct work *work, GError **error);

/* Gives in *ret_error only the relative RMS error that held_out_compare() finds for a model of
 * codec. */
gboolean held_out_error(const struct btf_matrix *btf, const struct held_out *held,
                        const struct codec *codec, gconstpointer model, const struct work *work,
                        double *ret_error, GError **error);
