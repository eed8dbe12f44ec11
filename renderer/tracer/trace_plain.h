/*
 * The reflectance of materials that are not measured: glTF's metallic and roughness,
 *     f = (1 − m) (1 − F_d(θ_v)) (1 − F_d(θ_l)) c / π  +  F(v·h) D G / (4 cos θ_l cos θ_v),
 * with c the base colour, m the metallic part, D and G those of GGX with α = roughness² and Smith's
 * height-correlated masking (Heitz 2014), F(x) = F0 + (F90 − F0) (1 − x)⁵,
 * F0 = 0.04 s (1 − m) + c m, F90 = s (1 − m) + m, s = specularFactor, F_d that of m = 0. What is
 * reflected at the surface does not reach the diffuser below it, neither on the way in nor out, so
 * that no more is reflected than arrives. With m = s = 0 it is c / π exactly.
 *
 * Directions are in the surface's frame, unit, z along its normal. Pure functions.
 */
#pragma once

#include "base/vec.h"

struct trace_plain {
    double base[3], metallic, roughness, specular;
};

/* f cos θ_l; 0 below the horizon. */
void trace_plain_evaluate(const struct trace_plain *plain, struct vec3 view, struct vec3 light,
                          double ret_rgb[3]);
/* A light direction in proportion to about that, by visible normals (Heitz 2018) or by the cosine;
 * returns its density per solid angle, 0: none. */
double trace_plain_draw(const struct trace_plain *plain, struct vec3 view, const double random[3],
                        struct vec3 *ret_light);
double trace_plain_density(const struct trace_plain *plain, struct vec3 view, struct vec3 light);
