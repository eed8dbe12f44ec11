/* Writes a BDI view by view. Each view is written to its place in the ABRDF of every texel, so that
 * no transposed copy of the BTF is needed. */
#include "bonn_private.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <unistd.h>

#include "base/new_file.h"
#include "base/work.h"
#include "exr/exr_half.h"

#define CHUNK_BYTES ((gsize)64 << 20) /* maximum size of a chunk of several lines */

struct output {
    char *path;
    struct new_file file; /* file.name is NULL before the file is begun and after it is finished */
};

struct BonnWriter {
    struct output output;
    int n_views, n_lights, n_texels;
    struct bonn_index index;
    gsize per_chunk, chunks_at;
};

static gboolean fail_errno(const char *path, GError **error) {
    const int saved = errno;
    g_set_error(error, BONN_ERROR,
                saved == ENOSPC || saved == EDQUOT ? BONN_ERROR_FULL : BONN_ERROR_IO,
                "%s: the file cannot be written: %s; free some space, or write to another folder",
                path, g_strerror(saved));
    return FALSE;
}

static gboolean open_output(struct output *output, const char *path, GError **error) {
    g_autofree char *folder = g_path_get_dirname(path), *name = g_path_get_basename(path);
    output->path = g_strdup(path);
    return new_file_begin(&output->file, folder, name) || fail_errno(path, error);
}

static void clear_output(struct output *output) {
    if (output->file.name)
        new_file_abandon(&output->file);
    g_free(output->path);
}

static gboolean put(const struct output *output, const void *data, gsize n, gsize at,
                    GError **error) {
    const guint8 *from = data;
    while (n > 0) {
        const gssize done = pwrite(output->file.fd, from, n, (off_t)at);
        if (done < 0 && errno == EINTR)
            continue;
        if (done <= 0)
            return fail_errno(output->path, error);
        from += done, at += (gsize)done, n -= (gsize)done;
    }
    return TRUE;
}

static gboolean finish_output(struct output *output, GError **error) {
    return new_file_commit(&output->file, TRUE) || fail_errno(output->path, error);
}

static gsize abrdf_bytes(const BonnWriter *writer) {
    return (gsize)writer->n_views * (gsize)writer->n_lights * BONN_CHANNELS * sizeof(guint16);
}

static gboolean put_front(BonnWriter *writer, const struct bonn_header *header, const guint8 *mask,
                          guint32 lines, GError **error) {
    g_autoptr(GByteArray) front = g_byte_array_new();
    const guint8 compression = header->kind == BONN_BDI_SPARSE ? 2 : 0;
    bonn_put_header(front, header);
    bytes_put_u32(front, lines);
    g_byte_array_append(front, &compression, 1);
    for (int i = 0; i < writer->n_texels; i++) {
        const guint8 there = !mask || mask[i];
        g_byte_array_append(front, &there, 1);
    }
    bytes_put_u32(front, 0);
    writer->chunks_at = front->len;
    return put(&writer->output, front->data, front->len, 0, error);
}

/* Writes the lengths of all chunks and reserves their space, so that a full disk is detected
 * immediately. */
static gboolean put_chunks(BonnWriter *writer, GError **error) {
    const gsize each = abrdf_bytes(writer), stored = (gsize)writer->index.n_stored;
    const gsize n_chunks = (stored + writer->per_chunk - 1) / writer->per_chunk;
    const gsize size = writer->chunks_at + n_chunks * sizeof(guint32) + stored * each;
    if (!new_file_reserve(&writer->output.file, size))
        return fail_errno(writer->output.path, error);
    for (gsize i = 0; i < n_chunks; i++) {
        const gsize n = MIN(writer->per_chunk, stored - i * writer->per_chunk);
        const guint32 bytes = GUINT32_TO_LE((guint32)(n * each));
        if (!put(&writer->output, &bytes, sizeof bytes,
                 writer->chunks_at + i * (sizeof bytes + writer->per_chunk * each), error))
            return FALSE;
    }
    return TRUE;
}

