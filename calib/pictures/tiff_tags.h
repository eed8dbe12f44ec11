/* This module reads the tags of TIFF files, EXIF data and camera raw files, which have the same
 * form. Any thread may call the functions. */
#pragma once

#include <glib.h>

G_BEGIN_DECLS

struct tiff {
    const guint8 *bytes;
    gsize length;
    gboolean big_endian, big; /* big: a BigTIFF, whose entries have 20 bytes instead of 12 */
};

/* The values of a tag: n values of size bytes each, all within the file. */
struct tiff_value {
    guint64 type, n;
    int size;
    const guint8 *at;
};

enum { TIFF_ASCII = 2, TIFF_RATIONAL = 5 };

/* Reads an unsigned integer of n bytes. */
guint64 tiff_number(const guint8 *at, int n, gboolean big_endian);

/* Returns whether the bytes begin a TIFF. The directories are checked when they are read. */
gboolean tiff_is(const guint8 *bytes, gsize length, struct tiff *ret);
/* Returns the offset of the first directory. */
guint64 tiff_first(const struct tiff *tiff);
/* Finds a tag in the directory at an offset. Returns FALSE if the directory does not have the tag,
 * if the tag has no values or values of an unknown type, or if the values are not within the
 * file. */
gboolean tiff_find(const struct tiff *tiff, guint64 directory, guint tag, struct tiff_value *ret);
/* Returns the first value of a tag with unsigned integers. Returns 0 if tiff_find() does not find
 * the tag, or if its values are of the type RATIONAL. */
guint64 tiff_find_number(const struct tiff *tiff, guint64 directory, guint tag);

G_END_DECLS
