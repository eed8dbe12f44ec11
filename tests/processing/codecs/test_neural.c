#include "base/data_error.h"
#include "codecs/codec/codec_geometry.h"
#include "codecs/neural/neural_codec.h"
#include "codecs/neural/neural_private.h"
#include "lib/btf_fixture.h"
#include "lib/damage.h"
#include "lib/neural_fixture.h"
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "lib/waves_fixture.h"

#include <gio/gio.h>
#include <math.h>
#include <string.h>

typedef struct neural Neural;
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Neural, neural_free)

static void draw_direction(GRand *random, double ret[3]) {
    const double theta = g_rand_double_range(random, 0, 1.4);
    const double phi = g_rand_double_range(random, -4, 4);
    ret[0] = sin(theta) * cos(phi);
    ret[1] = sin(theta) * sin(phi);
    ret[2] = cos(theta);
}

/* Compares neural_evaluate(), or neural_evaluate_points(), with the formulas of neural.h. A ray
 * that touches an edge may miss it in single precision. */
static void assert_formula(const struct neural *neural, gboolean points, double allowed_misses) {
    enum { N = 2000 };
    struct neural_sample *samples = g_new0(struct neural_sample, N);
    g_autofree float *colours = g_new0(float, 3 * N);
    GRand *random = g_rand_new_with_seed(9);
    double views[N][3], lights[N][3], brightest = 0;
    int missed = 0;
    for (int i = 0; i < N; i++) {
        struct neural_sample *sample = &samples[i];
        draw_direction(random, views[i]);
        draw_direction(random, lights[i]);
        sample->x = (float)g_rand_double_range(random, 0, (double)neural->layout.width);
        sample->y = (float)g_rand_double_range(random, 0, (double)neural->layout.height);
        sample->x += points ? (float)(i % 5 - 2) * (float)neural->layout.width : 0;
        if (i % 3 == 1) { /* the rays of the sample before */
            sample->x = samples[i - 1].x;
            sample->y = samples[i - 1].y;
            memcpy(views[i], views[i - 1], sizeof views[i]);
        }
        for (int k = 0; k < 3; k++) {
            sample->view[k] = (float)views[i][k];
            sample->light[k] = (float)lights[i][k];
        }
    }
    (points ? neural_evaluate_points : neural_evaluate)(neural, samples, N, colours);
    for (int i = 0; i < N; i++) {
        double expected[3];
        (points ? neural_formula_point : neural_formula)(
            neural, (double)samples[i].x, (double)samples[i].y, views[i], lights[i], expected);
        gboolean same = TRUE;
        for (int c = 0; c < 3; c++) {
            same =
                same && fabs((double)colours[3 * i + c] - expected[c]) <= 1e-4 + 2e-3 * expected[c];
            brightest = MAX(brightest, expected[c]);
        }
        missed += !same;
    }
    g_assert_cmpfloat(brightest, >, 0.1);
    g_assert_cmpfloat(missed, <=, allowed_misses * N);
    g_rand_free(random);
    g_free(samples);
}

TEST(formula) {
    g_autoptr(Neural) flat = neural_fixture_new(9, 7, 4, 0, 1);
    g_autoptr(Neural) relief = neural_fixture_new(16, 12, 12, 1.5, 2);
    g_autoptr(Neural) deep = neural_fixture_new(24, 24, 16, 9, 3);
    for (int points = 0; points < 2; points++) {
        assert_formula(flat, points, 0);
        assert_formula(relief, points, 0.01);
        assert_formula(deep, points, 0.02);
    }
}

