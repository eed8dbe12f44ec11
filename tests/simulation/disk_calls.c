/* The calls of the C library that the simulated disk sees. Each is the library's own, found with
 * dlsym(), with a decision before it and an entry of the journal after it. */
#include "disk.h"

#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#define MAX_FDS            1024
#define WALL_BEGINS_S      1767225600 /* 2026-01-01 */
#define MONOTONIC_BEGINS_S 1000000000 /* later than any kernel's */

static struct disk *disk;
static const Clock *disk_clock; /* the rig's; NULL: there is none */
static pthread_mutex_t disk_lock = PTHREAD_MUTEX_INITIALIZER;
static gboolean watched[MAX_FDS]; /* by descriptor: a file or folder of the disk */

#define REAL(name, type)                                                                           \
    static type real;                                                                              \
    if (!real)                                                                                     \
    *(void **)&real = dlsym(RTLD_NEXT, name)

void disk_use(struct disk *used) {
    pthread_mutex_lock(&disk_lock);
    disk = used;
    memset(watched, 0, sizeof watched);
    pthread_mutex_unlock(&disk_lock);
}

void disk_set_clock(const Clock *clock) {
    disk_clock = clock;
}

/* What another thread reads while the clock stands. */
static gint64 disk_now_us(const struct disk *of) {
    return disk_clock ? clock_now_us(disk_clock) : of->ended_us;
}

static void digest(struct disk *to, const char *text) {
    for (; *text; text++)
        to->digest = (to->digest ^ (guint8)*text) * 0x100000001b3u;
}

static void hide_six(char *text, const char *before) {
    for (char *at = strstr(text, before); at; at = strstr(at + 1, before))
        for (int i = 0; i < 6 && at[strlen(before) + i]; i++)
            at[strlen(before) + i] = '?';
}

/* Hides what is random in names: "000001_cam30.exr.0123abcd.part", ".small.session.7fA2xb",
 * "control.7FA2XB". */
static void hide_random(char *text) {
    for (char *part = strstr(text, ".part"); part; part = strstr(part + 1, ".part"))
        if (part - text > 8)
            memset(part - 8, '?', 8);
    hide_six(text, ".session.");
    hide_six(text, "/control.");
}

char *disk_neutral(const struct disk *of, const char *text) {
    static const char id[] = "(process ";
    const gsize n = strlen(of->root);
    GString *to = g_string_new(NULL);
    while (*text) {
        if (n > 0 && strncmp(text, of->root, n) == 0) {
            g_string_append(to, "DISK");
            text += n;
        } else if (g_str_has_prefix(text, id)) {
            g_string_append_printf(to, "%sN", id);
            for (text += strlen(id); g_ascii_isdigit(*text);)
                text++;
        } else {
            g_string_append_c(to, *text++);
        }
    }
    hide_random(to->str);
    return g_string_free(to, FALSE);
}

void disk_say(struct disk *to, const char *format, ...) {
    va_list args;
    va_start(args, format);
    g_autofree char *text = g_strdup_vprintf(format, args);
    va_end(args);
    g_autofree char *neutral = disk_neutral(to, text);
    g_autofree char *line =
        g_strdup_printf("  %9.3f s: %s\n", (double)disk_now_us(to) * 1e-6, neutral);
    const gsize n = strlen(line);
    pthread_mutex_lock(&disk_lock);
    digest(to, line);
    if (to->n_said + n < sizeof to->said) {
        memcpy(to->said + to->n_said, line, n);
        to->n_said += n;
    }
    pthread_mutex_unlock(&disk_lock);
}

void disk_kill(struct disk *of, gboolean cut) {
    of->cut = cut;
    of->ended_us = disk_now_us(of);
    for (;;)
        kill(getpid(), SIGKILL);
}

/* Below the disk's folder, or the folder itself. */
static gboolean is_inside(const char *path) {
    const gsize n = strlen(disk->root);
    return strncmp(path, disk->root, n) == 0 && (path[n] == '/' || !path[n]);
}

static gboolean find_path(int folder, const char *name, char ret[PATH_MAX]) {
    if (!disk || !disk->active)
        return FALSE;
    if (*name == '/') {
        g_strlcpy(ret, name, PATH_MAX);
    } else {
        char link[64];
        g_snprintf(link, sizeof link, folder == AT_FDCWD ? "/proc/self/cwd" : "/proc/self/fd/%d",
                   folder);
        const ssize_t n = readlink(link, ret, PATH_MAX - 1);
        if (n < 0 || (gsize)n + strlen(name) + 2 > PATH_MAX)
            return FALSE;
        ret[n] = '/';
        strcpy(ret + n + 1, name);
    }
    return is_inside(ret);
}

