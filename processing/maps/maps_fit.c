/* The mean of the texels is fitted first, beginning with many shapes. The fit of each texel begins
 * with the shape of the mean. */
#include "maps_fit_private.h"

#include <math.h>
#include <string.h>

#include "base/data_error.h"
#include "base/direction.h"

#define BLOCK  16   /* number of texels that a thread takes at a time */
#define SOME   96   /* number of texels with which the layers are chosen */
#define MEAN   1024 /* number of texels over which the mean is taken */
#define BETTER 0.95 /* a layer is used if it reduces the cost to at most this share */
/* minimum decrease of the mean cost of a texel by a layer; the cost is relative to Σ u² Y² */
#define WORTH       3e-4
#define STEPS       12 /* maximum number of steps of the first refinement */
#define STEPS_AGAIN 5  /* maximum number of steps of the second refinement, which has priors */
/* If the cost of a texel in the first refinement exceeds this factor times the mean cost, the
 * second refinement also tries the parameters of the cluster as a start. */
#define LARGE         1.2
#define STARTS        5   /* number of shapes with which the fit of a texel begins */
#define LAMBERT_LIMIT 0.7 /* minimum z of a normal from lambert() with which a fit begins */

struct maps_fit_run {
    const struct maps_register *of;
    const struct btf_matrix *btf; /* of->btf */
    const struct maps_pairs *pairs;
    struct maps_fit *fit;
    float mean[MAPS_SHAPE];
    /* 0: all texels are fitted; above 0: only the costs of every step-th texel are computed */
    int step;
    /* costs of the texels, and the mean of these costs; first those of the choice of layers, later
     * those of the first refinement */
    double *costs, mean_cost;
    /* parameters of all texels; NULL in the first fit */
    struct maps_parameters *parameters;
    struct maps_clusters *clusters;
    GMutex mutex;
    GError *error; /* the first error of reading */
};

void maps_fit_free(struct maps_fit *fit) {
    if (!fit)
        return;
    g_free(fit->texels);
    g_free(fit);
}

/* Gives the values of texels first … first + n − 1, pairs × 3 each. */
static gboolean rows(const struct maps_fit_run *run, gsize first, int n, float *rgb,
                     GError **error) {
    const struct btf_matrix *btf = run->btf;
    const gsize row = btf->layout.lights.n * 3, n_lights = btf->layout.lights.n;
    g_autofree float *buffer = g_new(float, row *(gsize)n);
    const float *from = NULL;
    gsize stride = 0;
    int view = -1;
    for (int i = 0; i < run->pairs->n; i++) {
        const int index = run->pairs->index[i];
        if (!from || index / (int)n_lights != view) {
            view = index / (int)n_lights;
            from = maps_register_rows(run->of, view, (int)first, n, buffer, &stride, error);
            if (!from)
                return FALSE;
        }
        for (int t = 0; t < n; t++)
            memcpy(rgb + ((gsize)t * (gsize)run->pairs->n + (gsize)i) * 3,
                   from + (gsize)t * stride + (gsize)index % n_lights * 3, sizeof(float) * 3);
    }
    return TRUE;
}

/* Gives x and y of the normal b / |b| by Lambert's law, min Σ (Y − b·l)². Gives 0, 0 if the normal
 * is not determined or is steeper than LAMBERT_LIMIT. */
static void lambert(const struct maps_pairs *pairs, const float *rgb, float ret[2]) {
    double a[3][3] = {{0}}, b[3] = {0};
    for (int i = 0; i < pairs->n; i++) {
        const float y = rgb_luminance(rgb + 3 * (gsize)i);
        const double l[3] = {pairs->planes[MAPS_LX][i], pairs->planes[MAPS_LY][i],
                             pairs->planes[MAPS_LZ][i]};
        for (int j = 0; j < 3 && isfinite(y); j++) {
            b[j] += (double)y * l[j];
            for (int k = 0; k < 3; k++)
                a[j][k] += l[j] * l[k];
        }
    }
    double minors[3][3], determinant = 0, x[3] = {0};
    for (int j = 0; j < 3; j++)
        for (int k = 0; k < 3; k++) {
            const int j1 = (j + 1) % 3, j2 = (j + 2) % 3, k1 = (k + 1) % 3, k2 = (k + 2) % 3;
            minors[j][k] = a[j1][k1] * a[j2][k2] - a[j1][k2] * a[j2][k1];
        }
    for (int k = 0; k < 3; k++)
        determinant += a[0][k] * minors[0][k];
    for (int j = 0; j < 3; j++)
        for (int k = 0; k < 3; k++)
            x[j] += minors[j][k] * b[k];
    const double length = sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]);
    const gboolean known = fabs(determinant) > 1e-6 && length > 0 && x[2] / length > LAMBERT_LIMIT;
    for (int k = 0; k < 2; k++)
        ret[k] = known ? (float)(x[k] / length) : 0;
}