BonnWriter *bonn_writer_new(const char *path, const struct bonn_header *header, const guint8 *mask,
                            GError **error) {
    g_return_val_if_fail(header->kind == BONN_BDI || header->kind == BONN_BDI_SPARSE, NULL);
    g_autoptr(BonnWriter) writer = g_new0(BonnWriter, 1);
    writer->n_views = header->n_views;
    writer->n_lights = header->n_lights;
    writer->n_texels = header->width * header->height;
    writer->index.of_texel = g_new(gint32, writer->n_texels);
    for (int i = 0; i < writer->n_texels; i++)
        writer->index.of_texel[i] =
            header->kind == BONN_BDI_SPARSE && mask && !mask[i] ? -1 : writer->index.n_stored++;
    if (!open_output(&writer->output, path, error))
        return NULL;
    const gsize line = (gsize)header->width * abrdf_bytes(writer);
    if (line > G_MAXUINT32) {
        g_set_error(error, BONN_ERROR, BONN_ERROR_UNSUPPORTED,
                    "%s: a line of %d texels with %d views and %d lights is longer than 4 GiB, "
                    "which this format cannot hold; export fewer texels, views or lights",
                    path, header->width, header->n_views, header->n_lights);
        return NULL;
    }
    const guint32 lines = (guint32)CLAMP(CHUNK_BYTES / line, 1, (gsize)header->height);
    writer->per_chunk = (gsize)lines * (gsize)header->width;
    return put_front(writer, header, mask, lines, error) && put_chunks(writer, error)
               ? g_steal_pointer(&writer)
               : NULL;
}

void bonn_writer_free(BonnWriter *writer) {
    if (!writer)
        return;
    clear_output(&writer->output);
    g_free(writer->index.of_texel);
    g_free(writer);
}

gboolean bonn_writer_view(BonnWriter *writer, int view, const float *rgb, GError **error) {
    const gsize n_lights = (gsize)writer->n_lights, n = n_lights * BONN_CHANNELS;
    const gsize n_texels = (gsize)writer->n_texels;
    g_autofree float *abrdf = g_new(float, n);
    g_autofree guint16 *halves = g_new(guint16, n);
    g_return_val_if_fail(view >= 0 && view < writer->n_views, FALSE);
    for (gsize texel = 0; texel < n_texels; texel++) {
        const gint32 stored = writer->index.of_texel[texel];
        if (stored < 0)
            continue;
        for (gsize light = 0; light < n_lights; light++)
            memcpy(abrdf + light * BONN_CHANNELS, rgb + (light * n_texels + texel) * BONN_CHANNELS,
                   sizeof *rgb * BONN_CHANNELS);
        exr_half_from_floats(halves, abrdf, n);
        const gsize chunk = (gsize)stored / writer->per_chunk;
        if (!put(&writer->output, halves, n * sizeof *halves,
                 writer->chunks_at + (chunk + 1) * sizeof(guint32) +
                     (gsize)stored * abrdf_bytes(writer) + (gsize)view * n * sizeof *halves,
                 error))
            return FALSE;
    }
    return TRUE;
}

/* Some views that are written. */
struct written {
    const BonnWriter *writer;
    int first, n;
    const guint16 *halves;
    GMutex lock; /* protects failed */
    GError *failed;
};

#define WRITE_BLOCK 1024 /* number of texels that a thread writes at a time */

static void write_block(int block, gpointer data) {
    struct written *written = data;
    const BonnWriter *writer = written->writer;
    const gsize row = (gsize)writer->n_lights * BONN_CHANNELS, each = row * (gsize)written->n;
    const gsize from = (gsize)block * WRITE_BLOCK;
    GError *failed = NULL;
    for (gsize texel = from; !failed && texel < MIN(from + WRITE_BLOCK, (gsize)writer->n_texels);
         texel++) {
        const gint32 stored = writer->index.of_texel[texel];
        if (stored < 0)
            continue;
        const gsize chunk = (gsize)stored / writer->per_chunk;
        put(&writer->output, written->halves + texel * each, each * sizeof(guint16),
            writer->chunks_at + (chunk + 1) * sizeof(guint32) +
                (gsize)stored * abrdf_bytes(writer) + (gsize)written->first * row * sizeof(guint16),
            &failed);
    }
    g_mutex_lock(&written->lock);
    if (!written->failed)
        written->failed = g_steal_pointer(&failed);
    g_mutex_unlock(&written->lock);
    g_clear_error(&failed);
}

