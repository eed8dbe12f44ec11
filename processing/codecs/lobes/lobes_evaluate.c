#include "lobes_private.h"

#include "base/direction.h"

#include <math.h>
#include <string.h>

#define COLOURS    3
#define BLOCK      16
#define LEAST_VIEW 0.1F

static float lobes_evaluate_dot(const float a[3], const float b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static float sum_lobes(const float *values, int k, const float w[3]) {
    float sum = 0;
    for (int i = 0; i < k; i++) {
        const float c = lobes_evaluate_dot(values + (gsize)(4 * i), w);
        sum += c > 0 ? powf(c, values[4 * i + 3]) : 0;
    }
    return sum;
}

static float polynomial(const float *c, const float l[3]) {
    return c[0] * l[0] * l[0] + c[1] * l[1] * l[1] + c[2] * l[0] * l[1] + c[3] * l[0] +
           c[4] * l[1] + c[5];
}

/* Ashikhmin–Shirley's exponent goes to −(U hx² + V hy²) / 2 at the normal. */
static float distribution(enum lobes_model model, float u, float v, const float h[3]) {
    if (model == LOBES_WARD) {
        const float x = h[0] / u, y = h[1] / v;
        return expf(-2 * (x * x + y * y) / (1 + MAX(h[2], 0)));
    }
    const float high = MAX(h[2], 1e-3F), rest = 1 - high * high;
    const float q = rest < 1e-4F ? -0.5F : logf(high) / rest;
    return expf(q * (u * h[0] * h[0] + v * h[1] * h[1]));
}

static void lobes_evaluate_facet(enum lobes_model model, const float *values, const float v[3],
                                 const float l[3], float ret[3]) {
    const float *n = values + 6, *t = values + 9, rough_u = values[12], rough_v = values[13];
    const float b[3] = {n[1] * t[2] - n[2] * t[1], n[2] * t[0] - n[0] * t[2],
                        n[0] * t[1] - n[1] * t[0]};
    float h[3] = {l[0] + v[0], l[1] + v[1], l[2] + v[2]};
    const float nl = lobes_evaluate_dot(n, l), nv = MAX(lobes_evaluate_dot(n, v), LEAST_VIEW);
    memset(ret, 0, sizeof(float) * COLOURS);
    if (!(nl > 1e-4F))
        return;
    const float size = MAX(sqrtf(lobes_evaluate_dot(h, h)), 1e-3F);
    for (int i = 0; i < 3; i++)
        h[i] /= size;
    const float local[3] = {lobes_evaluate_dot(h, t), lobes_evaluate_dot(h, b),
                            lobes_evaluate_dot(h, n)};
    const float scale = model == LOBES_WARD
                            ? sqrtf(nl / nv) / (4 * rough_u * rough_v)
                            : sqrtf((rough_u + 1) * (rough_v + 1)) / 8 * nl /
                                  (MAX(lobes_evaluate_dot(h, l), 1e-3F) * MAX(nl, nv));
    const float shine = scale * distribution(model, rough_u, rough_v, local);
    for (int c = 0; c < COLOURS; c++)
        ret[c] = values[c] * nl + values[COLOURS + c] * shine;
}

static void lobes_evaluate_evaluate(const struct lobes *lobes, const float *values,
                                    const float v[3], const float l[3], float ret[3]) {
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
        lobes_evaluate_facet(lobes->model, values, v, l, ret);
        return;
    }
    for (int c = 0; c < COLOURS; c++)
        ret[c] = values[c] * y;
}

static const float *values_of(const struct lobes *lobes, int slice, int texel) {
    const gsize texels = btf_layout_texels(&lobes->layout);
    return lobes->values + ((gsize)slice * texels + (gsize)texel) * (gsize)lobes->n_values;
}

void lobes_evaluate(const struct lobes *lobes, int slice, int texel, const float view[3],
                    const float light[3], float ret[3]) {
    lobes_evaluate_evaluate(lobes, values_of(lobes, slice, texel), view, light, ret);
}

