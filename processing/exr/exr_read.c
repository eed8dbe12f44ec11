/* Reads EXR files through OpenEXRCore, which parses headers and decompresses chunks. Unpacking to
 * planes of floats is done here, with separate checks, because headers may be hostile. */
#include "exr.h"
#include "exr_half.h"
#include "exr_private.h"

#include "base/error_details.h"
#include "base/input_file.h"
#include "base/work.h"

#include <errno.h>
#include <math.h>
#include <openexr.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* Maximum ratio of the bytes of the uncompressed pixels to those of the file. Deflate compresses by
 * at most 1032, run lengths and PIZ by less. A file that claims more is refused before memory is
 * allocated. */
#define MAX_EXPANSION 1100

#define WINDOW (1 << 16) /* bytes that are read from a file at a time */

static _Thread_local struct {
    ExrWatch watch;
    gpointer data;
} watcher;

/* Bytes of a file, from `at` on. */
struct window {
    guint8 *bytes;
    guint64 at;
    gsize n;
};

/* Each thread of exr_reader_next() has its own window, because threads that read different parts of
 * a file would fill a common window in turns. In other threads this is NULL, and the window of the
 * source is used. */
static _Thread_local struct window *own_window;

struct source {
    const char *path;
    int fd;
    gint64 size;
    guint64 memory; /* bytes of memory that the parts not yet read may take */
    exr_context_t context;
    char message[256]; /* last error message of the library */
    gint64 reached;    /* the farthest offset that was read */
    gboolean cancelled, failed;
    gboolean placed; /* TRUE for exr_read_picture(): the part gets the size of its display window */
    struct exr_scratch scratch;
    struct window window;
    GMutex lock; /* protects message, reached, cancelled and failed */
};

void exr_watch(ExrWatch watch, gpointer data) {
    watcher.watch = watch;
    watcher.data = data;
}

G_GNUC_PRINTF(4, 5)
static gboolean fail(const struct source *source, enum exr_error code, GError **error,
                     const char *format, ...) {
    va_list list;
    va_start(list, format);
    g_autofree char *what = g_strdup_vprintf(format, list);
    va_end(list);
    g_propagate_error(error,
                      error_details_new(EXR_ERROR, code, NULL, "%s: %s", source->path, what));
    return FALSE;
}

static gboolean fail_library(const struct source *source, exr_result_t rc, GError **error) {
    g_autofree char *what = g_utf8_make_valid(
        *source->message ? source->message : exr_get_default_error_message(rc), -1);

    if (source->cancelled)
        return fail(source, EXR_ERROR_CANCELLED, error, "cancelled");
    char begins[2] = "";
    if (pread(source->fd, begins, 1, 0) == 1 && (*begins == '[' || *begins == '#'))
        return fail(source, EXR_ERROR_FORMAT, error,
                    "not an EXR file, but probably a text; “mesorig calibrate show” prints "
                    "calibrations");
    if (rc == EXR_ERR_OUT_OF_MEMORY)
        return fail(source, EXR_ERROR_TOO_LARGE, error,
                    "there is not enough memory to read the file; close other programs, or use a "
                    "computer with more memory");
    if (source->failed)
        return fail(
            source, EXR_ERROR_IO, error,
            "cannot be read: the disk or the network failed; copy the file elsewhere and try "
            "again");
    return fail(source, EXR_ERROR_FORMAT, error,
                "not a valid EXR file: %s; copy the file again or make it again", what);
}

/* Fills the window with bytes of the file, from an offset on. Returns FALSE at the end of the file
 * and on errors. */
static gboolean fill_window(struct source *source, struct window *window, guint64 offset) {
    gssize n;

    if (!window->bytes)
        window->bytes = g_malloc(WINDOW);
    do
        n = pread(source->fd, window->bytes, WINDOW, (off_t)offset);
    while (n < 0 && errno == EINTR);
    if (n < 0) {
        g_mutex_lock(&source->lock);
        source->failed = TRUE;
        g_mutex_unlock(&source->lock);
    }
    window->at = offset;
    window->n = n > 0 ? (gsize)n : 0;
    return n > 0;
}

/* Tells the callback of exr_watch() how far the file was read. Returns FALSE if reading was
 * cancelled. */
