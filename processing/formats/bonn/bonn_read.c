/* Reads values view by view. In a BDI the ABRDF of a texel is contiguous: halves
 * [view][light][channel]. A view therefore gathers a slice of each texel's ABRDF. */
#include "bonn_private.h"

#include <math.h>
#include <string.h>
#include <unistd.h>

#include "base/input_file.h"
#include "base/work.h"
#include "exr/exr_half.h"

/* Number of pixels of a view that are decoded together: some texels under all lights. */
#define BLOCK ((gsize)1 << 20)

struct BonnFile {
    int fd; /* −1 if not opened */
    char *path;
    struct bonn_header header;
    int order[BONN_CHANNELS]; /* positions of R, G, B among the channels */

    guint32 per_chunk; /* number of texels in a chunk; only for BDI */
    gsize chunks_at;   /* position of the first chunk in the file, in bytes; only for BDI */
    struct bonn_index index;

    struct bonn_matrix matrices[BONN_CHANNELS]; /* an FMF has only the first */
    struct bonn_colours colours;
};

void bonn_close(BonnFile *file) {
    if (!file)
        return;
    for (int i = 0; i < BONN_CHANNELS; i++)
        bonn_matrix_clear(&file->matrices[i]);
    g_free(file->index.of_texel);
    bonn_header_clear(&file->header);
    if (file->fd >= 0)
        close(file->fd);
    g_free(file->path);
    g_free(file);
}

const struct bonn_header *bonn_header(const BonnFile *file) {
    return &file->header;
}

static gsize abrdf_bytes(const struct bonn_header *header) {
    return (gsize)header->n_views * (gsize)header->n_lights * BONN_CHANNELS * sizeof(guint16);
}

/* Checks that every chunk exists and has the right length. Later reads compute positions in the
 * file from these lengths. */
static gboolean check_chunks(BonnFile *file, struct bonn_bytes *bytes, GError **error) {
    const gsize each = abrdf_bytes(&file->header);
    file->chunks_at = bytes->at;
    for (gsize left = (gsize)file->index.n_stored; left > 0;) {
        const gsize n = MIN(left, file->per_chunk);
        guint32 size;
        if (!bonn_take_u32(bytes, "chunk", &size, error))
            return FALSE;
        if (size != n * each)
            return bonn_fail(
                bytes, BONN_ERROR_FORMAT, error,
                "the chunk of %u bytes at byte %zu should have %zu bytes; copy the file again",
                size, bytes->at - sizeof size, n * each);
        if (!bonn_skip(bytes, size, "chunk", error))
            return FALSE;
        left -= n;
    }
    return TRUE;
}

static gboolean parse_bdi(BonnFile *file, struct bonn_bytes *bytes, GError **error) {
    struct bonn_header *header = &file->header;
    guint32 lines;
    guint8 compression;
    const gsize n_texels = (gsize)header->width * (gsize)header->height;
    g_autofree guint8 *mask = g_malloc(n_texels);
    if (!bonn_take_u32(bytes, "number of lines per chunk", &lines, error) ||
        !bonn_take(bytes, 1, "compression", &compression, error))
        return FALSE;
    if (compression == 1)
        return bonn_fail(
            bytes, BONN_ERROR_UNSUPPORTED, error,
            "the file is compressed by bzip2, which is not supported; give the BTF in a file "
            "without bzip2");
    if (compression > 2 || lines < 1)
        return bonn_fail(bytes, BONN_ERROR_FORMAT, error,
                         "compression %d with %u lines per chunk is not valid; copy the file again",
                         compression, lines);
    header->kind = compression ? BONN_BDI_SPARSE : BONN_BDI;
    file->per_chunk = MIN(lines, (guint32)header->height) * (guint32)header->width;
    if (!bonn_take(bytes, n_texels, "mask", mask, error) ||
        !bonn_skip_rotations(bytes, header, error))
        return FALSE;
    file->index.of_texel = g_new(gint32, n_texels);
    for (gsize i = 0; i < n_texels; i++) {
        file->index.of_texel[i] = mask[i] ? file->index.n_stored : -1;
        file->index.n_stored += mask[i] != 0 || header->kind == BONN_BDI;
    }
    return check_chunks(file, bytes, error);
}

