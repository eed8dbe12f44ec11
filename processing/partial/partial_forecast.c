#include "partial_forecast.h"

#include <string.h>

#include "shared_exponent.h"

/* the model is fitted anew when the number of measured pairs has grown by this factor */
#define GROWTH  1.25
#define TARGETS 200 /* number of pairs from which the error after further shots is computed */
#define CELLS   8   /* g is computed at (CELLS + 1)² points of the grid, and interpolated */

struct PartialForecast {
    gint references;
    NearestPrediction *prediction;
    int n_measured;
    int n_fitted; /* number of pairs that were measured when the model was fitted */
    struct partial_later later[PARTIAL_LATER];
    int n_later;
};

/* Computes the error after 1/32, 1/8, 1/4, 1/2, 3/4 and all of the planned pairs. */
static void look_ahead(PartialForecast *forecast, const struct partial_sample *sample) {
    static const double shares[PARTIAL_LATER] = {1.0 / 32, 0.125, 0.25, 0.5, 0.75, 1};
    const int n_pairs = sample->pairs->n_views * sample->pairs->n_lights;
    g_autofree gboolean *more = g_new0(gboolean, n_pairs);
    int taken = 0;
    for (int i = 0; i < PARTIAL_LATER; i++) {
        const int n = (int)(shares[i] * sample->n_planned);
        if (n <= taken)
            continue;
        for (; taken < n; taken++)
            more[sample->planned[taken]] = TRUE;
        forecast->later[forecast->n_later++] = (struct partial_later){
            sample->shots[n - 1],
            nearest_prediction_error_after(forecast->prediction, more, TARGETS)};
    }
}

PartialForecast *partial_forecast_new(const struct partial_sample *sample,
                                      const PartialForecast *like, const struct work *work,
                                      GError **error) {
    const gboolean same = like && sample->n_measured < GROWTH * like->n_fitted;
    g_autoptr(NearestPrediction) prediction =
        nearest_prediction_new(sample->pairs, sample->values, sample->at_mm, sample->n_probes,
                               same ? like->prediction : NULL, work, error);
    if (!prediction)
        return NULL;
    PartialForecast *forecast = g_new0(PartialForecast, 1);
    forecast->references = 1;
    forecast->prediction = g_steal_pointer(&prediction);
    forecast->n_measured = sample->n_measured;
    forecast->n_fitted = same ? like->n_fitted : sample->n_measured;
    look_ahead(forecast, sample);
    return forecast;
}

PartialForecast *partial_forecast_ref(PartialForecast *forecast) {
    g_atomic_int_inc(&forecast->references);
    return forecast;
}

void partial_forecast_unref(PartialForecast *forecast) {
    if (!forecast || !g_atomic_int_dec_and_test(&forecast->references))
        return;
    nearest_prediction_free(forecast->prediction);
    g_free(forecast);
}

int partial_forecast_n_measured(const PartialForecast *forecast) {
    return forecast->n_measured;
}

double partial_forecast_error(const PartialForecast *forecast) {
    return nearest_prediction_error(forecast->prediction);
}

void partial_forecast_error_range(const PartialForecast *forecast, double ret[2]) {
    nearest_prediction_error_range(forecast->prediction, ret);
}

double partial_forecast_pair_error(const PartialForecast *forecast, int pair) {
    return nearest_prediction_pair_error(forecast->prediction, pair);
}

const struct partial_later *partial_forecast_later(const PartialForecast *forecast, int *ret_n) {
    *ret_n = forecast->n_later;
    return forecast->later;
}

/* g of a pair at the points of the grid: (CELLS + 1)² × 3. */
typedef float nodes[CELLS + 1][CELLS + 1][3];

static void find_nodes(const PartialForecast *forecast, const Partial *partial, int pair,
                       nodes ret) {
    const struct session_grid *grid = partial_grid(partial);
    for (int j = 0; j <= CELLS; j++)
        for (int i = 0; i <= CELLS; i++) {
            double g[3];
            nearest_prediction_mean(forecast->prediction,
                                    partial_point_mm(partial, (double)i * grid->width / CELLS - 0.5,
                                                     (double)j * grid->height / CELLS - 0.5),
                                    pair, g);
            for (int c = 0; c < 3; c++)
                ret[j][i][c] = (float)g[c];
        }
}

/* Adds weight · factor · picture to sum (n_texels × 3). factor is interpolated between its nodes.
 */
static void add(const struct session_grid *grid, const guint32 *picture, float weight,
                const nodes factor, float *sum) {
    for (int y = 0; y < grid->height; y++) {
        const float v = ((float)y + 0.5f) * CELLS / (float)grid->height;
        const int j = MIN((int)v, CELLS - 1);
        float row[CELLS + 1][3];
        for (int i = 0; i <= CELLS; i++)
            for (int c = 0; c < 3; c++)
                row[i][c] = weight * (factor[j][i][c] +
                                      (v - (float)j) * (factor[j + 1][i][c] - factor[j][i][c]));
        for (int x = 0; x < grid->width; x++, picture++, sum += 3) {
            const float u = ((float)x + 0.5f) * CELLS / (float)grid->width;
            const int i = MIN((int)u, CELLS - 1);
            float rgb[3];
            shared_exponent_unpack(*picture, rgb);
            for (int c = 0; c < 3; c++)
                sum[c] += rgb[c] * (row[i][c] + (u - (float)i) * (row[i + 1][c] - row[i][c]));
        }
    }
}

GBytes *partial_forecast_picture(const PartialForecast *forecast, const Partial *partial,
                                 int pair) {
    const struct session_grid *grid = partial_grid(partial);
    const gsize n_texels = (gsize)grid->width * (gsize)grid->height;
    const int *pairs;
    const float *weights;
    const int n = nearest_prediction_weights(forecast->prediction, pair, &pairs, &weights);
    if (n == 0)
        return NULL;
    g_autofree float *sum = g_new0(float, 3 * n_texels);
    guint32 *texels = g_new(guint32, n_texels);
    nodes own, of, factor;
    find_nodes(forecast, partial, pair, own);
    for (int k = 0; k < n; k++) {
        find_nodes(forecast, partial, pairs[k], of);
        for (int j = 0; j <= CELLS; j++)
            for (int i = 0; i <= CELLS; i++)
                for (int c = 0; c < 3; c++)
                    factor[j][i][c] = own[j][i][c] / of[j][i][c];
        add(grid, g_bytes_get_data(partial_picture(partial, pairs[k]), NULL), weights[k], factor,
            sum);
    }
    for (gsize i = 0; i < n_texels; i++)
        texels[i] = shared_exponent_pack(sum + 3 * i); /* negative values become 0 */
    return g_bytes_new_take(texels, n_texels * sizeof *texels);
}
