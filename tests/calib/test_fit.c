/* Robust least squares against the closed form of a straight line. */
#include "geometry/fit.h"
#include "lib/test.h"

#include <math.h>

#define N 400

struct line {
    double x[N], y[N];
};

static int n_evaluations;

static void residuals(const double *p, double *ret, gconstpointer data) {
    const struct line *line = data;
    n_evaluations++;
    for (int i = 0; i < N; i++)
        ret[i] = (line->y[i] - p[0] - p[1] * line->x[i]) / 0.1;
}

/* Points on 2 + 3x with deviations of 0.2, although 0.1 is given as their standard deviation, and
 * 40 outliers. */
static void make(struct line *line, GRand *rand) {
    for (int i = 0; i < N; i++) {
        line->x[i] = g_rand_double_range(rand, -1, 1);
        double sum = -6;
        for (int k = 0; k < 12; k++)
            sum += g_rand_double(rand);
        line->y[i] = 2 + 3 * line->x[i] + 0.2 * sum + (i % 10 == 0 ? 5 : 0);
    }
}

TEST(line_with_outliers) {
    g_autoptr(GRand) rand = g_rand_new_with_seed(1);
    double chi2 = 0;
    for (int trial = 0; trial < 40; trial++) {
        struct line line;
        struct fit_result result;
        double p[2] = {0, 0}, sx = 0, sxx = 0, n = 0, sy = 0, sxy = 0;
        make(&line, rand);
        const struct fit fit = {2, N, 1, residuals, &line, 4.5};
        g_assert_true(fit_solve(&fit, p, &result));
        for (int i = 0; i < N; i++) {
            g_assert_true(result.rejected[i] || i % 10 != 0);
            if (result.rejected[i])
                continue;
            n++, sx += line.x[i], sxx += line.x[i] * line.x[i];
            sy += line.y[i], sxy += line.x[i] * line.y[i];
        }
        double det = n * sxx - sx * sx, b = (n * sxy - sx * sy) / det, a = (sy - b * sx) / n;
        g_assert_cmpfloat_with_epsilon(p[0], a, 1e-7);
        g_assert_cmpfloat_with_epsilon(p[1], b, 1e-7);
        g_assert_cmpint(result.undetermined, ==, -1);
        g_assert_cmpfloat_with_epsilon(result.sigma, 2, 0.2);
        g_assert_cmpfloat_with_epsilon(result.covariance[3] / (0.01 * n / det),
                                       result.sigma * result.sigma, 1e-3);
        g_assert_cmpfloat_with_epsilon(result.covariance[1] / (-0.01 * sx / det),
                                       result.sigma * result.sigma, 1e-3);
        chi2 += pow((p[0] - 2) / fit_error(&fit, &result, 0), 2) / 80 +
                pow((p[1] - 3) / fit_error(&fit, &result, 1), 2) / 80;
        fit_result_clear(&result);
    }
    g_assert_cmpfloat(chi2, >, 0.6);
    g_assert_cmpfloat(chi2, <, 1.5);
}

/* From a solution, the same is found in fewer steps. */
TEST(near_a_solution) {
    g_autoptr(GRand) rand = g_rand_new_with_seed(4);
    struct line line;
    struct fit_result first, again;
    double p[2] = {0, 0}, q[2];
    make(&line, rand);
    struct fit fit = {2, N, 1, residuals, &line, 4.5};
    n_evaluations = 0;
    g_assert_true(fit_solve(&fit, p, &first));
    q[0] = p[0] + 1e-3, q[1] = p[1] - 1e-3;
    fit.is_near = TRUE;
    const int from_far = n_evaluations;
    g_assert_true(fit_solve(&fit, q, &again));
    g_test_message("%d evaluations, and %d", from_far, n_evaluations - from_far);
    g_assert_cmpint(2 * (n_evaluations - from_far), <, from_far);
    for (int k = 0; k < 2; k++)
        g_assert_cmpfloat_with_epsilon(q[k], p[k], 1e-7);
    g_assert_cmpint(again.n_used, ==, first.n_used);
    g_assert_cmpfloat_with_epsilon(again.sigma, first.sigma, 1e-9);
    fit_result_clear(&first);
    fit_result_clear(&again);
}

static void twice_the_same(const double *p, double *ret, gconstpointer data) {
    const struct line *line = data;
    for (int i = 0; i < N; i++)
        ret[i] = line->y[i] - (p[0] + p[1]) - p[2] * line->x[i];
}

TEST(undetermined) {
    g_autoptr(GRand) rand = g_rand_new_with_seed(2);
    struct line line;
    struct fit_result result;
    double p[3] = {0, 0, 0};
    make(&line, rand);
    const struct fit fit = {3, N, 1, twice_the_same, &line, 4.5};
    g_assert_true(fit_solve(&fit, p, &result));
    g_assert_cmpint(result.undetermined, >=, 0);
    g_assert_cmpint(result.undetermined, <=, 1);
    fit_result_clear(&result);
}

TEST(refused) {
    struct line line = {{0}, {0}};
    struct fit_result result;
    double p[2] = {0, 0};
    const struct fit few = {2, 2, 1, residuals, &line, 4.5};
    const struct fit fit = {2, N, 1, residuals, &line, 4.5};
    g_assert_false(fit_solve(&few, p, &result));
    line.y[7] = NAN;
    g_assert_false(fit_solve(&fit, p, &result));
}