/* A wall of one texel, 2 texels high, seen and lit from the sides. */
TEST(wall) {
    g_autoptr(Neural) neural = neural_fixture_new(16, 8, 4, 1, 1);
    const float right[3] = {sqrtf(0.5F), 0, sqrtf(0.5F)};
    const float left[3] = {-sqrtf(0.5F), 0, sqrtf(0.5F)};
    float dark[3], lit[3], flat[3];
    neural->height_scale.minimum = -1; /* mm; a texel has 0.5 mm */
    for (int i = 0; i < 32 * 16; i++)
        neural->heights[i] = i % 32 == 16 || i % 32 == 17 ? 255 : 0;
    /* Only the light's inputs have weights, so that the colour is S(0) shade + 0.3 S(−1). */
    for (int row = 0; row < NEURAL_ROWS; row++) {
        neural->rows[row] = (struct neural_scale){0, 0};
        neural->biases[row] = 0;
    }
    neural_prepare(neural);
    /* A texel left of the wall is dark if the light is right of the wall. */
    neural_evaluate(neural, &(struct neural_sample){7, 4, {0, 0, 1}, {right[0], 0, right[2]}}, 1,
                    dark);
    neural_evaluate(neural, &(struct neural_sample){7, 4, {0, 0, 1}, {left[0], 0, left[2]}}, 1,
                    lit);
    neural_evaluate(neural, &(struct neural_sample){2, 4, {0, 0, 1}, {left[0], 0, left[2]}}, 1,
                    flat);
    const float none = 0.3F * log1pf(expf(-4)) / 4, full = logf(2) / 4 * sqrtf(0.5F);
    g_assert_cmpfloat_with_epsilon(dark[0], none, 1e-4);
    g_assert_cmpfloat_with_epsilon(lit[0], none + full, 1e-4);
    g_assert_cmpfloat_with_epsilon(flat[0], none + full, 1e-4);
}

TEST(positions) {
    g_autoptr(Neural) neural = neural_fixture_new(4, 2, 4, 1, 1);
    float far[3], near[3];
    neural_view(neural, 1, 0, far);
    g_assert_cmpfloat_with_epsilon(far[2], cosf(25 * (float)G_PI / 180), 1e-5);
    neural->camera_mm = g_new0(float, 3 * neural->layout.views.n);
    neural->lamp_mm = g_new0(float, 3 * neural->layout.lights.n);
    /* Texel (3, 0) is at (0.75, 0.25, 3) mm. */
    neural->camera_mm[5] = 13;
    neural->camera_mm[3] = 0.75F;
    neural->camera_mm[4] = 0.25F - 10;
    neural->lamp_mm[2] = 53;
    neural_view(neural, 1, 3, near);
    g_assert_cmpfloat_with_epsilon(near[0], 0, 1e-6);
    g_assert_cmpfloat_with_epsilon(near[1], -sqrtf(0.5F), 1e-6);
    g_assert_cmpfloat_with_epsilon(near[2], sqrtf(0.5F), 1e-6);
    neural_light(neural, 0, 3, near);
    g_assert_cmpfloat_with_epsilon(near[0] / near[2], -0.75 / 50, 1e-6);
}

/* reconstruct() at the measured directions is evaluate() at the centre of the texel. */
TEST(reconstruct) {
    g_autoptr(Neural) neural = neural_fixture_new(5, 4, 8, 1, 4);
    const gsize n = neural->layout.views.n * neural->layout.lights.n;
    g_autofree float *values = g_new0(float, 3 * n);
    struct neural_sample sample = {2.5F, 1.5F, {0}, {0}};
    float one[3];
    neural_reconstruct(neural, 7, values);
    for (gsize i = 0; i < n; i++) {
        neural_view(neural, (int)(i / neural->layout.lights.n), 7, sample.view);
        neural_light(neural, (int)(i % neural->layout.lights.n), 7, sample.light);
        neural_evaluate(neural, &sample, 1, one);
        for (gsize c = 0; c < 3; c++)
            g_assert_cmpfloat_with_epsilon(values[3 * i + c], one[c], 1e-6);
    }
}

TEST(halved) {
    g_autoptr(Neural) neural = neural_fixture_new(7, 4, 4, 1, 5);
    g_autoptr(Neural) half = neural_halved(neural);
    g_assert_cmpint(half->layout.width, ==, 3);
    g_assert_cmpint(half->layout.height, ==, 2);
    g_assert_cmpint(half->level, ==, 1);
    g_assert_cmpfloat_with_epsilon(half->layout.texel_mm, 0.5 * 7 / 3, 1e-12);
    /* The middle of three columns covers columns 2⅓ … 4⅔ of seven. */
    double sum = 0;
    for (int row = 0; row < 2; row++)
        for (int column = 2; column < 5; column++)
            sum += neural->surface[(row * 7 + column) * 4 + 1] * (column == 3 ? 1 : 2.0 / 3);
    g_assert_cmpint(half->surface[4 + 1], ==, lround(sum / (2 * 7.0 / 3)));
    g_autoptr(Neural) last = neural_halved(half);
    g_assert_cmpint(last->layout.width, ==, 1);
    g_assert_cmpint(last->layout.height, ==, 1);
    g_assert_null(neural_halved(last));
    /* A level counts its texels only. */
    g_assert_cmpint(neural_bytes(last), ==, 4 + 4);
    g_assert_cmpint(neural_bytes(neural), >, 28 * 8 + 2 * 512 + 32 * (23 + 38));
}

