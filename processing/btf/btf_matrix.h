/*
 * A whole BTF as a matrix, one row (apparent BRDF) per texel. The values are in memory or, if
 * memory is too small for them, in a scratch file of half floats. Values that no camera measured
 * (NaN, or 0 and flagged by btf_make_view(), see btf.h) are filled from the texels around them in
 * the same picture, and counted. Lower bounds are used as they are, and counted as well.
 */
#pragma once

#include "base/team.h"
#include "base/work.h"
#include "btf_layout.h"

struct btf_scratch;

/* The matrix has one row for each texel. Texels are numbered row by row of the picture, row 0
 * first. A row has n_views × n_lights × 3 (R, G, B) values. */
struct btf_matrix {
    char *name; /* name of the session, for messages and for models made from the BTF */
    struct btf_layout layout;
    float *values; /* height · width rows; NULL if the values are in scratch */
    /* Numbers of texels with each flag of btf.h, summed over all pictures. Imported pictures may
     * have no flags. `holes` also counts the holes that were found in their values. */
    gint64 holes, bounds, shorter, predicted;
    char *directory; /* the session directory */
    struct btf_scratch *scratch;
};

void btf_matrix_free(struct btf_matrix *btf); /* NULL is ignored */

/* Returns the session directory. path is that directory or its products/btf; g_free(). */
char *btf_matrix_session(const char *path);

/* Reads the BTF of a session. path is the session directory or its products/btf. Views without a
 * file are left out. A picture that has only holes becomes black. The error is
 * DATA_ERROR_INCOMPLETE if no view has a file. The error is DATA_ERROR_INVALID if memory cannot be
 * allocated, or if a view
 * - has other lights than the first view
 * - has other texels than the session's grid
 * - lacks a colour or an angle
 * - has infinite values.
 *
 * Other errors are those of session_check_products() and exr_read(). The progress stage is
 * "read". */
struct btf_matrix *btf_matrix_read(const char *path, const struct work *work, GError **error);

/* Does the same as btf_matrix_read() with a limit of memory in bytes (0: no limit). If the values
 * would exceed the limit, they are kept in an unnamed file in products/ of the session, or in the
 * directory of temporary files if products/ is not writable. The file takes 2 bytes per value and
 * disappears with the matrix. Fails also if the disk is too full for the file. */
struct btf_matrix *btf_matrix_read_within(gint64 memory, const char *path, const struct work *work,
                                          GError **error);

/* Does the same as btf_matrix_read() for a team (base/team.h). All ranks call this function. In the
 * result, each rank has only the rows of its own texels (team_part()). Each view is read by one
 * rank, which distributes its texels. If one rank fails, all ranks return an error. */
struct btf_matrix *btf_matrix_read_shared(const struct team *team, const char *path,
                                          const struct work *work, GError **error);

/* Returns the rows of texels first … first + n − 1 in a view: n rows of n_lights × 3 floats,
 * *ret_stride floats apart. The result points into the matrix. If the values are in a scratch file,
 * they are read to buffer (n × n_lights × 3), and the result points to buffer. Returns NULL if the
 * scratch file cannot be read. Any thread. */
const float *btf_matrix_rows(const struct btf_matrix *btf, int view, int first, int n,
                             float *buffer, gsize *ret_stride, GError **error);

/* Copies the rows of texels first … first + n − 1 in a view to ret. The row of texel first + i
 * becomes row indices[i] (n_lights × 3) of ret. Returns FALSE if the scratch file cannot be
 * read. */
gboolean btf_matrix_place_rows(const struct btf_matrix *btf, int view, int first, int n,
                               const int *indices, float *ret, GError **error);

/* Returns the number of bytes that all values of a BTF take as floats. */
gint64 btf_matrix_bytes(const struct btf_layout *layout);

/* Fills a picture's holes (NaN) with the mean of their neighbours, from the border of each hole
 * inwards. planes: n of height × width. Returns the number of holes, or −1 if every pixel is a
 * hole. */
int btf_fill_holes(float *const *planes, int n, int width, int height);

/* The scratch file of btf_matrix_read_within(). The file holds n_views × n_texels × `row` half
 * floats, where `row` is n_lights × 3.
 * - btf_scratch_new() makes the file, without a name, in `folder`.
 * - btf_scratch_write() writes all texels of a view. `values` has n_texels × `row` floats.
 * - btf_scratch_read() reads texels first … first + n − 1 of a view. `ret` gets n × `row` floats.
 * - btf_scratch_place_rows() reads the same texels. As in btf_matrix_place_rows(), texel first + i
 *   becomes row indices[i] of `ret`. */
struct btf_scratch *btf_scratch_new(const char *folder, gsize row, int n_views, int n_texels,
                                    GError **error);
void btf_scratch_free(struct btf_scratch *scratch); /* NULL is ignored */
gboolean btf_scratch_write(struct btf_scratch *scratch, int view, const float *values,
                           GError **error);
gboolean btf_scratch_read(const struct btf_scratch *scratch, int view, int first, int n, float *ret,
                          GError **error);
gboolean btf_scratch_place_rows(const struct btf_scratch *scratch, int view, int first, int n,
                                const int *indices, float *ret, GError **error);
/* Returns the hash of a view's values, or 0 if btf_scratch_write() has not written the view. */
guint64 btf_scratch_hash(const struct btf_scratch *scratch, int view);
