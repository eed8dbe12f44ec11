/* Covariance of the cameras, robust against errors that the corners of one picture have in common.
 * The symbols C, S, J_i and r_i are those of bundle_covariance() in bundle.h.
 *
 * Let JᵀJ = G Gᵀ (Cholesky), so C = G⁻ᵀ G⁻¹. Then Gᵀ S G = Σ y yᵀ. A row j of the priors
 * contributes y = G⁻¹ jᵀ, and a picture contributes y = G⁻¹ J_iᵀ (I − J_i C J_iᵀ)^−½ r_i. Only a
 * few columns of J_i are not 0. Let W = Q R be the same columns of G⁻¹, B = J_i Rᵀ and BᵀB = V
 * diag(l) Vᵀ. Then y = Q V diag((1 − l)^−½) Vᵀ Bᵀ r_i.
 *
 * For the parameters of one camera, let W = Q R be their columns of G⁻¹. Then C = RᵀR and S = Rᵀ (Σ
 * z zᵀ) R with z = Qᵀ y. In this way no nearly singular matrix is squared. The JᵀJ of a rational
 * lens is nearly singular. */
#include "bundle_private.h"

#include <lapacke.h>
#include <math.h>
#include <string.h>

/* Smallest 1 − l at which a direction of B is used, where l is an eigenvalue of BᵀB. */
#define MIN_LEFT  1e-6
#define MIN_RCOND 1e-15 /* smallest reciprocal condition number of the scaled JᵀJ */
/* largest number of columns in which the rows of one picture are not 0: those of its camera, lay
 * and angle, of the bend and of the wobble */
#define MAX_OWN (BUNDLE_CAMERA + 6 + 1 + 3 + BUNDLE_WOBBLE)

struct factor {
    int n;
    double *g; /* G, column by column, for JᵀJ scaled to a unit diagonal */
    /* The units differ by orders of magnitude: parameter = scale · scaled parameter. */
    double *scale;
};

/* Computes G and the scale. Returns FALSE if JᵀJ is singular or nearly so. */
static gboolean factorise(const struct bundle_linear *linear, struct factor *ret) {
    const int n = ret->n = linear->n_columns;
    double *g = ret->g = g_new0(double, (gsize)n *(gsize)n + 1), rcond = 0;
    ret->scale = g_new(double, n + 1);
    for (int row = 0; row < linear->n_rows; row++)
        for (int a = linear->rows[row]; a < linear->rows[row + 1]; a++)
            for (int b = linear->rows[row]; b < linear->rows[row + 1]; b++)
                g[(gsize)linear->columns[a] * (gsize)n + (gsize)linear->columns[b]] +=
                    linear->values[a] * linear->values[b];
    for (int i = 0; i < n; i++)
        ret->scale[i] = 1 / sqrt(MAX(g[(gsize)i * (gsize)n + (gsize)i], 1e-300));
    for (int i = 0; i < n; i++)
        for (int k = 0; k < n; k++)
            g[(gsize)i * (gsize)n + (gsize)k] *= ret->scale[i] * ret->scale[k];
    const double norm = LAPACKE_dlansy(LAPACK_COL_MAJOR, '1', 'L', n, g, n);
    return LAPACKE_dpotrf(LAPACK_COL_MAJOR, 'L', n, g, n) == 0 &&
           LAPACKE_dpocon(LAPACK_COL_MAJOR, 'L', n, g, n, norm, &rcond) == 0 && rcond >= MIN_RCOND;
}

/* Decomposes k columns of G⁻¹ into Q (n × k, column by column) and R (k × k, upper, row by row).
 * Returns FALSE if LAPACK fails. */
static gboolean columns_of_inverse(const struct factor *factor, const int *columns, int k,
                                   double *ret_q, double *ret_r) {
    const int n = factor->n;
    double tau[MAX_OWN];
    memset(ret_q, 0, sizeof *ret_q * (gsize)n * (gsize)k);
    for (int i = 0; i < k; i++)
        ret_q[(gsize)i * (gsize)n + (gsize)columns[i]] = 1;
    if (LAPACKE_dtrtrs(LAPACK_COL_MAJOR, 'L', 'N', 'N', n, k, factor->g, n, ret_q, n) != 0 ||
        LAPACKE_dgeqrf(LAPACK_COL_MAJOR, n, k, ret_q, n, tau) != 0)
        return FALSE;
    for (int i = 0; i < k; i++)
        for (int l = 0; l < k; l++)
            ret_r[i * k + l] = l < i ? 0 : ret_q[(gsize)l * (gsize)n + (gsize)i];
    return LAPACKE_dorgqr(LAPACK_COL_MAJOR, n, k, k, ret_q, n, tau) == 0;
}