static gboolean tell_reached(struct source *source, gint64 end) {
    g_mutex_lock(&source->lock);
    source->reached = MAX(source->reached, MIN(end, source->size));
    if (watcher.watch != NULL && source->size > 0)
        source->cancelled |=
            !watcher.watch((double)source->reached / (double)source->size, watcher.data);
    const gboolean go_on = !source->cancelled;
    g_mutex_unlock(&source->lock);
    return go_on;
}

/* Copies bytes from the window. OpenEXRCore reads a file line by line if it is not compressed, and
 * the window saves most calls of the system. */
static int64_t source_read(exr_const_context_t context, void *data, void *buffer, uint64_t size,
                           uint64_t offset, exr_stream_error_func_ptr_t error_cb) {
    struct source *source = data;
    struct window *window = own_window ? own_window : &source->window;
    gsize done = 0;

    if (offset > G_MAXINT64 || (gint64)offset > source->size)
        return -1;
    /* The library may seek back to a header. The reported progress never decreases. */
    /* A short read is returned instead of −1, because for a negative count OpenEXRCore 3.1 clears
     * memory before its buffer. */
    if (!tell_reached(source, (gint64)(offset + MIN(size, (guint64)source->size))))
        return 0;
    while (done < size) {
        const guint64 at = offset + done;

        if ((at < window->at || at >= window->at + window->n) && !fill_window(source, window, at))
            break;
        const gsize from = (gsize)(at - window->at);
        const gsize n = MIN(size - done, window->n - from);
        memcpy((guint8 *)buffer + done, window->bytes + from, n);
        done += n;
    }
    return (int64_t)done;
}

static int64_t source_size(exr_const_context_t context, void *data) {
    return ((struct source *)data)->size;
}

static void source_message(exr_const_context_t context, exr_result_t code, const char *message) {
    void *data = NULL;

    if (exr_get_user_data(context, &data) != EXR_ERR_SUCCESS || !data)
        return;
    struct source *source = data;
    g_mutex_lock(&source->lock);
    g_strlcpy(source->message, message, sizeof source->message);
    g_mutex_unlock(&source->lock);
}

static void source_close(struct source *source) {
    if (source->context)
        exr_finish(&source->context);
    if (source->fd >= 0)
        close(source->fd);
    exr_scratch_clear(&source->scratch);
    g_free(source->window.bytes);
    g_mutex_clear(&source->lock);
}

/* Opens a file. Only regular files are opened; FIFOs and devices are refused. The library keeps a
 * pointer to source, which must not move until source is closed. */
static gboolean source_open(struct source *source, const char *path, GError **error) {
    exr_context_initializer_t how = EXR_DEFAULT_CONTEXT_INITIALIZER;
    GError *why = NULL;
    guint64 bytes = 0;
    exr_result_t rc;

    *source = (struct source){.path = path};
    g_mutex_init(&source->lock);
    source->fd = input_file_open(path, G_MAXINT64, &bytes, &why);
    if (source->fd < 0) {
        input_file_propagate(why, EXR_ERROR, EXR_ERROR_IO, EXR_ERROR_FORMAT, error);
        return FALSE;
    }
    source->size = (gint64)bytes;
    source->memory = input_file_memory(bytes);
    how.user_data = source;
    how.read_fn = source_read;
    how.size_fn = source_size;
    how.error_handler_fn = source_message;
    how.max_image_width = EXR_MAX_PIXELS;
    how.max_image_height = EXR_MAX_PIXELS;
    how.flags = EXR_CONTEXT_FLAG_DISABLE_CHUNK_RECONSTRUCTION;
    rc = exr_start_read(&source->context, path, &how);
    return rc == EXR_ERR_SUCCESS || fail_library(source, rc, error);
}

/* The data window (pixels that the file contains) and the display window (pixels of the picture) of
 * a part. */
struct windows {
    exr_attr_box2i_t data, display;
};

