/* Access to SQLite. A database may be hostile, because it may come from a stranger. It is opened
 * only if its format, the texts of its tables and its structure are as this program writes them. */
#include "session_private.h"
#include "session_schema.h"

#include "base/input_file.h"

#include <errno.h>
#include <fcntl.h>
#include <glib/gstdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define MAX_TEXT    (64 << 20)
#define PATIENCE_MS 10000 /* maximum time to wait for another program's transaction */

gboolean session_fail(GError **error, enum session_error code, const char *format, ...) {
    va_list list;

    va_start(list, format);
    g_propagate_error(error, g_error_new_valist(SESSION_ERROR, (int)code, format, list));
    va_end(list);
    return FALSE;
}

static gboolean damaged(const Session *session, const char *what, GError **error) {
    g_autofree char *valid = g_utf8_make_valid(what ? what : "", -1);

    if (session->is_new)
        return session_fail(error, SESSION_ERROR_IO,
                            "%s/session.db: a new database differs from what was written: %s; no "
                            "session was made; check the disk and start again",
                            session->path, valid);
    return session_fail(error, SESSION_ERROR_FORMAT,
                        "%s/session.db: damaged: %s; restore it from a backup, or try "
                        "'sqlite3 session.db .recover' on a copy",
                        session->path, valid);
}

/* Returns whether a file that SQLite has open can be read to its end. Reads through SQLite's own
 * descriptor. If a second descriptor were opened, its closing would release all locks that this
 * process has on the file. */
static gboolean can_read_all(sqlite3 *db, int which) {
    sqlite3_file *file = NULL;
    sqlite3_int64 size = 0;
    guint8 block[4096];
    if (sqlite3_file_control(db, "main", which, &file) != SQLITE_OK || !file || !file->pMethods)
        return TRUE; /* the file does not exist */
    if (file->pMethods->xFileSize(file, &size) != SQLITE_OK)
        return FALSE;
    for (sqlite3_int64 at = 0; at < size; at += (sqlite3_int64)sizeof block) {
        const int n = (int)MIN(size - at, (sqlite3_int64)sizeof block);
        const int rc = file->pMethods->xRead(file, block, n, at);
        if (rc != SQLITE_OK && rc != SQLITE_IOERR_SHORT_READ)
            return FALSE;
    }
    return TRUE;
}

/* Returns TRUE if the database is damaged, and FALSE if the disk fails to read it. The code of an
 * error does not tell, because SQLite also reports a page as damaged if the disk fails to read it
 * (SQLITE_IOERR_CORRUPTFS becomes SQLITE_CORRUPT while a statement runs). The database is damaged
 * if it can be read as a whole now, and a new connection still finds it damaged. */
static gboolean is_truly_damaged(const Session *session) {
    if (!can_read_all(session->db, SQLITE_FCNTL_FILE_POINTER) ||
        !can_read_all(session->db, SQLITE_FCNTL_JOURNAL_POINTER))
        return FALSE;
    g_autofree char *file = session_file(session, "session.db");
    g_autoptr(sqlite3_stmt) check = NULL;
    sqlite3 *db = NULL;
    gboolean sound = FALSE;
    if (sqlite3_open_v2(file, &db, SQLITE_OPEN_READONLY, NULL) == SQLITE_OK &&
        sqlite3_prepare_v2(db, "PRAGMA quick_check(1)", -1, &check, NULL) == SQLITE_OK &&
        sqlite3_step(check) == SQLITE_ROW)
        sound = g_strcmp0((const char *)sqlite3_column_text(check, 0), "ok") == 0;
    g_clear_pointer(&check, sqlite3_finalize);
    sqlite3_close(db);
    return !sound;
}

