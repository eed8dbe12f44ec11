#include "frames/sweep.h"
#include "lib/test.h"

#include <math.h>

/* Pulses with known times; the sweep sees them through noise, rounding and the converter's end. */
struct pulses {
    int width, height, frames, saturation;
    double sigma, amplitude, background, noise;
    double *centre;   /* of each pixel */
    double electrons; /* a DN; 0: light itself has no noise */
    double odd_dn;    /* that the whole frame odd_frame is brighter by */
    int odd_frame;
};

static double variance_of(const struct pulses *pulses, double light) {
    return pulses->noise * pulses->noise + (pulses->electrons > 0 ? light / pulses->electrons : 0);
}

static void finish_second(const Sweep *sweep, double threshold, float *ret_peak, float *ret_width,
                          float *ret_intensity) {
    const struct sweep_pulses second = {ret_peak, ret_width, ret_intensity};
    sweep_finish(sweep, threshold, NULL, &second);
}

static double gauss(GRand *random) {
    double u = g_rand_double_range(random, 1e-12, 1), v = g_rand_double(random);
    return sqrt(-2 * log(u)) * cos(2 * G_PI * v);
}

static Sweep *feed(const struct pulses *pulses, GRand *random) {
    int n = pulses->width * pulses->height;
    Sweep *sweep = sweep_new(pulses->width, pulses->height, pulses->frames, pulses->saturation);
    g_autofree guint16 *pixels = g_new(guint16, n);
    for (int t = 0; t < pulses->frames; t++) {
        for (int i = 0; i < n; i++) {
            double u = (t - pulses->centre[i]) / pulses->sigma;
            double light = pulses->amplitude * exp(-0.5 * u * u);
            double value =
                pulses->background + light + (t == pulses->odd_frame ? pulses->odd_dn : 0) +
                (pulses->noise > 0 ? sqrt(variance_of(pulses, light)) * gauss(random) : 0);
            pixels[i] = (guint16)lround(CLAMP(value, 0, pulses->saturation));
        }
        sweep_add(sweep, pixels);
    }
    return sweep;
}

/* A sweep of one pixel with these values. */
static Sweep *feed_values(const guint16 *values, int n, int saturation) {
    Sweep *sweep = sweep_new(1, 1, n, saturation);
    for (int i = 0; i < n; i++)
        sweep_add(sweep, &values[i]);
    return sweep;
}

/* Light at a distance (mm) from the middle of a line of standard deviation sigma_mm on a material
 * of which it enters a share, and comes out with the density exp(−r / scale) / (2π scale²): in one
 * dimension ∫ dy of that, folded with the line. */
static double bled(double x_mm, double sigma_mm, double share, double scale_mm) {
    const double h = 0.1 * scale_mm;
    double sum = 0;
    for (int i = -60; i <= 60; i++)
        for (int j = -60; j <= 60; j++) {
            const double off = (x_mm - i * h) / sigma_mm;
            sum += exp(-hypot(i, j) * h / scale_mm - 0.5 * off * off) * h * h /
                   (2 * G_PI * scale_mm * scale_mm);
        }
    return (1 - share) * exp(-0.5 * x_mm * x_mm / (sigma_mm * sigma_mm)) + share * sum;
}

/* A line is measured wider where light enters the material, if it is thin enough: the limit of a
 * warning is 1.1 (mdf_lines.c). sigma_mm: on the surface, of lines of 0.6, 1.2 and 2.4 mm at 45°.
 */
TEST(bleeding) {
    static const struct {
        double sigma_mm, least, most;
    } lines[] = {{0.36, 1.12, 1.15}, {0.72, 1.10, 1.12}, {1.44, 1.04, 1.06}};
    enum { FRAMES = 161, SIGMA_FRAMES = 4 };
    for (gsize k = 0; k < G_N_ELEMENTS(lines); k++) {
        guint16 values[FRAMES];
        float peak, width, intensity;
        for (int t = 0; t < FRAMES; t++) {
            const double mm = (t - FRAMES / 2) * lines[k].sigma_mm / SIGMA_FRAMES;
            values[t] = (guint16)lround(50 + 2000 * bled(mm, lines[k].sigma_mm, 0.3, 0.6));
        }
        g_autoptr(Sweep) sweep = feed_values(values, FRAMES, 4095);
        sweep_finish(sweep, 40, &(struct sweep_pulses){&peak, &width, &intensity}, NULL);
        const double ratio = (double)width / SIGMA_FRAMES;
        g_test_message("a line of %.2f mm is %.3f times as wide", lines[k].sigma_mm, ratio);
        g_assert_cmpfloat(ratio, >, lines[k].least);
        g_assert_cmpfloat(ratio, <, lines[k].most);
    }
}

