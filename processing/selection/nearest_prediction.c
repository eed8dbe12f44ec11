#include "nearest_prediction.h"

#include <lapacke.h>
#include <string.h>

#include "prediction_private.h"

#define CHUNK 128 /* number of pairs whose covariances are computed together */
/* maximum number of evaluations of each fit of the mean material */
#define MEAN_EVALUATIONS 1500
/* Maximum number of missing pairs at whose distances the cross-validation is done. With 160 of them
 * the expected error has a standard deviation of 3 to 8 %, with 800 of 1 to 3 %. */
#define EXAMINED 4000
/* Relative standard deviation of Σ σ² that the cross-validation cannot show, because the predicted
 * pairs t are not the missing pairs u, and because the probes are not the whole sample. The value
 * is from weave, brick, peanuts and brushed of docs/lab/fast.md. */
#define UNSEEN 0.11
/* limited_mean() cuts off highlights at max_gloss. The part that is cut off counts as uncertain, up
 * to MAX_BEYOND · max_gloss. There is this limit because a lobe that was fitted to few pairs may be
 * arbitrarily bright between them. */
#define MAX_BEYOND 0.5
/* nearest_prediction_error_range() gives a range of this number of standard deviations of log Σ σ²
 * on both sides of the expected error. */
#define RANGE 1.645

struct NearestPrediction {
    Prediction *model; /* without weights and factor */
    /* neighbours has NEAREST_NEIGHBOURS elements for each missing pair, of which the first
     * n_neighbours are used. */
    int *neighbours, *n_neighbours;
    float *weights;
    double *variance; /* n_missing: k_uu − k_Suᵀ w_u */
    /* n_pairs: for each pair, the mean of ρ² over the rows of probes, measured or predicted */
    double *energy;
    double total; /* Σ energy */
    /* maximum of g at measured pairs, which is also the maximum of g at missing pairs */
    double max_mean;
    /* Minimum of the cosines cos θ_v and cos θ_l at measured pairs. The diffuse part of g does not
     * change with a view below it, and changes with a light below it like that of a diffuser. */
    double min_cos_view, min_cos_light;
    /* n_pairs: b of nearest_prediction.h, mean over the rows of probes; 0 at measured pairs */
    double *beyond;
    double excess; /* e */
    double spread; /* relative standard deviation of Σ σ² */
};

void nearest_prediction_free(NearestPrediction *prediction) {
    if (!prediction)
        return;
    prediction_free(prediction->model);
    g_free(prediction->neighbours);
    g_free(prediction->n_neighbours);
    g_free(prediction->weights);
    g_free(prediction->variance);
    g_free(prediction->energy);
    g_free(prediction->beyond);
    g_free(prediction);
}

struct candidates {
    const Prediction *model;
    const int *known; /* n pairs, ascending */
    int n;
    const double *k;    /* n: covariance of each pair with the target */
    double most;        /* pairs whose covariance is larger than this are left out */
    const int *without; /* the group whose pairs are left out; NULL if there is none */
};

static gboolean may_use(const struct candidates *from, int i) {
    return from->k[i] <= from->most &&
           !(from->without && from->model->groups[from->known[i]] == *from->without);
}

/* Lists the NEAREST_NEIGHBOURS candidates with the largest covariances, the largest first. */
static int find_nearest(const struct candidates *from, int ret[NEAREST_NEIGHBOURS]) {
    double kept[NEAREST_NEIGHBOURS];
    int found = 0;
    for (int i = 0; i < from->n; i++) {
        const double k = from->k[i];
        if ((found == NEAREST_NEIGHBOURS && k <= kept[found - 1]) || !may_use(from, i))
            continue;
        int at = found < NEAREST_NEIGHBOURS ? found++ : NEAREST_NEIGHBOURS - 1;
        for (; at > 0 && kept[at - 1] < k; at--) {
            kept[at] = kept[at - 1];
            ret[at] = ret[at - 1];
        }
        kept[at] = k;
        ret[at] = from->known[i];
    }
    return found;
}

/* Computes w = K_SS⁻¹ k_Su for the n pairs S, and returns the variance k_uu − k_Suᵀ w. ret_weights
 * may be NULL. */
