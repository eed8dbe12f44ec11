#include "base/data_error.h"
#include "frames/rectify.h"

#include "lib/analytic.h"
#include "lib/test.h"
#include "pipeline/pipeline.h"

#include <math.h>

#define DEGREE (G_PI / 180)

static const struct session_grid grid = {24, 20, 36, 30, 5, 5};
static const char *const filters[] = {"mono", "rggb", "bggr", "grbg", "gbrg"};

static struct pinhole camera_at(double theta_deg, double focal_px) {
    return (struct pinhole){160, 160, theta_deg * DEGREE, 650, focal_px};
}

static int colour_at(const char *cfa, int x, int y) {
    if (strcmp(cfa, "mono") == 0)
        return 1;
    char c = cfa[2 * (y & 1) + (x & 1)];
    return c == 'r' ? 0 : c == 'g' ? 1 : 2;
}

/* Each colour's picture is linear in x and y, with slopes of its own. */
static double linear_at(int colour, double x, double y) {
    static const double slope[3][3] = {{2, 0.011, -0.007}, {3, -0.013, 0.017}, {1, 0.005, 0.009}};
    return slope[colour][0] + slope[colour][1] * x + slope[colour][2] * y;
}

static float *linear_mosaic(const char *cfa, const struct rig_camera *camera) {
    float *mosaic = g_new(float, camera->width * camera->height);
    for (int y = 0; y < camera->height; y++)
        for (int x = 0; x < camera->width; x++)
            mosaic[y * camera->width + x] = (float)linear_at(colour_at(cfa, x, y), x, y);
    return mosaic;
}

static void texel_in_picture(const struct pinhole *pinhole, double turntable, int texel,
                             double *ret_x, double *ret_y) {
    double x = -18 + (texel % 24 + 0.5) * 1.5, y = 15 - ((double)(texel / 24) + 0.5) * 1.5;
    double p[3] = {x, y, 5};
    analytic_turn(p, turntable, p);
    pinhole_project(pinhole, p, ret_x, ret_y);
}

static void check_linear(const char *cfa, const struct pinhole *pinhole, double turntable) {
    g_autoptr(GError) error = NULL;
    struct rig_camera camera = pinhole_to_rig(pinhole, "cam");
    camera.response = 1000; /* a DN a millisecond is one unit of radiance */
    g_autoptr(Rectify) rectify = rectify_new(&camera, NULL, cfa, turntable, &grid, &error);
    g_assert_no_error(error);
    g_autofree float *mosaic = linear_mosaic(cfa, &camera), *rgb = g_new(float, 24 * 20 * 3);
    g_assert_cmpint(rectify_apply(rectify, mosaic, rgb, NULL), ==, 0);
    for (int texel = 0; texel < 24 * 20; texel++)
        for (int c = 0; c < 3; c++) {
            double x, y;
            texel_in_picture(pinhole, turntable, texel, &x, &y);
            double expected = linear_at(strcmp(cfa, "mono") == 0 ? 1 : c, x, y);
            double most = strcmp(cfa, "mono") == 0 ? 1e-4 : 5e-3 * (1 + expected);
            g_assert_cmpfloat_with_epsilon(rgb[3 * texel + c], expected, most);
        }
}

/* No filter's phase moves a colour: pictures linear in x and y come out as they are, or to half a
 * percent where each colour has slopes of its own, at every magnification, whatever the view. */
TEST(linear) {
    for (guint f = 0; f < G_N_ELEMENTS(filters); f++)
        for (int view = 0; view < 12; view++)
            for (double focal_px = 400; focal_px < 1700; focal_px *= 2) {
                struct pinhole pinhole = camera_at(15 * (view % 6), focal_px);
                check_linear(filters[f], &pinhole, 0.7 * view);
            }
}

/* Planes of red, green and blue: each comes out at its own place, and what is no number in one of
 * them is a hole. */
