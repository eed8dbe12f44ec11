/* A mesostructure distance function on the graphics card, read by relief.glsl. */
#pragma once

#include "mdf_codecs/mdf_source.h"

#include <glib.h>

typedef struct MdfTexture MdfTexture; /* belongs to the thread of the GL context */

#define MDF_TEXTURE_UNIT 8  /* and the next two */
#define MDF_FACTORS_UNIT 13 /* the weights of factors by direction */

/* Copies what it needs. Views are stored as half floats, blocks as they are (RGTC1, 4 bits per
 * texel), factors as 8-bit maps, four of them at each fetch, whatever the number of views. */
MdfTexture *mdf_texture_new(const struct mdf_source *source, GError **error);
void mdf_texture_free(MdfTexture *texture); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(MdfTexture, mdf_texture_free)

/* Whether it holds factors; shaders are compiled with MDF_MAPS 1 for these, else 0. */
gboolean mdf_texture_is_maps(const MdfTexture *texture);

gint64 mdf_texture_bytes(const MdfTexture *texture); /* 0 of NULL */

/* Sets textures and uniforms of a program in use. */
void mdf_texture_bind(const MdfTexture *texture, guint program);
