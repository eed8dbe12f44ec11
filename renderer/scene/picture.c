#include "picture.h"

#include <png.h>

#include "base/output_file.h"
#include "exr/exr.h"
#include "formats/compare_pictures.h"

G_DEFINE_QUARK(picture_error, picture_error)

static void on_error(png_structp png, png_const_charp text) {
    char **message = png_get_error_ptr(png);
    *message = g_strdup(text);
    png_longjmp(png, 1);
}

static void picture_on_warning(png_structp png, png_const_charp text) {
}

static void picture_on_bytes(png_structp png, png_bytep bytes, size_t n) {
    g_byte_array_append(png_get_io_ptr(png), bytes, (guint)n);
}

/* Writes the PNG into `to`. All calls that may longjmp to setjmp are in this function, and none of
 * its variables is used after a longjmp. */
static gboolean encode(png_structp png, png_infop info, GByteArray *to, const guint8 *rgb,
                       int width, int height, const char *const *texts) {
    if (setjmp(png_jmpbuf(png)))
        return FALSE;
    png_set_write_fn(png, to, picture_on_bytes, NULL);
    png_set_user_limits(png, 0x7fffffff, 0x7fffffff);
    png_set_IHDR(png, info, width, height, 8, PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE,
                 PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_set_sRGB(png, info, PNG_sRGB_INTENT_RELATIVE);
    png_set_compression_level(png, 6);
    for (const char *const *t = texts; t != NULL && t[0] != NULL && t[1] != NULL; t += 2) {
        png_text text = {
            .compression =
                g_str_is_ascii(t[1]) ? PNG_TEXT_COMPRESSION_NONE : PNG_ITXT_COMPRESSION_NONE,
            .key = (png_charp)t[0],
            .text = (png_charp)t[1],
        };
        png_set_text(png, info, &text, 1);
    }
    png_write_info(png, info);
    for (int j = 0; j < height; j++)
        png_write_row(png, rgb + 3 * (gsize)width * j);
    png_write_end(png, info);
    return TRUE;
}

gboolean picture_write_png(const char *path, const guint8 *rgb, int width, int height,
                           const char *const *texts, GError **error) {
    g_autofree char *message = NULL;
    g_autoptr(GByteArray) bytes = g_byte_array_new();
    png_structp png =
        png_create_write_struct(PNG_LIBPNG_VER_STRING, &message, on_error, picture_on_warning);
    png_infop info = png != NULL ? png_create_info_struct(png) : NULL;
    const gboolean good = info != NULL && encode(png, info, bytes, rgb, width, height, texts);
    png_destroy_write_struct(&png, &info);
    if (good)
        return output_file_write(path, bytes->data, bytes->len, error);
    g_set_error(
        error, PICTURE_ERROR, PICTURE_ERROR_IO,
        "%s: the picture of %d × %d pixels cannot be encoded as a PNG: %s; choose a smaller "
        "picture",
        path, width, height, message != NULL ? message : "there is no memory");
    return FALSE;
}

gboolean picture_write_exr(const char *path, const float *rgb, int width, int height,
                           const char *const *texts, GError **error) {
    static const char *const channels[] = {"B", "G", "R", NULL};
    struct exr_part *part = exr_part_new("picture", width, height, channels, EXR_FLOAT);
    struct exr_file *file = exr_file_new();
    exr_file_add(file, part);
    exr_set_string(part, COMPARE_PICTURE_KIND, "picture");
    for (; texts != NULL && texts[0] != NULL && texts[1] != NULL; texts += 2) {
        g_autofree char *key = g_ascii_strdown(texts[0], -1);
        /* EXR has a standard attribute "tiles", so the attribute of a text has a prefix */
        g_autofree char *name = g_strconcat("picture.", key, NULL);
        exr_set_string(part, name, texts[1]);
    }
    for (gsize i = 0; i < (gsize)width * height; i++)
        for (gsize c = 0; c < 3; c++)
            part->planes[2 - c][i] = rgb[3 * i + c];
    const gboolean good = exr_write(path, file, EXR_ZIP, FALSE, error);
    exr_file_free(file);
    return good;
}

locale_t picture_numbers_begin(void) {
    locale_t before = uselocale((locale_t)0);
    uselocale(newlocale(LC_NUMERIC_MASK, "C", duplocale(before)));
    return before;
}

void picture_numbers_end(locale_t before) {
    freelocale(uselocale(before));
}
