/* The steps of maps_new(), which maps_make.c calls. */
#pragma once

#include "maps.h"

/* Sets heights_mm, relief_mm, height_holes and heights_from of maps. The heights come from the MDF
 * of the session if it gives at least half of the texels a height. If it does not, or if there is
 * no MDF, the heights come from the normals of the fit. session may be NULL. Fails if the MDF
 * cannot be read or differs from the BTF in its texels. */
gboolean maps_find_heights(struct maps *maps, const char *session, const struct work *work,
                           GError **error);

/* Computes the ambient occlusion of a height field: the share of the light of a uniform sky that
 * reaches a texel. For each texel, the elevations θ_k of the horizon are found in n azimuths, up to
 * a maximum distance:
 *   occlusion = 1/n Σ_k cos² θ_k.
 * heights are in units of a texel's width. There is no surface outside of the field. */
gboolean maps_find_occlusion(const float *heights, int width, int height, const struct work *work,
                             float *ret, GError **error);

/* Fills maps->errors: compares the maps, rounded to 8 bits, with the BTF. Fails if the scratch file
 * of the BTF cannot be read, or if cancelled. The progress stage is "errors". */
gboolean maps_find_errors(struct maps *maps, const struct maps_register *of,
                          const struct work *work, GError **error);
