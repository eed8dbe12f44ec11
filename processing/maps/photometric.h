/* Photometric stereo finds the normal and the albedo of each texel from its brightness under lights
 * of known directions (Woodham 1980). This method is robust against shadows and highlights. Any
 * thread.
 *
 * Let l_i be the light's unit direction, I_i the value relative to a white diffuser that faces the
 * light, and b = ρ n the product of albedo ρ and normal n. Lambert's law is I_i = max(b · l_i, 0).
 * b minimises
 *
 *     Σ_i φ((I_i − b · l_i) / σ),  over the lights that the surface faces, b · l_i > 0,
 *
 * with φ of Tukey's biweight (Beaton and Tukey 1974). Differences beyond 4.685 σ, which are cast
 * shadows and highlights, do not count. The minimum is found by reweighted least squares. The start
 * is the best of the solutions of triples of lights (RANSAC, Fischler and Bolles 1981), scored by Σ
 * min((r_i / σ)², 9). This sum also counts unlit lights, for which r_i = I_i.
 *
 * σ is the noise as a function of |b|. This function is found from many texels, because few lights
 * do not determine the noise of one texel. Each texel's residuals have a scale (a median). σ is the
 * lower quartile of these scales, divided by the lower quartile for simulated texels of σ = 1. The
 * lower quartile is used because texels with highlights or shadows have larger scales. If too few
 * lights agree within σ, the surface is not quite matt, and σ is doubled until enough lights agree.
 *
 * The covariance of b is s² (Σ w_i l_i l_iᵀ)⁻¹, where s² combines σ² and the texel's own residuals.
 * The error of the normal is an RMS angle: √(trace of the covariance across n) / |b|. */
#pragma once

#include "base/vec.h"
#include "base/work.h"

#define PHOTOMETRIC_MIN_LIGHTS 3

/* The reason why a texel has no normal. */
enum photometric_cause {
    PHOTOMETRIC_FOUND,
    PHOTOMETRIC_DARK, /* no light shows the texel: no value is above the noise */
    /* fewer than three lights have a known value, or fewer than three lights that the surface faces
     * have a value above the noise */
    PHOTOMETRIC_FEW,
    /* too few of the lights that the surface faces agree with Lambert's law */
    PHOTOMETRIC_CONTRADICT,
    /* the lights that agree lie nearly in a plane, so that they do not determine the normal, or
     * only with an error of 20° or more */
    PHOTOMETRIC_FLAT,
    PHOTOMETRIC_AWAY, /* the normal points away from the camera: n_z ≤ 0 */
    PHOTOMETRIC_CAUSES,
};
/* Returns a predicate of “texels” for messages, such as "are dark under all lights". */
const char *photometric_cause_text(enum photometric_cause cause);

struct photometric_texel {
    struct vec3 normal; /* unit vector; 0 if there is none */
    float albedo[3];    /* R, G, B: brightness of the surface if it faced the light */
    float sigma_deg;    /* RMS error of the normal */
    int used;           /* number of lights that agree */
    enum photometric_cause cause;
};

struct photometric_input {
    int n_lights; /* at most PHOTOMETRIC_MAX_LIGHTS */
    int n_texels;
    /* Gives the values of a texel (n_lights × 3: R, G, B; NaN if not known, for example if
     * saturated) and the unit vectors to its lights. Several threads call the function at the same
     * time. */
    void (*read)(int texel, float *ret_rgb, struct vec3 *ret_lights, gpointer data);
    gpointer data;
};
#define PHOTOMETRIC_MAX_LIGHTS 4096

/* Finds the normals of all texels; ret has n_texels elements. The progress stage is "normals".
 * Returns FALSE when cancelled. */
gboolean photometric_solve(const struct photometric_input *input, const struct work *work,
                           struct photometric_texel *ret, GError **error);
