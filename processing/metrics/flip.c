/* FLIP is the colour difference of two pictures as the eye resolves them, raised to a power. The
 * power is smaller where the pictures differ in edges or points. Sections and equations are those
 * of Andersson et al. 2020. */
#include "flip.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define PLANES 3
#define Q_C    0.7F  /* sec. 4.1.4: exponent of the colour difference */
#define P_C    0.4F  /* sec. 4.1.4: the part P_C of the largest difference is mapped to P_T */
#define P_T    0.95F /* sec. 4.1.4: see P_C */
#define W      0.082 /* sec. 4.2.1: width of an edge, degrees */
#define Q_F    0.5F  /* eq. 9 of sec. 4.2.3: exponent of the feature difference */

/* The contrast sensitivity of each channel (table 1) is a sum of one or two Gaussians in the
 * picture: a √(π/b) exp(−π² x²/b), where x is in degrees. */
static const struct gaussian {
    double a, b;
} sensitivity[PLANES][2] = {
    {{1.0, 0.0047}},
    {{1.0, 0.0053}},
    {{34.1, 0.04}, {13.5, 0.025}},
};

/* Matrices between linear sRGB and XYZ, and the white of D65. The exact fractions are those of the
 * authors' program. */
static const double to_xyz[3][3] = {
    {10135552.0 / 24577794, 8788810.0 / 24577794, 4435075.0 / 24577794},
    {2613072.0 / 12288897, 8788810.0 / 12288897, 887015.0 / 12288897},
    {1425312.0 / 73733382, 8788810.0 / 73733382, 70074185.0 / 73733382},
};
static const float white[3] = {0.950428545377F, 1.0F, 1.088900370798F};

struct planes {
    int width, height;
    float *plane[PLANES];
};

static struct planes planes_new(int width, int height) {
    struct planes ret = {width, height, {NULL}};
    for (int c = 0; c < PLANES; c++)
        ret.plane[c] = g_new0(float, (gsize)width *(gsize)height);
    return ret;
}

static void planes_clear(struct planes *planes) {
    for (int c = 0; c < PLANES; c++)
        g_free(planes->plane[c]);
}

/* Computes X, Y and Z of a linear sRGB colour, relative to X, Y and Z of white. */
static void relative_xyz(const float rgb[3], float ret[3]) {
    for (int i = 0; i < 3; i++)
        ret[i] = (float)(to_xyz[i][0] * rgb[0] + to_xyz[i][1] * rgb[1] + to_xyz[i][2] * rgb[2]) /
                 white[i];
}

/* Converts linear sRGB to Y Cx Cz, a linear form of L*a*b* with opponent channels (sec. 4.1.1, eq.
 * 1). */
static void to_ycxcz(const float rgb[3], float ret[3]) {
    float xyz[3];
    relative_xyz(rgb, xyz);
    ret[0] = 116 * xyz[1] - 16;
    ret[1] = 500 * (xyz[0] - xyz[1]);
    ret[2] = 200 * (xyz[1] - xyz[2]);
}

/* Computes the inverse of to_xyz by Cramer's rule. */
static void invert(double ret[3][3]) {
    const double(*m)[3] = to_xyz;
    double determinant = 0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const int a = (j + 1) % 3, b = (j + 2) % 3, c = (i + 1) % 3, d = (i + 2) % 3;
            ret[i][j] = m[a][c] * m[b][d] - m[a][d] * m[b][c];
        }
    for (int i = 0; i < 3; i++)
        determinant += m[0][i] * ret[i][0];
    for (int i = 0; i < 9; i++)
        ret[i / 3][i % 3] /= determinant;
}

static void to_rgb(const double inverse[3][3], const float ycxcz[3], float ret[3]) {
    const float y = (ycxcz[0] + 16) / 116;
    const float xyz[3] = {(ycxcz[1] / 500 + y) * white[0], y * white[1],
                          (y - ycxcz[2] / 200) * white[2]};
    for (int i = 0; i < 3; i++)
        ret[i] = (float)(inverse[i][0] * xyz[0] + inverse[i][1] * xyz[1] + inverse[i][2] * xyz[2]);
}

static float lab_curve(float t) {
    return t > 216.0F / 24389 ? cbrtf(t) : 841.0F / 108 * t + 4.0F / 29;
}

/* Converts linear sRGB to L*a*b* with the Hunt effect (eq. 3): colours of dark pixels differ
 * less. */