static void assert_same(const struct neural *a, const struct neural *b) {
    const gsize texels = a->layout.width * a->layout.height, channels = (gsize)a->n_channels;
    g_assert_cmpstr(a->name, ==, b->name);
    g_assert_cmpint(a->n_channels, ==, b->n_channels);
    g_assert_cmpint(a->level, ==, b->level);
    g_assert_cmpmem(a->surface, texels * channels, b->surface, texels * channels);
    g_assert_cmpmem(a->heights, 4 * texels, b->heights, 4 * texels);
    g_assert_cmpmem(a->halves, sizeof a->halves, b->halves, sizeof b->halves);
    g_assert_cmpmem(a->differences, sizeof a->halves, b->differences, sizeof b->halves);
    g_assert_cmpmem(a->weights, (gsize)neural_weights(a->n_channels), b->weights,
                    (gsize)neural_weights(b->n_channels));
    g_assert_cmpmem(a->rows, sizeof a->rows, b->rows, sizeof b->rows);
    g_assert_cmpmem(a->biases, sizeof a->biases, b->biases, sizeof b->biases);
    g_assert_cmpmem(a->surface_scales, channels * sizeof *a->surface_scales, b->surface_scales,
                    channels * sizeof *b->surface_scales);
    g_assert_cmpmem(&a->height_scale, sizeof a->height_scale, &b->height_scale,
                    sizeof b->height_scale);
    g_assert_true((a->camera_mm == NULL) == (b->camera_mm == NULL));
    if (a->camera_mm) {
        g_assert_cmpmem(a->camera_mm, 12 * a->layout.views.n, b->camera_mm, 12 * b->layout.views.n);
        g_assert_cmpmem(a->lamp_mm, 12 * a->layout.lights.n, b->lamp_mm, 12 * b->layout.lights.n);
    }
    g_assert_true(a->error == b->error && a->luminance_error == b->luminance_error &&
                  a->exact_error == b->exact_error);
}

static void write_small(const char *path, gboolean positions) {
    g_autoptr(Neural) neural = neural_fixture_new(5, 3, 12, 1, 6);
    for (gsize i = 0; positions && i < 2; i++) {
        const gsize n = i ? neural->layout.lights.n : neural->layout.views.n;
        float *at = g_new(float, 3 * n);
        for (gsize k = 0; k < 3 * n; k++)
            at[k] = 100 + 3.7F * (float)k;
        *(i ? &neural->lamp_mm : &neural->camera_mm) = at;
    }
    neural->error = 0.125;
    neural->exact_error = 0.25;
    neural->luminance_error = 0.5;
    g_autoptr(Neural) half = neural_halved(neural);
    struct neural *levels[NEURAL_MAX_LEVELS] = {neural, half}, *back[NEURAL_MAX_LEVELS];
    g_assert_true(ok(neural_write(path, levels, 2, ERR)));
    g_autoptr(Neural) first = ok(neural_read(path, ERR));
    assert_same(first, neural);
    g_assert_cmpint(ok(neural_read_levels(path, back, ERR)), ==, 2);
    for (int level = 0; level < 2; level++) {
        assert_same(back[level], levels[level]);
        neural_free(back[level]);
    }
}

/* A renderer gets all mip levels, also of a file that has only two. */
TEST(levels) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "neural.exr", NULL);
    write_small(path, FALSE);
    g_autoptr(GPtrArray) levels = ok(neural_codec.read_levels(path, ERR));
    g_assert_cmpint(levels->len, ==, 3);
    for (guint i = 0; i + 1 < levels->len; i++) {
        g_autoptr(Neural) half = neural_halved(levels->pdata[i]);
        assert_same(levels->pdata[i + 1], half);
    }
    const struct neural *last = levels->pdata[2];
    g_assert_cmpint(btf_layout_texels(&last->layout), ==, 1);
}

