/* The common part of the methods that draw a local PCA: checks, and the clusters and weights of the
 * texels as textures, which lpca_texel.glsl reads. */
#pragma once

#include "directions/directions.h"
#include "lpca/lpca.h"
#include "lpca/lpca_levels.h"
#include "method.h"

/* A local PCA and its mip levels joined into one: level 0, with the eigen-BRDFs of the clusters of
 * all levels one after the other. */
struct lpca_pyramid {
    struct lpca *lpca;
    gboolean owned; /* not levels[0] itself */
    int n_levels;
    const struct lpca *levels[LPCA_MAX_LEVELS]; /* borrowed; their clusters are counted from */
    int first[LPCA_MAX_LEVELS];                 /* this one */
};

/* Checks that all values are finite and that the levels fit together: each has half the texels of
 * the one before, all have the same directions. levels must outlive the pyramid. */
gboolean lpca_pyramid_init(struct lpca_pyramid *pyramid, struct lpca *const *levels, int n,
                           GError **error);
void lpca_pyramid_clear(struct lpca_pyramid *pyramid);

/* FALSE with an error for logarithms (LPCA_LOG): their linear interpolation between directions is
 * not that of reflectances. */
gboolean lpca_pyramid_is_linear(const struct lpca_pyramid *pyramid, GError **error);

/* The method's function open: reads all levels of a file, and calls the method's make, which
 * borrows them and puts them on the card. */
typedef gpointer (*LpcaMake)(struct lpca *const *levels, int n, GError **error);
gpointer lpca_open_levels(const char *path, LpcaMake make, GError **error);

struct lpca_texels {
    int width, height; /* of level 0 */
    int n_components, n_levels;
    gboolean log; /* texels are not mixed before they are evaluated */
    guint weights, clusters;
};

/* scales: NULL, or the factors of the weights of each cluster, n_clusters × (n_components + 1) as
 * in struct lpca. */
gboolean lpca_texels_init(struct lpca_texels *texels, const struct lpca_pyramid *pyramid,
                          const float *scales, GError **error);
void lpca_texels_clear(struct lpca_texels *texels);

/* The constants of lpca_texel.glsl; see struct method. g_free() */
char *lpca_texels_constants(const struct lpca_texels *texels, const struct method_style *style);

gboolean lpca_texels_size(const struct lpca_texels *texels, int ret[2]);
gint64 lpca_texels_bytes(const struct lpca_texels *texels);

/* Binds them to texture units 1 and 2 of a program in use. */
void lpca_texels_bind(const struct lpca_texels *texels, guint program);

/* Says how n_clusters blocks of rows are stacked in the layers of an array texture. */
struct lpca_stack {
    int n_columns, n_rows; /* of a block */
    int clusters_a_layer, n_layers;
};

/* advice: what to do if the card cannot hold it. */
gboolean lpca_stack_init(struct lpca_stack *stack, int n_clusters, int n_columns, int n_rows,
                         const char *advice, GError **error);
/* Storage of halves. */
guint lpca_stack_texture(const struct lpca_stack *stack, GError **error);
/* Clamps the values, in place, to the range of halves, and uploads them. */
void lpca_stack_put(const struct lpca_stack *stack, int cluster, float *values);

struct lpca_directions {
    Directions *views, *lights;
    float *sky; /* each light's share in an even sky */
};

/* triangulated: see directions_new_triangulated() */
gboolean lpca_directions_init(struct lpca_directions *directions, const struct lpca *lpca,
                              gboolean triangulated, GError **error);
void lpca_directions_clear(struct lpca_directions *directions);
