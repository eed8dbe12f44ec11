/*
 * Shiny surfaces with anisotropic microfacets, and with normals that differ from the normal of the
 * surface (Kang & Cho 2011). Vectors are in the frame of the surface: z is the normal of the
 * surface, and x the direction of U. The formula is in microfacet.glsl.
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

/*
 * Two surfaces that need no file, each with two models (Ward, and Ashikhmin and Shirley): brushed
 * metal under a normal map, and a plain weave of yarns with alternating directions of anisotropy.
 * The parameters of the surfaces are in microfacet_view.c. Under an even sky, both surfaces reflect
 * diffuse + specular. The normals of a file can replace the normals of the metal (struct method,
 * takes_normals).
 */
enum microfacet_surface { MICROFACET_METAL, MICROFACET_FABRIC };

/* For tests: computes the material *ret_surface and the normal *ret_normal at texel coordinates x
 * (see method.h), without filtering. */
void microfacet_surface_at(enum microfacet_surface which, enum microfacet_model model,
                           const double x[2], struct microfacet *ret_surface,
                           struct vec3 *ret_normal);

#define MICROFACET_METHODS 4
extern const struct method methods_microfacet[MICROFACET_METHODS];