static void spoil(struct exr_file *file, int fault) {
    static const char *const parts[] = {"surface1",     "surface3", "heights", "halves2",
                                        "differences1", "weights2", "rows",    "scales",
                                        "views",        "lights",   "cameras", "lamps"};
    static const struct {
        const char *name;
        int value;
    } numbers[] = {{"mesorig.channels", 16}, {"mesorig.channels", 8},      {"mesorig.channels", 5},
                   {"mesorig.slices", 2},    {"mesorig.height", 2},        {"mesorig.width", 6},
                   {"mesorig.channels", -4}, {"mesorig.channels", 1 << 30}};
    static const struct {
        const char *part, *channel;
        float value;
    } values[] = {{"surface2", "G", 256}, {"surface1", "A", -1},   {"heights", "Z", NAN},
                  {"halves1", "R", 300},  {"weights3", "W", -7},   {"rows", "BIAS", INFINITY},
                  {"rows", "STEP", 1e9F}, {"scales", "STEP", NAN}, {"scales", "MINIMUM", 1e30F},
                  {"cameras", "Z", 0},    {"lamps", "X", INFINITY}};
    struct exr_part *first = exr_file_part(file, "surface1");
    gsize k = (gsize)fault;
    if (k < G_N_ELEMENTS(parts)) {
        g_assert_true(g_ptr_array_remove(file->parts, exr_file_part(file, parts[k])));
        return;
    }
    k -= G_N_ELEMENTS(parts);
    if (k < G_N_ELEMENTS(numbers)) {
        exr_set_int(first, numbers[k].name, numbers[k].value);
        return;
    }
    k -= G_N_ELEMENTS(numbers);
    if (k < G_N_ELEMENTS(values))
        exr_part_plane(exr_file_part(file, values[k].part), values[k].channel)[2] = values[k].value;
    else if (k == G_N_ELEMENTS(values))
        exr_set_double(first, "texel_mm", 1e-9); /* the relief would be too deep */
    else
        exr_set_string(first, "mesorig.kind", "hsh");
}

TEST(file) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "neural.exr", NULL);
    write_small(path, FALSE);
    for (int fault = 0; fault < 33; fault++) {
        write_small(path, TRUE);
        struct exr_file *file = ok(exr_read(path, ERR));
        spoil(file, fault);
        /* Without surface3, mesorig.channels = 8 is another valid file. */
        if (fault == 13)
            exr_file_free(file);
        else
            assert_file_refused(neural_read, path, file);
    }
    write_small(path, TRUE);
    assert_cut_refused(neural_read, path, 2111);
}

/* The loss of a lesson in double precision. */
static double loss_of(const struct neural_numbers *numbers, const struct neural_lesson *lesson) {
    struct neural_batch batch;
    double sum = 0;
    neural_set_inputs(numbers, FALSE, lesson->queries, NEURAL_BATCH, &batch);
    neural_run(numbers, NEURAL_BATCH, &batch);
    for (int c = 0; c < 3; c++)
        for (int s = 0; s < NEURAL_BATCH; s++) {
            const double target = (double)lesson->targets[c][s];
            const double off = log1p(60 * (double)batch.colours[c][s]) - log1p(60 * target);
            sum += isnan(target) ? 0 : off * off / (log(61) * log(61));
        }
    return sum;
}

static void assert_gradient(struct neural_numbers *numbers, const struct neural_lesson *lesson,
                            const char *name, float *values, const float *gradient, gsize n) {
    const float change = 5e-4F;
    double squares = 0, largest = 0;
    int count = 0, above_zero = 0, off = 0;
    for (gsize i = 0; i < n; i++)
        squares += (double)(gradient[i] * gradient[i]) / (double)n;
    for (gsize i = 0; i < n; i += 1 + n / 150) {
        const float before = values[i];
        values[i] = before + change;
        const double above = loss_of(numbers, lesson);
        values[i] = before - change;
        const double found = (above - loss_of(numbers, lesson)) / (2 * (double)change);
        values[i] = before;
        off += fabs(found - (double)gradient[i]) > 0.05 * sqrt(squares);
        largest = MAX(largest, fabs(found - (double)gradient[i]));
        above_zero += fabs(found) > 0.1 * sqrt(squares);
        count++;
    }
    g_test_message("%s: RMS %g, largest difference %g", name, sqrt(squares), largest);
    g_assert_cmpfloat(squares, >, 0);
    g_assert_cmpint(above_zero, >, count / 20);
    /* Where the change takes a unit across 0, the difference is not the derivative. */
    g_assert_cmpint(off, <=, count / 50);
    g_assert_cmpfloat(largest, <, 0.3 * sqrt(squares));
}

