#include "lpca_choose.h"

#define PATIENCE 2 /* more clusters are tried so often without getting better */

/* What it would take as a file of that kind. */
static gint64 size_of(const struct btf_matrix *btf, const struct lpca_wish *wish, int clusters,
                      int components) {
    const struct lpca like = {
        .width = btf->width,
        .height = btf->height,
        .n_views = wish->n_grid ? wish->n_grid * wish->n_grid : btf->n_views,
        .n_lights = wish->n_grid ? wish->n_grid * wish->n_grid : btf->n_lights,
        .n_clusters = clusters,
        .n_components = components,
        .quantise = wish->quantise,
    };
    return lpca_bytes(&like);
}

/* 0 if not even one component fits. */
static int most_components(const struct btf_matrix *btf, const struct lpca_wish *wish,
                           int clusters) {
    int c = MIN(wish->n_components, LPCA_MAX_COMPONENTS);
    c = MIN(c, btf->n_views * btf->n_lights * 3);
    while (c > 0 && wish->bytes > 0 && size_of(btf, wish, clusters, c) > wish->bytes)
        c--;
    return c;
}

static gboolean is_better(const struct btf_matrix *btf, const struct lpca_wish *wish,
                          const struct lpca *one, const struct lpca *best) {
    if (!best || wish->error <= 0)
        return !best || one->error < best->error;
    return size_of(btf, wish, one->n_clusters, one->n_components) <
           size_of(btf, wish, best->n_clusters, best->n_components);
}

static struct lpca *too_small(const struct btf_matrix *btf, const struct lpca_wish *wish,
                              GError **error) {
    g_autofree char *wanted = g_format_size((guint64)wish->bytes);
    g_autofree char *least = g_format_size((guint64)size_of(btf, wish, 1, 1));
    g_set_error(error, PIPELINE_ERROR, PIPELINE_ERROR_DATA,
                "%s is too little: one cluster of one component takes %s", wanted, least);
    return NULL;
}

/* One number of clusters: NULL without an error where the wish cannot be had with it. */
static struct lpca *try_clusters(const struct btf_matrix *btf, const struct lpca_options *options,
                                 const struct lpca_wish *wish, int clusters, GError **last,
                                 GError **error) {
    struct lpca_options now = *options;
    g_autoptr(GError) failed = NULL;
    now.n_clusters = clusters;
    now.n_components = most_components(btf, wish, clusters);
    now.target = wish->error;
    struct lpca *lpca = now.n_components > 0 ? lpca_compute(btf, &now, &failed) : NULL;
    if (lpca || !failed)
        return lpca;
    if (g_error_matches(failed, G_IO_ERROR, G_IO_ERROR_CANCELLED) || wish->error <= 0) {
        g_propagate_error(error, g_steal_pointer(&failed));
        return NULL;
    }
    g_clear_error(last);
    *last = g_steal_pointer(&failed);
    return NULL;
}

struct lpca *lpca_choose(const struct btf_matrix *btf, const struct lpca_options *options,
                         const struct lpca_wish *wish, GError **error) {
    const gint64 most = MIN((gint64)btf->width * btf->height, LPCA_MAX_CLUSTERS);
    g_autoptr(GError) last = NULL, failed = NULL;
    struct lpca *best = NULL;
    int worse = 0;
    if (wish->bytes > 0 && most_components(btf, wish, 1) == 0)
        return too_small(btf, wish, error);
    for (int k = 1; k <= most && worse < PATIENCE; k *= 2) {
        struct lpca *lpca = try_clusters(btf, options, wish, k, &last, &failed);
        if (failed)
            break;
        if (lpca && is_better(btf, wish, lpca, best)) {
            lpca_free(best);
            best = g_steal_pointer(&lpca);
            worse = 0;
        } else {
            worse += lpca || best || most_components(btf, wish, k) == 0;
        }
        lpca_free(lpca);
    }
    if (failed) {
        g_clear_pointer(&best, lpca_free);
        g_propagate_error(error, g_steal_pointer(&failed));
    } else if (!best && last) {
        g_propagate_error(error, g_steal_pointer(&last));
    }
    return best;
}