struct result {
    double rms, bias, mean_width;
    int missing;
};

static struct result measure(const struct pulses *pulses, double threshold) {
    int n = pulses->width * pulses->height;
    g_autofree float *peak = g_new(float, n), *width = g_new(float, n), *bright = g_new(float, n);
    GRand *random = g_rand_new_with_seed(7);
    g_autoptr(Sweep) sweep = feed(pulses, random);
    g_rand_free(random);
    sweep_finish(sweep, threshold, &(struct sweep_pulses){peak, width, bright}, NULL);
    struct result result = {0};
    for (int i = 0; i < n; i++) {
        if (peak[i] < 0) {
            result.missing++;
            continue;
        }
        double error = peak[i] - pulses->centre[i];
        result.rms += error * error;
        result.bias += error;
        result.mean_width += width[i];
    }
    int found = MAX(1, n - result.missing);
    result.rms = sqrt(result.rms / found);
    result.bias /= found;
    result.mean_width /= found;
    return result;
}

static double *random_centres(int n, double from, double to) {
    double *centre = g_new(double, n);
    GRand *random = g_rand_new_with_seed(3);
    for (int i = 0; i < n; i++)
        centre[i] = g_rand_double_range(random, from, to);
    g_rand_free(random);
    return centre;
}

/* Integer peaks err by .29 frames; a Gaussian through three samples by about a tenth of that. */
TEST(accuracy) {
    g_autofree double *centre = random_centres(61 * 47, 3, 92);
    struct pulses pulses = {61, 47, 96, 4095, 1.6, 1500, 70, 10, centre};
    struct result noisy = measure(&pulses, 100);
    g_test_message("RMS %.4f frames with noise", noisy.rms);
    g_assert_cmpint(noisy.missing, ==, 0);
    g_assert_cmpfloat(noisy.rms, <, 0.03);
    g_assert_cmpfloat(fabs(noisy.bias), <, 0.002);
    g_assert_cmpfloat(fabs(noisy.mean_width - 1.6), <, 0.1);
    pulses.noise = 0;
    struct result clean = measure(&pulses, 100);
    g_assert_cmpfloat(clean.rms, <, 0.002);
    g_assert_cmpfloat(fabs(clean.mean_width - 1.6), <, 0.005);
}

/* A lamp that is still on, or not yet, in the first or the second frame. */
TEST(odd_first) {
    static const double odd_dn[] = {400, 30, -30, -60};
    g_autofree double *centre = random_centres(61 * 47, 8, 90);
    for (int frame = 0; frame < 2; frame++)
        for (gsize i = 0; i < G_N_ELEMENTS(odd_dn); i++) {
            struct pulses pulses = {61, 47, 96, 4095, 1.6, 600, 70, 4, centre, 0, odd_dn[i], frame};
            struct result result = measure(&pulses, 100);
            g_test_message("frame %d, %+g DN: %d missing, RMS %.4f frames", frame, odd_dn[i],
                           result.missing, result.rms);
            g_assert_cmpint(result.missing, ==, 0);
            g_assert_cmpfloat(result.rms, <, 0.03);
        }
}

/* Wide lines: all samples of a pulse count, not the three around its peak, which alone would give
 * 0.135 frames. */
#define WIDE_BOUND 0.0368 /* frames: Cramér and Rao, for a pulse of this size, width and noise */

/* Bounds in frames of the errors of pulses with random centres between from and to. */
static const struct accuracy {
    struct pulses pulses;
    double from, to, rms, bias, width;
} many_frames = {{50, 3, 1000, 4095, 2, 1500, 70, 5}, 5, 995, 0.03, INFINITY, INFINITY},
  saturated = {{64, 32, 60, 1023, 2, 3000, 60, 5}, 8, 50, 0.02, 0.02, INFINITY}, /* middle: .28 */
    wide_lines = {{64, 64, 60, 4095, 3, 300, 70, 6}, 10, 50, 1.3 * WIDE_BOUND, INFINITY, 0.2};

