/* The texels of a tile share their weights. If the model has planes, the texels of a tile are first
 * replaced by their principal components. */
#include "relighting_private.h"

#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <string.h>

#include "base/data_error.h"
#include "base/srgb.h"

#define DISTANT_TILE 16 /* side of a tile in texels, if all texels have the same directions */

static const double sigmas[] = {0.1, 0.125, 0.16, 0.2, 0.25, 0.32, 0.4, 0.5, 0.7};

/* The principal components of Y without one light, in planes rows of 3 n values. */
struct components {
    double *vectors; /* planes × 3 n, orthonormal rows; the three columns of the light are 0 */
};

struct leaving {
    struct relighting_fit fit;
    /* tile: side of a tile in texels
     * columns: number of tiles in a row */
    int tile, columns;
    double *mean; /* 3 n: mean of Y over the texels; all 0 if the model has no planes */
    /* one element for each light that is left out; NULL if the model has no planes */
    struct components *components;
    float *pictures; /* the result */
    /* −2 if the weights of all tiles were determined, otherwise *ret_light of
     * relighting_weights() */
    int failed_light;
};

char *relighting_model_name(const struct relighting_model *model) {
    static const char *const names[] = {"ptm", "hsh", "rbf", "kriging"};
    const int number = model->basis == RELIGHTING_HSH ? model->n_terms : model->planes;
    return number > 0 ? g_strdup_printf("%s%d", names[model->basis], number)
                      : g_strdup(names[model->basis]);
}

int relighting_model_numbers(const struct relighting_model *model, int n_lights) {
    return model->basis == RELIGHTING_PTM   ? 3 * 6
           : model->basis == RELIGHTING_HSH ? 3 * model->n_terms
           : model->planes > 0              ? model->planes
                                            : 3 * n_lights;
}

static struct vec3 light_of(const struct relighting_fit *fit, int light, int texel) {
    const Relighting *r = fit->relighting;
    return fit->model->near ? near_field_light(r->near, r->view, r->lights[light], texel)
                            : near_field_light_centre(r->near, r->view, r->lights[light]);
}

static struct vec3 view_of(const struct relighting_fit *fit, int texel) {
    const Relighting *r = fit->relighting;
    return fit->model->near ? near_field_view(r->near, r->view, texel)
                            : near_field_view_centre(r->near, r->view);
}

/* Returns the position of a lamp. */
static const struct vec3 *lamp_of(const Relighting *r, int light) {
    return &r->near->lamp_mm[(gsize)r->view * r->near->lights.n + (gsize)r->lights[light]];
}

static double fall_off(const struct relighting_fit *fit, int light, int texel) {
    const Relighting *r = fit->relighting;
    return near_field_fall_off(r->near, r->view, r->lights[light], texel);
}

/* Computes Y of a texel: n × 3. */
static void values_of(const struct relighting_fit *fit, int texel, double *ret) {
    const Relighting *r = fit->relighting;
    const gsize texels = (gsize)r->width * (gsize)r->height;
    for (int i = 0; i < r->n_lights; i++) {
        const float *from = r->values + 3 * ((gsize)i * texels + (gsize)texel);
        const double factor = fit->model->near ? 1 : fall_off(fit, i, texel);
        for (int c = 0; c < 3; c++) {
            const double y = fmax((double)from[c], 0) * factor;
            ret[3 * i + c] = fit->model->linear ? y : srgb_encode(y);
        }
    }
}

/* Computes P of light j from its predicted Y. */
static void picture_of(const struct relighting_fit *fit, int j, int texel, const double y[3],
                       float ret[3]) {
    const double factor = fit->model->near ? fall_off(fit, j, texel) : 1;
    for (int c = 0; c < 3; c++) {
        const double linear = fit->model->linear ? y[c] : srgb_decode(y[c]);
        ret[c] = (float)fmax(linear * factor, 0);
    }
}

/* Computes Ŷ_j = Σ_i w_ij Y_i of a texel. Y is n × 3. g is n × 3 for kriging, and NULL
 * otherwise. */
static void predict(const double *weights, int n, int j, const double *y, const double *g,
                    double ret[3]) {
    const double *w = weights + (gsize)n * (gsize)j;
    ret[0] = ret[1] = ret[2] = 0;
    for (int i = 0; i < n; i++)
        for (int c = 0; c < 3; c++)
            ret[c] += g ? w[i] * y[3 * i + c] / g[3 * i + c] : w[i] * y[3 * i + c];
    for (int c = 0; g && c < 3; c++)
        ret[c] *= g[3 * j + c];
}

