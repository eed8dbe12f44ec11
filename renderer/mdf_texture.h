/* A mesostructure distance function on the card, for shaders that have mdf.glsl. */
#pragma once

#include "mdf_table.h"

typedef struct MdfTexture MdfTexture; /* belongs to the thread of the GL context */

#define MDF_TEXTURE_UNIT 8 /* and the next two */

/* Copies what it needs. */
MdfTexture *mdf_texture_new(const struct mdf_table *table, GError **error);
void mdf_texture_free(MdfTexture *texture); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(MdfTexture, mdf_texture_free)

gint64 mdf_texture_bytes(const MdfTexture *texture); /* 0 of NULL */

/* Sets textures and uniforms of a program in use. */
void mdf_texture_bind(const MdfTexture *texture, guint program);
