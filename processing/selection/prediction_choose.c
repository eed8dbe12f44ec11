/* The choice of shots. The algorithm is greedy and minimises the sum of the conditional variances
 * of some pairs (targets T). Let S be the pairs that are measured or chosen. C = k − k_·S K_S⁻¹
 * k_S· is the conditional covariance. A shot of pairs B reduces the sum by tr (C_BB⁻¹ C_BT C_TB).
 * Then C becomes C − C_·B C_BB⁻¹ C_B·.
 *
 * Two matrices are kept in memory: C of all pairs against the targets, and a factor F of all pairs
 * with F Fᵀ = k − C. C between any two pairs follows from F. The gain of a shot changes little, and
 * only decreases. It is therefore computed again only if its previous value would still be the
 * largest (Minoux 1978). */
#include "prediction.h"

#include <cblas.h>
#include <lapacke.h>
#include <string.h>

#include "prediction_private.h"

struct choice {
    const Prediction *prediction;
    /* n_pairs: number of pairs that are considered
     * n_targets: number of targets among them */
    int n_pairs, n_targets;
    int *pairs; /* indices of the n_pairs pairs; the targets are first */
    int *place; /* for each pair of the material, its index in pairs, or −1 */
    int n_factors, room;
    double *factors; /* F: n_pairs × room, row by row */
    double *c;       /* C: n_pairs × n_targets, row by row, multiplied by g s of the target */
    double *left;    /* n_targets: conditional variances of ρ */
    /* the sum of variances over all missing pairs, divided by the sum over the targets */
    double to_all;
};

/* The pairs of a shot that are not measured, and their conditional covariance C_BB. */
struct choice_block {
    /* n: number of the pairs
     * at: their indices in choice.pairs */
    int n, *at;
    double *chol; /* n², column by column: Cholesky factor of C_BB */
};

static void choice_clear(struct choice *choice) {
    g_free(choice->pairs);
    g_free(choice->place);
    g_free(choice->factors);
    g_free(choice->c);
    g_free(choice->left);
}

static void choice_add_pair(struct choice *choice, int pair) {
    if (choice->place[pair] >= 0)
        return;
    choice->place[pair] = choice->n_pairs;
    choice->pairs[choice->n_pairs++] = pair;
}

/* Returns a number below n that looks random in i (Knuth 1998, §6.4, multiplicative hashing). */
static int choice_scatter(int i, int n) {
    return (int)(((guint32)i * 2654435769u >> 8) % (guint32)n);
}

/* Sets pairs, place and n_targets. Each target is taken from one of PREDICTION_TARGETS sections of
 * the list of missing pairs, of about the same length. If there are fewer missing pairs, each is a
 * target. The place of the target in its section is irregular, because with regular steps the
 * targets could be pairs of only a few lights. After the targets come all other pairs of the
 * candidates that are not measured. */
static void choice_set_pairs(struct choice *choice, const struct prediction_shot *shots,
                             const int *candidates, int n_candidates) {
    const Prediction *prediction = choice->prediction;
    const int n = prediction->n_missing;
    choice->pairs = g_new(int, prediction->n_pairs);
    choice->place = g_new(int, prediction->n_pairs);
    for (int p = 0; p < prediction->n_pairs; p++)
        choice->place[p] = -1;
    const int wanted = MIN(n, PREDICTION_TARGETS);
    for (int i = 0; i < wanted; i++) {
        const int first = (int)((gint64)i * n / wanted), end = (int)((gint64)(i + 1) * n / wanted);
        choice_add_pair(choice, prediction->missing[first + choice_scatter(i, end - first)]);
    }
    choice->n_targets = choice->n_pairs;
    for (int k = 0; k < n_candidates; k++)
        for (int i = 0; i < shots[candidates[k]].n_pairs; i++)
            if (!prediction_is_measured(prediction, shots[candidates[k]].pairs[i]))
                choice_add_pair(choice, shots[candidates[k]].pairs[i]);
}

