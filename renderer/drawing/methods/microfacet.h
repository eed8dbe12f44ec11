/*
 * Shiny surfaces with anisotropic microfacets, and with normals that differ from the surface's
 * (Kang & Cho 2011). Vectors are in the frame of the surface: z is its normal, x the direction of
 * U. microfacet.glsl is the same code for the graphics card.
 */
#pragma once

#include "method.h"

#include "base/vec.h"

enum microfacet_model { MICROFACET_WARD, MICROFACET_ASHIKHMIN };

struct microfacet {
    enum microfacet_model model;
    float diffuse[3], specular[3]; /* the formula of the specular part is in lobes.h */
    float rough[2];                /* roughness along U and V */
};

/* Returns the unit vector h in the frame of the unit normal n.
 * Exact: Rᵀ h of eq. 4 … 6, with u' = y × n, normalised, or u' = x if n = ±y.
 * Approximate: R̃ᵀ h of eq. 9 with the sign that makes its rows orthogonal, v' = (−n_x n_y, 1 −
 * n_y², −n_y n_z). Two of its rows have the length √(1 − n_y²).
 * None: (h_x, h_y, n·h), eq. 2. */
struct vec3 microfacet_half(struct vec3 h, struct vec3 n, enum method_rotation rotation);

/* Computes the reflectance for unit vectors to view and light. The factor n·l is included. */
void microfacet_evaluate(const struct microfacet *surface, struct vec3 n, struct vec3 view,
                         struct vec3 light, enum method_rotation rotation, double ret[3]);

/*
 * Two surfaces that need no file, each with both models: brushed metal under a normal map, and a
 * plain weave of yarns whose anisotropy alternates. Their parameters are in microfacet_view.c.
 * Under an even sky both reflect diffuse + specular. The normals of a file can replace those of the
 * metal (struct method, takes_normals).
 */
enum microfacet_surface { MICROFACET_METAL, MICROFACET_FABRIC };

/* Computes the material and the normal at texel coordinates x (see method.h), without filtering. */
void microfacet_surface_at(enum microfacet_surface which, enum microfacet_model model,
                           const double x[2], struct microfacet *ret_surface,
                           struct vec3 *ret_normal);

#define MICROFACET_METHODS 4
extern const struct method methods_microfacet[MICROFACET_METHODS];
