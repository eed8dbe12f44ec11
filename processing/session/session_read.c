/* Reads the plan, the frames and the events. The plan is checked as when a session is created,
 * because the database may have been edited. */
#include "session_private.h"

#include <math.h>
#include <string.h>

#define MAX_TEXELS 16384
#define MAX_NUMBER 1000000 /* maximum number of devices, poses and steps */

const char *const session_shot_kinds[] = {"dark", "lamp", "sweep", NULL};
const char *const session_shot_states[] = {"planned", "done", "skipped", NULL};

G_GNUC_PRINTF(2, 3)
static gboolean wrong(GError **error, const char *format, ...) {
    va_list list;
    va_start(list, format);
    g_autofree char *what = g_strdup_vprintf(format, list);
    va_end(list);
    return session_fail(error, SESSION_ERROR_FORMAT, "the session's plan is not valid: %s", what);
}

/* Completes the message of an error of wrong() with the file that was read, and with what to do. */
static void name_database(const Session *session, GError **error) {
    if (!error || !*error)
        return;
    g_prefix_error(error, "%s/session.db: ", session->path);
    char *text = g_strconcat((*error)->message, "; restore the database from a copy", NULL);
    g_free((*error)->message);
    (*error)->message = text;
}

gboolean session_check_grid(const struct session_grid *grid, GError **error) {
    if (grid->width < 1 || grid->width > MAX_TEXELS || grid->height < 1 ||
        grid->height > MAX_TEXELS)
        return wrong(error, "the grid has %d × %d texels, but must have 1 to %d in each dimension",
                     grid->width, grid->height, MAX_TEXELS);
    if (!(grid->width_mm > 0) || !isfinite(grid->width_mm) || !(grid->height_mm > 0) ||
        !isfinite(grid->height_mm))
        return wrong(error, "the grid is %g × %g mm, but each side must be above 0 and finite",
                     grid->width_mm, grid->height_mm);
    if (!isfinite(grid->reference_mm))
        return wrong(error, "the grid's reference_mm is %g, but must be finite",
                     grid->reference_mm);
    if (!(grid->depth_mm >= 0) || !isfinite(grid->depth_mm))
        return wrong(error, "the grid's depth_mm is %g, but must be at least 0 and finite",
                     grid->depth_mm);
    return TRUE;
}

gboolean session_check_direction(const struct session_direction *direction, int index,
                                 const char *kind, GError **error) {
    if (direction->index != index)
        return wrong(error, "%s %d, counted from 0, has the index %d", kind, index,
                     direction->index);
    if (direction->device < 0 || direction->device > MAX_NUMBER)
        return wrong(error, "%s %d has the device %d, but must have 0 to %d", kind, index,
                     direction->device, MAX_NUMBER);
    if (!isfinite(direction->theta_deg) || !isfinite(direction->phi_deg) ||
        !isfinite(direction->turntable_deg))
        return wrong(
            error, "%s %d has θ %g°, φ %g° and the turntable's angle %g°, but all must be finite",
            kind, index, direction->theta_deg, direction->phi_deg, direction->turntable_deg);
    return !direction->note || g_utf8_validate(direction->note, -1, NULL) ||
           wrong(error, "the note of %s %d is not UTF-8", kind, index);
}

/* Checks that the shot has this id, that its source is a planned light or laser position, and that
 * its other numbers are in range. */
