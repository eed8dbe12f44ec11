/* The files lpca*.c share the content of a packed file and its conversion. */
#pragma once

#include "exr/exr.h"
#include "lpca_pack.h"
#include "lpca_private.h"

/* The content of a packed file. */
struct lpca_packed {
    double step;
    int n_views, n_lights; /* number of axes that are kept */
    /* n_views × layout.views.n, and n_lights × layout.lights.n: the axes as in the file, not yet
     * orthonormal */
    float *views, *lights;
    float colours[9]; /* axes of the colours, 3 × 3, as in the file */
    float *scales;    /* S: clusters × (components + 1) */
    gint32 *tables;   /* clusters × (components + 1) × n_views × 3 × n_lights */
    gint32 *maps;     /* components × height × width */
};

struct lpca_packed *lpca_packed_new(void);

/* Returns the matrix of the orthonormal cosine transform, n × n. Row i is the i-th cosine.
 * g_free() */
float *lpca_cosines(int n);

/* Computes brdfs and weights from lpca->packed. */
void lpca_unpack(struct lpca *lpca, int n_threads);

/* Write and read the parts of a packed file. lpca_packed_read_parts() returns FALSE if a part is
 * missing or invalid. */
void lpca_packed_add_parts(struct exr_file *file, const struct lpca *lpca);
gboolean lpca_packed_read_parts(struct lpca *lpca, const struct exr_file *file);

/* Encode n numbers as an xz stream (lpca_pack.h), and decode the stream. lpca_varint_decode()
 * returns NULL if the bytes do not contain exactly n numbers; g_free() the result. */
GByteArray *lpca_varint_encode(const gint32 *values, gsize n);
gint32 *lpca_varint_decode(const guint8 *bytes, gsize size, gsize n);
