#include "trace_texture.h"

#include "base/srgb.h"
#include "trace_error.h"

#include <math.h>
#include <png.h>
#include <setjmp.h>
#include <stdio.h>
#include <string.h>

#include <jpeglib.h>

struct trace_texture {
    int size[2];
    enum gltf_wrap wrap[2];
    guint8 *rgb;       /* rows from the top, sRGB */
    float linear[256]; /* linear value of each byte */
};

static void no_memory(GError **error) {
    g_set_error_literal(error, TRACE_ERROR, TRACE_ERROR_SCENE,
                        "there is not enough memory for the picture; make it smaller");
}

/* Decodes a PNG. ret_size receives the width and height. Returns the rows from the top, 3 bytes per
 * pixel, or NULL with an error. Free the result with g_free(). */
static guint8 *trace_texture_png(gconstpointer data, gsize length, int ret_size[2],
                                 GError **error) {
    png_image image = {.version = PNG_IMAGE_VERSION};
    if (!png_image_begin_read_from_memory(&image, data, length)) {
        g_set_error(error, TRACE_ERROR, TRACE_ERROR_SCENE,
                    "the picture is neither a JPEG nor a readable PNG (%s); save it as PNG or JPEG",
                    image.message);
        png_image_free(&image);
        return NULL;
    }
    if (image.width > TRACE_TEXTURE_MAX_SIDE || image.height > TRACE_TEXTURE_MAX_SIDE) {
        g_set_error(error, TRACE_ERROR, TRACE_ERROR_SCENE,
                    "the picture has %u × %u pixels, but at most %d are possible in each "
                    "direction; make it smaller",
                    image.width, image.height, TRACE_TEXTURE_MAX_SIDE);
        png_image_free(&image);
        return NULL;
    }
    /* read with alpha, because otherwise libpng would blend the picture with a background */
    image.format = PNG_FORMAT_RGBA;
    const gsize n = (gsize)image.width * image.height;
    guint8 *ret = g_try_malloc(4 * n);
    if (ret == NULL || !png_image_finish_read(&image, NULL, ret, 0, NULL)) {
        if (ret == NULL)
            no_memory(error);
        else
            g_set_error(error, TRACE_ERROR, TRACE_ERROR_SCENE,
                        "the PNG picture cannot be read: %s; save it again", image.message);
        png_image_free(&image);
        g_free(ret);
        return NULL;
    }
    for (gsize i = 0; i < n; i++)
        memmove(ret + 3 * i, ret + 4 * i, 3);
    ret_size[0] = (int)image.width;
    ret_size[1] = (int)image.height;
    return ret;
}

/* State for libjpeg's error functions. manager comes first, so that a pointer to it is also a
 * pointer to the struct. */
struct trace_texture_trouble {
    struct jpeg_error_mgr manager;
    jmp_buf back;
    char text[JMSG_LENGTH_MAX];
};

G_NORETURN static void trace_texture_jpeg_error(j_common_ptr codec) {
    struct trace_texture_trouble *trouble = (struct trace_texture_trouble *)(gpointer)codec->err;
    trouble->manager.format_message(codec, trouble->text);
    longjmp(trouble->back, 1);
}

/* Treats warnings as errors, for example that the file ends early. */
static void jpeg_message(j_common_ptr codec, int level) {
    if (level < 0)
        trace_texture_jpeg_error(codec);
}

