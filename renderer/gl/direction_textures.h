/*
 * Interpolation weights of measured directions as two textures over all directions: the indices of
 * the measured ones, and their weights. Filled by direction_table.h and direction_cube.h. Thread of
 * the GL context.
 */
#pragma once

#include <glib.h>

struct direction_textures {
    guint target; /* GL_TEXTURE_2D or GL_TEXTURE_CUBE_MAP, of both */
    guint indices, weights;
};

void direction_textures_clear(struct direction_textures *textures);

gint64 direction_textures_bytes(const struct direction_textures *textures);

/* Binds to units unit and unit + 1 of the current program, as NAME_indices and NAME_weights. */
void direction_textures_bind(const struct direction_textures *textures, guint program,
                             const char *name, int unit);
