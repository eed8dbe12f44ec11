/* Reads sizes from the headers of PNG (IHDR), JPEG (start of frame), BMP, portable anymaps, and
 * TIFF (tags of the first directory). */
#include "picture_header.h"

#include "base/input_file.h"
#include "tiff_tags.h"
#include "vision.h"

#include <string.h>

struct size {
    guint64 width, height;
    guint64 bits; /* bits per value of a TIFF; 0: unknown */
};

static gboolean png_size(const guint8 *bytes, gsize length, struct size *ret) {
    static const guint8 signature[8] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
    if (length < 24 || memcmp(bytes, signature, sizeof signature) != 0 ||
        memcmp(bytes + 12, "IHDR", 4) != 0)
        return FALSE;
    *ret = (struct size){tiff_number(bytes + 16, 4, TRUE), tiff_number(bytes + 20, 4, TRUE), 0};
    return TRUE;
}

/* Reads the size from the first start of frame, after skipping the segments before it. */
static gboolean jpeg_size(const guint8 *bytes, gsize length, struct size *ret) {
    if (length < 4 || bytes[0] != 0xff || bytes[1] != 0xd8)
        return FALSE;
    for (gsize at = 2; at + 9 <= length;) {
        if (bytes[at] != 0xff || bytes[at + 1] == 0xff) { /* decoders skip such bytes */
            at++;
            continue;
        }
        const guint8 marker = bytes[at + 1];
        /* 0xc0 … 0xcf start a frame, except tables (c4, cc) and an extension (c8). */
        if (marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 &&
            marker != 0xcc) {
            *ret = (struct size){tiff_number(bytes + at + 7, 2, TRUE),
                                 tiff_number(bytes + at + 5, 2, TRUE), 0};
            return TRUE;
        }
        const gboolean alone = marker <= 0x01 || (marker >= 0xd0 && marker <= 0xd8);
        at += alone ? 2 : 2 + (gsize)tiff_number(bytes + at + 2, 2, TRUE);
    }
    return FALSE;
}

/* Reads the size of a bitmap of Windows or OS/2. A negative height means that the top row comes
 * first. */
static gboolean bmp_size(const guint8 *bytes, gsize length, struct size *ret) {
    if (length < 26 || memcmp(bytes, "BM", 2) != 0)
        return FALSE;
    const gboolean old = tiff_number(bytes + 14, 4, FALSE) == 12; /* bytes of the second header */
    const gint64 height = old ? (gint64)tiff_number(bytes + 20, 2, FALSE)
                              : (gint64)(gint32)tiff_number(bytes + 22, 4, FALSE);
    *ret = (struct size){tiff_number(bytes + 18, old ? 2 : 4, FALSE), (guint64)ABS(height), 0};
    return TRUE;
}

/* Reads the size of a portable graymap or pixmap. It begins with "P2", "P3", "P5" or "P6", followed
 * by width and height in decimal. These are separated by white space and by comments, which end
 * with the line. */
static gboolean pnm_size(const guint8 *bytes, gsize length, struct size *ret) {
    guint64 values[2] = {0, 0};
    gsize at = 2;
    if (length < 8 || bytes[0] != 'P' || !strchr("2356", bytes[1]))
        return FALSE;
    for (int k = 0; k < 2; k++) {
        gboolean comment = FALSE;
        for (; at < length && (comment || bytes[at] == '#' || g_ascii_isspace(bytes[at])); at++)
            comment = bytes[at] == '#' || (comment && bytes[at] != '\n');
        for (; at < length && g_ascii_isdigit(bytes[at]) && values[k] < G_MAXINT32; at++)
            values[k] = 10 * values[k] + (guint64)(bytes[at] - '0');
    }
    *ret = (struct size){values[0], values[1], 0};
    return values[0] > 0 && values[1] > 0;
}

enum { TIFF_WIDTH = 256, TIFF_HEIGHT, TIFF_BITS, TIFF_TILE_WIDTH = 322, TIFF_TILE_HEIGHT };

/* Returns the first value of a tag, which is in the entry itself or at the offset in the entry.
 * Returns 0 if the value is outside the file or of another type. */
