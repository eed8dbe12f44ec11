/*
 * A material in memory, with one interface for all its forms: a BTF, or the model that a codec made
 * of one. Any thread; material_reconstruct() from several at once.
 */
#pragma once

#include "codec.h"

typedef struct Material Material;

/* The BTF itself, seen as a codec that loses nothing: free, layout, bytes, reconstruct and evaluate
 * alone. Its models are struct btf_matrix with values in memory. */
extern const struct codec material_btf_codec;

/* Takes model; label is copied. */
Material *material_new(const char *label, const struct codec *codec, gpointer model);
/* The same as material_new() for a model that the caller keeps and that outlives the material. */
Material *material_borrow(const char *label, const struct codec *codec, gconstpointer model);
void material_free(Material *material); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Material, material_free)

const struct material_info *material_info(const Material *material);

/* One texel at the measured directions: n_views × n_lights × 3 (R, G, B). */
void material_reconstruct(const Material *material, int texel, float *ret);

/* NULL unless it is a BTF. Owned by the material. */
const struct btf_matrix *material_btf(const Material *material);
