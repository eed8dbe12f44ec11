/* Metrics of pictures, compared with independent programs: flip-evaluator by the authors of FLIP,
 * and scikit-image. */
#include "base/srgb.h"
#include "lib/test.h"
#include "metrics/delta_e.h"
#include "metrics/flip.h"
#include "metrics/psnr.h"
#include "metrics/ssim.h"

#include <math.h>

struct flip {
    double mean, corner, inside; /* of the picture, at (0, 0), and at (width / 3, height / 2) */
};

/* tests/bench/peers/metrics_reference.py made these rows: flip-evaluator 1.7, scikit-image
 * 0.26.0. */
static const struct reference {
    const char *name;
    int width, height;
    double pixels_per_degree, factor;
    struct flip ldr, hdr;
    double ssim, psnr;
} references[] = {
    {"noise",
     40,
     30,
     67.0,
     1,
     {0.101433, 0.289414, 0.083334},
     {0.096643, 0.523900, 0.044645},
     0.5401103,
     26.642576},
    {"shift",
     33,
     47,
     67.0,
     1,
     {0.217673, 0.076306, 0.201371},
     {0.177039, 0.032530, 0.160690},
     0.6251723,
     15.458998},
    {"blur",
     64,
     48,
     30.0,
     1,
     {0.559429, 0.876147, 0.234458},
     {0.486875, 0.772061, 0.193796},
     0.1466234,
     13.101069},
    {"stripes",
     48,
     20,
     67.0,
     1,
     {0.245999, 0.674110, 0.194967},
     {0.209836, 0.543545, 0.245471},
     0.0198743,
     13.365490},
    {"levels",
     50,
     31,
     67.0,
     1,
     {0.299588, 0.528873, 0.295973},
     {0.374775, 0.799702, 0.338695},
     0.6393665,
     17.668351},
    {"hue",
     60,
     60,
     40.0,
     1,
     {0.431394, 0.000000, 0.958135},
     {0.423210, 0.000000, 0.953428},
     0.4789620,
     12.996808},
    {"contrast",
     24,
     36,
     67.0,
     1,
     {0.479732, 0.799392, 0.281399},
     {0.428749, 0.971763, 0.221403},
     0.8647098,
     18.264156},
    {"opposite",
     16,
     12,
     67.0,
     1,
     {1.000000, 1.000000, 1.000000},
     {0.996169, 0.996168, 0.996168},
     0.3334000,
     1.760913},
    {"small",
     7,
     5,
     67.0,
     1,
     {0.588620, 0.527153, 0.608710},
     {0.535749, 0.521291, 0.590260},
     NAN,
     10.028323},
    {"darker",
     45,
     45,
     67.0,
     1,
     {0.249150, 0.036298, 0.246312},
     {0.454401, 0.476775, 0.426354},
     0.9155575,
     25.013029},
    {"bright noise",
     40,
     30,
     67.0,
     8,
     {0.577976, 0.971965, 0.768497},
     {0.601031, 0.973081, 0.592775},
     0.6254693,
     11.131032},
    {"bright blocks",
     51,
     35,
     50.0,
     20,
     {0.131472, 0.005198, 0.004388},
     {0.219312, 0.281490, 0.243064},
     0.9579772,
     30.344962},
};

static double noise(unsigned x, unsigned y, unsigned c) {
    guint32 h = x * 374761393U + y * 668265263U + c * 2246822519U;
    h = (h ^ h >> 13) * 1274126177U;
    return ((h ^ h >> 16) & 0xffff) / 65535.0;
}

static double blurred(int x, int y, int c) {
    double sum = 0;
    for (int i = 0; i < 9; i++)
        sum += noise(x + i % 3, y + i / 3, c);
    return sum / 9;
}

/* The same as value() in tests/bench/peers/metrics_reference.py. */
static double value(int kind, int test, int x, int y, int c, int w, int h) {
    static const double disk[] = {0.7, 0.3, 0.1};
    const double ramp = c == 0 ? (x + 0.5) / w : c == 1 ? (y + 0.5) / h : (x + y + 1.0) / (w + h);
    switch (kind) {
    case 0:
        return 0.1 + 0.8 * ramp + (test ? 0.2 * (noise(x, y, c) - 0.5) : 0);
    case 1:
        return 0.1 + 0.7 * (((x + test) / 6 + y / 6) % 2) * (c + 1) / 3.0;
    case 2:
        return test ? blurred(x, y, c) : noise(x, y, c);
    case 3:
        return test ? 0.5 : 0.2 + 0.6 * (x / 2 % 2);
    case 4:
        return test ? (int)(ramp * 6) / 6.0 : ramp;
    case 5:
        return (2 * x - w) * (2 * x - w) + (2 * y - h) * (2 * y - h) < w * h / 2.0
                   ? disk[(c + test) % 3]
                   : 0.4;
    case 6:
        return test ? 0.25 + 0.5 * ramp : ramp;
    case 7:
        return c == 1 + test;
    case 8:
        return noise(x + 50 * test, y, c);
    case 9:
        return 0.05 * ramp * (test ? 0.5 : 1);
    case 10:
        return ramp * ramp * ramp + (test ? 0.1 * noise(x, y, c) : 0);
    default:
        return noise(x / 5, y / 5, c) * noise(x / 5, y / 5, 7) * (test ? 0.8 : 1);
    }
}