static gboolean window_size(struct source *source, const struct exr_part *part,
                            const exr_attr_box2i_t *window, const char *which, GError **error) {
    const gint64 width = (gint64)window->max.x - window->min.x + 1;
    const gint64 height = (gint64)window->max.y - window->min.y + 1;
    if (width < 1 || height < 1 || window->max.x == G_MAXINT32 || window->max.y == G_MAXINT32)
        return fail(source, EXR_ERROR_FORMAT, error,
                    "in part \"%s\" the %s window is empty; copy the file again or make it again",
                    part->name, which);
    return (width <= EXR_MAX_PIXELS && height <= EXR_MAX_PIXELS &&
            width * height <= EXR_MAX_PIXELS) ||
           fail(source, EXR_ERROR_TOO_LARGE, error,
                "part \"%s\" has %" G_GINT64_FORMAT "×%" G_GINT64_FORMAT
                " pixels; at most %d can be read. Crop or reduce the picture",
                part->name, width, height, EXR_MAX_PIXELS);
}

static int window_width(const exr_attr_box2i_t *window) {
    return window->max.x - window->min.x + 1;
}

static int window_height(const exr_attr_box2i_t *window) {
    return window->max.y - window->min.y + 1;
}

static gboolean read_size(struct source *source, int index, struct exr_part *part,
                          struct windows *ret, GError **error) {
    *ret = (struct windows){0};
    exr_result_t rc = exr_get_data_window(source->context, index, &ret->data);
    const exr_attr_box2i_t *data = &ret->data, *display = &ret->display;
    ret->display = ret->data;
    if (rc == EXR_ERR_SUCCESS && source->placed)
        rc = exr_get_display_window(source->context, index, &ret->display);
    if (rc != EXR_ERR_SUCCESS)
        return fail_library(source, rc, error);
    if (!window_size(source, part, data, "data", error) ||
        !window_size(source, part, display, "display", error))
        return FALSE;
    const gint64 across =
        (gint64)MIN(data->max.x, display->max.x) - MAX(data->min.x, display->min.x) + 1;
    const gint64 down =
        (gint64)MIN(data->max.y, display->max.y) - MAX(data->min.y, display->min.y) + 1;
    if (across < 1 || down < 1)
        return fail(source, EXR_ERROR_FORMAT, error,
                    "the pixels of part \"%s\" lie outside of its display window; save the picture "
                    "with its data window within the display window",
                    part->name);
    part->width = window_width(display);
    part->height = window_height(display);
    part->left_px = source->placed ? display->min.x : 0;
    part->top_px = source->placed ? display->min.y : 0;
    part->outside = (gint64)part->width * part->height - across * down;
    return TRUE;
}

static gboolean read_channels(struct source *source, int index, struct exr_part *part,
                              GError **error) {
    const exr_attr_chlist_t *list = NULL;
    exr_result_t rc = exr_get_channels(source->context, index, &list);

    if (rc != EXR_ERR_SUCCESS)
        return fail_library(source, rc, error);
    if (list->num_channels < 1 || list->num_channels > EXR_MAX_CHANNELS)
        return fail(source, EXR_ERROR_FORMAT, error,
                    "part \"%s\" has %d channels; only 1 to %d can be read. Save the file with "
                    "fewer channels",
                    part->name, list->num_channels, EXR_MAX_CHANNELS);
    part->channels = g_new0(char *, list->num_channels + 1);
    part->planes = g_new0(float *, list->num_channels + 1);
    part->type = EXR_HALF;
    for (int c = 0; c < list->num_channels; c++) {
        const exr_attr_chlist_entry_t *entry = &list->entries[c];

        part->channels[part->n_channels++] = g_utf8_make_valid(entry->name.str, -1);
        if (entry->x_sampling != 1 || entry->y_sampling != 1)
            return fail(
                source, EXR_ERROR_FORMAT, error,
                "in part \"%s\" the channel \"%s\" is subsampled, which cannot be read; save "
                "the file with all channels in full resolution",
                part->name, part->channels[c]);
        if (entry->pixel_type != EXR_PIXEL_HALF)
            part->type = EXR_FLOAT;
    }
    return TRUE;
}