TEST(rgb) {
    struct pinhole pinhole = camera_at(30, 800);
    struct rig_camera camera = pinhole_to_rig(&pinhole, "cam");
    camera.response = 1000;
    g_autoptr(Rectify) rectify = rectify_new(&camera, NULL, "rgb", 0.7, &grid, NULL);
    g_autofree float *planes = g_new(float, 3 * 160 * 160), *rgb = g_new(float, 24 * 20 * 3);
    guint8 holes[24 * 20];
    for (int i = 0; i < 3 * 160 * 160; i++)
        planes[i] = (float)linear_at(i / (160 * 160), i % 160, (double)(i / 160 % 160));
    rectify_guide(rectify, planes);
    g_assert_cmpint(rectify_apply(rectify, planes, rgb, holes), ==, 0);
    for (int i = 0; i < 24 * 20 * 3; i++) {
        double x, y;
        texel_in_picture(&pinhole, 0.7, i / 3, &x, &y);
        g_assert_cmpfloat_with_epsilon(rgb[i], linear_at(i % 3, x, y), 1e-4);
    }
    planes[2 * 160 * 160 + 80 * 160 + 80] = NAN;
    const int n = rectify_apply(rectify, planes, rgb, holes);
    g_assert_cmpint(n, >, 0);
    g_assert_cmpint(n, <, 20);
    for (int i = 0; i < 24 * 20; i++)
        g_assert_true(holes[i] == (rgb[3 * i] == 0 && rgb[3 * i + 1] == 0 && rgb[3 * i + 2] == 0));
}

/* Middle of a colour's light in a picture of texels. */
static void middle_of(const float *rgb, int colour, double ret[2]) {
    double sum = 0;
    ret[0] = ret[1] = 0;
    for (int i = 0; i < grid.width * grid.height; i++) {
        const double value = (double)rgb[3 * i + colour] - 0.2;
        sum += value;
        ret[0] += value * (i % grid.width);
        ret[1] += value * (int)(i / grid.width);
    }
    ret[0] /= sum;
    ret[1] /= sum;
}

/* Lateral colour: a spot whose red and blue light arrive next to its green light. In texels all of
 * it is at one place, and what is even stays even. One texel is 2 pixels. */
static const struct lateral {
    const char *path, *cfa;
    double larger[3];
} laterals[] = {
    {"/rectify/lateral/filter", "rggb", {4e-3, -1e-3, -2e-3}},
    {"/rectify/lateral/other filter", "gbrg", {-4e-3, 1e-3, 2e-3}},
    {"/rectify/lateral/more than a pixel", "rggb", {3e-2, 0, -3e-2}},
    {"/rectify/lateral/colours", "rgb", {4e-3, -1e-3, -2e-3}},
    {"/rectify/lateral/colours far apart", "rgb", {3e-2, 0, -3e-2}},
};

