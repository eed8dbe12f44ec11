#include <cblas.h>
#include <gio/gio.h>
#include <lapacke.h>
#include <math.h>
#include <string.h>

#include "lpca_private.h"

#define SEED 19
/* number of iterations at the start that use only the means of the clusters, not their axes */
#define MEANS_ITERATIONS 3
#define MAX_ITERATIONS   40
#define POWER_STEPS      2
/* the iteration ends if it lowers the sum of squared distances by no more than this share of the
 * sum */
#define SETTLED 1e-4
#define BLOCK   512 /* number of rows that are assigned together */

void lpca_reduced_clear(struct lpca_reduced *reduced) {
    g_clear_pointer(&reduced->labels, g_free);
    g_clear_pointer(&reduced->means, g_free);
    g_clear_pointer(&reduced->bases, g_free);
    g_clear_pointer(&reduced->members, g_ptr_array_unref);
}

/* Draws an index i with the probability shares[i] / all, with all = Σ shares. */
static int draw(GRand *random, const double *shares, int n, double all) {
    double left = g_rand_double(random) * all;
    int last = 0;
    for (int i = 0; i < n; i++) {
        if (shares[i] <= 0)
            continue;
        last = i;
        left -= shares[i];
        if (left < 0)
            break;
    }
    return last;
}

void lpca_share(const struct team *team, void *values, int n, int step, gsize size) {
    if (!team)
        return;
    g_autofree gsize *starts = g_new0(gsize, team->n_ranks + 1);
    for (int i = 0; i < team->n_ranks; i++) {
        int first, end;
        team_part(team, i, n, step, &first, &end);
        starts[i + 1] = (gsize)end * size;
    }
    team->share(team, values, starts);
}

void lpca_reduced_weights(const struct lpca_reduced *reduced, const int *labels, int from, int end,
                          float *weights) {
    const gsize r = (gsize)reduced->r, c = (gsize)reduced->c;
    g_autofree float *row = g_new(float, r);
    for (int x = from; x < end; x++) {
        const gsize k = (gsize)labels[x];
        for (gsize j = 0; j < r; j++)
            row[j] = reduced->rows[(gsize)x * r + j] - reduced->means[k * r + j];
        cblas_sgemv(CblasRowMajor, CblasNoTrans, reduced->c, reduced->r, 1,
                    reduced->bases + k * c * r, reduced->r, row, 1, 0, weights + (gsize)x * c, 1);
    }
}

/* Gives the blocks *ret_first … *ret_end − 1 that this rank processes. All ranks exchange their
 * results afterwards (lpca_share()). */
static void blocks_of(const struct lpca_reduced *reduced, int *ret_first, int *ret_end) {
    const struct team *team = reduced->options->team;
    const int blocks = (reduced->n + BLOCK - 1) / BLOCK;
    team_part(team, team ? team->rank : 0, blocks, 1, ret_first, ret_end);
}

/* The arguments of seed_block(), which updates nearest[x] for a new seed. nearest[x] is the minimum
 * of ‖r_x − s‖² of row r_x over all seeds s so far. */
struct seeding {
    const struct lpca_reduced *reduced;
    const float *seed; /* the newest seed */
    gboolean first;
    int from;        /* index of the first block of this rank */
    double *nearest; /* n values */
};

static void seed_block(int block, gpointer data) {
    const struct seeding *seeding = data;
    const int r = seeding->reduced->r, from = (seeding->from + block) * BLOCK;
    for (int i = from; i < MIN(from + BLOCK, seeding->reduced->n); i++) {
        const float *row = seeding->reduced->rows + (gsize)i * (gsize)r;
        double d = 0;
        for (int j = 0; j < r; j++)
            d += ((double)row[j] - seeding->seed[j]) * ((double)row[j] - seeding->seed[j]);
        seeding->nearest[i] = seeding->first ? d : MIN(seeding->nearest[i], d);
    }
}

/* k-means++ (Arthur & Vassilvitskii 2007): each further seed is row x with a probability
 * proportional to nearest[x]. The number of seeds is at most the number of different rows. */
