/* What the sources of session.h share. */
#pragma once

#include "session.h"

#include <sqlite3.h>

struct Session {
    sqlite3 *db;
    char *path; /* absolute */
    char *name;
    enum session_mode mode;
    int lock; /* file descriptor that holds the capture lock, or −1 */
};

G_DEFINE_AUTOPTR_CLEANUP_FUNC(sqlite3_stmt, sqlite3_finalize)

/* Says what SQLite says, as the error that a user can do something about. Always FALSE. */
gboolean session_db_fail(const Session *session, int rc, GError **error);

/* Statements whose rows nobody wants. types has a letter an argument: i int, l gint64, d double,
 * s const char * (NULL is stored as NULL). */
gboolean session_db_run(Session *session, GError **error, const char *sql, const char *types, ...);

/* NULL on error. Bind as above. */
sqlite3_stmt *session_db_query(Session *session, GError **error, const char *sql, const char *types,
                               ...);

/* TRUE while there is a row. At the end FALSE without an error. */
gboolean session_db_next(Session *session, sqlite3_stmt *statement, GError **error);

/* Opens session.db of session->path as its mode says and refuses what is not a whole session. */
gboolean session_db_open(Session *session, gboolean create, GError **error);

/* Takes over lock, which may be −1: then SESSION_CAPTURE takes the lock itself. */
Session *session_open_locked(const char *path, enum session_mode mode, int lock, GError **error);
int session_lock(const char *path, GError **error); /* −1: somebody else has it */

gboolean session_begin(Session *session, GError **error);
gboolean session_commit(Session *session, GError **error);
void session_rollback(Session *session);

gboolean session_may(const Session *session, enum session_mode least, GError **error);

/* A name inside the session directory, that cannot lead out of it. */
gboolean session_is_relative(const char *path);

extern const char *const session_shot_kinds[];  /* by enum session_shot_kind, NULL-terminated */
extern const char *const session_shot_states[]; /* by enum session_shot_state */

/* What holds for every plan, whether it is to be stored or was read. */
gboolean session_check_grid(const struct session_grid *grid, GError **error);
gboolean session_check_direction(const struct session_direction *direction, int index,
                                 const char *kind, GError **error);
gboolean session_check_shot(const struct session_shot *shot, gint64 id, int n_lights, int n_lasers,
                            GError **error);