static double solve(const Prediction *model, int u, const int *s, int n, double *ret_weights) {
    double k[(NEAREST_NEIGHBOURS + 1) * (NEAREST_NEIGHBOURS + 1)], w[NEAREST_NEIGHBOURS];
    int pairs[NEAREST_NEIGHBOURS + 1];
    const int all = n + 1;
    memcpy(pairs, s, sizeof *s * (gsize)n);
    pairs[n] = u;
    prediction_covariance_small(model, pairs, all, k);
    double variance = k[n * all + n];
    memcpy(w, k + n * all, sizeof *w * (gsize)n);
    if (LAPACKE_dpotrf_work(LAPACK_COL_MAJOR, 'L', n, k, all) != 0 ||
        LAPACKE_dpotrs_work(LAPACK_COL_MAJOR, 'L', n, 1, k, all, w, MAX(n, 1)) != 0)
        memset(w, 0, sizeof w); /* the matrix is positive definite, except for rounding errors */
    else
        for (int i = 0; i < n; i++)
            variance -= k[n + i * all] * w[i];
    if (ret_weights)
        memcpy(ret_weights, w, sizeof *w * (gsize)n);
    return fmax(variance, 1e-12);
}

/* Calls the function `one` for each of n targets, with the covariances of the known pairs. */
typedef void (*ForTarget)(int index, int target, const double *k, gpointer data);
static void for_targets(const Prediction *model, const int *known, int n_known, const int *targets,
                        int n, ForTarget one, gpointer data) {
    g_autofree double *k = g_new(double, MAX((gsize)n_known * CHUNK, 1));
    for (int i = 0; i < n; i += CHUNK) {
        const int some = MIN(CHUNK, n - i);
        prediction_covariance(model, known, n_known, targets + i, some, k);
        for (int j = 0; j < some; j++)
            one(i + j, targets[i + j], k + (gsize)j * (gsize)n_known, data);
    }
}

static void weigh_one(int index, int target, const double *k, gpointer data) {
    NearestPrediction *to = data;
    const Prediction *model = to->model;
    int *s = to->neighbours + (gsize)index * NEAREST_NEIGHBOURS;
    double w[NEAREST_NEIGHBOURS];
    const struct candidates from = {model, model->measured, model->n_measured, k, INFINITY, NULL};
    const int n = find_nearest(&from, s);
    to->n_neighbours[index] = n;
    to->variance[index] = solve(model, target, s, n, w);
    for (int i = 0; i < n; i++)
        to->weights[(gsize)index * NEAREST_NEIGHBOURS + (gsize)i] = (float)w[i];
}

static void weigh(NearestPrediction *to) {
    const Prediction *model = to->model;
    const gsize n = MAX((gsize)model->n_missing, 1);
    to->neighbours = g_new(int, n *NEAREST_NEIGHBOURS);
    to->n_neighbours = g_new0(int, n);
    to->weights = g_new(float, n *NEAREST_NEIGHBOURS);
    to->variance = g_new0(double, n);
    for_targets(model, model->measured, model->n_measured, model->missing, model->n_missing,
                weigh_one, to);
}

/* Finds the lowest directions of measured pairs at the probes. */
static void find_lowest(NearestPrediction *to, const struct prediction_rows *rows,
                        const struct vec3 *at_mm) {
    const Prediction *model = to->model;
    to->min_cos_view = to->min_cos_light = 1;
    for (int r = 0; r < rows->n; r++) {
        if (r > 0 && rows->probes[r] / 3 == rows->probes[r - 1] / 3)
            continue;
        for (int i = 0; i < model->n_measured; i++) {
            struct vec3 v, l;
            prediction_directions(model, at_mm[rows->probes[r] / 3], model->measured[i], &v, &l);
            to->min_cos_view = fmin(to->min_cos_view, v.z);
            to->min_cos_light = fmin(to->min_cos_light, l.z);
        }
    }
}

/* Computes g of a pair, limited to what was measured (ret). Returns the square of the part of the
 * highlights that the limit cuts off. */
