#include "store_check.h"

#include <gio/gio.h>
#include <math.h>
#include <sqlite3.h>
#include <string.h>
#include <unistd.h>

struct store *store_new(void) {
    struct store *store = g_new0(struct store, 1);
    store->frames = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, g_free);
    store->products = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, g_free);
    return store;
}

void store_free(struct store *store) {
    if (!store)
        return;
    g_hash_table_unref(store->frames);
    g_hash_table_unref(store->products);
    g_free(store->state);
    g_free(store->reason);
    g_free(store->rounds);
    g_free(store);
}

/* NULL: there is no such file. */
static char *hash_of(const char *path, gsize *ret_bytes) {
    g_autofree char *text = NULL;
    if (!g_file_get_contents(path, &text, ret_bytes, NULL))
        return NULL;
    return g_compute_checksum_for_data(G_CHECKSUM_SHA256, (const guchar *)text, *ret_bytes);
}

/* A copy of the database with its log, opened; NULL: reported. */
static sqlite3 *open_copy(struct scene *scene, const char *scratch) {
    static const char *const names[] = {"session.db", "session.db-wal"};
    for (gsize i = 0; i < G_N_ELEMENTS(names); i++) {
        g_autofree char *from = g_build_filename(scene->session, names[i], NULL);
        g_autofree char *to = g_build_filename(scratch, names[i], NULL);
        g_autofree char *text = NULL;
        gsize length;
        unlink(to);
        if (g_file_get_contents(from, &text, &length, NULL) &&
            !g_file_set_contents(to, text, (gssize)length, NULL))
            g_error("simulate: %s cannot be written", to);
    }
    g_autofree char *index = g_build_filename(scratch, "session.db-shm", NULL);
    g_autofree char *copy = g_build_filename(scratch, "session.db", NULL);
    sqlite3 *db = NULL;
    unlink(index);
    if (sqlite3_open_v2(copy, &db, SQLITE_OPEN_READWRITE, NULL) == SQLITE_OK)
        return db;
    scene_break(scene, "database", "session.db cannot be opened: %s", sqlite3_errmsg(db));
    sqlite3_close(db);
    return NULL;
}

static sqlite3_stmt *prepare(struct scene *scene, sqlite3 *db, const char *sql) {
    sqlite3_stmt *statement = NULL;
    if (sqlite3_prepare_v2(db, sql, -1, &statement, NULL) != SQLITE_OK)
        scene_break(scene, "database", "%s", sqlite3_errmsg(db));
    return statement;
}

static char *one_text(struct scene *scene, sqlite3 *db, const char *sql) {
    sqlite3_stmt *statement = prepare(scene, db, sql);
    char *text = NULL;
    if (statement && sqlite3_step(statement) == SQLITE_ROW)
        text = g_strdup((const char *)sqlite3_column_text(statement, 0));
    sqlite3_finalize(statement);
    return text;
}

static void check_frame(struct scene *scene, const struct store *reference, GHashTable *damaged,
                        const char *path, const char *sha256, gint64 bytes) {
    g_autofree char *file = g_build_filename(scene->session, path, NULL);
    gsize found_bytes = 0;
    g_autofree char *found = hash_of(file, &found_bytes);
    const char *right = reference ? g_hash_table_lookup(reference->frames, path) : sha256;
    if (g_strcmp0(found, right) == 0)
        g_hash_table_remove(damaged, path);
    if (g_hash_table_contains(damaged, path))
        return;
    if (!found)
        scene_break(scene, "row has its file", "%s has a row, but is not there", path);
    else if ((gint64)found_bytes != bytes || strcmp(found, sha256) != 0)
        scene_break(scene, "row has its file",
                    "%s has %zu bytes and other contents than its row "
                    "says, which has %" G_GINT64_FORMAT " bytes",
                    path, found_bytes, bytes);
    else if (g_strcmp0(found, right) != 0)
        scene_break(scene, "frame is the asked one", "%s differs from an undisturbed run's", path);
}

