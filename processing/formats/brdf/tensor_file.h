/* Tensor files, the container of RGL's .bsdf files (Dupuy & Jakob 2018; rgl.epfl.ch/materials):
 * named arrays of numbers, all little-endian.
 *
 *   header  "tensor_file" and a NUL; u8 1, u8 0 (the version); u32 number of fields
 *   field   u16 length of the name; the name; u16 number of dimensions; u8 type; u64 position of
 *           the numbers in the file; u64 size of each dimension; the last dimension varies fastest
 *
 * A damaged or hostile file cannot take much memory: the size of a field is compared with the
 * length of the file before memory is allocated, and all fields together take no more memory than
 * the file has bytes. Errors are DATA_ERROR_INVALID and DATA_ERROR_IO, and name the file. Any
 * thread. */
#pragma once

#include <glib.h>

#define TENSOR_FILE_DIMENSIONS 8 /* maximum number of dimensions */

enum tensor_type {
    TENSOR_UINT8 = 1,
    TENSOR_INT8,
    TENSOR_UINT16,
    TENSOR_INT16,
    TENSOR_UINT32,
    TENSOR_INT32,
    TENSOR_UINT64,
    TENSOR_INT64,
    TENSOR_FLOAT16,
    TENSOR_FLOAT32,
    TENSOR_FLOAT64,
};

/* Returns for example "float32". */
const char *tensor_type_name(enum tensor_type type);

struct tensor_field {
    char *name;
    enum tensor_type type;
    int n_dimensions;
    gsize shape[TENSOR_FILE_DIMENSIONS];
    /* n_values: how many numbers the field has
     * bytes: how many bytes these numbers have */
    gsize n_values, bytes;
    void *values; /* the numbers, aligned as by g_malloc() */
};

typedef struct tensor_file {
    GPtrArray *fields; /* of struct tensor_field */
} TensorFile;

struct tensor_file *tensor_file_new(void);
void tensor_file_free(struct tensor_file *file); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(TensorFile, tensor_file_free)

struct tensor_file *tensor_file_read(const char *path, GError **error);

/* Returns a field, or NULL if there is none of that name. */
const struct tensor_field *tensor_file_field(const struct tensor_file *file, const char *name);

/* Adds a field. shape has n_dimensions sizes. values are copied. */
void tensor_file_add(struct tensor_file *file, const char *name, enum tensor_type type,
                     int n_dimensions, const gsize *shape, const void *values);

/* Writes a file in which the numbers of each field begin at a multiple of 8 bytes. */
gboolean tensor_file_write(const char *path, const struct tensor_file *file, GError **error);