static void test_bounds(gconstpointer data) {
    const struct accuracy *bound = data;
    struct pulses pulses = bound->pulses;
    g_autofree double *centre =
        random_centres(pulses.width * pulses.height, bound->from, bound->to);
    pulses.centre = centre;
    struct result result = measure(&pulses, 100);
    g_test_message("RMS %.4f frames", result.rms);
    g_assert_cmpint(result.missing, ==, 0);
    g_assert_cmpfloat(result.rms, <, bound->rms);
    g_assert_cmpfloat(fabs(result.bias), <, bound->bias);
    g_assert_cmpfloat(fabs(result.mean_width - pulses.sigma), <, bound->width);
}

/* A shorter exposure of the same pulses, with noise of its own. */
static Sweep *feed_shorter(const struct pulses *pulses, double ratio, GRand *random) {
    struct pulses shorter = *pulses;
    shorter.amplitude /= ratio;
    return feed(&shorter, random);
}

static double rms_of(const float *peak, const double *centre, int n) {
    double squares = 0;
    for (int i = 0; i < n; i++)
        squares += pow((double)peak[i] - centre[i], 2);
    return sqrt(squares / n);
}

/* Pulses that are up to sixteen times too bright, and narrow: of the longer exposure hardly
 * anything is left but the plateau. What does not saturate stays to the bit. */
TEST(shorter) {
    enum { N = 64 * 32 };
    static const double amplitudes[] = {3000, 20000, 60000};
    g_autofree double *centre = random_centres(N, 8, 50);
    float peak[2][N], width[N], bright[2][N];
    for (guint k = 0; k < G_N_ELEMENTS(amplitudes); k++) {
        struct pulses pulses = {64, 32, 60, 4095, 0.8, amplitudes[k], 60, 5, centre};
        GRand *random = g_rand_new_with_seed(7);
        g_autoptr(Sweep) sweep = feed(&pulses, random);
        g_autoptr(Sweep) shorter = feed_shorter(&pulses, 32, random);
        g_rand_free(random);
        sweep_finish(sweep, 100, &(struct sweep_pulses){peak[0], width, bright[0]}, NULL);
        sweep_set_shorter(sweep, shorter, 32);
        sweep_finish(sweep, 100, &(struct sweep_pulses){peak[1], width, bright[1]}, NULL);
        const double alone = rms_of(peak[0], centre, N), both = rms_of(peak[1], centre, N);
        g_test_message("%g DN: RMS %.4f frames alone, %.4f with the shorter", amplitudes[k], alone,
                       both);
        g_assert_cmpmem(bright[0], sizeof bright[0], bright[1], sizeof bright[1]);
        if (k == 0)
            g_assert_cmpmem(peak[0], sizeof peak[0], peak[1], sizeof peak[1]);
        else
            g_assert_cmpfloat(both, <, MIN(0.01, 0.7 * alone));
    }
}

/* What the shorter exposure lacks is not made up: nothing of it, or a step that is missing. */
TEST(shorter__lacks) {
    static const guint16 values[] = {10, 10, 300, 900, 900, 900, 200, 10, 10};
    static const guint16 lacks[][9] = {{10, 10, 10, 10, 10, 10, 10, 10, 10},
                                       {10, 10, 30, 300, 10, 200, 20, 10, 10}};
    for (guint k = 0; k < G_N_ELEMENTS(lacks); k++) {
        g_autoptr(Sweep) sweep = feed_values(values, G_N_ELEMENTS(values), 900);
        g_autoptr(Sweep) shorter = feed_values(lacks[k], G_N_ELEMENTS(values), 900);
        float peak[2], width[2], bright[2];
        sweep_finish(sweep, 20, &(struct sweep_pulses){&peak[0], &width[0], &bright[0]}, NULL);
        sweep_set_shorter(sweep, shorter, 10);
        sweep_finish(sweep, 20, &(struct sweep_pulses){&peak[1], &width[1], &bright[1]}, NULL);
        g_assert_cmpfloat(peak[0], ==, peak[1]);
        g_assert_cmpfloat(width[0], ==, width[1]);
        g_assert_cmpfloat(bright[0], ==, bright[1]);
        finish_second(sweep, 20, &peak[1], &width[1], &bright[1]);
        g_assert_cmpfloat(peak[1], ==, -1);
    }
}

