#include "lpca_fixture.h"

int lpca_fixture_row_length(const struct btf_matrix *btf) {
    return btf_layout_values(&btf->layout);
}

struct btf_matrix *lpca_fixture_mixture(int width, int height, int n_views, int n_lights,
                                        int groups, int rank, double noise) {
    struct btf_matrix *btf = btf_fixture_new("weave", width, height, n_views, n_lights);
    const int d = lpca_fixture_row_length(btf), factors = rank + 1;
    GRand *random = g_rand_new_with_seed(5);
    g_autofree double *basis = g_new0(double, groups *factors *d);
    for (int i = 0; i < groups * factors * d; i++)
        basis[i] = g_rand_double_range(random, -1, 1) * (i / d % factors == 0 ? 1 : 0.5);
    for (int texel = 0; texel < width * height; texel++) {
        float *row = btf->values + texel * d;
        for (int f = 0; f < factors; f++) {
            const double weight = f == 0 ? 1 : g_rand_double_range(random, -1, 1) / f;
            for (int j = 0; j < d; j++)
                row[j] += (float)(weight * basis[(texel % groups * factors + f) * d + j]);
        }
        for (int j = 0; j < d; j++)
            row[j] += (float)(noise * g_rand_double_range(random, -1, 1));
    }
    g_rand_free(random);
    return btf;
}

void lpca_fixture_assert_same(const struct lpca *a, const struct lpca *b) {
    const gsize n = btf_layout_texels(&a->layout), c = (gsize)a->n_components;
    const gsize tables = (gsize)a->n_clusters * (c + 1);
    const gsize d = btf_layout_values(&a->layout);
    g_assert_cmpint(a->n_clusters, ==, b->n_clusters);
    g_assert_cmpint(a->n_components, ==, b->n_components);
    g_assert_cmpint(a->layout.views.n, ==, b->layout.views.n);
    g_assert_cmpint(a->layout.lights.n, ==, b->layout.lights.n);
    g_assert_cmpmem(a->clusters, n * sizeof(int), b->clusters, n * sizeof(int));
    for (gsize i = 0; i < n * c; i++) /* −0 in 8 bits is read as 0 */
        g_assert_true(a->weights[i] == b->weights[i]);
    g_assert_cmpmem(a->scales, tables * sizeof(float), b->scales, tables * sizeof(float));
    g_assert_cmpint(a->colours, ==, b->colours);
    for (gsize i = 0; i < tables * d; i++)
        g_assert_true(a->brdfs[i] == b->brdfs[i]);
}