static gboolean read_attributes(struct source *source, int index, struct exr_part *part,
                                GError **error) {
    int32_t n = 0;
    exr_result_t rc = exr_get_attribute_count(source->context, index, &n);

    part->attributes = exr_attributes_new();
    for (int32_t i = 0; rc == EXR_ERR_SUCCESS && i < n; i++) {
        const exr_attribute_t *from = NULL;

        rc = exr_get_attribute_by_index(source->context, index, EXR_ATTR_LIST_FILE_ORDER, i, &from);
        if (rc != EXR_ERR_SUCCESS || exr_is_standard_attribute(from->name))
            continue;
        g_autofree char *name = g_utf8_make_valid(from->name, from->name_length);
        if (from->type == EXR_ATTR_STRING) {
            const char *text = from->string->str;
            g_autofree char *string =
                g_utf8_make_valid(text ? text : "", text ? from->string->length : 0);
            exr_set_string(part, name, string);
        } else if (from->type == EXR_ATTR_INT) {
            exr_set_int(part, name, from->i);
        } else if (from->type == EXR_ATTR_DOUBLE) {
            exr_set_double(part, name, from->d);
        } else if (from->type == EXR_ATTR_FLOAT) {
            exr_set_double(part, name, (double)from->f);
        } else if (from->type == EXR_ATTR_V3D) {
            exr_set_v3d(part, name, from->v3d->x, from->v3d->y, from->v3d->z);
        } else if (from->type == EXR_ATTR_V3F) {
            exr_set_v3d(part, name, (double)from->v3f->x, (double)from->v3f->y,
                        (double)from->v3f->z);
        }
    }
    return rc == EXR_ERR_SUCCESS || fail_library(source, rc, error);
}

static gboolean check_compression(struct source *source, int index, const struct exr_part *part,
                                  GError **error) {
    static const char *const names[] = {"none",  "RLE", "ZIPS", "ZIP",  "PIZ",
                                        "PXR24", "B44", "B44A", "DWAA", "DWAB"};
    exr_compression_t method;
    exr_result_t rc = exr_get_compression(source->context, index, &method);

    if (rc != EXR_ERR_SUCCESS)
        return fail_library(source, rc, error);
    if (method > EXR_COMPRESSION_PIZ)
        return fail(source, EXR_ERROR_FORMAT, error,
                    "part \"%s\" is compressed with %s; convert the file to ZIP or PIZ first",
                    part->name, method < G_N_ELEMENTS(names) ? names[method] : "an unknown method");
    return TRUE;
}

/* Returns the bytes of a part's pixels in the file, before compression. */
static gsize pixel_bytes(const struct exr_part *part, const struct windows *windows) {
    return (gsize)window_width(&windows->data) * (gsize)window_height(&windows->data) *
           (gsize)part->n_channels * (part->type == EXR_HALF ? 2 : 4);
}

/* Checks size, channels, compression and attributes of a part. The part is empty before the
 * call. */
static gboolean read_header(struct source *source, int index, struct exr_part *part,
                            struct windows *windows, GError **error) {
    const char *name = NULL;
    exr_storage_t storage;
    exr_result_t rc = exr_get_storage(source->context, index, &storage);

    if (rc != EXR_ERR_SUCCESS)
        return fail_library(source, rc, error);
    if (exr_get_name(source->context, index, &name) != EXR_ERR_SUCCESS || !name)
        name = "";
    part->name = g_utf8_make_valid(name, -1);
    if (storage != EXR_STORAGE_SCANLINE)
        return fail(source, EXR_ERROR_FORMAT, error,
                    "part \"%s\" consists of tiles or deep pixels; save the file with scan lines",
                    part->name);
    if (!read_size(source, index, part, windows, error) ||
        !read_channels(source, index, part, error) ||
        !check_compression(source, index, part, error) ||
        !read_attributes(source, index, part, error))
        return FALSE;
    return pixel_bytes(part, windows) / MAX_EXPANSION <= (gsize)source->size ||
           fail(source, EXR_ERROR_TOO_LARGE, error,
                "the file is too short for the %d×%d pixels of part \"%s\"; copy the file again",
                window_width(&windows->data), window_height(&windows->data), part->name);
}

/* Pads every buffer of the decoder with zeros, because OpenEXR before 3.1.6 reads beyond the end of
 * a damaged PIZ block, by at most the length of the block. */
static void *allocate_padded(exr_transcoding_pipeline_buffer_id_t id, size_t size) {
    return size < G_MAXSIZE / 4 ? calloc(1, 2 * size + 4096) : NULL;
}

static void free_padded(exr_transcoding_pipeline_buffer_id_t id, void *buffer) {
    free(buffer);
}