static void to_lab(const float rgb[3], float ret[3]) {
    float xyz[3];
    relative_xyz(rgb, xyz);
    const float x = lab_curve(xyz[0]), y = lab_curve(xyz[1]), z = lab_curve(xyz[2]);
    ret[0] = 116 * y - 16;
    ret[1] = 0.01F * ret[0] * (500 * (x - y));
    ret[2] = 0.01F * ret[0] * (200 * (y - z));
}

/* Returns the distance HyAB (eq. 4) of two colours to the power of Q_C. */
static float colour_difference(const float a[3], const float b[3]) {
    const float distance = fabsf(a[0] - b[0]) + hypotf(a[1] - b[1], a[2] - b[2]);
    return powf(distance, Q_C);
}

/* Returns the largest colour_difference(), which is that of green and blue. redistribute() maps
 * differences of up to P_C times the largest one to 0 … P_T, and larger differences to P_T … 1 (eq.
 * 5). */
static float largest_difference(void) {
    static const float green[3] = {0, 1, 0}, blue[3] = {0, 0, 1};
    float a[3], b[3];
    to_lab(green, a);
    to_lab(blue, b);
    return colour_difference(a, b);
}

static float redistribute(float difference, float largest) {
    const float knee = P_C * largest;
    return difference < knee ? P_T / knee * difference
                             : P_T + (difference - knee) / (largest - knee) * (1 - P_T);
}

/* Convolves a plane with the kernel `across` along rows and the kernel `down` along columns. The
 * kernels have 2 · radius + 1 values. Pixels at the border are repeated. */
static void convolve(const float *in, int width, int height, const float *across, const float *down,
                     int radius, float *ret) {
    g_autofree float *line = g_new0(float, (gsize)MAX(width, height) + 2 * (gsize)radius);
    g_autofree float *middle = g_new0(float, (gsize)width *(gsize)height);
    for (int y = 0; y < height; y++) {
        const float *from = in + (gsize)y * (gsize)width;
        float *to = middle + (gsize)y * (gsize)width;
        for (int x = -radius; x < width + radius; x++)
            line[x + radius] = from[CLAMP(x, 0, width - 1)];
        for (int k = 0; k <= 2 * radius; k++)
            for (int x = 0; x < width; x++)
                to[x] += across[k] * line[x + k];
    }
    memset(ret, 0, (gsize)width * (gsize)height * sizeof *ret);
    for (int y = 0; y < height; y++) {
        float *to = ret + (gsize)y * (gsize)width;
        for (int k = 0; k <= 2 * radius; k++) {
            const float *from = middle + (gsize)CLAMP(y + k - radius, 0, height - 1) * (gsize)width;
            for (int x = 0; x < width; x++)
                to[x] += down[k] * from[x];
        }
    }
}

/* Sec. 4.1.1: filters each channel with the contrast sensitivity of the eye. The kernel has the
 * sum 1. All channels have the radius of the widest Gaussian. */
static void blur(struct planes *planes, double pixels_per_degree) {
    const gsize n = (gsize)planes->width * (gsize)planes->height;
    double widest = 0;
    for (int i = 0; i < PLANES * 2; i++)
        widest = MAX(widest, sensitivity[i / 2][i % 2].b);
    const int radius = (int)ceil(3 * sqrt(widest / (2 * G_PI * G_PI)) * pixels_per_degree);
    g_autofree float *kernel = g_new0(float, (gsize)(2 * radius + 1));
    g_autofree float *one = g_new0(float, n);
    for (int c = 0; c < PLANES; c++) {
        g_autofree float *sum = g_new0(float, n);
        double total = 0;
        for (int g = 0; g < 2 && sensitivity[c][g].a > 0; g++) {
            const struct gaussian *of = &sensitivity[c][g];
            double side = 0;
            for (int k = -radius; k <= radius; k++) {
                const double x = k / pixels_per_degree;
                const double value =
                    sqrt(of->a * sqrt(G_PI / of->b)) * exp(-G_PI * G_PI * x * x / of->b);
                kernel[k + radius] = (float)value;
                side += value;
            }
            total += side * side;
            convolve(planes->plane[c], planes->width, planes->height, kernel, kernel, radius, one);
            for (gsize i = 0; i < n; i++)
                sum[i] += one[i];
        }
        for (gsize i = 0; i < n; i++)
            planes->plane[c][i] = sum[i] / (float)total;
    }
}

