/* What all ways to draw a local PCA share: its checks, and the clusters and weights of its texels
 * as textures. Read by lpca_texel.glsl. */
#pragma once

#include "directions.h"
#include "processing/lpca.h"

struct lpca_texels {
    int n_components;
    guint weights, clusters;
};

/* Whether everything in it is there and finite. */
gboolean lpca_texels_check(const struct lpca *lpca, GError **error);

gboolean lpca_texels_init(struct lpca_texels *texels, const struct lpca *lpca, GError **error);
void lpca_texels_clear(struct lpca_texels *texels);

/* To units 1 and 2 of a program in use. */
void lpca_texels_bind(const struct lpca_texels *texels, guint program, gboolean nearest);

/* How n_clusters blocks of rows are stacked in the layers of an array texture. */
struct lpca_stack {
    int n_columns, n_rows; /* of a block */
    int clusters_a_layer, n_layers;
};

/* advice: what to do if the card cannot hold it. */
gboolean lpca_stack_init(struct lpca_stack *stack, int n_clusters, int n_columns, int n_rows,
                         const char *advice, GError **error);
/* Storage of RGB halves. */
guint lpca_stack_texture(const struct lpca_stack *stack, GError **error);
/* Clamps to what halves hold, in place. */
void lpca_stack_put(const struct lpca_stack *stack, int cluster, float *values);

struct lpca_directions {
    Directions *views, *lights;
    float *sky; /* each light's share in an even sky */
};

gboolean lpca_directions_init(struct lpca_directions *directions, const struct lpca *lpca,
                              GError **error);
void lpca_directions_clear(struct lpca_directions *directions);