struct measured {
    float *views, *lights; /* × 3 */
};

static struct measured measured_directions(const struct lobes *lobes) {
    struct measured ret = {g_new(float, 3 * lobes->layout.views.n),
                           g_new(float, 3 * lobes->layout.lights.n)};
    for (gsize i = 0; i < lobes->layout.views.n; i++)
        direction_from_deg(lobes->layout.views.theta_deg[i], lobes->layout.views.phi_deg[i],
                           ret.views + (gsize)(3 * i));
    for (gsize i = 0; i < lobes->layout.lights.n; i++)
        direction_from_deg(lobes->layout.lights.theta_deg[i], lobes->layout.lights.phi_deg[i],
                           ret.lights + (gsize)(3 * i));
    return ret;
}

static void lobes_evaluate_measured_clear(struct measured *measured) {
    g_free(measured->views);
    g_free(measured->lights);
}

static void lobes_evaluate_reconstruct(const struct lobes *lobes, const struct measured *at,
                                       int texel, float *ret) {
    for (gsize v = 0; v < lobes->layout.views.n; v++) {
        const float *values = values_of(lobes, lobes->n_slices > 1 ? v : 0, texel);
        for (gsize l = 0; l < lobes->layout.lights.n; l++, ret += COLOURS)
            lobes_evaluate_evaluate(lobes, values, at->views + (gsize)(3 * v),
                                    at->lights + (gsize)(3 * l), ret);
    }
}

void lobes_reconstruct(const struct lobes *lobes, int texel, float *ret) {
    struct measured at = measured_directions(lobes);
    lobes_evaluate_reconstruct(lobes, &at, texel, ret);
    lobes_evaluate_measured_clear(&at);
}

struct comparison {
    const struct lobes *lobes;
    const struct btf_matrix *btf;
    struct measured at;
    double *sums; /* × 4 a block: of squares, of theirs; of luminance, how many */
};

static void lobes_evaluate_compare_block(int block, gpointer data) {
    const struct comparison *to = data;
    const int n = to->btf->layout.views.n * to->btf->layout.lights.n;
    const int end = MIN((block + 1) * BLOCK, btf_layout_texels(&to->btf->layout));
    double *sums = to->sums + (gsize)(4 * block);
    g_autofree float *values = g_new0(float, n *COLOURS);
    for (int texel = block * BLOCK; texel < end; texel++) {
        const float *truth = to->btf->values + (gsize)texel * (gsize)n * COLOURS;
        lobes_evaluate_reconstruct(to->lobes, &to->at, texel, values);
        for (int i = 0; i < n * COLOURS; i++) {
            const double rest = (double)truth[i] - values[i];
            sums[0] += isnan(truth[i]) ? 0 : rest * rest;
            sums[1] += isnan(truth[i]) ? 0 : (double)truth[i] * truth[i];
        }
        for (int i = 0; i < n; i++) {
            const float y = rgb_luminance(truth + (gsize)(i * COLOURS));
            const float there = rgb_luminance(values + (gsize)(i * COLOURS));
            sums[2] += isnan(y) ? 0 : fabsf(y - there);
            sums[3] += !isnan(y);
        }
    }
}

double lobes_error(struct lobes *lobes, const struct btf_matrix *btf, int n_threads) {
    const int blocks = (btf_layout_texels(&lobes->layout) + BLOCK - 1) / BLOCK;
    const struct work work = {.n_threads = n_threads};
    g_autofree double *sums = g_new0(double, 4 * blocks);
    struct comparison to = {lobes, btf, measured_directions(lobes), sums};
    double all[4] = {0};
    work_parallel(&work, "", blocks, lobes_evaluate_compare_block, &to, NULL);
    for (int i = 0; i < 4 * blocks; i++)
        all[i % 4] += sums[i];
    lobes->error = all[1] > 0 ? sqrt(all[0] / all[1]) : 0;
    lobes->luminance_error = all[3] > 0 ? all[2] / all[3] : 0;
    lobes_evaluate_measured_clear(&to.at);
    return lobes->error;
}
