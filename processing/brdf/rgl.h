/*
 * RGL's .bsdf files (Dupuy & Jakob 2018), a tensor file (tensor_file.h) with these fields, float32
 * but for the last two. P and T are the numbers of φ_i and θ_i:
 *   phi_i[P], theta_i[T]     radians, ascending: directions of incidence. P ≤ 2: isotropic
 *   ndf[b][a], sigma[b][a]   distribution of normals D(m), and the projected area σ(ω_i)
 *   vndf[P][T][b][a]         density of visible normals, of which only proportions count
 *   luminance[P][T][n][n]    of the reflected light in sample space, for importance sampling
 *   rgb[P][T][3][n][n]       of linear sRGB; or spectra[P][T][W][n][n] and wavelengths[W] in nm
 *   jacobian[1] (u8)         1: numbers of rgb and spectra are f_r · 4σ/D, as here; 0: f_r
 *   description (u8)         a text
 * Directions lie on the unit square at u = √(2θ/π) (a, the columns) and u_φ = (φ + π)/2π (b, the
 * rows); θ = π u²/2. With m = (ω_i + ω_o) / |ω_i + ω_o| at u_m (its φ less φ_i where isotropic),
 * and s = the inverse warp of vndf at ω_i (warp.h),
 *   f_r(ω_i, ω_o) = rgb(ω_i; s) · D(u_m) / (4 σ(u_i))                      (Dupuy & Jakob 2018)
 * with all tables linear between their nodes. ω_i is the light here, ω_o the view; the files of RGL
 * are reciprocal. Files that hold a half or a quarter
 * of the azimuths are mirrored.
 *
 * Spectra become colours by the CIE's 1931 observer, as the functions of Wyman et al. 2013 eq. 4
 * have it, under equal energy; X, Y and Z are scaled so that a spectrum of ones is white (1, 1, 1).
 */
#pragma once

#include "base/work.h"
#include "brdf.h"

struct rgl;

struct rgl *rgl_read(const char *path, GError **error);
void rgl_free(struct rgl *rgl); /* NULL is ignored */

void rgl_evaluate(const struct rgl *rgl, const float light[3], const float view[3], float ret[3]);
gboolean rgl_is_isotropic(const struct rgl *rgl);
const char *rgl_description(const struct rgl *rgl);

struct rgl_options {
    gboolean isotropic; /* write the mean of f turned about the normal by n_turns angles */
    int n_turns;
    const char *description;
};

struct rgl_result {
    int n_phi, n_theta, resolution; /* of the file */
};

/*
 * Writes f_r as such a file, with rgb and with spectra at six wavelengths that have its colours
 * (for programs that read spectra alone). D is found from the retro-reflection by power iteration
 * (Dupuy et al. 2015; Dupuy & Jakob 2018): with f of luminance,
 *   D(ω) = 4 f(ω, ω) cos θ · ∫ ⟨ω, m⟩ D(m) dm,     ∫ D(m) cos θ_m dm = 1
 * and held above 0.3 of that of the uniform hemisphere, 1/π; σ(ω) = ∫ ⟨ω, m⟩ D(m) dm, and vndf is
 * the mean of D(m) ⟨ω_i, m⟩ / σ(ω_i) · dm/du and of a constant. Neither changes f_r at the nodes of
 * the file; between them the product of D and of rgb, which holds 1/D, errs where D changes much
 * within a cell, which these two limit: to 0.3 … 0.8 % of f (RMS) for rough and glossy metals on a
 * diffuse ground. Importance sampling is left to the table luminance. A node of rgb whose ω_o lies
 * below the surface holds the value of the horizon. Stage "export".
 */
gboolean rgl_write(const char *path, BrdfFunction f, gpointer data,
                   const struct rgl_options *options, const struct work *work,
                   struct rgl_result *ret, GError **error);
