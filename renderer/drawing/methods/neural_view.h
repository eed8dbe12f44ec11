/*
 * Neural planes (neural.h) on the graphics card. The surface is an array texture of bytes. The
 * heights are also bytes in the file, but their texture has half floats of the same values. The
 * reason is that some cards and llvmpipe round the filtered values of byte textures to bytes, which
 * is too coarse for slopes and shadows. The planes over directions and the network are decoded to
 * floats, which take a few kilobytes. The scales of the channels of the surface are part of the
 * weights of the first layer.
 *
 * A pixel is evaluated at its own place, with one ray, as neural_evaluate_points() does. If texels
 * are not filtered, a pixel has the colour of its texel instead, from four rays.
 * docs/lab/rendering.md compares both with captures.
 *
 * Between two mip levels, each read of a texture is interpolated, and the network is evaluated
 * once. The card computes the mip levels that a file lacks, and all levels of the heights.
 *
 * For an even sky, (1/π) ∫ B dω is computed beforehand for each texel and NEURAL_SKY × NEURAL_SKY
 * views (neural_drawing.h), as a sum over 16 lights. The result is read at the place where the ray
 * ends. If the material has many texels, the texels of a coarser mip level are used.
 */
#pragma once

#include "codecs/neural/neural.h"
#include "method.h"

typedef struct NeuralView NeuralView; /* belongs to the thread of the GL context */

/* Makes the view of a model and its n − 1 mip levels. Copies everything that it needs. */
NeuralView *neural_view_new(struct neural *const *levels, int n, GError **error);
void neural_view_free(NeuralView *view); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(NeuralView, neural_view_free)

extern const struct method method_neural; /* its material is a NeuralView */