static void check_rows(struct scene *scene, sqlite3 *db, const struct store *reference,
                       GHashTable *damaged, struct store *ret) {
    sqlite3_stmt *rows = prepare(scene, db, "SELECT path, sha256, bytes FROM frame");
    while (rows && sqlite3_step(rows) == SQLITE_ROW) {
        const char *path = (const char *)sqlite3_column_text(rows, 0);
        const char *sha256 = (const char *)sqlite3_column_text(rows, 1);
        check_frame(scene, reference, damaged, path, sha256, sqlite3_column_int64(rows, 2));
        g_hash_table_replace(ret->frames, g_strdup(path), g_strdup(sha256));
    }
    sqlite3_finalize(rows);
    sqlite3_stmt *shots = prepare(scene, db,
                                  "SELECT state, cameras, id, (SELECT count(*) FROM frame "
                                  "WHERE frame.shot = shot.id) FROM shot");
    while (shots && sqlite3_step(shots) == SQLITE_ROW) {
        const char *state = (const char *)sqlite3_column_text(shots, 0);
        const gboolean done = strcmp(state, "done") == 0;
        const int cameras = __builtin_popcountll((guint64)sqlite3_column_int64(shots, 1));
        ret->done += done;
        ret->planned += strcmp(state, "planned") == 0;
        if (sqlite3_column_int(shots, 3) != (done ? cameras : 0))
            scene_break(scene, "shot is whole", "shot %d is %s with %d frames of %d cameras",
                        sqlite3_column_int(shots, 2), state, sqlite3_column_int(shots, 3), cameras);
    }
    sqlite3_finalize(shots);
}

gboolean store_check(struct scene *scene, const struct store *reference, GHashTable *damaged,
                     const char *scratch, struct store *ret) {
    if (!g_file_test(scene->session, G_FILE_TEST_IS_DIR))
        return FALSE;
    sqlite3 *db = open_copy(scene, scratch);
    if (!db)
        return TRUE;
    g_autofree char *sound = one_text(scene, db, "PRAGMA integrity_check(1)");
    if (g_strcmp0(sound, "ok") != 0)
        scene_break(scene, "database", "session.db is damaged: %s", sound ? sound : "unreadable");
    check_rows(scene, db, reference, damaged, ret);
    ret->state = one_text(scene, db, "SELECT value FROM value WHERE key = 'state'");
    ret->reason = one_text(scene, db, "SELECT value FROM value WHERE key = 'reason'");
    ret->rounds = one_text(
        scene, db,
        "SELECT coalesce((SELECT group_concat(line, '; ') FROM (SELECT key || ' = ' || value AS "
        "line "
        "FROM value WHERE key LIKE 'lasers.round.%' ORDER BY key)), 'none') || ', left out: ' || "
        "coalesce((SELECT group_concat(id) FROM (SELECT id FROM shot WHERE state = 'skipped' "
        "ORDER BY id)), 'none')");
    sqlite3_close(db);
    return TRUE;
}

static void check_left(struct scene *scene, const char *folder) {
    g_autofree char *path = g_build_filename(scene->session, folder, NULL);
    g_autoptr(GDir) dir = g_dir_open(path, 0, NULL);
    const char *name;
    while (dir && (name = g_dir_read_name(dir)))
        if (g_str_has_suffix(name, ".part"))
            scene_break(scene, "nothing is left over", "%s/%s", folder, name);
}

void store_read_products(const struct scene *scene, struct store *store) {
    static const char *const folders[] = {"products", "products/btf"};
    for (gsize i = 0; i < G_N_ELEMENTS(folders); i++) {
        g_autofree char *path = g_build_filename(scene->session, folders[i], NULL);
        g_autoptr(GDir) dir = g_dir_open(path, 0, NULL);
        const char *name;
        while (dir && (name = g_dir_read_name(dir))) {
            g_autofree char *file = g_build_filename(path, name, NULL);
            gsize bytes;
            if (g_str_has_suffix(name, ".exr"))
                g_hash_table_replace(store->products, g_build_filename(folders[i], name, NULL),
                                     hash_of(file, &bytes));
        }
    }
}

