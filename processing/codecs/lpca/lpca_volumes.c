#include "lpca_volumes.h"

#include "lpca_resample.h"

#include <math.h>
#include <string.h>

#define STEPS 127

struct lpca *lpca_volumes_on_grid(const struct lpca *lpca, int n_grid, GError **error) {
    const gsize tables = (gsize)lpca->n_clusters * (lpca->n_components + 1);
    g_autofree struct lpca *floats = g_memdup2(lpca, sizeof *lpca);
    floats->quantise = LPCA_FLOAT; /* in memory, all local PCAs have floats */
    /* The weights are not needed here. lpca_resample() must not copy them, because the local PCA of
     * all mip levels together has fewer weights than its numbers of clusters and components
     * imply. */
    floats->weights = floats->weight_scales = NULL;
    if (lpca->n_grid == 0)
        return lpca_resample(floats, n_grid, error);
    floats->name = NULL;
    floats->layout.views.theta_deg = floats->layout.views.phi_deg = NULL;
    floats->layout.lights.theta_deg = floats->layout.lights.phi_deg = NULL;
    floats->clusters = NULL;
    floats->light_scales = NULL;
    floats->scales = g_memdup2(lpca->scales, sizeof(float) * tables);
    floats->brdfs = g_memdup2(lpca->brdfs, sizeof(float) * 3 * tables * lpca->layout.views.n *
                                               lpca->layout.lights.n);
    return g_steal_pointer(&floats);
}

void lpca_volumes_block(int n, const float *values, float *ret) {
    const int samples = n * n;
    const double area = 2.0 / ((n - 1) * (n - 1));
    float *sky = ret + 3 * (gsize)samples * samples;
    memset(sky, 0, sizeof(float) * 3 * samples);
    for (int light = 0; light < samples; light++) {
        const int i = light % n, j = light / n;
        const float share =
            (float)(area * (i == 0 || i == n - 1 ? 0.5 : 1) * (j == 0 || j == n - 1 ? 0.5 : 1));
        for (int view = 0; view < samples; view++)
            for (int c = 0; c < 3; c++) {
                const float value = values[3 * ((gsize)view * samples + light) + c];
                ret[3 * ((gsize)light * samples + view) + c] = value;
                sky[3 * view + c] += share * value;
            }
    }
}

float lpca_volumes_quantise(const float *values, gsize n, gint8 *ret_steps) {
    float largest = 0;
    for (gsize k = 0; k < n; k++)
        largest = fmaxf(largest, fabsf(values[k]));
    for (gsize k = 0; k < n; k++)
        ret_steps[k] = largest > 0 ? (gint8)lrintf(values[k] / largest * STEPS) : 0;
    return largest;
}