gboolean bonn_writer_views(BonnWriter *writer, int first, int n, const guint16 *halves,
                           int n_threads, GError **error) {
    struct written written = {.writer = writer, .first = first, .n = n, .halves = halves};
    g_return_val_if_fail(first >= 0 && n > 0 && first + n <= writer->n_views, FALSE);
    g_mutex_init(&written.lock);
    work_for_each(n_threads, (writer->n_texels + WRITE_BLOCK - 1) / WRITE_BLOCK, write_block,
                  &written);
    g_mutex_clear(&written.lock);
    if (written.failed)
        g_propagate_error(error, written.failed);
    return written.failed == NULL;
}

gboolean bonn_writer_finish(BonnWriter *writer, GError **error) {
    return finish_output(&writer->output, error);
}

static gboolean put_halves(const struct output *output, const float *values, gsize n, gsize *at,
                           GError **error) {
    guint16 halves[4096];
    for (gsize i = 0; i < n; i += G_N_ELEMENTS(halves)) {
        const gsize some = MIN(G_N_ELEMENTS(halves), n - i);
        exr_half_from_floats(halves, values + i, some);
        if (!put(output, halves, some * sizeof *halves, *at, error))
            return FALSE;
        *at += some * sizeof *halves;
    }
    return TRUE;
}

static gboolean put_matrix(const struct output *output, const struct bonn_factors *factors,
                           gsize *at, GError **error) {
    g_autoptr(GByteArray) front = g_byte_array_new();
    const guint8 scalar = sizeof(guint16);
    const gsize k = (gsize)factors->n_components;
    g_byte_array_append(front, &scalar, 1);
    bytes_put_u32(front, (guint32)factors->n_components);
    bytes_put_u32(front, (guint32)factors->n_rows);
    bytes_put_u32(front, (guint32)factors->n_columns);
    if (!put(output, front->data, front->len, *at, error))
        return FALSE;
    *at += front->len;
    return put_halves(output, factors->s, k, at, error) &&
           put_halves(output, factors->u, (gsize)factors->n_rows * k, at, error) &&
           put_halves(output, factors->sv, (gsize)factors->n_columns * k, at, error);
}

gboolean bonn_write_factors(const char *path, const struct bonn_header *header,
                            const struct bonn_factors *factors, GError **error) {
    g_return_val_if_fail(header->kind == BONN_FMF || header->kind == BONN_DFMF, FALSE);
    const int n = header->kind == BONN_DFMF ? BONN_CHANNELS : 1;
    int most = 0;
    for (int i = 0; i < n; i++)
        most = MAX(most, factors[i].n_components);
    g_autoptr(GByteArray) front = g_byte_array_new();
    bonn_put_header(front, header);
    bytes_put_u32(front, 0); /* number of rotations */
    if (header->kind == BONN_FMF) {
        const guint8 version = 2;
        g_byte_array_append(front, &version, 1);
        for (int i = 0; i < 3; i++)
            bytes_put_u32(front, 0); /* no transformation of the range; no height map */
    }
    bytes_put_u32(front, (guint32)most);
    if (header->kind == BONN_DFMF) {
        for (int i = 0; i < 4; i++)
            bytes_put_u32(front, 0); /* untransformed colours; their mean */
        for (int i = 0; i < 9; i++)
            bytes_put_float(front, i % 4 == 0); /* their matrix: identity */
    }
    struct output output = {0};
    gsize at = front->len;
    gboolean ok =
        open_output(&output, path, error) && put(&output, front->data, front->len, 0, error);
    for (int i = 0; ok && i < n; i++)
        ok = put_matrix(&output, &factors[i], &at, error);
    ok = ok && finish_output(&output, error);
    clear_output(&output);
    return ok;
}
