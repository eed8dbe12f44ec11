#include "lpca_pack_private.h"

#include <cblas.h>
#include <string.h>

/* The weights of one cluster are coordinates along its orthonormal eigen-BRDFs E (r × d).
 * Clustering the weights is therefore the same as clustering the texels. A cluster of weights with
 * mean m and axes A has the mean E_0 + m E and the eigen-BRDFs A E. */
struct regroup {
    const struct lpca *from;
    struct lpca *to;
    const struct lpca_reduced *reduced;
};

static void regroup_cluster(int k, gpointer data) {
    const struct regroup *regroup = data;
    const struct lpca_reduced *reduced = regroup->reduced;
    const struct lpca *from = regroup->from;
    const int d = (int)btf_layout_values(&from->layout), r = reduced->r, c = reduced->c;
    float *mean = lpca_brdf(regroup->to, k, 0);
    memcpy(mean, lpca_brdf(from, 0, 0), sizeof(float) * (gsize)d);
    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, 1, d, r, 1,
                reduced->means + (gsize)k * (gsize)r, r, lpca_brdf(from, 0, 1), d, 1, mean, d);
    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, c, d, r, 1,
                reduced->bases + (gsize)(k * c) * (gsize)r, r, lpca_brdf(from, 0, 1), d, 0,
                lpca_brdf(regroup->to, k, 1), d);
}

static void regroup_weights(int block, gpointer data) {
    const struct regroup *regroup = data;
    const struct lpca_reduced *reduced = regroup->reduced;
    const int from = block * LPCA_BLOCK, end = MIN(from + LPCA_BLOCK, reduced->n);
    lpca_reduced_weights(reduced, reduced->labels, from, end, regroup->to->weights);
}

struct lpca *lpca_regroup(const struct lpca *lpca, const struct lpca_options *options,
                          GError **error) {
    const int n = btf_layout_texels(&lpca->layout);
    struct lpca_reduced reduced = {
        .n = n,
        .r = lpca->n_components,
        .rows = lpca->weights,
        .options = options,
        .k = MIN(options->n_clusters, n),
        .c = MIN(MIN(options->n_components, lpca->n_components), LPCA_MAX_COMPONENTS)};
    g_return_val_if_fail(lpca->n_clusters == 1, NULL);
    if (!lpca_cluster(&reduced, error)) {
        lpca_reduced_clear(&reduced);
        return NULL;
    }
    const struct btf_matrix like = {.name = lpca->name, .layout = lpca->layout};
    struct lpca *ret = lpca_new(&like, reduced.k, reduced.c);
    struct regroup regroup = {lpca, ret, &reduced};
    ret->colours = lpca->colours;
    memcpy(ret->clusters, reduced.labels, sizeof(int) * (gsize)n);
    work_for_each(options->work.n_threads, reduced.k, regroup_cluster, &regroup);
    work_for_each(options->work.n_threads, (n + LPCA_BLOCK - 1) / LPCA_BLOCK, regroup_weights,
                  &regroup);
    lpca_reduced_clear(&reduced);
    return ret;
}