struct unpack {
    struct exr_part *part;
    const struct windows *windows;
    /* Buffer for a line of the data window. NULL if the data window lies within the display
     * window. */
    float *line;
};

/* Converts a line of a channel to floats. Returns a pointer behind the bytes of the line. */
static const guint8 *unpack_line(const guint8 *from, exr_pixel_type_t type, float *line,
                                 gsize width) {
    if (type == EXR_PIXEL_HALF) {
        exr_half_to_floats(line, (const guint16 *)(gconstpointer)from, width);
        return from + width * sizeof(guint16);
    }
    memcpy(line, from, width * sizeof(float));
    for (gsize x = 0; x < width; x++) {
        guint32 bits;
        memcpy(&bits, &line[x], sizeof bits);
        bits = GUINT32_FROM_LE(bits);
        if (type == EXR_PIXEL_UINT)
            line[x] = (float)bits;
        else if (G_BYTE_ORDER != G_LITTLE_ENDIAN)
            memcpy(&line[x], &bits, sizeof bits);
    }
    return from + width * sizeof(float);
}

static exr_result_t exr_read_unpack(exr_decode_pipeline_t *decode) {
    const struct unpack *unpack = decode->decoding_user_data;
    const struct exr_part *part = unpack->part;
    const exr_attr_box2i_t *data = &unpack->windows->data, *display = &unpack->windows->display;
    const guint8 *from = decode->unpacked_buffer;
    const gsize width = (gsize)window_width(data);
    const int left = MAX(data->min.x, display->min.x), right = MIN(data->max.x, display->max.x);
    for (int y = 0; y < decode->chunk.height; y++) {
        const int row = decode->chunk.start_y + y;
        const gboolean shown = row >= display->min.y && row <= display->max.y;
        for (int c = 0; c < part->n_channels; c++) {
            float *to = shown
                            ? part->planes[c] + (gsize)(row - display->min.y) * (gsize)part->width +
                                  (left - display->min.x)
                            : NULL;
            float *line = unpack->line ? unpack->line : to;
            /* A line outside of the display window is skipped by unpacking it into the buffer. */
            if (!line)
                return EXR_ERR_BAD_CHUNK_LEADER;
            from = unpack_line(from, decode->channels[c].data_type, line, width);
            if (to && to != line)
                memcpy(to, line + (left - data->min.x), sizeof *to * (gsize)(right - left + 1));
        }
    }
    return EXR_ERR_SUCCESS;
}

/* Checks what exr_read_unpack() assumes about a chunk: its channels, position and sizes. The
 * library may not have checked them. */
static gboolean chunk_is_sound(const struct source *source, const struct unpack *unpack,
                               const exr_decode_pipeline_t *decode, int y, int lines) {
    const struct exr_part *part = unpack->part;
    const exr_chunk_info_t *chunk = &decode->chunk;
    const int width = window_width(&unpack->windows->data);
    gsize size = 0;

    for (int c = 0; c < decode->channel_count; c++)
        size +=
            (gsize)lines * (gsize)width * (decode->channels[c].data_type == EXR_PIXEL_HALF ? 2 : 4);
    return decode->channel_count == part->n_channels && chunk->start_y == y &&
           chunk->height == lines && chunk->width == width && chunk->unpacked_size == size &&
           chunk->packed_size <= size && chunk->data_offset <= (guint64)source->size &&
           chunk->packed_size <= (guint64)source->size - chunk->data_offset;
}

