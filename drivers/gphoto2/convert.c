#include "convert.h"

#include "pictures/picture_read.h"
#include "pictures/raw.h"

#include <gio/gio.h>
#include <math.h>
#include <string.h>

/* Writes values of which 0 is black and 1 is white. */
static gboolean write_pgm(const char *path, int width, int height, const float *values,
                          GError **error) {
    const gsize n = (gsize)width * (gsize)height;
    g_autoptr(GString) file = g_string_new(NULL);
    g_string_printf(file, "P5\n%d %d\n%d\n", width, height, CONVERT_WHITE);
    const gsize head = file->len;
    g_string_set_size(file, head + 2 * n);
    for (gsize i = 0; i < n; i++) {
        const double value = CONVERT_BLACK + (double)values[i] * (CONVERT_WHITE - CONVERT_BLACK);
        const guint16 number = (guint16)lround(CLAMP(value, 0, CONVERT_WHITE));
        file->str[head + 2 * i] = (char)(number >> 8);
        file->str[head + 2 * i + 1] = (char)number;
    }
    return g_file_set_contents_full(path, file->str, (gssize)file->len, G_FILE_SET_CONTENTS_NONE,
                                    0600, error);
}

static gboolean convert_raw(const char *path, const char *pgm, struct converted *ret,
                            GError **error) {
    char cfa[RAW_CFA];
    g_autoptr(Picture) picture = raw_read(path, cfa, error);
    if (!picture)
        return FALSE;
    *ret = (struct converted){.width = picture->width, .height = picture->height, .raw = TRUE};
    memcpy(ret->cfa, cfa, sizeof ret->cfa);
    return write_pgm(pgm, ret->width, ret->height, picture->values, error);
}

static gboolean convert_jpeg(const char *path, const char *pgm, struct converted *ret,
                             GError **error) {
    static const int colours[] = {0, 1, 1, 2}; /* of rggb */
    g_auto(PictureCodes) codes = {0};
    if (!picture_read_codes(path, &codes, error))
        return FALSE;
    const gsize n = (gsize)codes.width * (gsize)codes.height;
    const struct picture_tone *tone =
        picture_tone_choose(&codes.says.tone, codes.bits, PICTURE_TONES_UNSAID, path, error);
    if (!tone)
        return FALSE;
    picture_tone_apply(tone, codes.bits, codes.rgb, 3 * n);
    g_autofree float *values = g_new0(float, n);
    for (int y = 0; y < codes.height; y++)
        for (int x = 0; x < codes.width; x++) {
            const gsize i = (gsize)y * (gsize)codes.width + (gsize)x;
            values[i] = codes.rgb[3 * i + (gsize)colours[y % 2 * 2 + x % 2]];
        }
    *ret = (struct converted){.width = codes.width, .height = codes.height};
    memcpy(ret->cfa, codes.grey ? "mono" : "rggb", sizeof ret->cfa);
    return write_pgm(pgm, ret->width, ret->height, values, error);
}

gboolean convert_to_pgm(const char *path, const char *pgm, struct converted *ret, GError **error) {
    return (raw_is(path) ? convert_raw : convert_jpeg)(path, pgm, ret, error);
}