gboolean session_check_shot(const struct session_shot *shot, gint64 id, int n_lights, int n_lasers,
                            GError **error) {
    int sources = shot->kind == SHOT_LAMP ? n_lights : shot->kind == SHOT_SWEEP ? n_lasers : 0;

    if (shot->id != id)
        return wrong(error,
                     "the ids of shots must be 1, 2, 3 and so on, but %" G_GINT64_FORMAT
                     " is followed by %" G_GINT64_FORMAT,
                     id - 1, shot->id);
    if (shot->kind > SHOT_SWEEP)
        return wrong(error, "the kind of shot %" G_GINT64_FORMAT " is not dark, lamp or sweep", id);
    if (shot->state > SHOT_SKIPPED)
        return wrong(error,
                     "the state of shot %" G_GINT64_FORMAT " is not planned, done or skipped", id);
    if (shot->kind == SHOT_DARK && shot->source != -1)
        return wrong(error,
                     "shot %" G_GINT64_FORMAT
                     " is dark, so that its source must be −1, but its source is %d",
                     id, shot->source);
    if (shot->kind != SHOT_DARK && (shot->source < 0 || shot->source >= sources))
        return wrong(
            error,
            "shot %" G_GINT64_FORMAT " uses the %s %d, counted from 0, but there are only %d", id,
            shot->kind == SHOT_LAMP ? "light" : "laser position", shot->source, sources);
    if (shot->device < -1 || shot->device > MAX_NUMBER)
        return wrong(error, "the device of shot %" G_GINT64_FORMAT " is %d, but must be −1 to %d",
                     id, shot->device, MAX_NUMBER);
    if (shot->pose < 0 || shot->pose > MAX_NUMBER)
        return wrong(error, "the pose of shot %" G_GINT64_FORMAT " is %d, but must be 0 to %d", id,
                     shot->pose, MAX_NUMBER);
    if (shot->sweep_steps < 0 || shot->sweep_steps > MAX_NUMBER)
        return wrong(error, "shot %" G_GINT64_FORMAT " has %d steps, but must have 0 to %d", id,
                     shot->sweep_steps, MAX_NUMBER);
    if (!isfinite(shot->turntable_deg) || !isfinite(shot->arc_deg) ||
        !isfinite(shot->sweep_from_deg) || !isfinite(shot->sweep_to_deg))
        return wrong(
            error,
            "shot %" G_GINT64_FORMAT " has the turntable at %g°, the arc at %g° and a sweep "
            "from %g° to %g°, but all must be finite",
            id, shot->turntable_deg, shot->arc_deg, shot->sweep_from_deg, shot->sweep_to_deg);
    return !shot->note || g_utf8_validate(shot->note, -1, NULL) ||
           wrong(error, "the note of shot %" G_GINT64_FORMAT " is not UTF-8", id);
}

/* Returns the integer in a column. If it is out of the range of int, returns G_MININT, which no
 * check of a plan accepts. */
static int column_int(sqlite3_stmt *statement, int column) {
    gint64 value = sqlite3_column_int64(statement, column);

    return value < G_MININT || value > G_MAXINT ? G_MININT : (int)value;
}

/* Returns the number in a column of text, or NAN if the text is not a number. */
static double column_number(sqlite3_stmt *statement, int column) {
    g_autofree char *text = session_db_text(statement, column);
    char *end = text;
    const double value = text ? g_ascii_strtod(text, &end) : NAN;

    return text && end != text && *end == '\0' ? value : NAN;
}

static int column_choice(sqlite3_stmt *statement, int column, const char *const *choices) {
    const char *text = (const char *)sqlite3_column_text(statement, column);
    int i = 0;

    while (choices[i] && g_strcmp0(choices[i], text) != 0)
        i++;
    return i; /* invalid index, which session_check_shot() refuses */
}

gboolean session_origin(Session *session, char **ret_program, char **ret_created, GError **error) {
    g_autoptr(sqlite3_stmt) statement =
        session_db_query(session, error, "SELECT program, created FROM session", "");
    const int rc = statement ? session_db_next(session, statement, error) : -1;

    if (rc > 0) {
        *ret_program = session_db_text(statement, 0);
        *ret_created = session_db_text(statement, 1);
    }
    return rc > 0 ||
           (rc == 0 &&
            session_fail(error, SESSION_ERROR_FORMAT,
                         "%s/session.db: the table “session” is empty; restore the database "
                         "from a copy",
                         session->path));
}

gboolean session_grid(Session *session, struct session_grid *ret, GError **error) {
    g_autoptr(sqlite3_stmt) row =
        session_db_query(session, error,
                         "SELECT width, height, width_mm, height_mm, reference_mm, depth_mm"
                         " FROM grid WHERE id = 1",
                         "");

    int rc = row ? session_db_next(session, row, error) : -1;

    if (rc == 0) {
        wrong(error, "there is no grid");
        name_database(session, error);
    }
    if (rc <= 0)
        return FALSE;
    *ret = (struct session_grid){
        .width = column_int(row, 0),
        .height = column_int(row, 1),
        .width_mm = sqlite3_column_double(row, 2),
        .height_mm = sqlite3_column_double(row, 3),
        .reference_mm = sqlite3_column_double(row, 4),
        .depth_mm = sqlite3_column_double(row, 5),
    };
    const gboolean ok = session_check_grid(ret, error);
    if (!ok)
        name_database(session, error);
    return ok;
}

