/*
 * Hemispherical harmonics (HSH) of a BTF, as Relight and RTIViewer use them for RTI sets. Each
 * measured view, texel and colour has a sum of n = 4, 9 or 16 basis functions of the light,
 *   f(l) = Σ_{i=0..n−1} c_i H_i(l)                          (Gautron et al. 2004 eq. 5, 6)
 * Values contain n·l (pipeline.h) and are not multiplied by it again. f may be negative between the
 * measured lights.
 *
 * The basis is that of Gautron et al. 2004: associated Legendre polynomials P_l^m without
 * Condon–Shortley phase, shifted from [−1, 1] to the hemisphere by x = 2 cos θ − 1,
 *   H_l^m(θ, φ) = √2 K_l^m cos(mφ) P_l^m(x)        m > 0
 *                 √2 K_l^|m| sin(|m|φ) P_l^|m|(x)  m < 0
 *                 K_l^0 P_l^0(x)                   m = 0
 *   K_l^m = √((2l + 1) (l − m)! / (2π (l + m)!))
 * which is orthonormal over the hemisphere: ∫ H_i H_j dω = δ_ij. Order and signs are those of
 * RTIViewer: first degree l = 0, then 1, 2 and 3; within each degree m = l, l − 1, …, −l; H_l^m
 * with |m| = 2 is negated. With c = cos θ = l_z, w = c − c², and
 * (u, v) = √w (cos φ, sin φ) = √(c / (1 + c)) (l_x, l_y), the functions are:
 *   H0  √(1/2π)          H4  −√(30/π) (u² − v²)      H9   2√(35/π) (u³ − 3uv²)
 *   H1  √(6/π) u         H5   √(30/π) x u            H10  −√(210/π) x (u² − v²)
 *   H2  √(3/2π) x        H6   √(5/2π) (1 − 6w)       H11  2√(21/π) u (1 − 5w)
 *   H3  √(6/π) v         H7   √(30/π) x v            H12  √(7/2π) x (1 − 10w)
 *                        H8  −√(30/π) 2uv            H13  2√(21/π) v (1 − 5w)
 *                                                    H14  −√(210/π) x 2uv
 *                                                    H15  2√(35/π) (3u²v − v³)
 * All directions on the horizon have the same u = v = 0, and hence the same values of the basis. A
 * light below the horizon is treated as if it were on the horizon.
 *
 * On disk, one EXR "hsh.exr" of half floats. The first n parts are pictures of the texels of all
 * views below each other, line v · height + y:
 *   parts "term0" … "term<n−1>"  channels B G R, c_i of each colour
 *   parts "views", "lights"      channels "phi_deg", "theta_deg", width n, height 1, float
 * Attributes of the first part: mesorig.kind ("hsh"), mesorig.name (string); mesorig.terms,
 * mesorig.views, mesorig.width, mesorig.height (int); mesorig.error, mesorig.exact_error,
 * mesorig.luminance_error, texel_mm, reference_mm (double).
 */
#pragma once

#include "btf/btf_matrix.h"

#define HSH_MAX_TERMS     16
#define HSH_DEFAULT_TERMS 9

struct hsh {
    char *name;
    struct btf_layout layout;
    int n_terms;   /* 4, 9 or 16 */
    float *values; /* c_i: n_views × height × width × n_terms × 3 (R G B) */
    /* error            relative RMS error of R, G, B against the encoded BTF
     * luminance_error  mean of |Y − Ŷ| (Y of rgb_luminance())
     * exact_error      relative RMS error before the values were rounded to half floats */
    double error, luminance_error, exact_error;
};

struct hsh_options {
    int n_terms; /* 4, 9 or 16; 0 means HSH_DEFAULT_TERMS */
    struct work work;
};

void hsh_free(struct hsh *hsh); /* NULL is ignored */

/* Computes H_0 … H_{n_terms − 1} in a direction, which is a unit vector in the sample frame. */
void hsh_basis(const float light[3], int n_terms, float *ret);

/* Fits by least squares over all lights of each view, texel and colour. If several solutions fit
 * the lights equally, the one with the least ∫ f² dω is used. A value is left out if one of its
 * colours is NaN. Infinite values are refused. A texel of a view without any value becomes black.
 * The values of the result are rounded to half floats, as in the file. The result does not depend
 * on the number of threads. The progress stage is "fit". Errors are DATA_ERROR_INVALID and
 * G_IO_ERROR_CANCELLED. */
struct hsh *hsh_compute(const struct btf_matrix *btf, const struct hsh_options *options,
                        GError **error);

/* Reconstructs one texel at the measured directions: n_views × n_lights × 3. */
void hsh_reconstruct(const struct hsh *hsh, int texel, float *ret);

/* Computes error and luminance_error over all values of the BTF that are not NaN, and stores them
 * in hsh. Returns error. */
double hsh_error(struct hsh *hsh, const struct btf_matrix *btf, int n_threads);

/* Returns the bytes of all values as halves, as a renderer holds them. */
gint64 hsh_bytes(const struct hsh *hsh);

/* Errors: EXR_ERROR. */
gboolean hsh_write(const char *path, const struct hsh *hsh, GError **error);
struct hsh *hsh_read(const char *path, GError **error);
