#include "scratch_file.h"

#include <errno.h>
#include <fcntl.h>
#include <gio/gio.h>
#include <unistd.h>

struct ScratchFile {
    int fd;
    const char *content;
};

ScratchFile *scratch_file_new(const char *folder, guint64 bytes, const char *content,
                              GError **error) {
    int fd = open(folder, O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
    if (fd < 0)
        fd = open(folder = g_get_tmp_dir(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
    if (fd < 0 || (errno = posix_fallocate(fd, 0, (off_t)bytes)) != 0) {
        const int code = errno;
        g_autofree char *size = g_format_size(bytes);
        g_set_error(error, G_FILE_ERROR, g_file_error_from_errno(code),
                    "%s: no temporary file of %s can be made in this folder for %s: %s; free some "
                    "space there, or give a larger --memory if the command has this option",
                    folder, size, content, g_strerror(code));
        if (fd >= 0)
            close(fd);
        return NULL;
    }
    ScratchFile *file = g_new(ScratchFile, 1);
    *file = (ScratchFile){fd, content};
    return file;
}

void scratch_file_free(ScratchFile *file) {
    if (!file)
        return;
    close(file->fd);
    g_free(file);
}

/* Sets an error from errno. `what` is "reading" or "writing". Returns FALSE. */
static gboolean fail(const ScratchFile *file, const char *what, GError **error) {
    const int code = errno;
    g_set_error(error, G_FILE_ERROR, g_file_error_from_errno(code),
                "%s the temporary file for %s failed: %s; check the disk of the session, and that "
                "of %s, which is used if the file cannot be made in the session",
                what, file->content, g_strerror(code), g_get_tmp_dir());
    return FALSE;
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

gboolean scratch_file_read(const ScratchFile *file, guint64 at, gpointer ret, gsize n,
                           GError **error) {
    return transfer(file->fd, FALSE, ret, n, (off_t)at) || fail(file, "reading", error);
}

gboolean scratch_file_write(const ScratchFile *file, guint64 at, gconstpointer bytes, gsize n,
                            GError **error) {
    return transfer(file->fd, TRUE, (guint8 *)bytes, n, (off_t)at) || fail(file, "writing", error);
}
