/* Writes EXR files through OpenEXRCore, which compresses chunks and writes headers. Packing planes
 * of floats into chunks is done here. */
#include "exr.h"
#include "exr_half.h"
#include "exr_private.h"

#include "base/error_details.h"
#include "base/input_file.h"
#include "base/new_file.h"

#include <errno.h>
#include <openexr.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* The file to which OpenEXRCore writes. Small writes are collected in `pending`. */
struct sink {
    int fd;
    int error; /* errno of the first failed write, otherwise 0 */
    guint64 start;
    GByteArray *pending;
    char message[256]; /* last error message of the library */
};

#define SINK_SIZE (1 << 20)

static void flush(struct sink *sink) {
    gsize done = 0;

    while (!sink->error && done < sink->pending->len) {
        gssize n = pwrite(sink->fd, sink->pending->data + done, sink->pending->len - done,
                          (off_t)(sink->start + done));

        if (n > 0)
            done += (gsize)n;
        else if (n == 0 || errno != EINTR)
            sink->error = n == 0 ? EIO : errno;
    }
    sink->start += sink->pending->len;
    g_byte_array_set_size(sink->pending, 0);
}

static int64_t sink_write(exr_const_context_t context, void *data, const void *buffer,
                          uint64_t size, uint64_t offset, exr_stream_error_func_ptr_t error_cb) {
    struct sink *sink = data;

    if (size > G_MAXINT)
        return -1;
    if (offset != sink->start + sink->pending->len || sink->pending->len + size > SINK_SIZE) {
        flush(sink);
        sink->start = offset;
    }
    g_byte_array_append(sink->pending, buffer, (guint)size);
    return sink->error ? -1 : (int64_t)size;
}

static void sink_message(exr_const_context_t context, exr_result_t code, const char *message) {
    void *data = NULL;

    if (exr_get_user_data(context, &data) == EXR_ERR_SUCCESS && data)
        g_strlcpy(((struct sink *)data)->message, message, sizeof((struct sink *)0)->message);
}

/* The content of the file to write. */
struct content {
    const struct exr_file *file;
    enum exr_compression compression;
    ExrFill fill; /* NULL if all planes are in memory */
    gpointer data;
    GError *failed; /* the error that fill set, or NULL */
    struct exr_scratch scratch;
};

static gboolean refuse(GError **error, const char *path, const struct exr_part *part,
                       const char *what, const char *value) {
    g_set_error(error, EXR_ERROR, EXR_ERROR_FORMAT, "%s: part \"%s\": %s%s%s", path,
                part->name ? part->name : "", what, value ? " " : "", value ? value : "");
    return FALSE;
}

static gboolean check_part(const char *path, const struct exr_part *part, gboolean filled,
                           GError **error) {
    if (!part->name || !*part->name || strlen(part->name) > 255)
        return refuse(error, path, part, "its name must have 1 to 255 bytes", NULL);
    if (part->width < 1 || part->height < 1 ||
        (gint64)part->width * part->height > EXR_MAX_PIXELS) {
        g_set_error(
            error, EXR_ERROR, EXR_ERROR_TOO_LARGE,
            "%s: part \"%s\" has %d×%d pixels, but must have 1 to %d in all; use fewer texels",
            path, part->name, part->width, part->height, EXR_MAX_PIXELS);
        return FALSE;
    }
    if (part->n_channels < 1 || part->n_channels > EXR_MAX_CHANNELS)
        return refuse(error, path, part, "it must have 1 to 64 channels", NULL);
    for (int c = 0; c < part->n_channels; c++) {
        if (!*part->channels[c] || strlen(part->channels[c]) > 255)
            return refuse(error, path, part, "the name of a channel must have 1 to 255 bytes",
                          NULL);
        if (c && strcmp(part->channels[c - 1], part->channels[c]) >= 0)
            return refuse(
                error, path, part,
                "channels must have different names in alphabetical order; out of order is",
                part->channels[c]);
        if (!part->planes || (!part->planes[c] && !filled))
            return refuse(error, path, part, "there are no pixels for channel", part->channels[c]);
    }
    for (guint i = 0; i < part->attributes->len; i++) {
        const struct exr_attribute *attribute = g_ptr_array_index(part->attributes, i);
        const char *name = attribute->name;

        if (!*name || strlen(name) > 255)
            return refuse(error, path, part,
                          "the name of an attribute must have 1 to 255 bytes:", name);
        if (exr_is_standard_attribute(name))
            return refuse(error, path, part, "EXR has its own meaning for the attribute", name);
        if (attribute->kind == EXR_KIND_STRING && !attribute->string)
            return refuse(error, path, part, "there is no value for the attribute", name);
    }
    return TRUE;
}

