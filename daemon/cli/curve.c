#include "curve.h"

#include "compress.h"
#include "lpca/lpca_pack.h"

#include <string.h>

#define MOST_TERMS      16
#define MOST_COMPONENTS 16
#define COARSEST        4.0 /* step of packed ones, relative to what values are on average */
#define FINEST          (1.0 / 32)

struct curve {
    const struct btf_matrix *btf;
    GArray *points;
    const struct work *work;
};

void curve_free(GArray *points) {
    for (guint i = 0; points && i < points->len; i++) {
        g_free(g_array_index(points, struct plot_point, i).series);
        g_free(g_array_index(points, struct plot_point, i).label);
    }
    if (points)
        g_array_unref(points);
}

static void cli_curve_add_point(struct curve *curve, const char *series, char *label, gint64 bytes,
                                double error) {
    const struct plot_point point = {g_strdup(series), label, (double)bytes, error};
    g_array_append_val(curve->points, point);
}

static void add_lpca(struct curve *curve, const struct lpca *lpca, int components) {
    static const enum lpca_quantise kinds[] = {LPCA_HALF, LPCA_8BIT, LPCA_8BIT_WEIGHTS};
    static const char *const series[] = {"local PCA, halves", "local PCA, 8 bits",
                                         "local PCA, 8-bit weights"};
    for (gsize i = 0; i < G_N_ELEMENTS(kinds); i++) {
        struct lpca *fewer = lpca_truncated(lpca, components);
        lpca_quantise(fewer, kinds[i]);
        cli_curve_add_point(curve, series[i],
                            g_strdup_printf("%d × %d", fewer->n_clusters, components),
                            lpca_bytes(fewer), lpca_error(fewer, curve->btf, 0));
        lpca_free(fewer);
    }
}

static gboolean add_lpcas(struct curve *curve, GError **error) {
    const int texels = curve->btf->width * curve->btf->height;
    const int values = 3 * curve->btf->n_views * curve->btf->n_lights;
    for (int k = 1; k <= 64 && (k == 1 || k <= texels / 16); k *= 4) {
        const struct lpca_options options = {
            .n_clusters = k, .n_components = MIN(MOST_COMPONENTS, values), .work = *curve->work};
        struct lpca *lpca = lpca_compute(curve->btf, &options, error);
        if (!lpca)
            return FALSE;
        for (int c = 1; c <= lpca->n_components; c *= 2)
            add_lpca(curve, lpca, c);
        lpca_free(lpca);
    }
    return TRUE;
}

static gboolean add_rounded(struct curve *curve, const struct lpca_packer *packer, double step,
                            const struct lpca_options *options, GError **error) {
    struct lpca *lpca = lpca_packer_round(packer, step);
    const gint64 bytes = lpca_packed_bytes(lpca, error);
    const gboolean ok = bytes > 0 && lpca_error_shared(lpca, curve->btf, options, error);
    if (ok)
        cli_curve_add_point(
            curve, "local PCA, packed",
            g_strdup_printf(lpca->n_components > 1 ? "%d components" : "%d component",
                            lpca->n_components),
            bytes, lpca->error);
    lpca_free(lpca);
    return ok;
}

/* One local PCA is rounded to coarser and finer steps. */
static gboolean add_packed(struct curve *curve, GError **error) {
    const gint64 texels = (gint64)curve->btf->width * curve->btf->height;
    const gint64 values = 3 * (gint64)curve->btf->n_views * curve->btf->n_lights;
    const struct lpca_options options = {.n_clusters = 1,
                                         .n_components =
                                             (int)MIN(LPCA_MAX_PACKED, MIN(texels, values)),
                                         .to_pack = TRUE,
                                         .work = *curve->work};
    struct lpca *exact = lpca_compute(curve->btf, &options, error);
    if (!exact)
        return FALSE;
    struct lpca_packer *packer = lpca_packer_new(exact, 0);
    const double mean = lpca_mean_size(exact);
    gboolean ok = TRUE;
    for (double step = COARSEST; ok && step >= FINEST; step /= 2)
        ok = add_rounded(curve, packer, mean > 0 ? step * mean : 1, &options, error);
    lpca_packer_free(packer);
    lpca_free(exact);
    return ok;
}