static gboolean is_watched(int fd) {
    return disk && disk->active && fd >= 0 && fd < MAX_FDS && watched[fd];
}

static void note_call(enum disk_kind kind, const char *path) {
    char name[PATH_MAX];
    g_strlcpy(name, path + strlen(disk->root), sizeof name);
    hide_random(name);
    digest(disk, schedule_disk_kind(kind));
    digest(disk, name);
}

static void path_of(int fd, char ret[PATH_MAX]) {
    char link[64];
    g_snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    const ssize_t n = readlink(link, ret, PATH_MAX - 1);
    ret[MAX(n, 0)] = '\0';
}

static gboolean takes_space(enum disk_kind kind) {
    return kind == DISK_WRITE || kind == DISK_OPEN || kind == DISK_FOLDER || kind == DISK_TRUNCATE;
}

/* Counts a call and decides about it; the lock is held. 0, or the errno with which it fails;
 * *ret_short: half of it is done. */
static int decide(enum disk_kind kind, const char *path, gboolean creates, gboolean *ret_short) {
    int code = 0;
    disk->full = FALSE;
    disk->calls[kind]++;
    disk->calls[DISK_ANY]++;
    note_call(kind, path);
    for (int i = 0; i < disk->n_faults; i++) {
        const struct disk_fault *fault = &disk->faults[i];
        const int n = disk->calls[fault->kind];
        const gboolean lasts = n >= fault->at && n < fault->at + fault->calls;
        disk->full |= fault->action == DISK_FULL && lasts;
        if (!lasts || (fault->kind != DISK_ANY && fault->kind != kind))
            continue;
        if (fault->action == DISK_KILL || fault->action == DISK_CUT)
            disk_kill(disk, fault->action == DISK_CUT);
        if (fault->action == DISK_FAILS)
            code = EIO;
        else if (fault->action == DISK_FULL && takes_space(kind) && creates)
            code = ENOSPC;
        else if (fault->action == DISK_SHORT && kind == DISK_WRITE)
            *ret_short = TRUE;
    }
    disk->n_failed += code != 0 || disk->full || (ret_short && *ret_short);
    return code;
}

static void journal_add(int kind, guint64 inode, const char *name, const char *other,
                        const void *data, gsize n_data, gint64 offset) {
    const gsize n_name = name ? strlen(name) : 0, n_other = other ? strlen(other) : 0;
    const gsize bytes = (sizeof(struct disk_entry) + n_name + n_other + n_data + 7) / 8 * 8;
    if (disk->n_journal + bytes > DISK_JOURNAL_BYTES) {
        static const char told[] = "simulate: the journal of a simulated disk is full\n";
        syscall(SYS_write, STDERR_FILENO, told, sizeof told - 1);
        abort();
    }
    guint8 *to = (guint8 *)disk->journal + disk->n_journal;
    *(struct disk_entry *)(gpointer)to = (struct disk_entry){.bytes = bytes,
                                                             .kind = kind,
                                                             .inode = inode,
                                                             .offset = offset,
                                                             .n_name = n_name,
                                                             .n_other = n_other,
                                                             .n_data = n_data};
    to += sizeof(struct disk_entry);
    if (n_name > 0)
        memcpy(to, name, n_name);
    if (n_other > 0)
        memcpy(to + n_name, other, n_other);
    if (n_data > 0)
        memcpy(to + n_name + n_other, data, n_data);
    disk->n_journal += bytes;
}

static guint64 inode_of(int fd) {
    struct stat status;
    return fstat(fd, &status) == 0 ? status.st_ino : 0;
}

static const char *relative(const char *path) {
    const char *at = path + strlen(disk->root);
    return *at == '/' ? at + 1 : at;
}

