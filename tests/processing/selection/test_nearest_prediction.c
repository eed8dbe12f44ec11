/* Missing pairs predicted from their nearest neighbours, against values that follow from a formula,
 * against the prediction from all measured pairs, and the expected error against the true one. */
#include <math.h>
#include <string.h>

#include "lib/direction.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "selection/nearest_prediction.h"

enum { VIEWS = 24, LIGHTS = 32, PAIRS = VIEWS * LIGHTS, PROBES = 24, ROWS = 3 * PROBES };

static struct vec3 views[VIEWS], lights[LIGHTS];
static int groups[PAIRS];
static const struct prediction_pairs pairs = {VIEWS, LIGHTS, views, lights, .groups = groups};

/* Rings of eight: three of views, four of lights. A group is a light at one of eight angles of the
 * turntable, seen by three cameras. */
static void make_pairs(void) {
    for (int v = 0; v < VIEWS; v++)
        views[v] = direction_of_deg(15 + 25 * (v / 8), 45 * (v % 8));
    for (int l = 0; l < LIGHTS; l++)
        lights[l] = direction_of_deg(15 + 18 * (l / 8), 45 * (l % 8) + 20);
    for (int p = 0; p < PAIRS; p++)
        groups[p] = p / LIGHTS % 8 * LIGHTS + p % LIGHTS;
}

/* A diffuser with a tilted normal under a broad highlight, of each row's own albedo. */
static float value(int row, int pair) {
    const struct vec3 v = views[pair / LIGHTS], l = lights[pair % LIGHTS];
    const struct vec3 n = direction_of_deg(4 * (row % 7), 40 * (row % 9));
    const struct vec3 h = vec3_unit(vec3_add(v, l));
    const double albedo = 0.2 + 0.1 * (row % 6);
    return (float)(albedo * fmax(vec3_dot(n, l), 0) + 0.2 * exp(-20 * (1 - vec3_dot(h, n))));
}

/* Returns the table of all probes, with a share of the groups measured in a multiplicative order.
 */
static float *make_table(double share) {
    float *table = g_new(float, ROWS *PAIRS);
    for (int p = 0; p < PAIRS; p++)
        for (int r = 0; r < ROWS; r++)
            table[r * PAIRS + p] =
                (groups[p] * 29 + 11) % 256 < 256 * share ? value(r, p) : (float)NAN;
    return table;
}

/* Returns the predicted value of a missing pair in a row. */
static double predicted(const NearestPrediction *prediction, const float *table, int row,
                        int pair) {
    const int *near;
    const float *weights;
    const int n = nearest_prediction_weights(prediction, pair, &near, &weights);
    double own[3], of[3], sum = 0;
    g_assert_cmpint(n, >, 0);
    g_assert_cmpint(n, <=, NEAREST_NEIGHBOURS);
    nearest_prediction_mean(prediction, vec3(0, 0, 0), pair, own);
    for (int i = 0; i < n; i++) {
        g_assert_true(isfinite(table[row * PAIRS + near[i]]));
        nearest_prediction_mean(prediction, vec3(0, 0, 0), near[i], of);
        sum += (double)(weights[i] * table[row * PAIRS + near[i]]) * own[row % 3] / of[row % 3];
    }
    return fmax(sum, 0);
}

/* Returns the relative error of all values, in which measured ones are exact. If pair is not
 * negative, returns that of one pair. */
static double true_error(const NearestPrediction *prediction, const float *table, int pair) {
    double squares = 0, energy = 0;
    for (int p = 0; p < PAIRS; p++)
        for (int r = 0; r < ROWS && (pair < 0 || p == pair); r++) {
            const double truth = value(r, p);
            energy += truth * truth;
            if (isnan(table[r * PAIRS + p]))
                squares += pow(predicted(prediction, table, r, p) - truth, 2);
        }
    return sqrt(squares / energy);
}

