#include "material_private.h"

#include <math.h>
#include <string.h>

#define COLOURS 3
#define ACROSS  16 /* maximum number of texels of a footprint that count in each dimension */

/* Texels along one axis and their weights, whose sum is 1. */
struct material_axis {
    int n, index[ACROSS + 2];
    float weight[ACROSS + 2];
};

static int wrap(double i, int n) {
    const int rest = (int)fmod(i, n);
    return rest < 0 ? rest + n : rest;
}

/* Returns the integral of the tent max(0, 1 − |t|) from −∞ to t. */
static double tent(double t) {
    t = CLAMP(t, -1, 1);
    return t < 0 ? 0.5 * (t + 1) * (t + 1) : 1 - 0.5 * (1 - t) * (1 - t);
}

/* Gives the weights for the mean of the linear interpolant over at − width/2 … at + width/2, where
 * texel i has its centre at i + ½. If the range is wider than ACROSS texels, ACROSS evenly spaced
 * texels count. A width larger than the tile counts as the whole tile. */
static void axis_find(double at, double width, int n, struct material_axis *ret) {
    ret->n = 0;
    width = MIN(width, n);
    if (width > ACROSS) {
        for (; ret->n < ACROSS; ret->n++) {
            const double x = at + width * ((ret->n + 0.5) / ACROSS - 0.5);
            ret->index[ret->n] = wrap(floor(x), n);
            ret->weight[ret->n] = 1.0F / ACROSS;
        }
        return;
    }
    const double low = at - 0.5 * width - 0.5, high = at + 0.5 * width - 0.5;
    if (width < 1e-6) {
        const double first = floor(low), part = low - first;
        *ret = (struct material_axis){
            2, {wrap(first, n), wrap(first + 1, n)}, {(float)(1 - part), (float)part}};
        return;
    }
    for (double i = floor(low); i <= ceil(high) && ret->n < ACROSS + 2; i++) {
        const double weight = (tent(high - i) - tent(low - i)) / width;
        if (weight <= 0)
            continue;
        ret->index[ret->n] = wrap(i, n);
        ret->weight[ret->n++] = (float)weight;
    }
}

/* Adds the reflection of the texels of a level around (u, v), times share. width is the width of
 * the footprint in tiles. */
static void material_evaluate_level(const mesorig_material *m, guint level, double u, double v,
                                    double width, float share, const struct codec_query *query,
                                    float ret[COLOURS]) {
    gconstpointer model = m->levels->pdata[level];
    const struct btf_layout *layout = G_STRUCT_MEMBER_P(model, m->codec->layout);
    if (width == 0 && m->codec->evaluate_point) {
        m->codec->evaluate_point(model, query, u * (double)layout->width,
                                 v * (double)layout->height, share, ret);
        return;
    }
    struct material_axis x, y;
    int index[(ACROSS + 2) * (ACROSS + 2)], n = 0;
    float shares[G_N_ELEMENTS(index)];
    G_STATIC_ASSERT(G_N_ELEMENTS(index) <= CODEC_MAX_TEXELS);
    axis_find(u * layout->width, width * layout->width, (int)layout->width, &x);
    axis_find(v * layout->height, width * layout->height, (int)layout->height, &y);
    for (int j = 0; j < y.n; j++)
        for (int i = 0; i < x.n; i++) {
            index[n] = y.index[j] * (int)layout->width + x.index[i];
            shares[n] = share * x.weight[i] * y.weight[j];
            n += shares[n] > 0;
        }
    m->codec->evaluate(model, query, &(struct codec_texels){n, index, shares}, ret);
}

/* Evaluates the mip levels in the same way as the viewer: mixes the two levels nearest to log2 of
 * the footprint in texels of level 0. A material without mip levels is averaged over the footprint.
 * A footprint of at most one texel counts as a point of level 0 if there are mip levels. */
static void material_evaluate_texels(const mesorig_material *m, double u, double v, double width,
                                     const struct codec_query *query, float ret[COLOURS]) {
    const double texels = width * (double)MAX(m->layout->width, m->layout->height);
    if (m->levels->len == 1 || texels <= 1) {
        material_evaluate_level(m, 0, u, v, m->levels->len == 1 ? width : 0, 1, query, ret);
        return;
    }
    const double at = MIN(log2(texels), m->levels->len - 1), part = at - floor(at);
    material_evaluate_level(m, (guint)at, u, v, 0, (float)(1 - part), query, ret);
    if (part > 0)
        material_evaluate_level(m, (guint)at + 1, u, v, 0, (float)part, query, ret);
}

static void one(const mesorig_material *m, const float *uv, const float *view, const float *light,
                float footprint, struct codec_place *place, float ret[COLOURS]) {
    float sum[COLOURS] = {0};
    if (isfinite(uv[0]) && isfinite(uv[1]) && footprint >= 0 && isfinite(footprint) &&
        codec_place_set(&m->tables, view, light, place))
        material_evaluate_texels(m, uv[0] - floor((double)uv[0]), uv[1] - floor((double)uv[1]),
                                 footprint, &place->query, sum);
    for (int c = 0; c < COLOURS; c++)
        ret[c] = isfinite(sum[c]) && sum[c] > 0 ? sum[c] : 0;
}

int mesorig_material_evaluate(const mesorig_material *m, size_t n, const float *uv,
                              const float *view, const float *light, const float *footprint,
                              float *ret_rgb) {
    if (!m || (n > 0 && (!uv || !view || !light || !ret_rgb)))
        return MESORIG_ERROR_ARGUMENT;
    const gsize n_views = codec_place_views(&m->tables), n_lights = codec_place_lights(&m->tables);
    int few_indices[64];
    float few_weights[G_N_ELEMENTS(few_indices)];
    g_autofree int *indices = NULL;
    g_autofree float *weights = NULL;
    if (n_views + n_lights > G_N_ELEMENTS(few_indices)) {
        indices = g_try_new(int, n_views + n_lights);
        weights = g_try_new(float, n_views + n_lights);
        if (!indices || !weights)
            return MESORIG_ERROR_MEMORY;
    }
    int *const index = indices ? indices : few_indices;
    float *const weight = weights ? weights : few_weights;
    struct codec_place place = {
        .views = index,
        .lights = index + n_views,
        .view_weights = weight,
        .light_weights = weight + n_views,
    };
    for (size_t k = 0; k < n; k++)
        one(m, uv + 2 * k, view + 3 * k, light + 3 * k, footprint ? footprint[k] : 0, &place,
            ret_rgb + 3 * k);
    return MESORIG_OK;
}