/* open() and its like; of the real function only what differs is passed. */
static int open_watched(int folder, const char *name, int flags, mode_t mode) {
    typedef int (*Openat)(int, const char *, int, ...);
    REAL("openat", Openat);
    char path[PATH_MAX];
    if (!find_path(folder, name, path))
        return real(folder, name, flags, mode);
    pthread_mutex_lock(&disk_lock);
    struct stat status;
    const gboolean existed = fstatat(AT_FDCWD, path, &status, AT_SYMLINK_NOFOLLOW) == 0;
    const gboolean makes = (flags & O_CREAT) && !existed;
    const int code = decide(DISK_OPEN, path, makes, NULL);
    int fd = -1;
    if (code == 0)
        fd = real(folder, name, flags, mode);
    else
        errno = code;
    const int saved = errno;
    if (fd >= 0 && fd < MAX_FDS)
        watched[fd] = TRUE;
    if (fd >= 0 && makes)
        journal_add(ENTRY_FILE, inode_of(fd), relative(path), NULL, NULL, 0, 0);
    else if (fd >= 0 && (flags & O_TRUNC))
        journal_add(ENTRY_SIZE, inode_of(fd), NULL, NULL, NULL, 0, 0);
    pthread_mutex_unlock(&disk_lock);
    errno = saved;
    return fd;
}

static mode_t mode_from(int flags, va_list args) {
    return (flags & O_CREAT) ? (mode_t)va_arg(args, unsigned) : 0;
}

#define DEFINE_OPEN(name, open_folder)                                                             \
    int name(const char *path, int flags, ...) {                                                   \
        va_list args;                                                                              \
        va_start(args, flags);                                                                     \
        const mode_t mode = mode_from(flags, args);                                                \
        va_end(args);                                                                              \
        return open_watched(open_folder, path, flags, mode);                                       \
    }
DEFINE_OPEN(open, AT_FDCWD)
DEFINE_OPEN(open64, AT_FDCWD)

#define DEFINE_OPENAT(name)                                                                        \
    int name(int folder, const char *path, int flags, ...) {                                       \
        va_list args;                                                                              \
        va_start(args, flags);                                                                     \
        const mode_t mode = mode_from(flags, args);                                                \
        va_end(args);                                                                              \
        return open_watched(folder, path, flags, mode);                                            \
    }
DEFINE_OPENAT(openat)
DEFINE_OPENAT(openat64)

int close(int fd) {
    typedef int (*Close)(int);
    REAL("close", Close);
    if (fd >= 0 && fd < MAX_FDS)
        watched[fd] = FALSE;
    return real(fd);
}

/* offset −1: where the descriptor stands. */
static ssize_t write_watched(int fd, const void *data, size_t n, off_t offset) {
    typedef ssize_t (*Write)(int, const void *, size_t);
    typedef ssize_t (*Pwrite)(int, const void *, size_t, off_t);
    static Write real_write;
    static Pwrite real_pwrite;
    if (!real_write) {
        *(void **)&real_pwrite = dlsym(RTLD_NEXT, "pwrite");
        *(void **)&real_write = dlsym(RTLD_NEXT, "write");
    }
    if (!is_watched(fd))
        return offset < 0 ? real_write(fd, data, n) : real_pwrite(fd, data, n, offset);
    pthread_mutex_lock(&disk_lock);
    char path[PATH_MAX];
    gboolean is_short = FALSE;
    path_of(fd, path);
    const int code = decide(DISK_WRITE, path, TRUE, &is_short);
    if (is_short && n > 1)
        n /= 2;
    const off_t at = offset < 0 ? lseek(fd, 0, SEEK_CUR) : offset;
    ssize_t done = -1;
    if (code == 0)
        done = offset < 0 ? real_write(fd, data, n) : real_pwrite(fd, data, n, offset);
    else
        errno = code;
    const int saved = errno;
    if (done > 0)
        journal_add(ENTRY_WRITE, inode_of(fd), NULL, NULL, data, (gsize)done, at);
    pthread_mutex_unlock(&disk_lock);
    errno = saved;
    return done;
}

ssize_t write(int fd, const void *data, size_t n) {
    return write_watched(fd, data, n, -1);
}

ssize_t pwrite(int fd, const void *data, size_t n, off_t offset) {
    return write_watched(fd, data, n, offset);
}

ssize_t pwrite64(int fd, const void *data, size_t n, off64_t offset) {
    return write_watched(fd, data, n, offset);
}

/* The library's own does not go through write(). */
int dprintf(int fd, const char *format, ...) {
    va_list args;
    va_start(args, format);
    g_autofree char *text = g_strdup_vprintf(format, args);
    va_end(args);
    return (int)write(fd, text, strlen(text));
}

