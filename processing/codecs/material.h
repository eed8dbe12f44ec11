/*
 * Whatever holds a material, read from disk and looked at in one way: a BTF, or one of its
 * compressed forms. Any thread; material_reconstruct() from several at once.
 */
#pragma once

#include "eigenmaps/eigenmaps.h"
#include "lobes/lobes.h"

typedef struct Material Material;

struct material_info {
    char *label;      /* to tell it from others: the file's or the session's name, or a method's */
    const char *kind; /* "btf", "lpca", "eigenmaps", "fields", … */
    int width, height, n_views, n_lights;
    const float *view_theta_deg, *view_phi_deg;   /* n_views */
    const float *light_theta_deg, *light_phi_deg; /* n_lights */
    gint64 bytes;                                 /* as a renderer holds it; the BTF in halves */
};

/* A session directory, its products/btf, or an EXR that “mesorig compress” or “mesorig process”
 * wrote. progress, stage "read", is told of BTFs alone and may be NULL. */
Material *material_open(const char *path, const struct work *work, GError **error);
void material_free(Material *material); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Material, material_free)

/* Each takes what it is given; label is copied. */
Material *material_of_btf(const char *label, struct btf_matrix *btf);
Material *material_of_lpca(const char *label, struct lpca *lpca);
Material *material_of_eigenmaps(const char *label, struct eigenmaps *maps);
Material *material_of_lobes(const char *label, struct lobes *lobes);

const struct material_info *material_info(const Material *material);

/* One texel at the measured directions: n_views × n_lights × 3 (R, G, B). */
void material_reconstruct(const Material *material, int texel, float *ret);

/* NULL unless it is a BTF. Owned by the material. */
const struct btf_matrix *material_btf(const Material *material);