static void means_of(const struct relighting_fit *fit, int texel, double *ret) {
    const struct vec3 view = view_of(fit, texel);
    for (int i = 0; i < fit->relighting->n_lights; i++)
        prediction_mean_of(fit->prediction, view, light_of(fit, i, texel), ret + 3 * i);
}

static int probe(const Relighting *r, int i, int n) {
    return (int)((2 * i + 1) * (gint64)r->width * r->height / (2 * n));
}

static int n_probes(const Relighting *r) {
    return MIN(RELIGHTING_PROBES, r->width * r->height);
}

/* Returns the sum of squared errors of RBF with a σ, over all lights and probes. */
static double rbf_error(struct relighting_fit *fit, double sigma) {
    const int n = fit->relighting->n_lights, probes = n_probes(fit->relighting);
    g_autofree double *weights = g_new0(double, (gsize)n *(gsize)n), *y = g_new0(double, 3 * n);
    g_autofree struct vec3 *lights = g_new(struct vec3, n);
    double sum = 0;
    int ignored;
    fit->sigma = sigma;
    for (int p = 0; p < probes; p++) {
        const int texel = probe(fit->relighting, p, probes);
        for (int i = 0; i < n && (p == 0 || fit->model->near); i++)
            lights[i] = light_of(fit, i, texel);
        if (p == 0 || fit->model->near)
            relighting_weights(fit, view_of(fit, texel), lights, n, weights, &ignored);
        values_of(fit, texel, y);
        for (int j = 0; j < n; j++) {
            double predicted[3];
            predict(weights, n, j, y, NULL, predicted);
            for (int c = 0; c < 3; c++)
                sum += (predicted[c] - y[3 * j + c]) * (predicted[c] - y[3 * j + c]);
        }
    }
    return sum;
}

static void choose_sigma(struct relighting_fit *fit) {
    double best = INFINITY, chosen = sigmas[0];
    for (gsize k = 0; k < G_N_ELEMENTS(sigmas); k++) {
        const double error = rbf_error(fit, sigmas[k]);
        chosen = error < best ? sigmas[k] : chosen;
        best = fmin(best, error);
    }
    fit->sigma = chosen;
}

/* Fits the constants of kriging to the probes. */
static gboolean fit_prediction(struct relighting_fit *fit, const struct work *work,
                               GError **error) {
    const Relighting *r = fit->relighting;
    const int n = r->n_lights, probes = n_probes(r);
    const struct near_field *near = r->near;
    g_autofree struct vec3 *lights = g_new(struct vec3, n), *at_mm = g_new(struct vec3, probes);
    g_autofree struct vec3 *lamps = near->lamp_mm ? g_new(struct vec3, n) : NULL;
    g_autofree float *values = g_new(float, 3 * (gsize)n * (gsize)probes);
    g_autofree double *y = g_new0(double, 3 * n);
    const struct vec3 view = near_field_view_centre(near, r->view);
    for (int i = 0; i < n; i++) {
        lights[i] = near_field_light_centre(near, r->view, r->lights[i]);
        if (lamps)
            lamps[i] = *lamp_of(r, i);
    }
    for (int p = 0; p < probes; p++) {
        const int texel = probe(r, p, probes);
        at_mm[p] = near_field_texel_mm(near, texel);
        values_of(fit, texel, y);
        for (int i = 0; i < 3 * n; i++)
            values[(3 * (gsize)p + (gsize)(i % 3)) * (gsize)n + (gsize)(i / 3)] = (float)y[i];
    }
    const struct prediction_pairs pairs = {
        .n_views = 1,
        .n_lights = n,
        .views = &view,
        .lights = lights,
        .views_mm = fit->model->near && near->camera_mm ? &near->camera_mm[r->view] : NULL,
        .lights_mm = fit->model->near ? lamps : NULL};
    fit->prediction = prediction_new(&pairs, values, at_mm, probes, work, error);
    return fit->prediction != NULL;
}

/* Computes the mean (3 n) and the covariance (3 n × 3 n, upper triangle) of Y over the texels. The
 * arrays must be zeroed before. */
