/*
 * The reflectance model of material files: metallic-roughness with a microfacet lobe, as glTF 2.0
 * (appendix B) and its extensions KHR_materials_specular, _anisotropy, _sheen and _clearcoat define
 * it. Values are defined as in the BTF: π f(v, l) ⟨n·l⟩, relative to a white diffuser lit from its
 * normal.
 *
 * With normal n, tangent t (where the lobe is wider) and bitangent b = n × t of a texel, h the half
 * vector, α = roughness², αt = α + (1 − α) anisotropy², αb = α, f5 = (1 − v·h)^5:
 *   D = 1 / (π αt αb ((h·t)²/αt² + (h·b)²/αb² + (h·n)²)²)                     (Walter et al. 2007)
 *   V = ½ / (n·l |(αt v·t, αb v·b, v·n)| + n·v |(αt l·t, αb l·b, l·n)|)       (Heitz 2014)
 *   F_d = 0.04 s + (1 − 0.04 s) f5,  F_m = base + (1 − base) f5,  at most 1   (Schlick 1994)
 *   f_d = (1 − specular · max F_d) base / π + specular · F_d D V
 *   f_0 = (1 − metallic) f_d + metallic · F_m D V
 * A clear coat is an isotropic lobe of the sample's plane, whose normal is z, with Fresnel's factor
 * F_c = 0.04 + 0.96 (1 − v·z)^5: f_1 = (1 − coat · F_c) f_0 + coat · F_c D_c V_c.
 * Sheen has the colour c and the exponent 1/αs, αs = sheen_roughness². V_s is the shadowing term
 * and E the directional albedo of Estevez & Kulla 2017:
 *   D_s = (2 + 1/αs) sin(θh)^(1/αs) / 2π
 *   f = c D_s V_s + f_1 · min(1 − max(c) E(v·n), 1 − max(c) E(l·n)).
 * Pure functions; any thread.
 */
#pragma once

#include <glib.h>

#define MAPS_DIELECTRIC    0.04F /* reflectance of an index of refraction of 1.5 */
#define MAPS_MIN_ROUGHNESS 0.1F
#define MAPS_MAX_SPECULAR  25.0F /* maximum of specular_colour, which gives a reflectance of 1 */

/* The parameters of one texel. Vectors are in the sample frame. */
struct maps_texel {
    float base[3], metallic, roughness;
    /* specular: weight of the dielectric's lobe, 0 … 1
     * specular_colour: s of F_d, 0 … MAPS_MAX_SPECULAR */
    float specular, specular_colour[3];
    /* anisotropy: 0 … 1
     * direction: x and y of t before t is made orthogonal to n; a unit vector */
    float anisotropy, direction[2];
    float normal[3]; /* unit, z > 0 */
    float sheen[3], coat;
};

/* The two layers, sheen and clear coat, have the same roughness in all texels. A roughness of 0
 * means that the material does not have the layer. */
#define MAPS_SHEEN_STEPS 32
struct maps_layers {
    float sheen_roughness, coat_roughness;
    float sheen_albedo[MAPS_SHEEN_STEPS + 1]; /* E at cos θ = i / MAPS_SHEEN_STEPS */
};
struct maps_layers maps_layers_new(double sheen_roughness, double coat_roughness);

/* Evaluates the model. v and l are unit vectors with z > 0. The result is 0 if the normal faces
 * away from v or l. */
void maps_evaluate(const struct maps_layers *layers, const struct maps_texel *texel,
                   const float v[3], const float l[3], float ret[3]);

/* maps_lobe() returns D V of an isotropic lobe with α. maps_sheen() returns D_s V_s. Arguments of
 * both are the cosines nl = n·l, nv = n·v and nh = n·h. */
double maps_lobe(double alpha, double nl, double nv, double nh);
double maps_sheen(double roughness, double nl, double nv, double nh);
/* Returns E(cos θ) from the table. */
double maps_sheen_albedo(const struct maps_layers *layers, double cosine);
