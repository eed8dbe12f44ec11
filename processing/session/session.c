/* Opens and locks a session, reads its texts, reads and writes its values, and adds events and
 * products. */
#include "session_private.h"

#include "exr/exr.h"

#include <errno.h>
#include <fcntl.h>
#include <gio/gio.h>
#include <string.h>
#include <sys/file.h>
#include <unistd.h>

G_DEFINE_QUARK(session_error, session_error)

/* Locks the session for capture. The kernel releases the lock when the process that holds it ends
 * for any reason. */
int session_lock(const char *path, GError **error) {
    g_autofree char *file = g_build_filename(path, "capture.lock", NULL);
    int fd = open(file, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0666);
    char who[32] = "";

    if (fd >= 0 && flock(fd, LOCK_EX | LOCK_NB) == 0) {
        g_snprintf(who, sizeof who, "%ld\n", (long)getpid());
        /* a failure is ignored, because the process id is used only in the message below */
        if (ftruncate(fd, 0) != 0 || pwrite(fd, who, strlen(who), 0) < 0)
            g_debug("%s: %s", file, g_strerror(errno));
        return fd;
    }
    if (fd >= 0 && errno == EWOULDBLOCK) {
        if (pread(fd, who, sizeof who - 1, 0) < 0)
            *who = 0;
        /* pid is 0 if the other process has not written its id yet */
        const long pid = strtol(who, NULL, 10);
        g_autofree char *named = pid > 0 ? g_strdup_printf(" (process %ld)", pid) : g_strdup("");
        session_fail(error, SESSION_ERROR_LOCKED,
                     "%s: another process%s captures into this session; end that process first",
                     path, named);
    } else {
        session_fail(error,
                     errno == ENOSPC || errno == EDQUOT ? SESSION_ERROR_FULL : SESSION_ERROR_IO,
                     "%s: cannot be locked: %s; make the session writable or free some space", file,
                     g_strerror(errno));
    }
    if (fd >= 0)
        close(fd);
    return -1;
}

/* Syncs the names in a folder. Also succeeds if the folder cannot be opened for lack of permission,
 * or if its file system cannot sync folders. */
static gboolean session_sync_folder(const char *folder, GError **error) {
    const int fd = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    const gboolean ok = fd < 0 ? errno == EACCES : fsync(fd) == 0 || errno == EINVAL;
    const int saved = errno;

    if (fd >= 0)
        close(fd);
    return ok || session_fail(error, SESSION_ERROR_IO, "%s: cannot be synced: %s; check the disk",
                              folder, g_strerror(saved));
}

/* Syncs the folder that contains the session. The program that made the session may have ended
 * before it synced that folder. A power cut would then lose the session with all its frames. */
static gboolean session_sync_name(const Session *session, GError **error) {
    g_autofree char *parent = g_path_get_dirname(session->path);

    return session_sync_folder(parent, error);
}

static gboolean session_start(Session *session, GError **error) {
    static const char *const folders[] = {"frames", "laser", "products", "products/btf"};
    g_autofree char *db = session_file(session, "session.db");

    if (!g_file_test(session->path, G_FILE_TEST_IS_DIR))
        return session_fail(error, SESSION_ERROR_FORMAT, "%s: no session there: %s", session->path,
                            g_file_test(session->path, G_FILE_TEST_EXISTS)
                                ? "it is a file; give the directory of a session"
                                : "there is no such directory; give the directory of a session");
    /* Only a directory with session.db is locked, so that other directories do not get a lock
     * file. */
    if (session->mode == SESSION_CAPTURE && session->lock < 0 &&
        g_file_test(db, G_FILE_TEST_EXISTS)) {
        session->lock = session_lock(session->path, error);
        if (session->lock < 0 || !session_sync_name(session, error))
            return FALSE;
    }
    if (!session_db_open(session, FALSE, error))
        return FALSE;
    /* Syncs the name of the write-ahead log. SQLite takes this name for synced if it cannot open
     * the folder. A power cut would then leave a database without a part of the log. */
    if (session->mode != SESSION_READ && !session_sync_folder(session->path, error))
        return FALSE;
    if (session_db_one_text(session, "SELECT name FROM session WHERE id = 1", NULL, &session->name,
                            error) >= 0 &&
        !session->name)
        session_fail(error, SESSION_ERROR_FORMAT,
                     "%s/session.db: the session has no name; restore the database from a copy",
                     session->path);
    if (!session->name)
        return FALSE;
    /* Symbolic links instead of folders are refused, because nothing may be written outside of the
     * session. */
    for (gsize i = 0; session->mode != SESSION_READ && i < G_N_ELEMENTS(folders); i++) {
        g_autofree char *folder = session_file(session, folders[i]);

        if (g_file_test(folder, G_FILE_TEST_IS_SYMLINK))
            return session_fail(error, SESSION_ERROR_FORMAT,
                                "%s: is a symbolic link, and nothing is written through links; "
                                "replace it by a folder",
                                folder);
    }
    return TRUE;
}

Session *session_open_locked(const char *path, enum session_mode mode, int lock, GError **error) {
    g_autoptr(Session) session = g_new0(Session, 1);

    session->path = g_canonicalize_filename(path, NULL);
    session->mode = mode;
    session->lock = lock;
    return session_start(session, error) ? g_steal_pointer(&session) : NULL;
}

Session *session_open(const char *path, enum session_mode mode, GError **error) {
    return session_open_locked(path, mode, -1, error);
}

void session_close(Session *session) {
    if (!session)
        return;
    sqlite3_close(session->db);
    if (session->lock >= 0)
        close(session->lock);
    g_free(session->name);
    g_free(session->path);
    g_free(session);
}