/* Checks names, sizes, channels and attributes of all parts, before the file is created. */
static gboolean check(const char *path, const struct content *content, GError **error) {
    const struct exr_file *file = content->file;
    g_autoptr(GHashTable) names = g_hash_table_new(g_str_hash, g_str_equal);

    if (file->parts->len == 0) {
        g_set_error(error, EXR_ERROR, EXR_ERROR_FORMAT, "%s: a file needs at least one part", path);
        return FALSE;
    }
    for (guint i = 0; i < file->parts->len; i++) {
        const struct exr_part *part = g_ptr_array_index(file->parts, i);

        if (!check_part(path, part, content->fill != NULL, error))
            return FALSE;
        if (!g_hash_table_add(names, part->name))
            return refuse(error, path, part, "another part has the same name", NULL);
    }
    return TRUE;
}

static exr_result_t declare_attribute(exr_context_t context, int index,
                                      const struct exr_attribute *attribute) {
    exr_attr_v3d_t v = {.x = attribute->v[0], .y = attribute->v[1], .z = attribute->v[2]};

    switch (attribute->kind) {
    case EXR_KIND_STRING:
        return exr_attr_set_string(context, index, attribute->name, attribute->string);
    case EXR_KIND_INT:
        return exr_attr_set_int(context, index, attribute->name, attribute->integer);
    case EXR_KIND_DOUBLE:
        return exr_attr_set_double(context, index, attribute->name, attribute->v[0]);
    case EXR_KIND_V3D:
        return exr_attr_set_v3d(context, index, attribute->name, &v);
    }
    return EXR_ERR_INVALID_ATTR;
}

/* Declares a part with its channels and attributes. display is the display window of all parts,
 * which must be the same in a multi-part file. */
static exr_result_t declare_part(exr_context_t context, const struct exr_part *part,
                                 const exr_attr_box2i_t *display, exr_compression_t compression) {
    exr_attr_box2i_t window = {.max = {.x = part->width - 1, .y = part->height - 1}};
    exr_attr_v2f_t centre = {.x = 0, .y = 0};
    exr_pixel_type_t type = part->type == EXR_HALF ? EXR_PIXEL_HALF : EXR_PIXEL_FLOAT;
    int index;
    exr_result_t rc = exr_add_part(context, part->name, EXR_STORAGE_SCANLINE, &index);

    if (rc == EXR_ERR_SUCCESS)
        rc = exr_initialize_required_attr(context, index, display, &window, 1.f, &centre, 1.f,
                                          EXR_LINEORDER_INCREASING_Y, compression);
    for (int c = 0; rc == EXR_ERR_SUCCESS && c < part->n_channels; c++)
        rc = exr_add_channel(context, index, part->channels[c], type, EXR_PERCEPTUALLY_LOGARITHMIC,
                             1, 1);
    for (guint i = 0; rc == EXR_ERR_SUCCESS && i < part->attributes->len; i++)
        rc = declare_attribute(context, index, g_ptr_array_index(part->attributes, i));
    return rc;
}