/* Computes C, F, left and to_all for the pairs that are measured. */
static void choice_condition(struct choice *choice) {
    const Prediction *prediction = choice->prediction;
    const int m = prediction->n_measured, n = choice->n_pairs, t = choice->n_targets;
    g_autofree double *k = g_new(double, MAX((gsize)m * (gsize)n, 1));
    choice->c = g_new(double, (gsize)n *(gsize)t);
    choice->left = g_new(double, t);
    choice->factors = g_new0(double, (gsize)n *(gsize)choice->room);
    prediction_covariance(prediction, choice->pairs, t, choice->pairs, n, choice->c);
    for (gsize i = 0; i < (gsize)t; i++)
        choice->c[i * (gsize)t + i] += prediction->constants[PREDICTION_NUGGET];
    if (m > 0) {
        prediction_covariance(prediction, prediction->measured, m, choice->pairs, n, k);
        cblas_dtrsm(CblasColMajor, CblasLeft, CblasLower, CblasNoTrans, CblasNonUnit, m, n, 1,
                    prediction->factor, m, k, m);
        cblas_dgemm(CblasRowMajor, CblasNoTrans, CblasTrans, n, t, m, -1, k, m, k, m, 1, choice->c,
                    t);
        for (gsize i = 0; i < (gsize)n; i++)
            memcpy(choice->factors + i * (gsize)choice->room, k + i * (gsize)m,
                   sizeof(double) * (gsize)m);
    }
    choice->n_factors = m;
    for (gsize i = 0; i < (gsize)t; i++)
        choice->left[i] = choice->c[i * (gsize)t + i] * prediction->squares[choice->pairs[i]];
    for (gsize i = 0; i < (gsize)n; i++)
        for (gsize j = 0; j < (gsize)t; j++)
            choice->c[i * (gsize)t + j] *= sqrt(prediction->squares[choice->pairs[j]]);
    const double sum = cblas_dasum(t, choice->left, 1);
    double all = 0;
    for (int u = 0; u < prediction->n_missing; u++)
        all +=
            prediction->squares[prediction->missing[u]] *
            (prediction->variance ? prediction->variance[u]
                                  : prediction_prior_variance(prediction, prediction->missing[u]));
    choice->to_all = sum > 0 ? all / sum : 1;
}

/* Returns C of the pairs with the indices a and b in choice.pairs. prior is their covariance k. */
static double choice_covariance(const struct choice *choice, int a, int b, double prior) {
    return prior - cblas_ddot(choice->n_factors, choice->factors + (gsize)a * (gsize)choice->room,
                              1, choice->factors + (gsize)b * (gsize)choice->room, 1);
}

static gboolean choice_open_block(const struct choice *choice, const struct prediction_shot *shot,
                                  struct choice_block *ret) {
    const Prediction *prediction = choice->prediction;
    ret->at = g_new(int, MAX(shot->n_pairs, 1));
    ret->chol = g_new(double, MAX((gsize)shot->n_pairs * (gsize)shot->n_pairs, 1));
    ret->n = 0;
    g_autofree int *pairs = g_new(int, MAX(shot->n_pairs, 1));
    for (int i = 0; i < shot->n_pairs; i++)
        if (choice->place[shot->pairs[i]] >= 0) {
            pairs[ret->n] = shot->pairs[i];
            ret->at[ret->n++] = choice->place[shot->pairs[i]];
        }
    prediction_covariance_small(prediction, pairs, ret->n, ret->chol);
    for (int i = 0; i < ret->n; i++)
        for (int j = 0; j < ret->n; j++)
            ret->chol[i * ret->n + j] =
                choice_covariance(choice, ret->at[i], ret->at[j], ret->chol[i * ret->n + j]);
    return ret->n > 0 && LAPACKE_dpotrf(LAPACK_COL_MAJOR, 'L', ret->n, ret->chol, ret->n) == 0;
}

static void choice_close_block(struct choice_block *block) {
    g_clear_pointer(&block->at, g_free);
    g_clear_pointer(&block->chol, g_free);
}

/* Returns R⁻¹ C_BT with C_BB = R Rᵀ: n × n_targets, row by row. */
static double *choice_whitened(const struct choice *choice, const struct choice_block *block) {
    const int t = choice->n_targets;
    double *rows = g_new(double, (gsize)block->n *(gsize)t);
    for (int i = 0; i < block->n; i++)
        memcpy(rows + (gsize)i * (gsize)t, choice->c + (gsize)block->at[i] * (gsize)t,
               sizeof(double) * (gsize)t);
    cblas_dtrsm(CblasRowMajor, CblasLeft, CblasUpper, CblasTrans, CblasNonUnit, block->n, t, 1,
                block->chol, block->n, rows, t);
    return rows;
}

static double choice_gain(const struct choice *choice, const struct prediction_shot *shot) {
    struct choice_block block;
    double gain = 0;
    if (choice_open_block(choice, shot, &block)) {
        g_autofree double *rows = choice_whitened(choice, &block);
        const int n = block.n * choice->n_targets;
        gain = cblas_ddot(n, rows, 1, rows, 1);
    }
    choice_close_block(&block);
    return gain / shot->price_s;
}

/* Takes a shot: adds a column to F for each pair, and subtracts the outer product of the new
 * columns from C. */
