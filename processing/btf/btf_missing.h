/*
 * The picture of a light that was not taken, by those of the lights around it: see btf.h. Any
 * thread.
 */
#pragma once

#include "btf.h"

/* Of each light's picture in that of light i; taken has the part of each light that is there, else
 * NULL. g_free(); NULL if none is. */
double *btf_missing_weights(const struct btf_view *view, struct exr_part *const *taken, guint i);

/* Predicted, or a hole where a texel is one in any picture with a weight. n: texels. */
void btf_missing_marks(const double *weights, struct exr_part *const *taken, guint n_lights,
                       gsize n, guint8 *ret_marks);

/* B, G and R of part; holes are 0. */
void btf_missing_fill(const double *weights, struct exr_part *const *taken, guint n_lights,
                      const guint8 *marks, struct exr_part *part);
