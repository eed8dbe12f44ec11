/* Access to SQLite. A database is opened only if its format, its tables' texts and its structure
 * are those of this program: it may come from a stranger. */
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
#define PATIENCE_MS 10000 /* longest wait for another program's transaction */

gboolean session_db_fail(const Session *session, int rc, GError **error) {
    int saved = session->db ? sqlite3_system_errno(session->db) : 0;
    const char *says = session->db ? sqlite3_errmsg(session->db) : sqlite3_errstr(rc);
    int primary = rc & 0xff;

    if (primary == SQLITE_FULL || (primary == SQLITE_IOERR && (saved == ENOSPC || saved == EDQUOT)))
        g_set_error(error, SESSION_ERROR, SESSION_ERROR_FULL,
                    "%s: the disk is full; nothing was lost: free some space and go on",
                    session->path);
    else if (primary == SQLITE_NOTADB)
        g_set_error(error, SESSION_ERROR, SESSION_ERROR_FORMAT,
                    "%s/session.db: not a session's database: %s", session->path, says);
    else if (primary == SQLITE_CORRUPT || primary == SQLITE_FORMAT || primary == SQLITE_TOOBIG)
        g_set_error(error, SESSION_ERROR, SESSION_ERROR_FORMAT,
                    "%s/session.db: damaged: %s; restore it from a backup, or try "
                    "'sqlite3 session.db .recover' on a copy",
                    session->path, says);
    else if (primary == SQLITE_BUSY || primary == SQLITE_LOCKED)
        g_set_error(error, SESSION_ERROR, SESSION_ERROR_IO,
                    "%s/session.db: another program keeps it locked; close it and try again",
                    session->path);
    else if (primary == SQLITE_CONSTRAINT || primary == SQLITE_MISMATCH)
        g_set_error(error, SESSION_ERROR, SESSION_ERROR_FORMAT, "%s/session.db: refused: %s",
                    session->path, says);
    else
        g_set_error(error, SESSION_ERROR, saved == EFBIG ? SESSION_ERROR_FULL : SESSION_ERROR_IO,
                    "%s/session.db: %s%s%s", session->path, says, saved ? ": " : "",
                    saved ? g_strerror(saved) : "");
    return FALSE;
}

static int session_db_bind(sqlite3_stmt *statement, const char *types, va_list list) {
    int rc = SQLITE_OK;

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
    return rc;
}

static sqlite3_stmt *session_db_do_query(Session *session, GError **error, const char *sql,
                                         const char *types, va_list list) {
    g_autoptr(sqlite3_stmt) statement = NULL;
    int rc = sqlite3_prepare_v2(session->db, sql, -1, &statement, NULL);

    if (rc == SQLITE_OK)
        rc = session_db_bind(statement, types, list);
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
    statement = session_db_do_query(session, error, sql, types, list);
    va_end(list);
    return statement;
}

gboolean session_db_next(Session *session, sqlite3_stmt *statement, GError **error) {
    int rc = sqlite3_step(statement);

    if (rc != SQLITE_ROW && rc != SQLITE_DONE)
        return session_db_fail(session, sqlite3_extended_errcode(session->db), error);
    return rc == SQLITE_ROW;
}

