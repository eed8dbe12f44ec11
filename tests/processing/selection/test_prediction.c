/* Predicted pairs of directions against values that follow from a formula, and the choice of the
 * next shots against a search over all. */
#include <cblas.h>
#include <math.h>
#include <string.h>

#include "base/data_error.h"
#include "lib/direction.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "selection/prediction.h"

#define VIEWS  12
#define LIGHTS 16
#define PAIRS  (VIEWS * LIGHTS)
#define PROBES 40

static struct vec3 views[VIEWS], lights[LIGHTS];
static int groups[PAIRS];
static struct prediction_pairs pairs = {VIEWS, LIGHTS, views, lights, .groups = groups};

/* Rings of four: three of views, four of lights. A group is a light at one of four angles of the
 * turntable, seen by three cameras. */
static void make_pairs(void) {
    for (int v = 0; v < VIEWS; v++)
        views[v] = direction_of_deg(15 + 25 * (v / 4), 90 * (v % 4));
    for (int l = 0; l < LIGHTS; l++)
        lights[l] = direction_of_deg(15 + 18 * (l / 4), 90 * (l % 4) + 30);
    for (int p = 0; p < PAIRS; p++)
        groups[p] = p / LIGHTS % 4 * LIGHTS + p % LIGHTS;
}

/* A diffuser with a tilted normal under a broad highlight, of each row's own albedo. */
static float value(int row, int pair) {
    const struct vec3 v = views[pair / LIGHTS], l = lights[pair % LIGHTS];
    const struct vec3 n = direction_of_deg(3 * (row % 7), 40 * (row % 9));
    const struct vec3 h = vec3_unit(vec3_add(v, l));
    const double albedo = 0.2 + 0.1 * (row % 6);
    return (float)(albedo * fmax(vec3_dot(n, l), 0) + 0.2 * exp(-20 * (1 - vec3_dot(h, n))));
}

/* Whether the group of a pair is measured: a share of them, spread by a multiplicative order. */
static gboolean taken(int group, double share) {
    return (group * 29 + 11) % 64 < 64 * share;
}

static float *make_rows(int n, double share) {
    float *rows = g_new(float, n *PAIRS);
    for (int r = 0; r < n; r++)
        for (int p = 0; p < PAIRS; p++)
            rows[r * PAIRS + p] = taken(groups[p], share) ? value(r, p) : NAN;
    return rows;
}

static Prediction *predict(double share) {
    g_autofree float *probes = make_rows(3 * PROBES, share);
    Prediction *prediction = ok(prediction_new(&pairs, probes, NULL, PROBES, NULL, ERR));
    return prediction;
}

/* Of rows that were no probes: the error of missing pairs, relative to a diffuser's own (each
 * missing value being the row's albedo times cos θ), and how many lie within 2 σ. */
TEST(missing_pairs) {
    const int n = 60;
    g_autoptr(Prediction) prediction = predict(0.5);
    g_autofree float *rows = make_rows(3 * PROBES + n, 0.5);
    g_autofree float *sigma = g_new(float, n *PAIRS);
    float *filled = rows + 3 * PROBES * PAIRS;
    prediction_fill(prediction, filled, NULL, n / 3, sigma);
    double squares = 0, energy = 0;
    int within = 0, missing = 0;
    for (int r = 0; r < n; r++)
        for (int p = 0; p < PAIRS; p++) {
            const float truth = value(3 * PROBES + r, p);
            const double off = (double)(filled[r * PAIRS + p] - truth);
            energy += (double)truth * (double)truth;
            if (prediction_is_measured(prediction, p)) {
                g_assert_cmpfloat(off, ==, 0);
                g_assert_cmpfloat(sigma[r * PAIRS + p], ==, 0);
                continue;
            }
            squares += off * off;
            missing++;
            within += fabs(off) <= 2 * (double)sigma[r * PAIRS + p];
        }
    const double error = sqrt(squares / energy);
    g_test_message("error %.4f, expected %.4f, left out %.4f; within 2 σ %.3f", error,
                   prediction_error(prediction), prediction_left_out_error(prediction),
                   (double)within / missing);
    g_assert_cmpint(missing, ==, n * PAIRS / 2);
    g_assert_cmpfloat(error, <, 0.05);
    g_assert_cmpfloat(error, <, 2 * prediction_error(prediction));
    g_assert_cmpfloat(error, >, 0.5 * prediction_error(prediction));
    g_assert_cmpfloat((double)within / missing, >, 0.9);
}

/* Scaling all values scales predictions and error bars. */
TEST(scale) {
    g_autoptr(Prediction) prediction = predict(0.25);
    g_autofree float *one = make_rows(3, 0.25), *two = make_rows(3, 0.25);
    float sigma_one[3 * PAIRS], sigma_two[3 * PAIRS];
    for (int p = 0; p < 3 * PAIRS; p++)
        two[p] *= 4;
    prediction_fill(prediction, one, NULL, 1, sigma_one);
    prediction_fill(prediction, two, NULL, 1, sigma_two);
    for (int p = 0; p < 3 * PAIRS; p++) {
        g_assert_cmpfloat_with_epsilon(two[p], 4 * one[p], 1e-5);
        g_assert_cmpfloat_with_epsilon(sigma_two[p], 4 * sigma_one[p], 1e-5);
    }
}

static struct prediction_shot shots[64];
static int shot_pairs[64][3];

static void make_shots(void) {
    int n[64] = {0};
    for (int p = 0; p < PAIRS; p++)
        shot_pairs[groups[p]][n[groups[p]]++] = p;
    for (int s = 0; s < 64; s++)
        shots[s] = (struct prediction_shot){shot_pairs[s], 3, 1};
}