/* Sec. 4.2.1: a Gaussian and its first and second derivative. The positive weights of each kernel
 * sum to 1, and the negative weights, if there are any, to −1. */
struct feature_kernels {
    int radius;
    float *gaussian, *edge, *point;
};

static void balance(float *kernel, int n) {
    double positive = 0, negative = 0;
    for (int i = 0; i < n; i++)
        *(kernel[i] > 0 ? &positive : &negative) += fabsf(kernel[i]);
    for (int i = 0; i < n; i++)
        if (kernel[i] != 0)
            kernel[i] = (float)(kernel[i] / (kernel[i] > 0 ? positive : negative));
}

static struct feature_kernels feature_kernels_new(double pixels_per_degree) {
    const double sigma = 0.5 * W * pixels_per_degree;
    const int radius = (int)ceil(3 * sigma), n = 2 * radius + 1;
    struct feature_kernels ret = {radius, g_new0(float, n), g_new0(float, n), g_new0(float, n)};
    for (int k = 0; k < n; k++) {
        const double x = k - radius, g = exp(-x * x / (2 * sigma * sigma));
        ret.gaussian[k] = (float)g;
        ret.edge[k] = (float)(-x * g);
        ret.point[k] = (float)((x * x / (sigma * sigma) - 1) * g);
    }
    balance(ret.gaussian, n);
    balance(ret.edge, n);
    balance(ret.point, n);
    return ret;
}

static void feature_kernels_clear(struct feature_kernels *kernels) {
    g_free(kernels->gaussian);
    g_free(kernels->edge);
    g_free(kernels->point);
}

/* Returns the strength of edges or of points at each pixel of a luminance; g_free(). For edges it
 * is the length of the vector of the two first derivatives, for points that of the two second
 * derivatives. */
static float *strength(const float *luminance, int width, int height,
                       const struct feature_kernels *kernels, const float *derivative) {
    const gsize n = (gsize)width * (gsize)height;
    g_autofree float *down = g_new0(float, n);
    float *ret = g_new0(float, n);
    convolve(luminance, width, height, derivative, kernels->gaussian, kernels->radius, ret);
    convolve(luminance, width, height, kernels->gaussian, derivative, kernels->radius, down);
    for (gsize i = 0; i < n; i++)
        ret[i] = hypotf(ret[i], down[i]);
    return ret;
}

/* Returns the difference of edges and points of two luminances at each pixel, 0 … 1 (sec. 4.2, eq.
 * 9). g_free() */
static float *features(const float *const luminances[2], int width, int height,
                       double pixels_per_degree) {
    const gsize n = (gsize)width * (gsize)height;
    struct feature_kernels kernels = feature_kernels_new(pixels_per_degree);
    float *ret = g_new0(float, n);
    for (int kind = 0; kind < 2; kind++) {
        const float *derivative = kind ? kernels.point : kernels.edge;
        g_autofree float *a = strength(luminances[0], width, height, &kernels, derivative);
        g_autofree float *b = strength(luminances[1], width, height, &kernels, derivative);
        for (gsize i = 0; i < n; i++)
            ret[i] = MAX(ret[i], fabsf(a[i] - b[i]));
    }
    for (gsize i = 0; i < n; i++)
        ret[i] = powf(ret[i] * (float)G_SQRT2 / 2, Q_F);
    feature_kernels_clear(&kernels);
    return ret;
}

/* Converts a picture, clipped to 0 … 1, to Y Cx Cz. ret_luminance receives the luminance of each
 * pixel, 0 … 1. */
static struct planes load(const float *rgb, int width, int height, float *ret_luminance) {
    const gsize n = (gsize)width * (gsize)height;
    struct planes ret = planes_new(width, height);
    for (gsize i = 0; i < n; i++) {
        float clipped[3], ycxcz[3];
        for (int c = 0; c < 3; c++)
            clipped[c] = CLAMP(rgb[3 * i + c], 0.0F, 1.0F);
        to_ycxcz(clipped, ycxcz);
        for (int c = 0; c < 3; c++)
            ret.plane[c][i] = ycxcz[c];
        ret_luminance[i] = (ycxcz[0] + 16) / 116;
    }
    return ret;
}

/* Gives the colour of pixel i of the blurred picture, as L*a*b* with the Hunt effect. */
static void seen(const struct planes *planes, gsize i, const double inverse[3][3], float ret[3]) {
    const float ycxcz[3] = {planes->plane[0][i], planes->plane[1][i], planes->plane[2][i]};
    float rgb[3];
    to_rgb(inverse, ycxcz, rgb);
    for (int c = 0; c < 3; c++)
        rgb[c] = CLAMP(rgb[c], 0.0F, 1.0F);
    to_lab(rgb, ret);
}

