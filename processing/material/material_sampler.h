/*
 * Distributions of light directions that follow a material's reflectance, to draw samples from.
 *
 * A direction is l = (x, y, z) with (x, y) = the disc's point of (a, b) in [0, 1]², by the map that
 * keeps areas (Shirley & Chiu 1997). Uniform (a, b) are directions of density z / π. A table g
 * holds CELLS × CELLS densities over (a, b), with mean 1, of a cluster of texels and a measured
 * view: each is proportional to ∫ value dω over its cell, of the cluster's mean luminance. For a
 * view between measured ones the tables are mixed as the views are interpolated (weights w_i):
 *   p(l) = z / π · (C + (1 − C − U) Σ_i w_i g_i(a, b)) + U / 2π      per solid angle
 * with C and U the shares of a cosine lobe and of the even hemisphere: p > 0 wherever z > 0, and
 * value / p stays bounded.
 *
 * If the model is a formula, a cell's value is evaluated at the cell's middle, in some texels of
 * the cluster, because formulas need not fall towards the horizon as interpolated values do.
 *
 * Texels are put into clusters by the shape of their reflectance (k-means over fixed pairs of
 * measured view and light). A footprint wider than 1.5 texels takes the table of all texels.
 */
#pragma once

#include "btf/direction_grid.h"
#include "directions/directions.h"

#define MATERIAL_SAMPLER_CELLS 32

/* The source of a sampler; it and all that it refers to outlive the sampler. */
struct material_sampler_source {
    const struct btf_layout *layout;
    const Directions *views, *lights; /* of the layout; NULL if n_grid */
    int n_grid; /* 0, or views and lights are the samples of btf/direction_grid.h */
    /* One texel: n_views × n_lights × 3, as struct codec has it. */
    void (*reconstruct)(gconstpointer model, int texel, float *ret);
    gconstpointer model;
    /* If the model is a formula: evaluates a texel in a measured view under any light above the
     * horizon. NULL: values between the measured lights are interpolated. */
    void (*evaluate)(gconstpointer context, int view, int texel, const float light[3],
                     float ret[3]);
    gconstpointer context;
};

typedef struct MaterialSampler MaterialSampler;

/* The same source gives the same tables. Takes seconds for the largest materials. */
MaterialSampler *material_sampler_new(const struct material_sampler_source *source);
void material_sampler_free(MaterialSampler *sampler); /* NULL is ignored */

/* uv in tiles, v downwards; footprint in tiles; random: two numbers in [0, 1). Any thread.
 * Returns the density of ret_light per solid angle; 0, with ret_light 0: the view is below the
 * horizon. */
float material_sampler_draw(const MaterialSampler *sampler, const float uv[2], const float view[3],
                            float footprint, const float random[2], float ret_light[3]);
/* The density with which material_sampler_draw() draws this light; 0 if the light or the view is
 * below the horizon. */
float material_sampler_density(const MaterialSampler *sampler, const float uv[2],
                               const float view[3], const float light[3], float footprint);