/* Two pulses that the longer exposure shows as one plateau are two. */
TEST(shorter__parts) {
    static const guint16 values[] = {10, 10, 300, 900, 900, 900, 900, 900, 200, 10, 10};
    static const guint16 parts[] = {10, 10, 40, 300, 50, 20, 60, 400, 30, 10, 10};
    g_autoptr(Sweep) sweep = feed_values(values, G_N_ELEMENTS(values), 900);
    g_autoptr(Sweep) shorter = feed_values(parts, G_N_ELEMENTS(parts), 900);
    float peak, width, bright;
    sweep_finish(sweep, 20, &(struct sweep_pulses){&peak, &width, &bright}, NULL);
    g_assert_cmpfloat_with_epsilon(peak, 5, 0.3);
    sweep_set_shorter(sweep, shorter, 10);
    sweep_finish(sweep, 20, &(struct sweep_pulses){&peak, &width, &bright}, NULL);
    g_assert_cmpfloat_with_epsilon(peak, 7, 0.3);
    g_assert_cmpfloat(bright, ==, 890);
    finish_second(sweep, 20, &peak, &width, &bright);
    g_assert_cmpfloat_with_epsilon(peak, 3, 0.3);
}

/* Values above the saturation given are as good as equal. */
TEST(above_saturation) {
    static const guint16 values[] = {10, 10, 50, 900, 1000, 950, 50, 10, 10};
    g_autoptr(Sweep) sweep = feed_values(values, G_N_ELEMENTS(values), 900);
    float peak, width, bright;
    sweep_finish(sweep, 20, &(struct sweep_pulses){&peak, &width, &bright}, NULL);
    g_assert_cmpfloat_with_epsilon(peak, 4, 1e-6);
    g_assert_cmpfloat(bright, ==, 890);
}

static float peak_of(const guint16 *values, int n, double threshold) {
    g_autoptr(Sweep) sweep = feed_values(values, n, 65535);
    float peak, width, bright;
    sweep_finish(sweep, threshold, &(struct sweep_pulses){&peak, &width, &bright}, NULL);
    g_assert_false(isnan(width) || isnan(bright));
    return peak;
}
#define PEAK_OF(threshold, ...)                                                                    \
    peak_of((const guint16[]){__VA_ARGS__}, sizeof((const guint16[]){__VA_ARGS__}) / 2, threshold)

TEST(no_peak) {
    g_assert_cmpfloat(PEAK_OF(20, 10, 12, 10, 12, 11, 10), ==, -1); /* below threshold */
    g_assert_cmpfloat(PEAK_OF(20, 90, 50, 10, 10, 10), ==, -1);     /* at the first frame */
    g_assert_cmpfloat(PEAK_OF(20, 10, 10, 10, 50, 90), ==, -1);     /* at the last */
    g_assert_cmpfloat(PEAK_OF(20, 10, 10, 90, 90, 90), ==, -1);     /* a plateau to the end */
    g_assert_cmpfloat(PEAK_OF(20, 90, 90, 50, 10, 10), ==, -1);
    g_assert_cmpfloat(PEAK_OF(0, 0, 0, 0, 0, 0, 0, 0, 0), ==, -1);
    g_assert_cmpfloat(PEAK_OF(0, 7, 7, 7, 7, 7, 7), ==, -1);
    g_assert_cmpfloat(PEAK_OF(20, 99), ==, -1);
}

/* The first frame cannot be told from background, nor what falls below it later: what is left of
 * such a pulse is right or not there. */
TEST(at_the_start) {
    enum { N = 2000, EARLY = 400 };
    double centre[N];
    for (int i = 0; i < N; i++)
        centre[i] = i < EARLY ? -1 + 5.0 * i / EARLY : 14;
    for (double sigma = 0.5; sigma < 2.1; sigma += 0.3) {
        const struct pulses pulses = {N, 1, 24, 4000, sigma, 1200, 60, 4, centre};
        float peak[N], width[N], bright[N];
        GRand *random = g_rand_new_with_seed(3);
        g_autoptr(Sweep) sweep = feed(&pulses, random);
        g_rand_free(random);
        sweep_finish(sweep, 40, &(struct sweep_pulses){peak, width, bright}, NULL);
        for (int i = 0; i < N; i++) {
            g_assert_true(peak[i] >= 0 || centre[i] < 1.2);
            g_assert_true(peak[i] < 0 || fabs(peak[i] - centre[i]) < 0.1);
        }
    }
}

