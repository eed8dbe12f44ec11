#include "lpca.h"

#include <math.h>
#include <string.h>

#include "base/direction.h"
#include "exr/exr_half.h"
#include "lpca_private.h"

#define COLOURS   3
#define LARGEST_Q 127
#define MIN_LIGHT 1e-3F /* minimum of a light's step, relative to the largest step */

static const char *const kinds[] = {"float", "half", "8bit", "8bit-weights", "packed"};

const char *lpca_quantise_name(enum lpca_quantise quantise) {
    return kinds[quantise];
}

gboolean lpca_quantise_parse(const char *name, enum lpca_quantise *ret) {
    for (gsize i = 0; i < G_N_ELEMENTS(kinds); i++)
        if (g_strcmp0(kinds[i], name) == 0) {
            *ret = (enum lpca_quantise)i;
            return TRUE;
        }
    return FALSE;
}

void lpca_to_log(float *values, gsize n) {
    for (gsize i = 0; i < n; i++, values += COLOURS) {
        const float y = rgb_luminance(values), size = MAX(y, 0) + LPCA_LOG_OFFSET;
        const float rest[2] = {(values[0] - y) / size, (values[2] - y) / size};
        values[0] = logf(size);
        values[1] = rest[0];
        values[2] = rest[1];
    }
}

void lpca_from_log(float *values, gsize n) {
    for (gsize i = 0; i < n; i++, values += COLOURS) {
        const float size = expf(values[0]), y = size - LPCA_LOG_OFFSET;
        const float r = y + values[1] * size, b = y + values[2] * size;
        values[0] = r;
        values[1] = (y - 0.2126F * r - 0.0722F * b) / 0.7152F;
        values[2] = b;
    }
}

void lpca_free(struct lpca *lpca) {
    if (!lpca)
        return;
    g_free(lpca->name);
    btf_layout_clear(&lpca->layout);
    g_free(lpca->clusters);
    g_free(lpca->weights);
    g_free(lpca->brdfs);
    g_free(lpca->scales);
    g_free(lpca->light_scales);
    g_free(lpca->weight_scales);
    lpca_packed_free(lpca->packed);
    g_free(lpca);
}

float *lpca_brdf(const struct lpca *lpca, int cluster, int component) {
    return lpca->brdfs + (gsize)(cluster * (lpca->n_components + 1) + component) *
                             btf_layout_values(&lpca->layout);
}

float *lpca_ones(gsize n) {
    float *ret = g_new(float, n);
    for (gsize i = 0; i < n; i++)
        ret[i] = 1;
    return ret;
}

struct lpca *lpca_new(const struct btf_matrix *btf, int n_clusters, int n_components) {
    const gsize tables = (gsize)n_clusters * (gsize)(n_components + 1);
    const gsize texels = btf_layout_texels(&btf->layout);
    struct lpca *lpca = g_new0(struct lpca, 1);
    *lpca = (struct lpca){
        .name = g_strdup(btf->name),
        .layout = btf_layout_copy(&btf->layout),
        .n_clusters = n_clusters,
        .n_components = n_components,
        .clusters = g_new0(int, texels),
        .weights = g_new0(float, texels *(gsize)n_components),
        .brdfs = g_new0(float, tables *btf_layout_values(&btf->layout)),
        .scales = lpca_ones(tables),
        .weight_scales = lpca_ones((gsize)n_clusters * (gsize)n_components),
    };
    return lpca;
}

struct lpca *lpca_truncated(const struct lpca *lpca, int n_components) {
    const struct btf_matrix like = {.name = lpca->name, .layout = lpca->layout};
    const int c = lpca->n_components, texels = btf_layout_texels(&lpca->layout);
    const gsize d = btf_layout_values(&lpca->layout);
    g_return_val_if_fail(n_components >= 1 && n_components <= c, NULL);
    struct lpca *fewer = lpca_new(&like, lpca->n_clusters, n_components);
    memcpy(fewer->clusters, lpca->clusters, sizeof(int) * (gsize)texels);
    for (int i = 0; i < texels; i++)
        memcpy(fewer->weights + (gsize)i * (gsize)n_components, lpca->weights + (gsize)i * (gsize)c,
               sizeof(float) * (gsize)n_components);
    const gsize lights = lpca->layout.lights.n;
    if (lpca->light_scales)
        fewer->light_scales = lpca_ones((gsize)(lpca->n_clusters * (n_components + 1)) * lights);
    for (int k = 0; k < lpca->n_clusters; k++) {
        if (lpca->light_scales)
            memcpy(fewer->light_scales + (gsize)(k * (n_components + 1)) * lights,
                   lpca->light_scales + (gsize)(k * (c + 1)) * lights,
                   sizeof(float) * lights * (gsize)(n_components + 1));
        memcpy(lpca_brdf(fewer, k, 0), lpca_brdf(lpca, k, 0),
               sizeof(float) * d * (gsize)(n_components + 1));
        memcpy(fewer->scales + (gsize)(k * (n_components + 1)), lpca->scales + (gsize)(k * (c + 1)),
               sizeof(float) * (gsize)(n_components + 1));
        memcpy(fewer->weight_scales + (gsize)(k * n_components),
               lpca->weight_scales + (gsize)(k * c), sizeof(float) * (gsize)n_components);
    }
    fewer->colours = lpca->colours;
    fewer->quantise = lpca->quantise == LPCA_PACKED ? LPCA_FLOAT : lpca->quantise;
    fewer->n_grid = lpca->n_grid;
    return fewer;
}

