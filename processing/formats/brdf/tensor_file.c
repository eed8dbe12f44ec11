#include "tensor_file.h"

#include <string.h>
#include <unistd.h>

#include "base/data_error.h"
#include "base/input_file.h"
#include "base/output_file.h"

#define MAGIC       "tensor_file"
#define MAX_BYTES   ((guint64)2 << 30)
#define MAX_FIELDS  256
#define MAX_NAME    255
#define HEAD_BYTES  18 /* 12 of the magic, 2 of the version, 4 of the number of fields */
#define ALIGN_BYTES 8

G_STATIC_ASSERT(G_BYTE_ORDER == G_LITTLE_ENDIAN); /* numbers are copied as they are */

static gsize type_bytes(enum tensor_type type) {
    static const guint8 bytes[] = {0, 1, 1, 2, 2, 4, 4, 8, 8, 2, 4, 8};
    return bytes[type];
}

const char *tensor_type_name(enum tensor_type type) {
    static const char *const names[] = {"",      "uint8",   "int8",    "uint16",
                                        "int16", "uint32",  "int32",   "uint64",
                                        "int64", "float16", "float32", "float64"};
    return names[type];
}

static void field_free(gpointer data) {
    struct tensor_field *field = data;
    g_free(field->name);
    g_free(field->values);
    g_free(field);
}

struct tensor_file *tensor_file_new(void) {
    struct tensor_file *file = g_new0(struct tensor_file, 1);
    file->fields = g_ptr_array_new_with_free_func(field_free);
    return file;
}

void tensor_file_free(struct tensor_file *file) {
    if (!file)
        return;
    g_ptr_array_unref(file->fields);
    g_free(file);
}

const struct tensor_field *tensor_file_field(const struct tensor_file *file, const char *name) {
    for (guint i = 0; i < file->fields->len; i++) {
        const struct tensor_field *field = file->fields->pdata[i];
        if (strcmp(field->name, name) == 0)
            return field;
    }
    return NULL;
}

struct reader {
    const char *path;
    int fd;
    guint64 length, at, left; /* left is the number of bytes that further fields may take */
};

static gboolean take(struct reader *reader, void *to, gsize n, GError **error) {
    GError *found = NULL;
    if (n > reader->length - reader->at)
        return data_error_fail(reader->path, 0, error,
                               "the file ends within the list of fields; copy the file again");
    if (!input_file_read_at(reader->fd, reader->path, to, n, reader->at, &found)) {
        input_file_propagate(found, DATA_ERROR, DATA_ERROR_IO, DATA_ERROR_INVALID, error);
        return FALSE;
    }
    reader->at += n;
    return TRUE;
}

static gboolean read_values(struct reader *reader, struct tensor_field *field, guint64 offset,
                            GError **error) {
    guint64 bytes = type_bytes(field->type);
    GError *found = NULL;
    for (int i = 0; i < field->n_dimensions; i++)
        if (!g_uint64_checked_mul(&bytes, bytes, field->shape[i]))
            bytes = G_MAXUINT64;
    if (bytes > reader->left || offset > reader->length || bytes > reader->length - offset)
        return data_error_fail(reader->path, 0, error,
                               "the field “%s” is larger than the file; copy the file again",
                               field->name);
    reader->left -= bytes;
    field->bytes = (gsize)bytes;
    field->n_values = field->bytes / type_bytes(field->type);
    field->values = g_malloc(field->bytes + 1);
    if (input_file_read_at(reader->fd, reader->path, field->values, field->bytes, offset, &found))
        return TRUE;
    input_file_propagate(found, DATA_ERROR, DATA_ERROR_IO, DATA_ERROR_INVALID, error);
    return FALSE;
}

static gboolean read_field(struct reader *reader, struct tensor_file *file, GError **error) {
    guint16 length, n_dimensions;
    guint64 offset, sizes[TENSOR_FILE_DIMENSIONS];
    guint8 type;
    char name[MAX_NAME + 1] = {0};
    if (!take(reader, &length, sizeof length, error))
        return FALSE;
    if (length > MAX_NAME)
        return data_error_fail(
            reader->path, 0, error,
            "the name of field %u has %u bytes, but at most %d are possible; copy the file again",
            file->fields->len + 1, length, MAX_NAME);
    if (!take(reader, name, length, error) ||
        !take(reader, &n_dimensions, sizeof n_dimensions, error) ||
        !take(reader, &type, sizeof type, error) || !take(reader, &offset, sizeof offset, error))
        return FALSE;
    if (strlen(name) != length || !g_utf8_validate(name, -1, NULL))
        return data_error_fail(reader->path, 0, error,
                               "the name of field %u is not UTF-8; copy the file again",
                               file->fields->len + 1);
    if (type < TENSOR_UINT8 || type > TENSOR_FLOAT64 || n_dimensions > TENSOR_FILE_DIMENSIONS)
        return data_error_fail(reader->path, 0, error,
                               "the field “%s” has type %u and %u dimensions; only types 1 to 11 "
                               "and at most 8 dimensions can be read; copy the file again",
                               name, type, n_dimensions);
    if (tensor_file_field(file, name))
        return data_error_fail(reader->path, 0, error,
                               "the file has two fields “%s”; copy the file again", name);
    if (!take(reader, sizes, n_dimensions * sizeof sizes[0], error))
        return FALSE;
    struct tensor_field *field = g_new0(struct tensor_field, 1);
    g_ptr_array_add(file->fields, field);
    field->name = g_strdup(name);
    field->type = (enum tensor_type)type;
    field->n_dimensions = n_dimensions;
    for (int i = 0; i < n_dimensions; i++)
        field->shape[i] = (gsize)sizes[i];
    return read_values(reader, field, offset, error);
}