static void add_up(const struct relighting_fit *fit, double *mean, double *covariance) {
    const int m = 3 * fit->relighting->n_lights;
    const int texels = fit->relighting->width * fit->relighting->height;
    const int block = 256;
    g_autofree double *y = g_new0(double, (gsize)block *(gsize)m);
    for (int first = 0; first < texels; first += block) {
        const int count = MIN(block, texels - first);
        for (int t = 0; t < count; t++) {
            values_of(fit, first + t, y + (gsize)t * (gsize)m);
            for (int i = 0; i < m; i++)
                mean[i] += y[(gsize)t * (gsize)m + (gsize)i] / texels;
        }
        cblas_dsyrk(CblasRowMajor, CblasUpper, CblasTrans, m, count, 1.0 / texels, y, m, 1,
                    covariance, m);
    }
    for (int i = 0; i < m; i++)
        for (int k = i; k < m; k++)
            covariance[i * m + k] -= mean[i] * mean[k];
}

struct component_job {
    struct leaving *leaving;
    const double *covariance; /* 3 n × 3 n, upper triangle */
};

/* Finds the components without light j, from the covariance without its rows and columns. */
static void find_components(int j, gpointer data) {
    const struct component_job *job = data;
    const int n = job->leaving->fit.relighting->n_lights, m = 3 * n, left = m - 3;
    const int planes = MIN(job->leaving->fit.model->planes, left);
    struct components *to = &job->leaving->components[j];
    g_autofree double *c = g_new(double, (gsize)left *(gsize)left);
    g_autofree double *values = g_new(double, left);
    g_autofree double *vectors = g_new(double, (gsize)left *(gsize)planes);
    g_autofree int *support = g_new(int, 2 * (gsize)left);
    int found = 0;
    work_use_one_blas_thread();
    for (int i = 0; i < left; i++)
        for (int k = i; k < left; k++)
            c[i * left + k] =
                job->covariance[(i < 3 * j ? i : i + 3) * m + (k < 3 * j ? k : k + 3)];
    LAPACKE_dsyevr(LAPACK_ROW_MAJOR, 'V', 'I', 'U', left, c, left, 0, 0, left - planes + 1, left, 0,
                   &found, values, vectors, planes, support);
    to->vectors = g_new0(double, (gsize)job->leaving->fit.model->planes *(gsize)m);
    for (int p = 0; p < found; p++)
        for (int i = 0; i < left; i++)
            to->vectors[p * m + (i < 3 * j ? i : i + 3)] = vectors[i * planes + p];
}

/* Replaces Y (count × 3 n) by mean + (Y − mean) Vᵀ V, where V are the components without light
 * j. */
static void project(const struct leaving *leaving, int j, const double *y, int count, double *ret) {
    const int m = 3 * leaving->fit.relighting->n_lights, planes = leaving->fit.model->planes;
    const double *v = leaving->components[j].vectors;
    g_autofree double *c = g_new(double, (gsize)count *(gsize)planes);
    for (int i = 0; i < count * m; i++)
        ret[i] = y[i] - leaving->mean[i % m];
    cblas_dgemm(CblasRowMajor, CblasNoTrans, CblasTrans, count, planes, m, 1, ret, m, v, m, 0, c,
                planes);
    for (int i = 0; i < count * m; i++)
        ret[i] = leaving->mean[i % m];
    cblas_dgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, count, m, planes, 1, c, planes, v, m, 1,
                ret, m);
}

static void do_tile(int number, gpointer data) {
    struct leaving *leaving = data;
    const struct relighting_fit *fit = &leaving->fit;
    const Relighting *r = fit->relighting;
    const int n = r->n_lights, side = leaving->tile;
    const gsize m = 3 * (gsize)n, texels = (gsize)r->width * (gsize)r->height;
    const int left = number % leaving->columns * side, top = number / leaving->columns * side;
    const int width = MIN(side, r->width - left), height = MIN(side, r->height - top);
    const int centre = (top + height / 2) * r->width + left + width / 2, count = width * height;
    const gboolean krige = fit->model->basis == RELIGHTING_KRIGING;
    g_autofree double *weights = g_new0(double, (gsize)n *(gsize)n);
    g_autofree double *y = g_new0(double, m *(gsize)count), *z = g_new0(double, m *(gsize)count);
    g_autofree double *g = krige ? g_new0(double, m *(gsize)count) : NULL;
    g_autofree struct vec3 *lights = g_new(struct vec3, n);
    g_autofree int *at = g_new(int, count);
    int light;
    work_use_one_blas_thread();
    for (int i = 0; i < n; i++)
        lights[i] = light_of(fit, i, centre);
    if (!relighting_weights(fit, view_of(fit, centre), lights, n, weights, &light)) {
        g_atomic_int_compare_and_exchange(&leaving->failed_light, -2, light);
        return;
    }
    for (int t = 0; t < count; t++) {
        at[t] = (top + t / width) * r->width + left + t % width;
        values_of(fit, at[t], y + m * (gsize)t);
        if (krige)
            means_of(fit, at[t], g + m * (gsize)t);
    }
    for (int j = 0; j < n; j++) {
        if (leaving->components)
            project(leaving, j, y, count, z);
        for (int t = 0; t < count; t++) {
            double predicted[3];
            predict(weights, n, j, (leaving->components ? z : y) + m * (gsize)t,
                    krige ? g + m * (gsize)t : NULL, predicted);
            picture_of(fit, j, at[t], predicted,
                       leaving->pictures + 3 * ((gsize)j * texels + (gsize)at[t]));
        }
    }
}