/* Computes the score y of a picture. `rows` has the picture's rows of the Jacobian. k of their
 * columns are not 0. Where an eigenvalue l of BᵀB is 1, the fit follows this picture completely, so
 * the residuals contain no information. Such directions are left out. Returns FALSE if more than
 * MAX_OWN columns are not 0, or if LAPACK fails. */
static gboolean picture_score(const struct factor *factor, const struct bundle_linear *linear,
                              const GArray *rows, double *ret_y) {
    const int n = factor->n;
    int columns[MAX_OWN], k = 0;
    double r[MAX_OWN * MAX_OWN], v[MAX_OWN * MAX_OWN] = {0}, l[MAX_OWN];
    double towards[MAX_OWN] = {0}, along[MAX_OWN] = {0};
    g_autofree int *local = g_new(int, n + 1);
    g_autofree double *q = g_new(double, (gsize)n *MAX_OWN);
    memset(local, -1, sizeof *local * (gsize)n);
    for (guint i = 0; i < rows->len; i++) {
        const int row = g_array_index(rows, int, i);
        for (int a = linear->rows[row]; a < linear->rows[row + 1]; a++) {
            int *at = &local[linear->columns[a]];
            if (*at < 0 && k == MAX_OWN)
                return FALSE;
            if (*at < 0)
                columns[ *at = k++] = linear->columns[a];
        }
    }
    if (!columns_of_inverse(factor, columns, k, q, r))
        return FALSE;
    for (guint i = 0; i < rows->len; i++) { /* adds one row of B to BᵀB (v) and to Bᵀr (towards) */
        const int row = g_array_index(rows, int, i);
        double b[MAX_OWN] = {0};
        for (int a = linear->rows[row]; a < linear->rows[row + 1]; a++) {
            const int at = local[linear->columns[a]];
            const double value = linear->values[a] * factor->scale[linear->columns[a]];
            for (int c = 0; c <= at; c++)
                b[c] += value * r[c * k + at];
        }
        for (int a = 0; a < k; a++) {
            towards[a] += b[a] * linear->residuals[row];
            for (int c = 0; c <= a; c++)
                v[c * k + a] += b[a] * b[c]; /* the lower half, column by column */
        }
    }
    if (LAPACKE_dsyev(LAPACK_COL_MAJOR, 'V', 'L', k, v, k, l) != 0)
        return FALSE;
    for (int i = 0; i < k; i++) {
        double sum = 0;
        for (int a = 0; a < k; a++)
            sum += v[i * k + a] * towards[a];
        for (int a = 0; a < k && 1 - l[i] > MIN_LEFT; a++)
            along[a] += v[i * k + a] * sum / sqrt(1 - l[i]);
    }
    for (int i = 0; i < n; i++) {
        ret_y[i] = 0;
        for (int a = 0; a < k; a++)
            ret_y[i] += q[(gsize)a * (gsize)n + (gsize)i] * along[a];
    }
    return TRUE;
}

/* Computes the score y of one row of a prior. Returns FALSE if LAPACK fails. */
static gboolean prior_score(const struct factor *factor, const struct bundle_linear *linear,
                            int row, double *ret_y) {
    const int n = factor->n;
    memset(ret_y, 0, sizeof *ret_y * (gsize)n);
    for (int a = linear->rows[row]; a < linear->rows[row + 1]; a++)
        ret_y[linear->columns[a]] += linear->values[a] * factor->scale[linear->columns[a]];
    return LAPACKE_dtrtrs(LAPACK_COL_MAJOR, 'L', 'N', 'N', n, 1, factor->g, n, ret_y, n) == 0;
}

/* Returns the scores y of all pictures, then those of all rows of priors, as n doubles each.
 * Returns NULL if a score fails. */
