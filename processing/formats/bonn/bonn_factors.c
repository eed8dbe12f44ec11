/* Parses and multiplies the factors of FMF and DFMF: M ≈ U (S V)ᵀ with U (rows × components) and S
 * V (columns × components). Inverts the colour transformations and logarithms that were applied
 * before factoring. */
#include "bonn_private.h"

#include <cblas.h>
#include <math.h>
#include <string.h>

#include "exr/exr_half.h"

#define MAX_COMPONENTS 65536
/* Offset of logarithms: ln(value + EPSILON). */
#define EPSILON 1e-5f
#define BLOCK   ((gsize)1024) /* number of numbers that are converted together */

void bonn_matrix_clear(struct bonn_matrix *matrix) {
    g_clear_pointer(&matrix->u, g_free);
    g_clear_pointer(&matrix->sv, g_free);
}

static void to_floats(float *to, const guint8 *from, gsize n, int scalar) {
    guint16 halves[256];
    for (gsize i = 0; scalar == 2 && i < n; i += G_N_ELEMENTS(halves)) {
        const gsize some = MIN(G_N_ELEMENTS(halves), n - i);
        memcpy(halves, from + 2 * i, 2 * some);
        exr_half_to_floats(to + i, halves, some);
    }
    for (gsize i = 0; scalar == 4 && i < n; i++) {
        guint32 bits;
        memcpy(&bits, from + 4 * i, sizeof bits);
        bits = GUINT32_FROM_LE(bits);
        memcpy(&to[i], &bits, sizeof bits);
    }
    for (gsize i = 0; scalar == 8 && i < n; i++) {
        guint64 bits;
        double value;
        memcpy(&bits, from + 8 * i, sizeof bits);
        bits = GUINT64_FROM_LE(bits);
        memcpy(&value, &bits, sizeof bits);
        to[i] = (float)value;
    }
}

static gboolean take_factor(struct bonn_bytes *bytes, const char *what, gsize rows, gsize columns,
                            int scalar, float **ret, GError **error) {
    const gsize n = rows * columns;
    guint8 block[8 * BLOCK];
    struct bonn_bytes whole = *bytes;
    if (!bonn_skip(&whole, n * (gsize)scalar, what, error))
        return FALSE;
    *ret = g_try_new(float, n);
    if (!*ret)
        return bonn_fail(bytes, BONN_ERROR_IO, error,
                         "there is no memory for the %s of %zu × %zu numbers; read the file on a "
                         "computer with more memory",
                         what, rows, columns);
    for (gsize i = 0; i < n; i += BLOCK) {
        const gsize some = MIN(BLOCK, n - i);
        if (!bonn_take(bytes, some * (gsize)scalar, what, block, error))
            return FALSE;
        to_floats(*ret + i, block, some, scalar);
    }
    return TRUE;
}

gboolean bonn_parse_matrix(struct bonn_bytes *bytes, const struct bonn_header *header,
                           int n_channels, struct bonn_matrix *ret, GError **error) {
    const gsize texels = (gsize)header->width * (gsize)header->height;
    const gsize directions = (gsize)header->n_views * (gsize)header->n_lights;
    const gsize channels = (gsize)n_channels;
    guint8 scalar;
    guint32 sizes[3];
    if (!bonn_take(bytes, 1, "matrix", &scalar, error))
        return FALSE;
    if (scalar != 2 && scalar != 4 && scalar != 8)
        return bonn_fail(bytes, BONN_ERROR_FORMAT, error,
                         "the numbers of a matrix have %d bytes each, but must have 2, 4 or 8; "
                         "copy the file again",
                         scalar);
    for (int i = 0; i < 3; i++)
        if (!bonn_take_u32(bytes, "matrix", &sizes[i], error))
            return FALSE;
    if (sizes[0] < 1 || sizes[0] > MAX_COMPONENTS)
        return bonn_fail(
            bytes, BONN_ERROR_FORMAT, error,
            "a matrix has %u components, but must have 1 to 65536; copy the file again", sizes[0]);
    ret->n_components = sizes[0];
    ret->n_rows = sizes[1];
    ret->n_columns = sizes[2];
    /* The file does not say what rows and columns stand for. The numbers of rows and columns
     * decide. */
    ret->of_images = ret->n_rows != channels * directions || ret->n_columns != texels;
    if (ret->of_images && (ret->n_rows != channels * texels || ret->n_columns != directions))
        return bonn_fail(bytes, BONN_ERROR_FORMAT, error,
                         "a matrix of %zu × %zu does not fit %d × %d texels, %d views and %d "
                         "lights; copy the file again",
                         ret->n_rows, ret->n_columns, header->width, header->height,
                         header->n_views, header->n_lights);
    return bonn_skip(bytes, ret->n_components * scalar, "list of singular values", error) &&
           take_factor(bytes, "matrix U", ret->n_rows, ret->n_components, scalar, &ret->u, error) &&
           take_factor(bytes, "matrix SV", ret->n_columns, ret->n_components, scalar, &ret->sv,
                       error);
}

