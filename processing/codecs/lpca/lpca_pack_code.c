#include "lpca_pack_private.h"

#include <lzma.h>
#include <math.h>
#include <string.h>

#define COLOURS 3
/* a byte of this value stands for a number ≥ LARGE, which is stored after all of these bytes */
#define LARGE       255
#define PRESET      6
#define MAX_MEMORY  ((guint64)64 << 20) /* memory for unpacking, sufficient for PRESET */
#define MAX_NUMBERS ((gsize)1 << 30)
#define LARGE_BYTES 4
#define MAX_TABLES  ((gint64)1 << 26) /* maximum number of numbers in all tables together */

/* folded() maps the numbers 0, −1, 1, −2 … to 0, 1, 2, 3 …. unfolded() is its inverse. */
static guint32 folded(gint32 value) {
    return value >= 0 ? 2 * (guint32)value : 2 * (guint32)(-(gint64)value) - 1;
}

static gint32 unfolded(guint32 value) {
    return value % 2 ? (gint32)(-(gint64)(value / 2) - 1) : (gint32)(value / 2);
}

/* Returns the numbers of folded() as bytes that xz has compressed. For each number there is one
 * byte: the number, or LARGE if the number is larger. After these bytes there are, for each number
 * ≥ LARGE, the number minus LARGE in LARGE_BYTES bytes. */
GByteArray *lpca_varint_encode(const gint32 *values, gsize n) {
    g_autoptr(GByteArray) plain = g_byte_array_new();
    for (gsize i = 0; i < n; i++) {
        const guint8 byte = (guint8)MIN(folded(values[i]), LARGE);
        g_byte_array_append(plain, &byte, 1);
    }
    for (gsize i = 0; i < n; i++)
        if (folded(values[i]) >= LARGE) {
            const guint32 rest = GUINT32_TO_LE(folded(values[i]) - LARGE);
            g_byte_array_append(plain, (const guint8 *)&rest, LARGE_BYTES);
        }
    lzma_options_lzma options;
    const lzma_filter filters[] = {{LZMA_FILTER_LZMA2, &options}, {LZMA_VLI_UNKNOWN, NULL}};
    lzma_lzma_preset(&options, PRESET);
    options.lc = 0; /* the previous byte does not help to predict the next one */
    GByteArray *ret = g_byte_array_new();
    gsize used = 0;
    g_byte_array_set_size(ret, (guint)lzma_stream_buffer_bound(plain->len));
    if (lzma_stream_buffer_encode((lzma_filter *)filters, LZMA_CHECK_CRC32, NULL, plain->data,
                                  plain->len, ret->data, &used, ret->len) != LZMA_OK)
        g_error("no memory to compress %u bytes", plain->len);
    g_byte_array_set_size(ret, (guint)used);
    return ret;
}

/* Decodes n numbers that lpca_varint_encode() has encoded; g_free(). Returns NULL if the bytes do
 * not contain exactly n numbers. */
gint32 *lpca_varint_decode(const guint8 *bytes, gsize size, gsize n) {
    guint64 memory = MAX_MEMORY;
    gsize read = 0, found = 0, larger = 0, at = n;
    const gsize most = n * (1 + LARGE_BYTES);
    if (n > MAX_NUMBERS)
        return NULL;
    g_autofree guint8 *plain = g_try_malloc(most);
    if (!plain || lzma_stream_buffer_decode(&memory, 0, NULL, bytes, &read, size, plain, &found,
                                            most) != LZMA_OK)
        return NULL;
    for (gsize i = 0; found >= n && i < n; i++)
        larger += plain[i] == LARGE;
    if (found != n + larger * LARGE_BYTES)
        return NULL;
    gint32 *ret = g_try_new(gint32, n);
    for (gsize i = 0; ret && i < n; i++) {
        guint32 rest = 0;
        if (plain[i] == LARGE) {
            memcpy(&rest, plain + at, LARGE_BYTES);
            at += LARGE_BYTES;
        }
        ret[i] = unfolded(plain[i] + GUINT32_FROM_LE(rest));
    }
    return ret;
}

struct axis_pair {
    int key, view, light;
};