TEST(shapes) {
    g_assert_cmpfloat(PEAK_OF(20, 10, 10, 50, 90, 50, 10, 10), ==, 3);
    g_assert_cmpfloat(PEAK_OF(20, 10, 10, 10, 90, 10, 10, 10), ==, 3); /* a single frame */
    g_assert_cmpfloat(PEAK_OF(20, 10, 50, 90, 90, 50, 10, 10), ==, 2.5);
    g_assert_cmpfloat(PEAK_OF(20, 0, 0, 65535, 65535, 65535, 0, 0), ==, 3);
    /* Of two peaks the brighter one; of two alike the first. */
    g_assert_cmpfloat_with_epsilon(PEAK_OF(20, 10, 40, 60, 40, 10, 50, 90, 50, 10), 6, 1e-6);
    g_assert_cmpfloat_with_epsilon(PEAK_OF(20, 10, 50, 90, 50, 10, 50, 90, 50, 10), 2, 1e-6);
    float tilted = PEAK_OF(20, 10, 10, 50, 90, 70, 10, 10);
    g_assert_cmpfloat(tilted, >, 3);
    g_assert_cmpfloat(tilted, <, 3.5);
}

/* Cramér's and Rao's, of a pulse in the middle of the sweep; rounding is noise as well. */
static double bound_of(const struct pulses *pulses) {
    double sum = 0;
    for (int k = -20; k <= 20; k++) {
        const double t = (k + 0.25) / pulses->sigma, light = pulses->amplitude * exp(-0.5 * t * t);
        sum += pow(light * t / pulses->sigma, 2) / (variance_of(pulses, light) + 1 / 12.0);
    }
    return 1 / sqrt(sum);
}

/* Faint ones too: what a pulse has that is hardly brighter than noise counts as well. */
TEST(faint) {
    g_autofree double *centre = random_centres(64 * 64, 10, 50);
    for (double sigma = 0.7; sigma < 2.1; sigma += 0.3) {
        const struct pulses pulses = {64, 64, 60, 4095, sigma, 20, 70, 1.1, centre, 3.7};
        const struct result result = measure(&pulses, 10);
        g_test_message("%.1f frames: %.2f times the bound", sigma, result.rms / bound_of(&pulses));
        g_assert_cmpint(result.missing, ==, 0);
        g_assert_cmpfloat(result.rms, <, 1.4 * bound_of(&pulses));
    }
}

/* Light that another surface throws back comes at another time. */
TEST(second) {
    static const guint16 values[] = {10, 10, 40, 60, 40, 10, 10, 50,
                                     90, 50, 10, 10, 10, 30, 10, 10};
    g_autoptr(Sweep) sweep = feed_values(values, G_N_ELEMENTS(values), 4000);
    float peak, width, bright;
    sweep_finish(sweep, 15, &(struct sweep_pulses){&peak, &width, &bright}, NULL);
    g_assert_cmpfloat_with_epsilon(peak, 8, 1e-6);
    finish_second(sweep, 15, &peak, &width, &bright);
    g_assert_cmpfloat_with_epsilon(peak, 3, 1e-6);
    g_assert_cmpfloat(bright, ==, 50);
    finish_second(sweep, 60, &peak, &width, &bright);
    g_assert_cmpfloat(peak, ==, -1);
}

TEST(no_second) {
    static const guint16 values[] = {10, 10, 50, 90, 50, 10, 10, 10};
    g_autoptr(Sweep) sweep = feed_values(values, G_N_ELEMENTS(values), 4000);
    float peak, width, bright;
    finish_second(sweep, 15, &peak, &width, &bright);
    g_assert_cmpfloat(peak, ==, -1);
    g_assert_cmpfloat(bright, ==, 0);
}