static exr_result_t declare(exr_context_t context, const struct exr_file *file,
                            enum exr_compression compression) {
    static const exr_compression_t methods[] = {
        [EXR_NONE] = EXR_COMPRESSION_NONE,
        [EXR_ZIP] = EXR_COMPRESSION_ZIP,
        [EXR_PIZ] = EXR_COMPRESSION_PIZ,
    };
    exr_attr_box2i_t display = {0};
    exr_result_t rc = EXR_ERR_SUCCESS;
    gsize longest = 0; /* length of the longest name of an attribute or a channel */

    for (guint i = 0; i < file->parts->len; i++) {
        const struct exr_part *part = g_ptr_array_index(file->parts, i);

        display.max.x = MAX(display.max.x, part->width - 1);
        display.max.y = MAX(display.max.y, part->height - 1);
        for (guint a = 0; a < part->attributes->len; a++) {
            const struct exr_attribute *attribute = g_ptr_array_index(part->attributes, a);
            longest = MAX(longest, strlen(attribute->name));
        }
        for (int c = 0; c < part->n_channels; c++)
            longest = MAX(longest, strlen(part->channels[c]));
    }
    if (longest > 31)
        rc = exr_set_longname_support(context, 1);
    for (guint i = 0; rc == EXR_ERR_SUCCESS && i < file->parts->len; i++)
        rc = declare_part(context, g_ptr_array_index(file->parts, i), &display,
                          methods[compression]);
    return rc == EXR_ERR_SUCCESS ? exr_write_header(context) : rc;
}

struct encoding {
    const struct exr_part *part;
    /* the library's function for this method */
    exr_result_t (*compress)(exr_encode_pipeline_t *encode);
};

/* Compresses a chunk. If the compressed chunk has exactly the size of the uncompressed one, a
 * reader cannot tell which of them the file has. OpenEXRCore 3.1 writes the compressed chunk, but
 * reads it as an uncompressed one. Therefore this function replaces the compressed bytes by the
 * uncompressed bytes. */
static exr_result_t exr_write_compress(exr_encode_pipeline_t *encode) {
    const struct encoding *encoding = encode->encoding_user_data;
    const exr_result_t rc = encoding->compress(encode);

    if (rc == EXR_ERR_SUCCESS && encode->compressed_bytes == encode->packed_bytes &&
        encode->compressed_buffer != encode->packed_buffer)
        memcpy(encode->compressed_buffer, encode->packed_buffer, encode->packed_bytes);
    return rc;
}

/* Packs the lines of all channels one after the other, in the file's byte order. */
static exr_result_t pack(exr_encode_pipeline_t *encode) {
    const struct encoding *encoding = encode->encoding_user_data;
    const struct exr_part *part = encoding->part;
    guint8 *to = encode->packed_buffer;
    gsize width = (gsize)part->width;

    for (int y = encode->chunk.start_y; y < encode->chunk.start_y + encode->chunk.height; y++) {
        for (int c = 0; c < part->n_channels; c++) {
            const float *line = part->planes[c] + (gsize)y * width;

            if (part->type == EXR_HALF) {
                exr_half_from_floats((guint16 *)(gpointer)to, line, width);
                to += width * sizeof(guint16);
                continue;
            }
            memcpy(to, line, width * sizeof(float));
            for (gsize x = 0; G_BYTE_ORDER != G_LITTLE_ENDIAN && x < width; x++)
                ((guint32 *)(gpointer)to)[x] = GUINT32_TO_LE(((guint32 *)(gpointer)to)[x]);
            to += width * sizeof(float);
        }
    }
    encode->packed_bytes = (guint64)(to - (guint8 *)encode->packed_buffer);
    return EXR_ERR_SUCCESS;
}