static GArray *scores(const struct bundle *bundle, const struct factor *factor,
                      const struct bundle_linear *linear) {
    g_autoptr(GHashTable) pictures =
        g_hash_table_new_full(NULL, NULL, NULL, (GDestroyNotify)g_array_unref);
    g_autoptr(GArray) y = g_array_new(FALSE, FALSE, sizeof(double));
    GHashTableIter iter;
    gpointer rows;
    const guint n = (guint)factor->n;
    int row = 0;
    for (int i = 0; i < bundle->n_observations; i++) {
        const struct bundle_observation *o = &bundle->observations[i];
        if (o->rejected)
            continue;
        GArray *own = g_hash_table_lookup(pictures, GINT_TO_POINTER(o->picture));
        if (!own) {
            own = g_array_new(FALSE, FALSE, sizeof(int));
            g_hash_table_insert(pictures, GINT_TO_POINTER(o->picture), own);
        }
        for (int k = 0; k < 2; k++, row++)
            g_array_append_val(own, row);
    }
    g_hash_table_iter_init(&iter, pictures);
    while (g_hash_table_iter_next(&iter, NULL, &rows)) {
        g_array_set_size(y, y->len + n);
        if (!picture_score(factor, linear, rows, &g_array_index(y, double, y->len - n)))
            return NULL;
    }
    for (; row < linear->n_rows; row++) {
        g_array_set_size(y, y->len + n);
        if (!prior_score(factor, linear, row, &g_array_index(y, double, y->len - n)))
            return NULL;
    }
    return g_steal_pointer(&y);
}

static int pictures_of(const struct bundle *bundle, int camera) {
    g_autoptr(GHashTable) seen = g_hash_table_new(NULL, NULL);
    for (int i = 0; i < bundle->n_observations; i++) {
        const struct bundle_observation *o = &bundle->observations[i];
        if (!o->rejected && o->camera == camera)
            g_hash_table_add(seen, GINT_TO_POINTER(o->picture));
    }
    return (int)g_hash_table_size(seen);
}

/* Returns the 97.5 % quantile of Student's t divided by that of the normal distribution
 * (Cornish-Fisher expansion). */
static double student(int freedom) {
    const double z = 1.959964, z2 = z * z, v = MAX(freedom, 1);
    return 1 + (z2 + 1) / (4 * v) + ((5 * z2 + 16) * z2 + 3) / (96 * v * v) +
           (((3 * z2 + 19) * z2 + 17) * z2 - 15) / (384 * v * v * v);
}

/* Computes a camera's covariance V = g (n S + p f C) / (n + p) from n pictures and p parameters,
 * and its inflation f (bundle.h). y has the scores. `free` has the columns of the camera's p free
 * parameters. `at` has the index in `free` of each of the BUNDLE_CAMERA parameters, or −1. If p is
 * 0, V is 0 and f is 1. Returns FALSE if LAPACK fails. */
static gboolean camera_covariance(struct bundle_camera *camera, const struct factor *factor,
                                  const GArray *y, const int *free, int p, const int *at,
                                  int pictures, double *ret_f) {
    const gsize n = (gsize)factor->n;
    double r[BUNDLE_CAMERA * BUNDLE_CAMERA], s[BUNDLE_CAMERA][BUNDLE_CAMERA] = {{0}}, trace = 0;
    double half[BUNDLE_CAMERA][BUNDLE_CAMERA] = {{0}};
    g_autofree double *q = g_new(double, n *BUNDLE_CAMERA + 1);
    memset(camera->covariance, 0, sizeof camera->covariance);
    *ret_f = 1;
    if (p == 0)
        return TRUE;
    if (!columns_of_inverse(factor, free, p, q, r))
        return FALSE;
    for (gsize k = 0; k < y->len / n; k++) {
        const double *of = &g_array_index(y, double, k *n);
        double z[BUNDLE_CAMERA] = {0};
        for (int a = 0; a < p; a++)
            for (gsize i = 0; i < n; i++)
                z[a] += q[(gsize)a * n + i] * of[i];
        for (int a = 0; a < p; a++)
            for (int b = 0; b < p; b++)
                s[a][b] += z[a] * z[b];
    }
    for (int a = 0; a < p; a++)
        trace += s[a][a];
    *ret_f = MAX(trace / p, 1);
    const double t = student(pictures - 1), g = 1 + (t * t - 1) * (1 - 1 / *ret_f);
    for (int a = 0; a < p; a++)
        for (int b = 0; b < p; b++)
            s[a][b] = g * (pictures * s[a][b] + (a == b ? p * *ret_f : 0)) / (pictures + p);
    for (int a = 0; a < p; a++) /* Rᵀ s, then Rᵀ s R */
        for (int b = 0; b < p; b++)
            for (int i = 0; i <= a; i++)
                half[a][b] += r[i * p + a] * s[i][b];
    for (int a = 0; a < BUNDLE_CAMERA; a++)
        for (int b = 0; b <= a; b++) {
            double sum = 0;
            for (int i = 0; at[a] >= 0 && at[b] >= 0 && i <= at[b]; i++)
                sum += half[at[a]][i] * r[i * p + at[b]];
            if (at[a] >= 0 && at[b] >= 0)
                sum *= factor->scale[free[at[a]]] * factor->scale[free[at[b]]];
            camera->covariance[a][b] = camera->covariance[b][a] = sum;
        }
    return TRUE;
}