/* Parses the version of an FMF and the fields that it implies. Skips a height map. */
static gboolean parse_fmf_version(BonnFile *file, struct bonn_bytes *bytes, GError **error) {
    guint32 method = 0, width = 0, height = 0;
    guint8 version;
    if (!bonn_take(bytes, 1, "version", &version, error))
        return FALSE;
    if (version > 2)
        return bonn_fail(bytes, BONN_ERROR_UNSUPPORTED, error,
                         "the file is FMF version %d; only versions up to 2 can be read", version);
    if (version >= 1 && !bonn_take_u32(bytes, "range reduction", &method, error))
        return FALSE;
    if (version >= 2 && (!bonn_take_u32(bytes, "height map", &width, error) ||
                         !bonn_take_u32(bytes, "height map", &height, error)))
        return FALSE;
    if (width > G_MAXUINT16 || height > G_MAXUINT16)
        return bonn_fail(
            bytes, BONN_ERROR_FORMAT, error,
            "the height map has %u × %u texels, which is too large; copy the file again", width,
            height);
    file->colours.logarithm = method != 0;
    return bonn_skip(bytes, 2 * (gsize)width * height, "height map", error);
}

static gboolean parse_dfmf(BonnFile *file, struct bonn_bytes *bytes, GError **error) {
    guint32 components, numbers[12];
    if (!bonn_skip_rotations(bytes, &file->header, error) ||
        !bonn_take_u32(bytes, "number of components", &components, error) ||
        !bonn_take_u32(bytes, "colour model", &file->colours.model, error))
        return FALSE;
    for (int i = 0; i < 12; i++)
        if (!bonn_take_u32(bytes, "colour model", &numbers[i], error))
            return FALSE;
    memcpy(file->colours.mean, numbers, sizeof file->colours.mean);
    memcpy(file->colours.matrix, numbers + 3, sizeof file->colours.matrix);
    if (!bonn_colours_check(bytes, &file->colours, error))
        return FALSE;
    for (int i = 0; i < BONN_CHANNELS; i++)
        if (!bonn_parse_matrix(bytes, &file->header, 1, &file->matrices[i], error))
            return FALSE;
    return TRUE;
}

static gboolean parse(BonnFile *file, gsize size, GError **error) {
    struct bonn_bytes bytes = {file->fd, size, 0, file->path};
    const struct bonn_header *header = &file->header;
    guint32 components;
    gboolean extra;
    if (!bonn_parse_header(&bytes, &file->header, file->order, &extra, error))
        return FALSE;
    /* bonn_read_view() needs memory for all lights of a view. */
    const guint64 view = (guint64)header->width * (guint64)header->height *
                         (guint64)header->n_lights * BONN_CHANNELS * sizeof(float);
    if (view > input_file_memory(size))
        return bonn_fail(&bytes, BONN_ERROR_FORMAT, error,
                         "a view of %d × %d texels and %d lights takes %" G_GUINT64_FORMAT
                         " MiB of memory, which is too much for a file of %zu bytes; copy the file "
                         "again if these numbers are wrong. The limit in MiB is %" G_GUINT64_FORMAT,
                         header->width, header->height, header->n_lights, view >> 20, size,
                         input_file_memory(size) >> 20);
    switch (header->kind) {
    case BONN_FMF:
        return bonn_skip_rotations(&bytes, &file->header, error) &&
               (!extra || parse_fmf_version(file, &bytes, error)) &&
               bonn_take_u32(&bytes, "number of components", &components, error) &&
               bonn_parse_matrix(&bytes, header, BONN_CHANNELS, &file->matrices[0], error);
    case BONN_DFMF:
        return parse_dfmf(file, &bytes, error);
    default:
        return parse_bdi(file, &bytes, error);
    }
}

