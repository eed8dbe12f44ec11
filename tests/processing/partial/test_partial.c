/* The pictures of a session while it is captured, against the BTF that processing makes of it, and
 * the prediction of the others against the pictures that are taken later. */
#include <math.h>
#include <string.h>

#include "btf/btf.h"
#include "lib/capture_run.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/test.h"
#include "partial/partial_forecast.h"
#include "partial/shared_exponent.h"
#include "pipeline/pipeline.h"

enum { VIEWS = 16, LIGHTS = 16, PAIRS = VIEWS * LIGHTS, TEXELS = 8, VALUES = 3 * TEXELS * TEXELS };
static const struct change changes[] = {
    {"[sample]", "width_mm = 30"}, /* which all cameras see at all angles */
    {"[sample]", "height_mm = 30"},
    {"[views]", "rings = 30:8; 60:8"},
    {"[lights]", "rings = 30:8; 60:8"},
    {"[lasers]", NULL},
    {NULL, NULL},
};

TEST(shared_exponent) {
    g_autoptr(GRand) random = g_rand_new_with_seed(1);
    for (int i = 0; i < 10000; i++) {
        const double level = exp(g_rand_double_range(random, -8, 8));
        float rgb[3], back[3], most = 0;
        for (int c = 0; c < 3; c++)
            most = fmaxf(most, rgb[c] = (float)(level * g_rand_double(random)));
        shared_exponent_unpack(shared_exponent_pack(rgb), back);
        for (int c = 0; c < 3; c++)
            g_assert_cmpfloat(fabsf(back[c] - rgb[c]), <=, most / 511);
    }
    /* the texel that the specification of EXT_texture_shared_exponent calls the largest */
    const float large[3] = {1e9f, -1, NAN}, one[3] = {1, 0.5f, 0};
    float back[3];
    g_assert_cmphex(shared_exponent_pack(large), ==, 0xf80001ff);
    g_assert_cmphex(shared_exponent_pack(one), ==, 0x80000000 | 128 << 9 | 256);
    shared_exponent_unpack(0xf80001ff, back);
    g_assert_cmpfloat(back[0], ==, SHARED_EXPONENT_MAX);
}

static void unpack(GBytes *picture, float ret[VALUES]) {
    gsize n;
    const guint32 *texels = g_bytes_get_data(picture, &n);
    g_assert_cmpuint(n, ==, 4 * TEXELS * TEXELS);
    for (int i = 0; i < TEXELS * TEXELS; i++)
        shared_exponent_unpack(texels[i], ret + 3 * i);
}

static int read_all(Partial *partial, int most) {
    g_autoptr(GArray) pairs = g_array_new(FALSE, FALSE, sizeof(int));
    g_autofree char *problem = NULL;
    ok(partial_read(partial, most, pairs, &problem, ERR));
    g_assert_cmpstr(problem, ==, NULL);
    for (guint i = 0; i < pairs->len; i++)
        g_assert_nonnull(partial_picture(partial, g_array_index(pairs, int, i)));
    return (int)pairs->len;
}

/* Returns the number of pictures under lamps that the session has. */
static int count_pictures(const char *path) {
    g_autoptr(GPtrArray) frames = run_frames(path), shots = run_shots(path);
    int n = 0;
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        n += ((const struct session_shot *)shots->pdata[frame->shot - 1])->kind == SHOT_LAMP;
    }
    return n;
}

/* Every picture of the BTF, at its own texels, is the picture that was shown during the capture. */
static void compare_with_btf(const Partial *partial, const char *path) {
    struct pipeline_options options = {.n_eigenmaps = 1};
    struct pipeline_result result;
    ok(pipeline_run(path, &options, &result, ERR));
    double squares = 0, energy = 0;
    for (int v = 0; v < VIEWS; v++) {
        g_autofree char *file = g_strdup_printf("%s/products/btf/view_%04d.exr", path, v);
        g_autofree float *truth = g_new(float, LIGHTS *VALUES);
        int lights[LIGHTS];
        for (int l = 0; l < LIGHTS; l++)
            lights[l] = l;
        ok(btf_read_view(file, lights, LIGHTS, partial_grid(partial), 0, truth, ERR));
        for (int l = 0; l < LIGHTS; l++) {
            float values[VALUES];
            unpack(partial_picture(partial, v * LIGHTS + l), values);
            for (int i = 0; i < VALUES; i++) {
                squares += pow((double)(values[i] - truth[l * VALUES + i]), 2);
                energy += pow((double)truth[l * VALUES + i], 2);
            }
        }
    }
    g_test_message("RMS difference from the BTF: %.5f of the RMS", sqrt(squares / energy));
    g_assert_cmpfloat(sqrt(squares / energy), <, 0.01);
}