static exr_result_t read_chunk(struct source *source, struct exr_scratch *scratch, int index,
                               struct unpack *unpack, exr_decode_pipeline_t *decode, int y,
                               int lines, gboolean first) {
    exr_chunk_info_t chunk;
    exr_result_t rc = exr_read_scanline_chunk_info(source->context, index, y, &chunk);

    if (rc == EXR_ERR_SUCCESS)
        rc = first ? exr_decoding_initialize(source->context, index, &chunk, decode)
                   : exr_decoding_update(source->context, index, &chunk, decode);
    if (rc == EXR_ERR_SUCCESS && first)
        exr_scratch_swap(scratch, &decode->scratch_buffer_1, &decode->scratch_alloc_size_1,
                         &decode->scratch_buffer_2, &decode->scratch_alloc_size_2);
    if (rc == EXR_ERR_SUCCESS && !chunk_is_sound(source, unpack, decode, y, lines))
        rc = EXR_ERR_BAD_CHUNK_LEADER;
    decode->alloc_fn = allocate_padded;
    decode->free_fn = free_padded;
    if (rc == EXR_ERR_SUCCESS && first)
        rc = exr_decoding_choose_default_routines(source->context, index, decode);
    decode->unpack_and_convert_fn = exr_read_unpack;
    decode->decoding_user_data = unpack;
    if (rc == EXR_ERR_SUCCESS && chunk.packed_size == 0)
        rc = EXR_ERR_BAD_CHUNK_LEADER;
    if (rc == EXR_ERR_SUCCESS)
        rc = exr_decoding_run(source->context, index, decode);
    g_mutex_lock(&source->lock);
    rc = source->failed || source->cancelled ? EXR_ERR_READ_IO : rc;
    g_mutex_unlock(&source->lock);
    return rc;
}

/* Allocates the planes. Pixels that the file does not contain become NaN. read_pixels() sets all
 * other pixels.
 */
static gboolean new_planes(struct source *source, struct exr_part *part, GError **error) {
    const gsize n = (gsize)part->width * (gsize)part->height;
    for (int c = 0; c < part->n_channels; c++) {
        part->planes[c] = g_try_malloc_n(n, sizeof(float));
        if (!part->planes[c])
            return fail(source, EXR_ERROR_TOO_LARGE, error,
                        "there is not enough memory for part \"%s\"; close other programs, or use "
                        "a computer with more memory",
                        part->name);
        for (gsize i = 0; part->outside > 0 && i < n; i++)
            part->planes[c][i] = NAN;
    }
    return TRUE;
}

/* Sets *ret_step to the number of lines in a chunk of a part. Checks the necessary memory before it
 * is allocated. *left is the number of bytes of the file that may contain pixels of parts not yet
 * read. Subtracts from *left the minimum number of bytes that the pixels of this part take in the
 * file. */
static gboolean reserve(struct source *source, int index, const struct exr_part *part,
                        const struct windows *windows, gsize *left, int *ret_step, GError **error) {
    const struct exr_part stored = {.width = window_width(&windows->data),
                                    .height = window_height(&windows->data),
                                    .n_channels = part->n_channels};
    const guint64 planes = exr_plane_bytes(part);
    const gsize bytes = pixel_bytes(part, windows) / MAX_EXPANSION;
    int32_t step = 0;

    if (bytes > *left)
        return fail(source, EXR_ERROR_TOO_LARGE, error,
                    "the file is too short for the pixels of all its parts; copy the file again");
    *left -= bytes;
    exr_result_t rc = exr_get_scanlines_per_chunk(source->context, index, &step);
    if (rc != EXR_ERR_SUCCESS || step < 1)
        return fail_library(source, rc != EXR_ERR_SUCCESS ? rc : EXR_ERR_INVALID_ATTR, error);
    if (planes + exr_chunk_bytes(&stored, step) > source->memory)
        return fail(
            source, EXR_ERROR_TOO_LARGE, error,
            "part \"%s\" has %d×%d pixels of %d channels; all parts of a file of %" G_GINT64_FORMAT
            " bytes may take at most %" G_GUINT64_FORMAT
            " MiB of memory; save the file without compression",
            part->name, part->width, part->height, part->n_channels, source->size,
            input_file_memory((guint64)source->size) >> 20);
    source->memory -= planes;
    *ret_step = step;
    return TRUE;
}

/* Reads a part chunk by chunk. Each chunk has `step` lines, see reserve(). */
static gboolean read_pixels(struct source *source, struct exr_scratch *scratch, int index,
                            struct exr_part *part, const struct windows *windows, int step,
                            GError **error) {
    exr_decode_pipeline_t decode = EXR_DECODE_PIPELINE_INITIALIZER;
    const exr_attr_box2i_t *data = &windows->data, *display = &windows->display;
    const int height = window_height(data);
    struct unpack unpack = {.part = part, .windows = windows};
    exr_result_t rc = EXR_ERR_SUCCESS;

    if (!new_planes(source, part, error))
        return FALSE;
    if (data->min.x < display->min.x || data->max.x > display->max.x ||
        data->min.y < display->min.y || data->max.y > display->max.y)
        unpack.line = g_new(float, window_width(data));
    for (int row = 0; rc == EXR_ERR_SUCCESS && row < height; row += step)
        rc = read_chunk(source, scratch, index, &unpack, &decode, data->min.y + row,
                        MIN(step, height - row), row == 0);
    g_free(unpack.line);
    if (decode.context)
        exr_scratch_swap(scratch, &decode.scratch_buffer_1, &decode.scratch_alloc_size_1,
                         &decode.scratch_buffer_2, &decode.scratch_alloc_size_2);
    exr_decoding_destroy(source->context, &decode);
    return rc == EXR_ERR_SUCCESS || fail_library(source, rc, error);
}