BonnFile *bonn_open(const char *path, GError **error) {
    GError *found = NULL;
    g_autoptr(BonnFile) file = g_new0(BonnFile, 1);
    file->path = g_strdup(path);
    guint64 bytes = 0;
    file->fd = input_file_open(path, G_MAXINT64, &bytes, &found);
    if (file->fd < 0) {
        input_file_propagate(found, BONN_ERROR, BONN_ERROR_IO, BONN_ERROR_FORMAT, error);
        return NULL;
    }
    return parse(file, bytes, error) ? g_steal_pointer(&file) : NULL;
}

/* Reads a block of n texels. to[(light · n + texel) · 3 + channel] is a value, or NaN if the texel
 * is not stored. In the file, the channel of a texel varies fastest, then the light. */
static gboolean read_bdi(const BonnFile *file, int view, gsize first, gsize n, float *to,
                         GError **error) {
    const gsize n_lights = (gsize)file->header.n_lights, n_values = n_lights * BONN_CHANNELS;
    g_autofree guint16 *halves = g_new(guint16, n_values);
    g_autofree float *abrdf = g_new0(float, n_values);
    for (gsize texel = 0; texel < n; texel++) {
        const gint32 stored = file->index.of_texel[first + texel];
        for (gsize i = 0; stored < 0 && i < n_values; i++)
            abrdf[i] = NAN;
        if (stored >= 0) {
            const gsize chunk = (gsize)stored / file->per_chunk;
            const gsize at = file->chunks_at + (chunk + 1) * sizeof(guint32) +
                             (gsize)stored * abrdf_bytes(&file->header) +
                             (gsize)view * n_values * sizeof(guint16);
            struct bonn_bytes bytes = {file->fd, G_MAXSIZE, at, file->path};
            if (!bonn_take(&bytes, n_values * sizeof(guint16), "chunk", halves, error))
                return FALSE;
            exr_half_to_floats(abrdf, halves, n_values);
        }
        for (gsize light = 0; light < n_lights; light++)
            for (gsize c = 0; c < BONN_CHANNELS; c++)
                to[(light * n + texel) * BONN_CHANNELS + c] = abrdf[light * BONN_CHANNELS + c];
    }
    return TRUE;
}

/* Copies n pixels, with their channels in the order R, G, B. A pixel with a value that is not
 * finite becomes 0. Returns the number of such pixels. */
static int store(const BonnFile *file, const float *from, gsize n, float *to) {
    int holes = 0;
    for (gsize i = 0; i < n; i++, from += BONN_CHANNELS, to += BONN_CHANNELS) {
        gboolean good = TRUE;
        for (int c = 0; c < BONN_CHANNELS; c++) {
            to[c] = from[file->order[c]];
            good &= isfinite(to[c]) != 0;
        }
        if (!good)
            to[0] = to[1] = to[2] = 0;
        holes += !good;
    }
    return holes;
}

gboolean bonn_read_view(const BonnFile *file, int view, float *ret_rgb, int *ret_holes,
                        GError **error) {
    static const int all[BONN_CHANNELS] = {0, 1, 2};
    const struct bonn_header *header = &file->header;
    const gsize n_texels = (gsize)header->width * (gsize)header->height;
    const gsize n_lights = (gsize)header->n_lights;
    const gsize most = CLAMP(BLOCK / n_lights, 1, n_texels);
    g_autofree float *block = g_new(float, n_lights *most *BONN_CHANNELS);
    g_return_val_if_fail(view >= 0 && view < header->n_views, FALSE);
    memset(ret_holes, 0, sizeof *ret_holes * n_lights);
    for (gsize first = 0; first < n_texels; first += most) {
        const gsize n = MIN(most, n_texels - first);
        if (header->kind == BONN_FMF)
            bonn_matrix_view(&file->matrices[0], header, BONN_CHANNELS, view, first, n, all, block);
        for (int c = 0; header->kind == BONN_DFMF && c < BONN_CHANNELS; c++)
            bonn_matrix_view(&file->matrices[c], header, 1, view, first, n, &all[c], block);
        if (header->kind == BONN_FMF || header->kind == BONN_DFMF)
            bonn_colours_undo(&file->colours, block, n * n_lights);
        else if (!read_bdi(file, view, first, n, block, error))
            return FALSE;
        for (gsize light = 0; light < n_lights; light++)
            ret_holes[light] += store(file, block + light * n * BONN_CHANNELS, n,
                                      ret_rgb + (light * n_texels + first) * BONN_CHANNELS);
    }
    return TRUE;
}