static void seed_means(struct lpca_reduced *reduced) {
    g_autofree double *nearest = g_new(double, reduced->n);
    GRand *random = g_rand_new_with_seed(SEED);
    const gsize r = (gsize)reduced->r;
    double first = 0;
    int seeds = 0, next = g_rand_int_range(random, 0, reduced->n), from, end;
    blocks_of(reduced, &from, &end);
    while (seeds < reduced->k) {
        float *mean = reduced->means + (gsize)seeds * r;
        struct seeding seeding = {reduced, mean, seeds == 0, from, nearest};
        double all = 0;
        memcpy(mean, reduced->rows + (gsize)next * r, sizeof(float) * r);
        work_for_each(reduced->options->work.n_threads, end - from, seed_block, &seeding);
        lpca_share(reduced->options->team, nearest, reduced->n, BLOCK, sizeof *nearest);
        for (int i = 0; i < reduced->n; i++)
            all += nearest[i];
        if (seeds++ == 0)
            first = all;
        if (all <= 1e-12 * first)
            break;
        next = draw(random, nearest, reduced->n, all);
    }
    reduced->k = seeds;
    g_rand_free(random);
}

/* The arguments of assign_block(), which assigns each row r to the cluster whose affine subspace is
 * nearest (Kambhatla & Leen 1997). A cluster has the factors f_0 = m, its mean, and f_1 … f_c, its
 * axes. With p_i = ⟨r, f_i⟩ and o_i = ⟨m, f_i⟩, the squared distance is
 *   ‖r − m‖² − Σ_i ⟨r − m, f_i⟩² = ‖r‖² − 2 p_0 + o_0 − Σ_{i≥1} (p_i − o_i)².
 * One matrix multiplication gives all products. */
struct assignment {
    const struct lpca_reduced *reduced;
    int c;          /* number of axes in use; 0 for k-means */
    float *factors; /* k × (c + 1) × r: mean, then axes */
    float *offsets; /* k × (c + 1): products of a cluster's mean with its factors */
    float *errors;  /* n: squared distance of each row from the subspace of its cluster */
    int *labels;
    int from; /* index of the first block of this rank */
};

static void assign_row(const struct assignment *to, int row, const float *products) {
    const struct lpca_reduced *reduced = to->reduced;
    const float *values = reduced->rows + (gsize)row * (gsize)reduced->r;
    const int stride = to->c + 1;
    double norm = 0, best = G_MAXDOUBLE;
    for (int i = 0; i < reduced->r; i++)
        norm += (double)values[i] * values[i];
    for (int k = 0; k < reduced->k; k++) {
        const float *p = products + k * stride, *o = to->offsets + k * stride;
        double error = norm - 2.0 * p[0] + o[0];
        for (int i = 1; i <= to->c; i++)
            error -= ((double)p[i] - o[i]) * ((double)p[i] - o[i]);
        if (error < best) {
            best = error;
            to->labels[row] = k;
        }
    }
    to->errors[row] = (float)MAX(best, 0);
}

static void assign_block(int block, gpointer data) {
    const struct assignment *to = data;
    const int r = to->reduced->r, columns = to->reduced->k * (to->c + 1);
    const int from = (to->from + block) * BLOCK, n = MIN(BLOCK, to->reduced->n - from);
    g_autofree float *products = g_new(float, (gsize)n *(gsize)columns);
    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasTrans, n, columns, r, 1,
                to->reduced->rows + (gsize)from * (gsize)r, r, to->factors, r, 0, products,
                columns);
    for (int i = 0; i < n; i++)
        assign_row(to, from + i, products + (gsize)i * (gsize)columns);
}

/* Assigns all rows to clusters with c axes each. Gives the squared distance of each row from the
 * subspace of its cluster in errors (n), and returns their sum. */
