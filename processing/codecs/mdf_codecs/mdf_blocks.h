/*
 * Depths in blocks of 4 × 4 texels and 8 bytes, 4 bits per texel, as cards read them at one fetch
 * (RGTC1, also called BC4): two ends of 8 bits, and for each texel an index that chooses one of
 * eight values from one end to the other.
 *
 * On disk, an MDF of such views is one EXR file:
 *   part "view_0000" …  channels "B0" … "B7", half, one pixel per block: its bytes, 0 … 255
 * Attributes of each: view.theta_deg, view.phi_deg (double); of the first also mesorig.kind =
 * "mdf-blocks", mesorig.width, mesorig.height (int, texels), texel_mm, least_mm, deepest_mm,
 * mesorig.error_mm (double). Depths are from least_mm, 0 in the blocks, to deepest_mm, 1 in them;
 * texels that no laser saw have those of their neighbours.
 */
#pragma once

#include <gio/gio.h>

#include "mdf/mdf_table.h"

#define MDF_BLOCK_BYTES 8
#define MDF_BLOCK_SIDE  4

/* Blocks along a side of n texels; the last one may be partly beyond them. */
int mdf_blocks_across(int n);
/* Bytes of all blocks of width × height texels. */
gsize mdf_blocks_bytes(int width, int height);

/* depth: height × width, from least to deepest. Ends and indices are optimised in turn, each with
 * the other fixed. */
void mdf_blocks_encode(const float *depth, int width, int height, double least, double deepest,
                       guint8 *ret);
void mdf_blocks_decode(const guint8 *blocks, int width, int height, double least, double deepest,
                       float *ret_depth);

struct mdf_blocks {
    int width, height, n_views;
    double texel_mm, least_mm, deepest_mm;
    float *theta_deg, *phi_deg; /* of each view */
    guint8 *blocks;             /* n_views × mdf_blocks_bytes() */
    double error_mm;            /* mdf_table_difference() */
};

struct mdf_blocks *mdf_blocks_new(const struct mdf_table *table);
typedef struct mdf_blocks MdfBlocks;
void mdf_blocks_free(struct mdf_blocks *blocks); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(MdfBlocks, mdf_blocks_free)
struct mdf_table *mdf_blocks_table(const struct mdf_blocks *blocks);

gboolean mdf_blocks_write(const char *path, const struct mdf_blocks *blocks, GError **error);
struct mdf_blocks *mdf_blocks_read(const char *path, GError **error);