/* Computes E_0 + Σ_i w_i(x) E_i of texel x, for the n values that begin with number `from`. */
static void add_components(const struct lpca *lpca, int texel, int from, int n, float *ret) {
    const int k = lpca->clusters[texel], c = lpca->n_components;
    memcpy(ret, lpca_brdf(lpca, k, 0) + from, sizeof(float) * (gsize)n);
    for (int i = 0; i < c; i++) {
        const float weight = lpca->weights[(gsize)texel * (gsize)c + (gsize)i];
        const float *brdf = lpca_brdf(lpca, k, i + 1) + from;
        for (int j = 0; j < n; j++)
            ret[j] += weight * brdf[j];
    }
}

void lpca_reconstruct(const struct lpca *lpca, int texel, float *ret) {
    const int d = (int)btf_layout_values(&lpca->layout);
    add_components(lpca, texel, 0, d, ret);
    if (lpca->colours == LPCA_LOG)
        lpca_from_log(ret, (gsize)d / COLOURS);
}

static void to_halves(float *values, gsize n) {
    g_autofree guint16 *halves = g_new(guint16, n);
    exr_half_from_floats(halves, values, n);
    exr_half_to_floats(values, halves, n);
}

/* Rounds one table E_i (views × lights × 3) to whole steps of S_i S_i,l. S_i = max |E_i| / 127, and
 * S_i,l = max_v |E_i(v, l)| / max |E_i|, at least MIN_LIGHT. light_scales gets S_i,l; NULL means
 * that all are 1. */
static void to_steps(float *brdf, int n_views, int n_lights, float *ret_scale,
                     float *light_scales) {
    const int n = n_views * n_lights * COLOURS;
    float largest = 0;
    for (int i = 0; i < n; i++)
        largest = MAX(largest, fabsf(brdf[i]));
    *ret_scale = largest > 0 ? largest / LARGEST_Q : 1;
    for (int l = 0; l < n_lights && light_scales; l++)
        light_scales[l] = largest > 0 ? MIN_LIGHT : 1;
    for (int i = 0; i < n && light_scales && largest > 0; i++) {
        float *most = &light_scales[i / COLOURS % n_lights];
        *most = MAX(*most, fabsf(brdf[i]) / largest);
    }
    if (light_scales)
        to_halves(light_scales, (gsize)n_lights);
    for (int i = 0; i < n; i++) {
        const float step = *ret_scale * (light_scales ? light_scales[i / COLOURS % n_lights] : 1);
        brdf[i] = roundf(brdf[i] / step) * step;
    }
}

/* Rounds the weights of each cluster and component to whole steps of max |w| / 127. */
static void weights_to_steps(struct lpca *lpca) {
    const int c = lpca->n_components, texels = btf_layout_texels(&lpca->layout);
    const int n = lpca->n_clusters * c;
    memset(lpca->weight_scales, 0, sizeof(float) * (gsize)n);
    for (int i = 0; i < texels * c; i++) {
        float *largest = &lpca->weight_scales[lpca->clusters[i / c] * c + i % c];
        *largest = MAX(*largest, fabsf(lpca->weights[i]));
    }
    for (int i = 0; i < n; i++)
        lpca->weight_scales[i] =
            lpca->weight_scales[i] > 0 ? lpca->weight_scales[i] / LARGEST_Q : 1;
    for (int i = 0; i < texels * c; i++) {
        const float scale = lpca->weight_scales[lpca->clusters[i / c] * c + i % c];
        lpca->weights[i] = roundf(lpca->weights[i] / scale) * scale;
    }
}

void lpca_quantise(struct lpca *lpca, enum lpca_quantise quantise) {
    const gsize d = btf_layout_values(&lpca->layout);
    const int tables = lpca->n_components + 1;
    g_return_if_fail(lpca->quantise == LPCA_FLOAT && (int)quantise < LPCA_QUANTISE_KINDS);
    lpca->quantise = quantise;
    lpca->error = 0;
    if (quantise == LPCA_FLOAT)
        return;
    if (quantise >= LPCA_8BIT && lpca->n_grid == 0)
        lpca->light_scales =
            lpca_ones((gsize)lpca->n_clusters * (gsize)tables * lpca->layout.lights.n);
    if (quantise == LPCA_8BIT_WEIGHTS)
        weights_to_steps(lpca);
    else
        to_halves(lpca->weights, btf_layout_texels(&lpca->layout) * (gsize)lpca->n_components);
    for (int i = 0; i < lpca->n_clusters * tables; i++)
        if (quantise >= LPCA_8BIT && i % tables > 0)
            to_steps(lpca->brdfs + (gsize)i * d, lpca->layout.views.n, lpca->layout.lights.n,
                     &lpca->scales[i],
                     lpca->light_scales ? lpca->light_scales + (gsize)i * lpca->layout.lights.n
                                        : NULL);
        else
            to_halves(lpca->brdfs + (gsize)i * d, d);
}

gint64 lpca_bytes(const struct lpca *lpca) {
    const gint64 texels = btf_layout_texels(&lpca->layout), k = lpca->n_clusters;
    const gint64 d = (int)btf_layout_values(&lpca->layout), c = lpca->n_components;
    const gint64 value = lpca->quantise == LPCA_FLOAT ? 4 : 2;
    const gint64 weight = lpca->quantise == LPCA_8BIT_WEIGHTS ? 1 : value;
    const gint64 scales = lpca->quantise == LPCA_8BIT_WEIGHTS ? 8 : 4;
    const gboolean bytes = lpca->quantise == LPCA_8BIT || lpca->quantise == LPCA_8BIT_WEIGHTS;
    const gint64 lights = lpca->light_scales ? 2 * lpca->layout.lights.n : 0;
    const gint64 brdfs = bytes ? k * (2 * d + c * (d + scales + lights)) : k * (c + 1) * d * value;
    return texels * ((k > 256 ? 2 : 1) + c * weight) + brdfs;
}