/* The gradients of all numbers by differences of the loss. */
TEST(gradients) {
    g_autoptr(Neural) neural = neural_fixture_new(3, 3, 8, 1, 7);
    struct neural_numbers *numbers = neural->numbers;
    struct neural_lesson *lesson = g_aligned_alloc0(1, sizeof *lesson, 64);
    GRand *random = g_rand_new_with_seed(3);
    float transposed[NEURAL_MAX_WEIGHTS], surface[9 * 8] = {0};
    struct neural_sample samples[NEURAL_BATCH];
    for (int s = 0; s < NEURAL_BATCH; s++) {
        double view[3], light[3];
        samples[s].x = (float)g_rand_double_range(random, 0, 3);
        samples[s].y = (float)g_rand_double_range(random, 0, 3);
        draw_direction(random, view);
        draw_direction(random, light);
        for (int k = 0; k < 3; k++) {
            samples[s].view[k] = (float)view[k];
            samples[s].light[k] = (float)light[k];
            lesson->targets[k][s] = (float)g_rand_double_range(random, 0, 0.8);
        }
    }
    neural_make_queries(numbers, FALSE, samples, NEURAL_BATCH, lesson->queries);
    lesson->targets[1][5] = NAN;
    neural_transpose(numbers, transposed);
    neural_learn(numbers, transposed, 1, lesson);
    neural_add_surface(numbers, lesson, surface);
    const struct neural_gradient *found = &lesson->gradient;
    g_assert_cmpfloat_with_epsilon(lesson->loss, loss_of(numbers, lesson), 1e-4 * lesson->loss);
    assert_gradient(numbers, lesson, "surface", numbers->surface, surface, 9 * 8);
    assert_gradient(numbers, lesson, "halves", numbers->halves, found->halves, NEURAL_PLANE_VALUES);
    assert_gradient(numbers, lesson, "differences", numbers->differences, found->differences,
                    NEURAL_PLANE_VALUES);
    const gsize first = (gsize)NEURAL_HIDDEN * (gsize)neural_inputs(8);
    const gsize second = (gsize)NEURAL_HIDDEN * NEURAL_HIDDEN;
    assert_gradient(numbers, lesson, "weights1", numbers->weights, found->weights, first);
    assert_gradient(numbers, lesson, "weights2", numbers->weights + first, found->weights + first,
                    second);
    assert_gradient(numbers, lesson, "weights3", numbers->weights + first + second,
                    found->weights + first + second, (gsize)NEURAL_OUTPUTS * NEURAL_HIDDEN);
    assert_gradient(numbers, lesson, "biases", numbers->biases, found->biases, NEURAL_ROWS);
    g_rand_free(random);
    g_aligned_free(lesson);
}

/* The loss of a BTF of one value, in double precision. */
static double loss_of_value(const struct neural *neural, const float *target) {
    struct neural_sample sample = {0.5F, 0.5F, {0}, {0}};
    float colour[3];
    double sum = 0;
    neural_view(neural, 0, 0, sample.view);
    neural_light(neural, 0, 0, sample.light);
    neural_evaluate(neural, &sample, 1, colour);
    for (int c = 0; c < 3; c++)
        sum += pow((log1p(60 * (double)colour[c]) - log1p(60 * (double)target[c])) / log(61), 2);
    return sum / 3;
}

/* The step of Adam as Kingma & Ba 2015 write it in their algorithm 1, with the rates of neural.h.
 * moments are m and v. */
static double adam(int t, int steps, double rate, double gradient, double moments[2]) {
    const double falling = rate * fmin(1, t / 50.0) * pow(1.0 / 50, (t - 1.0) / steps);
    moments[0] = 0.9 * moments[0] + 0.1 * gradient;
    moments[1] = 0.99 * moments[1] + 0.01 * gradient * gradient;
    return -falling * (moments[0] / (1 - pow(0.9, t))) / (sqrt(moments[1] / (1 - pow(0.99, t))));
}

/* A BTF of one value: all samples of a step are alike. Their gradient is that of the loss by
 * differences, and the steps are those of Adam. */
