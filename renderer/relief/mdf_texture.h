/* A mesostructure distance function on the card, for shaders that have mdf.glsl. */
#pragma once

#include "mdf_codecs/mdf_blocks.h"
#include "mdf_codecs/mdf_factors.h"

typedef struct MdfTexture MdfTexture; /* belongs to the thread of the GL context */

#define MDF_TEXTURE_UNIT 8  /* and the next two */
#define MDF_FACTORS_UNIT 13 /* of what compressed ones have beside them */

/* Copies what it needs. */
MdfTexture *mdf_texture_new(const struct mdf_table *table, GError **error);
/* The same at 4 bits a texel: views of the table, of which those in blocks are taken as they are;
 * or NULL. */
MdfTexture *mdf_texture_new_blocks(const struct mdf_table *table, const struct mdf_blocks *blocks,
                                   GError **error);

/* The same from few maps: four of them at each fetch, whatever the number of views. */
MdfTexture *mdf_texture_new_factors(const struct mdf_factors *factors, GError **error);
void mdf_texture_free(MdfTexture *texture); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(MdfTexture, mdf_texture_free)

/* Whether it is made up of maps: shaders take it for the constant MDF_MAPS, 0 or 1. */
gboolean mdf_texture_is_maps(const MdfTexture *texture);

gint64 mdf_texture_bytes(const MdfTexture *texture); /* 0 of NULL */

/* Sets textures and uniforms of a program in use. */
void mdf_texture_bind(const MdfTexture *texture, guint program);