gboolean session_db_run(Session *session, GError **error, const char *sql, const char *types, ...) {
    g_autoptr(sqlite3_stmt) statement = NULL;
    g_autoptr(GError) own = NULL;
    va_list list;

    va_start(list, types);
    statement = session_db_do_query(session, error, sql, types, list);
    va_end(list);
    if (!statement)
        return FALSE;
    while (session_db_next(session, statement, &own))
        ;
    if (own)
        g_propagate_error(error, g_steal_pointer(&own));
    else
        return TRUE;
    return FALSE;
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

static gboolean session_db_damaged(const Session *session, const char *what, GError **error) {
    g_autofree char *valid = g_utf8_make_valid(what ? what : "", -1);

    g_set_error(error, SESSION_ERROR, SESSION_ERROR_FORMAT,
                "%s/session.db: damaged: %s; restore it from a backup, or try "
                "'sqlite3 session.db .recover' on a copy",
                session->path, valid);
    return FALSE;
}

/* For queries that always have a row, unless the file is damaged. */
static gboolean must_next(Session *session, sqlite3_stmt *statement, GError **error) {
    g_autoptr(GError) own = NULL;

    if (session_db_next(session, statement, &own))
        return TRUE;
    if (!own)
        return session_db_damaged(session, "a row is missing", error);
    g_propagate_error(error, g_steal_pointer(&own));
    return FALSE;
}

static gboolean one_number(Session *session, const char *sql, gint64 *ret, GError **error) {
    g_autoptr(sqlite3_stmt) statement = session_db_query(session, error, sql, "");

    if (!statement || !must_next(session, statement, error))
        return FALSE;
    *ret = sqlite3_column_int64(statement, 0);
    return TRUE;
}

static gboolean check_version(Session *session, GError **error) {
    gint64 application = 0, version = 0;

    if (!one_number(session, "PRAGMA application_id", &application, error) ||
        !one_number(session, "PRAGMA user_version", &version, error))
        return FALSE;
    if (application != SESSION_APPLICATION_ID) {
        g_set_error(error, SESSION_ERROR, SESSION_ERROR_FORMAT,
                    "%s/session.db: a database, but not of a session", session->path);
        return FALSE;
    }
    if (version != SESSION_FORMAT) {
        g_set_error(error, SESSION_ERROR, SESSION_ERROR_FORMAT,
                    "%s: session format %" G_GINT64_FORMAT ", this program knows %d%s",
                    session->path, version, SESSION_FORMAT,
                    version > SESSION_FORMAT ? "; use a newer program" : "");
        return FALSE;
    }
    return TRUE;
}

/* SQLite's own check of the file's structure. */
static gboolean check_sound(Session *session, GError **error) {
    g_autoptr(sqlite3_stmt) statement =
        session_db_query(session, error, "PRAGMA quick_check(1)", "");
    const char *says;

    if (!statement || !must_next(session, statement, error))
        return FALSE;
    says = (const char *)sqlite3_column_text(statement, 0);
    return g_strcmp0(says, "ok") == 0 || session_db_damaged(session, says, error);
}

/* Compares the table's text with the schema, so that no computed column or virtual table can run
 * code. */
static gboolean check_table(Session *session, const struct session_table *table, GError **error) {
    g_autoptr(sqlite3_stmt) statement = session_db_query(
        session, error, "SELECT sql FROM sqlite_schema WHERE type = 'table' AND name = ?1", "s",
        table->name);

    if (!statement || !must_next(session, statement, error))
        return FALSE;
    return g_strcmp0((const char *)sqlite3_column_text(statement, 0), table->sql) == 0 ||
           session_db_damaged(session, "a table is not as it was made", error);
}

/* SQLite opens these files itself, and would block on a FIFO. */
static gboolean check_file(const Session *session, const char *file, GError **error) {
    static const char *const beside[] = {"", "-wal", "-shm", "-journal"};
    struct stat status;

    if (stat(file, &status) != 0) {
        int saved = errno;

        g_set_error(error, SESSION_ERROR,
                    saved == ENOENT || saved == ENOTDIR ? SESSION_ERROR_FORMAT : SESSION_ERROR_IO,
                    "%s: no session there: session.db: %s", session->path, g_strerror(saved));
        return FALSE;
    }
    for (gsize i = 0; i < G_N_ELEMENTS(beside); i++) {
        g_autofree char *name = g_strconcat(file, beside[i], NULL);

        if (stat(name, &status) == 0 && !S_ISREG(status.st_mode)) {
            g_set_error(error, SESSION_ERROR, SESSION_ERROR_FORMAT,
                        "%s: it is %s, not a regular file", name, input_file_kind(status.st_mode));
            return FALSE;
        }
    }
    return TRUE;
}

/* Settings against hostile database files. */
static void harden(sqlite3 *db) {
    sqlite3_db_config(db, SQLITE_DBCONFIG_DEFENSIVE, 1, NULL);
    sqlite3_db_config(db, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, NULL);
    sqlite3_db_config(db, SQLITE_DBCONFIG_ENABLE_TRIGGER, 0, NULL);
    sqlite3_db_config(db, SQLITE_DBCONFIG_ENABLE_VIEW, 0, NULL);
    sqlite3_limit(db, SQLITE_LIMIT_LENGTH, MAX_TEXT);
    sqlite3_limit(db, SQLITE_LIMIT_ATTACHED, 0);
    sqlite3_extended_result_codes(db, 1);
    sqlite3_busy_timeout(db, PATIENCE_MS);
}

static gboolean connect(Session *session, const char *name, int flags, GError **error) {
    int rc = sqlite3_open_v2(name, &session->db, flags | SQLITE_OPEN_URI, NULL);

    if (rc != SQLITE_OK)
        return session_db_fail(session, rc, error);
    harden(session->db);
    return session_db_run(session, error, "PRAGMA cell_size_check = ON", "") &&
           session_db_run(session, error, "PRAGMA foreign_keys = ON", "") &&
           session_db_run(session, error, "PRAGMA synchronous = FULL", "");
}

static gboolean session_db_check(Session *session, GError **error) {
    gboolean ok = check_version(session, error) && check_sound(session, error);

    for (gsize i = 0; ok && i < G_N_ELEMENTS(session_tables); i++)
        ok = check_table(session, &session_tables[i], error);
    return ok;
}

/* On a read-only medium a reader cannot create the shared index of the WAL; if the WAL is empty
 * the database file alone is complete. */
static gboolean may_be_immutable(const Session *session, const char *file) {
    g_autofree char *wal = g_strconcat(file, "-wal", NULL);
    int rc = sqlite3_errcode(session->db) & 0xff;
    struct stat status;

    return session->mode == SESSION_READ && (rc == SQLITE_CANTOPEN || rc == SQLITE_READONLY) &&
           (stat(wal, &status) != 0 || status.st_size == 0);
}

/* SQLite creates files writable by the owner only, whatever the umask; create the file first. */
static gboolean make_file(const Session *session, const char *file, GError **error) {
    int fd = g_open(file, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666);

    if (fd < 0)
        g_set_error(error, SESSION_ERROR, SESSION_ERROR_IO, "%s: %s", file, g_strerror(errno));
    else
        close(fd);
    return fd >= 0;
}

gboolean session_db_open(Session *session, gboolean create, GError **error) {
    g_autofree char *file = session_file(session, "session.db");
    g_autofree char *uri = g_filename_to_uri(file, NULL, NULL);
    g_autofree char *immutable = g_strconcat(uri, "?immutable=1", NULL);
    g_autoptr(GError) own = NULL;
    int flags = session->mode == SESSION_READ ? SQLITE_OPEN_READONLY : SQLITE_OPEN_READWRITE;

    if (create)
        return make_file(session, file, error) && connect(session, uri, flags, error);
    if (!check_file(session, file, error))
        return FALSE;
    if (connect(session, uri, flags, &own) && session_db_check(session, &own))
        return TRUE;
    if (!may_be_immutable(session, file)) {
        g_propagate_error(error, g_steal_pointer(&own));
        return FALSE;
    }
    sqlite3_close(session->db);
    session->db = NULL;
    return connect(session, immutable, flags, error) && session_db_check(session, error);
}