/* Decodes a JPEG, like trace_texture_png(). */
static guint8 *trace_texture_jpeg(gconstpointer data, gsize length, int ret_size[2],
                                  GError **error) {
    struct jpeg_decompress_struct codec;
    struct trace_texture_trouble trouble;
    guint8 *volatile ret = NULL;
    codec.err = jpeg_std_error(&trouble.manager);
    trouble.manager.error_exit = trace_texture_jpeg_error;
    trouble.manager.emit_message = jpeg_message;
    if (setjmp(trouble.back)) {
        g_set_error(error, TRACE_ERROR, TRACE_ERROR_SCENE,
                    "the JPEG picture cannot be read: %s; save it again", trouble.text);
        jpeg_destroy_decompress(&codec);
        g_free(ret);
        return NULL;
    }
    jpeg_create_decompress(&codec);
    jpeg_mem_src(&codec, data, length);
    jpeg_read_header(&codec, TRUE);
    const gsize width = codec.image_width, height = codec.image_height;
    if (width > TRACE_TEXTURE_MAX_SIDE || height > TRACE_TEXTURE_MAX_SIDE) {
        g_set_error(error, TRACE_ERROR, TRACE_ERROR_SCENE,
                    "the picture has %zu × %zu pixels, but at most %d are possible in each "
                    "direction; make it smaller",
                    width, height, TRACE_TEXTURE_MAX_SIDE);
        jpeg_destroy_decompress(&codec);
        return NULL;
    }
    ret = g_try_malloc(3 * width * height);
    if (ret == NULL) {
        no_memory(error);
        jpeg_destroy_decompress(&codec);
        return NULL;
    }
    codec.out_color_space = JCS_RGB;
    jpeg_start_decompress(&codec);
    while (codec.output_scanline < codec.output_height) {
        JSAMPROW row = ret + 3 * width * codec.output_scanline;
        jpeg_read_scanlines(&codec, &row, 1);
    }
    jpeg_finish_decompress(&codec);
    jpeg_destroy_decompress(&codec);
    ret_size[0] = (int)width;
    ret_size[1] = (int)height;
    return ret;
}

TraceTexture *trace_texture_new(GBytes *bytes, const enum gltf_wrap wrap[2], GError **error) {
    gsize length;
    int size[2];
    const guint8 *data = g_bytes_get_data(bytes, &length);
    if (data == NULL) {
        g_set_error_literal(error, TRACE_ERROR, TRACE_ERROR_SCENE,
                            "the file of the picture is empty; save it again");
        return NULL;
    }
    const gboolean jpeg = length > 2 && data[0] == 0xff && data[1] == 0xd8;
    guint8 *rgb = jpeg ? trace_texture_jpeg(data, length, size, error)
                       : trace_texture_png(data, length, size, error);
    if (rgb == NULL)
        return NULL;
    TraceTexture *ret = g_new0(TraceTexture, 1);
    *ret = (TraceTexture){.size = {size[0], size[1]}, .wrap = {wrap[0], wrap[1]}, .rgb = rgb};
    for (int k = 0; k < 256; k++)
        ret->linear[k] = (float)srgb_decode(k / 255.0);
    return ret;
}

void trace_texture_free(TraceTexture *texture) {
    if (texture == NULL)
        return;
    g_free(texture->rgb);
    g_free(texture);
}

/* Returns the index, 0 … n − 1, of the pixel that is shown at position k of a row or column of n
 * pixels. k may lie beyond the ends of the row or column. */
static int texture_wrapped(double k, int n, enum gltf_wrap wrap) {
    if (wrap == GLTF_WRAP_CLAMP)
        return (int)CLAMP(k, 0.0, n - 1.0);
    const double period = wrap == GLTF_WRAP_MIRROR ? 2.0 * n : n;
    const int at = CLAMP((int)(k - floor(k / period) * period), 0, (int)period - 1);
    return at < n ? at : 2 * n - 1 - at;
}

void trace_texture_colour(const TraceTexture *texture, double u, double v, double ret_rgb[3]) {
    const double at[2] = {u * texture->size[0] - 0.5, (1.0 - v) * texture->size[1] - 0.5};
    int pixel[2][2];
    double share[2][2];
    ret_rgb[0] = ret_rgb[1] = ret_rgb[2] = 0.0;
    if (!isfinite(at[0]) || !isfinite(at[1]))
        return;
    for (int axis = 0; axis < 2; axis++) {
        const double below = floor(at[axis]);
        share[axis][1] = at[axis] - below;
        share[axis][0] = 1.0 - share[axis][1];
        for (int k = 0; k < 2; k++)
            pixel[axis][k] = texture_wrapped(below + k, texture->size[axis], texture->wrap[axis]);
    }
    for (int j = 0; j < 2; j++)
        for (int i = 0; i < 2; i++) {
            const gsize row = (gsize)pixel[1][j] * (gsize)texture->size[0];
            const guint8 *from = texture->rgb + 3 * (row + (gsize)pixel[0][i]);
            for (int c = 0; c < 3; c++)
                ret_rgb[c] += share[0][i] * share[1][j] * (double)texture->linear[from[c]];
        }
}
