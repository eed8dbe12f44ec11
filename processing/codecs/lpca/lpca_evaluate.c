#include "lpca_evaluate.h"

#include <string.h>

#include "lpca.h"
#include "lpca_pack.h"

#define COLOURS 3

/* Returns E_0 … E_c of a cluster at view 0 and light 0. Consecutive E_i are btf_layout_values()
 * floats apart. */
static const float *lpca_evaluate_tables(const struct lpca *lpca, int cluster) {
    return lpca->brdfs +
           (gsize)cluster * (gsize)(lpca->n_components + 1) * btf_layout_values(&lpca->layout);
}

/* Adds Σ_a Σ_b g_a h_b Σ_i w_i E_i(a, b). w_0 is the weight of the mean. g_a is the weight of view
 * a of the query, and h_b is the weight of light b. */
static void lpca_evaluate_cluster(const struct lpca *lpca, const struct codec_query *query,
                                  int cluster, const float *w, float ret[COLOURS]) {
    const float *tables = lpca_evaluate_tables(lpca, cluster);
    const gsize size = btf_layout_values(&lpca->layout), row = lpca->layout.lights.n * COLOURS;
    for (int i = 0; i <= lpca->n_components; i++, tables += size) {
        float sum[COLOURS] = {0};
        if (w[i] == 0)
            continue;
        for (int a = 0; a < query->n_views; a++) {
            const float *from = tables + (gsize)query->views[a] * row;
            for (int b = 0; b < query->n_lights; b++) {
                const float share = query->view_weights[a] * query->light_weights[b];
                const float *rgb = from + (gsize)query->lights[b] * COLOURS;
                for (int c = 0; c < COLOURS; c++)
                    sum[c] += share * rgb[c];
            }
        }
        for (int c = 0; c < COLOURS; c++)
            ret[c] += w[i] * sum[c];
    }
}

/* Evaluates each cluster once, with the summed weights of its texels. left[k] becomes 0 when texel
 * k has been evaluated. */
static void lpca_evaluate_rgb(const struct lpca *lpca, const struct codec_query *query,
                              const struct codec_texels *texels, float ret[COLOURS]) {
    const gsize n = (gsize)lpca->n_components;
    float left[CODEC_MAX_TEXELS], w[LPCA_MAX_PACKED + 1];
    memcpy(left, texels->share, sizeof(float) * (gsize)texels->n);
    for (int first = 0; first < texels->n; first++) {
        const int cluster = lpca->clusters[texels->index[first]];
        if (left[first] == 0)
            continue;
        memset(w, 0, sizeof(float) * (n + 1));
        for (int k = first; k < texels->n; k++) {
            if (left[k] == 0 || lpca->clusters[texels->index[k]] != cluster)
                continue;
            const float *of_texel = lpca->weights + (gsize)texels->index[k] * n;
            w[0] += left[k];
            for (gsize i = 0; i < n; i++)
                w[i + 1] += left[k] * of_texel[i];
            left[k] = 0;
        }
        lpca_evaluate_cluster(lpca, query, cluster, w, ret);
    }
}

static void lpca_evaluate_log(const struct lpca *lpca, const struct codec_query *query, int texel,
                              float share, float ret[COLOURS]) {
    const float *tables = lpca_evaluate_tables(lpca, lpca->clusters[texel]);
    const float *w = lpca->weights + (gsize)texel * (gsize)lpca->n_components;
    const gsize size = btf_layout_values(&lpca->layout);
    for (int a = 0; a < query->n_views; a++)
        for (int b = 0; b < query->n_lights; b++) {
            const float *from = tables + ((gsize)query->views[a] * lpca->layout.lights.n +
                                          (gsize)query->lights[b]) *
                                             COLOURS;
            float sum[COLOURS] = {from[0], from[1], from[2]};
            for (int i = 0; i < lpca->n_components; i++)
                for (int c = 0; c < COLOURS; c++)
                    sum[c] += w[i] * from[(gsize)(i + 1) * size + (gsize)c];
            lpca_from_log(sum, 1);
            for (int c = 0; c < COLOURS; c++)
                ret[c] += share * query->view_weights[a] * query->light_weights[b] * sum[c];
        }
}

void lpca_evaluate(gconstpointer model, const struct codec_query *query,
                   const struct codec_texels *texels, float ret[COLOURS]) {
    const struct lpca *lpca = model;
    if (lpca->colours != LPCA_LOG)
        lpca_evaluate_rgb(lpca, query, texels, ret);
    for (int k = 0; lpca->colours == LPCA_LOG && k < texels->n; k++)
        lpca_evaluate_log(lpca, query, texels->index[k], texels->share[k], ret);
}
