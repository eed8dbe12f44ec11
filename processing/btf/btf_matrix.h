/*
 * A whole BTF as a matrix, one row (apparent BRDF) per texel: in memory, or, where that is too
 * small, in a scratch file of half floats. Values that no camera measured (NaN, or 0 and flagged by
 * btf_make_view(), see btf.h) are filled from the texels around them in the same picture, and
 * counted. Lower bounds are used as they are, and counted as well.
 */
#pragma once

#include "base/team.h"
#include "base/work.h"
#include "btf_layout.h"

struct btf_scratch;

/* n_texels rows (texels row by row, row 0 first) of n_views × n_lights × 3 (R, G, B). */
struct btf_matrix {
    char *name;
    struct btf_layout layout;
    float *values;    /* height · width rows; NULL if they are in scratch */
    gint64 holes;     /* values that no valid pixel of a frame measured */
    gint64 bounds;    /* lower bounds, from saturated pixels */
    gint64 shorter;   /* values from shorter exposures only */
    gint64 predicted; /* values predicted for missing lights */
    char *directory;  /* of the session */
    struct btf_scratch *scratch;
};

void btf_matrix_free(struct btf_matrix *btf); /* NULL is ignored */

/* The session directory of a path to it or to its products/btf; g_free() it. */
char *btf_matrix_session(const char *path);

/* Reads the BTF of a session directory, or of its products/btf. Views without a file are left
 * out. DATA_ERROR_INVALID: a view differs from the first in lights or texels, or has infinite
 * values. A picture of holes alone becomes black. Progress stage "read". */
struct btf_matrix *btf_matrix_read(const char *path, const struct work *work, GError **error);

/* As btf_matrix_read(). If the values would take more than memory bytes (0: no limit), they are
 * kept in an unnamed file in products/ of the session, or, if that is not writable, in the
 * directory of temporary files. It takes 2 bytes per value and disappears with the matrix. */
struct btf_matrix *btf_matrix_read_within(gint64 memory, const char *path, const struct work *work,
                                          GError **error);

/* All ranks of a team (base/team.h) call this; values hold only the rows of a rank's own texels.
 * One rank reads each view and distributes its texels. An error of one rank is an error of all. */
struct btf_matrix *btf_matrix_read_shared(const struct team *team, const char *path,
                                          const struct work *work, GError **error);

/* Texels first … first + n − 1 in a view: n rows of n_lights × 3 floats, *ret_stride floats apart,
 * in memory or read into buffer (n × n_lights × 3). NULL: the file cannot be read. Any thread. */
const float *btf_matrix_rows(const struct btf_matrix *btf, int view, int first, int n,
                             float *buffer, gsize *ret_stride, GError **error);

/* Copies the same rows, that of texel first + i to row indices[i] of ret (n × n_lights × 3). */
gboolean btf_matrix_place_rows(const struct btf_matrix *btf, int view, int first, int n,
                               const int *indices, float *ret, GError **error);

/* Bytes of the values as floats. */
gint64 btf_matrix_bytes(const struct btf_layout *layout);

/* Fills a picture's holes (NaN) with the mean of their neighbours, from the border of each hole
 * inwards. planes: n of height × width. Returns the number of holes; −1 if all of it is holes. */
int btf_fill_holes(float *const *planes, int n, int width, int height);

/* The scratch file of btf_matrix_read_within(): half floats, n_views × n_texels × n_lights × 3. */
struct btf_scratch *btf_scratch_new(const char *folder, gsize row, int n_views, int n_texels,
                                    GError **error);
void btf_scratch_free(struct btf_scratch *scratch); /* NULL is ignored */
gboolean btf_scratch_write(struct btf_scratch *scratch, int view, const float *values,
                           GError **error);
gboolean btf_scratch_read(const struct btf_scratch *scratch, int view, int first, int n, float *ret,
                          GError **error);
gboolean btf_scratch_place_rows(const struct btf_scratch *scratch, int view, int first, int n,
                                const int *indices, float *ret, GError **error);
/* Hash of a view's values. */
guint64 btf_scratch_hash(const struct btf_scratch *scratch, int view);
