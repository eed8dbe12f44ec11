#include "lpca_resample.h"

#include <cblas.h>
#include <math.h>
#include <string.h>

#include "base/data_error.h"
#include "base/direction.h"
#include "btf/direction_grid.h"

#define COLOURS 3
#define BLOCK   8 /* number of texels that a thread compares at a time */

/* Returns a copy whose brdfs have the size for the grid. brdfs is NULL if there is not enough
 * memory. */
static struct lpca *like(const struct lpca *lpca, int n_grid) {
    const gsize texels = btf_layout_texels(&lpca->layout);
    const gsize tables = (gsize)lpca->n_clusters * (gsize)(lpca->n_components + 1);
    struct lpca *ret = g_new0(struct lpca, 1);
    *ret = *lpca;
    ret->name = g_strdup(lpca->name);
    ret->n_grid = n_grid;
    ret->layout.views = direction_grid_samples(n_grid);
    ret->layout.lights = direction_grid_samples(n_grid);
    ret->clusters = g_memdup2(lpca->clusters, sizeof(int) * texels);
    ret->weights = g_memdup2(lpca->weights, sizeof(float) * texels * (gsize)lpca->n_components);
    ret->scales = g_memdup2(lpca->scales, sizeof(float) * tables);
    ret->weight_scales = g_memdup2(lpca->weight_scales, sizeof(float) * (gsize)lpca->n_clusters *
                                                            (gsize)lpca->n_components);
    ret->light_scales = NULL;
    ret->packed = NULL;
    ret->brdfs = g_try_new(float, tables *btf_layout_values(&ret->layout));
    ret->error = 0;
    return ret;
}

/* Converts a table E (views × lights × 3) to V E Lᵀ (n² × n² × 3) with the operators V (n² × views)
 * and L (n² × lights). Converts the views first, then the lights of each view. The colours of a
 * light are adjacent. */
static void resample_table(const struct lpca *from, const struct lpca *to, gsize table,
                           const float *views, const float *lights, float *between) {
    const int samples = to->layout.views.n, row = from->layout.lights.n * COLOURS;
    const float *values = from->brdfs + table * from->layout.views.n * (gsize)row;
    float *ret = to->brdfs + table * (gsize)samples * (gsize)samples * COLOURS;
    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, samples, row, from->layout.views.n, 1,
                views, from->layout.views.n, values, row, 0, between, row);
    for (gsize i = 0; i < (gsize)samples; i++)
        cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, samples, COLOURS,
                    from->layout.lights.n, 1, lights, from->layout.lights.n,
                    between + i * (gsize)row, COLOURS, 0, ret + i * (gsize)samples * COLOURS,
                    COLOURS);
}

struct lpca *lpca_resample(const struct lpca *lpca, int n_grid, GError **error) {
    g_return_val_if_fail(
        lpca->quantise == LPCA_FLOAT && lpca->n_grid == 0 && lpca->colours == LPCA_RGB, NULL);
    g_autofree float *views = direction_grid_operator(&lpca->layout.views, n_grid, FALSE, error);
    g_autofree float *lights =
        views ? direction_grid_operator(&lpca->layout.lights, n_grid, TRUE, error) : NULL;
    if (!lights)
        return NULL;
    g_autoptr(Lpca) ret = like(lpca, n_grid);
    if (!ret->brdfs) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "a grid of %d for %d clusters of %d components does not fit into memory; give "
                    "a coarser grid, or fewer clusters or components",
                    n_grid, lpca->n_clusters, lpca->n_components);
        return NULL;
    }
    g_autofree float *between = g_new(float, ret->layout.views.n * lpca->layout.lights.n * COLOURS);
    for (gsize table = 0; table < (gsize)lpca->n_clusters * (gsize)(lpca->n_components + 1);
         table++)
        resample_table(lpca, ret, table, views, lights, between);
    return g_steal_pointer(&ret);
}

/* A comparison of a local PCA on a grid with btf, at the directions of btf. A texel is first
 * reconstructed on the whole grid, which costs least, and then interpolated. */
struct comparison {
    const struct lpca *lpca;
    const struct btf_matrix *btf;
    int *view_index, *light_index;     /* views × 4, lights × 4: samples around each direction */
    float *view_weight, *light_weight; /* weights of these samples */
    double *sums;                      /* two per block: ‖X − X̂‖² and ‖X‖² */
};

