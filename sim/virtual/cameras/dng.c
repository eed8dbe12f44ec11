#include "dng.h"

#include <string.h>

enum { BYTE = 1, ASCII, SHORT, LONG, RATIONAL, SRATIONAL = 10 };

struct out {
    /* `entries`: 12 bytes for each tag. `more`: values that do not fit into an entry. */
    GByteArray *entries, *more;
    guint32 more_at; /* position of `more` in the file */
};

static void put(GByteArray *to, int bytes, guint64 value) {
    for (int i = 0; i < bytes; i++) {
        const guint8 byte = (guint8)(value >> 8 * i);
        g_byte_array_append(to, &byte, 1);
    }
}

/* Adds a tag with n values. The values of a rational type are numerators; each denominator is
 * 1000. */
static void tag(struct out *out, guint16 number, int type, guint32 n, const guint32 *values) {
    static const int sizes[] = {[BYTE] = 1, [ASCII] = 1, [SHORT] = 2, [LONG] = 4};
    const gboolean ratio = type == RATIONAL || type == SRATIONAL;
    const guint32 length = n * (ratio ? 8 : (guint32)sizes[type]);
    GByteArray *to = length > 4 ? out->more : out->entries;
    put(out->entries, 2, number);
    put(out->entries, 2, (guint64)type);
    put(out->entries, 4, n);
    if (length > 4)
        put(out->entries, 4, out->more_at + out->more->len);
    for (guint32 i = 0; i < n; i++) {
        put(to, ratio ? 4 : sizes[type], values[i]);
        if (ratio)
            put(to, 4, 1000);
    }
    if (length < 4)
        put(out->entries, (int)(4 - length), 0);
    if (out->more->len % 2)
        put(out->more, 1, 0);
}

static void text(struct out *out, guint16 number, const char *value) {
    guint32 letters[64] = {0};
    const guint32 n = (guint32)strlen(value) + 1;
    for (guint32 i = 0; i < n; i++)
        letters[i] = (guchar)value[i];
    tag(out, number, ASCII, n, letters);
}

#define TAG(number, type, ...)                                                                     \
    tag(&out, number, type, sizeof((const guint32[]){__VA_ARGS__}) / 4,                            \
        (const guint32[]){__VA_ARGS__})

static void tag_filter(struct out *to, const struct dng *dng) {
    struct out out = *to;
    guint32 colours[64];
    const guint32 repeat = dng->repeat ? (guint32)dng->repeat : 2;
    for (guint32 i = 0; i < repeat * repeat; i++)
        colours[i] = dng->repeat ? 1 : (guint32)(strchr("rgb", dng->cfa[i]) - "rgb");
    TAG(33421, SHORT, repeat, repeat);
    tag(&out, 33422, BYTE, repeat * repeat, colours);
}

GBytes *dng_new(const struct dng *dng) {
    const guint32 width = (guint32)dng->width, height = (guint32)dng->height;
    const gboolean mono = strcmp(dng->cfa, "mono") == 0;
    const guint32 n_tags = mono ? 22 : 24, more_at = 8 + 2 + 12 * n_tags + 4, room = 1024;
    struct out out = {g_byte_array_new(), g_byte_array_new(), more_at};
    TAG(254, LONG, 0);
    TAG(256, LONG, width);
    TAG(257, LONG, height);
    TAG(258, SHORT, 16);
    TAG(259, SHORT, 1);
    TAG(262, SHORT, mono ? 34892 : 32803);
    text(&out, 271, "Mesorig");
    text(&out, 272, "Test");
    TAG(273, LONG, more_at + room);
    TAG(274, SHORT, 6); /* orientation: a quarter turn, which a reader must ignore */
    TAG(277, SHORT, 1);
    TAG(278, LONG, height);
    TAG(279, LONG, 2 * width * height);
    TAG(284, SHORT, 1);
    if (!mono)
        tag_filter(&out, dng);
    TAG(50706, BYTE, 1, 4, 0, 0);
    text(&out, 50708, "Mesorig Test");
    TAG(50713, SHORT, 2, 2);
    TAG(50714, LONG, dng->black[0], dng->black[1], dng->black[2], dng->black[3]);
    TAG(50717, LONG, dng->white);
    TAG(50721, SRATIONAL, 700, 0, 0, 0, 1000, 0, 0, 0, 900);
    TAG(50728, RATIONAL, 500, 1000, 700);
    TAG(50829, LONG, (guint32)dng->top, (guint32)dng->left, height, width);
    g_assert_cmpuint(out.entries->len, ==, 12 * n_tags);
    g_assert_cmpuint(out.more->len, <=, room);
    GByteArray *file = g_byte_array_new();
    g_byte_array_append(file, (const guint8 *)"II", 2);
    put(file, 2, 42);
    put(file, 4, 8);
    put(file, 2, n_tags);
    g_byte_array_append(file, out.entries->data, out.entries->len);
    put(file, 4, 0);
    g_byte_array_append(file, out.more->data, out.more->len);
    while (file->len < more_at + room)
        put(file, 1, 0);
    for (guint32 i = 0; i < width * height; i++)
        put(file, 2, dng->values[i]);
    g_byte_array_unref(out.entries);
    g_byte_array_unref(out.more);
    return g_byte_array_free_to_bytes(file);
}
