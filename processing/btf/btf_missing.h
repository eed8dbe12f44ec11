/*
 * Predicts a missing light's picture from the pictures of the lights around it, see btf.h. Any
 * thread.
 */
#pragma once

#include "btf.h"

/* Returns the weights (n_lights) with which the pictures of all lights are summed to the picture of
 * light i. `taken` (n_lights) has the part of each light, or NULL if the light is missing. Returns
 * NULL if no light was captured; g_free(). */
double *btf_missing_weights(const struct btf_view *view, struct exr_part *const *taken, guint i);

/* Gives the flags of n texels in ret_flags (n): BTF_FLAG_PREDICTED, or BTF_FLAG_HOLE if any picture
 * whose weight is not 0 has a hole there. */
void btf_missing_flags(const double *weights, struct exr_part *const *taken, guint n_lights,
                       gsize n, guint8 *ret_flags);

/* Adds the parts in `taken`, multiplied by their `weights`, to the channels B, G and R of `part`.
 * The channels must be 0 before. A texel becomes 0 if `flags` marks it as a hole. Negative sums
 * become 0. */
void btf_missing_fill(const double *weights, struct exr_part *const *taken, guint n_lights,
                      const guint8 *flags, struct exr_part *part);