static int by_key(gconstpointer a, gconstpointer b) {
    const struct axis_pair *p = a, *q = b;
    return p->key != q->key ? p->key - q->key : p->view - q->view;
}

/* Returns the positions of the numbers in packed->tables, in the order of the file. */
static gsize *table_order(const struct lpca_packed *packed, int tables, gsize *ret_n) {
    const int v = packed->n_views, l = packed->n_lights;
    g_autofree struct axis_pair *pairs = g_new(struct axis_pair, v * l);
    gsize *ret = g_new(gsize, (gsize)(v * l) * COLOURS * (gsize)tables), n = 0;
    for (int i = 0; i < v * l; i++)
        pairs[i] = (struct axis_pair){(i / l + 3) * (i % l + 3), i / l, i % l};
    qsort(pairs, (gsize)v * (gsize)l, sizeof *pairs, by_key);
    for (int i = 0; i < v * l; i++)
        for (int c = 0; c < COLOURS; c++)
            for (int table = 0; table < tables; table++)
                ret[n++] = ((gsize)(table * v + pairs[i].view) * COLOURS + (gsize)c) * (gsize)l +
                           (gsize)pairs[i].light;
    *ret_n = n;
    return ret;
}

/* Returns the positions of the numbers of a map, in the order of the file. */
static gsize *map_order(int width, int height, gsize *ret_n) {
    gsize *ret = g_new(gsize, (gsize)width * (gsize)height), n = 0;
    for (int sum = 0; sum < width + height - 1; sum++)
        for (int x = MAX(0, sum - height + 1); x <= MIN(sum, width - 1); x++)
            ret[n++] = (gsize)(sum - x) * (gsize)width + (gsize)x;
    *ret_n = n;
    return ret;
}

static gsize *tables_of(const struct lpca *lpca, gsize *ret_n) {
    return table_order(lpca->packed, lpca->n_clusters * (lpca->n_components + 1), ret_n);
}

/* Encodes count numbers. Number i is values[order[i % n] + i / n · n]. */
static GByteArray *encode(const gint32 *values, const gsize *order, gsize n, gsize count) {
    g_autofree gint32 *ordered = g_new0(gint32, count);
    for (gsize i = 0; i < count; i++)
        ordered[i] = values[order[i % n] + i / n * n];
    return lpca_varint_encode(ordered, count);
}

static GByteArray *encode_tables(const struct lpca *lpca) {
    gsize n = 0;
    g_autofree gsize *order = tables_of(lpca, &n);
    return encode(lpca->packed->tables, order, n, n);
}

static GByteArray *encode_maps(const struct lpca *lpca) {
    gsize size = 0;
    g_autofree gsize *order = map_order(lpca->layout.width, lpca->layout.height, &size);
    const gsize c = (gsize)lpca->n_components;
    return encode(lpca->packed->maps, order, size, size * c);
}

static struct exr_part *one_channel(const char *name, const char *channel, int width, int height,
                                    enum exr_type type, const float *values) {
    const char *channels[] = {channel, NULL};
    struct exr_part *part = exr_part_new(name, width, height, channels, type);
    memcpy(part->planes[0], values, sizeof(float) * (gsize)width * (gsize)height);
    return part;
}

static struct exr_part *bits_part(const char *name, GByteArray *bytes) {
    const guint n = bytes->len, pixels = (n + 3) / 4;
    static const guint8 zeros[4];
    g_byte_array_append(bytes, zeros, 4 * pixels - n);
    for (guint i = 0; i < pixels; i++)
        ((guint32 *)(gpointer)bytes->data)[i] =
            GUINT32_FROM_LE(((guint32 *)(gpointer)bytes->data)[i]);
    struct exr_part *part =
        one_channel(name, "BITS", (int)pixels, 1, EXR_FLOAT, (gconstpointer)bytes->data);
    exr_set_int(part, "mesorig.bytes", (int)n);
    g_byte_array_unref(bytes);
    return part;
}

