/*
 * Interpolation weights of measured directions as two textures over all directions. One has the
 * indices of the measured directions, the other their weights. direction_table.h and
 * direction_cube.h make the textures. The functions belong to the thread of the GL context.
 */
#pragma once

#include <glib.h>

struct direction_textures {
    guint target; /* target of both textures: GL_TEXTURE_2D or GL_TEXTURE_CUBE_MAP */
    guint indices, weights;
};

void direction_textures_clear(struct direction_textures *textures);

gint64 direction_textures_bytes(const struct direction_textures *textures);

/* Binds the textures to the texture units `unit` and `unit + 1`, and makes them the samplers
 * NAME_indices and NAME_weights of the current program. */
void direction_textures_bind(const struct direction_textures *textures, guint program,
                             const char *name, int unit);