TEST(steps) {
    static const char *const names[] = {"surface", "halves", "differences", "weights", "biases"};
    g_autoptr(BtfMatrix) btf = waves_fixture_new(1, 1, 1, 1, 0, FALSE);
    g_autoptr(Neural) neural = neural_fixture_new(1, 1, 4, 0, 1);
    const struct neural_options options = {.n_channels = 4, .seed = 3, .work.n_threads = 1};
    struct neural_trainer *trainer = neural_trainer_new(neural, btf, &options);
    double *moments[NEURAL_GROUPS];
    for (int g = 0; g < NEURAL_GROUPS; g++) {
        g_assert_cmpstr(trainer->groups[g].name, ==, names[g]);
        moments[g] = g_new0(double, 2 * trainer->groups[g].n);
    }
    for (int t = 1; t <= 3; t++) {
        neural_trainer_learn(trainer);
        for (int g = 0; g < NEURAL_GROUPS; g++) {
            const struct neural_group *group = &trainer->groups[g];
            const gsize skip = 1 + group->n / 50;
            double squares = 0, largest = 0;
            for (gsize i = 0; i < group->n; i += skip) {
                const float before = group->values[i], change = 2e-3F;
                group->values[i] = before + change;
                const double above = loss_of_value(neural, btf->values);
                group->values[i] = before - change;
                const double found =
                    (above - loss_of_value(neural, btf->values)) / (2 * (double)change);
                group->values[i] = before;
                squares += pow((double)group->gradient[i], 2);
                largest = fmax(largest, fabs(found - (double)group->gradient[i]));
            }
            g_test_message("step %d, %s: gradient %g, off by at most %g", t, group->name,
                           sqrt(squares), largest);
            g_assert_cmpfloat(squares, >, 0);
            g_assert_cmpfloat(largest, <, 0.05 * sqrt(squares));
        }
        float *before[NEURAL_GROUPS], *gradient[NEURAL_GROUPS];
        for (int g = 0; g < NEURAL_GROUPS; g++) {
            const struct neural_group *group = &trainer->groups[g];
            before[g] = g_memdup2(group->values, sizeof(float) * group->n);
            gradient[g] = g_memdup2(group->gradient, sizeof(float) * group->n);
        }
        neural_trainer_step(trainer);
        for (int g = 0; g < NEURAL_GROUPS; g++) {
            const struct neural_group *group = &trainer->groups[g];
            for (gsize i = 0; i < group->n; i++) {
                const double change = adam(t, trainer->steps, g < 3 ? 0.02 : 0.01,
                                           (double)gradient[g][i], moments[g] + 2 * i);
                if (moments[g][2 * i + 1] > 1e-16)
                    g_assert_cmpfloat_with_epsilon(group->values[i], (double)before[g][i] + change,
                                                   1e-3 * fabs(change) + 1e-6);
                g_assert_true(group->gradient[i] == 0);
            }
            g_free(before[g]);
            g_free(gradient[g]);
        }
        g_assert_cmpint(trainer->step, ==, t);
    }
    for (int g = 0; g < NEURAL_GROUPS; g++)
        g_free(moments[g]);
    neural_trainer_free(trainer);
}

/* The medians of points become heights; cells without points continue their neighbours. */
TEST(heights) {
    g_autoptr(Neural) neural = neural_fixture_new(2, 2, 4, 1, 7); /* 4 × 4 cells of 0.25 mm */
    struct codec_surface_point points[] = {
        {-0.4F, 0.4F, -1, 0},    {-0.45F, 0.3F, -3, 0},
        {-0.3F, 0.3F, -1.2F, 0}, /* cell (0, 0) */
        {0.4F, -0.4F, -0.2F, 1}, {7, 0, 100, 1},
        {0, 0.6F, 100, 1}, /* cell (3, 3), outside */
    };
    const struct codec_geometry geometry = {.n_points = G_N_ELEMENTS(points), .points = points};
    neural_set_heights(neural, &geometry);
    g_assert_cmpfloat_with_epsilon(neural->height_scale.minimum, -1.2, 1e-6);
    g_assert_cmpfloat_with_epsilon(neural->height_scale.step, 1.0 / 255, 1e-6);
    g_assert_cmpint(neural->heights[0], ==, 0);
    g_assert_cmpint(neural->heights[15], ==, 255);
    g_assert_cmpint(neural->heights[1], ==, 0);
    g_assert_cmpint(neural->heights[14], ==, 255);
    neural_set_heights(neural, NULL);
    g_assert_true(neural->height_scale.minimum == 0 && neural->height_scale.step == 0);
    g_assert_cmpint(neural->heights[15], ==, 0);
}

