/* Cube maps of functions of a direction. */
#pragma once

#include "base/vec.h"
#include <glib.h>

/* Computes the texel (R, G, B, A from 0 to 1) of a direction. */
typedef void (*CubeMapFill)(struct vec3 direction, gpointer data, float ret[4]);

/* Makes a cube map of 16 bits per channel. If filtered is TRUE, it is filtered linearly. Otherwise
 * the nearest texel is used. */
guint cube_map_new(int size, gboolean filtered, CubeMapFill fill, gpointer data);
