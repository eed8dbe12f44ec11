/* Creates a session. The database and the folders are made under a hidden name and synced. Then the
 * directory is renamed. */
#include "session_private.h"
#include "session_schema.h"

#include "base/output_file.h"

#include <errno.h>
#include <fcntl.h>
#include <gio/gio.h>
#include <glib/gstdio.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static gboolean fail_errno(const char *path, int saved, GError **error) {
    enum session_error code = SESSION_ERROR_IO;

    if (saved == EEXIST || saved == ENOTEMPTY)
        code = SESSION_ERROR_EXISTS;
    else if (saved == ENOSPC || saved == EDQUOT)
        code = SESSION_ERROR_FULL;
    if (code == SESSION_ERROR_EXISTS)
        return session_fail(error, code, "%s: exists already; take another name", path);
    return session_fail(
        error, code,
        "%s: cannot be made: %s; make the folder that contains it writable, or free some space",
        path, g_strerror(saved));
}

/* Syncs a folder, so that new directory entries are durable. */
static gboolean sync_folder(const char *path, GError **error) {
    int fd = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    gboolean ok = fd >= 0 && fsync(fd) == 0;
    int saved = errno;

    if (fd >= 0)
        close(fd);
    return ok || fail_errno(path, saved, error);
}

static gboolean check_texts(const char *name, const struct session_texts *texts, GError **error) {
    const char *const all[] = {name, texts->rig_conf, texts->session_conf, texts->calibration,
                               texts->rig_path ? texts->rig_path : ""};
    static const char *const names[] = {"the name", "rig.conf", "session.conf", "calibration.conf",
                                        "the rig's path"};

    for (gsize i = 0; i < G_N_ELEMENTS(all); i++)
        if (!all[i] || !g_utf8_validate(all[i], -1, NULL))
            return session_fail(error, SESSION_ERROR_FORMAT,
                                "a new session needs %s as UTF-8 text, but it is %s", names[i],
                                all[i] ? "not UTF-8" : "missing");
    return TRUE;
}

static gboolean check_directions(const struct session_direction *directions, int n,
                                 const char *kind, GError **error) {
    for (int i = 0; i < n; i++)
        if (!session_check_direction(&directions[i], i, kind, error))
            return FALSE;
    return TRUE;
}

static gboolean check_plan(const struct session_plan *plan, GError **error) {
    gboolean ok = session_check_grid(&plan->grid, error) &&
                  check_directions(plan->views, plan->n_views, "view", error) &&
                  check_directions(plan->lights, plan->n_lights, "light", error) &&
                  check_directions(plan->lasers, plan->n_lasers, "laser", error);

    for (int i = 0; ok && i < plan->n_shots; i++)
        ok = session_check_shot(&plan->shots[i], i + 1, plan->n_lights, plan->n_lasers, error);
    return ok;
}

static gboolean insert_directions(Session *session, const struct session_direction *directions,
                                  int n, const char *kind, GError **error) {
    for (int i = 0; i < n; i++) {
        const struct session_direction *d = &directions[i];

        if (!session_db_run(session, error,
                            "INSERT INTO direction VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)", "siiddds",
                            kind, d->index, d->device, d->theta_deg, d->phi_deg, d->turntable_deg,
                            d->note))
            return FALSE;
    }
    return TRUE;
}

/* Sets *ret to the number that the column cameras has for a set of cameras (session_private.h). It
 * is a bit mask, or −n for the nth set that is stored as a value. sets (of struct camera_set) has
 * the sets that are stored so far. If the set needs a value and is not among them, it is stored and
 * appended to sets. */
static gboolean insert_cameras(Session *session, struct camera_set cameras, GArray *sets,
                               gint64 *ret, GError **error) {
    if (camera_set_next(cameras, SESSION_MASK_CAMERAS - 1) < 0) {
        *ret = 0;
        for (int c = camera_set_next(cameras, -1); c >= 0; c = camera_set_next(cameras, c))
            *ret |= (gint64)1 << c;
        return TRUE;
    }
    guint i = 0;
    while (i < sets->len && !camera_set_equal(g_array_index(sets, struct camera_set, i), cameras))
        i++;
    *ret = -(gint64)i - 1;
    if (i < sets->len)
        return TRUE;
    g_array_append_val(sets, cameras);
    g_autofree char *key = g_strdup_printf(SESSION_CAMERAS "%u", i + 1);
    g_autofree char *text = camera_set_to_text(cameras);
    return session_db_run(session, error, "INSERT INTO value VALUES (?1, ?2)", "ss", key, text);
}

