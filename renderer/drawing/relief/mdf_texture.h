/* A mesostructure distance function on the graphics card, read by relief.glsl. */
#pragma once

#include "codecs/mdf_codecs/mdf_source.h"

#include <glib.h>

typedef struct MdfTexture MdfTexture; /* belongs to the thread of the GL context */

#define MDF_TEXTURE_UNIT 8  /* the texture uses this unit and the next two */
#define MDF_FACTORS_UNIT 13 /* unit of the factors' weights, by direction */

/* Makes the texture of an MDF, and copies everything that it needs. The layout of the texture
 * depends on the form of the MDF:
 * - Views are stored as half floats.
 * - Blocks are stored unchanged (RGTC1, 4 bits per texel).
 * - Factors are stored as 8-bit maps. A texel of the texture has the values of four maps. The
 *   number of maps does not depend on the number of views. */
MdfTexture *mdf_texture_new(const struct mdf_source *source, GError **error);
void mdf_texture_free(MdfTexture *texture); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(MdfTexture, mdf_texture_free)

/* Returns whether the texture holds factors. If so, shaders are compiled with MDF_MAPS 1, and
 * otherwise with MDF_MAPS 0. */
gboolean mdf_texture_is_maps(const MdfTexture *texture);

gint64 mdf_texture_bytes(const MdfTexture *texture); /* GPU memory; 0 for NULL */

/* Makes the form that Wang et al. 2005 §5 describe, for comparison. Shaders are compiled with
 * MDF_VOLUME 1. The first call makes the texture from the views.
 *
 * The texture is 3D. Its third axis is the view; its slices are those of drawing/gl/ring_slices.h.
 * A texel has the distance along the ray as 8 bits, with one scale for all texels. The texture is
 * filtered trilinearly, without mip levels. The filter interpolates between views of a ring, and
 * the shader interpolates between two rings.
 *
 * Fails if the MDF is in factors, if the views are not on evenly spaced rings, or if the views do
 * not fit into a 3D texture of the card. */
gboolean mdf_texture_make_volume(MdfTexture *texture, GError **error);

/* Makes the shell of the MDF (mdf/mdf_shell.h), in an array texture with mip levels. The first call
 * takes about a second for 60 views of 64² texels. Shaders are compiled with MDF_SHELL 1. Fails if
 * the shell is too large for the card. After a failure, the MdfTexture must be freed. */
gboolean mdf_texture_make_shell(MdfTexture *texture, GError **error);

/* Makes the depths of the measured views and the triangulation of these views, for along.glsl.
 * Fails if the depths are too large for the card. */
gboolean mdf_texture_make_along(MdfTexture *texture, GError **error);

/* Sets the textures that mdf_texture_make_along() has made, and their uniforms, in a program in
 * use. The textures use the units 8 to 10 and 13. Does nothing before mdf_texture_make_along(). */
void mdf_texture_bind_along(const MdfTexture *texture, guint program);

/* Sets ret to the width and height of the sample in mm. */
void mdf_texture_size_mm(const MdfTexture *texture, float ret[2]);

/* Sets the textures and uniforms of the MDF in a program in use. */
void mdf_texture_bind(const MdfTexture *texture, guint program);