static void dark(struct maps_texel *ret) {
    *ret = (struct maps_texel){.roughness = 1,
                               .specular = 1,
                               .specular_colour = {1, 1, 1},
                               .direction = {1, 0},
                               .normal = {0, 0, 1}};
}

/* Replaces the metal in the parameters by a dielectric with the same lobes. Such a dielectric
 * exists, because its specular colour can be that of the metal's lobe. */
static void make_dielectric(struct maps_parameters *x) {
    const float m = x->x[MAPS_REFINE_METALLIC], w = x->x[MAPS_SHAPE - 1];
    const float all = (1 - m) * w + m;
    float before = 0, after = 0;
    for (int c = 0; c < 3; c++) {
        float *f = &x->x[MAPS_REFINE_F0 + c];
        before = MAX(before, *f);
        *f = ((1 - m) * w * *f + m * x->x[MAPS_REFINE_BASE + c]) / all;
        after = MAX(after, *f);
    }
    for (int c = 0; c < 3; c++)
        x->x[MAPS_REFINE_BASE + c] *= (1 - m) * (1 - w * before) / MAX(1 - all * after, 0.1F);
    x->x[MAPS_SHAPE - 1] = all;
    x->x[MAPS_REFINE_METALLIC] = 0;
}

/* Returns the parameters that the refinement of a texel may change, as bits. */
static guint moving(const struct maps_fit_run *run, gboolean metal) {
    const guint shape = (1U << (MAPS_SHAPE - 1)) - 1, base = 7U << MAPS_REFINE_BASE;
    if (run->pairs->model == MAPS_MODEL_CORE)
        return 7U | base | 1U << MAPS_REFINE_METALLIC;
    return metal ? shape | base : (1U << MAPS_REFINE_METALLIC) - 1;
}

static void store(const struct maps_fit_run *run, const struct maps_parameters *x,
                  struct maps_texel *ret) {
    maps_parameters_store(x, ret);
    /* these texels have exactly 1, which stands for a file without the extension */
    for (int c = 0; c < 3; c++)
        if (run->pairs->model == MAPS_MODEL_CORE || ret->metallic >= 1)
            ret->specular_colour[c] = 1;
}

/* Refines a texel without priors. */
static void refine(struct maps_fit_run *run, struct maps_refiner *refiner, const float *rgb,
                   gsize texel) {
    static const struct maps_refine_prior none = {0};
    struct maps_parameters x = maps_parameters_of(&run->fit->texels[texel]);
    if (!maps_refiner_take(refiner, rgb, &run->fit->texels[texel], TRUE))
        return;
    if (run->pairs->model == MAPS_MODEL_FULL)
        make_dielectric(&x);
    run->costs[texel] = maps_refiner_run(refiner, &none, moving(run, FALSE), STEPS, &x);
    store(run, &x, &run->fit->texels[texel]);
}

/* Refines a texel with the prior of its cluster and of the texels around it. */
static void refine_again(struct maps_fit_run *run, struct maps_refiner *refiner, const float *rgb,
                         gsize texel) {
    const int width = (int)run->btf->layout.width, height = (int)run->btf->layout.height;
    const gboolean metal = run->clusters->metal[run->clusters->labels[texel]];
    const struct maps_refine_prior prior =
        maps_clusters_prior(run->clusters, run->parameters, width, height, (int)texel);
    struct maps_parameters own = run->parameters[texel], usual = prior.mean;
    /* A texel without light has no costs. */
    if (run->costs[texel] <= 0 || !maps_refiner_take(refiner, rgb, &run->fit->texels[texel], FALSE))
        return;
    const guint bits = moving(run, metal);
    const double cost = maps_refiner_run(refiner, &prior, bits, STEPS_AGAIN, &own);
    if (run->costs[texel] > LARGE * run->mean_cost) {
        memcpy(usual.x, own.x, sizeof(float) * 2); /* the normal */
        memcpy(usual.x + MAPS_REFINE_BASE, own.x + MAPS_REFINE_BASE, sizeof(float) * 3);
        if (maps_refiner_run(refiner, &prior, bits, STEPS, &usual) < cost)
            own = usual;
    }
    store(run, &own, &run->fit->texels[texel]);
}