/* Sets wobble_error_rad to the square root of the trace of the wobble's part of C. This is the
 * RMS tilt error, because the mean of |tilt|² over a turn is Σ |z_n|². If the wobble is not
 * adjusted, the error is 0. Returns FALSE if LAPACK fails. */
static gboolean wobble_error(struct bundle *bundle, const struct factor *factor,
                             const struct bundle_linear *linear) {
    const int k = linear->n_wobble;
    int columns[BUNDLE_WOBBLE] = {0};
    double r[BUNDLE_WOBBLE * BUNDLE_WOBBLE], sum = 0;
    g_autofree double *q = g_new(double, (gsize)factor->n *BUNDLE_WOBBLE + 1);
    bundle->wobble_error_rad = 0;
    if (linear->wobble < 0 || k == 0)
        return TRUE;
    for (int i = 0; i < k; i++)
        columns[i] = linear->wobble + i;
    if (!columns_of_inverse(factor, columns, k, q, r))
        return FALSE;
    for (int i = 0; i < k; i++)
        for (int l = 0; l < k; l++)
            sum += pow(r[l * k + i] * factor->scale[columns[i]], 2);
    bundle->wobble_error_rad = sqrt(sum);
    return TRUE;
}

gboolean bundle_scatter(struct bundle *bundle, const struct bundle_linear *linear,
                        double *ret_inflation, GError **error) {
    struct factor factor;
    g_autoptr(GArray) y = NULL;
    gboolean ok = factorise(linear, &factor) && (y = scores(bundle, &factor, linear)) &&
                  wobble_error(bundle, &factor, linear);
    for (int i = 0; ok && i < bundle->n_cameras; i++) {
        /* Columns in the order of the covariance: fx … p2, ω, shift, k4, k5, k6. */
        int of_lens[BUNDLE_INTRINSICS], free[BUNDLE_CAMERA], at[BUNDLE_CAMERA], p = 0;
        int lens = linear->lens[i];
        double f;
        for (int k = 0; k < BUNDLE_INTRINSICS; k++)
            of_lens[k] = lens >= 0 && bundle_has(bundle->cameras[i].lens, k) ? lens++ : -1;
        for (int k = 0; k < BUNDLE_CAMERA; k++) {
            const int pose = linear->pose[i] < 0 ? -1 : linear->pose[i] + k - 9;
            const int column = k < 9 ? of_lens[k] : k < 15 ? pose : of_lens[k - 6];
            at[k] = column < 0 ? -1 : p;
            if (column >= 0)
                free[p++] = column;
        }
        ok = camera_covariance(&bundle->cameras[i], &factor, y, free, p, at, pictures_of(bundle, i),
                               &f);
        if (ok && ret_inflation)
            ret_inflation[i] = f;
    }
    g_free(factor.g);
    g_free(factor.scale);
    if (!ok)
        g_set_error_literal(error, BUNDLE_ERROR, BUNDLE_ERROR_SINGULAR,
                            "the joint refinement of cameras and boards has failed: the pictures "
                            "do not determine all parameters; take more pictures, with the board "
                            "at several tilts, and on a turntable at angles all around");
    return ok;
}
