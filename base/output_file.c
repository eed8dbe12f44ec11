#include "output_file.h"

#include <errno.h>
#include <fcntl.h>
#include <glib/gstdio.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include "data_error.h"
#include "file_lock.h"
#include "new_file.h"

#define KIND "mesorig.kind"
/* The mark of the kind is searched for in this number of bytes at the beginning of a file, or at
 * the end of a PDF. */
#define LOOKED_AT ((gsize)1 << 20)
#define MAX_MARK  ((goffset)1 << 30) /* a larger file does not get the mark of its kind */
#define TRIES     100
#define PNG_HEAD  33 /* signature and IHDR */
#define EXR_MAGIC "v/1\x01"

enum found { FOUND_NOTHING, FOUND_OWN, FOUND_OTHER, FOUND_STREAM };

struct OutputFile {
    char *path;   /* path as the user gave it */
    char *target; /* path after following symbolic links */
    char *kind;   /* kind of product, or NULL */
    enum found found;
    struct stat before; /* status of an existing file */
    char *folder;       /* folder in which the file is written; NULL before output_file_path() */
    char *written;      /* path of the file in that folder */
    char *note;
    int lock; /* −1 if there is none */
    char *lock_path;
};

static gboolean fail(const char *path, GError **error) {
    const int saved = errno;
    const gboolean full = saved == ENOSPC || saved == EDQUOT;
    const gboolean denied = saved == EACCES || saved == EPERM || saved == EROFS;
    g_set_error(error, DATA_ERROR, DATA_ERROR_IO, "%s: cannot be written: %s%s", path,
                g_strerror(saved),
                full     ? "; free some space, then try again"
                : denied ? "; choose a folder in which you may write"
                         : "; give another path");
    return FALSE;
}

gboolean output_file_write(const char *path, const void *bytes, gsize n, GError **error) {
    g_autofree char *folder = g_path_get_dirname(path), *name = g_path_get_basename(path);
    struct new_file file;
    if (!new_file_begin(&file, folder, name))
        return fail(path, error);
    if (!new_file_put(&file, bytes, n)) {
        new_file_abandon(&file);
        return fail(path, error);
    }
    return new_file_commit(&file, TRUE) || fail(path, error);
}

gboolean output_file_move(const char *from, const char *to) {
    struct stat status;
    if (renameat2(AT_FDCWD, from, AT_FDCWD, to, RENAME_NOREPLACE) == 0)
        return TRUE;
    if (errno != EINVAL && errno != ENOSYS && errno != EOPNOTSUPP)
        return FALSE;
    /* The file system lacks RENAME_NOREPLACE. link() never replaces an existing name. It fails for
     * folders, and on file systems without hard links such as exFAT. */
    if (link(from, to) == 0) {
        unlink(from);
        return TRUE;
    }
    if (errno == EEXIST)
        return FALSE;
    if (lstat(to, &status) == 0) {
        errno = EEXIST;
        return FALSE;
    }
    return rename(from, to) == 0;
}

gboolean output_file_move_folder(const char *folder, const char *path, GError **error) {
    if (output_file_move(folder, path))
        return TRUE;
    const int saved = errno;
    const gboolean exists = saved == EEXIST || saved == ENOTEMPTY;
    g_autofree char *beside = g_strdup_printf("%s-%08x", path, g_random_int());
    const gboolean moved = output_file_move(folder, beside);
    g_set_error(error, DATA_ERROR, exists ? DATA_ERROR_EXISTS : DATA_ERROR_IO,
                exists ? "%s exists already, because another program has made it meanwhile: %s; "
                         "the finished folder is %s"
                       : "%s: cannot be made: %s; the finished folder is %s",
                path, g_strerror(saved), moved ? beside : folder);
    return FALSE;
}

/* Reads at least LOOKED_AT bytes of a file from the offset at on, or all bytes to its end if there
 * are fewer. */
static GByteArray *read_part(int fd, goffset at) {
    GByteArray *bytes = g_byte_array_new();
    guint8 some[1 << 14];
    gssize n;
    while (bytes->len < LOOKED_AT && (n = pread(fd, some, sizeof some, at + bytes->len)) > 0)
        g_byte_array_append(bytes, some, (guint)n);
    return bytes;
}

