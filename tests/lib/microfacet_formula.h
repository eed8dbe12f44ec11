/* Anisotropic microfacets, as microfacet.glsl has them, on the CPU. Vectors are in the frame of the
 * surface, as in microfacet.h. */
#pragma once

#include "drawing/methods/microfacet.h"

/* Returns the unit vector h in the frame of the unit normal n.
 * Exact: Rᵀ h of eq. 4 … 6, with u' = y × n, normalised, or u' = x if n = ±y.
 * Approximate: R̃ᵀ h of eq. 9 with the sign that makes its rows orthogonal, v' = (−n_x n_y, 1 −
 * n_y², −n_y n_z). Two of its rows have the length √(1 − n_y²).
 * None: (h_x, h_y, n·h), eq. 2. */
struct vec3 microfacet_half(struct vec3 h, struct vec3 n, enum method_rotation rotation);

/* Computes the reflectance for unit vectors to view and light. The factor n·l is included. */
void microfacet_evaluate(const struct microfacet *surface, struct vec3 n, struct vec3 view,
                         struct vec3 light, enum method_rotation rotation, double ret[3]);