static double limited_mean(const NearestPrediction *prediction, struct vec3 at_mm, int pair,
                           double ret[3]) {
    const Prediction *model = prediction->model;
    struct vec3 v, l;
    prediction_directions(model, at_mm, pair, &v, &l);
    const double gloss = prediction_mean_gloss(model->mean, v, l);
    const double used = fmin(gloss, model->max_gloss);
    const double cos_v = fmax(v.z, prediction->min_cos_view);
    const double cos_l = fmax(l.z, prediction->min_cos_light);
    prediction_mean_diffuse(model->mean, cos_v, cos_l, ret);
    for (int c = 0; c < 3; c++)
        ret[c] = CLAMP(ret[c] * fmin(fmax(l.z, 0) / cos_l, 1) + used, PREDICTION_MIN_MEAN,
                       prediction->max_mean);
    return pow(fmin(gloss - used, MAX_BEYOND * model->max_gloss), 2);
}

/* Sets squares of the model to the means of g² s² over rows, and energy to the means of ρ². */
static void sum_up(NearestPrediction *to, const struct prediction_rows *rows,
                   const struct vec3 *at_mm) {
    Prediction *model = to->model;
    const gsize n = (gsize)model->n_pairs, m = (gsize)model->n_measured;
    g_autofree double *means = g_new(double, 3 * n), *ratios = g_new0(double, n);
    g_autofree double *off = g_new0(double, n);
    memset(model->squares, 0, sizeof(double) * n);
    find_lowest(to, rows, at_mm);
    for (gsize i = 0; i < (gsize)rows->n * m; i++)
        to->max_mean = fmax(to->max_mean, rows->g[i]);
    for (int r = 0; r < rows->n; r++) {
        const double *z = rows->z + (gsize)r * m;
        double scale = 0;
        if (r == 0 || rows->probes[r] / 3 != rows->probes[r - 1] / 3)
            for (gsize p = 0; p < n; p++)
                off[p] = limited_mean(to, at_mm[rows->probes[r] / 3], (int)p, means + 3 * p);
        for (gsize i = 0; i < m; i++) {
            ratios[model->measured[i]] = z[i];
            scale += z[i] * z[i] / (double)m;
        }
        for (int u = 0; u < model->n_missing; u++) {
            const gsize first = (gsize)u * NEAREST_NEIGHBOURS;
            double sum = 0;
            for (gsize i = 0; i < (gsize)to->n_neighbours[u]; i++)
                sum += (double)to->weights[first + i] * ratios[to->neighbours[first + i]];
            ratios[model->missing[u]] = fmax(sum, 0);
            to->beyond[model->missing[u]] += off[model->missing[u]] * scale / rows->n;
        }
        for (gsize p = 0; p < n; p++) {
            const double g = means[3 * p + (gsize)(rows->probes[r] % 3)];
            model->squares[p] += g * g * scale / rows->n;
            to->energy[p] += g * g * ratios[p] * ratios[p] / rows->n;
        }
    }
    for (gsize p = 0; p < n; p++)
        to->total += to->energy[p];
}

struct validation {
    const NearestPrediction *of;
    const struct prediction_rows *rows;
    const int *columns; /* n_pairs: for each measured pair, its column in the rows */
    const int *limits;  /* for each target t: the missing pair u */
    /* squares: squared error of each target
     * variances: expected squared error of each target, without the factor e */
    double *squares, *variances;
};

/* Predicts a measured pair t from the measured pairs that are at least as far from t as the missing
 * pair u is. */
static void validate_one(int index, int t, const double *k, gpointer data) {
    struct validation *v = data;
    const Prediction *model = v->of->model;
    const gsize m = (gsize)model->n_measured;
    double limit, w[NEAREST_NEIGHBOURS];
    int s[NEAREST_NEIGHBOURS];
    prediction_covariance(model, &t, 1, &v->limits[index], 1, &limit);
    const struct candidates from = {model, model->measured, (int)m, k, limit, &model->groups[t]};
    const int n = find_nearest(&from, s);
    const double variance = solve(model, t, s, n, w);
    for (int r = 0; r < v->rows->n; r++) {
        const double *z = v->rows->z + (gsize)r * m,
                     g = v->rows->g[(gsize)r * m + (gsize)v->columns[t]];
        double sum = 0;
        for (int i = 0; i < n; i++)
            sum += w[i] * z[v->columns[s[i]]];
        const double off = g * (fmax(sum, 0) - z[v->columns[t]]);
        v->squares[index] += off * off / v->rows->n;
    }
    v->variances[index] = model->squares[t] * variance;
}

/* Sets e and the spread (relative standard deviation of Σ σ²) from n targets. Several targets may
 * be the same pair t, and then have similar errors. The standard deviation of e is therefore that
 * of a ratio of sums over groups (Cochran 1977 eq. 2.46). It is assumed that the errors of missing
 * pairs scatter about their variances as the errors of the targets do. */