static void maps_fit_texel(struct maps_fit_run *run, struct maps_solver *solver,
                           struct maps_refiner *refiner, const float *rgb, gsize texel) {
    float starts[STARTS][MAPS_SHAPE];
    struct maps_solution solution = {0};
    if (run->clusters) {
        refine_again(run, refiner, rgb, texel);
        return;
    }
    for (int k = 0; k < STARTS; k++)
        memcpy(starts[k], run->mean, sizeof starts[k]);
    lambert(run->pairs, rgb, starts[1]);
    starts[2][2] -= 1;
    starts[3][2] += 1;
    memcpy(starts[4], starts[1], sizeof(float) * 2);
    starts[4][2] -= 1;
    if (!maps_solver_run(solver, rgb, starts, STARTS, &solution)) {
        if (!run->step)
            dark(&run->fit->texels[texel]);
        return;
    }
    if (run->step)
        run->costs[texel / (gsize)run->step] = solution.cost;
    else {
        maps_solver_colours(solver, rgb, &run->fit->layers, &solution, &run->fit->texels[texel]);
        refine(run, refiner, rgb, texel);
    }
}

static void maps_fit_block(int block, gpointer data) {
    struct maps_fit_run *run = data;
    const gsize n = btf_layout_texels(&run->btf->layout);
    const gsize size = (gsize)run->pairs->n * 3;
    const gsize first = (gsize)block * (gsize)(run->step ? run->step : BLOCK);
    const int count = run->step ? 1 : (int)MIN(BLOCK, n - first);
    g_autofree float *rgb = g_new(float, size *(gsize)count);
    g_autoptr(GError) error = NULL;
    if (!rows(run, first, count, rgb, &error)) {
        g_mutex_lock(&run->mutex);
        if (!run->error)
            run->error = g_steal_pointer(&error);
        g_mutex_unlock(&run->mutex);
        return;
    }
    struct maps_solver *solver = maps_solver_new(run->pairs);
    struct maps_refiner *refiner = maps_refiner_new(run->pairs, &run->fit->layers);
    for (int t = 0; t < count; t++)
        maps_fit_texel(run, solver, refiner, rgb + (gsize)t * size, first + (gsize)t);
    maps_solver_free(solver);
    maps_refiner_free(refiner);
}

static gboolean blocks(struct maps_fit_run *run, const struct work *work, int n, GError **error) {
    if (!work_parallel(work,
                       run->step       ? "layers"
                       : run->clusters ? "refine"
                                       : "fit",
                       n, maps_fit_block, run, error))
        return FALSE;
    if (!run->error)
        return TRUE;
    g_propagate_error(error, g_steal_pointer(&run->error));
    return FALSE;
}

/* Fits the mean of about MEAN texels, beginning with several shapes. The shape of the best result
 * becomes run->mean. */
static gboolean maps_fit_mean(struct maps_fit_run *run, GError **error) {
    static const float widths[] = {-4, -3, -2, -1.2F, -0.4F};
    static const float spreads[3][2] = {{0, 0}, {0.5F, 0}, {-0.5F, 0}};
    const gsize n = btf_layout_texels(&run->btf->layout), size = (gsize)run->pairs->n * 3;
    const gsize step = MAX(n / MEAN, 1);
    g_autofree float *rgb = g_new0(float, size), *mean = g_new0(float, size);
    g_autofree guint *counts = g_new0(guint, size);
    float starts[G_N_ELEMENTS(widths) * 6][MAPS_SHAPE] = {{0}};
    struct maps_solution solution = {0};
    for (gsize t = 0; t < n; t += step) {
        if (!rows(run, t, 1, rgb, error))
            return FALSE;
        for (gsize i = 0; i < size; i++)
            if (!isnan(rgb[i])) {
                mean[i] += rgb[i];
                counts[i]++;
            }
    }
    for (gsize i = 0; i < size; i++)
        mean[i] = counts[i] > 0 ? mean[i] / (float)counts[i] : NAN;
    for (gsize k = 0; k < G_N_ELEMENTS(starts); k++) {
        starts[k][2] = widths[k / 6];
        memcpy(starts[k] + 3, spreads[k % 3], sizeof spreads[0]);
        starts[k][5] = k % 6 < 3 ? 1 : 0.2F;
    }
    struct maps_solver *solver = maps_solver_new(run->pairs);
    const gboolean lit =
        maps_solver_run(solver, mean, starts, (int)G_N_ELEMENTS(starts), &solution);
    maps_solver_free(solver);
    if (!lit)
        return data_error_fail(
            run->btf->name ? run->btf->name : "BTF", 0, error,
            "all values of the BTF are 0 or missing, so that there is nothing to fit; see “mesorig "
            "info” and process or import the session again");
    memcpy(run->mean, solution.shape, sizeof run->mean);
    return TRUE;
}

