/*
 * Predicts a missing light's picture from the pictures of the lights around it, see btf.h. Any
 * thread.
 */
#pragma once

#include "btf.h"

/* Returns the weights (n_lights) with which the pictures of all lights are summed to the picture
 * of light i. taken (n_lights) has the part of each light, NULL for a missing one. Returns NULL
 * if no light was captured; g_free(). */
double *btf_missing_weights(const struct btf_view *view, struct exr_part *const *taken, guint i);

/* Sets the flags of n texels: BTF_FLAG_PREDICTED, or BTF_FLAG_HOLE if any picture with a weight
 * has a hole there. */
void btf_missing_flags(const double *weights, struct exr_part *const *taken, guint n_lights,
                       gsize n, guint8 *ret_flags);

/* Sets the channels B, G and R of a part to the weighted sum. Holes and negative sums become 0. */
void btf_missing_fill(const double *weights, struct exr_part *const *taken, guint n_lights,
                      const guint8 *flags, struct exr_part *part);
