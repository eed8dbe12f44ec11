#include "maps_png.h"

#include <gio/gio.h>
#include <math.h>
#include <png.h>

float maps_srgb_encode(float linear) {
    return linear <= 0.0031308F ? 12.92F * linear : 1.055F * powf(linear, 1 / 2.4F) - 0.055F;
}

float maps_srgb_decode(float coded) {
    return coded <= 0.04045F ? coded / 12.92F : powf((coded + 0.055F) / 1.055F, 2.4F);
}

float maps_srgb_round(float linear) {
    return maps_srgb_decode(rintf(255 * maps_srgb_encode(CLAMP(linear, 0, 1))) / 255);
}

static void maps_png_write(png_structp png, png_bytep data, png_size_t length) {
    g_byte_array_append(png_get_io_ptr(png), data, (guint)length);
}

static void flush(png_structp png) {
}

static void fail(png_structp png, png_const_charp message) {
    g_set_error((GError **)png_get_error_ptr(png), G_IO_ERROR, G_IO_ERROR_INVALID_DATA,
                "a map cannot be encoded as PNG (libpng: %s); export fewer texels, or use a "
                "computer with more memory",
                message);
    png_longjmp(png, 1);
}

static void maps_png_row(const float *values, gsize n, int channels, int bits, gboolean srgb,
                         guint8 *ret) {
    for (gsize i = 0; i < n * (gsize)channels; i++) {
        const gboolean colour = srgb && (channels != 4 || i % 4 != 3);
        const float value = CLAMP(values[i], 0, 1);
        const float coded = colour ? maps_srgb_encode(value) : value;
        if (bits == 8) {
            ret[i] = (guint8)lrintf(255 * coded);
        } else {
            const guint16 whole = (guint16)lrintf(65535 * coded);
            ret[2 * i] = (guint8)(whole >> 8);
            ret[2 * i + 1] = (guint8)whole;
        }
    }
}

GBytes *maps_png(const float *values, int width, int height, int channels, int bits, gboolean srgb,
                 GError **error) {
    const int types[] = {0, PNG_COLOR_TYPE_GRAY, 0, PNG_COLOR_TYPE_RGB, PNG_COLOR_TYPE_RGB_ALPHA};
    GByteArray *to = g_byte_array_new();
    guint8 *row = g_malloc((gsize)width * (gsize)channels * 2);
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, error, fail, NULL);
    png_infop info = png_create_info_struct(png);
    if (setjmp(png_jmpbuf(png))) {
        png_destroy_write_struct(&png, &info);
        g_byte_array_unref(to);
        g_free(row);
        return NULL;
    }
    png_set_write_fn(png, to, maps_png_write, flush);
    png_set_IHDR(png, info, (png_uint_32)width, (png_uint_32)height, bits, types[channels],
                 PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    if (srgb)
        png_set_sRGB(png, info, PNG_sRGB_INTENT_PERCEPTUAL);
    png_write_info(png, info);
    for (int y = 0; y < height; y++) {
        const gsize n = (gsize)width;
        maps_png_row(values + (gsize)y * n * (gsize)channels, n, channels, bits, srgb, row);
        png_write_row(png, row);
    }
    png_write_end(png, NULL);
    png_destroy_write_struct(&png, &info);
    g_free(row);
    return g_byte_array_free_to_bytes(to);
}
