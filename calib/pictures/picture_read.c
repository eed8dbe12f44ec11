#include "picture_read.h"

#include <dlfcn.h>

#include "base/input_file.h"
#include "base/program.h"
#include "picture_codecs.h"
#include "picture_header.h"
#include "raw.h"

/* Loads the codecs once; they stay. */
static PictureCodecsDecode *load_codecs(GError **error) {
    static GMutex mutex;
    static PictureCodecsDecode *decode;
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&mutex);
    if (decode)
        return decode;
    g_autofree char *path = program_find_module(PICTURE_CODECS_MODULE, error);
    if (!path)
        return NULL;
    void *module = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (module)
        *(void **)&decode = dlsym(module, PICTURE_CODECS_DECODE);
    if (!decode)
        g_set_error(error, PICTURE_FILE_ERROR, PICTURE_FILE_ERROR_FAILED,
                    "the picture codecs cannot be loaded: %s; install Mesorig again", dlerror());
    return decode;
}

static gboolean read_pixels(const char *path, gboolean grey, struct picture_pixels *ret,
                            char **ret_sha256, GError **error) {
    gsize length = 0;
    g_autofree char *bytes = input_file_read(path, G_MAXINT, &length, error);
    if (!bytes || !picture_header_check(path, (const guint8 *)bytes, length, error))
        return FALSE;
    PictureCodecsDecode *decode = load_codecs(error);
    if (!decode)
        return FALSE;
    g_autofree char *what = NULL;
    if (decode((const guint8 *)bytes, length, grey, ret, &what)) {
        if (ret_sha256)
            *ret_sha256 =
                g_compute_checksum_for_data(G_CHECKSUM_SHA256, (const guchar *)bytes, length);
        return TRUE;
    }
    if (what)
        g_set_error(error, PICTURE_FILE_ERROR, PICTURE_FILE_ERROR_FAILED, "%s: %s", path, what);
    else
        g_set_error(error, PICTURE_FILE_ERROR, PICTURE_FILE_ERROR_IO,
                    "%s: is not a JPEG, PNG, TIFF, BMP or portable anymap (PGM, PPM) picture that "
                    "can be read",
                    path);
    return FALSE;
}

/* Value k of all: one of 8 bits is made linear by the table (sRGB), and 1 is white; without a table
 * the number in the file. */
static float value_at(const struct picture_pixels *from, gsize k, const float *table) {
    if (from->bits == 8) {
        const guint8 code = ((const guint8 *)from->values)[k];
        return table ? table[code] : code;
    }
    if (from->bits == 16)
        return ((const guint16 *)from->values)[k] / (table ? 65535.0f : 1.0f);
    return ((const float *)from->values)[k];
}

struct picture *picture_read(const char *path, GError **error) {
    if (raw_is(path))
        return raw_read_grey(path, error);
    struct picture_pixels pixels;
    g_autofree char *sum = NULL;
    if (!read_pixels(path, TRUE, &pixels, &sum, error))
        return NULL;
    struct picture *picture = picture_new(path, sum, pixels.width, pixels.height);
    float table[256];
    picture_srgb(table);
    for (gsize i = 0; i < (gsize)pixels.width * (gsize)pixels.height; i++)
        picture->values[i] = value_at(&pixels, i, table);
    g_free(pixels.values);
    return picture;
}

/* ret_bits: NULL for values that are linear in light. */
static gboolean read_in_colour(const char *path, int *ret_width, int *ret_height,
                               gboolean *ret_grey, int *ret_bits, float **ret_rgb, GError **error) {
    struct picture_pixels pixels;
    if (!read_pixels(path, FALSE, &pixels, NULL, error))
        return FALSE;
    const gsize n = (gsize)pixels.width * (gsize)pixels.height;
    const gboolean grey = pixels.channels == 1;
    float *rgb = g_new(float, 3 * n), table[256];
    picture_srgb(table);
    for (gsize i = 0; i < n; i++)
        for (gsize c = 0; c < 3; c++)
            rgb[3 * i + c] = value_at(&pixels, grey ? i : 3 * i + 2 - c, ret_bits ? NULL : table);
    *ret_grey = grey;
    *ret_width = pixels.width;
    *ret_height = pixels.height;
    *ret_rgb = rgb;
    if (ret_bits)
        *ret_bits = pixels.bits;
    g_free(pixels.values);
    return TRUE;
}

gboolean picture_read_colour(const char *path, int *ret_width, int *ret_height, gboolean *ret_grey,
                             float **ret_rgb, GError **error) {
    return read_in_colour(path, ret_width, ret_height, ret_grey, NULL, ret_rgb, error);
}

gboolean picture_read_codes(const char *path, int *ret_width, int *ret_height, gboolean *ret_grey,
                            int *ret_bits, float **ret_rgb, GError **error) {
    return read_in_colour(path, ret_width, ret_height, ret_grey, ret_bits, ret_rgb, error);
}