static void test_lateral(gconstpointer data) {
    const struct lateral *lateral = data;
    struct pinhole pinhole = {160, 160, 0, 650, 2 * 645 / 1.5};
    struct rig_camera camera = pinhole_to_rig(&pinhole, "cam");
    const gboolean planes = strcmp(lateral->cfa, "rgb") == 0;
    const int n = planes ? 3 * 160 * 160 : 160 * 160;
    g_autofree float *spot = g_new(float, n), *even = g_new(float, n);
    g_autofree float *rgb = g_new(float, 24 * 20 * 3);
    guint8 flags[24 * 20], of_red[24 * 20], saturated[160 * 160] = {0};
    double worst[2] = {0, 0};
    camera.response = 1000;
    camera.cx_px = 20; /* far from the spot */
    camera.cy_px = 140;
    camera.translation_mm.x += (79.5 - camera.cx_px) * 650 / camera.fx_px;
    camera.translation_mm.y += (79.5 - camera.cy_px) * 650 / camera.fy_px;
    for (int i = 0; i < n; i++) {
        const int x = i % 160, y = i / 160 % 160;
        const int c = planes ? i / (160 * 160) : colour_at(lateral->cfa, x, y);
        const double u = camera.cx_px + (x - camera.cx_px) / (1 + lateral->larger[c]);
        const double v = camera.cy_px + (y - camera.cy_px) / (1 + lateral->larger[c]);
        spot[i] = (float)(0.2 + exp(-(pow(u - 82, 2) + pow(v - 77, 2)) / (2 * 5 * 5)));
        even[i] = 0.7f;
    }
    for (int corrected = 0; corrected < 2; corrected++) {
        double middle[3][2];
        memcpy(camera.lateral_colour, lateral->larger,
               corrected ? sizeof camera.lateral_colour : 0);
        g_autoptr(Rectify) rectify = rectify_new(&camera, NULL, lateral->cfa, 0, &grid, NULL);
        g_assert_nonnull(rectify);
        g_assert_cmpint(rectify_apply(rectify, spot, rgb, NULL), ==, 0);
        for (int c = 0; c < 3; c++)
            middle_of(rgb, c, middle[c]);
        for (int c = 0; c < 3; c += 2)
            worst[corrected] = MAX(worst[corrected], 2 * hypot(middle[c][0] - middle[1][0],
                                                               middle[c][1] - middle[1][1]));
        /* Values of pixels that agree, whatever their weights. */
        rectify_apply(rectify, even, rgb, NULL);
        for (int i = 0; i < 24 * 20 * 3; i++)
            g_assert_cmpfloat_with_epsilon(rgb[i], 0.7, 1e-5);
        /* Saturated pixels are so in the texels that they are weighed in, of any plane. */
        struct rig_camera red = rig_camera_of_colour(&camera, 0);
        memset(red.lateral_colour, 0, sizeof red.lateral_colour);
        g_autoptr(Rectify) one = rectify_new(&red, NULL, "rgb", 0, &grid, NULL);
        for (int x = 60; x < 100; x += 7)
            saturated[77 * 160 + x] = 1;
        rectify_flags(rectify, saturated, flags);
        rectify_flags(one, saturated, of_red);
        int flagged = 0;
        for (int i = 0; i < 24 * 20; i++) {
            flagged += flags[i];
            g_assert_true(flags[i] >= of_red[i] || !planes);
        }
        g_assert_cmpint(flagged, >, 5);
        g_assert_cmpint(flagged, <, 60);
    }
    g_test_message("red and blue are %.4f px off, %.4f px", worst[0], worst[1]);
    const double most = MAX(fabs(lateral->larger[0] - lateral->larger[1]),
                            fabs(lateral->larger[2] - lateral->larger[1]));
    g_assert_cmpfloat_with_epsilon(worst[0], most * hypot(82 - 20, 77 - 140),
                                   0.1 * most * hypot(82 - 20, 77 - 140));
    g_assert_cmpfloat(worst[1], <, 0.005 * worst[0]);
}

/* The picture of a white diffuser under vignetting comes out flat. */
TEST(vignetting) {
    struct pinhole pinhole = camera_at(30, 1664);
    struct rig_camera camera = pinhole_to_rig(&pinhole, "cam");
    camera.vignetting = 0.3;
    g_autoptr(Rectify) rectify = rectify_new(&camera, NULL, "rggb", 1, &grid, NULL);
    g_autofree float *mosaic = g_new(float, 160 * 160), *rgb = g_new(float, 24 * 20 * 3);
    for (int y = 0; y < 160; y++)
        for (int x = 0; x < 160; x++) {
            double r2 = (pow(x - 79.5, 2) + pow(y - 79.5, 2)) / (2 * 79.5 * 79.5);
            mosaic[160 * y + x] = (float)(6 * 0.25 * (1 - 0.3 * r2)); /* 6 DN/ms a unit */
        }
    rectify_apply(rectify, mosaic, rgb, NULL);
    for (int i = 0; i < 24 * 20 * 3; i++)
        g_assert_cmpfloat_with_epsilon(rgb[i], 0.25, 1e-6);
}

/* What a single pixel gives away to all texels is the number of texels that its area covers.
 * Straight from above, with a texel of p × p pixels. */
TEST(energy) {
    struct pinhole pinhole = {160, 160, 0, 650, 0};
    for (double p = 0.7; p < 4; p += 0.9) {
        pinhole.focal_px = p * 645 / 1.5;
        struct rig_camera camera = pinhole_to_rig(&pinhole, "cam");
        camera.response = 1000;
        g_autoptr(Rectify) rectify = rectify_new(&camera, NULL, "mono", 0, &grid, NULL);
        g_autofree float *mosaic = g_new0(float, 160 * 160), *rgb = g_new(float, 24 * 20 * 3);
        double sum[3] = {0};
        mosaic[160 * 78 + 80] = 4;
        rectify_apply(rectify, mosaic, rgb, NULL);
        for (int i = 0; i < 24 * 20 * 3; i++)
            sum[i % 3] += rgb[i];
        for (int c = 0; c < 3; c++)
            g_assert_cmpfloat_with_epsilon(sum[c] * p * p, 4, p < 1 ? 0.4 : 0.1);
    }
}