/* Inserts all rows of the plan. The caller has begun a transaction. */
static gboolean insert_plan(Session *session, const struct session_plan *plan, GError **error) {
    const struct session_grid *grid = &plan->grid;
    g_autoptr(GArray) sets = g_array_new(FALSE, FALSE, sizeof(struct camera_set));
    gboolean ok =
        session_db_run(session, error, "INSERT INTO grid VALUES (1, ?1, ?2, ?3, ?4, ?5, ?6)",
                       "iidddd", grid->width, grid->height, grid->width_mm, grid->height_mm,
                       grid->reference_mm, grid->depth_mm) &&
        insert_directions(session, plan->views, plan->n_views, "view", error) &&
        insert_directions(session, plan->lights, plan->n_lights, "light", error) &&
        insert_directions(session, plan->lasers, plan->n_lasers, "laser", error);

    for (int i = 0; ok && i < plan->n_shots; i++) {
        const struct session_shot *shot = &plan->shots[i];
        gint64 cameras;

        ok = insert_cameras(session, shot->cameras, sets, &cameras, error) &&
             session_db_run(
                 session, error,
                 "INSERT INTO shot VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?13)",
                 "lsiddiilddiss", shot->id, session_shot_kinds[shot->kind], shot->pose,
                 shot->turntable_deg, shot->arc_deg, shot->source, shot->device, cameras,
                 shot->sweep_from_deg, shot->sweep_to_deg, shot->sweep_steps,
                 session_shot_states[shot->state], shot->note);
    }
    return ok;
}

static gboolean insert_all(Session *session, const char *name, const struct session_texts *texts,
                           const struct session_plan *plan, GError **error) {
    const char *const files[][2] = {{"rig.conf", texts->rig_conf},
                                    {"session.conf", texts->session_conf},
                                    {"calibration.conf", texts->calibration}};
    g_autofree char *application =
        g_strdup_printf("PRAGMA application_id = %d", SESSION_APPLICATION_ID);
    g_autofree char *version = g_strdup_printf("PRAGMA user_version = %d", SESSION_FORMAT);
    g_autoptr(GDateTime) now = g_date_time_new_now_utc();
    g_autofree char *created = g_date_time_format_iso8601(now);
    gboolean ok = session_db_run(session, error, "PRAGMA journal_mode = WAL", "") &&
                  session_begin(session, error) &&
                  session_db_run(session, error, application, "") &&
                  session_db_run(session, error, version, "");

    for (gsize i = 0; ok && i < G_N_ELEMENTS(session_tables); i++)
        ok = session_db_run(session, error, session_tables[i].sql, "");
    ok = ok && session_db_run(session, error, "INSERT INTO session VALUES (1, ?1, ?2, ?3)", "sss",
                              name, "mesorig " MESORIG_VERSION, created);
    for (gsize i = 0; ok && i < G_N_ELEMENTS(files); i++)
        ok = session_db_run(session, error, "INSERT INTO text VALUES (?1, ?2)", "ss", files[i][0],
                            files[i][1]);
    for (int i = 0; ok && i < texts->n_values; i++)
        ok = !texts->values[i][1] ||
             session_set_value(session, texts->values[i][0], texts->values[i][1], error);
    return ok &&
           (!texts->rig_path || session_set_value(session, "rig_path", texts->rig_path, error)) &&
           insert_plan(session, plan, error) && session_commit(session, error);
}

/* Writes everything into a hidden directory. */
static gboolean fill(const char *path, const char *name, const struct session_texts *texts,
                     const struct session_plan *plan, GError **error) {
    static const char *const folders[] = {"frames", "laser", "products", "products/btf"};
    g_autoptr(Session) session = g_new0(Session, 1);

    session->path = g_strdup(path);
    session->mode = SESSION_CAPTURE;
    session->lock = -1;
    session->is_new = TRUE;
    for (gsize i = 0; i < G_N_ELEMENTS(folders); i++) {
        g_autofree char *folder = session_file(session, folders[i]);

        if (g_mkdir(folder, 0777) != 0)
            return fail_errno(folder, errno, error);
    }
    return session_db_open(session, TRUE, error) && insert_all(session, name, texts, plan, error) &&
           sync_folder(path, error);
}

static void remove_all(const char *path) {
    static const char *const names[] = {"products/btf",   "products",    "laser",
                                        "frames",         "session.db",  "session.db-wal",
                                        "session.db-shm", "capture.lock"};

    for (gsize i = 0; i < G_N_ELEMENTS(names); i++) {
        g_autofree char *file = g_build_filename(path, names[i], NULL);

        g_remove(file);
    }
    g_rmdir(path);
}

/* Renames a directory, but never replaces anything, not even an empty directory. */
static gboolean move_in_place(const char *from, const char *to, GError **error) {
    return output_file_move(from, to) || fail_errno(to, errno, error);
}

Session *session_create(const char *path, const char *name, const struct session_texts *texts,
                        const struct session_plan *plan, GError **error) {
    g_autofree char *absolute = g_canonicalize_filename(path, NULL);
    g_autofree char *parent = g_path_get_dirname(absolute), *base = g_path_get_basename(absolute);
    g_autofree char *hidden = g_strdup_printf("%s/.%s.XXXXXX", parent, base);
    int lock = -1;

    if (!check_texts(name, texts, error) || !check_plan(plan, error))
        return NULL;
    if (g_file_test(absolute, G_FILE_TEST_EXISTS)) {
        fail_errno(absolute, EEXIST, error);
        return NULL;
    }
    if (!g_mkdtemp_full(hidden, 0777)) {
        fail_errno(absolute, errno, error);
        return NULL;
    }
    if (!fill(hidden, name, texts, plan, error) || (lock = session_lock(hidden, error)) < 0 ||
        !move_in_place(hidden, absolute, error))
        remove_all(hidden);
    else if (sync_folder(parent, error))
        return session_open_locked(absolute, SESSION_CAPTURE, lock, error);
    if (lock >= 0)
        close(lock);
    return NULL;
}
