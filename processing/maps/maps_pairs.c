#include "maps_fit_private.h"

#include <math.h>

#define MIN_Z 0.02F /* minimum z of a direction; from lower directions almost nothing is seen */

struct maps_pairs *maps_pairs_new(const struct btf_layout *layout, enum maps_model model) {
    g_autofree float *views = direction_list_vectors(&layout->views);
    g_autofree float *lights = direction_list_vectors(&layout->lights);
    const gsize all = layout->views.n * layout->lights.n;
    const gsize stride = MAX((all + MAPS_MAX_PAIRS - 1) / MAPS_MAX_PAIRS, 1);
    struct maps_pairs *ret = g_new0(struct maps_pairs, 1);
    ret->model = model;
    ret->index = g_new(int, all / stride + 1);
    for (int k = 0; k < MAPS_PLANES; k++)
        ret->planes[k] = g_new0(float, all / stride + 1);
    for (gsize i = 0; i < all; i += stride) {
        const float *v = views + i / layout->lights.n * 3, *l = lights + i % layout->lights.n * 3;
        float h[3] = {v[0] + l[0], v[1] + l[1], v[2] + l[2]};
        const float length = sqrtf(h[0] * h[0] + h[1] * h[1] + h[2] * h[2]);
        if (v[2] < MIN_Z || l[2] < MIN_Z)
            continue;
        const int n = ret->n++;
        for (int k = 0; k < 3; k++) {
            h[k] /= length;
            ret->planes[MAPS_VX + k][n] = v[k];
            ret->planes[MAPS_LX + k][n] = l[k];
            ret->planes[MAPS_HX + k][n] = h[k];
        }
        ret->planes[MAPS_F5][n] = powf(MAX(1 - v[0] * h[0] - v[1] * h[1] - v[2] * h[2], 0), 5);
        ret->index[n] = (int)i;
    }
    return ret;
}

void maps_pairs_set_layers(struct maps_pairs *pairs, const struct maps_layers *layers) {
    const double sheen = layers->sheen_roughness, coat = layers->coat_roughness;
    pairs->extra = sheen > 0 || coat > 0;
    for (int i = 0; i < pairs->n; i++) {
        const double nl = pairs->planes[MAPS_LZ][i], nv = pairs->planes[MAPS_VZ][i];
        const double nh = pairs->planes[MAPS_HZ][i];
        double value = 0;
        if (sheen > 0)
            value += maps_sheen(sheen, nl, nv, nh);
        if (coat > 0)
            value += maps_lobe(coat * coat, nl, nv, nh) * (0.04 + 0.96 * pow(1 - nv, 5));
        pairs->planes[MAPS_EXTRA][i] = (float)(G_PI * nl * value);
    }
}

void maps_pairs_free(struct maps_pairs *pairs) {
    if (!pairs)
        return;
    for (int k = 0; k < MAPS_PLANES; k++)
        g_free(pairs->planes[k]);
    g_free(pairs->index);
    g_free(pairs);
}