TEST(follows) {
    struct run *run = run_begin(changes);
    while (count_pictures(run->session) <= 20) /* frames wait for the intake on a loaded computer */
        g_main_context_iteration(NULL, TRUE);
    g_autoptr(Partial) partial = ok(partial_open(run->session, ERR));
    g_assert_cmpint(partial_n_pairs(partial), ==, PAIRS);
    g_assert_cmpint(partial_grid(partial)->width, ==, TEXELS);
    const int half = count_pictures(run->session);
    g_assert_cmpint(half, >, 20);
    g_assert_cmpint(read_all(partial, 10), ==, 10);
    g_assert_cmpint(read_all(partial, PAIRS), ==, half - 10);
    g_assert_cmpint(read_all(partial, PAIRS), ==, 0);
    g_assert_cmpint(partial_n_measured(partial), ==, half);
    run_to_end(run);
    g_assert_cmpint(read_all(partial, PAIRS), ==, PAIRS - half);
    g_assert_cmpint(partial_n_measured(partial), ==, PAIRS);
    compare_with_btf(partial, run->session);
    run_free(run);
}

/* Leaves every third shot out of a sample. */
static void leave_out(struct partial_sample *sample) {
    g_free(sample->planned);
    g_free(sample->shots);
    sample->planned = g_new(int, PAIRS);
    sample->shots = g_new(int, PAIRS);
    sample->n_planned = sample->n_measured = 0;
    for (int pair = 0; pair < PAIRS; pair++) {
        if (sample->pairs->groups[pair] % 3 != 0) {
            sample->n_measured++;
            continue;
        }
        sample->shots[sample->n_planned] = sample->n_planned + 1;
        sample->planned[sample->n_planned++] = pair;
        for (int row = 0; row < 3 * sample->n_probes; row++)
            sample->values[row * PAIRS + pair] = NAN;
    }
}

/* Pictures of shots that were left out are predicted, and about as wrong as expected. */
TEST(predicts) {
    struct run *run = run_begin(changes);
    run_to_end(run);
    g_autoptr(Partial) partial = ok(partial_open(run->session, ERR));
    g_assert_cmpint(read_all(partial, PAIRS), ==, PAIRS);
    struct partial_sample *whole = ok(partial_sample(partial, ERR));
    struct partial_sample *sample = ok(partial_sample(partial, ERR));
    g_assert_cmpint(whole->n_measured, ==, PAIRS);
    g_assert_cmpint(whole->n_planned, ==, 0);
    g_assert_cmpint(whole->n_probes, >, TEXELS * TEXELS / 2);
    leave_out(sample);
    g_autoptr(PartialForecast) forecast = ok(partial_forecast_new(sample, NULL, NULL, ERR));
    double squares = 0, energy = 0;
    int predicted = 0;
    for (int pair = 0; pair < PAIRS; pair++) {
        g_autoptr(GBytes) picture = partial_forecast_picture(forecast, partial, pair);
        float truth[VALUES], values[VALUES];
        unpack(partial_picture(partial, pair), truth);
        for (int i = 0; i < VALUES; i++)
            energy += (double)(truth[i] * truth[i]);
        g_assert_true((picture != NULL) == (sample->pairs->groups[pair] % 3 == 0));
        if (!picture)
            continue;
        unpack(picture, values);
        for (int i = 0; i < VALUES; i++)
            squares += pow((double)(values[i] - truth[i]), 2);
        predicted++;
    }
    int n;
    const double is = sqrt(squares / energy), expected = partial_forecast_error(forecast);
    const struct partial_later *later = partial_forecast_later(forecast, &n);
    g_test_message("%d of %d pictures predicted with an error of %.4f, expected %.4f", predicted,
                   PAIRS, is, expected);
    g_assert_cmpint(predicted, ==, sample->n_planned);
    g_assert_cmpfloat(is, <, 0.05); /* without the predictor it would be about √(1/3) */
    g_assert_cmpfloat(expected, >, is / 1.5);
    g_assert_cmpfloat(expected, <, is * 1.5);
    g_assert_cmpint(n, >, 2);
    g_assert_cmpint(later[n - 1].shots, ==, sample->n_planned);
    g_assert_cmpfloat(later[n - 1].error, ==, 0);
    for (int i = 0; i < n; i++)
        g_assert_cmpfloat(later[i].error, <, i ? later[i - 1].error : expected * 1.1);
    /* With all pictures nothing is predicted; the model of the earlier forecast is used. */
    g_autoptr(PartialForecast) end = ok(partial_forecast_new(whole, forecast, NULL, ERR));
    g_assert_cmpfloat(partial_forecast_error(end), ==, 0);
    partial_sample_free(sample);
    partial_sample_free(whole);
    run_free(run);
}

/* A damaged frame is left out with a sentence, and the others are shown. */
TEST(damaged_frame) {
    struct run *run = run_begin(changes);
    run_to_end(run);
    g_autoptr(GPtrArray) frames = run_frames(run->session);
    const struct session_frame *frame = frames->pdata[frames->len - 1];
    g_autofree char *path = g_build_filename(run->session, frame->path, NULL), *problem = NULL;
    ok(g_file_set_contents(path, "no picture", -1, ERR));
    g_autoptr(Partial) partial = ok(partial_open(run->session, ERR));
    g_autoptr(GArray) pairs = g_array_new(FALSE, FALSE, sizeof(int));
    ok(partial_read(partial, PAIRS, pairs, &problem, ERR));
    g_assert_cmpuint(pairs->len, ==, PAIRS - 1);
    assert_has(problem, frame->path);
    run_free(run);
}

TESTS_RUN_BY(run_tests);
