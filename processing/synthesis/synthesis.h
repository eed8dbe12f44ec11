/* Synthesis of a larger material from a sample, as an index map (index_map.h). Makes the map with
 * its mip levels from a whole BTF and its MDF, and computes figures of its quality. */
#pragma once

#include "index_map.h"
#include "order.h"
#include "texel_features.h"

enum synthesis_method {
    /* Tries textons and quilting. Chooses textons, which repeat no whole blocks. Chooses quilting
     * only if it keeps the sample's order better (order.h) by more than SYNTHESIS_SPARE. */
    SYNTHESIS_AUTO,
    SYNTHESIS_TEXTONS,
    SYNTHESIS_QUILTING,
    SYNTHESIS_TILEABLE, /* a part of the sample that can be repeated (tileable.h) */
    SYNTHESIS_METHODS
};

#define SYNTHESIS_SPARE 0.01

extern const char *const synthesis_names[SYNTHESIS_METHODS];

struct synthesis_options {
    enum synthesis_method method;
    int width, height; /* size of the map in texels; ignored by SYNTHESIS_TILEABLE */
    int block;         /* for quilting; 0 means quilting_block() */
    guint32 seed;
};

struct synthesis_result {
    enum synthesis_method method; /* the method by which the map was made */
    /* order_difference() of each method that was tried (textons, quilting); −1 for the others */
    double order[SYNTHESIS_METHODS];
    struct order_seams seams;
    int n_features;
    double explained, relief; /* see struct texel_features */
};

/* Synthesises a map with its mip levels from features. Free it with index_map_free(). Sizes and
 * block must be valid, as checked by synthesis_of_session(). Returns NULL with an error when
 * cancelled. The progress stages are "textons" and "quilting", for the methods of these names. */
struct index_map *synthesis_of_features(const struct texel_features *features,
                                        const struct synthesis_options *options,
                                        const struct work *work, struct synthesis_result *ret,
                                        GError **error);

/* Synthesises a map from the BTF of a session, and from its MDF if it has one. memory is as in
 * btf_matrix_read_within(). The error is DATA_ERROR_INVALID if the sample is too small or too
 * large, or if a size or the block is out of range; the message names the option. Other errors are
 * those of the functions that read the BTF and the MDF. The progress stages are "read",
 * "components" and those of synthesis_of_features(). */
struct index_map *synthesis_of_session(const char *path, gint64 memory,
                                       const struct synthesis_options *options,
                                       const struct work *work, struct synthesis_result *ret,
                                       GError **error);

/* Makes the mip levels of a map from level 0. A texel of level n stands for a block, and this block
 * covers up to four blocks of level n − 1. Each of these gives a candidate: the square of the
 * sample that has the smaller block at the same place, moved so that it stays within the sample.
 * The candidate is chosen whose mean in the sample is nearest to the mean of the texels in the map.
 *
 * A block of the last level is at most as wide as the shorter side of the map, and as a quarter of
 * the shorter side of the sample. There are at most INDEX_MAP_LEVELS levels. */
void synthesis_add_levels(const struct texel_features *features, struct index_map *map);
