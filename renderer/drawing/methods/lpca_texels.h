/* The common part of the methods that draw a local PCA: checks, and the clusters and weights of the
 * texels as textures. lpca_texel.glsl reads these textures. */
#pragma once

#include "codecs/lpca/lpca.h"
#include "codecs/lpca/lpca_levels.h"
#include "directions/directions.h"
#include "method.h"

/* A local PCA and its mip levels, with one list of clusters for all levels. `lpca` is level 0 with
 * the eigen-BRDFs of the clusters of all levels, one level after the other. */
struct lpca_pyramid {
    struct lpca *lpca;
    gboolean owned; /* whether `lpca` is a copy that must be freed; otherwise it is levels[0] */
    int n_levels;
    const struct lpca *levels[LPCA_MAX_LEVELS]; /* borrowed */
    int first[LPCA_MAX_LEVELS];                 /* number of the first cluster of each level */
};

/* Initializes a pyramid. levels must live longer than the pyramid. Checks that all values are
 * finite and that the levels fit together:
 * - Each level has half the width and height of the level before, but at least 1 texel.
 * - All levels have the same directions.
 * - All levels together have at most 65535 clusters. */
gboolean lpca_pyramid_init(struct lpca_pyramid *pyramid, struct lpca *const *levels, int n,
                           GError **error);
void lpca_pyramid_clear(struct lpca_pyramid *pyramid);

/* Returns FALSE with an error if the values are logarithms (LPCA_LOG). A linear interpolation of
 * logarithms between directions is not a linear interpolation of reflectances. */
gboolean lpca_pyramid_is_linear(const struct lpca_pyramid *pyramid, GError **error);

/* Uploads n levels to the card, and does not keep them. Returns a method's material, or NULL on
 * error. */
typedef gpointer (*LpcaMake)(struct lpca *const *levels, int n, GError **error);
/* Implements a method's function open(): reads all levels of a file, calls make with them, and
 * returns its result. */
gpointer lpca_open_levels(const char *path, LpcaMake make, GError **error);

struct lpca_texels {
    int width, height; /* of level 0 */
    int n_components, n_levels;
    /* whether the values are logarithms, so that each texel must be evaluated before texels are
     * mixed */
    gboolean log;
    guint weights, clusters; /* textures of lpca_texel.glsl */
};

/* Initializes the textures. scales is NULL, or has the factors by which the weights of each cluster
 * are multiplied, n_clusters × (n_components + 1) as in struct lpca. */
gboolean lpca_texels_init(struct lpca_texels *texels, const struct lpca_pyramid *pyramid,
                          const float *scales, GError **error);
void lpca_texels_clear(struct lpca_texels *texels);

/* Returns the constants of lpca_texel.glsl; see struct method. Free them with g_free(). */
char *lpca_texels_constants(const struct lpca_texels *texels, const struct method_style *style);

/* Sets ret to the numbers of columns and rows of level 0. Always returns TRUE. */
gboolean lpca_texels_size(const struct lpca_texels *texels, int ret[2]);
gint64 lpca_texels_bytes(const struct lpca_texels *texels);

/* Binds the textures to texture units 1 and 2 of a program in use. */
void lpca_texels_bind(const struct lpca_texels *texels, guint program);

/* How the tables of the clusters lie in an array texture. Each cluster has a block of n_columns ×
 * n_rows texels. Blocks are stacked below each other in a layer, as many as the card allows. */
struct lpca_stack {
    int n_columns, n_rows; /* size of a block, texels */
    int clusters_a_layer, n_layers;
};

/* Computes the layout. Fails if the card cannot hold the tables. advice is appended to the error,
 * and says what the user can do. */
gboolean lpca_stack_init(struct lpca_stack *stack, int n_clusters, int n_columns, int n_rows,
                         const char *advice, GError **error);
/* Returns a new texture of half floats with this layout, or 0 on error. */
guint lpca_stack_texture(const struct lpca_stack *stack, GError **error);
/* Clamps the values of a cluster's block (RGB), in place, to the range of half floats, and uploads
 * them to the texture that is bound. */
void lpca_stack_put(const struct lpca_stack *stack, int cluster, float *values);

struct lpca_directions {
    Directions *views, *lights;
    float *sky; /* share of each light in an even sky */
};

/* Makes the tables of directions. For triangulated, see directions_new_triangulated(). */
gboolean lpca_directions_init(struct lpca_directions *directions, const struct lpca *lpca,
                              gboolean triangulated, GError **error);
void lpca_directions_clear(struct lpca_directions *directions);