static gboolean begins(const GByteArray *bytes, const char *what) {
    return bytes->len >= strlen(what) && memcmp(bytes->data, what, strlen(what)) == 0;
}

static gboolean is_png(const GByteArray *bytes) {
    return begins(bytes, "\x89PNG") && bytes->len > PNG_HEAD;
}

/* Returns the bytes that mark the kind in a PNG, an EXR or another file. file has the first bytes
 * of the file and shows its format. In a PNG and an EXR the mark includes a length. */
static GByteArray *output_file_mark(const GByteArray *file, const char *kind) {
    GByteArray *mark = g_byte_array_new();
    const guint32 length = (guint32)strlen(kind);
    if (is_png(file)) {
        const guint32 all = GUINT32_TO_BE(length + (guint32)sizeof KIND);
        g_byte_array_append(mark, (const guint8 *)&all, sizeof all);
        g_byte_array_append(mark, (const guint8 *)"tEXt" KIND, sizeof "tEXt" KIND);
    } else if (begins(file, EXR_MAGIC)) {
        const guint32 its = GUINT32_TO_LE(length);
        g_byte_array_append(mark, (const guint8 *)KIND "\0string", sizeof KIND "\0string");
        g_byte_array_append(mark, (const guint8 *)&its, sizeof its);
    } else {
        g_byte_array_append(mark, (const guint8 *)KIND ": ", strlen(KIND ": "));
    }
    g_byte_array_append(mark, (const guint8 *)kind, length);
    return mark;
}

/* Returns whether the bytes contain the mark. In formats other than PNG and EXR, no letter or digit
 * may follow the mark. */
static gboolean has(const GByteArray *bytes, const GByteArray *mark) {
    const gboolean text = !is_png(bytes) && !begins(bytes, EXR_MAGIC);
    const guint8 *at = memmem(bytes->data, bytes->len, mark->data, mark->len);
    const guint8 *next = at ? at + mark->len : NULL;
    return at && (!text || next == bytes->data + bytes->len || !g_ascii_isalnum(*next));
}

/* Returns whether Mesorig has written the file as that kind. */
static gboolean output_file_is(const char *path, const struct stat *status, const char *kind) {
    const int fd = kind ? open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY) : -1;
    if (fd < 0)
        return FALSE;
    g_autoptr(GByteArray) begin = read_part(fd, 0);
    g_autoptr(GByteArray) end = read_part(fd, MAX(0, status->st_size - (goffset)LOOKED_AT));
    g_autoptr(GByteArray) mark = output_file_mark(begin, kind);
    close(fd);
    return has(begins(begin, "%PDF") ? end : begin, mark);
}

static gboolean output_file_exists(const struct OutputFile *file, GError **error) {
    if (file->kind)
        g_set_error(
            error, DATA_ERROR, DATA_ERROR_EXISTS,
            "%s exists already, and is not a “%s” that Mesorig has written: give another name, "
            "or --force to replace it",
            file->path, file->kind);
    else
        g_set_error(error, DATA_ERROR, DATA_ERROR_EXISTS,
                    "%s exists already: give another name, or --force to replace it", file->path);
    return FALSE;
}

static gboolean is_no_file(const char *path, mode_t mode, GError **error) {
    g_set_error(error, DATA_ERROR, DATA_ERROR_EXISTS, "%s is a %s: give the name of a file", path,
                S_ISDIR(mode)    ? "folder"
                : S_ISSOCK(mode) ? "socket"
                                 : "disk");
    return FALSE;
}

/* Decides what happens to the name: sets found, target, before and note. Returns FALSE with an
 * error if the name is refused. */