static float *picture(int kind, int test) {
    const struct reference *of = &references[kind];
    const int n = 3 * of->width * of->height;
    float *ret = g_new(float, n);
    for (int i = 0; i < n; i++)
        ret[i] = (float)(of->factor * value(kind, test, i / 3 % of->width, i / 3 / of->width, i % 3,
                                            of->width, of->height));
    return ret;
}

typedef double (*Flip)(const float *reference, const float *test, int width, int height,
                       double pixels_per_degree, float *ret_map);

/* Single pixels have 5e-4, because a square root makes small differences of features larger. */
static void assert_flip(Flip flip, int kind, const struct flip *expected) {
    const struct reference *of = &references[kind];
    const gsize n = (gsize)of->width * (gsize)of->height;
    g_autofree float *a = picture(kind, 0), *b = picture(kind, 1), *map = g_new(float, n);
    const double mean = flip(a, b, of->width, of->height, of->pixels_per_degree, map);
    const double inside = map[of->height / 2 * of->width + of->width / 3];
    g_test_message("%s: %.6f, expected %.6f; pixels %.6f and %.6f", of->name, mean, expected->mean,
                   (double)map[0], inside);
    g_assert_cmpfloat_with_epsilon(mean, expected->mean, 1e-4);
    g_assert_cmpfloat_with_epsilon(map[0], expected->corner, 5e-4);
    g_assert_cmpfloat_with_epsilon(inside, expected->inside, 5e-4);
    g_assert_cmpfloat(mean, ==, flip(a, b, of->width, of->height, of->pixels_per_degree, NULL));
    g_assert_cmpfloat(flip(a, a, of->width, of->height, of->pixels_per_degree, NULL), ==, 0);
}

TEST(flip_ldr) {
    for (gsize i = 0; i < G_N_ELEMENTS(references); i++)
        assert_flip(flip_ldr, (int)i, &references[i].ldr);
}

TEST(flip_hdr) {
    for (gsize i = 0; i < G_N_ELEMENTS(references); i++)
        assert_flip(flip_hdr, (int)i, &references[i].hdr);
}

/* flip-evaluator 1.7 refuses a black reference. */
TEST(flip_black) {
    static const float black[3 * 4], grey[3 * 4] = {0.1F, 0.1F, 0.1F, 0.1F, 0.1F, 0.1F};
    g_assert_cmpfloat(flip_hdr(black, black, 2, 2, FLIP_PIXELS_PER_DEGREE, NULL), ==, 0);
    g_assert_cmpfloat(flip_hdr(black, grey, 2, 2, FLIP_PIXELS_PER_DEGREE, NULL), >, 0.1);
    g_assert_cmpfloat_with_epsilon(FLIP_PIXELS_PER_DEGREE, 67.0206, 1e-4); /* sec. 5 of the paper */
}

TEST(ssim) {
    for (gsize i = 0; i < G_N_ELEMENTS(references); i++) {
        const struct reference *of = &references[i];
        g_autofree float *a = picture((int)i, 0), *b = picture((int)i, 1);
        const double found = ssim(a, b, of->width, of->height);
        g_test_message("%s: %.7f, expected %.7f", of->name, found, of->ssim);
        g_assert_cmpint(isnan(found), ==, isnan(of->ssim));
        if (isnan(found))
            continue;
        g_assert_cmpfloat_with_epsilon(found, of->ssim, 1e-6);
        g_assert_cmpfloat_with_epsilon(ssim(a, a, of->width, of->height), 1, 1e-12);
    }
}

TEST(psnr) {
    for (gsize i = 0; i < G_N_ELEMENTS(references); i++) {
        const struct reference *of = &references[i];
        g_autofree float *a = picture((int)i, 0), *b = picture((int)i, 1);
        g_assert_cmpfloat_with_epsilon(psnr(a, b, of->width, of->height), of->psnr, 1e-5);
        g_assert_true(isinf(psnr(a, a, of->width, of->height)));
    }
}