/* The last maps are left out one power of two after the other: they are in order of what they
 * hold. */
static gboolean add_eigenmaps(struct curve *curve, GError **error) {
    const struct btf_matrix *btf = curve->btf;
    const int most = MIN(MOST_TERMS, btf->n_views);
    const struct work quiet = {.cancellable = curve->work->cancellable};
    double ignored;
    struct eigenmaps *maps =
        compress_eigenmaps(btf, most, &(struct eigenmaps_options){0}, curve->work, &ignored, error);
    if (!maps)
        return FALSE;
    Material *of_maps = material_of_eigenmaps("", maps);
    Material *of_btf = material_of_btf("", g_memdup2(btf, sizeof *btf));
    const gint64 bytes = material_info(of_maps)->bytes;
    gboolean ok = TRUE;
    for (int n = 1; ok && n <= most; n *= 2) {
        maps->n_terms = n;
        struct comparison *c = compare_materials(of_btf, of_maps, &quiet, error);
        ok = c != NULL;
        if (c)
            cli_curve_add_point(curve, "eigen-maps",
                                g_strdup_printf(n > 1 ? "%d terms" : "%d term", n),
                                bytes * n / most, c->all.error);
        comparison_free(c);
    }
    maps->n_terms = most;
    material_free(of_maps);
    /* It is the caller's: only the copy of the struct goes with the material. */
    memset((struct btf_matrix *)material_btf(of_btf), 0, sizeof *btf);
    material_free(of_btf);
    return ok;
}

static gboolean add_lobes(struct curve *curve, enum lobes_model model, int most, GError **error) {
    static const char *const names[LOBES_MODELS] = {"reflectance fields", "polynomials",
                                                    "Lafortune", "Ward", "Ashikhmin–Shirley"};
    for (int k = 1; k <= most; k++) {
        const struct lobes_options options = {.model = model, .n_lobes = k, .work = *curve->work};
        struct lobes *lobes = lobes_compute(curve->btf, &options, error);
        if (!lobes)
            return FALSE;
        cli_curve_add_point(curve, names[model],
                            most > 1 ? g_strdup_printf(k > 1 ? "%d lobes" : "%d lobe", k)
                                     : g_strdup(""),
                            lobes_bytes(lobes), lobes->error);
        lobes_free(lobes);
    }
    return TRUE;
}

static int by_series_and_size(gconstpointer a, gconstpointer b) {
    const struct plot_point *p = a, *q = b;
    const int series = strcmp(p->series, q->series);
    return series ? series : (p->bytes > q->bytes) - (p->bytes < q->bytes);
}

/* Leaves out points that a smaller one of their series does not lose against. */
static void cli_curve_keep_best(GArray *points) {
    struct plot_point *list = &g_array_index(points, struct plot_point, 0);
    guint kept = 0;
    for (guint i = 0; i < points->len; i++) {
        const gboolean same = kept > 0 && g_str_equal(list[kept - 1].series, list[i].series);
        if (!same || list[i].error < list[kept - 1].error) {
            list[kept++] = list[i];
            continue;
        }
        g_free(list[i].series);
        g_free(list[i].label);
    }
    g_array_set_size(points, kept);
}

GArray *curve_measure(const struct btf_matrix *btf, const struct work *work, GError **error) {
    static const struct work none;
    struct curve curve = {btf, g_array_new(FALSE, TRUE, sizeof(struct plot_point)),
                          work ? work : &none};
    const gboolean ok =
        add_lpcas(&curve, error) && add_packed(&curve, error) && add_eigenmaps(&curve, error) &&
        add_lobes(&curve, LOBES_FIELDS, LOBES_MAX_LOBES, error) &&
        add_lobes(&curve, LOBES_PTM, 1, error) &&
        add_lobes(&curve, LOBES_LAFORTUNE, LOBES_MAX_LOBES, error) &&
        add_lobes(&curve, LOBES_WARD, 1, error) && add_lobes(&curve, LOBES_ASHIKHMIN, 1, error);
    if (!ok) {
        curve_free(curve.points);
        return NULL;
    }
    g_array_sort(curve.points, by_series_and_size);
    cli_curve_keep_best(curve.points);
    return curve.points;
}