static gboolean decide(struct OutputFile *file, gboolean force, GError **error) {
    g_autofree char *folder = g_path_get_dirname(file->path);
    struct stat link_status;
    const gboolean named = lstat(file->path, &link_status) == 0;
    file->target = g_strdup(file->path);
    if (!named || stat(file->path, &file->before) != 0) {
        const gboolean missing = errno == ENOENT;
        file->found = FOUND_NOTHING;
        if (!*file->path || g_str_has_suffix(file->path, "/")) {
            g_set_error(error, DATA_ERROR, DATA_ERROR_EXISTS,
                        *file->path ? "%s ends with a slash: give the name of a file"
                                    : "the name of the output%s is empty: give the name of a file",
                        file->path);
            return FALSE;
        }
        if (named && !missing)
            return fail(file->path, error);
        if (named) {
            g_set_error(
                error, DATA_ERROR, DATA_ERROR_EXISTS,
                "%s is a symbolic link to a file that does not exist: remove the link, or give "
                "another name",
                file->path);
            return FALSE;
        }
        if (access(folder, W_OK | X_OK) == 0)
            return TRUE;
        if (errno != ENOENT)
            return fail(file->path, error);
        g_set_error(error, DATA_ERROR, DATA_ERROR_IO,
                    "%s: cannot be written: there is no folder %s; make it first", file->path,
                    folder);
        return FALSE;
    }
    if (S_ISCHR(file->before.st_mode) || S_ISFIFO(file->before.st_mode)) {
        file->found = FOUND_STREAM;
        return access(file->path, W_OK) == 0 || fail(file->path, error);
    }
    if (!S_ISREG(file->before.st_mode))
        return is_no_file(file->path, file->before.st_mode, error);
    if (S_ISLNK(link_status.st_mode)) {
        char *resolved = realpath(file->path, NULL);
        if (!resolved)
            return fail(file->path, error);
        g_free(file->target);
        file->target = g_strdup(resolved);
        free(resolved);
    }
    const gboolean own = output_file_is(file->target, &file->before, file->kind);
    if (!own && !force)
        return output_file_exists(file, error);
    g_free(folder);
    folder = g_path_get_dirname(file->target);
    if (access(folder, W_OK | X_OK) != 0)
        return fail(file->path, error);
    file->found = own ? FOUND_OWN : FOUND_OTHER;
    file->note =
        own ? g_strdup_printf("it replaces the “%s” that Mesorig had written there", file->kind)
            : g_strdup("it replaces the existing file");
    return TRUE;
}

OutputFile *output_file_new(const char *path, const char *kind, gboolean force, GError **error) {
    g_autoptr(OutputFile) file = g_new0(OutputFile, 1);
    file->path = g_strdup(path);
    file->kind = g_strdup(kind);
    file->lock = -1;
    return decide(file, force, error) ? g_steal_pointer(&file) : NULL;
}

OutputFile *output_file_new_locked(const char *path, const char *kind, gboolean force,
                                   GError **error) {
    g_autoptr(OutputFile) before = output_file_new(path, kind, force, error);
    g_autofree char *lock_path = NULL;
    if (!before || before->found == FOUND_STREAM)
        return g_steal_pointer(&before);
    const int lock = file_lock_take_output(before->target, &lock_path, error);
    if (lock < 0)
        return NULL;
    /* The previous holder of the lock may have written the file. */
    OutputFile *file = output_file_new(path, kind, force, error);
    if (!file) {
        file_lock_give(lock, lock_path);
        return NULL;
    }
    file->lock = lock;
    file->lock_path = g_steal_pointer(&lock_path);
    return file;
}

gboolean output_file_check(const char *path, const char *kind, gboolean force, GError **error) {
    g_autoptr(OutputFile) file = output_file_new(path, kind, force, error);
    return file != NULL;
}

void output_file_free(OutputFile *file) {
    if (!file)
        return;
    if (file->written)
        g_unlink(file->written);
    if (file->folder)
        g_rmdir(file->folder);
    file_lock_give(file->lock, file->lock_path);
    g_free(file->lock_path);
    g_free(file->path);
    g_free(file->target);
    g_free(file->kind);
    g_free(file->folder);
    g_free(file->written);
    g_free(file->note);
    g_free(file);
}

