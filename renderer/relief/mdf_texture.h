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

/* The published form (Wang et al. 2005 §5), for comparison: 8 bits per distance in a 3D texture
 * whose third axis is the view, filtered trilinearly, without mip levels. Between views of a ring
 * the texture's filter interpolates; the shader mixes two rings. The texture is made from the views
 * when it is first asked for; the first view of each ring is repeated at its end. Shaders are
 * compiled with MDF_VOLUME 1. Fails where the MDF is in factors, or its views are not on at most
 * MDF_VOLUME_RINGS rings, each evenly spaced. */
#define MDF_VOLUME_RINGS 16
gboolean mdf_texture_make_volume(MdfTexture *texture, GError **error);

/* Sets textures and uniforms of a program in use. */
void mdf_texture_bind(const MdfTexture *texture, guint program);
