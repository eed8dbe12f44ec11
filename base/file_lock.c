#include "file_lock.h"

#include "new_file.h"

#include <errno.h>
#include <fcntl.h>
#include <gio/gio.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

/* Reads the process number of the holder from the lock file. Waits up to 1 s for it, because a
 * process that has just taken the lock writes its number a moment later. Returns 0 if the file
 * still contains no number then. */
static glong read_holder(int fd) {
    const gint64 until_us = g_get_monotonic_time() + G_USEC_PER_SEC;
    glong holder = 0;

    while (holder == 0 && g_get_monotonic_time() < until_us) {
        char text[32] = "";

        if (pread(fd, text, sizeof text - 1, 0) > 0)
            holder = strtol(text, NULL, 10);
        if (holder == 0)
            g_usleep(1000);
    }
    return holder;
}

static int fail(const char *path, int fd, int saved, const char *what, GError **error) {
    if (fd >= 0 && (saved == EAGAIN || saved == EACCES)) {
        const long holder = read_holder(fd);
        g_autofree char *process =
            holder > 0 ? g_strdup_printf("process %ld", holder) : g_strdup("another process");
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_BUSY,
                    "%s: %s is writing %s; wait until that process has ended", path, process, what);
    } else
        g_set_error(error, G_IO_ERROR, (int)g_io_error_from_errno(saved),
                    "%s: the lock file cannot be made or locked: %s; check that you may write in "
                    "its folder",
                    path, g_strerror(saved));
    if (fd >= 0)
        close(fd);
    return -1;
}

int file_lock_take(const char *path, const char *what, GError **error) {
    for (;;) {
        struct flock whole = {.l_type = F_WRLCK, .l_whence = SEEK_SET};
        const int fd = open(path, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK, 0666);
        struct stat opened, named;

        if (fd < 0 || fcntl(fd, F_OFD_SETLK, &whole) != 0)
            return fail(path, fd, errno, what, error);
        /* The previous holder may have removed the file after it was opened here. A lock on a
         * removed file excludes nobody, so the file is opened again. */
        if (fstat(fd, &opened) == 0 && lstat(path, &named) == 0 && opened.st_dev == named.st_dev &&
            opened.st_ino == named.st_ino) {
            if (ftruncate(fd, 0) != 0 || dprintf(fd, "%ld\n", (long)getpid()) < 0)
                /* The lock is valid without the number, which is only used in messages. */
                g_debug("%s: %s", path, g_strerror(errno));
            return fd;
        }
        close(fd);
    }
}

int file_lock_take_output(const char *path, char **ret_lock, GError **error) {
    g_autofree char *folder = g_path_get_dirname(path), *name = g_path_get_basename(path);
    g_autofree char *prefix = g_strconcat(name, ".", NULL);
    *ret_lock = g_strconcat(path, ".lock", NULL);
    const int lock = file_lock_take(*ret_lock, path, error);
    if (lock >= 0)
        new_file_remove_left(folder, "", prefix);
    return lock;
}

void file_lock_give(int lock, const char *path) {
    if (lock < 0)
        return;
    unlink(path);
    close(lock);
}

gboolean file_lock_is_held(const char *path) {
    struct flock whole = {.l_type = F_WRLCK, .l_whence = SEEK_SET};
    const int fd = open(path, O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    const gboolean held = fd >= 0 && fcntl(fd, F_OFD_GETLK, &whole) == 0 && whole.l_type != F_UNLCK;

    if (fd >= 0)
        close(fd);
    return held;
}
