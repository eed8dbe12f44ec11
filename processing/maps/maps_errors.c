/* Compares the maps with the BTF: each texel at every k-th pair of a view and a light, where k is
 * errors.every. Consecutive texels begin with different pairs. */
#include <math.h>

#include "maps_private.h"
#include "metrics/delta_e.h"

/* largest number of comparisons, each of one texel in one view under one light */
#define MAX_COMPARED 8000000

struct maps_errors_run {
    struct maps *maps;
    const struct maps_register *of;
    const struct btf_matrix *btf; /* of->btf */
    const float *views, *lights;
    GMutex mutex;
    /* sums: for each pair, the sum of CIEDE2000 over texels
     * counts: for each pair, the number of these texels */
    double *sums, *counts;
    double residual, all, delta_e, n;
    GError *error;
};

/* Compares the texels of row y. */
static void maps_errors_row(int y, gpointer data) {
    struct maps_errors_run *run = data;
    struct maps *maps = run->maps;
    const int width = maps->width, every = maps->errors.every;
    const gsize row = run->btf->layout.lights.n * 3;
    const int n_pairs = maps->n_views * maps->n_lights;
    g_autofree float *buffer = g_new(float, row *(gsize)width);
    g_autofree double *sums = g_new0(double, n_pairs), *counts = g_new0(double, n_pairs);
    g_autofree double *texels = g_new0(double, width), *compared = g_new0(double, width);
    double residual = 0, all = 0;
    g_autoptr(GError) error = NULL;
    for (int view = 0; view < maps->n_views && !error; view++) {
        gsize stride;
        const float *from =
            maps_register_rows(run->of, view, y * width, width, buffer, &stride, &error);
        for (int x = 0; from && x < width; x++) {
            const gsize texel = (gsize)y * (gsize)width + (gsize)x;
            const struct maps_texel rounded = maps_rounded(maps, texel);
            const int offset = (int)(texel * 7 % (gsize)every);
            for (int light = 0; light < maps->n_lights; light++) {
                const int pair = view * maps->n_lights + light;
                const float *value = from + (gsize)x * stride + (gsize)light * 3;
                float model[3];
                double lab[3], model_lab[3];
                if (pair % every != offset || isnan(value[0] + value[1] + value[2]))
                    continue;
                maps_evaluate(&maps->fit->layers, &rounded, run->views + 3 * (gsize)view,
                              run->lights + 3 * (gsize)light, model);
                delta_e_lab(value, lab);
                delta_e_lab(model, model_lab);
                const double delta_e = delta_e_2000(lab, model_lab);
                sums[pair] += delta_e;
                counts[pair]++;
                texels[x] += delta_e;
                compared[x]++;
                for (int c = 0; c < 3; c++) {
                    const double r = (double)value[c] - (double)model[c];
                    residual += r * r;
                    all += (double)value[c] * (double)value[c];
                }
            }
        }
    }
    for (int x = 0; x < width; x++)
        maps->errors.texels[(gsize)y * (gsize)width + (gsize)x] =
            compared[x] > 0 ? (float)(texels[x] / compared[x]) : NAN;
    g_mutex_lock(&run->mutex);
    for (int i = 0; i < n_pairs; i++) {
        run->sums[i] += sums[i];
        run->counts[i] += counts[i];
    }
    run->residual += residual;
    run->all += all;
    if (error && !run->error)
        run->error = g_steal_pointer(&error);
    g_mutex_unlock(&run->mutex);
}

gboolean maps_find_errors(struct maps *maps, const struct maps_register *of,
                          const struct work *work, GError **error) {
    const struct btf_matrix *btf = of->btf;
    const gsize n_pairs = btf->layout.views.n * btf->layout.lights.n;
    const gsize n = btf_layout_texels(&btf->layout);
    g_autofree float *views = direction_list_vectors(&btf->layout.views);
    g_autofree float *lights = direction_list_vectors(&btf->layout.lights);
    g_autofree double *sums = g_new0(double, n_pairs), *counts = g_new0(double, n_pairs);
    struct maps_errors_run run = {.maps = maps,
                                  .of = of,
                                  .btf = btf,
                                  .views = views,
                                  .lights = lights,
                                  .sums = sums,
                                  .counts = counts};
    struct maps_errors *errors = &maps->errors;
    errors->n_views = maps->n_views;
    errors->n_lights = maps->n_lights;
    errors->every = (int)MIN((n * n_pairs + MAX_COMPARED - 1) / MAX_COMPARED, n_pairs);
    errors->pairs = g_new0(float, n_pairs);
    errors->texels = g_new0(float, n);
    g_mutex_init(&run.mutex);
    const gboolean done = work_parallel(work, "errors", maps->height, maps_errors_row, &run, error);
    g_mutex_clear(&run.mutex);
    if (!done) {
        g_clear_error(&run.error);
        return FALSE;
    }
    if (run.error) {
        g_propagate_error(error, run.error);
        return FALSE;
    }
    for (gsize i = 0; i < n_pairs; i++) {
        errors->pairs[i] = counts[i] > 0 ? (float)(sums[i] / counts[i]) : NAN;
        run.delta_e += sums[i];
        run.n += counts[i];
    }
    errors->delta_e = run.n > 0 ? run.delta_e / run.n : 0;
    errors->relative_error = run.all > 0 ? sqrt(run.residual / run.all) : 0;
    return TRUE;
}
