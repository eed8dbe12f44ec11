#include "compress.h"

#include "eigenmaps/eigenmaps.h"

#define ROWS ((gsize)64) /* texels read at a time, so that what is written stays in the cache */

struct columns {
    const struct btf_matrix *btf;
    const struct work *work;
    gint64 begun_us;
    int asked;
};

static gboolean cli_compress_eigenmaps_give_column(int view, float *ret_column, gpointer data,
                                                   GError **error) {
    struct columns *columns = data;
    const struct btf_matrix *btf = columns->btf;
    const gsize texels = (gsize)btf->width * (gsize)btf->height, n = 3 * (gsize)btf->n_lights;
    columns->asked++;
    if (!work_tell(columns->work, "eigenmaps", MIN(columns->asked, btf->n_views), btf->n_views,
                   columns->begun_us, error))
        return FALSE;
    g_autofree float *buffer = btf->values ? NULL : g_new(float, ROWS *n);
    for (gsize first = 0; first < texels; first += ROWS) {
        const gsize rows = MIN(ROWS, texels - first);
        gsize stride;
        const float *values =
            btf_matrix_rows(btf, view, (int)first, (int)rows, buffer, &stride, error);
        if (!values)
            return FALSE;
        for (gsize row = 0; row < rows; row++)
            for (gsize i = 0; i < n; i++)
                ret_column[(i / 3 * texels + first + row) * 3 + i % 3] = values[row * stride + i];
    }
    return TRUE;
}

static struct eigenmaps *cli_compress_eigenmaps_new_eigenmaps(const struct btf_matrix *btf,
                                                              int n_terms) {
    const gsize views = sizeof(float) * (gsize)btf->n_views;
    const gsize lights = sizeof(float) * (gsize)btf->n_lights;
    struct eigenmaps *maps = g_new0(struct eigenmaps, 1);
    *maps = (struct eigenmaps){
        .name = g_strdup(btf->name),
        .width = btf->width,
        .height = btf->height,
        .texel_mm = btf->texel_mm,
        .reference_mm = btf->reference_mm,
        .n_views = btf->n_views,
        .n_lights = btf->n_lights,
        .n_terms = n_terms,
        .view_theta_deg = g_memdup2(btf->view_theta_deg, views),
        .view_phi_deg = g_memdup2(btf->view_phi_deg, views),
        .light_theta_deg = g_memdup2(btf->light_theta_deg, lights),
        .light_phi_deg = g_memdup2(btf->light_phi_deg, lights),
    };
    return maps;
}

struct eigenmaps *compress_eigenmaps(const struct btf_matrix *btf, int n_terms,
                                     const struct eigenmaps_options *options,
                                     const struct work *work, double *ret_error, GError **error) {
    struct columns columns = {.btf = btf, .work = work, .begun_us = g_get_monotonic_time()};
    struct eigenmaps *maps = cli_compress_eigenmaps_new_eigenmaps(btf, n_terms);
    if (!eigenmaps_compute_with(maps, options, cli_compress_eigenmaps_give_column, &columns,
                                ret_error, error))
        g_clear_pointer(&maps, eigenmaps_free);
    return maps;
}