static guint64 tiff_value(const struct tiff *tiff, const guint8 *entry) {
    static const int sizes[] = {[1] = 1, [3] = 2, [4] = 4, [16] = 8};
    const int room = tiff->big ? 8 : 4;
    const guint64 type = tiff_number(entry + 2, 2, tiff->big_endian);
    const int size = type < G_N_ELEMENTS(sizes) ? sizes[type] : 0;
    const guint64 n = tiff_number(entry + 4, room, tiff->big_endian);
    const guint8 *at = entry + 4 + room;
    if (size > 0 && n > (guint64)(room / size)) {
        const guint64 offset = tiff_number(at, room, tiff->big_endian);
        if (offset > tiff->length - 8)
            return 0;
        at = tiff->bytes + offset;
    }
    return tiff_number(at, MIN(size, room), tiff->big_endian);
}

/* Reads the size from the tags of the first directory. A tile that extends beyond the picture is
 * decoded completely, so the size is at least that of a tile. Returns FALSE if width or height is
 * missing. */
static gboolean tiff_size(const struct tiff *tiff, struct size *ret) {
    const gsize n_bytes = tiff->big ? 8 : 2, each = tiff->big ? 20 : 12;
    const guint64 at = tiff_first(tiff);
    struct size tile = {0};
    if (at > tiff->length || tiff->length - at < n_bytes)
        return FALSE;
    const guint64 n = tiff_number(tiff->bytes + at, (int)n_bytes, tiff->big_endian);
    const guint8 *entry = tiff->bytes + at + n_bytes;
    for (guint64 i = 0; i < n && (gsize)(tiff->bytes + tiff->length - entry) >= each; i++) {
        const guint64 tag = tiff_number(entry, 2, tiff->big_endian),
                      value = tiff_value(tiff, entry);
        guint64 *const to = tag == TIFF_WIDTH         ? &ret->width
                            : tag == TIFF_HEIGHT      ? &ret->height
                            : tag == TIFF_BITS        ? &ret->bits
                            : tag == TIFF_TILE_WIDTH  ? &tile.width
                            : tag == TIFF_TILE_HEIGHT ? &tile.height
                                                      : NULL;
        if (to)
            *to = MAX(*to, value);
        entry += each;
    }
    ret->width = MAX(ret->width, tile.width);
    ret->height = MAX(ret->height, tile.height);
    return ret->width > 0 && ret->height > 0;
}

/* The size is checked before decoding, so that a small file cannot make the decoder allocate much
 * memory. */
gboolean picture_header_check(const char *path, const guint8 *bytes, gsize length, GError **error) {
    struct size size = {0};
    struct tiff tiff;
    if (!png_size(bytes, length, &size) && !jpeg_size(bytes, length, &size) &&
        !bmp_size(bytes, length, &size) && !pnm_size(bytes, length, &size) &&
        !(tiff_is(bytes, length, &tiff) && tiff_size(&tiff, &size))) {
        g_set_error(error, PICTURE_FILE_ERROR, PICTURE_FILE_ERROR_IO,
                    "%s is not a JPEG, PNG, TIFF, BMP or portable anymap (PGM, PPM) picture that "
                    "can be read; copy the file again, or save it as PNG or TIFF",
                    path);
        return FALSE;
    }
    if (!input_file_check_pixels(path, size.width, size.height, length, error))
        return FALSE;
    /* Values of 32 bits need twice the memory during decoding. */
    const guint64 most = MAX((guint64)INPUT_FILE_PIXELS, INPUT_FILE_PIXELS_PER_BYTE * length) / 2;
    if (size.bits <= 16 || size.height <= most / size.width)
        return TRUE;
    g_set_error(error, PICTURE_FILE_ERROR, PICTURE_FILE_ERROR_IO,
                "%s: with %" G_GUINT64_FORMAT " bits per value, a file of %" G_GSIZE_FORMAT
                " bytes may have at most %" G_GUINT64_FORMAT " pixels, not %" G_GUINT64_FORMAT
                " × %" G_GUINT64_FORMAT "; save the picture with 16 bits per value",
                path, size.bits, length, most, size.width, size.height);
    return FALSE;
}
