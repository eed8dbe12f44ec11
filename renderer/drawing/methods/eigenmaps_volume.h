/*
 * Eigen-maps in the form that Wang et al. 2005 §5 describe, to compare with eigenmaps_view.h. The
 * lights are the third axis of a 3D texture of half floats. The filter of the texture interpolates
 * between neighbouring lights of a ring (gl/ring_slices.h). A term takes the slices of all lights,
 * and then one slice for a sky of even radiance. Above the topmost ring, the light is that of the
 * nearest azimuth of this ring. There are no mip levels, because they would also average over the
 * lights.
 */
#pragma once

#include "codecs/eigenmaps/eigenmaps.h"
#include "method.h"

typedef struct EigenmapsVolume EigenmapsVolume; /* belongs to the thread of the GL context */

/* Makes the texture. Copies everything that it needs from maps. The error is GPU_ERROR_FAILED if
 * the lights are not on evenly spaced rings or the maps are damaged, and GPU_ERROR_TOO_LARGE if the
 * texture is too large for the card. */
EigenmapsVolume *eigenmaps_volume_new(const struct eigenmaps *maps, GError **error);
void eigenmaps_volume_free(EigenmapsVolume *volume); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(EigenmapsVolume, eigenmaps_volume_free)

extern const struct method method_eigenmaps_volume; /* its material is an EigenmapsVolume */