/* Computes `product`, the block of M ≈ U (S V)ᵀ for one view and n texels. If of_images is TRUE, a
 * row of the product is a pair (texel, channel) and a column is a light. Otherwise a row is a texel
 * and a column is a pair (light, channel). */
void bonn_matrix_view(const struct bonn_matrix *matrix, const struct bonn_header *header,
                      int n_channels, int view, gsize first, gsize n, const int *channel,
                      float *to) {
    const gsize n_lights = (gsize)header->n_lights, nc = (gsize)n_channels;
    const gboolean of_images = matrix->of_images;
    const gsize k = matrix->n_components, rows = of_images ? n * nc : n;
    const gsize columns = of_images ? n_lights : n_lights * nc;
    const float *texels = of_images ? matrix->u + first * nc * k : matrix->sv + first * k;
    const float *lights = (of_images ? matrix->sv : matrix->u) + (gsize)view * columns * k;
    g_autofree float *product = g_new(float, n *nc *n_lights);
    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasTrans, (int)rows, (int)columns, (int)k, 1, texels,
                (int)k, lights, (int)k, 0, product, (int)columns);
    for (gsize light = 0; light < n_lights; light++)
        for (gsize texel = 0; texel < n; texel++)
            for (gsize c = 0; c < nc; c++)
                to[(light * n + texel) * BONN_CHANNELS + (gsize)channel[c]] =
                    of_images ? product[(texel * nc + c) * n_lights + light]
                              : product[(texel * n_lights + light) * nc + c];
}

enum {
    MODEL_RGB,
    MODEL_YUV,
    MODEL_PCA = 3,
    MODEL_YCOCG,
    MODEL_LOG_Y = 9,
    MODEL_LOG_YUV,
    MODEL_LOG_Y_RATIOS,
    MODEL_LOG_RGB
};

gboolean bonn_colours_check(const struct bonn_bytes *bytes, const struct bonn_colours *colours,
                            GError **error) {
    static const guint32 known[] = {MODEL_RGB,   MODEL_YUV,     MODEL_PCA,          MODEL_YCOCG,
                                    MODEL_LOG_Y, MODEL_LOG_YUV, MODEL_LOG_Y_RATIOS, MODEL_LOG_RGB};
    for (gsize i = 0; i < G_N_ELEMENTS(known); i++)
        if (colours->model == known[i])
            return TRUE;
    return bonn_fail(bytes, BONN_ERROR_UNSUPPORTED, error,
                     "the colour model is %u; only 0, 1, 3, 4 and 9 to 12 can be read",
                     colours->model);
}

static float unlog(float value) {
    return expf(value) - EPSILON;
}

static void undo_logarithm(guint32 model, float *p) {
    if (model != MODEL_LOG_RGB)
        p[0] = unlog(p[0]);
    for (int c = 0; c < BONN_CHANNELS; c++)
        if (model == MODEL_LOG_RGB)
            p[c] = unlog(p[c]);
        else if (c > 0 && model == MODEL_LOG_YUV)
            p[c] = p[c] == 0 ? 0 : copysignf(EPSILON * expf(fabsf(p[c])), p[c]);
        else if (c > 0 && model == MODEL_LOG_Y_RATIOS)
            p[c] *= p[0] + EPSILON;
}

static void undo_pixel(const struct bonn_colours *colours, float *p) {
    if (colours->model >= MODEL_LOG_Y)
        undo_logarithm(colours->model, p);
    const float a = p[0], b = p[1], c = p[2];
    switch (colours->model) {
    case MODEL_YUV:
    case MODEL_LOG_Y:
    case MODEL_LOG_YUV:
    case MODEL_LOG_Y_RATIOS:
        p[0] = a + 1.13983f * c;
        p[1] = a - 0.39465f * b - 0.58060f * c;
        p[2] = a + 2.03211f * b;
        break;
    case MODEL_PCA:
        for (int i = 0; i < BONN_CHANNELS; i++)
            p[i] = colours->mean[i] + a * colours->matrix[i] + b * colours->matrix[3 + i] +
                   c * colours->matrix[6 + i];
        break;
    case MODEL_YCOCG:
        p[0] = a + b - c;
        p[1] = a + c;
        p[2] = a - b - c;
        break;
    default:
        break;
    }
}

void bonn_colours_undo(const struct bonn_colours *colours, float *rgb, gsize n_pixels) {
    for (gsize i = 0; i < n_pixels && colours->model != MODEL_RGB; i++)
        undo_pixel(colours, rgb + BONN_CHANNELS * i);
    for (gsize i = 0; i < BONN_CHANNELS * n_pixels && colours->logarithm; i++)
        rgb[i] = unlog(rgb[i]);
}