/* Reads a part's header. Reads the part's pixels too if `left`, an argument of reserve(), is not
 * NULL. Returns NULL on error. */
static struct exr_part *one_part(struct source *source, int index, gsize *left, GError **error) {
    g_autoptr(ExrPart) part = g_new0(struct exr_part, 1);
    struct windows windows = {0};
    int step = 0;

    if (!read_header(source, index, part, &windows, error) ||
        (left && (!reserve(source, index, part, &windows, left, &step, error) ||
                  !read_pixels(source, &source->scratch, index, part, &windows, step, error))))
        return NULL;
    return g_steal_pointer(&part);
}

/* Returns FALSE with an error if the file has a part of this name already. */
static gboolean check_name(struct source *source, const struct exr_file *file,
                           const struct exr_part *part, GError **error) {
    return !exr_file_part(file, part->name) ||
           fail(source, EXR_ERROR_FORMAT, error,
                "two parts have the name \"%s\"; copy the file again or make it again", part->name);
}

static struct exr_file *read_file(const char *path, gboolean pixels, GError **error) {
    g_autoptr(ExrFile) file = exr_file_new();
    struct source source;
    gboolean ok = source_open(&source, path, error);
    gsize left = ok ? (gsize)source.size : 0;
    int n = 0;

    if (ok)
        exr_get_count(source.context, &n);
    for (int i = 0; ok && i < n; i++) {
        g_autoptr(ExrPart) part = one_part(&source, i, pixels ? &left : NULL, error);

        ok = part && check_name(&source, file, part, error);
        if (ok)
            exr_file_add(file, g_steal_pointer(&part));
    }
    source_close(&source);
    return ok ? g_steal_pointer(&file) : NULL;
}

struct exr_file *exr_read(const char *path, GError **error) {
    return read_file(path, TRUE, error);
}

struct exr_file *exr_read_headers(const char *path, GError **error) {
    return read_file(path, FALSE, error);
}

/* The buffers with which a thread reads a part. */
struct buffers {
    struct exr_scratch scratch;
    struct window window;
};

static void free_buffers(gpointer data) {
    struct buffers *buffers = data;

    exr_scratch_clear(&buffers->scratch);
    g_free(buffers->window.bytes);
    g_free(buffers);
}

struct ExrReader {
    struct source source;
    char *path;
    /* the headers of all parts that exr_reader_next() has not yet returned, in order */
    struct exr_file *file;
    struct windows *windows; /* for each part of the file, like steps */
    int *steps;              /* lines of a chunk */
    /* n: number of parts
     * given: number of parts that exr_reader_next() has returned */
    int n, given;
    struct exr_file *pending; /* the parts that are being read */
    GError **errors;          /* for each part of pending, its error or NULL */
    GPtrArray *idle;          /* struct buffers that no thread uses; source.lock protects it */
};

void exr_reader_free(ExrReader *reader) {
    if (!reader)
        return;
    source_close(&reader->source);
    g_ptr_array_unref(reader->idle);
    exr_file_free(reader->file);
    g_free(reader->windows);
    g_free(reader->steps);
    g_free(reader->path);
    g_free(reader);
}

