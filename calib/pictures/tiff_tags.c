#include "tiff_tags.h"

#include <string.h>

guint64 tiff_number(const guint8 *at, int n, gboolean big_endian) {
    guint64 value = 0;
    for (int i = 0; i < n; i++)
        value = value << 8 | at[big_endian ? i : n - 1 - i];
    return value;
}

gboolean tiff_is(const guint8 *bytes, gsize length, struct tiff *ret) {
    if (length < 16 || (memcmp(bytes, "II", 2) != 0 && memcmp(bytes, "MM", 2) != 0))
        return FALSE;
    *ret = (struct tiff){bytes, length, bytes[0] == 'M', FALSE};
    const guint64 version = tiff_number(bytes + 2, 2, ret->big_endian);
    ret->big = version == 43;
    return version == 42 || version == 43;
}

guint64 tiff_first(const struct tiff *tiff) {
    return tiff_number(tiff->bytes + (tiff->big ? 8 : 4), tiff->big ? 8 : 4, tiff->big_endian);
}

gboolean tiff_find(const struct tiff *tiff, guint64 directory, guint tag, struct tiff_value *ret) {
    static const int sizes[] = {0, 1, 1, 2, 4, 8, 1, 1, 2, 4, 8, 4, 8, 4, 0, 0, 8, 8, 8};
    const gsize n_bytes = tiff->big ? 8 : 2, each = tiff->big ? 20 : 12;
    const int room = tiff->big ? 8 : 4;
    if (directory > tiff->length || tiff->length - directory < n_bytes)
        return FALSE;
    const guint64 n = tiff_number(tiff->bytes + directory, (int)n_bytes, tiff->big_endian);
    const guint8 *entry = tiff->bytes + directory + n_bytes;
    for (guint64 i = 0; i < n && (gsize)(tiff->bytes + tiff->length - entry) >= each; i++) {
        if (tiff_number(entry, 2, tiff->big_endian) != tag) {
            entry += each;
            continue;
        }
        ret->type = tiff_number(entry + 2, 2, tiff->big_endian);
        ret->n = tiff_number(entry + 4, room, tiff->big_endian);
        ret->size = ret->type < G_N_ELEMENTS(sizes) ? sizes[ret->type] : 0;
        ret->at = entry + 4 + room;
        if (ret->size == 0 || ret->n == 0)
            return FALSE;
        if (ret->n > (guint64)(room / ret->size)) {
            const guint64 offset = tiff_number(ret->at, room, tiff->big_endian);
            if (offset > tiff->length || ret->n > (tiff->length - offset) / (guint64)ret->size)
                return FALSE;
            ret->at = tiff->bytes + offset;
        }
        return TRUE;
    }
    return FALSE;
}

guint64 tiff_find_number(const struct tiff *tiff, guint64 directory, guint tag) {
    struct tiff_value value;
    return tiff_find(tiff, directory, tag, &value) && value.type != TIFF_RATIONAL
               ? tiff_number(value.at, value.size, tiff->big_endian)
               : 0;
}