static exr_result_t write_part(exr_context_t context, int index, struct exr_part *part,
                               struct content *content) {
    exr_encode_pipeline_t encode = EXR_ENCODE_PIPELINE_INITIALIZER;
    struct encoding encoding = {.part = part};
    exr_chunk_info_t chunk;
    int32_t step;
    exr_result_t rc = exr_get_scanlines_per_chunk(context, index, &step);

    for (int y = 0; rc == EXR_ERR_SUCCESS && y < part->height; y += step) {
        rc = exr_write_scanline_chunk_info(context, index, y, &chunk);
        if (rc == EXR_ERR_SUCCESS)
            rc = y == 0 ? exr_encoding_initialize(context, index, &chunk, &encode)
                        : exr_encoding_update(context, index, &chunk, &encode);
        if (rc != EXR_ERR_SUCCESS)
            break;
        if (y == 0)
            exr_scratch_swap(&content->scratch, &encode.scratch_buffer_1,
                             &encode.scratch_alloc_size_1, &encode.scratch_buffer_2,
                             &encode.scratch_alloc_size_2);
        /* The library requires a layout of the channels in memory, although pack() does not use
         * it. */
        for (int c = 0; c < encode.channel_count; c++) {
            exr_coding_channel_info_t *channel = &encode.channels[c];

            channel->user_bytes_per_element = sizeof(float);
            channel->user_data_type = EXR_PIXEL_FLOAT;
            channel->user_pixel_stride = sizeof(float);
            channel->user_line_stride = (int32_t)((gsize)part->width * sizeof(float));
            channel->encode_from_ptr = (const guint8 *)part->planes[c];
        }
        if (y == 0) {
            rc = exr_encoding_choose_default_routines(context, index, &encode);
            encoding.compress = encode.compress_fn;
        }
        if (encoding.compress)
            encode.compress_fn = exr_write_compress;
        encode.convert_and_pack_fn = pack;
        encode.encoding_user_data = &encoding;
        if (rc == EXR_ERR_SUCCESS)
            rc = exr_encoding_run(context, index, &encode);
    }
    if (encode.context)
        exr_scratch_swap(&content->scratch, &encode.scratch_buffer_1, &encode.scratch_alloc_size_1,
                         &encode.scratch_buffer_2, &encode.scratch_alloc_size_2);
    exr_encoding_destroy(context, &encode);
    return rc;
}

static exr_result_t write_filled(exr_context_t context, int index, struct content *content) {
    struct exr_part *part = g_ptr_array_index(content->file->parts, (guint)index);
    exr_result_t rc = EXR_ERR_SUCCESS;

    if (part->planes[0])
        return write_part(context, index, part, content);
    for (int c = 0; c < part->n_channels && rc == EXR_ERR_SUCCESS; c++) {
        part->planes[c] = g_try_malloc0_n((gsize)part->width * (gsize)part->height, sizeof(float));
        rc = part->planes[c] ? EXR_ERR_SUCCESS : EXR_ERR_OUT_OF_MEMORY;
    }
    if (rc == EXR_ERR_SUCCESS)
        rc = content->fill && content->fill(part, content->data, &content->failed)
                 ? write_part(context, index, part, content)
                 : EXR_ERR_UNKNOWN;
    exr_part_drop_planes(part);
    return rc;
}

static exr_result_t write_file(const char *path, struct sink *sink, struct content *content) {
    const struct exr_file *file = content->file;
    exr_context_initializer_t how = EXR_DEFAULT_CONTEXT_INITIALIZER;
    exr_context_t context = NULL;
    exr_result_t rc, finished;

    how.user_data = sink;
    how.write_fn = sink_write;
    how.error_handler_fn = sink_message;
    rc = exr_start_write(&context, path, EXR_WRITE_FILE_DIRECTLY, &how);
    if (rc != EXR_ERR_SUCCESS)
        return rc;
    rc = declare(context, file, content->compression);
    for (guint i = 0; rc == EXR_ERR_SUCCESS && i < file->parts->len; i++)
        rc = write_filled(context, (int)i, content);
    finished = exr_finish(&context);
    if (rc == EXR_ERR_SUCCESS)
        rc = finished;
    exr_scratch_clear(&content->scratch);
    flush(sink);
    return rc;
}

