/* Keeps the values of a BTF that does not fit into memory in a scratch file, as half floats in the
 * order [view][texel][light][colour]. Reading and writing convert PIECE values at a time. */
#include <xxhash.h>

#include "base/scratch_file.h"
#include "btf_matrix_private.h"
#include "exr/exr_half.h"

/* number of values that are converted at a time, so that they fit into the cache */
#define PIECE 16384

struct btf_scratch {
    ScratchFile *file;
    gsize row; /* number of values of a texel in a view */
    gsize n_texels;
    guint64 *hashes; /* n_views: hash of a view's values; 0 if not written by btf_scratch_write() */
};

struct btf_scratch *btf_scratch_new(const char *folder, gsize row, int n_views, int n_texels,
                                    GError **error) {
    const gint64 bytes = (gint64)row * n_views * n_texels * (gint64)sizeof(guint16);
    ScratchFile *file = scratch_file_new(folder, (guint64)bytes, "the values of the BTF", error);
    if (!file)
        return NULL;
    struct btf_scratch *scratch = g_new0(struct btf_scratch, 1);
    *scratch = (struct btf_scratch){file, row, (gsize)n_texels, g_new0(guint64, n_views)};
    return scratch;
}

void btf_scratch_free(struct btf_scratch *scratch) {
    if (!scratch)
        return;
    scratch_file_free(scratch->file);
    g_free(scratch->hashes);
    g_free(scratch);
}

static guint64 offset(const struct btf_scratch *scratch, int view, gsize first) {
    return ((guint64)((gsize)view * scratch->n_texels) + first) * scratch->row * sizeof(guint16);
}

/* Writes n texels of a view. ret_hash, which may be NULL, gets the hash of the values written. */
static gboolean write_rows(const struct btf_scratch *scratch, int view, int first, int n,
                           const float *values, guint64 *ret_hash, GError **error) {
    guint16 halves[PIECE];
    const gsize all = (gsize)n * scratch->row;
    guint64 at = offset(scratch, view, (gsize)first);
    guint64 hash = 0;
    for (gsize i = 0; i < all; i += PIECE) {
        const gsize part = MIN(PIECE, all - i);
        exr_half_from_floats(halves, values + i, part);
        if (ret_hash)
            hash = XXH3_64bits_withSeed(halves, part * sizeof *halves, hash);
        if (!scratch_file_write(scratch->file, at, halves, part * sizeof *halves, error))
            return FALSE;
        at += part * sizeof *halves;
    }
    if (ret_hash)
        *ret_hash = hash;
    return TRUE;
}

gboolean btf_scratch_write_rows(const struct btf_scratch *scratch, int view, int first, int n,
                                const float *values, GError **error) {
    return write_rows(scratch, view, first, n, values, NULL, error);
}

gboolean btf_scratch_write(struct btf_scratch *scratch, int view, const float *values,
                           GError **error) {
    return write_rows(scratch, view, 0, (int)scratch->n_texels, values, &scratch->hashes[view],
                      error);
}

gboolean btf_scratch_read(const struct btf_scratch *scratch, int view, int first, int n, float *ret,
                          GError **error) {
    guint16 halves[PIECE];
    const gsize all = (gsize)n * scratch->row;
    guint64 at = offset(scratch, view, (gsize)first);
    for (gsize i = 0; i < all; i += PIECE) {
        const gsize part = MIN(PIECE, all - i);
        if (!scratch_file_read(scratch->file, at, halves, part * sizeof *halves, error))
            return FALSE;
        exr_half_to_floats(ret + i, halves, part);
        at += part * sizeof *halves;
    }
    return TRUE;
}

gboolean btf_scratch_place_rows(const struct btf_scratch *scratch, int view, int first, int n,
                                const int *indices, float *ret, GError **error) {
    guint16 halves[PIECE];
    const gsize row = scratch->row;
    const int at_once = (int)(PIECE / row);
    for (int i = 0; at_once == 0 && i < n; i++)
        if (!btf_scratch_read(scratch, view, first + i, 1, ret + (gsize)indices[i] * row, error))
            return FALSE;
    for (int i = 0; at_once > 0 && i < n; i += at_once) {
        const int rows = MIN(at_once, n - i);
        if (!scratch_file_read(scratch->file, offset(scratch, view, (gsize)first + (gsize)i),
                               halves, (gsize)rows * row * sizeof *halves, error))
            return FALSE;
        for (int j = 0; j < rows; j++)
            exr_half_to_floats(ret + (gsize)indices[i + j] * row, halves + (gsize)j * row, row);
    }
    return TRUE;
}

guint64 btf_scratch_hash(const struct btf_scratch *scratch, int view) {
    return scratch->hashes[view];
}
