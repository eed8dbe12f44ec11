/* Fits the model of maps_model.h to each texel of a BTF, in all views and under all lights
 * together.
 *
 * The fit is a weighted least-squares fit of luminance Y over pairs i of a view and a light,
 *   min Σ u_i² (Y_i − d D_i − S A_i − w B_i − e E_i)² + priors,   u_i = h_i / (m_i + y0)^0.6.
 * Here w is the specular weight. D is Lambert's lobe times 1 − w (0.04 + 0.96 f5). A and B are the
 * microfacet lobe times (1 − f5) and f5. E is sheen or a clear coat. The exponent makes equal
 * differences in lightness count equally. For a given normal, roughnesses and w, the factors d, S
 * and e are the linear solution (variable projection, Golub & Pereyra 1973). The
 * Levenberg–Marquardt method finds the normal, roughnesses and w.
 *
 * In the first round m_i is Y_i, y0 is the mean of Y_i, and h_i is 1. In two more rounds, m_i is
 * the value of the model, y0 is a twentieth of the mean of Y_i, and h_i is Huber's factor. Shadows
 * and other effects that the model does not contain then count less. Metallic and specular follow
 * from d and S. Then base, specular colour and sheen are solved for each colour: first by least
 * squares, then with weights that minimise the sum of absolute differences of all three colours
 * (iteratively reweighted least squares). In both steps, values are also weighted by v·z of their
 * view.
 *
 * In the core model, d = (1 − m) base and S = m base + 0.04 (1 − m) give the metallic value m.
 *
 * The parameters of each texel are then refined together, by the colour difference that is seen
 * (maps_fit_private.h): first without priors, with half of the pairs, and then with all pairs and
 * the prior of the texel's cluster and of the texels around it. In the full model the clusters
 * decide which texels are metals, so that metal and dielectric do not alternate from texel to
 * texel.
 *
 * Values that are NaN are left out. A texel without light is black. Any thread. */
#pragma once

#include "base/work.h"
#include "btf/btf_matrix.h"
#include "maps_model.h"
#include "maps_register.h"

/* The parameters that a fit may use. MAPS_MODEL_CORE has the parameters of glTF without extensions:
 * base colour, metallic, roughness and normal. Anisotropy is 0, w is 1, S is at least that of a
 * dielectric, and there are no layers. */
enum maps_model { MAPS_MODEL_FULL, MAPS_MODEL_CORE };

/* maximum number of pairs of a view and a light that are fitted; if there are more pairs, every
 * second, third, … is taken */
#define MAPS_MAX_PAIRS 4096

struct maps_fit {
    struct maps_layers layers;
    struct maps_texel *texels; /* height × width */
    int dark;                  /* number of texels without light, which are black */
};

/* Fits the model to the points of the mean surface (maps_register.h). If layers is NULL, the
 * function tries layers on a selection of texels. A layer is used if it lowers the cost of these
 * texels by more than a twentieth, and by more than 0.0003 per texel on average. The cost of a
 * texel is relative to Σ u_i² Y_i².
 *
 * Returns NULL with an error in DATA_ERROR
 * - if all values of the BTF are 0 or missing,
 * - if there is not enough memory, or
 * - if no view and light are both at least 1.15° above the plane of the sample.
 * Fails too if the scratch file of the BTF cannot be read, or if cancelled.
 *
 * The progress stages are "layers", "fit" and "refine". "layers" exists only if layers is NULL and
 * the model is MAPS_MODEL_FULL. */
struct maps_fit *maps_fit_new(const struct maps_register *of, const struct maps_layers *layers,
                              enum maps_model model, const struct work *work, GError **error);
void maps_fit_free(struct maps_fit *fit); /* NULL is ignored */