gboolean session_db_fail(const Session *session, int rc, GError **error) {
    int saved = session->db ? sqlite3_system_errno(session->db) : 0;
    const char *says = session->db ? sqlite3_errmsg(session->db) : sqlite3_errstr(rc);
    int primary = rc & 0xff;

    if (primary == SQLITE_FULL || (primary == SQLITE_IOERR && (saved == ENOSPC || saved == EDQUOT)))
        return session_fail(error, SESSION_ERROR_FULL,
                            "%s: the disk is full; nothing was lost; free some space and continue",
                            session->path);
    if (primary == SQLITE_NOTADB)
        return session_fail(error, SESSION_ERROR_FORMAT,
                            "%s/session.db: not a session's database: %s; restore it from a backup",
                            session->path, says);
    if (primary == SQLITE_CORRUPT && session->db && !session->is_new && !is_truly_damaged(session))
        return session_fail(
            error, SESSION_ERROR_IO,
            "%s/session.db: a part of the database could not be read; check the disk "
            "and try again",
            session->path);
    if (primary == SQLITE_CORRUPT || primary == SQLITE_FORMAT || primary == SQLITE_TOOBIG)
        return damaged(session, says, error);
    if (primary == SQLITE_BUSY || primary == SQLITE_LOCKED)
        return session_fail(
            error, SESSION_ERROR_IO,
            "%s/session.db: another program keeps the database locked; close that program and try "
            "again",
            session->path);
    if (primary == SQLITE_CONSTRAINT || primary == SQLITE_MISMATCH)
        return session_fail(
            error, SESSION_ERROR_FORMAT,
            "%s/session.db: SQLite refused a row: %s; restore the database from a backup",
            session->path, says);
    return session_fail(
        error, saved == EFBIG ? SESSION_ERROR_FULL : SESSION_ERROR_IO, "%s/session.db: %s%s%s%s",
        session->path, says, saved ? ": " : "", saved ? g_strerror(saved) : "",
        primary == SQLITE_IOERR ? "; check the disk and try again"
                                : "; check the access rights of its directory, and the disk");
}

static sqlite3_stmt *prepare(Session *session, GError **error, const char *sql, const char *types,
                             va_list list) {
    g_autoptr(sqlite3_stmt) statement = NULL;
    int rc = sqlite3_prepare_v2(session->db, sql, -1, &statement, NULL);

    for (int i = 1; rc == SQLITE_OK && types[i - 1]; i++) {
        if (types[i - 1] == 'i')
            rc = sqlite3_bind_int(statement, i, va_arg(list, int));
        else if (types[i - 1] == 'l')
            rc = sqlite3_bind_int64(statement, i, va_arg(list, gint64));
        else if (types[i - 1] == 'd')
            rc = sqlite3_bind_double(statement, i, va_arg(list, double));
        else
            rc = sqlite3_bind_text(statement, i, va_arg(list, const char *), -1, SQLITE_TRANSIENT);
    }
    if (rc == SQLITE_OK)
        return g_steal_pointer(&statement);
    session_db_fail(session, rc, error);
    return NULL;
}

sqlite3_stmt *session_db_query(Session *session, GError **error, const char *sql, const char *types,
                               ...) {
    sqlite3_stmt *statement;
    va_list list;

    va_start(list, types);
    statement = prepare(session, error, sql, types, list);
    va_end(list);
    return statement;
}

int session_db_next(Session *session, sqlite3_stmt *statement, GError **error) {
    int rc = sqlite3_step(statement);

    if (rc == SQLITE_ROW || rc == SQLITE_DONE)
        return rc == SQLITE_ROW;
    session_db_fail(session, sqlite3_extended_errcode(session->db), error);
    return -1;
}

char *session_db_text(sqlite3_stmt *statement, int column) {
    return g_strdup((const char *)sqlite3_column_text(statement, column));
}

int session_db_one_text(Session *session, const char *sql, const char *key, char **ret,
                        GError **error) {
    g_autoptr(sqlite3_stmt) statement = session_db_query(session, error, sql, key ? "s" : "", key);
    int rc = statement ? session_db_next(session, statement, error) : -1;

    *ret = rc > 0 ? session_db_text(statement, 0) : NULL;
    return rc;
}

gboolean session_db_run(Session *session, GError **error, const char *sql, const char *types, ...) {
    va_list list;
    int rc = -1;

    va_start(list, types);
    g_autoptr(sqlite3_stmt) statement = prepare(session, error, sql, types, list);
    va_end(list);
    while (statement && (rc = session_db_next(session, statement, error)) > 0)
        ;
    return rc == 0;
}

gboolean session_begin(Session *session, GError **error) {
    return session_db_run(session, error, "BEGIN IMMEDIATE", "");
}

gboolean session_commit(Session *session, GError **error) {
    if (session_db_run(session, error, "COMMIT", ""))
        return TRUE;
    session_rollback(session);
    return FALSE;
}

void session_rollback(Session *session) {
    if (!sqlite3_get_autocommit(session->db))
        session_db_run(session, NULL, "ROLLBACK", "");
}

