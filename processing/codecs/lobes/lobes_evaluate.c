#include "lobes_private.h"

#include "codecs/codec/texel_model.h"

#include <math.h>
#include <string.h>

#define COLOURS  3
#define MIN_VIEW 0.1F /* minimum of the divisors n·v and max(n·l, n·v) of lobes.h */

static float dot(const float a[3], const float b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Computes Σ_{i<k} ⟨g_i · w⟩^N_i. values is k × (X, Y, Z, N), with g_i = (X, Y, Z). w is l for
 * fields, and (vx lx, vy ly, vz lz) for lafortune. */
static float sum_lobes(const float *values, int k, const float w[3]) {
    float sum = 0;
    for (int i = 0; i < k; i++) {
        const float c = dot(values + (gsize)(4 * i), w);
        sum += c > 0 ? powf(c, values[4 * i + 3]) : 0;
    }
    return sum;
}

/* Evaluates a polynomial texture map (Malzbender et al. 2001); c is C0 … C5. */
static float polynomial(const float *c, const float l[3]) {
    return c[0] * l[0] * l[0] + c[1] * l[1] * l[1] + c[2] * l[0] * l[1] + c[3] * l[0] +
           c[4] * l[1] + c[5];
}

/* Returns the distribution of a microfacet model at the half vector h = (hx, hy, hn) in the frame
 * (t, b, n):
 *   Ward        exp(−2 ((hx/U)² + (hy/V)²) / (1 + hn))
 *   Ashikhmin   hn^((U hx² + V hy²) / (1 − hn²)) = exp(q (U hx² + V hy²)), q = ln hn / (1 − hn²)
 * At the normal, where q is 0/0, the exponent is −(U hx² + V hy²) / 2. */
static float distribution(enum lobes_model model, float u, float v, const float h[3]) {
    if (model == LOBES_WARD) {
        const float x = h[0] / u, y = h[1] / v;
        return expf(-2 * (x * x + y * y) / (1 + MAX(h[2], 0)));
    }
    const float high = MAX(h[2], 1e-3F), rest = 1 - high * high;
    const float q = rest < 1e-4F ? -0.5F : logf(high) / rest;
    return expf(q * (u * h[0] * h[0] + v * h[1] * h[1]));
}

/* Computes RGB = diffuse ⟨n·l⟩ + specular s (v, l), with s as in lobes.h. values are diffuse RGB,
 * specular RGB, n, t, U, V. MIN_VIEW replaces a smaller n·v. The result is 0 for a light on or
 * below the surface. */
static void facet(enum lobes_model model, const float *values, const float v[3], const float l[3],
                  float ret[3]) {
    const float *n = values + 6, *t = values + 9, rough_u = values[12], rough_v = values[13];
    const float b[3] = {n[1] * t[2] - n[2] * t[1], n[2] * t[0] - n[0] * t[2],
                        n[0] * t[1] - n[1] * t[0]};
    float h[3] = {l[0] + v[0], l[1] + v[1], l[2] + v[2]};
    const float nl = dot(n, l), nv = MAX(dot(n, v), MIN_VIEW);
    memset(ret, 0, sizeof(float) * COLOURS);
    if (!(nl > 1e-4F))
        return;
    const float size = MAX(sqrtf(dot(h, h)), 1e-3F);
    for (int i = 0; i < 3; i++)
        h[i] /= size;
    const float local[3] = {dot(h, t), dot(h, b), dot(h, n)};
    const float scale = model == LOBES_WARD ? sqrtf(nl / nv) / (4 * rough_u * rough_v)
                                            : sqrtf((rough_u + 1) * (rough_v + 1)) / 8 * nl /
                                                  (MAX(dot(h, l), 1e-3F) * MAX(nl, nv));
    const float shine = scale * distribution(model, rough_u, rough_v, local);
    for (int c = 0; c < COLOURS; c++)
        ret[c] = values[c] * nl + values[COLOURS + c] * shine;
}

/* Evaluates the values of one texel in one slice. The values of microfacet models contain two
 * colours. The other models give Y, which is multiplied by the colour of the texel. */
static void evaluate(const struct lobes *lobes, const float *values, const float v[3],
                     const float l[3], float ret[3]) {
    const float w[3] = {v[0] * l[0], v[1] * l[1], v[2] * l[2]};
    float y;
    switch (lobes->model) {
    case LOBES_FIELDS:
        y = sum_lobes(values + COLOURS, lobes->n_lobes, l);
        break;
    case LOBES_PTM:
        y = polynomial(values + COLOURS, l);
        break;
    case LOBES_LAFORTUNE:
        y = l[2] * (values[COLOURS] + sum_lobes(values + COLOURS + 1, lobes->n_lobes, w));
        break;
    default:
        facet(lobes->model, values, v, l, ret);
        return;
    }
    for (int c = 0; c < COLOURS; c++)
        ret[c] = values[c] * y;
}

/* Returns the n_values values of a texel of a slice. slice is the index of a view for fields and
 * ptm, otherwise 0. */
static const float *values_of(const struct lobes *lobes, int slice, int texel) {
    const gsize texels = btf_layout_texels(&lobes->layout);
    return lobes->values + ((gsize)slice * texels + (gsize)texel) * (gsize)lobes->n_values;
}

void lobes_evaluate(const struct lobes *lobes, int slice, int texel, const float view[3],
                    const float light[3], float ret[3]) {
    evaluate(lobes, values_of(lobes, slice, texel), view, light, ret);
}

struct measured {
    const struct lobes *lobes;
    float *views, *lights; /* n_views × 3 and n_lights × 3, unit vectors */
};

static struct measured measured_directions(const struct lobes *lobes) {
    return (struct measured){lobes, direction_list_vectors(&lobes->layout.views),
                             direction_list_vectors(&lobes->layout.lights)};
}

static void lobes_evaluate_measured_clear(struct measured *measured) {
    g_free(measured->views);
    g_free(measured->lights);
}

/* Reconstructs one texel at the measured directions. ret is n_views × n_lights × COLOURS. */
static void reconstruct(gconstpointer model, int texel, float *ret) {
    const struct measured *at = model;
    const struct lobes *lobes = at->lobes;
    for (gsize v = 0; v < lobes->layout.views.n; v++) {
        const float *values = values_of(lobes, lobes->n_slices > 1 ? (int)v : 0, texel);
        for (gsize l = 0; l < lobes->layout.lights.n; l++, ret += COLOURS)
            evaluate(lobes, values, at->views + 3 * v, at->lights + 3 * l, ret);
    }
}

void lobes_reconstruct(const struct lobes *lobes, int texel, float *ret) {
    struct measured at = measured_directions(lobes);
    reconstruct(&at, texel, ret);
    lobes_evaluate_measured_clear(&at);
}

double lobes_error(struct lobes *lobes, const struct btf_matrix *btf, int n_threads) {
    struct measured at = measured_directions(lobes);
    texel_model_errors(btf, reconstruct, &at, n_threads, &lobes->error, &lobes->luminance_error);
    lobes_evaluate_measured_clear(&at);
    return lobes->error;
}
