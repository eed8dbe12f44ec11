/* Cube maps of functions of a direction. */
#pragma once

#include "base/vec.h"
#include <glib.h>

/* Computes the colour (R, G, B, A, each from 0 to 1) of the texel in a direction. data is the
 * pointer that was given to cube_map_new(). */
typedef void (*CubeMapFill)(struct vec3 direction, gpointer data, float ret[4]);

/* Returns a new cube map texture with faces of size × size texels and 16 bits per channel. It is
 * filtered linearly if filtered is TRUE, and unfiltered otherwise. */
guint cube_map_new(int size, gboolean filtered, CubeMapFill fill, gpointer data);