static gboolean fail(GError **error, const char *path, int errno_value) {
    const gboolean full = errno_value == ENOSPC || errno_value == EDQUOT;
    const gboolean link = errno_value == ENOTDIR || errno_value == ELOOP;

    g_propagate_error(
        error, error_details_new(
                   EXR_ERROR, full || errno_value == EFBIG ? EXR_ERROR_FULL : EXR_ERROR_IO, NULL,
                   "%s: cannot be written: %s%s%s", path, g_strerror(errno_value),
                   full ? ERROR_ADVICE "free some space and go on" : "",
                   link ? "; the file's folder must be a folder, and not a symbolic link or a file"
                   : full ? ""
                          : ERROR_ADVICE "check the access rights of its folder, and the disk"));
    return FALSE;
}

static gboolean write_to(struct new_file *to, const char *path, struct content *content,
                         GError **error) {
    struct sink sink = {.fd = to->fd, .pending = g_byte_array_sized_new(SINK_SIZE)};
    const exr_result_t rc = write_file(path, &sink, content);

    g_byte_array_unref(sink.pending);
    if (content->failed) {
        g_propagate_error(error, g_steal_pointer(&content->failed));
        return FALSE;
    }
    if (sink.error)
        return fail(error, path, sink.error);
    if (rc != EXR_ERR_SUCCESS)
        g_set_error(error, EXR_ERROR, EXR_ERROR_IO,
                    "%s: cannot be written: %s; check the disk and the free memory", path,
                    *sink.message ? sink.message : exr_get_default_error_message(rc));
    return rc == EXR_ERR_SUCCESS;
}

#define MAX_LINES 32 /* maximum number of lines in a chunk */

/* Returns whether exr_read() will accept the file. Returns TRUE too if the size of the file cannot
 * be found. exr_read() limits the memory according to the size of the file. Uniform pixels may
 * compress so well that their memory exceeds this limit. */
static gboolean may_be_read(int fd, const struct exr_file *file) {
    guint64 planes = 0, chunk = 0;
    struct stat status;

    for (guint i = 0; i < file->parts->len; i++) {
        const struct exr_part *part = g_ptr_array_index(file->parts, i);

        planes += exr_plane_bytes(part);
        chunk = MAX(chunk, exr_chunk_bytes(part, MAX_LINES));
    }
    return fstat(fd, &status) != 0 || planes + chunk <= input_file_memory((guint64)status.st_size);
}

static gboolean exr_write_content(const char *directory, const char *relative,
                                  struct content *content, gboolean sync, GError **error) {
    g_autofree char *path = g_build_filename(directory, relative, NULL);
    struct new_file to;

    g_return_val_if_fail(content->compression <= EXR_PIZ, FALSE);
    if (!check(path, content, error))
        return FALSE;
    if (!new_file_begin(&to, directory, relative))
        return fail(error, path, errno);
    gboolean ok = write_to(&to, path, content, error);
    if (ok && content->compression != EXR_NONE && !may_be_read(to.fd, content->file)) {
        content->compression = EXR_NONE;
        ok = ftruncate(to.fd, 0) == 0 || fail(error, path, errno);
        ok = ok && write_to(&to, path, content, error);
    }
    if (ok)
        return new_file_commit(&to, sync) || fail(error, path, errno);
    new_file_abandon(&to);
    return FALSE;
}

gboolean exr_write_below(const char *directory, const char *relative, const struct exr_file *file,
                         enum exr_compression compression, gboolean sync, GError **error) {
    struct content content = {.file = file, .compression = compression};

    return exr_write_content(directory, relative, &content, sync, error);
}

gboolean exr_write_filled(const char *path, const struct exr_file *file,
                          enum exr_compression compression, gboolean sync, ExrFill fill,
                          gpointer data, GError **error) {
    g_autofree char *folder = g_path_get_dirname(path), *name = g_path_get_basename(path);
    struct content content = {file, compression, fill, data, NULL};

    return exr_write_content(folder, name, &content, sync, error);
}

gboolean exr_write(const char *path, const struct exr_file *file, enum exr_compression compression,
                   gboolean sync, GError **error) {
    return exr_write_filled(path, file, compression, sync, NULL, NULL, error);
}