static gboolean read_fields(struct reader *reader, struct tensor_file *file, GError **error) {
    guint8 head[HEAD_BYTES];
    guint32 n;
    if (reader->length < HEAD_BYTES)
        return data_error_fail(reader->path, 0, error,
                               "the file is too short for a tensor file (.bsdf); copy it again");
    if (!take(reader, head, sizeof head, error))
        return FALSE;
    memcpy(&n, head + 14, sizeof n);
    if (memcmp(head, MAGIC, sizeof MAGIC) != 0)
        return data_error_fail(
            reader->path, 0, error,
            "the file is not a tensor file; give a BRDF in RGL's format (.bsdf)");
    if (head[12] != 1 || head[13] != 0 || n > MAX_FIELDS)
        return data_error_fail(reader->path, 0, error,
                               "the tensor file has version %u.%u and %u fields; only version 1.0 "
                               "with at most %d fields can be read",
                               head[12], head[13], n, MAX_FIELDS);
    for (guint32 i = 0; i < n; i++)
        if (!read_field(reader, file, error))
            return FALSE;
    return TRUE;
}

struct tensor_file *tensor_file_read(const char *path, GError **error) {
    struct reader reader = {.path = path};
    GError *found = NULL;
    reader.fd = input_file_open(path, MAX_BYTES, &reader.length, &found);
    if (reader.fd < 0) {
        input_file_propagate(found, DATA_ERROR, DATA_ERROR_IO, DATA_ERROR_INVALID, error);
        return NULL;
    }
    reader.left = reader.length;
    g_autoptr(TensorFile) file = tensor_file_new();
    const gboolean ok = read_fields(&reader, file, error);
    close(reader.fd);
    return ok ? g_steal_pointer(&file) : NULL;
}

void tensor_file_add(struct tensor_file *file, const char *name, enum tensor_type type,
                     int n_dimensions, const gsize *shape, const void *values) {
    struct tensor_field *field = g_new0(struct tensor_field, 1);
    field->name = g_strdup(name);
    field->type = type;
    field->n_dimensions = n_dimensions;
    field->n_values = 1;
    for (int i = 0; i < n_dimensions; i++) {
        field->shape[i] = shape[i];
        field->n_values *= shape[i];
    }
    field->bytes = field->n_values * type_bytes(type);
    field->values = g_malloc(field->bytes + 1);
    if (field->bytes > 0)
        memcpy(field->values, values, field->bytes);
    g_ptr_array_add(file->fields, field);
}

static gsize tensor_aligned(gsize at) {
    return (at + ALIGN_BYTES - 1) / ALIGN_BYTES * ALIGN_BYTES;
}

static gsize head_bytes(const struct tensor_field *field) {
    return 2 + strlen(field->name) + 2 + 1 + 8 + 8 * (gsize)field->n_dimensions;
}

gboolean tensor_file_write(const char *path, const struct tensor_file *file, GError **error) {
    static const guint8 version[2] = {1, 0}, zeros[ALIGN_BYTES] = {0};
    const guint32 n = file->fields->len;
    g_autoptr(GByteArray) out = g_byte_array_new();
    gsize at = HEAD_BYTES;
    g_byte_array_append(out, (const guint8 *)MAGIC, sizeof MAGIC);
    g_byte_array_append(out, version, sizeof version);
    g_byte_array_append(out, (const guint8 *)&n, sizeof n);
    for (guint i = 0; i < n; i++)
        at += head_bytes(file->fields->pdata[i]);
    for (guint i = 0; i < n; i++) {
        const struct tensor_field *field = file->fields->pdata[i];
        const guint16 length = (guint16)strlen(field->name);
        const guint16 n_dimensions = (guint16)field->n_dimensions;
        const guint8 type = (guint8)field->type;
        at = tensor_aligned(at);
        const guint64 offset = at;
        g_byte_array_append(out, (const guint8 *)&length, sizeof length);
        g_byte_array_append(out, (const guint8 *)field->name, length);
        g_byte_array_append(out, (const guint8 *)&n_dimensions, sizeof n_dimensions);
        g_byte_array_append(out, &type, sizeof type);
        g_byte_array_append(out, (const guint8 *)&offset, sizeof offset);
        for (int k = 0; k < field->n_dimensions; k++) {
            const guint64 size = field->shape[k];
            g_byte_array_append(out, (const guint8 *)&size, sizeof size);
        }
        at += field->bytes;
    }
    for (guint i = 0; i < n; i++) {
        const struct tensor_field *field = file->fields->pdata[i];
        g_byte_array_append(out, zeros, (guint)(tensor_aligned(out->len) - out->len));
        g_byte_array_append(out, field->values, (guint)field->bytes);
    }
    return output_file_write(path, out->data, out->len, error);
}
