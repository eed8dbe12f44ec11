#include "picture_read.h"

#include <dlfcn.h>
#include <math.h>

#include "base/input_file.h"
#include "base/program.h"
#include "picture_codecs.h"
#include "picture_header.h"
#include "raw.h"

/* Returns the function of the codecs' module. The first call loads the module, which stays loaded.
 * Returns NULL with an error if the module cannot be loaded. */
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
                    "the picture codecs (mesorig-picture-codecs.so) cannot be loaded: %s; install "
                    "Mesorig again",
                    dlerror());
    return decode;
}

/* Reads, checks and decodes a file. ret_sha256 may be NULL. */
static gboolean read_pixels(const char *path, gboolean grey, struct picture_pixels *ret,
                            struct picture_says *ret_says, char **ret_sha256, GError **error) {
    gsize length = 0;
    g_autofree char *bytes = input_file_read(path, G_MAXINT, &length, error);
    if (!bytes || !picture_header_check(path, (const guint8 *)bytes, length, error))
        return FALSE;
    PictureCodecsDecode *decode = load_codecs(error);
    if (!decode)
        return FALSE;
    g_autofree char *what = NULL;
    picture_says_read((const guint8 *)bytes, length, ret_says);
    if (decode((const guint8 *)bytes, length,
               grey              ? PICTURE_GREY
               : ret_says->alpha ? PICTURE_ALPHA
                                 : PICTURE_COLOUR,
               ret, &what)) {
        if (ret_sha256)
            *ret_sha256 =
                g_compute_checksum_for_data(G_CHECKSUM_SHA256, (const guchar *)bytes, length);
        return TRUE;
    }
    picture_says_clear(ret_says);
    if (what)
        g_set_error(error, PICTURE_FILE_ERROR, PICTURE_FILE_ERROR_FAILED,
                    "%s: the picture cannot be decoded (%s); copy the file again, or save it in "
                    "another program",
                    path, what);
    else
        g_set_error(error, PICTURE_FILE_ERROR, PICTURE_FILE_ERROR_IO,
                    "%s is not a picture of a known format (JPEG, PNG, TIFF, BMP, PGM, PPM); copy "
                    "the file again, or save it as PNG or TIFF",
                    path);
    return FALSE;
}

/* Returns number k of all numbers in the file. */
static float number_at(const struct picture_pixels *from, gsize k) {
    if (from->bits == 8)
        return ((const guint8 *)from->values)[k];
    if (from->bits == 16)
        return ((const guint16 *)from->values)[k];
    return ((const float *)from->values)[k];
}

struct picture *picture_read(const char *path, GError **error) {
    if (raw_is(path))
        return raw_read_grey(path, error);
    struct picture_pixels pixels;
    struct picture_says says = {0};
    g_autofree char *sum = NULL;
    if (!read_pixels(path, TRUE, &pixels, &says, &sum, error))
        return NULL;
    const struct picture_tone *tone =
        picture_tone_choose(&says.tone, pixels.bits, PICTURE_TONES_UNSAID, path, error);
    struct picture *picture = tone ? picture_new(path, sum, pixels.width, pixels.height) : NULL;
    if (picture) {
        const gsize n = (gsize)pixels.width * (gsize)pixels.height;
        for (gsize i = 0; i < n; i++)
            picture->values[i] = number_at(&pixels, i);
        picture_tone_apply(tone, pixels.bits, picture->values, n);
    }
    g_free(pixels.values);
    picture_says_clear(&says);
    return picture;
}

gboolean picture_read_codes(const char *path, struct picture_codes *ret, GError **error) {
    struct picture_pixels pixels;
    *ret = (struct picture_codes){0};
    if (!read_pixels(path, FALSE, &pixels, &ret->says, NULL, error))
        return FALSE;
    const gsize n = (gsize)pixels.width * (gsize)pixels.height, channels = (gsize)pixels.channels;
    const float opaque = pixels.bits ? (float)((1 << pixels.bits) - 1) : 1;
    ret->width = pixels.width;
    ret->height = pixels.height;
    ret->grey = channels == 1;
    ret->bits = pixels.bits;
    ret->rgb = g_new(float, 3 * n);
    for (gsize i = 0; i < n; i++) {
        const gboolean seen =
            channels < 4 || !ret->says.alpha || number_at(&pixels, 4 * i + 3) >= opaque;
        ret->transparent += !seen;
        for (gsize c = 0; c < 3; c++)
            ret->rgb[3 * i + c] =
                seen ? number_at(&pixels, channels == 1 ? i : channels * i + 2 - c) : NAN;
    }
    g_free(pixels.values);
    return TRUE;
}

void picture_codes_clear(struct picture_codes *codes) {
    g_clear_pointer(&codes->rgb, g_free);
    picture_says_clear(&codes->says);
}