double flip_ldr(const float *reference, const float *test, int width, int height,
                double pixels_per_degree, float *ret_map) {
    const gsize n = (gsize)width * (gsize)height;
    const float largest = largest_difference();
    double inverse[3][3], sum = 0;
    g_autofree float *of_reference = g_new0(float, n), *of_test = g_new0(float, n);
    struct planes a = load(reference, width, height, of_reference);
    struct planes b = load(test, width, height, of_test);
    const float *const luminances[] = {of_reference, of_test};
    g_autofree float *feature = features(luminances, width, height, pixels_per_degree);
    blur(&a, pixels_per_degree);
    blur(&b, pixels_per_degree);
    invert(inverse);
    for (gsize i = 0; i < n; i++) {
        float lab_a[3], lab_b[3];
        seen(&a, i, inverse, lab_a);
        seen(&b, i, inverse, lab_b);
        const float colour = redistribute(colour_difference(lab_a, lab_b), largest);
        const float value = powf(colour, 1 - feature[i]); /* eq. 10 */
        if (ret_map)
            ret_map[i] = value;
        sum += value;
    }
    planes_clear(&a);
    planes_clear(&b);
    return sum / (double)n;
}

/* The tone curve of ACES, as fitted by Narkowicz (2021, sec. 3): a ratio of two polynomials. */
static const double above[] = {0.0, 0.6 * 0.03, 0.6 * 0.6 * 2.51};
static const double below[] = {0.14, 0.6 * 0.59, 0.6 * 0.6 * 2.43};

static float tone(double x) {
    const double y =
        (above[2] * x * x + above[1] * x + above[0]) / (below[2] * x * x + below[1] * x + below[0]);
    return (float)CLAMP(y, 0.0, 1.0);
}

static int by_value(gconstpointer a, gconstpointer b) {
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

/* Gives the first and the last exposure of flip_hdr(), as exponents of 2 (2021, sec. 3). At the
 * first exposure, the tone curve maps the brightest pixel to 0.85. At the last exposure, it maps
 * the median of the pixels to 0.85. */
static void exposures(const float *reference, gsize n, double *ret_first, double *ret_last) {
    const double level = 0.85;
    const double a = above[2] - level * below[2], b = above[1] - level * below[1],
                 c = above[0] - level * below[0];
    const double middle = -0.5 * b / a, white_at = middle + sqrt(middle * middle - c / a);
    g_autofree float *luminance = g_new0(float, n);
    for (gsize i = 0; i < n; i++) {
        const float *p = reference + 3 * i;
        luminance[i] = 0.2126F * p[0] + 0.7152F * p[1] + 0.0722F * p[2];
    }
    qsort(luminance, n, sizeof *luminance, by_value);
    *ret_first = log2(white_at / MAX(luminance[n - 1], FLT_EPSILON));
    *ret_last = log2(white_at / MAX(luminance[n / 2], FLT_EPSILON));
}

static void expose(const float *rgb, gsize n, double exposure, float *ret) {
    const double factor = exp2(exposure);
    for (gsize i = 0; i < 3 * n; i++)
        ret[i] = tone(factor * MAX(rgb[i], 0.0F));
}

double flip_hdr(const float *reference, const float *test, int width, int height,
                double pixels_per_degree, float *ret_map) {
    const gsize n = (gsize)width * (gsize)height;
    double first, last, sum = 0;
    exposures(reference, n, &first, &last);
    const int steps = MAX(2, (int)ceil(last - first));
    g_autofree float *a = g_new0(float, 3 * n), *b = g_new0(float, 3 * n);
    g_autofree float *map = g_new0(float, n), *largest = g_new0(float, n);
    for (int k = 0; k < steps; k++) {
        const double exposure = first + (last - first) * k / (steps - 1);
        expose(reference, n, exposure, a);
        expose(test, n, exposure, b);
        flip_ldr(a, b, width, height, pixels_per_degree, map);
        for (gsize i = 0; i < n; i++)
            largest[i] = MAX(largest[i], map[i]);
    }
    for (gsize i = 0; i < n; i++)
        sum += largest[i];
    if (ret_map)
        memcpy(ret_map, largest, n * sizeof *largest);
    return sum / (double)n;
}
