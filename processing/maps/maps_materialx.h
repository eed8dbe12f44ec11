/* The parts of the MaterialX export that the USD export shares. Any thread. */
#pragma once

#include "maps.h"
#include "maps_graph.h"

/* Writes the nodes of the shading model standard_surface. The last one is named "surface". The
 * nodes read maps of maps_add_maps(), and the map of maps_materialx_add_weight(). */
void maps_materialx_surface(const struct maps_graph *graph, const struct maps *maps);
/* Adds the map NAME_SpecularWeight. */
gboolean maps_materialx_add_weight(const struct maps *maps, MapsFiles *files, GError **error);
/* Returns the factor by which the specular weight and colour of a texel multiply the reflectance of
 * 4 %. */
double maps_materialx_specular(const struct maps_texel *texel);
