#include "told_pictures.h"

#include <lcms2.h>
#include <png.h>
#include <stdio.h>
#include <string.h>

#include <jpeglib.h>

static GBytes *profile(double gamma) {
    const cmsCIExyY white = {0.3127, 0.3290, 1};
    const cmsCIExyYTRIPLE primaries = {{0.64, 0.33, 1}, {0.30, 0.60, 1}, {0.15, 0.06, 1}};
    cmsToneCurve *curve = cmsBuildGamma(NULL, gamma);
    cmsToneCurve *const curves[3] = {curve, curve, curve};
    cmsHPROFILE made = cmsCreateRGBProfile(&white, &primaries, curves);
    cmsUInt32Number n = 0;
    g_assert_true(cmsSaveProfileToMem(made, NULL, &n));
    guint8 *bytes = g_malloc(n);
    g_assert_true(cmsSaveProfileToMem(made, bytes, &n));
    cmsCloseProfile(made);
    cmsFreeToneCurve(curve);
    return g_bytes_new_take(bytes, n);
}

static void put(GByteArray *to, guint32 value, int n) {
    for (int i = 0; i < n; i++)
        g_byte_array_append(to, &(guint8){(guint8)(value >> (8 * i))}, 1);
}

static void entry(GByteArray *to, int tag, int type, guint32 n, guint32 value) {
    put(to, (guint32)tag, 2);
    put(to, (guint32)type, 2);
    put(to, n, 4);
    put(to, value, 4);
}

/* Returns a TIFF whose first directory refers to an EXIF directory. */
static GByteArray *exif(const struct told *told) {
    GByteArray *to = g_byte_array_new();
    const int n = (told->taken != NULL) + (told->fraction != NULL) + (told->colour_space != 0) +
                  (told->focal[1] != 0) + (told->plane[1] != 0) + (told->plane_unit != 0) +
                  (told->full_px != 0) + (told->film_mm != 0);
    const guint32 texts = 26 + 2 + 12 * (guint32)n + 4;
    const guint32 focal = texts + (told->taken ? 20 : 0), plane = focal + (told->focal[1] ? 8 : 0);
    g_byte_array_append(to, (const guint8 *)"II\x2a\0\x08\0\0\0", 8);
    put(to, 1, 2);
    entry(to, 34665, 4, 1, 26);
    put(to, 0, 4);
    put(to, (guint32)n, 2);
    if (told->taken)
        entry(to, 36867, 2, 20, texts);
    if (told->focal[1])
        entry(to, 37386, 5, 1, focal);
    if (told->fraction)
        entry(to, 37521, 2, 3, (guint32)told->fraction[0] | (guint32)told->fraction[1] << 8);
    if (told->colour_space)
        entry(to, 40961, 3, 1, (guint32)told->colour_space);
    if (told->full_px)
        entry(to, 40962, 4, 1, (guint32)told->full_px);
    if (told->plane[1])
        entry(to, 41486, 5, 1, plane);
    if (told->plane_unit)
        entry(to, 41488, 3, 1, (guint32)told->plane_unit);
    if (told->film_mm)
        entry(to, 41989, 3, 1, (guint32)told->film_mm);
    put(to, 0, 4);
    if (told->taken)
        g_byte_array_append(to, (const guint8 *)told->taken, 20);
    for (int i = 0; i < 4; i++)
        if ((i < 2 ? told->focal : told->plane)[1])
            put(to, (i < 2 ? told->focal : told->plane)[i % 2], 4);
    return to;
}

static gboolean has_exif(const struct told *told) {
    return told->taken || told->colour_space || told->focal[1] || told->film_mm;
}

