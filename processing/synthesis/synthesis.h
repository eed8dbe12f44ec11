/*
 * Synthesis of a larger material from a sample, as an index map (index_map.h): from a whole BTF and
 * its MDF to the map with its mip levels, and the figures of how well it went.
 */
#pragma once

#include "index_map.h"
#include "order.h"
#include "texel_features.h"

enum synthesis_method {
    SYNTHESIS_AUTO, /* makes both of the next and takes textons, which repeat no whole blocks,
                       unless quilting keeps the sample's order better (order.h) by more than
                       SYNTHESIS_SPARE */
    SYNTHESIS_TEXTONS,
    SYNTHESIS_QUILTING,
    SYNTHESIS_TILEABLE, /* a part of the sample that can be repeated (tileable.h) */
    SYNTHESIS_METHODS
};

#define SYNTHESIS_SPARE 0.01

extern const char *const synthesis_names[SYNTHESIS_METHODS];

struct synthesis_options {
    enum synthesis_method method;
    int width, height; /* of the map, in texels; not of SYNTHESIS_TILEABLE */
    int block;         /* of quilting; 0: quilting_block() */
    guint32 seed;
};

struct synthesis_result {
    enum synthesis_method method;    /* that the map was made by */
    double order[SYNTHESIS_METHODS]; /* order_difference() of those that were tried, else −1 */
    struct order_seams seams;
    int n_features;
    double explained, relief; /* see struct texel_features */
};

/* From features. Sizes and block must be possible, as synthesis_of_session() checks them. NULL when
 * cancelled. */
struct index_map *synthesis_of_features(const struct texel_features *features,
                                        const struct synthesis_options *options,
                                        const struct work *work, struct synthesis_result *ret,
                                        GError **error);

/* The same from a session, of which the BTF must be there and the MDF is used if it is. memory: as
 * of btf_matrix_read_within(). DATA_ERROR_INVALID names the option that is out of range. */
struct index_map *synthesis_of_session(const char *path, gint64 memory,
                                       const struct synthesis_options *options,
                                       const struct work *work, struct synthesis_result *ret,
                                       GError **error);

/*
 * Makes the mip levels of a map from level 0. A block of level n is one of the blocks of level n −
 * 1 that it is made of, moved to where it belongs, so that it stays within the sample; of these,
 * the one whose mean in the sample is nearest to the mean of what stands in the map. Levels end
 * where a block has a quarter of the sample's shorter side.
 */
void synthesis_add_levels(const struct texel_features *features, struct index_map *map);
