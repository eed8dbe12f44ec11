/* What session.c and the files session_*.c share: the struct Session, access to the database, and
 * the checks of a plan. */
#pragma once

#include "session.h"

#include <sqlite3.h>

struct Session {
    sqlite3 *db;
    char *path; /* absolute */
    char *name;
    enum session_mode mode;
    int lock; /* file descriptor that holds the capture lock, or −1 */
    /* session_create() is still making the session, so no data are lost if it fails */
    gboolean is_new;
};

G_DEFINE_AUTOPTR_CLEANUP_FUNC(sqlite3_stmt, sqlite3_finalize)

/* Sets an error of SESSION_ERROR. Always returns FALSE. */
gboolean session_fail(GError **error, enum session_error code, const char *format, ...)
    G_GNUC_PRINTF(3, 4);

/* Sets the error for an SQLite result code and adds advice for the user. Always returns FALSE. */
gboolean session_db_fail(const Session *session, int rc, GError **error);

/* Runs a statement and drops its result rows. types has one letter per argument: i for int, l for
 * gint64, d for double, s for const char * (NULL is stored as NULL). */
gboolean session_db_run(Session *session, GError **error, const char *sql, const char *types, ...);

/* Prepares a query, with arguments as for session_db_run(). Free it with sqlite3_finalize().
 * Returns NULL on error. */
sqlite3_stmt *session_db_query(Session *session, GError **error, const char *sql, const char *types,
                               ...);

/* Steps to the next row. Returns 1 if there is a row, 0 if there are no more rows, −1 on error. */
int session_db_next(Session *session, sqlite3_stmt *statement, GError **error);

char *session_db_text(sqlite3_stmt *statement, int column); /* g_free() */

/* Gives the text in the first column of the first row. If the query has the parameter ?1, key is
 * its value; otherwise key is NULL. *ret is NULL if there is no row, and on error. Returns the same
 * values as session_db_next(). */
int session_db_one_text(Session *session, const char *sql, const char *key, char **ret,
                        GError **error);

/* Opens session.db of session->path in session->mode. Fails if it is not a complete session. If
 * create is TRUE, makes an empty database instead; session.db must not exist. */
gboolean session_db_open(Session *session, gboolean create, GError **error);

/* Opens a session, and takes ownership of lock even if it fails. If lock is −1 and the mode is
 * SESSION_CAPTURE, takes the lock. */
Session *session_open_locked(const char *path, enum session_mode mode, int lock, GError **error);
/* Takes the capture lock. Returns its file descriptor, or −1 with an error, for example if another
 * process holds the lock. */
int session_lock(const char *path, GError **error);

/* How the column cameras of the table shot stores a set of cameras as a number. If all cameras are
 * below SESSION_MASK_CAMERAS, the number has bit c for camera c. Otherwise it is −n, and the value
 * SESSION_CAMERAS "n" has the text of the set (camera_set_to_text()). */
#define SESSION_MASK_CAMERAS 63
#define SESSION_CAMERAS      "cameras/"

/* Begin and end a transaction. session_begin() waits up to 10 s for a transaction of another
 * program. If session_commit() fails, it rolls the transaction back. session_rollback() does
 * nothing if there is no transaction. */
gboolean session_begin(Session *session, GError **error);
gboolean session_commit(Session *session, GError **error);
void session_rollback(Session *session);

/* Returns whether the session was opened in the mode `least` or in a mode that may do more. The
 * error is SESSION_ERROR_IO. */
gboolean session_may(const Session *session, enum session_mode least, GError **error);

/* Returns whether a path is relative and valid UTF-8, and has no component that is empty, "." or
 * "..". */
gboolean session_is_relative(const char *path);

extern const char *const session_shot_kinds[];  /* by enum session_shot_kind, NULL-terminated */
extern const char *const session_shot_states[]; /* by enum session_shot_state */

/* Check the parts of a plan, both before the plan is stored and after it was read. index and id are
 * the values that the part must have. The error is SESSION_ERROR_FORMAT; its message names no
 * file. */
gboolean session_check_grid(const struct session_grid *grid, GError **error);
gboolean session_check_direction(const struct session_direction *direction, int index,
                                 const char *kind, GError **error);
gboolean session_check_shot(const struct session_shot *shot, gint64 id, int n_lights, int n_lasers,
                            GError **error);

#define SESSION_TURNED "turned/" /* beginning of the name of a value, which SHOT/CAMERA follows */