/* Gives the four samples around each of n directions and their weights, n × 4 each. */
static void fill_weights(int n_grid, const float *theta_deg, const float *phi_deg, int n,
                         int **ret_index, float **ret_weight) {
    *ret_index = g_new(int, 4 * n);
    *ret_weight = g_new(float, 4 * n);
    for (int i = 0; i < n; i++) {
        float direction[3];
        direction_from_deg(theta_deg[i], phi_deg[i], direction);
        direction_grid_weights(n_grid, direction, *ret_index + (gsize)(4 * i),
                               *ret_weight + (gsize)(4 * i));
    }
}

/* Computes Σ_a Σ_b v_a l_b G(a, b) of the grid G. a are the four samples around the view, with the
 * weights v_a. b are the four samples around the light, with the weights l_b. */
static void interpolate(const struct comparison *to, const float *grid, int view, int light,
                        float ret[COLOURS]) {
    const gsize samples = to->lpca->layout.lights.n;
    memset(ret, 0, sizeof(float) * COLOURS);
    for (int a = 0; a < 4; a++)
        for (int b = 0; b < 4; b++) {
            const float weight = to->view_weight[4 * view + a] * to->light_weight[4 * light + b];
            const float *at = grid + ((gsize)to->view_index[4 * view + a] * samples +
                                      (gsize)to->light_index[4 * light + b]) *
                                         COLOURS;
            for (int c = 0; c < COLOURS; c++)
                ret[c] += weight * at[c];
        }
}

/* Adds the squared errors of a texel in one view to sums[0], and its squared values to sums[1].
 * grid is n² × n² × 3, truth is lights × 3. */
static void compare_view(const struct comparison *to, const float *grid, const float *truth,
                         int view, double *sums) {
    for (gsize light = 0; light < to->btf->layout.lights.n; light++, truth += COLOURS) {
        float value[COLOURS];
        interpolate(to, grid, view, light, value);
        for (int c = 0; c < COLOURS; c++) {
            const double rest = (double)truth[c] - value[c];
            sums[0] += rest * rest;
            sums[1] += (double)truth[c] * truth[c];
        }
    }
}

static void compare_block(int block, gpointer data) {
    const struct comparison *to = data;
    const struct btf_matrix *btf = to->btf;
    const int end = MIN((block + 1) * BLOCK, btf_layout_texels(&btf->layout));
    double *sums = to->sums + (gsize)(2 * block);
    g_autofree float *grid = g_new(float, btf_layout_values(&to->lpca->layout));
    g_autofree float *buffer = g_new(float, btf->layout.lights.n *COLOURS);
    for (int texel = block * BLOCK; texel < end; texel++) {
        lpca_reconstruct(to->lpca, texel, grid);
        for (gsize view = 0; view < btf->layout.views.n; view++) {
            gsize stride;
            const float *truth = btf_matrix_rows(btf, view, texel, 1, buffer, &stride, NULL);
            if (truth)
                compare_view(to, grid, truth, view, sums);
            else
                sums[0] = NAN;
        }
    }
}

double lpca_resample_error(struct lpca *resampled, const struct btf_matrix *btf, int n_threads) {
    const struct work work = {.n_threads = n_threads};
    const int blocks = (btf_layout_texels(&btf->layout) + BLOCK - 1) / BLOCK;
    struct comparison to = {.lpca = resampled, .btf = btf, .sums = g_new0(double, 2 * blocks)};
    double rest = 0, all = 0;
    g_return_val_if_fail(resampled->n_grid > 0 && resampled->layout.width == btf->layout.width &&
                             resampled->layout.height == btf->layout.height,
                         NAN);
    fill_weights(resampled->n_grid, btf->layout.views.theta_deg, btf->layout.views.phi_deg,
                 btf->layout.views.n, &to.view_index, &to.view_weight);
    fill_weights(resampled->n_grid, btf->layout.lights.theta_deg, btf->layout.lights.phi_deg,
                 btf->layout.lights.n, &to.light_index, &to.light_weight);
    work_parallel(&work, "", blocks, compare_block, &to, NULL);
    for (int i = 0; i < blocks; i++) {
        rest += to.sums[2 * i];
        all += to.sums[2 * i + 1];
    }
    g_free(to.view_index);
    g_free(to.view_weight);
    g_free(to.light_index);
    g_free(to.light_weight);
    g_free(to.sums);
    resampled->error = all > 0 || isnan(rest) ? sqrt(rest / all) : 0;
    return resampled->error;
}
