/*
 * Predicts a missing light's picture from those of the lights around it: btf.h. Any thread.
 */
#pragma once

#include "btf.h"

/* Weights (n_lights) of the lights' pictures in that of light i. taken: n_lights, the part of
 * each light, NULL if missing. g_free() the result; NULL if no light was captured. */
double *btf_missing_weights(const struct btf_view *view, struct exr_part *const *taken, guint i);

/* Flags of the n texels: BTF_FLAG_PREDICTED, or a hole if any picture with a weight has one. */
void btf_missing_flags(const double *weights, struct exr_part *const *taken, guint n_lights,
                       gsize n, guint8 *ret_flags);

/* Sets the channels B, G and R of part to the weighted sum, holes to 0. */
void btf_missing_fill(const double *weights, struct exr_part *const *taken, guint n_lights,
                      const guint8 *flags, struct exr_part *part);
