#include "input_file.h"

#include <errno.h>
#include <fcntl.h>
#include <gio/gio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define LEASE_US      (60 * G_USEC_PER_SEC)
#define LEASE_POLL_US 10000

#define AT_ONCE ((gsize)1 << 20) /* minimum number of bytes by which a buffer grows */

G_DEFINE_QUARK(input_file_error, input_file_error)

/* Sets the error. Always returns FALSE. */
static gboolean G_GNUC_PRINTF(4, 5) input_file_fail(const char *path, enum input_file_error code,
                                                    GError **error, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    g_autofree char *what = g_strdup_vprintf(format, arguments);
    va_end(arguments);
    g_set_error(error, INPUT_FILE_ERROR, (int)code, "cannot read %s: %s", path, what);
    return FALSE;
}

static void input_file_fail_errno(const char *path, int number, GError **error) {
    struct stat link;
    const gboolean dangling = number == ENOENT && lstat(path, &link) == 0 && S_ISLNK(link.st_mode);
    g_set_error(error, G_FILE_ERROR, (int)g_file_error_from_errno(number), "cannot read %s: %s%s",
                path, g_strerror(number),
                dangling ? ": it is a symbolic link to a file that does not exist" : "");
}

void input_file_propagate(GError *from, GQuark domain, int io, int unfit, GError **error) {
    if (from->domain == INPUT_FILE_ERROR || io >= 0) {
        g_set_error_literal(error, domain, from->domain == INPUT_FILE_ERROR ? unfit : io,
                            from->message);
        g_error_free(from);
    } else {
        g_propagate_error(error, from);
    }
}

const char *input_file_kind(mode_t mode) {
    static const struct {
        mode_t kind;
        const char *name;
    } kinds[] = {{S_IFIFO, "a FIFO"},         {S_IFCHR, "a character device"},
                 {S_IFBLK, "a block device"}, {S_IFDIR, "a directory"},
                 {S_IFSOCK, "a socket"},      {S_IFLNK, "a symbolic link"},
                 {S_IFREG, "a regular file"}};
    for (gsize i = 0; i < G_N_ELEMENTS(kinds); i++)
        if ((mode & S_IFMT) == kinds[i].kind)
            return kinds[i].name;
    return "something unknown";
}

static gboolean check_status(const char *path, const struct stat *status, guint64 max_bytes,
                             GError **error) {
    if (!S_ISREG(status->st_mode))
        return input_file_fail(path, INPUT_FILE_ERROR_KIND, error,
                               "it is %s, not a regular file; give the path of a file",
                               input_file_kind(status->st_mode));
    return (guint64)status->st_size <= max_bytes ||
           input_file_fail(path, INPUT_FILE_ERROR_TOO_LARGE, error,
                           "it has %" G_GUINT64_FORMAT
                           " bytes, more than the limit of %" G_GUINT64_FORMAT
                           "; give a smaller file",
                           (guint64)status->st_size, max_bytes);
}

/* Examines the file before it is opened, because opening some devices has side effects. Examines it
 * again afterwards, because the name may then refer to another file. */
int input_file_open(const char *path, guint64 max_bytes, guint64 *ret_bytes, GError **error) {
    struct stat status;
    if (stat(path, &status) != 0) {
        input_file_fail_errno(path, errno, error);
        return -1;
    }
    if (!check_status(path, &status, max_bytes, error))
        return -1;
    /* Another program, such as a file server, may hold a lease on the file. A blocking open() would
     * wait until the lease is given back, at most /proc/sys/fs/lease-break-time, 45 s. This open()
     * does not block, and is repeated. */
    const gint64 until_us = g_get_monotonic_time() + LEASE_US;
    int fd;
    while ((fd = open(path, O_RDONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC)) < 0 &&
           errno == EWOULDBLOCK && g_get_monotonic_time() < until_us)
        g_usleep(LEASE_POLL_US);
    if (fd < 0 || fstat(fd, &status) != 0) {
        input_file_fail_errno(path, errno, error);
    } else if (check_status(path, &status, max_bytes, error)) {
        if (ret_bytes)
            *ret_bytes = (guint64)status.st_size;
        return fd;
    }
    if (fd >= 0)
        close(fd);
    return -1;
}

/* Reads until the end of the file, appends a NUL, and sets *ret_length. The length may differ from
 * expected: files of /proc and /sys report a length of 0, and other files may grow. */