const char *output_file_path(OutputFile *file, GError **error) {
    g_autofree char *name = g_path_get_basename(file->target);
    for (int i = 0; !file->folder && i < TRIES; i++) {
        g_autofree char *folder = file->found == FOUND_STREAM
                                      ? g_build_filename(g_get_tmp_dir(), "mesorig", NULL)
                                      : g_strdup(file->target);
        g_autofree char *made = g_strdup_printf("%s.%08x.part", folder, g_random_int());
        if (g_mkdir(made, file->found == FOUND_STREAM ? 0700 : 0777) == 0)
            file->folder = g_steal_pointer(&made);
        else if (errno != EEXIST)
            break;
    }
    if (!file->folder) {
        fail(file->path, error);
        return NULL;
    }
    if (!file->written)
        file->written = g_build_filename(file->folder, name, NULL);
    return file->written;
}

/* Returns a copy of a PNG with a chunk inserted after the header. This function appends the
 * checksum that the chunk lacks. */
static GByteArray *mark_png(const guint8 *png, gsize n, const GByteArray *chunk) {
    GByteArray *ret = g_byte_array_new();
    const guint32 sum = GUINT32_TO_BE((guint32)crc32(0, chunk->data + 4, chunk->len - 4));
    g_byte_array_append(ret, png, PNG_HEAD);
    g_byte_array_append(ret, chunk->data, chunk->len);
    g_byte_array_append(ret, (const guint8 *)&sum, sizeof sum);
    g_byte_array_append(ret, png + PNG_HEAD, (guint)n - PNG_HEAD);
    return ret;
}

/* Returns the content of the file with the mark of its kind added. Returns NULL if the file already
 * has the mark, or if this module cannot add it to a file of that format. */
static GByteArray *output_file_marked(const guint8 *bytes, gsize n, const char *kind) {
    const GByteArray all = {(guint8 *)bytes, (guint)n};
    g_autoptr(GByteArray) mark = output_file_mark(&all, kind);
    const gboolean pdf = begins(&all, "%PDF"), xml = begins(&all, "<");
    if (has(&all, mark))
        return NULL;
    if (is_png(&all))
        return mark_png(bytes, n, mark);
    const guint8 *end = pdf ? bytes + n : xml ? memchr(bytes, '>', n) : NULL;
    if (!end)
        return NULL;
    const gsize first = (gsize)(end - bytes) + xml;
    g_autofree char *comment =
        g_strdup_printf(pdf ? "%% " KIND ": %s\n" : "\n<!-- " KIND ": %s -->", kind);
    GByteArray *ret = g_byte_array_new();
    g_byte_array_append(ret, bytes, (guint)first);
    g_byte_array_append(ret, (const guint8 *)comment, (guint)strlen(comment));
    g_byte_array_append(ret, bytes + first, (guint)(n - first));
    return ret;
}

static gboolean add_kind(const struct OutputFile *file, GError **error) {
    struct stat status;
    if (!file->kind || stat(file->written, &status) != 0 || status.st_size > MAX_MARK)
        return TRUE;
    g_autoptr(GMappedFile) mapped = g_mapped_file_new(file->written, FALSE, error);
    if (!mapped)
        return FALSE;
    g_autoptr(GByteArray) marked =
        output_file_marked((const guint8 *)g_mapped_file_get_contents(mapped),
                           g_mapped_file_get_length(mapped), file->kind);
    return !marked || output_file_write(file->written, marked->data, marked->len, error);
}

/* Copies the file to a device or pipe. Opening a pipe waits for its reader. */
static gboolean stream(const struct OutputFile *file) {
    guint8 some[1 << 16];
    gssize n = 0;
    const int from = open(file->written, O_RDONLY | O_CLOEXEC);
    const int to = from >= 0 ? open(file->path, O_WRONLY | O_CLOEXEC | O_NOCTTY) : -1;
    gboolean ok = to >= 0;
    while (ok && (n = read(from, some, sizeof some)) > 0)
        ok = new_file_write(to, some, (gsize)n);
    const int saved = errno;
    if (from >= 0)
        close(from);
    if (to >= 0)
        ok = close(to) == 0 && ok;
    errno = saved;
    return ok && n == 0;
}

