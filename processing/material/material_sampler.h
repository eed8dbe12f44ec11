/* Distributions of light directions that follow a material's reflectance, for importance sampling.
 *
 * A direction is l = (x, y, z). The area-preserving map of Shirley & Chiu 1997 maps (a, b) in [0,
 * 1]² to the point (x, y) of the disc. If (a, b) is uniform, directions have the density z / π.
 *
 * A table g has CELLS × CELLS densities over (a, b), with mean 1, for a cluster of texels and a
 * measured view. Each density is proportional to the integral of the cluster's mean luminance over
 * the cell, ∫ value dω. For a view between measured ones, the tables are mixed with the weights w_i
 * with which the views are interpolated. The density per solid angle is
 *
 *   p(l) = z / π · (C + (1 − C − U) Σ_i w_i g_i(a, b)) + U / 2π
 *
 * C and U are the shares of a cosine lobe and of the uniform hemisphere. Because of these two
 * terms, p > 0 wherever z > 0, and value / p is bounded.
 *
 * If the model is a formula, the value of a cell is evaluated at the cell's middle, in some texels
 * of the cluster. The reason is that formulas need not fall towards the horizon as interpolated
 * values do.
 *
 * Texels are clustered by the shape of their reflectance (k-means over fixed pairs of measured view
 * and light). The table of all texels is used if the footprint is wider than 1.5 steps between the
 * texels that were examined. */
#pragma once

#include "btf/direction_grid.h"
#include "directions/directions.h"

#define MATERIAL_SAMPLER_CELLS 32

/* The source of a sampler. The source and all data that it refers to must outlive the sampler. */
struct material_sampler_source {
    const struct btf_layout *layout;
    const Directions *views, *lights; /* of the layout; NULL if n_grid > 0 */
    /* 0, or the n of n × n samples of btf/direction_grid.h that are the views and lights */
    int n_grid;
    /* Reconstructs one texel: n_views × n_lights × 3, as in struct codec. */
    void (*reconstruct)(gconstpointer model, int texel, float *ret);
    gconstpointer model;
    /* If the model is a formula, evaluates a texel in a measured view under any light above the
     * horizon. If NULL, values between the measured lights are interpolated. */
    void (*evaluate)(gconstpointer context, int view, int texel, const float light[3],
                     float ret[3]);
    gconstpointer context;
};

typedef struct MaterialSampler MaterialSampler;

/* Makes a sampler. The same source gives the same tables. Takes seconds for the largest
 * materials. */
MaterialSampler *material_sampler_new(const struct material_sampler_source *source);
void material_sampler_free(MaterialSampler *sampler); /* NULL is ignored */

/* Draws a direction.
 * - uv is a point of the material in tiles, with v downwards.
 * - footprint is the width of the area that is shaded, in tiles.
 * - random is two numbers in [0, 1).
 * Returns the density of ret_light per solid angle. If the view is below the horizon, returns 0 and
 * sets ret_light to 0. Any thread. */
float material_sampler_draw(const MaterialSampler *sampler, const float uv[2], const float view[3],
                            float footprint, const float random[2], float ret_light[3]);
/* Returns the density with which material_sampler_draw() draws this light. Returns 0 if the light
 * or the view is below the horizon. */
float material_sampler_density(const MaterialSampler *sampler, const float uv[2],
                               const float view[3], const float light[3], float footprint);
