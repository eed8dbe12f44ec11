/* Cube maps that tell something of every direction. */
#pragma once

#include "base/vec.h"
#include <glib.h>

/* The direction of the centre of texel (i, j) of a face of size texels each way, faces in the order
 * of OpenGL: +x, −x, +y, −y, +z, −z. */
struct vec3 cube_map_direction(int face, int i, int j, int size);

/* Four values, 0 … 1, of a direction. */
typedef void (*CubeMapFill)(struct vec3 direction, gpointer data, float ret[4]);

/* Of 16 bits a value; filtered or not. */
guint cube_map_new(int size, gboolean filtered, CubeMapFill fill, gpointer data);
