/*
 * An index map (synthesis/index_map.h) on the graphics card, read by places.glsl. Through the map,
 * a point of the surface has up to four places in the sample. At each place, the material is
 * evaluated and its MDF is read as if the sample were repeated.
 *
 * Texture lookups use the derivatives of the point on the surface, so that they read the right mip
 * level of the sample. Where the neighbours of a texel of the map are also neighbours in the
 * sample, the sample's own filter is used. Other texels are interpolated one by one. Where the
 * surface is drawn small, mip levels of the map are read. One texel of such a level stands for a
 * block of texels of the map.
 */
#pragma once

#include "synthesis/index_map.h"

typedef struct IndexTexture IndexTexture; /* belongs to the thread of the GL context */

#define INDEX_TEXTURE_UNIT 15 /* higher than the texture units of methods, viewer and relief */

/* Makes the texture, with two 16-bit integers per texel. Copies everything that it needs from
 * map. */
IndexTexture *index_texture_new(const struct index_map *map, GError **error);
void index_texture_free(IndexTexture *texture); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(IndexTexture, index_texture_free)

gint64 index_texture_bytes(const IndexTexture *texture); /* GPU memory; 0 for NULL */

/* Sets the texture and the uniforms of a program. The program must be in use. */
void index_texture_bind(const IndexTexture *texture, guint program);

/* Returns the number of tiles of the sample in each direction after which the map repeats. */
void index_texture_period(const IndexTexture *texture, double ret[2]);
