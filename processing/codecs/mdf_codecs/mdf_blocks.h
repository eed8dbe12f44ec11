/* Depths in blocks of 4 × 4 texels. A block has 8 bytes, which is 4 bits per texel, in the format
 * RGTC1 (also called BC4), which graphics cards read with one fetch. A block has two end values of
 * 8 bits. Each texel has an index that chooses one of eight values between the two ends.
 *
 * On disk, an MDF in such blocks is one EXR file:
 *   part "view_0000" …  channels "B0" … "B7", half, one pixel per block: its bytes, 0 … 255
 * The attributes of each part are view.theta_deg and view.phi_deg (double). The first part also has
 * mesorig.kind = "mdf-blocks", mesorig.width, mesorig.height (int, texels), texel_mm, least_mm,
 * deepest_mm and mesorig.error_mm (double). The end value 0 of a block stands for the depth
 * least_mm (member min_mm), and 255 for the depth deepest_mm. Depths are below the reference plane.
 * Texels that no laser saw have the depths of their neighbours. */
#pragma once

#include <glib.h>

#include "mdf/mdf_table.h"

#define MDF_BLOCK_BYTES 8
#define MDF_BLOCK_SIDE  4

/* Returns the number of blocks along a side of n texels. If n is not a multiple of 4, the last
 * block extends beyond the texels. */
int mdf_blocks_across(int n);
/* Returns the bytes of all blocks of width × height texels. */
gsize mdf_blocks_bytes(int width, int height);

/* Encode depths (height × width) to blocks, and decode them. The value 0 stands for the depth
 * least, 255 for the depth deepest. The encoder optimises the end values with fixed indices and the
 * indices with fixed end values, in turn. */
void mdf_blocks_encode(const float *depth, int width, int height, double least, double deepest,
                       guint8 *ret);
void mdf_blocks_decode(const guint8 *blocks, int width, int height, double least, double deepest,
                       float *ret_depth);

struct mdf_blocks {
    int width, height, n_views;
    double texel_mm, min_mm, deepest_mm;
    float *theta_deg, *phi_deg; /* direction of each view */
    guint8 *blocks;             /* n_views × mdf_blocks_bytes() */
    double error_mm;            /* RMS error, see mdf_table_difference() */
};

/* Encodes all views of a table, and measures error_mm. mdf_blocks_table() decodes the views. */
struct mdf_blocks *mdf_blocks_new(const struct mdf_table *table);
typedef struct mdf_blocks MdfBlocks;
void mdf_blocks_free(struct mdf_blocks *blocks); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(MdfBlocks, mdf_blocks_free)
struct mdf_table *mdf_blocks_table(const struct mdf_blocks *blocks);

/* Writes or reads a file. Errors are in the domain EXR_ERROR. */
gboolean mdf_blocks_write(const char *path, const struct mdf_blocks *blocks, GError **error);
struct mdf_blocks *mdf_blocks_read(const char *path, GError **error);