struct BonnViews {
    const BonnFile *file;
    int first, n;
    guint16 *halves; /* n_texels × n × n_lights × 3, as in the file */
    GMutex lock;     /* protects failed */
    GError *failed;
};

#define READ_BLOCK 1024 /* number of texels that a thread reads at a time */

static void read_block(int block, gpointer data) {
    BonnViews *views = data;
    const BonnFile *file = views->file;
    const struct bonn_header *header = &file->header;
    const gsize row = (gsize)header->n_lights * BONN_CHANNELS, each = row * (gsize)views->n;
    const gsize n_texels = (gsize)header->width * (gsize)header->height;
    const gsize from = (gsize)block * READ_BLOCK;
    GError *failed = NULL;
    for (gsize texel = from; !failed && texel < MIN(from + READ_BLOCK, n_texels); texel++) {
        const gint32 stored = file->index.of_texel[texel];
        if (stored < 0)
            continue;
        const gsize chunk = (gsize)stored / file->per_chunk;
        const gsize at = file->chunks_at + (chunk + 1) * sizeof(guint32) +
                         (gsize)stored * abrdf_bytes(header) +
                         (gsize)views->first * row * sizeof(guint16);
        struct bonn_bytes bytes = {file->fd, G_MAXSIZE, at, file->path};
        bonn_take(&bytes, each * sizeof(guint16), "chunk", views->halves + texel * each, &failed);
    }
    g_mutex_lock(&views->lock);
    if (!views->failed)
        views->failed = g_steal_pointer(&failed);
    g_mutex_unlock(&views->lock);
    g_clear_error(&failed);
}

void bonn_views_free(BonnViews *views) {
    if (!views)
        return;
    g_mutex_clear(&views->lock);
    g_clear_error(&views->failed);
    g_free(views->halves);
    g_free(views);
}

BonnViews *bonn_views_read(const BonnFile *file, int first, int n, int n_threads, GError **error) {
    const struct bonn_header *header = &file->header;
    const gsize texels = (gsize)header->width * (gsize)header->height;
    g_return_val_if_fail(header->kind == BONN_BDI || header->kind == BONN_BDI_SPARSE, NULL);
    g_return_val_if_fail(first >= 0 && n > 0 && first + n <= header->n_views, NULL);
    g_autoptr(BonnViews) views = g_new0(BonnViews, 1);
    views->file = file;
    views->first = first;
    views->n = n;
    g_mutex_init(&views->lock);
    views->halves = g_try_new(guint16, texels * (gsize)n * (gsize)header->n_lights * BONN_CHANNELS);
    if (!views->halves) {
        g_set_error(error, BONN_ERROR, BONN_ERROR_IO,
                    "%s: there is no memory for %d of its views; close other programs, or import "
                    "fewer texels",
                    file->path, n);
        return NULL;
    }
    work_for_each(n_threads, (int)((texels + READ_BLOCK - 1) / READ_BLOCK), read_block, views);
    if (views->failed) {
        g_propagate_error(error, g_steal_pointer(&views->failed));
        return NULL;
    }
    return g_steal_pointer(&views);
}

int bonn_views_picture(const BonnViews *views, int view, int light, float *ret_rgb) {
    const BonnFile *file = views->file;
    const struct bonn_header *header = &file->header;
    const gsize n_texels = (gsize)header->width * (gsize)header->height;
    const gsize row = (gsize)header->n_lights * BONN_CHANNELS, each = row * (gsize)views->n;
    const gsize at = (gsize)(view - views->first) * row + (gsize)light * BONN_CHANNELS;
    int holes = 0;
    for (gsize texel = 0; texel < n_texels; texel++) {
        float channels[BONN_CHANNELS] = {NAN, NAN, NAN};
        if (file->index.of_texel[texel] >= 0)
            exr_half_to_floats(channels, views->halves + texel * each + at, BONN_CHANNELS);
        holes += store(file, channels, 1, ret_rgb + texel * BONN_CHANNELS);
    }
    return holes;
}