static double error_of_all_pairs(const float *table) {
    g_autofree float *filled = g_memdup2(table, sizeof *table * ROWS * PAIRS);
    g_autoptr(Prediction) prediction = ok(prediction_new(&pairs, table, NULL, PROBES, NULL, ERR));
    double squares = 0, energy = 0;
    prediction_fill(prediction, filled, NULL, PROBES, NULL);
    for (int p = 0; p < PAIRS; p++)
        for (int r = 0; r < ROWS; r++) {
            const double truth = value(r, p);
            squares += pow((double)filled[r * PAIRS + p] - truth, 2);
            energy += truth * truth;
        }
    return sqrt(squares / energy);
}

TEST(missing_pairs) {
    static const double shares[] = {0.15, 0.3, 0.6};
    double before = 1;
    for (gsize i = 0; i < G_N_ELEMENTS(shares); i++) {
        g_autofree float *table = make_table(shares[i]);
        g_autoptr(NearestPrediction) prediction =
            ok(nearest_prediction_new(&pairs, table, NULL, PROBES, NULL, NULL, ERR));
        const double is = true_error(prediction, table, -1), all = error_of_all_pairs(table);
        const double expected = nearest_prediction_error(prediction);
        g_test_message("%.2f of the shots: error %.4f, expected %.4f, from all pairs %.4f",
                       shares[i], is, expected, all);
        g_assert_cmpfloat(is, <, before);
        g_assert_cmpfloat(is, <, 1.75 * all);
        double range[2];
        nearest_prediction_error_range(prediction, range);
        g_test_message("range %.4f to %.4f", range[0], range[1]);
        g_assert_cmpfloat(expected, >, is / 1.5);
        g_assert_cmpfloat(expected, <, is * 1.5);
        g_assert_cmpfloat(fabs(range[0] * range[1] - expected * expected), <, 1e-9);
        g_assert_cmpfloat(range[1], >, 1.05 * expected);
        g_assert_cmpfloat(range[1], <, 2 * expected);
        before = is;
    }
}

/* The expected errors of pairs have the mean of the true ones, and their sum is the expected error
 * of all. */
TEST(each_pair) {
    g_autofree float *table = make_table(0.3);
    g_autoptr(NearestPrediction) prediction =
        ok(nearest_prediction_new(&pairs, table, NULL, PROBES, NULL, NULL, ERR));
    double expected = 0, is = 0;
    int missing = 0;
    for (int p = 0; p < PAIRS; p++) {
        const double one = nearest_prediction_pair_error(prediction, p);
        const int *near;
        const float *weights;
        if (!isnan(table[p])) {
            g_assert_cmpfloat(one, ==, 0);
            g_assert_cmpint(nearest_prediction_weights(prediction, p, &near, &weights), ==, 0);
            continue;
        }
        g_assert_cmpfloat(one, >, 0);
        expected += one;
        is += true_error(prediction, table, p);
        missing++;
    }
    g_test_message("mean of %d pairs: %.4f, expected %.4f", missing, is / missing,
                   expected / missing);
    g_assert_cmpfloat(expected, >, is / 2);
    g_assert_cmpfloat(expected, <, 2 * is);
}

/* The error that is expected after further shots is about the error that is expected once they are
 * taken, and 0 after all of them. */
TEST(looks_ahead) {
    g_autofree float *table = make_table(0.25), *later = make_table(0.5);
    g_autoptr(NearestPrediction) now =
        ok(nearest_prediction_new(&pairs, table, NULL, PROBES, NULL, NULL, ERR));
    g_autoptr(NearestPrediction) then =
        ok(nearest_prediction_new(&pairs, later, NULL, PROBES, now, NULL, ERR));
    g_autofree gboolean *more = g_new(gboolean, PAIRS);
    for (int p = 0; p < PAIRS; p++)
        more[p] = !isnan(later[p]);
    const double looked = nearest_prediction_error_after(now, more, 200);
    g_test_message("now %.4f, ahead %.4f, then %.4f", nearest_prediction_error(now), looked,
                   nearest_prediction_error(then));
    g_assert_cmpfloat(looked, <, nearest_prediction_error(now));
    g_assert_cmpfloat(looked, >, nearest_prediction_error(then) / 1.5);
    g_assert_cmpfloat(looked, <, nearest_prediction_error(then) * 1.5);
    for (int p = 0; p < PAIRS; p++)
        more[p] = TRUE;
    g_assert_cmpfloat(nearest_prediction_error_after(now, more, 200), ==, 0);
}

