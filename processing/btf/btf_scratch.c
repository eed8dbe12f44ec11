/* Keeps the values of a BTF that does not fit into memory in an unnamed file (O_TMPFILE), as half
 * floats in the order [view][texel][light][colour]. Reading and writing convert PIECE values at a
 * time. */
#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <unistd.h>
#include <xxhash.h>

#include "btf_matrix_private.h"
#include "exr/exr_half.h"

/* number of values that are converted at a time, so that they fit into the cache */
#define PIECE 16384

struct btf_scratch {
    int fd;
    gsize row; /* number of values of a texel in a view */
    gsize n_texels;
    guint64 *hashes; /* n_views: hash of a view's values; 0 if not written by btf_scratch_write() */
};

/* Sets an error from errno. `what` is "reading" or "writing". Returns FALSE. */
static gboolean io_error(GError **error, const char *what) {
    const int code = errno;
    g_set_error(error, G_FILE_ERROR, g_file_error_from_errno(code),
                "%s the temporary file for the values of the BTF failed: %s; check the disk of the "
                "session, and that of %s, which is used if the session is not writable",
                what, g_strerror(code), g_get_tmp_dir());
    return FALSE;
}

struct btf_scratch *btf_scratch_new(const char *folder, gsize row, int n_views, int n_texels,
                                    GError **error) {
    const gint64 bytes = (gint64)row * n_views * n_texels * (gint64)sizeof(guint16);
    int fd = open(folder, O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
    if (fd < 0)
        fd = open(folder = g_get_tmp_dir(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
    /* Reserves the space now, so that a full disk is reported before the views are read. */
    if (fd < 0 || (errno = posix_fallocate(fd, 0, bytes)) != 0) {
        const int code = errno;
        g_autofree char *size = g_format_size((guint64)bytes);
        g_set_error(error, G_FILE_ERROR, g_file_error_from_errno(code),
                    "%s: no temporary file of %s can be made here for the values of the BTF: %s; "
                    "free some space or raise the limit of memory",
                    folder, size, g_strerror(code));
        if (fd >= 0)
            close(fd);
        return NULL;
    }
    struct btf_scratch *scratch = g_new0(struct btf_scratch, 1);
    *scratch = (struct btf_scratch){fd, row, (gsize)n_texels, g_new0(guint64, n_views)};
    return scratch;
}

void btf_scratch_free(struct btf_scratch *scratch) {
    if (!scratch)
        return;
    close(scratch->fd);
    g_free(scratch->hashes);
    g_free(scratch);
}

static off_t offset(const struct btf_scratch *scratch, int view, gsize first) {
    return (off_t)((((gsize)view * scratch->n_texels) + first) * scratch->row * sizeof(guint16));
}

/* Reads or writes n bytes, repeating short transfers. */
static gboolean transfer(int fd, gboolean write, guint8 *bytes, gsize n, off_t at) {
    while (n > 0) {
        const gssize done = write ? pwrite(fd, bytes, n, at) : pread(fd, bytes, n, at);
        if (done < 0 && errno == EINTR)
            continue;
        if (done <= 0) {
            errno = done == 0 ? EIO : errno;
            return FALSE;
        }
        bytes += done;
        at += done;
        n -= (gsize)done;
    }
    return TRUE;
}

/* Writes n texels of a view. ret_hash, which may be NULL, gets the hash of the values written. */
static gboolean write_rows(const struct btf_scratch *scratch, int view, int first, int n,
                           const float *values, guint64 *ret_hash, GError **error) {
    guint16 halves[PIECE];
    const gsize all = (gsize)n * scratch->row;
    off_t at = offset(scratch, view, (gsize)first);
    guint64 hash = 0;
    for (gsize i = 0; i < all; i += PIECE) {
        const gsize part = MIN(PIECE, all - i);
        exr_half_from_floats(halves, values + i, part);
        if (ret_hash)
            hash = XXH3_64bits_withSeed(halves, part * sizeof *halves, hash);
        if (!transfer(scratch->fd, TRUE, (guint8 *)halves, part * sizeof *halves, at))
            return io_error(error, "writing");
        at += (off_t)(part * sizeof *halves);
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
    off_t at = offset(scratch, view, (gsize)first);
    for (gsize i = 0; i < all; i += PIECE) {
        const gsize part = MIN(PIECE, all - i);
        if (!transfer(scratch->fd, FALSE, (guint8 *)halves, part * sizeof *halves, at))
            return io_error(error, "reading");
        exr_half_to_floats(ret + i, halves, part);
        at += (off_t)(part * sizeof *halves);
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
        if (!transfer(scratch->fd, FALSE, (guint8 *)halves, (gsize)rows * row * sizeof *halves,
                      offset(scratch, view, (gsize)first + (gsize)i)))
            return io_error(error, "reading");
        for (int j = 0; j < rows; j++)
            exr_half_to_floats(ret + (gsize)indices[i + j] * row, halves + (gsize)j * row, row);
    }
    return TRUE;
}

guint64 btf_scratch_hash(const struct btf_scratch *scratch, int view) {
    return scratch->hashes[view];
}
