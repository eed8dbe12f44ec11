/*
 * The reflectance of materials that are not measured, by glTF's metallic and roughness:
 *     f = (1 − m) (1 − F_d(θ_v)) (1 − F_d(θ_l)) c / π  +  F(v·h) D G / (4 cos θ_l cos θ_v),
 *     F(x) = F0 + (F90 − F0) (1 − x)⁵,
 *     F0 = 0.04 s (1 − m) + c m,
 *     F90 = s (1 − m) + m.
 * c is the base colour, m the metallic part, and s the specularFactor. D and G are the terms of GGX
 * with α = roughness², at least 0.001, and Smith's height-correlated masking (Heitz 2014). F_d is F
 * for m = 0. The diffuser below the surface only gets the light that the surface does not reflect,
 * on the way in and on the way out. These are the two factors 1 − F_d. Therefore no more light is
 * reflected than arrives. With m = s = 0, f is exactly c / π.
 *
 * Directions are unit vectors in the frame of the surface, with z along its normal. All functions
 * are pure.
 */
#pragma once

#include "base/vec.h"

struct trace_plain {
    /* c, m, roughness and s in the formula; all are from 0 to 1 */
    double base[3], metallic, roughness, specular;
};

/* Sets ret_rgb to f cos θ_l, which is 0 below the horizon. */
void trace_plain_evaluate(const struct trace_plain *plain, struct vec3 view, struct vec3 light,
                          double ret_rgb[3]);
/* Draws a light direction approximately in proportion to f cos θ_l. For the highlight, a visible
 * normal is drawn (Heitz 2018). For the diffuse part, the direction is drawn in proportion to the
 * cosine. random has three numbers from 0 to 1.
 *
 * Returns the density per solid angle of *ret_light. Returns 0 if view or *ret_light is not above
 * the horizon. If view is not above the horizon, *ret_light is not set. */
double trace_plain_draw(const struct trace_plain *plain, struct vec3 view, const double random[3],
                        struct vec3 *ret_light);
/* Returns the density per solid angle with which trace_plain_draw() draws `light`. */
double trace_plain_density(const struct trace_plain *plain, struct vec3 view, struct vec3 light);