ExrReader *exr_reader_new(const char *path, GError **error) {
    g_autoptr(ExrReader) reader = g_new0(ExrReader, 1);

    reader->path = g_strdup(path);
    reader->file = exr_file_new();
    reader->idle = g_ptr_array_new_with_free_func(free_buffers);
    if (!source_open(&reader->source, reader->path, error))
        return NULL;
    exr_get_count(reader->source.context, &reader->n);
    reader->windows = g_new0(struct windows, reader->n);
    reader->steps = g_new0(int, reader->n);
    gsize left = (gsize)reader->source.size;
    for (int i = 0; i < reader->n; i++) {
        g_autoptr(ExrPart) part = g_new0(struct exr_part, 1);
        if (!read_header(&reader->source, i, part, &reader->windows[i], error) ||
            !check_name(&reader->source, reader->file, part, error) ||
            !reserve(&reader->source, i, part, &reader->windows[i], &left, &reader->steps[i],
                     error))
            return NULL;
        exr_file_add(reader->file, g_steal_pointer(&part));
    }
    return g_steal_pointer(&reader);
}

int exr_reader_parts(const ExrReader *reader) {
    return reader->n;
}

const char *exr_reader_name(const ExrReader *reader, int ahead) {
    if ((guint)ahead >= reader->file->parts->len)
        return NULL;
    return ((const struct exr_part *)g_ptr_array_index(reader->file->parts, (guint)ahead))->name;
}

void exr_reader_skip(ExrReader *reader) {
    exr_part_free(g_ptr_array_steal_index(reader->file->parts, 0));
    reader->given++;
}

static void read_pending(int i, gpointer data) {
    ExrReader *reader = data;
    const int index = reader->given + i;
    GMutex *lock = &reader->source.lock;

    g_mutex_lock(lock);
    struct buffers *own = reader->idle->len > 0
                              ? g_ptr_array_steal_index(reader->idle, reader->idle->len - 1)
                              : g_new0(struct buffers, 1);
    g_mutex_unlock(lock);
    own_window = &own->window;
    read_pixels(&reader->source, &own->scratch, index, g_ptr_array_index(reader->pending->parts, i),
                &reader->windows[index], reader->steps[index], &reader->errors[i]);
    own_window = NULL;
    g_mutex_lock(lock);
    g_ptr_array_add(reader->idle, own);
    g_mutex_unlock(lock);
}

struct exr_file *exr_reader_next(ExrReader *reader, int n, int n_threads, GError **error) {
    const int some = MIN(n, reader->n - reader->given);
    g_autofree GError **errors = reader->errors = g_new0(GError *, some + 1);
    g_autoptr(ExrFile) pending = reader->pending = exr_file_new();
    gboolean ok = TRUE;

    for (int i = 0; i < some; i++)
        exr_file_add(pending, g_ptr_array_steal_index(reader->file->parts, 0));
    if (some > 0)
        work_for_each(n_threads, some, read_pending, reader);
    reader->given += some;
    for (int i = 0; i < some; i++) {
        if (errors[i] && ok)
            g_propagate_error(error, g_steal_pointer(&errors[i]));
        else if (errors[i])
            g_clear_error(&errors[i]);
        else
            continue;
        ok = FALSE;
    }
    return ok ? g_steal_pointer(&pending) : NULL;
}

struct exr_part *exr_read_part(const char *path, const char *name, GError **error) {
    struct exr_part *part = NULL;
    struct source source;
    gboolean ok = source_open(&source, path, error);
    gboolean found = FALSE;
    int n = 0;

    if (ok)
        exr_get_count(source.context, &n);
    for (int i = 0; ok && !found && i < n; i++) {
        const char *other = NULL;
        gsize left = (gsize)source.size;

        exr_get_name(source.context, i, &other);
        found = g_strcmp0(other ? other : "", name) == 0;
        if (found)
            part = one_part(&source, i, &left, error);
    }
    if (ok && !found)
        fail(&source, EXR_ERROR_MISSING, error,
             "the file has no part \"%s\"; copy the file again or make it again", name);
    source_close(&source);
    return part;
}

struct exr_part *exr_read_picture(const char *path, GError **error) {
    struct exr_part *part = NULL;
    struct source source;
    int n = 0;
    if (source_open(&source, path, error)) {
        gsize left = (gsize)source.size;
        source.placed = TRUE;
        exr_get_count(source.context, &n);
        if (n > 0)
            part = one_part(&source, 0, &left, error);
        else
            fail(&source, EXR_ERROR_MISSING, error,
                 "the file has no part; copy the file again or make it again");
    }
    source_close(&source);
    return part;
}