void store_check_products(struct scene *scene, const struct store *reference) {
    static const char *const folders[] = {"frames", "laser", "products", "products/btf"};
    struct store *store = store_new();
    GHashTableIter iter;
    gpointer path, sha256;
    store_read_products(scene, store);
    g_hash_table_iter_init(&iter, reference->products);
    while (g_hash_table_iter_next(&iter, &path, &sha256))
        if (g_strcmp0(g_hash_table_lookup(store->products, path), sha256) != 0)
            scene_break(scene, "products are the same", "%s %s", (const char *)path,
                        g_hash_table_contains(store->products, path)
                            ? "differs from an undisturbed run's"
                            : "is not there");
    if (g_hash_table_size(store->products) > g_hash_table_size(reference->products))
        scene_break(scene, "products are the same", "there are more than in an undisturbed run");
    for (gsize i = 0; i < G_N_ELEMENTS(folders); i++)
        check_left(scene, folders[i]);
    store_free(store);
}

/* A drive's backlash, and the rounding of its position. */
#define POSE_DEG 0.11

static gboolean is_angle(double a_deg, double b_deg) {
    return fabs(remainder(a_deg - b_deg, 360)) <= POSE_DEG;
}

/* What may shine in a picture, by the bits of the world's lamps or lasers. */
struct asked {
    double turntable_deg, arc_deg;
    guint32 lamps, laser;
};

/* NULL, or what differs. */
static const char *compare_exposure(const struct exposure *seen, const struct asked *asked) {
    if (!is_angle(seen->turntable_deg, asked->turntable_deg))
        return "the turntable stands elsewhere";
    if (!is_angle(seen->arc_deg, asked->arc_deg))
        return "the arc stands elsewhere";
    if (seen->lamps != asked->lamps)
        return "other lamps shine";
    /* The last picture of a sweep is taken without the laser. */
    if (seen->lasers != 0 && seen->lasers != asked->laser)
        return "other lasers shine";
    return NULL;
}

static const struct exposure *exposure_at(const struct scene *scene, int i) {
    return i < MIN(scene->n_exposures, SCENE_MAX_EXPOSURES) ? &scene->exposures[i] : NULL;
}

static void check_shot_exposures(struct scene *scene, sqlite3_stmt *shot) {
    const gint64 id = sqlite3_column_int64(shot, 0);
    const char *kind = (const char *)sqlite3_column_text(shot, 3);
    const gboolean is_lamp = strcmp(kind, "lamp") == 0, is_sweep = strcmp(kind, "sweep") == 0;
    const int device = sqlite3_column_int(shot, 4); /* -1: none */
    const guint32 bit = device >= 0 ? 1u << device : 0;
    const struct asked asked = {.turntable_deg = sqlite3_column_double(shot, 1),
                                .arc_deg = sqlite3_column_double(shot, 2),
                                .lamps = is_lamp ? bit : 0,
                                .laser = is_sweep ? bit : 0};
    const struct exposure *seen;
    guint32 seen_by = 0, lasers = 0;
    for (int i = 0; (seen = exposure_at(scene, i)); i++) {
        const int sub = (int)(seen->tag & 0xffff);
        if (seen->tag >> 16 != (guint64)id)
            continue;
        const char *differs = compare_exposure(seen, &asked);
        seen_by |= 1u << seen->camera;
        lasers |= seen->lasers;
        if (differs)
            scene_break(scene, "frame is the asked one",
                        "shot %" G_GINT64_FORMAT ", picture %d: %s", id, sub, differs);
    }
    if (seen_by != (guint32)sqlite3_column_int64(shot, 5))
        scene_break(scene, "frame is the asked one",
                    "shot %" G_GINT64_FORMAT " was not seen by its cameras", id);
    if (is_sweep && lasers == 0)
        scene_break(scene, "frame is the asked one",
                    "shot %" G_GINT64_FORMAT " is a sweep without a laser", id);
}

void store_check_exposures(struct scene *scene, const char *scratch) {
    sqlite3 *db = open_copy(scene, scratch);
    sqlite3_stmt *shots =
        db ? prepare(scene, db,
                     "SELECT id, turntable_deg, arc_deg, kind, device, cameras FROM shot"
                     " WHERE state = 'done'")
           : NULL;
    while (shots && sqlite3_step(shots) == SQLITE_ROW)
        check_shot_exposures(scene, shots);
    sqlite3_finalize(shots);
    sqlite3_close(db);
}