/* Below the lowest measured light, the mean material becomes darker like a diffuser, even if it has
 * become darker faster between the measured lights. */
TEST(low_lights) {
    const double lowest = cos(51 * G_PI / 180), low = cos(69 * G_PI / 180);
    g_autofree float *table = g_new(float, ROWS *PAIRS);
    double g[3];
    for (int p = 0; p < PAIRS; p++)
        for (int r = 0; r < ROWS; r++) {
            const double z = lights[p % LIGHTS].z;
            table[r * PAIRS + p] =
                p % LIGHTS < 24 ? (float)(0.5 * z * exp(-5 * (1 - z))) : (float)NAN;
        }
    g_autoptr(NearestPrediction) prediction =
        ok(nearest_prediction_new(&pairs, table, NULL, PROBES, NULL, NULL, ERR));
    const double expected = 0.5 * low * exp(-5 * (1 - lowest));
    nearest_prediction_mean(prediction, vec3(0, 0, 0), LIGHTS - 1, g);
    g_test_message("mean at a low light %.4f, of a diffuser %.4f", g[0], expected);
    g_assert_cmpfloat(fabs(g[0] / expected - 1), <, 0.15);
}

/* A highlight that becomes brighter towards the directions that are missing is limited to what was
 * measured, and the error of a missing pair is expected to be as large as what the limit takes. */
TEST(bright_highlights) {
    g_autofree float *table = g_new(float, ROWS *PAIRS);
    double g[3], brightest = 0, missing = 0;
    for (int p = 0; p < PAIRS; p++) {
        const struct vec3 v = views[p / LIGHTS], l = lights[p % LIGHTS];
        const struct vec3 h = vec3_unit(vec3_add(v, l));
        const double lobe = exp(-3 * (h.x * h.x + h.y * h.y) / (h.z * h.z)) / (v.z * l.z);
        const gboolean known = p % LIGHTS < 24;
        for (int r = 0; r < ROWS; r++)
            table[r * PAIRS + p] = known ? (float)(0.3 * l.z + 0.3 * lobe) : (float)NAN;
        if (known)
            brightest = fmax(brightest, 0.3 * l.z + 0.3 * lobe);
    }
    g_autoptr(NearestPrediction) prediction =
        ok(nearest_prediction_new(&pairs, table, NULL, PROBES, NULL, NULL, ERR));
    for (int p = 0; p < PAIRS; p++) {
        nearest_prediction_mean(prediction, vec3(0, 0, 0), p, g);
        g_assert_cmpfloat(g[0], <, 1.05 * brightest);
        missing = fmax(missing, nearest_prediction_pair_error(prediction, p));
    }
    double range[2];
    nearest_prediction_error_range(prediction, range);
    g_test_message("largest expected error %.3f, range %.3f to %.3f", missing, range[0], range[1]);
    g_assert_cmpfloat(missing, >, 0.2);
}

TEST(ends) {
    g_autofree float *none = make_table(0), *all = make_table(1);
    g_autoptr(NearestPrediction) nothing =
        ok(nearest_prediction_new(&pairs, none, NULL, PROBES, NULL, NULL, ERR));
    g_autoptr(NearestPrediction) whole =
        ok(nearest_prediction_new(&pairs, all, NULL, PROBES, NULL, NULL, ERR));
    const int *near;
    const float *weights;
    g_assert_cmpfloat(nearest_prediction_error(nothing), ==, 1);
    g_assert_cmpfloat(nearest_prediction_pair_error(nothing, 3), ==, 1);
    g_assert_cmpint(nearest_prediction_weights(nothing, 3, &near, &weights), ==, 0);
    g_assert_cmpfloat(nearest_prediction_error(whole), ==, 0);
    g_assert_cmpfloat(nearest_prediction_pair_error(whole, 3), ==, 0);
}

BEFORE_TESTS {
    make_pairs();
}