const char *session_path(const Session *session) {
    return session->path;
}

const char *session_name(const Session *session) {
    return session->name;
}

char *session_file(const Session *session, const char *relative) {
    return g_build_filename(session->path, relative, NULL);
}

gboolean session_is_relative(const char *path) {
    g_auto(GStrv) parts = NULL;

    if (!path || !*path || g_path_is_absolute(path) || !g_utf8_validate(path, -1, NULL))
        return FALSE;
    parts = g_strsplit(path, "/", -1);
    for (char **part = parts; *part; part++)
        if (!**part || strcmp(*part, ".") == 0 || strcmp(*part, "..") == 0)
            return FALSE;
    return TRUE;
}

gboolean session_may(const Session *session, enum session_mode least, GError **error) {
    return session->mode >= least ||
           session_fail(error, SESSION_ERROR_IO, "%s: the session is open for %s only",
                        session->path,
                        session->mode == SESSION_READ ? "reading" : "writing products");
}

char *session_frame_path(const struct session_shot *shot, const char *camera) {
    g_autofree char *safe = g_strdup(camera);

    g_strcanon(safe, G_CSET_a_2_z G_CSET_A_2_Z G_CSET_DIGITS "._-", '_');
    return g_strdup_printf("%s/%06" G_GINT64_FORMAT "_%s.exr",
                           shot->kind == SHOT_SWEEP ? "laser" : "frames", shot->id, safe);
}

char *session_text(Session *session, const char *name, GError **error) {
    char *content;

    if (session_db_one_text(session, "SELECT content FROM text WHERE name = ?1", name, &content,
                            error) >= 0 &&
        !content)
        session_fail(error, SESSION_ERROR_FORMAT,
                     "%s/session.db: there is no text “%s”; restore the database from a copy",
                     session->path, name);
    return content;
}

gboolean session_read_value(Session *session, const char *key, char **ret, GError **error) {
    return session_db_one_text(session, "SELECT value FROM value WHERE key = ?1", key, ret,
                               error) >= 0;
}

char *session_value(Session *session, const char *key) {
    char *value;

    session_read_value(session, key, &value, NULL);
    return value;
}

void session_suspicions(Session *session, GPtrArray *ret) {
    g_autofree char *value = session_value(session, "suspicions");
    g_auto(GStrv) lines = value ? g_strsplit(value, "\n", -1) : NULL;
    for (char **line = lines; line && *line; line++)
        g_ptr_array_add(ret, g_strdup(*line));
}

gboolean session_suspect(Session *session, const char *sentence, GError **error) {
    g_autoptr(GHashTable) values = session_values(session, "suspicions", error);
    if (!values)
        return FALSE;
    const char *before = g_hash_table_lookup(values, "suspicions");
    g_auto(GStrv) lines = before ? g_strsplit(before, "\n", -1) : NULL;
    if (lines && g_strv_contains((const char *const *)lines, sentence))
        return TRUE;
    g_autofree char *all = before ? g_strconcat(before, "\n", sentence, NULL) : g_strdup(sentence);
    return session_set_value(session, "suspicions", all, error);
}

GHashTable *session_values(Session *session, const char *prefix, GError **error) {
    g_autoptr(GHashTable) values = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, g_free);
    g_autoptr(sqlite3_stmt) statement = session_db_query(
        session, error, "SELECT key, value FROM value WHERE substr(key, 1, length(?1)) = ?1", "s",
        prefix);
    int rc = -1;

    while (statement && (rc = session_db_next(session, statement, error)) > 0)
        g_hash_table_insert(values, session_db_text(statement, 0), session_db_text(statement, 1));
    return rc == 0 ? g_steal_pointer(&values) : NULL;
}

gboolean session_set_value(Session *session, const char *key, const char *value, GError **error) {
    g_autofree char *valid = value ? g_utf8_make_valid(value, -1) : NULL;

    if (!session_may(session, SESSION_PRODUCTS, error))
        return FALSE;
    if (!valid)
        return session_db_run(session, error, "DELETE FROM value WHERE key = ?1", "s", key);
    return session_db_run(session, error, "INSERT OR REPLACE INTO value VALUES (?1, ?2)", "ss", key,
                          valid);
}

gboolean session_add_event(Session *session, double time_s, const char *level, const char *source,
                           const char *message, GError **error) {
    g_autofree char *from = g_utf8_make_valid(source ? source : "", -1);
    g_autofree char *says = g_utf8_make_valid(message ? message : "", -1);

    return session_may(session, SESSION_PRODUCTS, error) &&
           session_db_run(session, error,
                          "INSERT INTO event (time_s, level, source, message)"
                          " VALUES (?1, ?2, ?3, ?4)",
                          "dsss", time_s == time_s ? time_s : 0.0, level, from, says);
}

/* The file is hashed here rather than by the caller, because the row must describe the file on
 * disk. */
gboolean session_add_product(Session *session, const char *relative, const char *made_by,
                             GError **error) {
    g_autofree char *file = session_file(session, relative), *sha256 = NULL;
    g_autoptr(GError) own = NULL;
    gint64 bytes = 0;

    if (!session_may(session, SESSION_PRODUCTS, error))
        return FALSE;
    sha256 = session_is_relative(relative) ? exr_sha256(file, &bytes, &own) : NULL;
    if (!sha256)
        return session_fail(error, SESSION_ERROR_IO, "%s: the product %s cannot be recorded: %s",
                            session->path, relative,
                            own ? own->message : "its path leads out of the session");
    return session_db_run(session, error, "INSERT OR REPLACE INTO product VALUES (?1, ?2, ?3, ?4)",
                          "sssl", relative, made_by, sha256, bytes);
}