/* Returns a new element made from a row, or NULL with an error if the row is not valid. number is
 * the index of the row, from 0. */
typedef gpointer (*ReadRow)(sqlite3_stmt *row, int number, gpointer data, GError **error);

/* Returns an array with the element of each row of a query. If the query has the parameter ?1, key
 * is its value, and also the data of read_row. Otherwise key is NULL. */
static GPtrArray *session_read_rows(Session *session, const char *sql, const char *key,
                                    GDestroyNotify free_row, ReadRow read_row, GError **error) {
    g_autoptr(GPtrArray) rows = g_ptr_array_new_with_free_func(free_row);
    g_autoptr(sqlite3_stmt) statement = session_db_query(session, error, sql, key ? "s" : "", key);
    int rc = -1;

    while (statement && (rc = session_db_next(session, statement, error)) > 0) {
        gpointer row = read_row(statement, (int)rows->len, (gpointer)key, error);

        if (!row) {
            name_database(session, error);
            return NULL;
        }
        g_ptr_array_add(rows, row);
    }
    return rc == 0 ? g_steal_pointer(&rows) : NULL;
}

static void direction_free(gpointer data) {
    struct session_direction *direction = data;

    g_free(direction->note);
    g_free(direction);
}

static gpointer read_direction(sqlite3_stmt *row, int number, gpointer kind, GError **error) {
    struct session_direction *direction = g_new0(struct session_direction, 1);

    direction->index = column_int(row, 0);
    direction->device = column_int(row, 1);
    direction->theta_deg = sqlite3_column_double(row, 2);
    direction->phi_deg = sqlite3_column_double(row, 3);
    direction->turntable_deg = sqlite3_column_double(row, 4);
    direction->note = session_db_text(row, 5);
    if (!session_check_direction(direction, number, kind, error))
        g_clear_pointer(&direction, direction_free);
    return direction;
}

static GPtrArray *directions(Session *session, const char *kind, GError **error) {
    return session_read_rows(session,
                             "SELECT idx, device, theta_deg, phi_deg, turntable_deg, note"
                             " FROM direction WHERE kind = ?1 ORDER BY idx",
                             kind, direction_free, read_direction, error);
}

GPtrArray *session_views(Session *session, GError **error) {
    return directions(session, "view", error);
}

GPtrArray *session_lights(Session *session, GError **error) {
    return directions(session, "light", error);
}

GPtrArray *session_lasers(Session *session, GError **error) {
    return directions(session, "laser", error);
}

static void shot_free(gpointer data) {
    struct session_shot *shot = data;

    g_free(shot->note);
    g_free(shot);
}

/* Reads a set of cameras. number is the number in the column cameras (session_private.h). If it is
 * negative, value is the text that it refers to, or NULL if there is no such text. Returns FALSE if
 * number is negative and the text is missing or not valid. */
static gboolean read_cameras(gint64 number, const char *value, struct camera_set *ret) {
    if (number < 0)
        return value && *value && camera_set_from_text(value, ret);
    for (int c = 0; c < SESSION_MASK_CAMERAS; c++)
        if (number >> c & 1)
            camera_set_add(ret, c);
    return TRUE;
}

/* Returns NULL with an error if the row violates the checks. */
static gpointer read_shot(sqlite3_stmt *row, int number, gpointer data, GError **error) {
    struct session_shot *shot = g_new0(struct session_shot, 1);
    const gint64 cameras = sqlite3_column_int64(row, 7);
    const char *value = (const char *)sqlite3_column_text(row, 15);

    shot->id = sqlite3_column_int64(row, 0);
    shot->kind = (enum session_shot_kind)column_choice(row, 1, session_shot_kinds);
    shot->pose = column_int(row, 2);
    shot->turntable_deg = sqlite3_column_double(row, 3);
    shot->arc_deg = sqlite3_column_double(row, 4);
    shot->source = column_int(row, 5);
    shot->device = column_int(row, 6);
    shot->sweep_from_deg = sqlite3_column_double(row, 8);
    shot->sweep_to_deg = sqlite3_column_double(row, 9);
    shot->sweep_steps = column_int(row, 10);
    shot->state = (enum session_shot_state)column_choice(row, 11, session_shot_states);
    shot->note = session_db_text(row, 12);
    if (!read_cameras(cameras, value, &shot->cameras))
        wrong(error,
              "the cameras of shot %" G_GINT64_FORMAT " are %" G_GINT64_FORMAT
              ", so that the value " SESSION_CAMERAS "%" G_GUINT64_FORMAT
              " must be their numbers in ascending order, 0 to %d, but it is %s%s%s",
              shot->id, cameras, 0 - (guint64)cameras, CAMERA_SET_MAX - 1, value ? "“" : "",
              value ? value : "missing", value ? "”" : "");
    else if (session_check_shot(shot, number + 1, column_int(row, 13), column_int(row, 14), error))
        return shot;
    shot_free(shot);
    return NULL;
}