/* Returns the text that a query gives. If there is no row, sets an error and returns NULL, because
 * every undamaged database has a row for the query. */
static char *must_text(Session *session, const char *sql, const char *key, GError **error) {
    char *text = NULL;

    if (session_db_one_text(session, sql, key, &text, error) >= 0 && !text) {
        g_autofree char *what = g_strdup_printf(
            "%s%s is missing", key ? "the table " : "the value of ", key ? key : sql);
        damaged(session, what, error);
    }
    return text;
}

/* Sets the error if SQLite's check of the structure failed, and returns FALSE. `says` is the text
 * that the check gave. The check also reports a page as damaged if the disk cannot read it;
 * `says` then has the code of the read error. */
static gboolean unsound(const Session *session, const char *says, GError **error) {
    static const char code[] = "error code=";
    const char *at = g_strstr_len(says, -1, code);

    if (!at || (g_ascii_strtoll(at + strlen(code), NULL, 10) & 0xff) != SQLITE_IOERR)
        return damaged(session, says, error);
    return session_fail(error, SESSION_ERROR_IO,
                        "%s/session.db: cannot be read: %s; check the disk and try again",
                        session->path, says);
}

/* Returns the text of a table without its comments, which differ between versions. A text could
 * hide code behind a “--” in quotes or brackets, which is no comment. Its quote or bracket then
 * stays in the result. The tables of the schema have no quote or bracket there, so that such a text
 * differs from them. */
static char *without_comments(const char *sql) {
    g_autoptr(GRegex) comments = g_regex_new(" *--[^\n]*", 0, 0, NULL);
    return g_regex_replace_literal(comments, sql, -1, 0, "", 0, NULL);
}

/* Refuses a database that is not a session's, is of another version, or is damaged. */
static gboolean session_db_check(Session *session, GError **error) {
    g_autofree char *application = must_text(session, "PRAGMA application_id", NULL, error);
    g_autofree char *version =
        application ? must_text(session, "PRAGMA user_version", NULL, error) : NULL;

    if (!version)
        return FALSE;
    if (g_ascii_strtoll(application, NULL, 10) != SESSION_APPLICATION_ID)
        return session_fail(
            error, SESSION_ERROR_FORMAT,
            "%s/session.db: this is a database, but not of a session; give the directory of a "
            "session",
            session->path);
    const gint64 format = g_ascii_strtoll(version, NULL, 10);
    if (format != SESSION_FORMAT)
        return session_fail(error, SESSION_ERROR_FORMAT,
                            "%s: the session has format %" G_GINT64_FORMAT
                            ", but this program reads only format %d%s",
                            session->path, format, SESSION_FORMAT,
                            format > SESSION_FORMAT ? "; use a newer program"
                                                    : "; use the version that made it");
    /* SQLite's own check of the file's structure. */
    g_autofree char *sound = must_text(session, "PRAGMA quick_check(1)", NULL, error);
    if (!sound || strcmp(sound, "ok") != 0)
        return sound && unsound(session, sound, error);
    /* The text of each table must be that of the schema, so that no computed column or virtual
     * table can run code. */
    for (gsize i = 0; i < G_N_ELEMENTS(session_tables); i++) {
        g_autofree char *sql =
            must_text(session, "SELECT sql FROM sqlite_schema WHERE type = 'table' AND name = ?1",
                      session_tables[i].name, error);

        g_autofree char *is = sql ? without_comments(sql) : NULL;
        g_autofree char *made = without_comments(session_tables[i].sql);

        g_autofree char *what = g_strdup_printf(
            "the definition of the table %s differs from a session's", session_tables[i].name);
        if (g_strcmp0(is, made) != 0)
            return sql && damaged(session, what, error);
    }
    return TRUE;
}

/* Checks that session.db exists and is a regular file, and also that the files that SQLite opens
 * next to it are regular files. SQLite would wait forever for a FIFO. */
