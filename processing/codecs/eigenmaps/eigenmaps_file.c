/* Keeps the maps of large eigen-maps in an unnamed file (O_TMPFILE) as floats. */
#include "eigenmaps_private.h"

#include <errno.h>
#include <fcntl.h>
#include <unistd.h>

struct eigenmaps_file {
    int fd;
};

static gboolean fail(GError **error, const char *what) {
    const int code = errno;
    g_set_error(error, G_FILE_ERROR, g_file_error_from_errno(code),
                "%s the temporary file for the eigen-maps failed: %s; check the disk of the "
                "session, and that of %s, which is used if the session is not writable",
                what, g_strerror(code), g_get_tmp_dir());
    return FALSE;
}

struct eigenmaps_file *eigenmaps_file_new(const char *folder, gsize n, GError **error) {
    const off_t bytes = (off_t)(n * sizeof(float));
    int fd = open(folder, O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
    if (fd < 0)
        fd = open(folder = g_get_tmp_dir(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
    if (fd < 0 || (errno = posix_fallocate(fd, 0, bytes)) != 0) {
        const int code = errno;
        g_autofree char *size = g_format_size((guint64)bytes);
        g_set_error(error, G_FILE_ERROR, g_file_error_from_errno(code),
                    "%s: no temporary file of %s can be made here for the eigen-maps: %s; free "
                    "some space or raise the limit of memory",
                    folder, size, g_strerror(code));
        if (fd >= 0)
            close(fd);
        return NULL;
    }
    struct eigenmaps_file *file = g_new(struct eigenmaps_file, 1);
    file->fd = fd;
    return file;
}

void eigenmaps_file_free(struct eigenmaps_file *file) {
    if (!file)
        return;
    close(file->fd);
    g_free(file);
}

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

gboolean eigenmaps_file_read(const struct eigenmaps_file *file, gsize at, gsize n, float *ret,
                             GError **error) {
    return transfer(file->fd, FALSE, (guint8 *)ret, n * sizeof *ret, (off_t)(at * sizeof *ret)) ||
           fail(error, "reading");
}

gboolean eigenmaps_file_write(struct eigenmaps_file *file, gsize at, gsize n, const float *values,
                              GError **error) {
    return transfer(file->fd, TRUE, (guint8 *)values, n * sizeof *values,
                    (off_t)(at * sizeof *values)) ||
           fail(error, "writing");
}