GPtrArray *session_shots(Session *session, GError **error) {
    return session_read_rows(
        session,
        "SELECT id, kind, pose, turntable_deg, arc_deg, source, device, cameras, sweep_from_deg,"
        " sweep_to_deg, sweep_steps, state, note,"
        " (SELECT count(*) FROM direction WHERE kind = 'light'),"
        " (SELECT count(*) FROM direction WHERE kind = 'laser'),"
        " (SELECT value FROM value WHERE key = '" SESSION_CAMERAS "' || -cameras)"
        " FROM shot ORDER BY id",
        NULL, shot_free, read_shot, error);
}

static void frame_free(gpointer data) {
    struct session_frame *frame = data;

    g_free(frame->path);
    g_free(frame->sha256);
    g_free(frame);
}

static gpointer read_frame(sqlite3_stmt *row, int number, gpointer data, GError **error) {
    struct session_frame *frame = g_new0(struct session_frame, 1);

    frame->shot = sqlite3_column_int64(row, 0);
    frame->camera = column_int(row, 1);
    frame->path = session_db_text(row, 2);
    frame->sha256 = session_db_text(row, 3);
    frame->bytes = sqlite3_column_int64(row, 4);
    frame->retakes = column_int(row, 5);
    frame->captured_s = sqlite3_column_double(row, 6);
    frame->turned = sqlite3_column_type(row, 7) != SQLITE_NULL;
    frame->turntable_deg = frame->turned ? column_number(row, 7) : 0;
    if (frame->camera < 0 || frame->camera >= CAMERA_SET_MAX)
        wrong(error,
              "a frame of shot %" G_GINT64_FORMAT " has the camera %d, but must have 0 to %d",
              frame->shot, frame->camera, CAMERA_SET_MAX - 1);
    else if (!session_is_relative(frame->path))
        wrong(error,
              "the frame of camera %d in shot %" G_GINT64_FORMAT " has a path out of the "
              "session",
              frame->camera, frame->shot);
    else if (!frame->sha256 || frame->bytes < 0)
        wrong(error,
              "the frame of camera %d in shot %" G_GINT64_FORMAT " has no checksum or no size",
              frame->camera, frame->shot);
    else if (!isfinite(frame->turntable_deg))
        wrong(error,
              "the turntable's angle of the frame of camera %d in shot %" G_GINT64_FORMAT
              " is not a finite number",
              frame->camera, frame->shot);
    else
        return frame;
    frame_free(frame);
    return NULL;
}

GPtrArray *session_frames(Session *session, GError **error) {
    return session_read_rows(session,
                             "SELECT shot, camera, path, sha256, bytes, retakes, captured_s,"
                             " value.value FROM frame JOIN shot ON shot.id = frame.shot"
                             " LEFT JOIN value ON value.key ="
                             " '" SESSION_TURNED "' || frame.shot || '/' || frame.camera"
                             " ORDER BY shot, camera",
                             NULL, frame_free, read_frame, error);
}

static void event_free(gpointer data) {
    struct session_event *event = data;

    g_free(event->level);
    g_free(event->source);
    g_free(event->message);
    g_free(event);
}

static gpointer read_event(sqlite3_stmt *row, int number, gpointer data, GError **error) {
    struct session_event *event = g_new0(struct session_event, 1);

    event->time_s = sqlite3_column_double(row, 0);
    event->level = session_db_text(row, 1);
    event->source = session_db_text(row, 2);
    event->message = session_db_text(row, 3);
    return event;
}

GPtrArray *session_events(Session *session, GError **error) {
    return session_read_rows(session,
                             "SELECT time_s, level, source, message FROM event ORDER BY id", NULL,
                             event_free, read_event, error);
}
