/* A material in memory, with one interface for all its forms: a BTF, or the model that a codec made
 * of a BTF. Any thread; material_reconstruct() may be called from several threads at the same
 * time. */
#pragma once

#include "codec.h"

typedef struct Material Material;

/* The BTF itself as a lossless codec. Only name, free, layout, bytes, reconstruct and evaluate are
 * set. Its models are struct btf_matrix with values in memory. */
extern const struct codec material_btf_codec;

/* Takes ownership of model. label is copied. */
Material *material_new(const char *label, const struct codec *codec, gpointer model);
/* The same as material_new(), except that the caller keeps the model, which must outlive the
 * material. */
Material *material_borrow(const char *label, const struct codec *codec, gconstpointer model);
void material_free(Material *material); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Material, material_free)

const struct material_info *material_info(const Material *material);

/* Reconstructs one texel at the measured directions: n_views × n_lights × 3 (R, G, B). */
void material_reconstruct(const Material *material, int texel, float *ret);

/* Return the codec of a material and its model. Owned by the material. */
const struct codec *material_codec(const Material *material);
gconstpointer material_model(const Material *material);

/* Returns the BTF, or NULL if the material has another form. Owned by the material. */
const struct btf_matrix *material_btf(const Material *material);
