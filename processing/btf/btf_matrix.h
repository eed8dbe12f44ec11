/*
 * A whole BTF, one BRDF a texel: in memory, or, where that is too small, in a file of halves that
 * goes with it. Of a session, values that no camera saw (NaN, or those that the BTF's maker set to
 * 0 and counted, see btf.h) are filled from the texels around them in the same picture, and
 * counted. Lower bounds are taken as they are, which is nearer than what is around them, and
 * counted too.
 */
#pragma once

#include "base/team.h"
#include "base/work.h"

struct btf_scratch;

/* One row a texel, row 0 first, of n_views × n_lights × 3 (R, G, B). */
struct btf_matrix {
    char *name;
    int width, height; /* texels */
    double texel_mm, reference_mm;
    int n_views, n_lights;
    float *view_theta_deg, *view_phi_deg;   /* n_views */
    float *light_theta_deg, *light_phi_deg; /* n_lights */
    float *values;                          /* height · width rows; NULL if they are in scratch */
    gint64 holes;     /* pixels of the rectified pictures that no good frame pixel shows */
    gint64 bounds;    /* of them that are lower bounds, since saturated pixels show them */
    gint64 shorter;   /* those that are known from shorter exposures only */
    gint64 predicted; /* those of pictures that were not taken, made of other lights' */
    char *directory;  /* of the session */
    struct btf_scratch *scratch;
};

void btf_matrix_free(struct btf_matrix *btf); /* NULL is ignored */

/* The session that a path belongs to: itself, or what its products/btf lies in; g_free(). */
char *btf_matrix_session(const char *path);

/* Of a session directory, or of its products/btf. Views that are not there are left out; a view
 * whose lights or texels are other than those of the first is refused, as are infinite values.
 * A picture that is nothing but holes becomes black. Stage "read". */
struct btf_matrix *btf_matrix_read(const char *path, const struct work *work, GError **error);

/* The same; if values would take more than memory bytes (0: any number), they are kept in a file
 * without a name in products/ of the session, or if that cannot be written, where temporary files
 * are. It takes 2 bytes a value and is gone with the matrix. */
struct btf_matrix *btf_matrix_read_within(gint64 memory, const char *path, const struct work *work,
                                          GError **error);

/* For a team (lpca_team.h) in which all call this: values hold the rows of a rank's own texels
 * alone. Each view is read by one rank, which deals its texels out. An error of one is an error of
 * all. */
struct btf_matrix *btf_matrix_read_shared(const struct team *team, const char *path,
                                          const struct work *work, GError **error);

/* What n texels from first on show to a view: n rows of n_lights × 3 floats, each *ret_stride
 * behind the one before. They lie in memory, or else in buffer (n × n_lights × 3). NULL if the file
 * cannot be read. Any thread. */
const float *btf_matrix_rows(const struct btf_matrix *btf, int view, int first, int n,
                             float *buffer, gsize *ret_stride, GError **error);

/* The same in another order: a copy, texel first + i's in the places[i]-th row of ret, which has
 * n × n_lights × 3 floats. */
gboolean btf_matrix_place_rows(const struct btf_matrix *btf, int view, int first, int n,
                               const int *places, float *ret, GError **error);

/* Bytes of the values as floats. */
gint64 btf_matrix_bytes(int width, int height, int n_views, int n_lights);

/* A picture's holes (NaN) become the mean of what is next to them, row by row inwards. planes: n of
 * width × height. Returns how many pixels were holes; −1 if there was nothing else. */
int btf_fill_holes(float *const *planes, int n, int width, int height);

/* For btf_matrix_read_within(): halves of one view after the other, height × width × n_lights × 3.
 */
struct btf_scratch *btf_scratch_new(const char *folder, gsize row, int n_views, int n_texels,
                                    GError **error);
void btf_scratch_free(struct btf_scratch *scratch); /* NULL is ignored */
gboolean btf_scratch_write(struct btf_scratch *scratch, int view, const float *values,
                           GError **error);
gboolean btf_scratch_read(const struct btf_scratch *scratch, int view, int first, int n, float *ret,
                          GError **error);
gboolean btf_scratch_place_rows(const struct btf_scratch *scratch, int view, int first, int n,
                                const int *places, float *ret, GError **error);
/* Of what was written of a view: the same for the same values. */
guint64 btf_scratch_hash(const struct btf_scratch *scratch, int view);