static void judge(NearestPrediction *to, const struct validation *of, const int *targets, int n) {
    const Prediction *model = to->model;
    g_autofree double *squares = g_new0(double, model->n_pairs);
    g_autofree double *variances = g_new0(double, model->n_pairs);
    double all = 0, expected = 0, of_e = 0, scatter = 0, single = 0, left = 0, left_2 = 0, more = 0,
           more_2 = 0;
    for (int i = 0; i < n; i++) {
        all += of->squares[i];
        expected += of->variances[i];
        squares[targets[i]] += of->squares[i];
        variances[targets[i]] += of->variances[i];
    }
    if (!(expected > 0))
        return;
    const double e = to->excess = all / expected;
    for (int t = 0; t < model->n_pairs; t++)
        of_e += pow(squares[t] - e * variances[t], 2);
    for (int i = 0; i < n; i++) {
        scatter += pow(of->squares[i] - e * of->variances[i], 2);
        single += pow(e * of->variances[i], 2);
    }
    for (int u = 0; u < model->n_missing; u++) {
        const double one = e * model->squares[model->missing[u]] * to->variance[u];
        const double beyond = to->beyond[model->missing[u]];
        left += one;
        left_2 += one * one;
        more += beyond;
        more_2 += beyond * beyond;
    }
    const double of_all = left * left * of_e / (all * all) + left_2 * scatter / single + more_2;
    to->spread = hypot(UNSEEN, sqrt(of_all) / (left + more));
}

/* Sets the factor e and the spread. If no pair is missing, e stays 1 and the spread 0. */
static void validate(NearestPrediction *to, const struct prediction_rows *rows) {
    const Prediction *model = to->model;
    const int n = MIN(model->n_missing, EXAMINED);
    g_autofree int *columns = g_new0(int, model->n_pairs), *limits = g_new(int, n + 1);
    g_autofree int *targets = g_new(int, n + 1);
    for (int i = 0; i < model->n_measured; i++)
        columns[model->measured[i]] = i;
    for (int i = 0; i < n; i++) {
        const int u = (int)((gint64)i * model->n_missing / n);
        limits[i] = model->missing[u];
        targets[i] = to->neighbours[(gsize)u * NEAREST_NEIGHBOURS];
    }
    g_autofree double *squares = g_new0(double, n + 1), *variances = g_new0(double, n + 1);
    struct validation v = {to, rows, columns, limits, squares, variances};
    for_targets(model, model->measured, model->n_measured, targets, n, validate_one, &v);
    judge(to, &v, targets, n);
}

static gboolean learn(NearestPrediction *to, const float *probes, const struct vec3 *at_mm,
                      int n_probes, const NearestPrediction *like, const struct work *work,
                      GError **error) {
    Prediction *model = to->model;
    struct prediction_rows rows;
    if (like) {
        memcpy(model->mean, like->model->mean, sizeof model->mean);
        memcpy(model->constants, like->model->constants, sizeof model->constants);
        model->max_gloss = like->model->max_gloss;
    } else {
        prediction_mean_fit(model, probes, at_mm, n_probes, NULL, MEAN_EVALUATIONS);
    }
    const gboolean ok = prediction_rows_take(model, probes, at_mm, n_probes, &rows, error) &&
                        (like || prediction_fit(model, rows.z, rows.g, rows.n, work, error));
    if (ok) {
        weigh(to);
        sum_up(to, &rows, at_mm);
        validate(to, &rows);
    }
    prediction_rows_clear(&rows);
    return ok;
}

NearestPrediction *nearest_prediction_new(const struct prediction_pairs *pairs, const float *probes,
                                          const struct vec3 *at_mm, int n_probes,
                                          const NearestPrediction *like, const struct work *work,
                                          GError **error) {
    g_autoptr(NearestPrediction) prediction = g_new0(NearestPrediction, 1);
    g_autofree struct vec3 *middle = at_mm ? NULL : g_new0(struct vec3, n_probes);
    prediction->model = prediction_begin(pairs, probes, n_probes);
    prediction->energy = g_new0(double, MAX(prediction->model->n_pairs, 1));
    prediction->beyond = g_new0(double, MAX(prediction->model->n_pairs, 1));
    prediction->excess = 1;
    work_use_one_blas_thread();
    if (prediction->model->n_measured > 0 &&
        !learn(prediction, probes, at_mm ? at_mm : middle, n_probes,
               like && like->model->n_measured > 0 ? like : NULL, work, error))
        return NULL;
    return g_steal_pointer(&prediction);
}

