/* Commits shots with their frames, and verifies frames when a capture resumes. A frame's row is
 * written only after its file is on disk, so that every row has its file. */
#include "session_private.h"

#include "base/new_file.h"

#include <errno.h>
#include <math.h>
#include <string.h>
#include <sys/stat.h>

#define AGAIN "; resume the capture, or repeat the import"

G_GNUC_PRINTF(4, 5)
static gboolean refuse(const Session *session, const struct session_frame *frame, GError **error,
                       const char *format, ...) {
    va_list list;
    va_start(list, format);
    g_autofree char *what = g_strdup_vprintf(format, list);
    va_end(list);
    return session_fail(
        error, SESSION_ERROR_IO, "%s: frame of shot %" G_GINT64_FORMAT ", camera %d, \"%s\": %s",
        session->path, frame->shot, frame->camera, frame->path ? frame->path : "", what);
}

/* Returns the size of a file in bytes. Returns −1 if the file is missing or not a regular file.
 * Returns −2, with errno, if the file cannot be examined. */
static gint64 size_of(const Session *session, const char *relative) {
    g_autofree char *file = session_file(session, relative);
    struct stat status;

    if (lstat(file, &status) == 0)
        return S_ISREG(status.st_mode) ? (gint64)status.st_size : -1;
    return errno == ENOENT || errno == ENOTDIR || errno == ENAMETOOLONG || errno == ELOOP ? -1 : -2;
}

static gboolean check_frames(const Session *session, gint64 shot, enum session_shot_state state,
                             const struct session_frame *frames, int n_frames, GError **error) {
    if (state == SHOT_PLANNED && n_frames > 0)
        return session_fail(error, SESSION_ERROR_FORMAT,
                            "%s: shot %" G_GINT64_FORMAT
                            " is planned and not done, so that its %d frames cannot be committed",
                            session->path, shot, n_frames);
    for (int i = 0; i < n_frames; i++) {
        const struct session_frame *frame = &frames[i];
        const char *sum = frame->sha256 ? frame->sha256 : "";

        if (frame->shot != shot)
            return refuse(session, frame, error,
                          "the frame is committed with shot %" G_GINT64_FORMAT, shot);
        if (frame->camera < 0 || frame->camera >= CAMERA_SET_MAX)
            return refuse(session, frame, error,
                          "the number of the camera must be 0 to %d; this is a fault of the "
                          "program: report it",
                          CAMERA_SET_MAX - 1);
        if (!session_is_relative(frame->path))
            return refuse(session, frame, error, "the path leads out of the session");
        if (strlen(sum) != 64 || strspn(sum, "0123456789abcdef") != 64)
            return refuse(session, frame, error,
                          "the checksum is “%s”, but must be 64 hexadecimal digits", sum);
        if (!isfinite(frame->captured_s) || !isfinite(frame->turntable_deg))
            return refuse(session, frame, error,
                          "the time %g s or the turntable's angle %g° is not finite",
                          frame->captured_s, frame->turntable_deg);
        const gint64 bytes = size_of(session, frame->path);
        if (bytes == -2)
            return refuse(session, frame, error, "the file cannot be read: %s; check the disk",
                          g_strerror(errno));
        if (bytes < 0)
            return refuse(session, frame, error, "the file is missing or not a regular file" AGAIN);
        if (bytes != frame->bytes)
            return refuse(session, frame, error,
                          "the file has %" G_GINT64_FORMAT " bytes, but %" G_GINT64_FORMAT
                          " bytes were written" AGAIN,
                          bytes, frame->bytes);
    }
    return TRUE;
}

static gboolean set_state(Session *session, gint64 shot, enum session_shot_state state,
                          const char *note, GError **error) {
    g_autofree char *valid = note ? g_utf8_make_valid(note, -1) : NULL;

    if (!session_db_run(session, error, "UPDATE shot SET state = ?2, note = ?3 WHERE id = ?1",
                        "lss", shot, session_shot_states[state], valid))
        return FALSE;
    return sqlite3_changes(session->db) == 1 ||
           session_fail(error, SESSION_ERROR_FORMAT,
                        "%s: the plan of this session has no shot %" G_GINT64_FORMAT, session->path,
                        shot);
}

