/* Cube maps of functions of a direction. */
#pragma once

#include "base/vec.h"
#include <glib.h>

/* Computes the texel (R, G, B, A of 0 … 1) of a direction. */
typedef void (*CubeMapFill)(struct vec3 direction, gpointer data, float ret[4]);

/* A cube map of 16 bits per channel; filtered: linearly, else nearest. */
guint cube_map_new(int size, gboolean filtered, CubeMapFill fill, gpointer data);
