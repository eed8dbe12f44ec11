#include "store_check.h"

#include <math.h>
#include <sqlite3.h>
#include <stdlib.h>
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

/* Groups of lamps that are taken together: "PART;FIRST:N;FIRST:N…", by the ids of shots. FALSE:
 * the shot is in none. */
static gboolean group_of(const char *groups, gint64 shot, gint64 *ret_first, int *ret_n) {
    for (const char *item = groups ? strchr(groups, ';') : NULL; item; item = strchr(item, ';')) {
        char *end;
        *ret_first = g_ascii_strtoll(++item, &end, 10);
        *ret_n = *end == ':' ? (int)g_ascii_strtoll(end + 1, NULL, 10) : 0;
        if (shot >= *ret_first && shot < *ret_first + *ret_n)
            return TRUE;
    }
    return FALSE;
}

static char *read_groups(struct scene *scene, sqlite3 *db) {
    return one_text(scene, db, "SELECT value FROM value WHERE key = 'multiplex'");
}

static gboolean is_in_group(struct scene *scene, sqlite3 *db) {
    g_autofree char *groups = read_groups(scene, db);
    gint64 first;
    int n;
    if (!group_of(groups, g_atomic_int_get(&scene->last_shot), &first, &n))
        return FALSE;
    g_autofree char *sql =
        g_strdup_printf("SELECT count(*) FROM shot WHERE state = 'planned' AND id BETWEEN "
                        "%" G_GINT64_FORMAT " AND %" G_GINT64_FORMAT,
                        first, first + n - 1);
    g_autofree char *planned = one_text(scene, db, sql);
    return g_strcmp0(planned, "0") != 0;
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
    ret->in_group = is_in_group(scene, db);
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

/* A group of lamps as the world saw it. */
struct group {
    gint64 first;
    int n;
    guint32 all;         /* its lamps */
    guint32 patterns[8]; /* that are lit in the first picture of each shot */
    int last_sub;        /* of its last shot: the picture of the lamps that are left out */
};

static void see_group(struct scene *scene, sqlite3 *db, struct group *group) {
    const struct exposure *seen;
    group->all = 0;
    group->last_sub = 0;
    if (group->n > (int)G_N_ELEMENTS(group->patterns))
        g_error("simulate: a group of %d lamps is too large", group->n);
    for (int k = 0; k < group->n; k++) {
        g_autofree char *sql = g_strdup_printf(
            "SELECT device FROM shot WHERE id = %" G_GINT64_FORMAT, group->first + k);
        g_autofree char *device = one_text(scene, db, sql);
        group->all |= device ? 1u << atoi(device) : 0;
        group->patterns[k] = 0;
        for (int i = 0; (seen = exposure_at(scene, i)); i++)
            if (seen->tag == (guint64)(group->first + k) << 16)
                group->patterns[k] = seen->lamps;
    }
    for (int i = 0; (seen = exposure_at(scene, i)); i++)
        if (seen->tag >> 16 == (guint64)(group->first + group->n - 1))
            group->last_sub = MAX(group->last_sub, (int)(seen->tag & 0xffff));
}

/* S Sᵀ = (n + 1)/4 · (I + J). */
static void check_patterns(struct scene *scene, const struct group *group) {
    if (__builtin_popcount(group->all) != group->n)
        scene_break(scene, "frame is the asked one", "a group has the same lamp twice");
    for (int i = 0; i < group->n; i++)
        for (int j = 0; j <= i; j++) {
            const guint32 both = group->patterns[i] & group->patterns[j];
            if (__builtin_popcount(both) * 4 != (group->n + 1) * (i == j ? 2 : 1) ||
                (both & ~group->all))
                scene_break(scene, "frame is the asked one",
                            "lamps %#x and %#x, of %#x, are no patterns of an S-matrix",
                            group->patterns[i], group->patterns[j], group->all);
        }
}

/* The lamps that a picture of a shot must show. */
static guint32 asked_lamps(const struct group *group, gint64 shot, int device, int sub) {
    if (group->n == 0)
        return 1u << device;
    const int k = (int)(shot - group->first);
    const gboolean is_last = k + 1 == group->n && sub == group->last_sub;
    return is_last ? group->all & ~group->patterns[k] : group->patterns[k];
}

static void check_shot_exposures(struct scene *scene, sqlite3_stmt *shot,
                                 const struct group *group) {
    const gint64 id = sqlite3_column_int64(shot, 0);
    const char *kind = (const char *)sqlite3_column_text(shot, 3);
    const gboolean is_lamp = strcmp(kind, "lamp") == 0, is_sweep = strcmp(kind, "sweep") == 0;
    const int device = sqlite3_column_int(shot, 4);
    struct asked asked = {.turntable_deg = sqlite3_column_double(shot, 1),
                          .arc_deg = sqlite3_column_double(shot, 2),
                          .laser = is_sweep ? 1u << device : 0};
    const struct exposure *seen;
    guint32 seen_by = 0, lasers = 0;
    for (int i = 0; (seen = exposure_at(scene, i)); i++) {
        const int sub = (int)(seen->tag & 0xffff);
        if (seen->tag >> 16 != (guint64)id)
            continue;
        asked.lamps = is_lamp ? asked_lamps(group, id, device, sub) : 0;
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
    g_autofree char *groups = db ? read_groups(scene, db) : NULL;
    sqlite3_stmt *shots =
        db ? prepare(scene, db,
                     "SELECT id, turntable_deg, arc_deg, kind, device, cameras FROM shot"
                     " WHERE state = 'done'")
           : NULL;
    while (shots && sqlite3_step(shots) == SQLITE_ROW) {
        struct group group = {0};
        if (group_of(groups, sqlite3_column_int64(shots, 0), &group.first, &group.n))
            see_group(scene, db, &group);
        else
            group.n = 0;
        check_patterns(scene, &group);
        check_shot_exposures(scene, shots, &group);
    }
    sqlite3_finalize(shots);
    sqlite3_close(db);
}
