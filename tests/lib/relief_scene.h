/*
 * Materials whose surface is a height field and whose reflectance is a formula, as BTF and MDF, for
 * tests that draw structure and reflectance together. They are computed without the program's code.
 * The heights h(x, y) repeat with the tile. The normals are computed from the gradient of the
 * heights. The rays of the MDF march over the heights.
 */
#pragma once

#include "btf_fixture.h"
#include "codecs/lpca/lpca.h"
#include "mdf/mdf_table.h"

enum relief_kind {
    RELIEF_WEAVE,   /* two colours, matt, crossed bumps */
    RELIEF_BUMPS,   /* one colour, glossy, round bumps */
    RELIEF_GROOVES, /* deep grooves along y, slightly glossy */
    RELIEF_KINDS
};

#define RELIEF_TEXELS   32
#define RELIEF_TEXEL_MM 0.25

/* Makes the BTF. Views are on three rings down to 70°, lights on three rings down to 75°, and both
 * include the pole. */
struct btf_matrix *relief_scene_btf(enum relief_kind kind);

/* Makes the MDF with the same number of rings down to 80°. Its depths count from the highest point;
 * mdf_table_free(). */
struct mdf_table *relief_scene_mdf(enum relief_kind kind);

struct lpca *relief_scene_compress(const struct btf_matrix *btf, int clusters, int components);

/* Writes BTF and MDF as files. Each kind has a different form of local PCA: the weave has mip
 * levels in half floats, the bumps a separate grid with 8 bits, and the grooves a separate grid in
 * half floats. MDFs are written as factors, except that the bumps have blocks. */
void relief_scene_write(enum relief_kind kind, const char *material, const char *mdf);
