/* The parts of maps_new(). */
#pragma once

#include "maps.h"

/* Heights from the MDF of a session, or from the fit's normals. */
gboolean maps_find_heights(struct maps *maps, const char *session, const struct work *work,
                           GError **error);

/*
 * Ambient occlusion of a height field: the share of a white sky's light that arrives, with the
 * horizon of DIRECTIONS azimuths as seen from each texel up to a reach:
 *   1/n Σ cos² θ_k,  θ_k the horizon's elevation.
 * heights in units of a texel's width; outside of the field is nothing.
 */
gboolean maps_find_occlusion(const float *heights, int width, int height, const struct work *work,
                             float *ret, GError **error);

gboolean maps_find_errors(struct maps *maps, const struct maps_register *of,
                          const struct work *work, GError **error);