/* Returns the side of tiles in texels. No texel of a tile is farther from the tile's centre than d,
 * half the diagonal of the tile. Between the centre and this texel, the direction to a lamp at the
 * distance r differs by at most d / r. */
static int tile_side(const struct relighting_fit *fit) {
    const Relighting *r = fit->relighting;
    const struct near_field *near = r->near;
    double nearest_mm = INFINITY;
    if (!fit->model->near || !near->lamp_mm)
        return DISTANT_TILE;
    const int corners[] = {0, r->width - 1, (r->height - 1) * r->width, r->height * r->width - 1,
                           r->height / 2 * r->width + r->width / 2};
    for (int i = 0; i < r->n_lights; i++)
        for (gsize k = 0; k < G_N_ELEMENTS(corners); k++)
            nearest_mm =
                fmin(nearest_mm,
                     vec3_length(vec3_sub(*lamp_of(r, i), near_field_texel_mm(near, corners[k]))));
    const double most_mm = RELIGHTING_TILE_DEG * G_PI / 180 * nearest_mm;
    return CLAMP((int)(most_mm * sqrt(2) * r->width / near->grid.width_mm), 1, DISTANT_TILE);
}

static void find_all_components(struct leaving *leaving) {
    const gsize m = 3 * (gsize)leaving->fit.relighting->n_lights;
    g_autofree double *covariance = g_new0(double, m *m);
    leaving->mean = g_new0(double, m);
    leaving->components = g_new0(struct components, leaving->fit.relighting->n_lights);
    add_up(&leaving->fit, leaving->mean, covariance);
    struct component_job job = {leaving, covariance};
    work_for_each(0, leaving->fit.relighting->n_lights, find_components, &job);
}

static gboolean fail(const struct leaving *leaving, GError **error) {
    g_autofree char *name = relighting_model_name(leaving->fit.model);
    if (leaving->failed_light >= 0)
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "%s: without light %d, counted from 0, the other lights do not determine all "
                    "terms; use a basis "
                    "of fewer terms",
                    name, leaving->fit.relighting->lights[leaving->failed_light]);
    else
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "%s: the %d lights do not determine all terms; use a basis of fewer terms",
                    name, leaving->fit.relighting->n_lights);
    return FALSE;
}

gboolean relighting_leave_out(const Relighting *relighting, const struct relighting_model *model,
                              const struct work *work, float *ret_pictures, double *ret_sigma,
                              GError **error) {
    struct leaving leaving = {.fit = {.relighting = relighting, .model = model},
                              .pictures = ret_pictures,
                              .failed_light = -2};
    leaving.fit.sigma = model->sigma;
    if (model->basis == RELIGHTING_RBF && model->sigma == 0)
        choose_sigma(&leaving.fit);
    gboolean ok = model->basis != RELIGHTING_KRIGING || fit_prediction(&leaving.fit, work, error);
    if (ok && model->planes > 0 && model->basis >= RELIGHTING_RBF)
        find_all_components(&leaving);
    if (ok) {
        leaving.tile = tile_side(&leaving.fit);
        leaving.columns = (relighting->width + leaving.tile - 1) / leaving.tile;
        const int rows = (relighting->height + leaving.tile - 1) / leaving.tile;
        ok = work_parallel(work, "relighting", leaving.columns * rows, do_tile, &leaving, error) &&
             (leaving.failed_light == -2 || fail(&leaving, error));
    }
    if (ret_sigma)
        *ret_sigma = leaving.fit.sigma;
    for (int j = 0; leaving.components && j < relighting->n_lights; j++)
        g_free(leaving.components[j].vectors);
    g_free(leaving.components);
    g_free(leaving.mean);
    prediction_free(leaving.fit.prediction);
    return ok;
}
