#include "new_file.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define END      ".part"
#define DIGITS   8
#define MAX_NAME 200 /* maximum number of bytes of the final name in the name of the .part file */
#define TRIES    100

/* Opens the folder that contains relative, a path below directory. If all is TRUE, opens relative
 * itself, which is then a folder. Returns −1 and sets errno on failure. */
static int open_folder(const char *directory, const char *relative, gboolean all) {
    g_auto(GStrv) parts = g_strsplit(relative, "/", -1);
    int folder = open(directory, O_RDONLY | O_DIRECTORY | O_CLOEXEC);

    for (char **part = parts; folder >= 0 && *part && (all || part[1]); part++) {
        const int next = openat(folder, *part, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
        const int saved = errno;

        close(folder);
        errno = saved;
        folder = next;
    }
    return folder;
}

static void clear(struct new_file *file) {
    const int saved = errno;

    if (file->fd >= 0)
        close(file->fd);
    if (file->folder >= 0)
        close(file->folder);
    g_clear_pointer(&file->name, g_free);
    g_clear_pointer(&file->beside, g_free);
    errno = saved;
}

gboolean new_file_begin(struct new_file *file, const char *directory, const char *relative) {
    const char *slash = strrchr(relative, '/');

    *file = (struct new_file){open_folder(directory, relative, FALSE), -1,
                              g_strdup(slash ? slash + 1 : relative), NULL};
    for (int i = 0; file->folder >= 0 && file->fd < 0 && i < TRIES; i++) {
        g_free(file->beside);
        file->beside = g_strdup_printf("%.*s.%08x" END, MAX_NAME, file->name, g_random_int());
        file->fd = openat(file->folder, file->beside,
                          O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0666);
        if (file->fd < 0 && errno != EEXIST)
            break;
    }
    if (file->fd >= 0)
        return TRUE;
    clear(file);
    return FALSE;
}

gboolean new_file_write(int fd, const void *bytes, gsize n) {
    const char *from = bytes;

    while (n > 0) {
        const gssize done = write(fd, from, n);

        if (done < 0 && errno == EINTR)
            continue;
        if (done <= 0)
            return FALSE;
        from += done;
        n -= (gsize)done;
    }
    return TRUE;
}

gboolean new_file_reserve(const struct new_file *file, gsize n) {
    if (fallocate(file->fd, 0, 0, (off_t)n) == 0)
        return TRUE;
    return (errno == EOPNOTSUPP || errno == ENOSYS) && ftruncate(file->fd, (off_t)n) == 0;
}

gboolean new_file_put(const struct new_file *file, const void *bytes, gsize n) {
    return new_file_write(file->fd, bytes, n);
}

/* Returns TRUE if the name is free or belongs to a file, link or folder. Otherwise sets errno to
 * EEXIST and returns FALSE, because a device, a pipe or a socket is never replaced. */
static gboolean may_replace(const struct new_file *file) {
    struct stat status;

    if (fstatat(file->folder, file->name, &status, AT_SYMLINK_NOFOLLOW) != 0 ||
        S_ISREG(status.st_mode) || S_ISLNK(status.st_mode) || S_ISDIR(status.st_mode))
        return TRUE;
    errno = EEXIST;
    return FALSE;
}

gboolean new_file_commit(struct new_file *file, gboolean sync) {
    gboolean ok = !sync || fsync(file->fd) == 0;

    if (ok) {
        ok = close(file->fd) == 0;
        file->fd = -1;
    }
    ok = ok && may_replace(file) &&
         renameat(file->folder, file->beside, file->folder, file->name) == 0;
    if (!ok) {
        new_file_abandon(file);
        return FALSE;
    }
    ok = !sync || fsync(file->folder) == 0;
    clear(file);
    return ok;
}

void new_file_abandon(struct new_file *file) {
    const int saved = errno;

    unlinkat(file->folder, file->beside, 0);
    errno = saved;
    clear(file);
}

/* Removes an unfinished file, or a folder of output_file.h with the unfinished file in it. */
static void remove_part(int folder, const char *name) {
    if (unlinkat(folder, name, 0) == 0 || (errno != EISDIR && errno != EPERM))
        return;
    const int fd = openat(folder, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
    DIR *dir = fd >= 0 ? fdopendir(fd) : NULL;

    for (const struct dirent *entry; dir && (entry = readdir(dir));)
        unlinkat(dirfd(dir), entry->d_name, 0);
    if (dir)
        closedir(dir);
    unlinkat(folder, name, AT_REMOVEDIR);
}

void new_file_remove_left(const char *directory, const char *folder, const char *prefix) {
    const int fd = open_folder(directory, folder, TRUE);
    DIR *dir = fd >= 0 ? fdopendir(fd) : NULL;

    if (fd >= 0 && !dir)
        close(fd);
    for (const struct dirent *entry; dir && (entry = readdir(dir));) {
        const char *name = entry->d_name;
        const gsize n = strlen(name), end = DIGITS + strlen(END);

        if (g_str_has_prefix(name, prefix) && g_str_has_suffix(name, END) && n > end + 1 &&
            name[n - end - 1] == '.' && strspn(name + n - end, "0123456789abcdef") == DIGITS)
            remove_part(dirfd(dir), name);
    }
    if (dir)
        closedir(dir);
}
