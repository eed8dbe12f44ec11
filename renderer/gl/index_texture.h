/*
 * An index map (synthesis/index_map.h) on the graphics card, read by places.glsl: through it, a
 * point of the surface has up to four places in the sample, at each of which the material is
 * evaluated and its MDF read as if the sample were repeated there.
 *
 * Derivatives are those of the point, so that the sample's own mip levels fit. Texels of the map
 * whose neighbours are neighbours in the sample as well are filtered by the sample's filter;
 * others are interpolated one by one. Where the surface is drawn small, the map's own mip levels
 * are read, a texel of which stands for a block.
 */
#pragma once

#include "synthesis/index_map.h"

typedef struct IndexTexture IndexTexture; /* belongs to the thread of the GL context */

#define INDEX_TEXTURE_UNIT 15 /* higher than those of methods, viewer and relief */

/* Copies what it needs. Two 16-bit integers per texel. */
IndexTexture *index_texture_new(const struct index_map *map, GError **error);
void index_texture_free(IndexTexture *texture); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(IndexTexture, index_texture_free)

gint64 index_texture_bytes(const IndexTexture *texture); /* 0 of NULL */

/* Sets the texture and uniforms of a program in use. */
void index_texture_bind(const IndexTexture *texture, guint program);

/* Tiles of the sample each way after which the map repeats. */
void index_texture_period(const IndexTexture *texture, double ret[2]);