void told_png(const char *path, int width, int height, int channels, int bits,
              const guint16 *values, const struct told *told) {
    static const int types[] = {0, PNG_COLOR_TYPE_GRAY, PNG_COLOR_TYPE_GRAY_ALPHA,
                                PNG_COLOR_TYPE_RGB, PNG_COLOR_TYPE_RGBA};
    FILE *file = fopen(path, "wb");
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, NULL, NULL, NULL);
    png_infop info = png_create_info_struct(png);
    g_assert_true(file && info);
    png_init_io(png, file);
    png_set_IHDR(png, info, (png_uint_32)width, (png_uint_32)height, bits, types[channels],
                 PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    if (told && told->srgb)
        png_set_sRGB(png, info, PNG_sRGB_INTENT_PERCEPTUAL);
    if (told && told->icc_gamma > 0) {
        g_autoptr(GBytes) icc = profile(told->icc_gamma);
        png_set_iCCP(png, info, "told", PNG_COMPRESSION_TYPE_BASE, g_bytes_get_data(icc, NULL),
                     (png_uint_32)g_bytes_get_size(icc));
    }
    png_write_info(png, info);
    if (told && told->png_chunk)
        png_write_chunk(png, (png_const_bytep)told->png_chunk, told->chunk, told->chunk_bytes);
    if (told && has_exif(told)) {
        g_autoptr(GByteArray) bytes = exif(told);
        png_write_chunk(png, (png_const_bytep) "eXIf", bytes->data, bytes->len);
    }
    const gsize n = (gsize)width * (gsize)channels;
    g_autofree guint8 *row = g_malloc(2 * n);
    for (int y = 0; y < height; y++) {
        for (gsize i = 0; i < n; i++) {
            const guint16 value = values[(gsize)y * n + i];
            if (bits == 8) {
                row[i] = (guint8)value;
            } else {
                row[2 * i] = (guint8)(value >> 8);
                row[2 * i + 1] = (guint8)value;
            }
        }
        png_write_row(png, row);
    }
    png_write_end(png, info);
    png_destroy_write_struct(&png, &info);
    g_assert_cmpint(fclose(file), ==, 0);
}

void told_jpeg(const char *path, int width, int height, const guint8 *rgb,
               const struct told *told) {
    struct jpeg_error_mgr errors;
    struct jpeg_compress_struct jpeg = {.err = jpeg_std_error(&errors)};
    FILE *file = fopen(path, "wb");
    g_assert_nonnull(file);
    jpeg_create_compress(&jpeg);
    jpeg_stdio_dest(&jpeg, file);
    jpeg.image_width = (JDIMENSION)width;
    jpeg.image_height = (JDIMENSION)height;
    jpeg.input_components = 3;
    jpeg.in_color_space = JCS_RGB;
    jpeg_set_defaults(&jpeg);
    jpeg_set_quality(&jpeg, 100, TRUE);
    jpeg_start_compress(&jpeg, TRUE);
    if (told && has_exif(told)) {
        g_autoptr(GByteArray) bytes = exif(told);
        g_byte_array_prepend(bytes, (const guint8 *)"Exif\0\0", 6);
        jpeg_write_marker(&jpeg, JPEG_APP0 + 1, bytes->data, bytes->len);
    }
    if (told && told->icc_gamma > 0) {
        g_autoptr(GBytes) icc = profile(told->icc_gamma);
        jpeg_write_icc_profile(&jpeg, g_bytes_get_data(icc, NULL), (unsigned)g_bytes_get_size(icc));
    }
    while (jpeg.next_scanline < jpeg.image_height) {
        JSAMPROW row = (JSAMPROW)rgb + 3 * (gsize)width * jpeg.next_scanline;
        jpeg_write_scanlines(&jpeg, &row, 1);
    }
    jpeg_finish_compress(&jpeg);
    jpeg_destroy_compress(&jpeg);
    g_assert_cmpint(fclose(file), ==, 0);
}

void told_tiff(const char *path, int width, int height, int channels, const guint8 *values,
               const struct told *told) {
    g_autoptr(GByteArray) to = g_byte_array_new();
    g_autoptr(GBytes) icc = told && told->icc_gamma > 0 ? profile(told->icc_gamma) : NULL;
    const guint32 pixels = (guint32)(width * height * channels);
    const int n = 10 + (channels == 4) + (icc != NULL);
    const guint32 bits = 8 + 2 + 12 * (guint32)n + 4, data = bits + 8, after = data + pixels;
    g_byte_array_append(to, (const guint8 *)"II\x2a\0\x08\0\0\0", 8);
    put(to, (guint32)n, 2);
    entry(to, 256, 3, 1, (guint32)width);
    entry(to, 257, 3, 1, (guint32)height);
    entry(to, 258, 3, (guint32)channels, bits);
    entry(to, 259, 3, 1, 1);
    entry(to, 262, 3, 1, 2);
    entry(to, 273, 4, 1, data);
    entry(to, 277, 3, 1, (guint32)channels);
    entry(to, 278, 3, 1, (guint32)height);
    entry(to, 279, 4, 1, pixels);
    entry(to, 284, 3, 1, 1);
    if (channels == 4)
        entry(to, 338, 3, 1, 2);
    if (icc)
        entry(to, 34675, 7, (guint32)g_bytes_get_size(icc), after);
    put(to, 0, 4);
    for (int i = 0; i < 4; i++)
        put(to, 8, 2);
    g_byte_array_append(to, values, pixels);
    if (icc)
        g_byte_array_append(to, g_bytes_get_data(icc, NULL), (guint)g_bytes_get_size(icc));
    g_assert_true(g_file_set_contents(path, (const char *)to->data, to->len, NULL));
}