static struct neural *compute(const struct btf_matrix *btf, int n_threads, double per_texel,
                              guint32 seed) {
    const struct neural_options options = {
        .n_channels = 8, .per_texel = per_texel, .seed = seed, .work.n_threads = n_threads};
    return ok(neural_compute(btf, &options, ERR));
}

/* A training that is cancelled in the middle continues from its checkpoint, to the same model. */
struct stop {
    GCancellable *cancellable;
    int after, told, last;
};

static void stop_after(const struct work_progress *progress, gpointer data) {
    struct stop *stop = data;
    if (g_str_equal(progress->stage, "train")) {
        stop->told++;
        stop->last = progress->done;
    }
    if (progress->done > stop->after)
        g_cancellable_cancel(stop->cancellable);
}

TEST(resumes) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "x.checkpoint", NULL);
    g_autoptr(GError) error = NULL;
    g_autoptr(GCancellable) cancellable = g_cancellable_new();
    g_autoptr(BtfMatrix) btf = waves_fixture_new(6, 5, 5, 7, 0.002, FALSE);
    struct stop stop = {.cancellable = cancellable, .after = 20};
    struct neural_options options = {
        .n_channels = 8,
        .per_texel = 20000,
        .work = {.progress = stop_after, .data = &stop, .cancellable = cancellable}};
    g_autoptr(Neural) whole =
        ok(neural_compute(btf, &(struct neural_options){.n_channels = 8, .per_texel = 20000}, ERR));
    for (int run = 0; run < 2; run++) {
        g_autoptr(Checkpoint) checkpoint = checkpoint_new(path);
        options.checkpoint = checkpoint;
        stop.told = 0;
        g_autoptr(Neural) neural = neural_compute(btf, &options, &error);
        if (run == 0) {
            g_assert_null(neural);
            g_assert_error(error, G_IO_ERROR, G_IO_ERROR_CANCELLED);
            g_assert_cmpint(stop.last, >, 0);
            g_assert_cmpint(stop.last, <, 585);
            g_clear_error(&error);
            g_cancellable_reset(cancellable);
            stop.after = G_MAXINT;
            continue;
        }
        g_assert_no_error(error);
        g_assert_nonnull(checkpoint_note(checkpoint));
        assert_same(neural, whole);
    }
}

TEST(refused) {
    static const int channels[] = {-4, 3, 6, 20, G_MAXINT};
    g_autoptr(GError) error = NULL;
    g_autoptr(BtfMatrix) btf = waves_fixture_new(3, 2, 3, 4, 0, FALSE);
    for (gsize i = 0; i < G_N_ELEMENTS(channels); i++) {
        g_assert_null(
            neural_compute(btf, &(struct neural_options){.n_channels = channels[i]}, &error));
        g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
        g_assert_nonnull(strstr(error->message, "give 4, 8, 12 or 16"));
        g_clear_error(&error);
    }
    g_assert_null(neural_compute(btf, &(struct neural_options){.per_texel = -1}, &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
    g_clear_error(&error);
    btf->values[7] = INFINITY;
    g_assert_null(neural_compute(btf, &(struct neural_options){0}, &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
}

/* The model is the same with any number of threads, and another with another seed. Its error is
 * small, although not as small as the noise. */
TEST(repeats) {
    g_autoptr(BtfMatrix) btf = waves_fixture_new(6, 5, 5, 7, 0.002, FALSE);
    for (gsize i = 0; i < 5 * 7 * 3; i++)
        btf->values[(5 * 7 * 3 * 11) + i] = i % 4 ? btf->values[(5 * 7 * 3 * 11) + i] : NAN;
    g_autoptr(Neural) one = compute(btf, 1, 17500, 1);
    g_autoptr(Neural) three = compute(btf, 3, 17500, 1);
    g_autoptr(Neural) other = compute(btf, 1, 17500, 2);
    assert_same(one, three);
    g_assert_cmpint(memcmp(one->weights, other->weights, sizeof one->weights), !=, 0);
    g_test_message("errors %g (%g before rounding) and %g", one->error, one->exact_error,
                   other->error);
    g_assert_cmpfloat(one->error, <, 0.08);
    g_assert_cmpfloat(other->error, <, 0.08);
    g_assert_cmpfloat(fabs(one->error - one->exact_error), <, 0.01);
}