static double assign(struct lpca_reduced *reduced, int c, float *errors) {
    const struct team *team = reduced->options->team;
    const gsize n_factors = (gsize)reduced->k * (gsize)(c + 1), r = (gsize)reduced->r;
    g_autofree float *factors = g_new(float, n_factors *r), *offsets = g_new(float, n_factors);
    struct assignment to = {reduced, c, factors, offsets, errors, reduced->labels};
    double sum = 0;
    int end;
    blocks_of(reduced, &to.from, &end);
    for (gsize k = 0; k < (gsize)reduced->k; k++) {
        const float *mean = reduced->means + k * r;
        const gsize first = k * (gsize)(c + 1);
        memcpy(factors + first * r, mean, sizeof(float) * r);
        memcpy(factors + (first + 1) * r, reduced->bases + k * (gsize)reduced->c * r,
               sizeof(float) * r * (gsize)c);
        for (gsize i = first; i <= first + (gsize)c; i++)
            offsets[i] = cblas_sdot((int)r, mean, 1, factors + i * r, 1);
    }
    work_for_each(reduced->options->work.n_threads, end - to.from, assign_block, &to);
    lpca_share(team, errors, reduced->n, BLOCK, sizeof *errors);
    lpca_share(team, reduced->labels, reduced->n, BLOCK, sizeof *reduced->labels);
    for (int i = 0; i < reduced->n; i++)
        sum += errors[i];
    return sum;
}

static void collect(struct lpca_reduced *reduced) {
    for (int k = 0; k < reduced->k; k++)
        g_array_set_size(g_ptr_array_index(reduced->members, k), 0);
    for (int i = 0; i < reduced->n; i++)
        g_array_append_val((GArray *)g_ptr_array_index(reduced->members, reduced->labels[i]), i);
}

/* Gives each cluster without rows the row with the largest error. The error of that row becomes 0.
 * When all errors are 0, the remaining clusters stay without rows. */
static void refill(struct lpca_reduced *reduced, float *errors) {
    for (int k = 0; k < reduced->k; k++) {
        int worst = 0;
        if (((GArray *)g_ptr_array_index(reduced->members, k))->len > 0)
            continue;
        for (int i = 1; i < reduced->n; i++)
            if (errors[i] > errors[worst])
                worst = i;
        if (errors[worst] <= 0)
            break;
        errors[worst] = 0;
        reduced->labels[worst] = k;
    }
    collect(reduced);
}

/* Sets the mean of a cluster to the mean of its rows. Returns copies of the rows minus the mean;
 * g_free(). */
static float *centred(const struct lpca_reduced *reduced, int k) {
    const GArray *members = g_ptr_array_index(reduced->members, k);
    const gsize r = (gsize)reduced->r;
    float *rows = g_new(float, MAX(members->len, 1) * r), *mean = reduced->means + (gsize)k * r;
    g_autofree double *sums = g_new0(double, r);
    for (guint i = 0; i < members->len; i++) {
        const float *row = reduced->rows + (gsize)g_array_index(members, int, i) * r;
        memcpy(rows + i * r, row, sizeof(float) * r);
        for (gsize j = 0; j < r; j++)
            sums[j] += row[j];
    }
    for (gsize j = 0; j < r; j++)
        mean[j] = (float)(sums[j] / members->len);
    for (guint i = 0; i < members->len; i++)
        for (gsize j = 0; j < r; j++)
            rows[i * r + j] -= mean[j];
    return rows;
}

/* Finds all axes from the covariance RᵀR of n centred rows: the eigenvectors of its c largest
 * eigenvalues, descending; axes along which the rows do not vary are 0. */
static void exact_axes(const struct lpca_reduced *reduced, const float *rows, int n, float *axes) {
    const int r = reduced->r, c = reduced->c;
    g_autofree float *covariance = g_new0(float, (gsize)r *(gsize)r);
    g_autofree float *values = g_new0(float, r);
    g_autofree float *vectors = g_new0(float, (gsize)r *(gsize)c);
    g_autofree int *support = g_new0(int, 2 * r);
    int found = 0;
    cblas_ssyrk(CblasColMajor, CblasUpper, CblasNoTrans, r, n, 1, rows, r, 0, covariance, r);
    memset(axes, 0, sizeof(float) * (gsize)r * (gsize)c);
    if (LAPACKE_ssyevr(LAPACK_COL_MAJOR, 'V', 'I', 'U', r, covariance, r, 0, 0, r - c + 1, r, 0,
                       &found, values, vectors, r, support) != 0)
        return;
    for (int i = 0; i < found; i++)
        if (values[found - 1 - i] > 1e-7F * values[found - 1])
            memcpy(axes + (gsize)i * (gsize)r, vectors + (gsize)(found - 1 - i) * (gsize)r,
                   sizeof(float) * (gsize)r);
}