/* Returns the index of a pair among the missing ones, or −1 if it is measured. */
static int missing_index(const Prediction *model, int pair) {
    int low = 0, high = model->n_missing;
    while (low < high) {
        const int middle = (low + high) / 2;
        if (model->missing[middle] < pair)
            low = middle + 1;
        else
            high = middle;
    }
    return low < model->n_missing && model->missing[low] == pair ? low : -1;
}

int nearest_prediction_weights(const NearestPrediction *prediction, int pair, const int **ret_pairs,
                               const float **ret_weights) {
    const int u = prediction->neighbours ? missing_index(prediction->model, pair) : -1;
    if (u < 0)
        return 0;
    *ret_pairs = prediction->neighbours + (gsize)u * NEAREST_NEIGHBOURS;
    *ret_weights = prediction->weights + (gsize)u * NEAREST_NEIGHBOURS;
    return prediction->n_neighbours[u];
}

void nearest_prediction_mean(const NearestPrediction *prediction, struct vec3 at_mm, int pair,
                             double ret[3]) {
    limited_mean(prediction, at_mm, pair, ret);
}

/* Returns σ² of a missing pair, as the mean over the rows of probes. */
static double expected_square(const NearestPrediction *prediction, int pair, double variance) {
    return prediction->excess * prediction->model->squares[pair] * variance +
           prediction->beyond[pair];
}

double nearest_prediction_error(const NearestPrediction *prediction) {
    const Prediction *model = prediction->model;
    double sum = 0;
    if (model->n_measured == 0)
        return 1;
    for (int u = 0; u < model->n_missing; u++)
        sum += expected_square(prediction, model->missing[u], prediction->variance[u]);
    return sqrt(sum / prediction->total);
}

void nearest_prediction_error_range(const NearestPrediction *prediction, double ret[2]) {
    const double error = nearest_prediction_error(prediction);
    const double factor = exp(RANGE * prediction->spread / 2);
    ret[0] = error / factor;
    ret[1] = error * factor;
}

double nearest_prediction_pair_error(const NearestPrediction *prediction, int pair) {
    const Prediction *model = prediction->model;
    const int u = missing_index(model, pair);
    if (model->n_measured == 0 || u < 0)
        return u < 0 ? 0 : 1;
    return sqrt(expected_square(prediction, pair, prediction->variance[u]) /
                fmax(prediction->energy[pair], 1e-12));
}

struct later {
    const NearestPrediction *of;
    const int *known;
    int n_known;
    double sum;
};

static void add_later(int index, int target, const double *k, gpointer data) {
    struct later *later = data;
    const Prediction *model = later->of->model;
    int s[NEAREST_NEIGHBOURS];
    const struct candidates from = {model, later->known, later->n_known, k, INFINITY, NULL};
    const int n = find_nearest(&from, s);
    later->sum += expected_square(later->of, target, solve(model, target, s, n, NULL));
}

double nearest_prediction_error_after(const NearestPrediction *prediction, const gboolean *more,
                                      int targets) {
    const Prediction *model = prediction->model;
    g_autofree int *known = g_new(int, model->n_pairs + 1), *left = g_new(int, model->n_pairs + 1);
    g_autofree int *some = g_new(int, targets + 1);
    int n_known = model->n_measured, n_left = 0;
    if (model->n_measured == 0)
        return 1;
    memcpy(known, model->measured, sizeof(int) * (gsize)n_known);
    for (int u = 0; u < model->n_missing; u++)
        if (more[model->missing[u]])
            known[n_known++] = model->missing[u];
        else
            left[n_left++] = model->missing[u];
    const int n = MIN(n_left, targets);
    for (int i = 0; i < n; i++)
        some[i] = left[(gint64)i * n_left / n];
    struct later later = {prediction, known, n_known, 0};
    for_targets(model, known, n_known, some, n, add_later, &later);
    return n > 0 ? sqrt(later.sum * n_left / n / prediction->total) : 0;
}
