/* The files bonn_*.c share the parsing and writing of headers, and the factors of FMF and DFMF. */
#pragma once

#include "base/bytes.h"
#include "bonn.h"

#include <stdio.h>

#define BONN_SIGNATURE 10 /* maximum bytes of a signature */

/* A cursor over the bytes of a file. The bytes are read, not mapped, so that a file that is
 * truncated during the work causes an error and not a signal. */
struct bonn_bytes {
    int fd;
    gsize size, at;
    const char *path;
};

/* Reads n bytes and moves the cursor. `what` names the bytes in the error. Returns FALSE with an
 * error if fewer bytes are left, or if they cannot be read. bonn_skip() only moves the cursor. */
gboolean bonn_take(struct bonn_bytes *bytes, gsize n, const char *what, gpointer ret,
                   GError **error);
gboolean bonn_skip(struct bonn_bytes *bytes, gsize n, const char *what, GError **error);
gboolean bonn_take_u32(struct bonn_bytes *bytes, const char *what, guint32 *ret, GError **error);

void bonn_report(const struct bonn_bytes *bytes, enum bonn_error code, GError **error,
                 const char *format, ...) G_GNUC_PRINTF(4, 5);
#define bonn_fail(...) (bonn_report(__VA_ARGS__), FALSE)

/* Parses the file from the signature to width and height. ret_order gives the positions of R, G, B
 * among the channels. *ret_extra says whether the file is an FMF with a version. */
gboolean bonn_parse_header(struct bonn_bytes *bytes, struct bonn_header *ret,
                           int ret_order[BONN_CHANNELS], gboolean *ret_extra, GError **error);

/* Reads the number of rotations of local frames into header->n_rotations, and skips the
 * rotations. */
gboolean bonn_skip_rotations(struct bonn_bytes *bytes, struct bonn_header *header, GError **error);

/* Appends the header of a file to the bytes. */
void bonn_put_header(GByteArray *to, const struct bonn_header *header);

/* of_texel[i] is the position of texel i among the stored texels, or −1 if the texel is not stored.
 * A full file stores all texels. When a full file is read, of_texel is −1 for texels outside of the
 * mask too.
 */
struct bonn_index {
    gint32 *of_texel;
    int n_stored;
};

/* A matrix as two factors, u and sv, and the meaning of its rows. */
struct bonn_matrix {
    gsize n_components, n_rows, n_columns;
    float *u, *sv;
    /* TRUE if a row is (texel, channel), FALSE if a row is (view, light, channel) */
    gboolean of_images;
};
void bonn_matrix_clear(struct bonn_matrix *matrix);

/* Parses a matrix of n_channels interleaved channels (3 in an FMF), or of one channel (in a
 * DFMF). */
gboolean bonn_parse_matrix(struct bonn_bytes *bytes, const struct bonn_header *header,
                           int n_channels, struct bonn_matrix *ret, GError **error);

/* Reconstructs texels first … first + n − 1 of a view: to[(light · n + texel) · 3 + channel[i]]. */
void bonn_matrix_view(const struct bonn_matrix *matrix, const struct bonn_header *header,
                      int n_channels, int view, gsize first, gsize n, const int *channel,
                      float *to);

/* The transformation of the colours that a file stores. bonn_colours_undo() inverts the
 * transformation. bonn_colours_check() fails if the model is not known. */
struct bonn_colours {
    guint32 model;
    float mean[3], matrix[9];
    gboolean logarithm; /* whether logarithms of all values are stored */
};
gboolean bonn_colours_check(const struct bonn_bytes *bytes, const struct bonn_colours *colours,
                            GError **error);
void bonn_colours_undo(const struct bonn_colours *colours, float *rgb, gsize n_pixels);
