/*
 * Eigen-maps on the graphics card: BTF(x, v, l) = Σ_i W_i(v) E_i(x, l) (Wang et al. 2005 §5).
 * Values between the measured directions are interpolated with directions.h.
 *
 * The maps are the layers of one array texture of half floats, with mipmaps. The texture repeats.
 * Each term has a layer for each light, then a layer for the pole, and then a layer for an even
 * sky. The layer of the pole is the mean of the topmost ring of lights. The layer of the sky is the
 * reflectance under a sky of even radiance, (1/π) ∫ BTF dω.
 *
 * W is tabulated over the hemisphere and filtered. For the light, a finer table (direction_table.h)
 * has the numbers and weights of up to four layers that are mixed.
 */
#pragma once

#include "codecs/eigenmaps/eigenmaps.h"
#include "method.h"

typedef struct EigenmapsView EigenmapsView; /* belongs to the thread of the GL context */

/* Makes the view. Copies everything that it needs from maps. */
EigenmapsView *eigenmaps_view_new(const struct eigenmaps *maps, GError **error);
void eigenmaps_view_free(EigenmapsView *view); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(EigenmapsView, eigenmaps_view_free)

/* For eigenmaps_volume.h. Checks the eigen-maps. Returns FALSE with GPU_ERROR_FAILED if they are
 * empty or if a weight is not finite. Returns FALSE with GPU_ERROR_TOO_LARGE if they have more
 * texels than a texture of the card can have. */
gboolean eigenmaps_view_check(const struct eigenmaps *maps, GError **error);

/* For eigenmaps_volume.h. Makes the texture of the weights W over the hemisphere, four terms per
 * layer. Returns 0 with an error if the views cannot be interpolated. */
guint eigenmaps_view_weights(const struct eigenmaps *maps, GError **error);

extern const struct method method_eigenmaps; /* its material is an EigenmapsView */