/* Stripes finer than red or blue pixels can show only, of a colour all over: each colour follows
 * them as green does, and none goes below black. */
TEST(detail) {
    static const double tint[3] = {0.8, 0.5, 0.1};
    struct pinhole pinhole = camera_at(15, 1664);
    struct rig_camera camera = pinhole_to_rig(&pinhole, "cam");
    camera.response = 1000;
    g_autoptr(Rectify) rectify = rectify_new(&camera, NULL, "rggb", 0, &grid, NULL);
    g_autofree float *mosaic = g_new(float, 160 * 160), *rgb = g_new(float, 24 * 20 * 3);
    for (int y = 0; y < 160; y++)
        for (int x = 0; x < 160; x++)
            mosaic[160 * y + x] =
                (float)(tint[colour_at("rggb", x, y)] * (1 + 0.8 * sin(2 * G_PI * x / 5.0)));
    rectify_apply(rectify, mosaic, rgb, NULL);
    double error[3] = {0}, alone = 0;
    for (int texel = 0; texel < 24 * 20; texel++) {
        double x, y;
        texel_in_picture(&pinhole, 0, texel, &x, &y);
        /* The mean over a texel's 3.87 pixels. */
        double u = G_PI * 3.87 / 5, expected = 1 + 0.8 * sin(2 * G_PI * x / 5) * sin(u) / u;
        for (int c = 0; c < 3; c++) {
            g_assert_cmpfloat(rgb[3 * texel + c], >, 0);
            error[c] += pow(rgb[3 * texel + c] / tint[c] - expected, 2);
        }
        alone += pow(1 - expected, 2);
    }
    for (int c = 0; c < 3; c++)
        g_assert_cmpfloat(sqrt(error[c] / alone), <, 0.45);
    g_assert_cmpfloat(sqrt(error[1] / alone), <, 0.35);
}

/* Texels at the very border of the picture: no pixel is read that is not there. */
TEST(border) {
    for (guint f = 0; f < G_N_ELEMENTS(filters); f++)
        for (int size = 93; size < 97; size++) {
            struct pinhole pinhole = {size, size - 16, 0, 645 + 5, 1664};
            struct rig_camera camera = pinhole_to_rig(&pinhole, "cam");
            camera.response = 1000;
            g_autoptr(Rectify) rectify = rectify_new(&camera, NULL, filters[f], 0, &grid, NULL);
            if (!rectify) /* a picture that is too small is refused */
                continue;
            int n = camera.width * camera.height;
            g_autofree float *mosaic = g_new(float, n), *rgb = g_new(float, 24 * 20 * 3);
            for (int i = 0; i < n; i++)
                mosaic[i] = 3;
            guint8 is_hole[24 * 20];
            int holes = rectify_apply(rectify, mosaic, rgb, is_hole);
            for (int i = 0; i < 24 * 20; i++) {
                holes -= is_hole[i];
                for (int c = 0; c < 3; c++)
                    g_assert_true(is_hole[i] ? rgb[3 * i + c] == 0
                                             : fabsf(rgb[3 * i + c] - 3) < 1e-4f);
            }
            g_assert_cmpint(holes, ==, 0);
        }
}

TEST(holes) {
    struct pinhole pinhole = camera_at(15, 1664);
    struct rig_camera camera = pinhole_to_rig(&pinhole, "cam");
    g_autoptr(Rectify) rectify = rectify_new(&camera, NULL, "rggb", 0, &grid, NULL);
    g_autofree float *mosaic = g_new(float, 160 * 160), *rgb = g_new(float, 24 * 20 * 3);
    for (int i = 0; i < 160 * 160; i++)
        mosaic[i] = 1;
    mosaic[80 * 160 + 80] = NAN;
    mosaic[60 * 160 + 61] = INFINITY;
    int holes = rectify_apply(rectify, mosaic, rgb, NULL);
    g_assert_cmpint(holes, >, 0);
    g_assert_cmpint(holes, <, 30);
    int zeros = 0;
    for (int i = 0; i < 24 * 20; i++) {
        g_assert_true(isfinite(rgb[3 * i]) && isfinite(rgb[3 * i + 1]) && isfinite(rgb[3 * i + 2]));
        zeros += rgb[3 * i] == 0 && rgb[3 * i + 1] == 0 && rgb[3 * i + 2] == 0;
    }
    g_assert_cmpint(zeros, ==, holes);
}

