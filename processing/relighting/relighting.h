/*
 * Relighting of one view, as by RTI viewers: each picture is predicted from the pictures under all
 * other lights, in order to compare bases of the light. Any thread.
 *
 * ρ_i(x) is the value of texel x under light i (pipeline.h), and f_i(x) the fall-off of lamp i
 * (near_field_fall_off()). P_i = ρ_i f_i is the picture that lamp i makes of the sample, relative
 * to a white diffuser in the centre. All errors are those of P_i, in two models of the light:
 *
 *   distant  light i has the direction of the sample's centre l_i, and makes Y_i = P_i
 *   near     light i has the direction l_i(x) at each texel, and makes Y_i = P_i / f_i = ρ_i
 *
 * In both models, Y_j is predicted from all other lights by weights that depend on the directions
 * only,
 *
 *   Ŷ_j = Σ_{i≠j} w_ij Y_i,
 *
 * so that one fit is sufficient instead of n fits. Y is encoded as sRGB, as in the files of RTI, so
 * that components and fits have the errors that a person sees. With n lights and k terms:
 *
 *   PTM      lx², ly², lx ly, lx, ly, 1 (Malzbender et al. 2001), by least squares
 *   HSH      4, 9 or 16 terms of hsh.h (Gautron et al. 2004), by least squares
 *   RBF      normalised Gaussians of the distance between lights, as in the basis “rbf” of the
 *            program Relight (Ponchio et al. 2018): w_ij = e_ij / Σ_{k≠j} e_kj, with
 *            e_ij = exp (−|l_i − l_j|² / σ²). Nine values of σ are tried, among them Relight's
 *            default of 0.125. The one is taken with the least error when a light is left out, at
 *            RELIGHTING_PROBES texels.
 *   kriging  the Gaussian process of prediction.h for the ratios Y / g to a mean material g:
 *            w_ij = −(K⁻¹)_ij / (K⁻¹)_jj · g_j / g_i. Its constants are fitted once, to all lights
 *            at RELIGHTING_PROBES texels.
 *
 * For PTM and HSH, let A (n × k) be the terms at the lights and H = A (Aᵀ A)⁻¹ Aᵀ. The fit without
 * light j has w_ij = H_ij / (1 − H_jj) (Allen 1974, PRESS).
 *
 * RBF and kriging weigh pictures. A file stores these pictures as `planes` principal components of
 * the 3 n values of a texel (Ponchio et al. 2018). The components without light j follow from the
 * covariance of all lights, without the three rows and columns of j.
 *
 * In the near model, the texels of a tile share their weights. Tiles are so small that within a
 * tile no direction of a light differs by more than RELIGHTING_TILE_DEG from that at the tile's
 * centre.
 */
#pragma once

#include "base/work.h"
#include "btf/near_field.h"

#define RELIGHTING_PROBES   400
#define RELIGHTING_TILE_DEG 0.25

struct relighting {
    struct near_field *near; /* directions and positions of all views */
    int view;                /* index of the view nearest to the normal */
    int width, height;
    /* n_lights: number of lights whose pictures were captured
     * lights: indices of these lights in near->lights
     * A picture is left out if more than half of its texels were predicted (BTF_FLAG_PREDICTED). */
    int n_lights, *lights;
    /* ρ: n_lights × height × width × 3 (R, G, B). Holes have the mean of their neighbours
     * (btf_fill_holes()). If all texels of a picture are holes, its values are 0. */
    float *values;
};
typedef struct relighting Relighting;

/* Reads the view of a session's BTF that is nearest to the normal. The error is DATA_ERROR_INVALID
 * if there are fewer than RELIGHTING_MIN_LIGHTS lights or not enough memory. Other errors are those
 * of near_field_read() and session_view_files_read(). The progress stage is "read". */
#define RELIGHTING_MIN_LIGHTS 5
Relighting *relighting_read(const char *session, const struct work *work, GError **error);
void relighting_free(Relighting *relighting); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Relighting, relighting_free)

enum relighting_basis { RELIGHTING_PTM, RELIGHTING_HSH, RELIGHTING_RBF, RELIGHTING_KRIGING };

struct relighting_model {
    enum relighting_basis basis;
    int n_terms; /* of RELIGHTING_HSH: 4, 9 or 16 */
    int planes;  /* number of principal components of RBF and kriging; 0 keeps all pictures */
    gboolean near;
    gboolean linear; /* whether Y is not encoded */
    double sigma;    /* of RBF; 0 means the best of nine */
};

/* Returns a name such as "ptm", "hsh9" or "rbf27"; g_free(). */
char *relighting_model_name(const struct relighting_model *model);
/* Returns how many numbers of a texel a file stores. For PTM and HSH, these are three for each
 * term. For RBF and kriging, it is the number of planes, or three for each light if planes is 0. */
int relighting_model_numbers(const struct relighting_model *model, int n_lights);

/* Predicts P of each light from all other lights. ret_pictures receives n_lights × height × width ×
 * 3 values, at least 0. ret_sigma receives σ of RBF; it may be NULL. The progress stages are
 * "prediction", only for kriging, and "relighting".
 *
 * The error is DATA_ERROR_INVALID if the kriging cannot be fitted, or if the lights do not
 * determine the terms when one of them is left out. It is G_IO_ERROR_CANCELLED if cancelled. */
gboolean relighting_leave_out(const Relighting *relighting, const struct relighting_model *model,
                              const struct work *work, float *ret_pictures, double *ret_sigma,
                              GError **error);

/* Returns P of all lights: n_lights × height × width × 3 values; g_free(). */
float *relighting_pictures(const Relighting *relighting);

/* Errors of predicted pictures, over all lights (metrics/psnr.h, ssim.h, flip.h). */
struct relighting_errors {
    double psnr_db; /* of all values */
    /* means over the pictures; ssim is NaN if a picture has less than 11 × 11 texels */
    double ssim, flip;
};
/* Compares pictures of relighting_pictures() and relighting_leave_out(). ret_light_db receives the
 * PSNR of each light in dB; it may be NULL. */
void relighting_compare(const Relighting *relighting, const float *pictures, const float *predicted,
                        struct relighting_errors *ret, double *ret_light_db);