/* The expected error falls with each choice, begins where the prediction is, and is what a
 * prediction would expect that has the chosen ones as well; all of it the same with other threads.
 */
TEST(choice) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Prediction) prediction = predict(0.25);
    gboolean done[64];
    struct prediction_choice choices[64], again[64];
    const struct work one = {.n_threads = 1}, four = {.n_threads = 4};
    for (int s = 0; s < 64; s++)
        done[s] = taken(s, 0.25);
    const int n = ok(prediction_choose(prediction, shots, 64, done, 64, choices, &one, ERR));
    g_assert_cmpint(n, ==, 48);
    g_assert_cmpfloat_with_epsilon(choices[0].error_before, prediction_error(prediction), 1e-9);
    for (int k = 0; k < n; k++) {
        g_assert_false(done[choices[k].shot]);
        done[choices[k].shot] = TRUE;
        g_assert_cmpfloat(choices[k].error_after, <, choices[k].error_before);
    }
    g_assert_cmpfloat(choices[n - 1].error_after, ==, 0);
    for (int s = 0; s < 64; s++)
        done[s] = taken(s, 0.25);
    openblas_set_num_threads(4);
    prediction_choose(prediction, shots, 64, done, 64, again, &four, &error);
    openblas_set_num_threads(1);
    for (int k = 0; k < n; k++) {
        g_assert_cmpint(choices[k].shot, ==, again[k].shot);
        g_assert_cmpfloat(choices[k].error_before, ==, again[k].error_before);
        g_assert_cmpfloat(choices[k].error_after, ==, again[k].error_after);
    }
}

/* The first choice gains most for its price among all; one that costs ten times as much waits. */
TEST(price) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Prediction) prediction = predict(0.25);
    gboolean all_but[64], done[64];
    struct prediction_choice first, alone;
    double best = 0;
    int best_shot = -1;
    for (int s = 0; s < 64; s++)
        done[s] = taken(s, 0.25);
    g_assert_cmpint(prediction_choose(prediction, shots, 64, done, 1, &first, NULL, &error), ==, 1);
    for (int s = 0; s < 64; s++) {
        for (int k = 0; k < 64; k++)
            all_but[k] = k != s;
        if (done[s] ||
            prediction_choose(prediction, shots, 64, all_but, 1, &alone, NULL, &error) != 1)
            continue;
        const double gain =
            alone.error_before * alone.error_before - alone.error_after * alone.error_after;
        best_shot = gain > best ? s : best_shot;
        best = fmax(gain, best);
    }
    g_assert_cmpint(first.shot, ==, best_shot);
    shots[first.shot].price_s = 10;
    prediction_choose(prediction, shots, 64, done, 1, &alone, NULL, &error);
    g_assert_cmpint(alone.shot, !=, first.shot);
    shots[first.shot].price_s = 1;
}

/* Where nothing is measured, fewer are the first of more, and all views and lights come early. */
TEST(start) {
    g_autoptr(GError) error = NULL;
    int views_seen = 0, lights_seen = 0;
    struct prediction_choice few[8], more[24];
    g_autoptr(Prediction) none = ok(prediction_new(&pairs, NULL, NULL, 0, NULL, ERR));
    g_assert_cmpint(prediction_choose(none, shots, 64, NULL, 8, few, NULL, &error), ==, 8);
    g_assert_cmpint(prediction_choose(none, shots, 64, NULL, 24, more, NULL, &error), ==, 24);
    for (int k = 0; k < 8; k++)
        g_assert_cmpint(few[k].shot, ==, more[k].shot);
    for (int k = 0; k < 24; k++) {
        views_seen |= 1 << more[k].shot / LIGHTS;
        lights_seen |= 1 << more[k].shot % LIGHTS;
    }
    g_assert_cmpint(views_seen, ==, 0xf);
    g_assert_cmpint(lights_seen, ==, 0xffff);
}

/* Rows that lack a measured value tell nothing; if none has all, that is an error. Where nothing is
 * measured, nothing is known. */
TEST(refused) {
    g_autoptr(GError) error = NULL;
    g_autofree float *probes = make_rows(3, 0.25);
    for (int r = 0, p = 0; r < 3; r++, p++) {
        while (!isfinite(probes[r * PAIRS + p]))
            p++;
        probes[r * PAIRS + p] = NAN;
    }
    g_assert_null(prediction_new(&pairs, probes, NULL, 1, NULL, &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
    g_clear_error(&error);
    for (int p = 0; p < 3 * PAIRS; p++)
        probes[p] = NAN;
    g_autoptr(Prediction) none = prediction_new(&pairs, probes, NULL, 1, NULL, &error);
    g_assert_no_error(error);
    for (int p = 0; p < PAIRS; p++)
        g_assert_false(prediction_is_measured(none, p));
    g_assert_cmpfloat(prediction_error(none), ==, 1);
}

/* All pairs up to the maximum, and an evenly spread part of more. */
TEST(most_measured) {
    const int most = PREDICTION_MAX_MEASURED, numbers[] = {1, 7, most, most + 1, 9216, 3 * most};
    for (gsize i = 0; i < G_N_ELEMENTS(numbers); i++) {
        const int n = numbers[i], gap = (n + most - 1) / most;
        int used = 0, last = -1;
        for (int k = 0; k < n; k++)
            if (prediction_uses(k, n)) {
                g_assert_cmpint(k - last, <=, gap);
                last = k;
                used++;
            }
        g_assert_cmpint(used, ==, MIN(n, most));
        g_assert_cmpint(n - 1 - last, <, gap);
    }
}

BEFORE_TESTS {
    make_pairs();
    make_shots();
}