static gboolean store_turned(Session *session, const struct session_frame *frame, GError **error) {
    char deg[G_ASCII_DTOSTR_BUF_SIZE];
    g_autofree char *key =
        g_strdup_printf(SESSION_TURNED "%" G_GINT64_FORMAT "/%d", frame->shot, frame->camera);

    return !frame->turned ||
           session_set_value(session, key, g_ascii_dtostr(deg, sizeof deg, frame->turntable_deg),
                             error);
}

/* Replaces the frames of a shot in the database, with their angles. The caller has begun a
 * transaction. */
static gboolean replace_frames(Session *session, gint64 shot, const struct session_frame *frames,
                               int n_frames, GError **error) {
    /* The names of all values between `from` and `to` begin with "turned/SHOT/", because '0'
     * follows '/' in ASCII. */
    g_autofree char *from = g_strdup_printf(SESSION_TURNED "%" G_GINT64_FORMAT "/", shot);
    g_autofree char *to = g_strdup_printf(SESSION_TURNED "%" G_GINT64_FORMAT "0", shot);
    gboolean ok = session_db_run(session, error, "DELETE FROM frame WHERE shot = ?1", "l", shot) &&
                  session_db_run(session, error, "DELETE FROM value WHERE key > ?1 AND key < ?2",
                                 "ss", from, to);

    for (int i = 0; ok && i < n_frames; i++)
        ok = session_db_run(session, error, "INSERT INTO frame VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)",
                            "lisslid", shot, frames[i].camera, frames[i].path, frames[i].sha256,
                            frames[i].bytes, frames[i].retakes, frames[i].captured_s) &&
             store_turned(session, &frames[i], error);
    return ok;
}

/* All rows are written in one transaction, so that a reader never sees half of a shot. The frames
 * are checked before the transaction begins. */
gboolean session_commit_shot(Session *session, gint64 shot, enum session_shot_state state,
                             const struct session_frame *frames, int n_frames, const char *note,
                             GError **error) {
    g_return_val_if_fail(state <= SHOT_SKIPPED, FALSE);
    if (!session_may(session, SESSION_CAPTURE, error) ||
        !check_frames(session, shot, state, frames, n_frames, error) ||
        !session_begin(session, error))
        return FALSE;
    if (set_state(session, shot, state, note, error) &&
        replace_frames(session, shot, frames, n_frames, error))
        return session_commit(session, error);
    session_rollback(session);
    return FALSE;
}

/* A damaged frame is noted in a value. This is the beginning of the value's name, which the path of
 * the frame follows. */
#define NOTED "damaged/"

gboolean session_note_damage(Session *session, const char *frame, const char *what,
                             GError **error) {
    g_autofree char *key = g_strconcat(NOTED, frame, NULL);

    return session_set_value(session, key, what, error);
}

/* Removes all frames of every shot that has lost a frame, because a shot is captured as a whole.
 * The shot is planned again, and an event says why. Also deletes the notes of
 * session_note_damage(). For each frame, why has the reason if the frame is lost, and NULL
 * otherwise. Uses one short transaction. */
static gboolean forget_shots(Session *session, const GPtrArray *frames, const GPtrArray *why,
                             GError **error) {
    g_autofree char *clock = session_value(session, "clock_s");
    double now_s = clock ? g_ascii_strtod(clock, NULL) : 0;
    gboolean ok =
        session_begin(session, error) &&
        session_db_run(session, error, "DELETE FROM value WHERE substr(key, 1, length(?1)) = ?1",
                       "s", NOTED);

    for (guint i = 0; ok && i < frames->len; i++) {
        const struct session_frame *frame = g_ptr_array_index(frames, i);
        const char *wrong = g_ptr_array_index(why, i);

        if (!wrong)
            continue;
        g_autofree char *message =
            g_strdup_printf("shot %" G_GINT64_FORMAT " is planned again: %s", frame->shot, wrong);
        ok = set_state(session, frame->shot, SHOT_PLANNED, wrong, error) &&
             replace_frames(session, frame->shot, NULL, 0, error) &&
             session_add_event(session, isfinite(now_s) ? now_s : 0, "warning", "session", message,
                               error);
    }
    if (ok)
        return session_commit(session, error);
    session_rollback(session);
    return FALSE;
}