/* How the axes A of a cluster with the centred rows R are found. NO_AXES leaves A as it is.
 * EXACT_AXES computes A from the covariance RᵀR. BETTER_AXES improves A by POWER_STEPS steps of
 * subspace iteration, A ← orth (A RᵀR), which costs less than the covariance. */
enum axes { NO_AXES, EXACT_AXES, BETTER_AXES };

struct update {
    struct lpca_reduced *reduced;
    enum axes axes;
    int from; /* index of the first cluster of this rank */
};

static void update_cluster(int block, gpointer data) {
    const struct update *update = data;
    struct lpca_reduced *reduced = update->reduced;
    const int k = update->from + block;
    const int n = (int)((GArray *)g_ptr_array_index(reduced->members, k))->len;
    const int r = reduced->r, c = reduced->c;
    if (n == 0)
        return;
    g_autofree float *rows = centred(reduced, k);
    float *axes = reduced->bases + (gsize)(k * c) * (gsize)r;
    if (update->axes == NO_AXES)
        return;
    if (update->axes == EXACT_AXES) {
        exact_axes(reduced, rows, n, axes);
        return;
    }
    g_autofree float *products = g_new(float, (gsize)n *(gsize)c);
    for (int step = 0; step < POWER_STEPS; step++) {
        cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasTrans, n, c, r, 1, rows, r, axes, r, 0,
                    products, c);
        cblas_sgemm(CblasRowMajor, CblasTrans, CblasNoTrans, c, r, n, 1, products, c, rows, r, 0,
                    axes, r);
        lpca_orthonormalise(axes, c, r, FALSE);
    }
}

static void update(struct lpca_reduced *reduced, enum axes axes) {
    const struct team *team = reduced->options->team;
    const gsize row = sizeof(float) * (gsize)reduced->r; /* bytes of a row */
    struct update all = {reduced, axes};
    int end;
    team_part(team, team ? team->rank : 0, reduced->k, 1, &all.from, &end);
    work_for_each(reduced->options->work.n_threads, end - all.from, update_cluster, &all);
    lpca_share(team, reduced->means, reduced->k, 1, row);
    if (axes != NO_AXES)
        lpca_share(team, reduced->bases, reduced->k, 1, (gsize)reduced->c * row);
}

static void drop_empty(struct lpca_reduced *reduced) {
    const gsize r = (gsize)reduced->r, c = (gsize)reduced->c;
    int kept = 0;
    for (int k = 0; k < reduced->k; k++) {
        GArray *members = g_ptr_array_index(reduced->members, kept);
        if (members->len == 0) {
            g_ptr_array_remove_index(reduced->members, (guint)kept);
            continue;
        }
        memmove(reduced->means + (gsize)kept * r, reduced->means + (gsize)k * r, sizeof(float) * r);
        memmove(reduced->bases + (gsize)kept * c * r, reduced->bases + (gsize)k * c * r,
                sizeof(float) * c * r);
        for (guint i = 0; i < members->len; i++)
            reduced->labels[g_array_index(members, int, i)] = kept;
        kept++;
    }
    reduced->k = kept;
}

/* Stores the number of the next iteration in run->state, which the checkpoint saves, with the
 * number of clusters. before is the sum of errors of the iteration before. */
static void keep(const struct lpca_reduced *reduced, int iteration, double before) {
    struct lpca_run *run = reduced->run;
    if (!run)
        return;
    run->state.k = reduced->k;
    run->state.iteration = iteration;
    run->state.before = before;
}

/* Reports progress, and saves the checkpoint if a save is due. If the work was cancelled, saves the
 * checkpoint at once and returns FALSE. */
