/* RGL's .bsdf files (Dupuy & Jakob 2018), as RGL's loaders and Mitsuba read them. A file is a
 * tensor file (tensor_file.h) with the following fields, all float32 except the last two. P and T
 * are the numbers of φ_i and θ_i:
 *   phi_i[P], theta_i[T]     directions of incidence, in radians, ascending; with P ≤ 2 the BRDF is
 *                            isotropic
 *   ndf[b][a], sigma[b][a]   distribution of normals D(m), and projected area σ(ω_i)
 *   vndf[P][T][b][a]         density of visible normals, up to a factor
 *   luminance[P][T][n][n]    luminance of the reflected light in sample space, for importance
 *                            sampling
 *   rgb[P][T][3][n][n]       linear sRGB in sample space; instead of rgb, a file may have
 *                            spectra[P][T][W][n][n] and wavelengths[W] in nm
 *   jacobian[1] (u8)         1 if rgb and spectra are f_r cos θ_o · 4σ/D, as below; 0 if they are
 *                            f_r cos θ_o
 *   description (u8)         a text
 * Directions are mapped to the unit square by u = √(2θ/π) (a, the columns) and u_φ = (φ + π)/2π (b,
 * the rows), so that θ = π u²/2. The half vector m = (ω_i + ω_o) / |ω_i + ω_o| has the coordinates
 * u_m. If the BRDF is isotropic, φ_i is subtracted from the φ of m. s is the inverse warp of vndf
 * at ω_i (warp.h), applied to u_m. Then
 *   f_r(ω_i, ω_o) cos θ_o = rgb(ω_i; s) · D(u_m) / (4 σ(u_i))              (Dupuy & Jakob 2018).
 * All tables are linear between their nodes.
 *
 * Here ω_i is the view and ω_o the light, as in Mitsuba, because path tracers start at the eye. For
 * the files of RGL the order makes no difference, because their BRDFs are reciprocal. Files with
 * only half or a quarter of the azimuths are completed by mirroring.
 *
 * Spectra become colours by the CIE's 1931 observer under equal energy, with the functions of Wyman
 * et al. 2013 eq. 4. X, Y and Z are scaled so that a spectrum of ones is white (1, 1, 1). */
#pragma once

#include "base/work.h"
#include "brdf_function.h"

struct rgl;

struct rgl *rgl_read(const char *path, GError **error);
void rgl_free(struct rgl *rgl); /* NULL is ignored */

/* Gives f_r. */
void rgl_evaluate(const struct rgl *rgl, const float light[3], const float view[3], float ret[3]);

struct rgl_options {
    gboolean isotropic; /* whether to write the mean of f over n_turns rotations about the normal */
    int n_turns;
    const char *description;
    /* Whether to leave out spectra. Some programs, such as Mitsuba, treat a file with spectra as a
     * spectral file even if the file has rgb as well. */
    gboolean rgb_only;
};

struct rgl_result {
    /* n_phi, n_theta: numbers of φ_i and θ_i in the file
     * resolution: n of the n × n nodes in sample space */
    int n_phi, n_theta, resolution;
};

/* Writes f_r as a .bsdf file with rgb. If rgb_only is FALSE, the file also has spectra at six
 * wavelengths that have the same colours. A node of rgb is 0 if its ω_o is below the surface. The
 * table luminance is meant for importance sampling. The progress stage is "export".
 *
 * D is found from the retro-reflection by power iteration (Dupuy et al. 2015; Dupuy & Jakob 2018).
 * With the luminance f of f_r,
 *   D(ω) = 4 f(ω, ω) cos θ · ∫ ⟨ω, m⟩ D(m) dm,     ∫ D(m) cos θ_m dm = 1.
 * D is kept above 0.3/π. (For comparison, a uniform hemisphere has D = 1/π.) σ(ω) = ∫ ⟨ω, m⟩ D(m)
 * dm. vndf is the mean of a constant and of D(m) ⟨ω_i, m⟩ / σ(ω_i) · dm/du.
 *
 * Neither the minimum of D nor the constant changes f_r at the nodes of the file. Between the
 * nodes, the product of D and rgb is wrong where D changes much within a cell, because rgb contains
 * 1/D. The minimum and the constant reduce this error. For rough metals on a diffuse base, the
 * remaining RMS error is 0.4 % (isotropic) and 0.8 % (anisotropic) of f_r cos θ_o. */
gboolean rgl_write(const char *path, BrdfFunction f, gpointer data,
                   const struct rgl_options *options, const struct work *work,
                   struct rgl_result *ret, GError **error);