/* Whether a call on a descriptor is to fail, with errno set. */
static gboolean fails(int fd, enum disk_kind kind) {
    if (!is_watched(fd))
        return FALSE;
    pthread_mutex_lock(&disk_lock);
    char path[PATH_MAX];
    path_of(fd, path);
    const int code = decide(kind, path, FALSE, NULL);
    pthread_mutex_unlock(&disk_lock);
    if (code != 0)
        errno = code;
    return code != 0;
}

ssize_t read(int fd, void *data, size_t n) {
    typedef ssize_t (*Read)(int, void *, size_t);
    REAL("read", Read);
    return fails(fd, DISK_READ) ? -1 : real(fd, data, n);
}

#define DEFINE_PREAD(name, offset_type)                                                            \
    ssize_t name(int fd, void *data, size_t n, offset_type offset) {                               \
        typedef ssize_t (*Pread)(int, void *, size_t, offset_type);                                \
        REAL(#name, Pread);                                                                        \
        return fails(fd, DISK_READ) ? -1 : real(fd, data, n, offset);                              \
    }
DEFINE_PREAD(pread, off_t)
DEFINE_PREAD(pread64, off64_t)

static int sync_watched(int fd, int (*real)(int)) {
    if (!is_watched(fd))
        return real(fd);
    pthread_mutex_lock(&disk_lock);
    char path[PATH_MAX];
    path_of(fd, path);
    const int code = decide(DISK_SYNC, path, FALSE, NULL);
    journal_add(code ? ENTRY_SYNC_FAILED : ENTRY_SYNC, inode_of(fd), NULL, NULL, NULL, 0, 0);
    pthread_mutex_unlock(&disk_lock);
    if (code == 0)
        return 0;
    errno = code;
    return -1;
}

int fsync(int fd) {
    typedef int (*Sync)(int);
    REAL("fsync", Sync);
    return sync_watched(fd, real);
}

int fdatasync(int fd) {
    typedef int (*Sync)(int);
    REAL("fdatasync", Sync);
    return sync_watched(fd, real);
}

static int truncate_watched(int fd, off_t size, int (*real)(int, off_t)) {
    if (!is_watched(fd))
        return real(fd, size);
    pthread_mutex_lock(&disk_lock);
    char path[PATH_MAX];
    path_of(fd, path);
    const int code = decide(DISK_TRUNCATE, path, TRUE, NULL);
    int result = -1;
    if (code == 0)
        result = real(fd, size);
    else
        errno = code;
    const int saved = errno;
    if (result == 0)
        journal_add(ENTRY_SIZE, inode_of(fd), NULL, NULL, NULL, 0, size);
    pthread_mutex_unlock(&disk_lock);
    errno = saved;
    return result;
}

int ftruncate(int fd, off_t size) {
    typedef int (*Truncate)(int, off_t);
    REAL("ftruncate", Truncate);
    return truncate_watched(fd, size, real);
}

int ftruncate64(int fd, off64_t size) {
    return ftruncate(fd, size);
}

/* A change of names, made by the system call itself. to: NULL for all but a renaming. */
static int change_name(enum disk_kind kind, int from_folder, const char *from, int to_folder,
                       const char *to, long number, long third) {
    char path[PATH_MAX], other[PATH_MAX];
    const gboolean inside = find_path(from_folder, from, path);
    if (to)
        find_path(to_folder, to, other);
    if (inside)
        pthread_mutex_lock(&disk_lock);
    const int code = inside ? decide(kind, path, kind == DISK_FOLDER, NULL) : 0;
    long result = -1;
    if (code == 0)
        result = to ? syscall(number, from_folder, from, to_folder, to, third)
                    : syscall(number, from_folder, from, third);
    else
        errno = code;
    const int saved = errno;
    if (result == 0 && inside) {
        struct stat status = {0};
        if (kind == DISK_FOLDER)
            fstatat(AT_FDCWD, path, &status, AT_SYMLINK_NOFOLLOW);
        journal_add(kind == DISK_FOLDER ? (int)ENTRY_FOLDER
                    : to                ? (int)ENTRY_RENAME
                                        : (int)ENTRY_REMOVE,
                    status.st_ino, relative(path), to ? relative(other) : NULL, NULL, 0, 0);
    }
    if (inside)
        pthread_mutex_unlock(&disk_lock);
    errno = saved;
    return (int)result;
}

int rename(const char *from, const char *to) {
    return change_name(DISK_RENAME, AT_FDCWD, from, AT_FDCWD, to, SYS_renameat2, 0);
}

int renameat(int from_folder, const char *from, int to_folder, const char *to) {
    return change_name(DISK_RENAME, from_folder, from, to_folder, to, SYS_renameat2, 0);
}

int renameat2(int from_folder, const char *from, int to_folder, const char *to, unsigned flags) {
    return change_name(DISK_RENAME, from_folder, from, to_folder, to, SYS_renameat2, (long)flags);
}

int unlink(const char *path) {
    return change_name(DISK_REMOVE, AT_FDCWD, path, 0, NULL, SYS_unlinkat, 0);
}

int unlinkat(int folder, const char *path, int flags) {
    return change_name(DISK_REMOVE, folder, path, 0, NULL, SYS_unlinkat, flags);
}

int rmdir(const char *path) {
    return change_name(DISK_REMOVE, AT_FDCWD, path, 0, NULL, SYS_unlinkat, AT_REMOVEDIR);
}

int remove(const char *path) {
    struct stat status;
    const gboolean folder =
        fstatat(AT_FDCWD, path, &status, AT_SYMLINK_NOFOLLOW) == 0 && S_ISDIR(status.st_mode);
    return folder ? rmdir(path) : unlink(path);
}

int mkdir(const char *path, mode_t mode) {
    return change_name(DISK_FOLDER, AT_FDCWD, path, 0, NULL, SYS_mkdirat, (long)mode);
}

int mkdirat(int folder, const char *path, mode_t mode) {
    return change_name(DISK_FOLDER, folder, path, 0, NULL, SYS_mkdirat, (long)mode);
}

/* Not among the calls that a schedule has: most of them follow a call that is. */
int lstat(const char *path, struct stat *ret) {
    char whole[PATH_MAX];
    if (!find_path(AT_FDCWD, path, whole))
        return fstatat(AT_FDCWD, path, ret, AT_SYMLINK_NOFOLLOW);
    gboolean failing = FALSE;
    pthread_mutex_lock(&disk_lock);
    const int n = ++disk->calls[DISK_STAT];
    for (int i = 0; i < disk->n_faults; i++) {
        const struct disk_fault *fault = &disk->faults[i];
        failing |= fault->kind == DISK_STAT && n >= fault->at && n - fault->at < fault->calls;
    }
    disk->n_failed += failing;
    pthread_mutex_unlock(&disk_lock);
    if (!failing)
        return fstatat(AT_FDCWD, path, ret, AT_SYMLINK_NOFOLLOW);
    errno = EIO;
    return -1;
}

/* Room for 8 GiB, or none: the machine's own disk is not asked. */
int statvfs(const char *path, struct statvfs *ret) {
    typedef int (*Statvfs)(const char *, struct statvfs *);
    REAL("statvfs", Statvfs);
    const int result = real(path, ret);
    if (result == 0 && disk && disk->active) {
        ret->f_frsize = ret->f_bsize = 4096;
        ret->f_bavail = ret->f_bfree = disk->full ? 0 : 2 << 20;
    }
    return result;
}

int statvfs64(const char *path, struct statvfs64 *ret) {
    return statvfs(path, (struct statvfs *)(gpointer)ret);
}

/* Wall time goes with the rig's clock, and is set by operators. So does monotonic time, ahead of
 * the kernel's, so that who waits for another thread until some time waits for the thread only. */
int clock_gettime(clockid_t id, struct timespec *ret) {
    const gboolean wall = id == CLOCK_REALTIME;
    if (!disk || !disk->active || (!wall && id != CLOCK_MONOTONIC))
        return (int)syscall(SYS_clock_gettime, id, ret);
    const gint64 us = disk_now_us(disk);
    ret->tv_sec = us / G_USEC_PER_SEC + (wall ? WALL_BEGINS_S + disk->step_s : MONOTONIC_BEGINS_S);
    ret->tv_nsec = us % G_USEC_PER_SEC * 1000;
    return 0;
}

int gettimeofday(struct timeval *ret, void *zone) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    ret->tv_sec = now.tv_sec;
    ret->tv_usec = now.tv_nsec / 1000;
    return 0;
}

/* The memory that a process has used differs from run to run; the session notes it. */
int getrusage(__rusage_who_t who, struct rusage *ret) {
    const int result = (int)syscall(SYS_getrusage, who, ret);
    if (result == 0 && disk && disk->active)
        ret->ru_maxrss = 100 << 10;
    return result;
}