/* Chooses the layers: fits about SOME texels without layers, with sheen and with clear coats of
 * some roughnesses, and keeps the layers with the smallest cost. A layer must reduce the cost
 * without layers as BETTER and WORTH require. */
static gboolean choose(struct maps_fit_run *run, struct maps_pairs *pairs, const struct work *work,
                       GError **error) {
    static const double layers[][2] = {{0, 0}, {0.35, 0}, {0.6, 0}, {0.9, 0}, {0, 0.15}, {0, 0.3}};
    const gsize n = btf_layout_texels(&run->btf->layout);
    double least = 0;
    run->step = (int)MAX(n / SOME, 1);
    const int some = (int)((n + (gsize)run->step - 1) / (gsize)run->step);
    run->costs = g_new(double, some);
    gboolean ok = TRUE;
    for (gsize k = 0; ok && k < G_N_ELEMENTS(layers); k++) {
        const struct maps_layers now = maps_layers_new(layers[k][0], layers[k][1]);
        double sum = 0;
        memset(run->costs, 0, sizeof(double) * (gsize)some);
        maps_pairs_set_layers(pairs, &now);
        ok = blocks(run, work, some, error);
        for (int i = 0; i < some; i++)
            sum += run->costs[i];
        const gboolean none =
            !(run->fit->layers.sheen_roughness > 0 || run->fit->layers.coat_roughness > 0);
        const double enough = none ? MIN(BETTER * least, least - WORTH * some) : least;
        if (k > 0 && sum >= enough)
            continue;
        run->fit->layers = now;
        least = sum;
    }
    g_clear_pointer(&run->costs, g_free);
    run->step = 0;
    return ok;
}

/* Refines all texels, with priors from the first fit. */
static gboolean refine_all(struct maps_fit_run *run, const struct work *work, GError **error) {
    const int width = (int)run->btf->layout.width, height = (int)run->btf->layout.height;
    const int n = width * height;
    run->parameters = g_new(struct maps_parameters, n);
    for (int t = 0; t < n; t++) {
        run->parameters[t] = maps_parameters_of(&run->fit->texels[t]);
        run->mean_cost += run->costs[t] / n;
    }
    run->clusters = maps_clusters_new(run->parameters, width, height, run->pairs->model);
    maps_clusters_set_metals(run->clusters, n, run->parameters);
    const gboolean ok = blocks(run, work, (n + BLOCK - 1) / BLOCK, error);
    g_clear_pointer(&run->clusters, maps_clusters_free);
    g_clear_pointer(&run->parameters, g_free);
    return ok;
}

struct maps_fit *maps_fit_new(const struct maps_register *of, const struct maps_layers *layers,
                              enum maps_model model, const struct work *work, GError **error) {
    const struct btf_matrix *btf = of->btf;
    const gsize n = btf_layout_texels(&btf->layout);
    struct maps_fit *fit = g_new0(struct maps_fit, 1);
    struct maps_pairs *pairs = maps_pairs_new(&btf->layout, model);
    struct maps_fit_run run = {.of = of, .btf = btf, .pairs = pairs, .fit = fit};
    g_mutex_init(&run.mutex);
    gboolean ok = pairs->n > 0;
    if (!ok)
        data_error_set(btf->name ? btf->name : "BTF", 0, error,
                       "there is no pair of a view and a light that are both at least 1.15° above "
                       "the plane of the sample; capture or import other directions");
    fit->texels = ok ? g_try_new0(struct maps_texel, n) : NULL;
    if (ok && !fit->texels) {
        data_error_set(btf->name ? btf->name : "BTF", 0, error,
                       "there is not enough memory for the maps of %zu × %zu texels; export on a "
                       "computer with more memory",
                       btf->layout.width, btf->layout.height);
        ok = FALSE;
    }
    ok = ok && maps_fit_mean(&run, error);
    if (ok && layers)
        fit->layers = *layers;
    else if (ok && model == MAPS_MODEL_FULL)
        ok = choose(&run, pairs, work, error);
    if (ok) {
        maps_pairs_set_layers(pairs, &fit->layers);
        run.costs = g_new0(double, n);
        ok = blocks(&run, work, (int)((n + BLOCK - 1) / BLOCK), error) &&
             refine_all(&run, work, error);
        g_free(run.costs);
    }
    for (gsize t = 0; ok && t < n; t++)
        fit->dark += fit->texels[t].base[0] <= 0 && fit->texels[t].base[1] <= 0 &&
                     fit->texels[t].base[2] <= 0 && fit->texels[t].metallic <= 0 &&
                     fit->texels[t].roughness >= 1;
    maps_pairs_free(pairs);
    g_mutex_clear(&run.mutex);
    if (!ok)
        g_clear_pointer(&fit, maps_fit_free);
    return fit;
}