static gboolean check_file(const Session *session, const char *file, GError **error) {
    static const char *const beside[] = {"", "-wal", "-shm", "-journal"};
    struct stat status;

    if (stat(file, &status) != 0) {
        const gboolean missing = errno == ENOENT || errno == ENOTDIR;
        return session_fail(
            error, missing ? SESSION_ERROR_FORMAT : SESSION_ERROR_IO,
            missing ? "%s: no session there: session.db: %s; give the directory of a session"
                    : "%s/session.db: cannot be read: %s; check its permissions and the disk",
            session->path, g_strerror(errno));
    }
    for (gsize i = 0; i < G_N_ELEMENTS(beside); i++) {
        g_autofree char *name = g_strconcat(file, beside[i], NULL);

        if (stat(name, &status) == 0 && !S_ISREG(status.st_mode))
            return session_fail(error, SESSION_ERROR_FORMAT,
                                "%s: this is %s, not a regular file; a session needs a file here",
                                name, input_file_kind(status.st_mode));
    }
    return TRUE;
}

/* Connects to the database. If alone is TRUE, the index of the WAL is kept in memory, and only this
 * process can use the database. */
static gboolean connect(Session *session, const char *name, int flags, gboolean alone,
                        GError **error) {
    int rc = sqlite3_open_v2(name, &session->db, flags | SQLITE_OPEN_URI, NULL);

    if (rc != SQLITE_OK)
        return session_db_fail(session, rc, error);
    /* Settings against hostile database files. */
    sqlite3_db_config(session->db, SQLITE_DBCONFIG_DEFENSIVE, 1, NULL);
    sqlite3_db_config(session->db, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, NULL);
    sqlite3_db_config(session->db, SQLITE_DBCONFIG_ENABLE_TRIGGER, 0, NULL);
    sqlite3_db_config(session->db, SQLITE_DBCONFIG_ENABLE_VIEW, 0, NULL);
    sqlite3_limit(session->db, SQLITE_LIMIT_LENGTH, MAX_TEXT);
    sqlite3_limit(session->db, SQLITE_LIMIT_ATTACHED, 0);
    sqlite3_extended_result_codes(session->db, 1);
    sqlite3_busy_timeout(session->db, PATIENCE_MS);
    return (!alone || session_db_run(session, error, "PRAGMA locking_mode = EXCLUSIVE", "")) &&
           session_db_run(session, error, "PRAGMA cell_size_check = ON", "") &&
           session_db_run(session, error, "PRAGMA foreign_keys = ON", "") &&
           session_db_run(session, error, "PRAGMA synchronous = FULL", "");
}

gboolean session_db_open(Session *session, gboolean create, GError **error) {
    g_autofree char *file = session_file(session, "session.db");
    g_autofree char *wal = g_strconcat(file, "-wal", NULL);
    g_autofree char *uri = g_filename_to_uri(file, NULL, NULL);
    int flags = session->mode == SESSION_READ ? SQLITE_OPEN_READONLY : SQLITE_OPEN_READWRITE;
    GError *own = NULL;
    struct stat status;

    if (create) {
        /* The file is created here, because SQLite would create a file that only its owner may
         * write, regardless of the umask. */
        int fd = g_open(file, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666);

        if (fd < 0)
            return session_fail(
                error, SESSION_ERROR_IO,
                "%s: cannot be made: %s; make the folder writable or free some space", file,
                g_strerror(errno));
        close(fd);
        return connect(session, uri, flags, FALSE, error);
    }
    if (!check_file(session, file, error))
        return FALSE;
    if (connect(session, uri, flags, FALSE, &own) && session_db_check(session, &own))
        return TRUE;
    /* The index of the WAL is a file that processes share. It cannot be created on a read-only
     * medium or on a full disk. No other process then has the session open.
     *
     * If the WAL is empty, the database file is complete and is opened without the WAL. If not, the
     * index is kept in memory, which needs a connection without locks of the file. */
    const int rc = sqlite3_errcode(session->db) & 0xff;
    const gboolean full = g_error_matches(own, SESSION_ERROR, SESSION_ERROR_FULL);
    const gboolean has_wal = stat(wal, &status) == 0 && status.st_size > 0;
    if (session->mode != SESSION_READ ||
        (!full && (has_wal || (rc != SQLITE_CANTOPEN && rc != SQLITE_READONLY)))) {
        g_propagate_error(error, own);
        return FALSE;
    }
    g_error_free(own);
    sqlite3_close(session->db);
    session->db = NULL;
    g_autofree char *alone = g_strconcat(uri, has_wal ? "?vfs=unix-none" : "?immutable=1", NULL);
    return connect(session, alone, flags, has_wal, error) && session_db_check(session, error);
}