/* Returns the set of the paths of dark frames and of frames that were noted as damaged.
 * session_verify() compares the checksums of these frames even if it is not thorough. */
static GHashTable *suspects(Session *session, GError **error) {
    g_autoptr(GHashTable) noted = session_values(session, NOTED, error);
    g_autoptr(GHashTable) paths = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, NULL);
    g_autoptr(sqlite3_stmt) darks =
        noted ? session_db_query(session, error,
                                 "SELECT path FROM frame JOIN shot ON shot.id = frame.shot"
                                 " WHERE kind = 'dark'",
                                 "")
              : NULL;
    GHashTableIter iter;
    gpointer key;
    int rc;

    if (!darks)
        return NULL;
    g_hash_table_iter_init(&iter, noted);
    while (g_hash_table_iter_next(&iter, &key, NULL))
        g_hash_table_add(paths, g_strdup((const char *)key + strlen(NOTED)));
    while ((rc = session_db_next(session, darks, error)) > 0)
        g_hash_table_add(paths, session_db_text(darks, 0));
    return rc == 0 ? g_steal_pointer(&paths) : NULL;
}

void session_remove_unfinished(const Session *session) {
    new_file_remove_left(session->path, "frames", "");
    new_file_remove_left(session->path, "laser", "");
}

/* Sets the error for a frame that the disk fails to read, and returns FALSE. Such a frame does not
 * count as lost, because a failing disk would otherwise plan all shots again. */
static gboolean unreadable(const Session *session, const char *relative, const char *why,
                           GError **error) {
    return session_fail(error, SESSION_ERROR_IO,
                        "%s/%s: cannot be read: %s; check the disk and try again; if only this "
                        "file stays unreadable, remove it, and its shot is taken again",
                        session->path, relative, why);
}

/* Returns a description of the damage of a committed frame, or NULL if the frame is intact.
 * Compares the checksum only if hashed is TRUE. If the disk fails to read the frame, *ret_ok is
 * FALSE, the error is set, and the result is NULL. */
static char *session_commit_damage(const Session *session, const struct session_frame *frame,
                                   gboolean hashed, gboolean *ret_ok, GError **error) {
    const gint64 size = size_of(session, frame->path);
    char *wrong = NULL;

    *ret_ok = size != -2 || unreadable(session, frame->path, g_strerror(errno), error);
    if (size < 0)
        return *ret_ok ? g_strdup_printf("%s is gone", frame->path) : NULL;
    if (size != frame->bytes)
        return g_strdup_printf("%s has %" G_GINT64_FORMAT " bytes, but had %" G_GINT64_FORMAT
                               " when it was taken",
                               frame->path, size, frame->bytes);
    struct session_damage *damage =
        hashed ? session_examine(session, frame->path, frame->sha256) : NULL;
    if (damage && damage->unreadable)
        *ret_ok = unreadable(session, frame->path, damage->what, error);
    else if (damage)
        wrong = g_strdup_printf("%s is not as it was taken: %s", frame->path, damage->what);
    session_damage_free(damage);
    return wrong;
}

/* The files are compared outside of a transaction, because a transaction would block other writers
 * for minutes. */
gboolean session_verify(Session *session, gboolean thorough, int *ret_lost, GError **error) {
    g_autoptr(GPtrArray) frames = NULL;
    g_autoptr(GHashTable) suspected = NULL;
    /* damage of each frame, or NULL */
    g_autoptr(GPtrArray) why = g_ptr_array_new_with_free_func(g_free);
    int lost = 0;

    if (!session_may(session, SESSION_CAPTURE, error) ||
        !(frames = session_frames(session, error)) || !(suspected = suspects(session, error)))
        return FALSE;
    session_remove_unfinished(session);
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = g_ptr_array_index(frames, i);
        const gboolean hashed = thorough || g_hash_table_contains(suspected, frame->path);
        gboolean ok;
        char *wrong = session_commit_damage(session, frame, hashed, &ok, error);

        if (!ok)
            return FALSE;
        g_ptr_array_add(why, wrong);
        lost += wrong != NULL;
    }
    if ((lost > 0 || g_hash_table_size(suspected) > 0) &&
        !forget_shots(session, frames, why, error))
        return FALSE;
    if (ret_lost)
        *ret_lost = lost;
    return TRUE;
}
