/*
 * Photometric stereo: the normal and the albedo of each texel from its brightness under lights of
 * known directions (Woodham 1980), robust against shadows and highlights. Any thread.
 *
 * With the light's unit direction l_i, values I_i relative to a white diffuser that faces the
 * light, and b = ρ n, albedo ρ times normal n, Lambert's law is I_i = max(b · l_i, 0). b minimises
 *
 *     Σ_i φ((I_i − b · l_i) / σ),  over the lights that the surface faces, b · l_i > 0,
 *
 * with φ of Tukey's biweight (Beaton and Tukey 1974): differences beyond 4.685 σ, which are cast
 * shadows and highlights, do not count. It is found by reweighted least squares, which begins with
 * the best of the solutions of triples of lights (RANSAC, Fischler and Bolles 1981; scored by
 * Σ min((r_i / σ)², 9), which counts unlit lights as well: r_i = I_i there).
 *
 * σ is the noise. It is found from many texels, as a function of |b|, since few lights do not tell
 * one texel's own: the lower quartile of their scales, as texels with highlights or shadows have
 * larger ones, over that of made-up texels whose σ is known. Where too few lights agree within σ,
 * the surface is not quite matt, and σ is doubled until enough do.
 * The covariance of b is s² (Σ w_i l_i l_iᵀ)⁻¹, where s² is σ² and the texel's own residuals
 * together. The error bar of the normal is the RMS of the angle: √(trace of the covariance's part
 * across n) / |b|.
 */
#pragma once

#include "base/vec.h"
#include "base/work.h"

#define PHOTOMETRIC_LEAST_LIGHTS 3

/* Why a texel has no normal. */
enum photometric_cause {
    PHOTOMETRIC_FOUND,
    PHOTOMETRIC_DARK,       /* no light shows it: no value is above the noise */
    PHOTOMETRIC_FEW,        /* fewer than three lights, not counting saturated and missing values */
    PHOTOMETRIC_CONTRADICT, /* more lights contradict Lambert's law than agree with it */
    PHOTOMETRIC_FLAT,       /* the lights that agree lie nearly in a plane: error above 20° */
    PHOTOMETRIC_AWAY,       /* the normal points away from the camera's side, n_z ≤ 0 */
    PHOTOMETRIC_CAUSES,
};
/* For messages: "are dark under all lights", … */
const char *photometric_cause_text(enum photometric_cause cause);

struct photometric_texel {
    struct vec3 normal; /* unit; 0 without one */
    float albedo[3];    /* R, G, B: brightness of a surface that faces the light */
    float sigma_deg;    /* RMS error of the normal */
    int used;           /* lights that agree */
    enum photometric_cause cause;
};

struct photometric_input {
    int n_lights; /* at most PHOTOMETRIC_MOST_LIGHTS */
    int n_texels;
    /* Fills a texel's values (n_lights × 3: R, G, B; NaN: not known, as a saturated one) and the
     * unit directions to its lights. Called from several threads at once. */
    void (*read)(int texel, float *ret_rgb, struct vec3 *ret_lights, gpointer data);
    gpointer data;
};
#define PHOTOMETRIC_MOST_LIGHTS 4096

/* ret: n_texels. Stage "normals". FALSE: cancelled. */
gboolean photometric_solve(const struct photometric_input *input, const struct work *work,
                           struct photometric_texel *ret, GError **error);