/* Noise of a known variance, added to the coded values: 10 log10 (1 / σ²). */
TEST(psnr_noise) {
    enum { SIDE = 200, N = 3 * SIDE * SIDE };
    g_autofree float *a = g_new(float, N), *b = g_new(float, N);
    const double half = 0.05; /* uniform in ± half: a variance of half² / 3 */
    for (int i = 0; i < N; i++) {
        const double coded = 0.1 + 0.8 * noise(i, 1, 0);
        a[i] = (float)srgb_decode(coded);
        b[i] = (float)srgb_decode(coded + half * (2 * noise(i, 2, 1) - 1));
    }
    g_assert_cmpfloat_with_epsilon(psnr(a, b, SIDE, SIDE), -10 * log10(half * half / 3), 0.05);
    g_assert_cmpfloat_with_epsilon(psnr_decibels(0.01), 20, 1e-12);
}

/* Light above white and below black is not seen. */
TEST(clipped) {
    static const float a[] = {1, 0, 0.5F}, b[] = {7, -3, 0.5F}, c[] = {0.9F, 0, 0.5F};
    float shown[3];
    g_assert_true(isinf(psnr(a, b, 1, 1)));
    g_assert_cmpfloat(flip_ldr(a, b, 1, 1, FLIP_PIXELS_PER_DEGREE, NULL), ==, 0);
    g_assert_cmpfloat(flip_ldr(c, b, 1, 1, FLIP_PIXELS_PER_DEGREE, NULL), >, 0);
    psnr_show(b, 3, shown);
    g_assert_cmpfloat(shown[0], ==, 1);
    g_assert_cmpfloat(shown[1], ==, 0);
    g_assert_cmpfloat_with_epsilon(shown[2], 0.735357, 1e-6);
}

/* Published with the formula (Sharma, Wu & Dalal 2005, Table 1). */
TEST(delta_e) {
    static const double pairs[][7] = {
        {50, 2.6772, -79.7751, 50, 0, -82.7485, 2.0425},
        {50, 3.1571, -77.2803, 50, 0, -82.7485, 2.8615},
        {50, 2.8361, -74.0200, 50, 0, -82.7485, 3.4412},
        {50, -1.3802, -84.2814, 50, 0, -82.7485, 1.0000},
        {50, 0, 0, 50, -1, 2, 2.3669},
        {50, -1, 2, 50, 0, 0, 2.3669},
        {50, 2.4900, -0.0010, 50, -2.4900, 0.0009, 7.1792},
        {50, 2.4900, -0.0010, 50, -2.4900, 0.0011, 7.2195},
        {50, -0.0010, 2.4900, 50, 0.0009, -2.4900, 4.8045},
        {50, 2.5, 0, 73, 25, -18, 27.1492},
        {50, 2.5, 0, 61, -5, 29, 22.8977},
        {50, 2.5, 0, 56, -27, -3, 31.9030},
        {50, 2.5, 0, 58, 24, 15, 19.4535},
        {60.2574, -34.0099, 36.2677, 60.4626, -34.1751, 39.4387, 1.2644},
        {63.0109, -31.0961, -5.8663, 62.8187, -29.7946, -4.0864, 1.2630},
        {6.7747, -0.2908, -2.4247, 5.8714, -0.0985, -2.2286, 0.6377},
        {2.0776, 0.0795, -1.1350, 0.9033, -0.0636, -0.5514, 0.9082},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(pairs); i++)
        g_assert_cmpfloat_with_epsilon(delta_e_2000(pairs[i], pairs[i] + 3), pairs[i][6], 1e-4);
}

/* Of the primaries of sRGB, as they are commonly tabulated. */
TEST(lab) {
    static const float rgb[][3] = {{1, 1, 1}, {0, 0, 0}, {1, 0, 0}, {0, 0, 1}, {-1, -2, -3}};
    static const double labs[][3] = {{100, 0, 0},
                                     {0, 0, 0},
                                     {53.2408, 80.0925, 67.2032},
                                     {32.2970, 79.1875, -107.8602},
                                     {0, 0, 0}};
    for (gsize i = 0; i < G_N_ELEMENTS(labs); i++) {
        double lab[3];
        delta_e_lab(rgb[i], lab);
        for (int k = 0; k < 3; k++)
            g_assert_cmpfloat_with_epsilon(lab[k], labs[i][k], 0.02);
    }
}