static void choice_take(struct choice *choice, const struct prediction_shot *shot) {
    const Prediction *prediction = choice->prediction;
    const gsize t = (gsize)choice->n_targets, room = (gsize)choice->room;
    struct choice_block block;
    if (choice_open_block(choice, shot, &block)) {
        g_autofree double *rows = choice_whitened(choice, &block);
        const int n = block.n, all = choice->n_pairs, old = choice->n_factors;
        g_autofree int *pairs = g_new(int, n);
        g_autofree double *new = g_new(double, (gsize)n *(gsize)all); /* all × n, row by row */
        g_autofree double *own = g_new(double, (gsize)n *room);
        for (int i = 0; i < n; i++) {
            pairs[i] = choice->pairs[block.at[i]];
            memcpy(own + (gsize)i * room, choice->factors + (gsize)block.at[i] * room,
                   sizeof(double) * room);
        }
        prediction_covariance(prediction, pairs, n, choice->pairs, all, new);
        for (int i = 0; i < n; i++)
            new[(gsize)block.at[i] * (gsize)n + (gsize)i] +=
                prediction->constants[PREDICTION_NUGGET];
        if (old > 0)
            cblas_dgemm(CblasRowMajor, CblasNoTrans, CblasTrans, all, n, old, -1, choice->factors,
                        (int)room, own, (int)room, 1, new, n);
        cblas_dtrsm(CblasColMajor, CblasLeft, CblasLower, CblasNoTrans, CblasNonUnit, n, all, 1,
                    block.chol, n, new, n);
        cblas_dgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, all, (int)t, n, -1, new, n, rows,
                    (int)t, 1, choice->c, (int)t);
        for (gsize i = 0; i < (gsize)all; i++)
            memcpy(choice->factors + i * room + (gsize)old, new + i *(gsize)n,
                   sizeof(double) * (gsize)n);
        choice->n_factors += n;
        for (gsize k = 0; k < t; k++)
            for (gsize i = 0; i < (gsize)n; i++)
                choice->left[k] -= rows[i * t + k] * rows[i * t + k];
        for (int i = 0; i < n; i++)
            if (block.at[i] < choice->n_targets)
                choice->left[block.at[i]] = 0;
    }
    choice_close_block(&block);
}

static double choice_error(const struct choice *choice) {
    const Prediction *prediction = choice->prediction;
    double sum = 0;
    for (int k = 0; k < choice->n_targets; k++)
        sum += fmax(choice->left[k], 0);
    return prediction_relative_error(prediction, choice->to_all * sum);
}

struct choice_gains {
    const struct choice *choice;
    const struct prediction_shot *shots;
    const int *candidates;
    double *gains;
};

static void choice_first_gain(int k, gpointer data) {
    const struct choice_gains *job = data;
    job->gains[k] = choice_gain(job->choice, &job->shots[job->candidates[k]]);
}

/* Returns the candidate with the largest gain, or the first of several such candidates. Returns −1
 * if no candidate has a gain above 0. gains are updated where necessary. */
static int choice_best(const struct choice *choice, const struct prediction_shot *shots,
                       const int *candidates, int n, double *gains) {
    int fresh = -1;
    for (;;) {
        int best = -1;
        for (int k = 0; k < n; k++)
            if (gains[k] > 0 && (best < 0 || gains[k] > gains[best]))
                best = k;
        if (best < 0 || best == fresh)
            return best;
        gains[best] = choice_gain(choice, &shots[candidates[best]]);
        fresh = best;
    }
}

static int choice_run(struct choice *choice, const struct prediction_shot *shots,
                      const int *candidates, int n, int most, struct prediction_choice *ret,
                      const struct work *work, GError **error) {
    g_autofree double *gains = g_new(double, MAX(n, 1));
    struct choice_gains job = {choice, shots, candidates, gains};
    const gint64 begun_us = g_get_monotonic_time();
    choice_condition(choice);
    work_for_each(work ? work->n_threads : 0, n, choice_first_gain, &job);
    for (int k = 0; k < most; k++) {
        if (!work_tell(work, "choice", k, most, begun_us, error))
            return -1;
        const int best = choice_best(choice, shots, candidates, n, gains);
        if (best < 0)
            return k;
        ret[k].shot = candidates[best];
        ret[k].error_before = choice_error(choice);
        choice_take(choice, &shots[candidates[best]]);
        ret[k].error_after = choice_error(choice);
        gains[best] = 0;
    }
    return most;
}

int prediction_choose(const Prediction *prediction, const struct prediction_shot *shots,
                      int n_shots, const gboolean *taken, int most, struct prediction_choice *ret,
                      const struct work *work, GError **error) {
    g_autofree int *free_shots = g_new(int, MAX(n_shots, 1));
    int n_free = 0, per_shot = 0;
    for (int i = 0; i < n_shots; i++)
        if (!taken || !taken[i])
            free_shots[n_free++] = i;
    const int n = MIN(n_free, PREDICTION_CANDIDATES);
    g_autofree int *candidates = g_new(int, MAX(n, 1));
    for (int k = 0; k < n; k++) {
        candidates[k] = free_shots[(gint64)k * n_free / n];
        per_shot = MAX(per_shot, shots[candidates[k]].n_pairs);
    }
    if (prediction->n_missing == 0 || n == 0 || most <= 0)
        return 0;
    struct choice choice = {.prediction = prediction,
                            .room = prediction->n_measured + MIN(most, n) * per_shot};
    choice_set_pairs(&choice, shots, candidates, n);
    /* With several threads, the sums of OpenBLAS would depend on the number of threads. */
    const int threads = openblas_get_num_threads();
    openblas_set_num_threads(1);
    const int chosen = choice_run(&choice, shots, candidates, n, MIN(most, n), ret, work, error);
    openblas_set_num_threads(threads);
    choice_clear(&choice);
    return chosen;
}