static gboolean tell_and_save(const struct lpca_reduced *reduced, int done, gint64 begun,
                              GError **error) {
    const struct work *work = &reduced->options->work;
    const int total = MEANS_ITERATIONS + MAX_ITERATIONS;
    const double spent = (double)(g_get_monotonic_time() - begun) / G_USEC_PER_SEC;
    const struct work_progress progress = {"cluster", done, total,
                                           done > 0 ? spent / done * (total - done) : -1};
    if (work->progress)
        work->progress(&progress, work->data);
    const gboolean ok = !g_cancellable_set_error_if_cancelled(work->cancellable, error);
    if (reduced->run && reduced->options->checkpoint)
        (ok ? checkpoint_save_if_due : checkpoint_save)(reduced->options->checkpoint);
    return ok;
}

/* Lloyd's iteration, first as k-means and then as local PCA. Each iteration assigns the rows and
 * then finds means and axes. The iterations end when one lowers the sum of errors by a share of
 * less than SETTLED, or after MEANS_ITERATIONS + MAX_ITERATIONS. Then finds the exact axes and
 * drops empty clusters.
 *
 * Begins with iteration number `from`. `before` is the sum of errors of the iteration before, or
 * G_MAXDOUBLE at the start. Returns FALSE only if the work is cancelled. */
static gboolean iterate(struct lpca_reduced *reduced, int from, double before, GError **error) {
    g_autofree float *errors = g_new(float, reduced->n);
    const gint64 begun = g_get_monotonic_time();
    for (int i = from; reduced->k > 1 && i < MEANS_ITERATIONS + MAX_ITERATIONS; i++) {
        const gboolean means = i < MEANS_ITERATIONS;
        keep(reduced, i, before);
        if (!tell_and_save(reduced, i, begun, error))
            return FALSE;
        const double sum = assign(reduced, means ? 0 : reduced->c, errors);
        collect(reduced);
        refill(reduced, errors);
        update(reduced, i + 1 < MEANS_ITERATIONS    ? NO_AXES
                        : i + 1 == MEANS_ITERATIONS ? EXACT_AXES
                                                    : BETTER_AXES);
        if (i > MEANS_ITERATIONS && sum >= before * (1 - SETTLED))
            break;
        before = i < MEANS_ITERATIONS ? G_MAXDOUBLE : sum;
    }
    if (reduced->k == 1)
        collect(reduced);
    update(reduced, EXACT_AXES);
    drop_empty(reduced);
    if (reduced->run) {
        reduced->run->state.k = reduced->k;
        lpca_enter(reduced->run, LPCA_REFINING);
    }
    return tell_and_save(reduced, MEANS_ITERATIONS + MAX_ITERATIONS, begun, error);
}

gboolean lpca_cluster(struct lpca_reduced *reduced, GError **error) {
    struct lpca_run *run = reduced->run;
    const gsize k = (gsize)reduced->k, r = (gsize)reduced->r;
    reduced->labels = g_new0(int, reduced->n);
    reduced->means = g_new0(float, k *r);
    reduced->bases = g_new0(float, k *(gsize)reduced->c *r);
    reduced->members = g_ptr_array_new_with_free_func((GDestroyNotify)g_array_unref);
    for (gsize i = 0; i < k; i++)
        g_ptr_array_add(reduced->members, g_array_new(FALSE, FALSE, sizeof(int)));
    const int stage = run ? run->state.stage : LPCA_REDUCED;
    if (stage < LPCA_CLUSTERING)
        seed_means(reduced);
    if (run && stage < LPCA_CLUSTERING) {
        keep(reduced, 0, G_MAXDOUBLE);
        lpca_enter(run, LPCA_CLUSTERING);
    }
    /* lpca_keep() copies the arrays from the checkpoint if they are there, and registers them for
     * later saves */
    if (run) {
        reduced->k = run->state.k;
        lpca_keep(run, LPCA_KEPT_LABELS, reduced->labels);
    }
    if (run && run->state.stage <= LPCA_REFINING) {
        lpca_keep(run, LPCA_KEPT_MEANS, reduced->means);
        lpca_keep(run, LPCA_KEPT_BASES, reduced->bases);
    }
    g_ptr_array_set_size(reduced->members, reduced->k);
    if (stage >= LPCA_CLUSTERING)
        collect(reduced);
    if (stage > LPCA_CLUSTERING)
        return TRUE;
    return iterate(reduced, run ? run->state.iteration : 0, run ? run->state.before : G_MAXDOUBLE,
                   error);
}
