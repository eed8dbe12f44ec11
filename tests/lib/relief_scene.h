/*
 * Materials that are a height field with a formula for reflectance, as BTF and MDF, computed
 * without the program's code: heights h(x, y) repeat with the tile, normals are their gradient's,
 * and rays of the MDF march over them. For tests that draw structure and reflectance together.
 */
#pragma once

#include "btf_fixture.h"
#include "codecs/lpca/lpca.h"
#include "mdf/mdf_table.h"

enum relief_kind {
    RELIEF_WEAVE,   /* two colours, matt, crossing bumps */
    RELIEF_BUMPS,   /* one colour, glossy, round bumps */
    RELIEF_GROOVES, /* deep grooves along y, a little glossy */
    RELIEF_KINDS
};

#define RELIEF_TEXELS   32
#define RELIEF_TEXEL_MM 0.25

/* Views and lights on three rings down to 70° and 75°, and the pole of each. */
struct btf_matrix *relief_scene_btf(enum relief_kind kind);

/* The same views and rings of 80°; depths below the highest point. mdf_table_free() */
struct mdf_table *relief_scene_mdf(enum relief_kind kind);

struct lpca *relief_scene_compress(const struct btf_matrix *btf, int clusters, int components);

/* Both as files, a form of local PCA each: the weave's with mip levels in halves, the bumps' on a
 * grid of its own with 8 bits, the grooves' in halves; MDFs as factors, that of the bumps as
 * blocks. */
void relief_scene_write(enum relief_kind kind, const char *material, const char *mdf);