void lpca_packed_add_parts(struct exr_file *file, const struct lpca *lpca) {
    const struct lpca_packed *packed = lpca->packed;
    exr_file_add(file, one_channel("view_axes", "A", lpca->layout.views.n, packed->n_views,
                                   EXR_HALF, packed->views));
    exr_file_add(file, one_channel("light_axes", "A", lpca->layout.lights.n, packed->n_lights,
                                   EXR_HALF, packed->lights));
    exr_file_add(file,
                 one_channel("colour_axes", "A", COLOURS, COLOURS, EXR_FLOAT, packed->colours));
    exr_file_add(file, bits_part("tables", encode_tables(lpca)));
    exr_file_add(file, bits_part("maps", encode_maps(lpca)));
}

/* Reads axes of width values each. Returns NULL if the part is missing, has more than width axes,
 * or has a value that is not finite. g_free() */
static float *read_axes(const struct exr_file *file, const char *name, int width, int *ret_n) {
    const struct exr_part *part = exr_file_part(file, name);
    const float *plane = part ? exr_part_plane(part, "A") : NULL;
    if (!plane || part->width != width || part->height > width)
        return NULL;
    float *ret = g_memdup2(plane, sizeof(float) * (gsize)width * (gsize)part->height);
    *ret_n = part->height;
    for (int i = 0; i < width * part->height; i++)
        if (!isfinite(ret[i])) {
            g_free(ret);
            return NULL;
        }
    return ret;
}

/* Reads from a part of the file the numbers that encode() wrote. Returns NULL if the part is
 * missing or damaged. */
static gint32 *read_bits(const struct exr_file *file, const char *name, const gsize *order, gsize n,
                         gsize count) {
    const struct exr_part *part = exr_file_part(file, name);
    const float *plane = part ? exr_part_plane(part, "BITS") : NULL;
    int bytes = 0;
    if (!plane || part->height != 1 || !exr_get_int(part, "mesorig.bytes", &bytes, NULL) ||
        bytes < 1 || bytes > 4 * (gint64)part->width)
        return NULL;
    g_autofree guint32 *words = g_memdup2(plane, sizeof(float) * (gsize)part->width);
    for (int i = 0; i < part->width; i++)
        words[i] = GUINT32_TO_LE(words[i]);
    g_autofree gint32 *ordered = lpca_varint_decode((const guint8 *)words, (gsize)bytes, count);
    gint32 *ret = ordered ? g_new0(gint32, count) : NULL;
    for (gsize i = 0; ret && i < count; i++)
        ret[order[i % n] + i / n * n] = ordered[i];
    return ret;
}

static gboolean read_colours(struct lpca_packed *packed, const struct exr_file *file) {
    int n = 0;
    g_autofree float *axes = read_axes(file, "colour_axes", COLOURS, &n);
    if (n == COLOURS)
        memcpy(packed->colours, axes, sizeof packed->colours);
    return n == COLOURS;
}

static gboolean read_tables(const struct lpca *lpca, const struct exr_file *file) {
    gsize n = 0;
    g_autofree gsize *order = tables_of(lpca, &n);
    lpca->packed->tables = read_bits(file, "tables", order, n, n);
    return lpca->packed->tables != NULL;
}

static gboolean read_maps(const struct lpca *lpca, const struct exr_file *file) {
    gsize size = 0;
    g_autofree gsize *order = map_order(lpca->layout.width, lpca->layout.height, &size);
    const gsize c = (gsize)lpca->n_components;
    lpca->packed->maps = read_bits(file, "maps", order, size, size * c);
    return lpca->packed->maps != NULL;
}

gboolean lpca_packed_read_parts(struct lpca *lpca, const struct exr_file *file) {
    struct lpca_packed *packed = lpca->packed;
    packed->views = read_axes(file, "view_axes", lpca->layout.views.n, &packed->n_views);
    packed->lights = read_axes(file, "light_axes", lpca->layout.lights.n, &packed->n_lights);
    return packed->views && packed->lights && read_colours(packed, file) &&
           (gint64)packed->n_views * packed->n_lights * COLOURS * lpca->n_clusters <=
               MAX_TABLES / (lpca->n_components + 1) &&
           read_tables(lpca, file) && read_maps(lpca, file);
}