/* Noise above what is taken for it must not fill the memory. */
TEST(noise_alone) {
    enum { SIDE = 64, FRAMES = 200 };
    g_autoptr(Sweep) sweep = sweep_new(SIDE, SIDE, FRAMES, 4000);
    guint16 pixels[SIDE * SIDE];
    GRand *random = g_rand_new_with_seed(2);
    for (int t = 0; t < FRAMES; t++) {
        for (int i = 0; i < SIDE * SIDE; i++)
            pixels[i] = (guint16)(100 + (t > 5 ? g_rand_int_range(random, 0, 60) : 0));
        sweep_add(sweep, pixels);
    }
    g_rand_free(random);
    g_test_message("%" G_GSIZE_FORMAT " bytes", sweep_bytes(sweep));
    g_assert_cmpuint(sweep_bytes(sweep), <, (gsize)SIDE * SIDE * FRAMES * 3 / 2);
}

/* Whatever the number of pixels and frames, queued or absorbed, the answer is the same. */
TEST(sizes) {
    for (int n = 1; n < 40; n += 3)
        for (int frames = 9; frames < 22; frames++) {
            g_autofree double *centre = random_centres(n, 2, 7);
            struct pulses pulses = {n, 1, frames, 4095, 1, 2000, 64, 0, centre};
            struct result result = measure(&pulses, 100);
            g_assert_cmpint(result.missing, ==, 0);
            g_assert_cmpfloat(result.rms, <, 0.01);
        }
}

/* sweep_finish() may look in between. */
TEST(look_in_between) {
    g_autoptr(Sweep) sweep = sweep_new(1, 1, 20, 65535);
    float peak, width, bright;
    for (int t = 0; t < 20; t++) {
        guint16 value = (guint16)(t == 10 ? 500 : t == 9 || t == 11 ? 200 : 5);
        sweep_add(sweep, &value);
        sweep_finish(sweep, 50, &(struct sweep_pulses){&peak, &width, &bright}, NULL);
        g_assert_cmpfloat(peak, ==, t > 10 ? 10 : -1);
    }
}

/* What a line and flickering light leave, of frames that come so many at a time. */
static GBytes *leave(const guint16 *frames, int width, int height, int n_frames, int together) {
    const gsize n = (gsize)width * (gsize)height;
    g_autoptr(Sweep) sweep = sweep_new(width, height, n_frames, 900);
    for (int t = 0; t < n_frames; t += together) {
        g_autofree const guint16 **some = g_new(const guint16 *, together);
        const int k = MIN(together, n_frames - t);
        for (int i = 0; i < k; i++)
            some[i] = frames + (gsize)(t + i) * n;
        sweep_add_some(sweep, some, k);
    }
    float *left = g_new(float, 6 * n);
    const struct sweep_pulses first = {left, left + n, left + 2 * n};
    const struct sweep_pulses second = {left + 3 * n, left + 4 * n, left + 5 * n};
    sweep_finish(sweep, 50, &first, &second);
    return g_bytes_new_take(left, 6 * n * sizeof *left);
}

/* However many frames are handed over at a time, to the bit, whether or not the memory gets tight.
 */
TEST(together) {
    enum { WIDTH = 67, HEIGHT = 31, FRAMES = 90, N = WIDTH * HEIGHT };
    g_autofree guint16 *frames = g_new(guint16, FRAMES * N);
    for (int flicker = 0; flicker < 60; flicker += 25) {
        GRand *random = g_rand_new_with_seed(9);
        for (int i = 0; i < FRAMES * N; i++) {
            const double u = i % N % WIDTH + 5 - i / N;
            const int noise = g_rand_int_range(random, 0, i / N > 4 ? 10 + flicker : 10);
            frames[i] = (guint16)(60 + noise + lround(1200 * exp(-u * u / 4)));
        }
        g_rand_free(random);
        g_autoptr(GBytes) single = leave(frames, WIDTH, HEIGHT, FRAMES, 1);
        for (int together = 2; together < 12; together++) {
            g_autoptr(GBytes) some = leave(frames, WIDTH, HEIGHT, FRAMES, together);
            g_assert_true(g_bytes_equal(single, some));
        }
        const float *peak = g_bytes_get_data(single, NULL);
        for (int i = 0; i < N; i++)
            g_assert_cmpfloat_with_epsilon(peak[i], i % WIDTH + 5, 0.3);
    }
}

BEFORE_TESTS {
    g_test_add_data_func("/sweep/many-frames", &many_frames, test_bounds);
    g_test_add_data_func("/sweep/saturated", &saturated, test_bounds);
    g_test_add_data_func("/sweep/wide", &wide_lines, test_bounds);
}