static gboolean output_file_sync(const char *path, int flags) {
    const int fd = open(path, flags | O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
    const gboolean ok = fd >= 0 && fsync(fd) == 0;
    const int saved = errno;
    if (fd >= 0)
        close(fd);
    errno = saved;
    return ok;
}

/* Returns whether the file that may be replaced is still the one that was examined. */
static gboolean unchanged(const struct OutputFile *file) {
    struct stat now;
    const struct stat *before = &file->before;
    if (lstat(file->target, &now) != 0)
        return FALSE;
    return now.st_dev == before->st_dev && now.st_ino == before->st_ino && S_ISREG(now.st_mode) &&
           now.st_size == before->st_size && now.st_mtim.tv_sec == before->st_mtim.tv_sec &&
           now.st_mtim.tv_nsec == before->st_mtim.tv_nsec;
}

/* Syncs the file and moves it to its final name. Returns FALSE and sets errno on failure. */
static gboolean deliver(const struct OutputFile *file) {
    struct stat now;
    if (!output_file_sync(file->written, 0))
        return FALSE;
    if (file->found == FOUND_NOTHING || lstat(file->target, &now) != 0)
        return output_file_move(file->written, file->target);
    if (!unchanged(file)) {
        errno = EEXIST;
        return FALSE;
    }
    return rename(file->written, file->target) == 0;
}

/* Called when the finished file cannot be delivered, with the reason in errno. Moves the file next
 * to its final place, as NAME-XXXXXXXX.END. Sets the error, which names the path of the finished
 * file. Always returns FALSE. */
static gboolean keep(struct OutputFile *file, GError **error) {
    const int saved = errno;
    const char *name = strrchr(file->target, '/'), *end = strrchr(file->target, '.');
    if (!end || end <= (name ? name + 1 : file->target))
        end = file->target + strlen(file->target);
    g_autofree char *beside = g_strdup_printf("%.*s-%08x%s", (int)(end - file->target),
                                              file->target, g_random_int(), end);
    const gboolean moved = file->found != FOUND_STREAM && output_file_move(file->written, beside);
    g_set_error(error, DATA_ERROR, saved == EEXIST ? DATA_ERROR_EXISTS : DATA_ERROR_IO,
                saved == EEXIST ? "%s: another program has written it meanwhile (%s); the finished "
                                  "file is %s"
                                : "%s: cannot be written: %s; the finished file is %s",
                file->path, g_strerror(saved), moved ? beside : file->written);
    if (!moved)
        g_clear_pointer(&file->folder, g_free);
    g_clear_pointer(&file->written, g_free);
    return FALSE;
}

/* Makes the error name the output instead of the path at which it is written. */
static void rename_error(const struct OutputFile *file, GError **error) {
    if (!file->written || !error || !*error || !strstr((*error)->message, file->written))
        return;
    g_auto(GStrv) parts = g_strsplit((*error)->message, file->written, -1);
    g_free((*error)->message);
    (*error)->message = g_strjoinv(file->path, parts);
}

gboolean output_file_end(OutputFile *file, gboolean written, GError **error) {
    g_autofree char *folder = g_path_get_dirname(file->target);
    if (!written || !add_kind(file, error)) {
        rename_error(file, error);
        return FALSE;
    }
    if (file->found == FOUND_STREAM)
        return stream(file) || keep(file, error);
    if (!deliver(file))
        return keep(file, error);
    g_clear_pointer(&file->written, g_free);
    if (!output_file_sync(folder, O_DIRECTORY))
        /* Some file systems cannot sync a folder. The file is under its final name nevertheless. */
        g_debug("%s: %s", folder, g_strerror(errno));
    return TRUE;
}

gboolean output_file_put(OutputFile *file, const void *bytes, gsize n, GError **error) {
    const char *path = output_file_path(file, error);
    return path && output_file_end(file, output_file_write(path, bytes, n, error), error);
}

const char *output_file_note(const OutputFile *file) {
    return file->note;
}

void output_file_say(const OutputFile *file, const char *program) {
    if (file->note)
        g_printerr("%s: %s: %s\n", program, file->path, file->note);
}

gboolean output_file_streams(const OutputFile *file) {
    return file->found == FOUND_STREAM;
}
