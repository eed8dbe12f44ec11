/*
 * The model of maps_model.h fitted to the whole BTF of each texel: all views and lights at once.
 *
 * Weighted least squares of luminance Y over pairs i of a view and a light,
 *   min Σ u_i² (Y_i − d D_i − S A_i − w B_i − e E_i)² + priors,   u_i = h_i / (m_i + y0)^0.6,
 * where w is the specular weight, D Lambert's lobe times 1 − w (0.04 + 0.96 f5), A and B the
 * microfacet lobe times (1 − f5) and f5, and E sheen or a clear coat. The exponent makes equal
 * differences in lightness count alike. d, S and e are the solution for given normal, roughnesses
 * and w (variable projection, Golub & Pereyra 1973), which Levenberg and Marquardt's method finds.
 * In a first round m_i is Y_i, y0 its mean, and h_i is 1; in two more, m_i is what the model gave,
 * y0 a twentieth of the mean, and h_i Huber's factor, so that shadows and other things that the
 * model does not hold count less. From d and S follow metallic and specular; then base, specular
 * colour and sheen are solved for each colour, by least squares first, then with weights that make
 * it the least sum of absolute differences of all three (iteratively reweighted least squares), a
 * view counting as v·z.
 *
 * Of the core model, d = (1 − m) base and S = m base + 0.04 (1 − m) give metallic m.
 *
 * Values that are NaN are left out; a texel without light is black. Any thread.
 */
#pragma once

#include "base/work.h"
#include "btf/btf_matrix.h"
#include "maps_model.h"
#include "maps_register.h"

/* The parameters that a fit may use. MAPS_MODEL_CORE: those of glTF without extensions: base
 * colour, metallic, roughness and normal. Anisotropy is 0, w is 1, S is at least that of a
 * dielectric, and there are no layers. */
enum maps_model { MAPS_MODEL_FULL, MAPS_MODEL_CORE };

#define MAPS_MOST_PAIRS 4096 /* of a view and a light; of more, every second, third, … is taken */

struct maps_fit {
    struct maps_layers layers;
    struct maps_texel *texels; /* height × width */
    int dark;                  /* texels without light */
};

/* Of the points of the mean surface. layers: NULL: those that lower the cost of some texels by more
 * than a twentieth are chosen. DATA_ERROR: the BTF has no light in it at all, or there is not
 * enough memory. Stages "layers", "fit". */
struct maps_fit *maps_fit_new(const struct maps_register *of, const struct maps_layers *layers,
                              enum maps_model model, const struct work *work, GError **error);
void maps_fit_free(struct maps_fit *fit); /* NULL is ignored */