static char *input_file_read_all(int fd, const char *path, gsize expected, gsize max_bytes,
                                 gsize *ret_length, GError **error) {
    gsize length = 0, room = MIN(expected, max_bytes) + 1;
    g_autofree char *text = g_try_malloc(room + 1);
    while (text) {
        const gssize n = read(fd, text + length, room - length);
        if (n < 0 && errno == EINTR)
            continue;
        if (n < 0) {
            input_file_fail_errno(path, errno, error);
            return NULL;
        }
        length += (gsize)n;
        if (length > max_bytes) {
            input_file_fail(path, INPUT_FILE_ERROR_TOO_LARGE, error,
                            "it has more than %" G_GSIZE_FORMAT
                            " bytes, the limit for such a file; give a smaller file",
                            max_bytes);
            return NULL;
        }
        if (n == 0) {
            text[length] = '\0';
            *ret_length = length;
            return g_steal_pointer(&text);
        }
        if (length == room) {
            room = MIN(room + MAX(room, AT_ONCE), max_bytes + 1);
            char *larger = g_try_realloc(text, room + 1);
            if (!larger)
                g_free(text);
            text = larger;
        }
    }
    input_file_fail_errno(path, ENOMEM, error);
    return NULL;
}

char *input_file_read(const char *path, gsize max_bytes, gsize *ret_length, GError **error) {
    guint64 bytes;
    gsize length = 0;
    const int fd = input_file_open(path, max_bytes, &bytes, error);
    if (fd < 0)
        return NULL;
    char *text = input_file_read_all(fd, path, (gsize)bytes, max_bytes, &length, error);
    close(fd);
    if (ret_length)
        *ret_length = length;
    return text;
}

gboolean input_file_is_utf16(const char *text, gsize length) {
    const guint8 *bytes = (const guint8 *)text;
    if (length < 2)
        return FALSE;
    /* The files that are read here begin with ASCII. In UTF-16 without a byte-order mark, one of
     * the bytes of the first two letters is therefore 0. */
    return (bytes[0] == 0xff && bytes[1] == 0xfe) || (bytes[0] == 0xfe && bytes[1] == 0xff) ||
           (bytes[0] == 0) != (bytes[1] == 0);
}

char *input_file_read_text(const char *path, gsize max_bytes, GError **error) {
    gsize length;
    g_autofree char *text = input_file_read(path, max_bytes, &length, error);
    if (text && input_file_is_utf16(text, length)) {
        input_file_fail(path, INPUT_FILE_ERROR_TEXT, error, INPUT_FILE_UTF16);
        return NULL;
    }
    if (text && g_str_has_prefix(text, INPUT_FILE_MARK)) {
        length -= strlen(INPUT_FILE_MARK);
        memmove(text, text + strlen(INPUT_FILE_MARK), length + 1);
    }
    if (!text || strlen(text) == length)
        return g_steal_pointer(&text);
    input_file_fail(path, INPUT_FILE_ERROR_TEXT, error,
                    "it is not a text file: byte %" G_GSIZE_FORMAT
                    ", counted from 0, is 0; give a text file",
                    strlen(text));
    return NULL;
}

gboolean input_file_read_at(int fd, const char *path, gpointer to, gsize n, guint64 offset,
                            GError **error) {
    for (gsize done = 0; done < n;) {
        const gssize got = pread(fd, (guint8 *)to + done, n - done, (off_t)(offset + done));
        if (got < 0 && errno == EINTR)
            continue;
        if (got < 0) {
            input_file_fail_errno(path, errno, error);
            return FALSE;
        }
        if (got == 0)
            return input_file_fail(
                path, INPUT_FILE_ERROR_CUT, error,
                "it has become shorter while it was read: it ends before byte %" G_GUINT64_FORMAT
                "; try again when no other program writes it",
                offset + n);
        done += (gsize)got;
    }
    return TRUE;
}

guint64 input_file_memory(guint64 file_bytes) {
    return MAX(INPUT_FILE_MEMORY, INPUT_FILE_MEMORY_PER_BYTE * file_bytes);
}

gboolean input_file_check_pixels(const char *path, guint64 width, guint64 height,
                                 guint64 file_bytes, GError **error) {
    const guint64 most = MAX((guint64)INPUT_FILE_PIXELS, INPUT_FILE_PIXELS_PER_BYTE * file_bytes);
    return width == 0 || height <= most / width ||
           input_file_fail(path, INPUT_FILE_ERROR_TOO_LARGE, error,
                           "its header announces a picture of %" G_GUINT64_FORMAT
                           " × %" G_GUINT64_FORMAT " pixels, but a file of %" G_GUINT64_FORMAT
                           " bytes may have at most %" G_GUINT64_FORMAT
                           " pixels; save it smaller, or without compression",
                           width, height, file_bytes, most);
}