TEST(outside) {
    g_autoptr(GError) error = NULL;
    struct pinhole pinhole = camera_at(15, 5000);
    struct rig_camera camera = pinhole_to_rig(&pinhole, "cam7");
    g_assert_null(rectify_new(&camera, NULL, "rggb", 0, &grid, &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
    g_assert_nonnull(strstr(error->message, "cam7"));
    g_assert_nonnull(strstr(error->message, "calibrate"));
    g_clear_error(&error);
    pinhole.focal_px = 1664;
    camera = pinhole_to_rig(&pinhole, "cam7");
    camera.translation_mm.z = -650; /* behind the camera */
    g_assert_null(rectify_new(&camera, NULL, "rggb", 0, &grid, &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
    g_clear_error(&error);
    camera.translation_mm.z = NAN;
    g_assert_null(rectify_new(&camera, NULL, "rggb", 0, &grid, &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
    g_clear_error(&error);
    g_assert_null(rectify_new(&camera, NULL, "xtrans", 0, &grid, &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
}

/* Of a picture in which a single pixel has a variance of 1, texels have the squares of their
 * derivatives by that pixel, as a small change of it shows. Colours vary, so that the excess over
 * the guide counts as well. */
TEST(variance) {
    const float change = 2e-3f;
    for (guint f = 0; f < G_N_ELEMENTS(filters); f++) {
        struct pinhole pinhole = camera_at(40, 1100);
        struct rig_camera camera = pinhole_to_rig(&pinhole, "cam");
        camera.response = 1000;
        camera.vignetting = 0.1;
        g_autoptr(Rectify) rectify = rectify_new(&camera, NULL, filters[f], 0.5, &grid, NULL);
        g_autofree float *mosaic = linear_mosaic(filters[f], &camera), *pixels = NULL;
        g_autofree float *low = g_new(float, 24 * 20 * 3), *high = g_new(float, 24 * 20 * 3);
        g_autofree float *variance = g_new(float, 24 * 20 * 3);
        g_autofree float *detail = g_new(float, 24 * 20 * 3), *shift = g_new(float, 24 * 20 * 3);
        rectify_guide(rectify, mosaic);
        for (int i = 0; i < 160 * 160; i++)
            mosaic[i] *= 1 + 0.3f * sinf((float)i);
        for (int k = 0; k < 16; k++) {
            const int pixel = 160 * (76 + k / 2) + 70 + k % 4 * 5;
            float most = 0;
            pixels = g_renew(float, pixels, 160 * 160);
            memset(pixels, 0, sizeof(float) * 160 * 160);
            pixels[pixel] = 1;
            rectify_errors(rectify, mosaic, pixels, variance, detail, shift);
            mosaic[pixel] -= change;
            rectify_apply(rectify, mosaic, low, NULL);
            mosaic[pixel] += 2 * change;
            rectify_apply(rectify, mosaic, high, NULL);
            mosaic[pixel] -= change;
            for (int i = 0; i < 24 * 20 * 3; i++) {
                const float slope = (high[i] - low[i]) / (2 * change);
                most = MAX(most, fabsf(slope));
                g_assert_cmpfloat_with_epsilon(sqrtf(variance[i]), fabsf(slope), 1e-3);
            }
            g_assert_cmpfloat(most, >, 0.02);
        }
    }
}

/* A field of waves of many lengths and directions, of mean 0 and variance 1. */
static float *random_waves(guint32 seed, double shortest_px, double longest_px) {
    enum { WAVES = 40 };
    float *ret = g_new0(float, 160 * 160);
    GRand *rand = g_rand_new_with_seed(seed);
    for (int k = 0; k < WAVES; k++) {
        const double length = g_rand_double_range(rand, shortest_px, longest_px);
        const double angle = g_rand_double_range(rand, 0, G_PI);
        const double phase = g_rand_double_range(rand, 0, 2 * G_PI);
        for (int i = 0; i < 160 * 160; i++)
            ret[i] += (float)(sqrt(2.0 / WAVES) *
                              sin(2 * G_PI / length *
                                      (cos(angle) * (i % 160) + sin(angle) * (double)(i / 160)) +
                                  phase));
    }
    g_rand_free(rand);
    return ret;
}

/* Squared errors of a camera with a colour filter, as they are and as it says: means over texels
 * and colours. Its truth are the values that a camera with all three colours in each pixel finds.
 * pattern and chroma are what a light adds to ln m, of all colours alike and of red. The guide
 * shows three flat colours, or (same) these as well. */
struct filter_errors {
    double squares, detail;
};

static struct filter_errors find_filter_errors(double theta_deg, const float *pattern,
                                               const float *chroma, gboolean same) {
    static const float flat[] = {3, 2, 1};
    const int n = 160 * 160, texels = 24 * 20;
    const struct pinhole pinhole = camera_at(theta_deg, 1664);
    struct rig_camera camera = pinhole_to_rig(&pinhole, "cam");
    g_autoptr(Rectify) filtered = rectify_new(&camera, NULL, "rggb", 0.5, &grid, NULL);
    g_autoptr(Rectify) whole = rectify_new(&camera, NULL, "rgb", 0.5, &grid, NULL);
    g_autofree float *planes = g_new(float, 3 * n), *mosaic = g_new(float, n);
    g_autofree float *guide = g_new(float, n), *pixels = g_new0(float, n);
    g_autofree float *noise = g_new(float, 3 * texels), *detail = g_new(float, 3 * texels);
    g_autofree float *shift = g_new(float, 3 * texels);
    g_autofree float *rgb = g_new(float, 3 * texels), *truth = g_new(float, 3 * texels);
    struct filter_errors ret = {0};
    for (int i = 0; i < n; i++) {
        const int colour = colour_at("rggb", i % 160, i / 160);
        for (int c = 0; c < 3; c++)
            planes[c * n + i] = flat[c] * expf(pattern[i] + (c == 0 ? chroma[i] : 0));
        mosaic[i] = planes[colour * n + i];
        guide[i] = same ? mosaic[i] : flat[colour];
    }
    rectify_guide(filtered, guide);
    rectify_apply(filtered, mosaic, rgb, NULL);
    rectify_apply(whole, planes, truth, NULL);
    rectify_errors(filtered, mosaic, pixels, noise, detail, shift);
    for (int i = 0; i < 3 * texels; i++) {
        g_assert_cmpfloat(noise[i], ==, 0);
        ret.squares += pow((double)(rgb[i] - truth[i]), 2) / (3 * texels);
        ret.detail += (double)detail[i] / (3 * texels);
    }
    return ret;
}

/* What changes all colours alike from light to light needs none of a colour filter's error bars,
 * however sharp it is: they are of the size of the few errors that there are. Where red only
 * changes at edges, they hold its errors. */
TEST(colours) {
    g_autofree float *pattern = random_waves(1, 4, 20), *nothing = g_new0(float, 160 * 160);
    for (int i = 0; i < 160 * 160; i++)
        pattern[i] *= 0.3f;
    for (guint32 view = 0; view < 4; view++) {
        g_autofree float *red = random_waves(10 + view, 8, 40);
        for (int i = 0; i < 160 * 160; i++)
            red[i] = red[i] > 0 ? 0.3f : -0.3f;
        const struct filter_errors grey = find_filter_errors(20 * view, pattern, nothing, FALSE);
        const struct filter_errors coloured = find_filter_errors(20 * view, pattern, red, FALSE);
        g_test_message("%u°: grey %.3g, said %.3g; coloured %.3g, said %.3g", 20 * view,
                       grey.squares, grey.detail, coloured.squares, coloured.detail);
        g_assert_cmpfloat(grey.detail, >, grey.squares);
        g_assert_cmpfloat(grey.detail, <, 5 * grey.squares);
        g_assert_cmpfloat(coloured.detail, >, coloured.squares);
        g_assert_cmpfloat(coloured.detail, <, 8 * coloured.squares);
    }
}

/* Red that changes at random from pixel to pixel, under all lights alike: the guide, which sees it
 * in every fourth pixel, has wrong colours, and no light adds anything that would tell. Error bars
 * are a third to three times as large as the errors: the guide's green follows red in part, so that
 * colours seem to change less than they do. */
TEST(fine_colours) {
    g_autofree float *nothing = g_new0(float, 160 * 160), *red = g_new(float, 160 * 160);
    for (guint32 view = 0; view < 4; view++) {
        g_autoptr(GRand) rand = g_rand_new_with_seed(view);
        for (int i = 0; i < 160 * 160; i++)
            red[i] = g_rand_boolean(rand) ? 0.3f : -0.3f;
        const struct filter_errors fine = find_filter_errors(20 * view, nothing, red, TRUE);
        g_test_message("%u°: %.3g, said %.3g", 20 * view, fine.squares, fine.detail);
        g_assert_cmpfloat(sqrt(fine.detail), >, 0.33 * sqrt(fine.squares));
        g_assert_cmpfloat(sqrt(fine.detail), <, 3 * sqrt(fine.squares));
    }
}

/* Error bars of each colour of "rgb" are those of a grey camera that took its plane. */
TEST(variance_rgb) {
    enum { N = 160 * 160, VALUES = 24 * 20 * 3 };
    struct pinhole pinhole = camera_at(40, 1100);
    struct rig_camera camera = pinhole_to_rig(&pinhole, "cam");
    g_autoptr(Rectify) rgb = rectify_new(&camera, NULL, "rgb", 0.5, &grid, NULL);
    g_autoptr(Rectify) mono = rectify_new(&camera, NULL, "mono", 0.5, &grid, NULL);
    g_autofree float *frame = g_new(float, 3 * N), *pixels = g_new(float, 3 * N);
    float found[3][VALUES], wanted[3][VALUES];
    for (int i = 0; i < 3 * N; i++) {
        const int c = i / N;
        frame[i] = (float)(1 + c) * (1 + 0.3f * sinf((float)i));
        pixels[i] = 0.01f * frame[i] * (float)(3 - c);
    }
    rectify_errors(rgb, frame, pixels, found[0], found[1], found[2]);
    for (int c = 0; c < 3; c++) {
        rectify_errors(mono, frame + c * N, pixels + c * N, wanted[0], wanted[1], wanted[2]);
        for (int i = c; i < VALUES; i += 3)
            for (int k = 0; k < 3; k++)
                g_assert_cmpfloat(found[k][i], ==, wanted[k][i]);
    }
}

/* A list of texels has the values that these texels have in the whole grid, to the bit. */
TEST(some_texels) {
    static const int texels[] = {479, 0, 37, 240, 37};
    const struct pinhole pinhole = camera_at(30, 400);
    struct rig_camera camera = pinhole_to_rig(&pinhole, "cam");
    g_autoptr(GError) error = NULL;
    g_autoptr(Rectify) whole = rectify_new(&camera, NULL, "rggb", 0.3, &grid, &error);
    g_assert_no_error(error);
    g_autoptr(Rectify) some =
        rectify_new_at(&camera, NULL, "rggb", 0.3, &grid, texels, G_N_ELEMENTS(texels), &error);
    g_assert_no_error(error);
    g_autofree float *mosaic = linear_mosaic("rggb", &camera);
    float all[24 * 20 * 3], few[3 * G_N_ELEMENTS(texels)];
    g_assert_cmpint(rectify_apply(whole, mosaic, all, NULL), ==, 0);
    g_assert_cmpint(rectify_apply(some, mosaic, few, NULL), ==, 0);
    for (gsize i = 0; i < G_N_ELEMENTS(texels); i++)
        for (int c = 0; c < 3; c++)
            g_assert_true(few[3 * i + (gsize)c] == all[3 * texels[i] + c]);
}

BEFORE_TESTS {
    for (gsize i = 0; i < G_N_ELEMENTS(laterals); i++)
        g_test_add_data_func(laterals[i].path, &laterals[i], test_lateral);
}
