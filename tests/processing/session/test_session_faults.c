/* Each call to the disk, and each allocation of SQLite's, fails once in each operation of the
 * session store, the n-th for n = 1, 2, 3 … until the operation ends without a fault. What an
 * undisturbed operation gives, and the database's contents before and after it, are the truth: a
 * disturbed one fails with a message or gives the same, the database is as before or as after and
 * nothing between, and the operation succeeds when it is repeated without the fault. */
#include <fcntl.h>
#include <glib/gstdio.h>
#include <sqlite3.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "exr/exr.h"
#include "lib/ok.h"
#include "lib/text_file.h"
#include "session/made_with.h"
#include "session/outputs.h"
#include "session/session.h"
#include "simulation/disk_model.h"

#define FRAME   "frames/000001_cam.exr"
#define PRODUCT "products/btf/view_0000.exr"

static char *folder, *root, *session_dir; /* root is the simulated disk, session_dir lies in it */
static struct disk *disk; /* always active: nothing that is synced waits for the machine's disk */
static int failed_calls;  /* of the operation that was disturbed last */

/* Allocations of SQLite's that are still given; −1: all. */
static gint allocations_left = -1;
static gboolean allocation_failed;
static sqlite3_mem_methods memory;

static gboolean allocation_fails(void) {
    if (g_atomic_int_get(&allocations_left) < 0)
        return FALSE;
    if (g_atomic_int_add(&allocations_left, -1) != 0)
        return FALSE;
    allocation_failed = TRUE;
    return TRUE;
}

static void *faulty_malloc(int n) {
    return allocation_fails() ? NULL : memory.xMalloc(n);
}

static void *faulty_realloc(void *old, int n) {
    return allocation_fails() ? NULL : memory.xRealloc(old, n);
}

static void add_sorted(GString *to, GHashTable *table) {
    g_autoptr(GList) keys = g_list_sort(g_hash_table_get_keys(table), (GCompareFunc)strcmp);
    for (const GList *at = keys; at; at = at->next)
        g_string_append_printf(to, "%s=%s\n", (char *)at->data,
                               (char *)g_hash_table_lookup(table, at->data));
}

/* What an operation gives, as text. FALSE: it failed. */
typedef gboolean (*Operation)(Session *session, GString *ret, GError **error);

static gboolean use_nothing(Session *session, GString *ret, GError **error) {
    g_string_append(ret, session_name(session));
    return TRUE;
}

static gboolean use_grid(Session *session, GString *ret, GError **error) {
    struct session_grid grid;
    g_autofree char *program = NULL, *created = NULL;
    if (!session_grid(session, &grid, error) || !session_origin(session, &program, &created, error))
        return FALSE;
    g_string_append_printf(ret, "%d %d %g %s", grid.width, grid.height, grid.depth_mm, program);
    return TRUE;
}

static gboolean use_directions(Session *session, GString *ret, GError **error) {
    typedef GPtrArray *(*Read)(Session *, GError **);
    static const Read reads[] = {session_views, session_lights, session_lasers};
    for (gsize k = 0; k < G_N_ELEMENTS(reads); k++) {
        g_autoptr(GPtrArray) all = reads[k](session, error);
        if (!all)
            return FALSE;
        for (guint i = 0; i < all->len; i++) {
            const struct session_direction *one = all->pdata[i];
            g_string_append_printf(ret, "%d %g %s\n", one->index, one->theta_deg, one->note);
        }
    }
    return TRUE;
}

static gboolean use_shots(Session *session, GString *ret, GError **error) {
    g_autoptr(GPtrArray) shots = session_shots(session, error);
    for (guint i = 0; shots && i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        g_string_append_printf(ret, "%d %d %g %s\n", (int)shot->id, (int)shot->state,
                               shot->turntable_deg, shot->note);
    }
    return shots != NULL;
}

static gboolean use_frames(Session *session, GString *ret, GError **error) {
    g_autoptr(GPtrArray) frames = session_frames(session, error);
    for (guint i = 0; frames && i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        g_string_append_printf(ret, "%d %s %s\n", (int)frame->shot, frame->path, frame->sha256);
    }
    return frames != NULL;
}

static gboolean use_events(Session *session, GString *ret, GError **error) {
    g_autoptr(GPtrArray) events = session_events(session, error);
    for (guint i = 0; events && i < events->len; i++) {
        const struct session_event *event = events->pdata[i];
        g_string_append_printf(ret, "%g %s %s %s\n", event->time_s, event->level, event->source,
                               event->message);
    }
    return events != NULL;
}

static gboolean use_values(Session *session, GString *ret, GError **error) {
    g_autoptr(GHashTable) values = session_values(session, "", error);
    g_autofree char *text = values ? session_text(session, "calibration.conf", error) : NULL;
    g_autofree char *state = NULL, *none = NULL;
    if (!text || !session_read_value(session, "state", &state, error) ||
        !session_read_value(session, "no such value", &none, error))
        return FALSE;
    g_string_append_printf(ret, "%s %s %s\n", text, state, none);
    add_sorted(ret, values);
    return TRUE;
}

static void add_damages(GString *to, const GPtrArray *damages) {
    for (guint i = 0; i < damages->len; i++) {
        const struct session_damage *damage = damages->pdata[i];
        g_string_append_printf(to, "%s: %s; %s\n", damage->path, damage->what, damage->remedy);
    }
}

static gboolean use_products(Session *session, GString *ret, GError **error) {
    g_autoptr(GPtrArray) products = session_list_products(session, error);
    g_autoptr(GHashTable) names = products ? session_products(session, error) : NULL;
    if (!names)
        return FALSE;
    for (guint i = 0; i < products->len; i++) {
        const struct session_product *product = products->pdata[i];
        g_string_append_printf(ret, "%s %s %s %d\n", product->path, product->made_by,
                               product->sha256, (int)product->bytes);
    }
    g_string_append_printf(ret, "%u", g_hash_table_size(names));
    return TRUE;
}

static gboolean use_damage(Session *session, GString *ret, GError **error) {
    for (int k = 0; k < 2; k++) {
        int n = 0;
        g_autoptr(GPtrArray) damages =
            session_find_damage(session, k ? SESSION_PRODUCTS_MADE : SESSION_FRAMES,
                                k ? "products/" : "", NULL, &n, error);
        if (!damages)
            return FALSE;
        g_string_append_printf(ret, "%d\n", n);
        add_damages(ret, damages);
    }
    return TRUE;
}

static gboolean use_btf(Session *session, GString *ret, GError **error) {
    g_autoptr(GPtrArray) files = session_btf_files(session, error);
    for (guint i = 0; files && i < files->len; i++)
        g_string_append_printf(ret, "%s\n", (char *)files->pdata[i]);
    return files != NULL;
}

static gboolean use_product_by_path(Session *session, GString *ret, GError **error) {
    g_autofree char *file = session_file(session, PRODUCT);
    return session_check_product(file, error);
}

static gboolean use_commit(Session *session, GString *ret, GError **error) {
    g_autofree char *file = session_file(session, "frames/000002_cam.exr");
    g_autofree char *path = g_strdup("frames/000002_cam.exr");
    g_autofree char *sha256 = exr_sha256(file, NULL, error);
    const struct session_frame frame = {.shot = 2, .path = path, .sha256 = sha256, .bytes = 6};
    return sha256 && session_commit_shot(session, 2, SHOT_DONE, &frame, 1, "saturated", error);
}

static gboolean use_event(Session *session, GString *ret, GError **error) {
    return session_add_event(session, 2, "info", "axis", "homed", error);
}

static gboolean use_set(Session *session, GString *ret, GError **error) {
    return session_set_value(session, "state", "done", error);
}

static gboolean use_note(Session *session, GString *ret, GError **error) {
    return session_note_damage(session, FRAME, "it is gone", error);
}

static gboolean use_add_product(Session *session, GString *ret, GError **error) {
    g_autofree char *file = session_file(session, PRODUCT);
    return session_add_product_file(file, "compress lpca", error) &&
           session_add_product(session, "products/mdf.exr", "inputs", error);
}

static gboolean use_store_output(Session *session, GString *ret, GError **error) {
    return outputs_store(session, 2, "cam", 1.01, 0.002, error);
}

static gboolean use_outputs(Session *session, GString *ret, GError **error) {
    g_autoptr(GPtrArray) shots = session_shots(session, error);
    struct outputs *outputs = shots ? outputs_load(session, shots, error) : NULL;
    for (gint64 i = 1; outputs && i <= 3; i++)
        g_string_append_printf(ret, "%.9f\n", outputs_of(outputs, i));
    const gboolean ok = outputs != NULL;
    outputs_free(outputs);
    return ok;
}

static gboolean use_made_with(Session *session, GString *ret, GError **error) {
    struct made_with with;
    if (!made_with_read(session, &with, error))
        return FALSE;
    g_string_append_printf(ret, "%s %s %d %d", with.where, with.text, with.own, with.mixed);
    made_with_clear(&with);
    return TRUE;
}

static gboolean use_made_with_own(Session *session, GString *ret, GError **error) {
    return made_with_begin(session, "own.conf", NULL, error);
}

static gboolean use_made_with_third(Session *session, GString *ret, GError **error) {
    return made_with_begin(session, "third.conf", "third", error);
}

static gboolean use_made_with_end(Session *session, GString *ret, GError **error) {
    return made_with_end(session, error);
}

static gboolean use_verify(Session *session, GString *ret, GError **error) {
    int lost = -1;
    if (!session_verify(session, FALSE, &lost, error))
        return FALSE;
    g_string_append_printf(ret, "%d", lost);
    return TRUE;
}

static gboolean use_verify_thorough(Session *session, GString *ret, GError **error) {
    int lost = -1;
    if (!session_verify(session, TRUE, &lost, error))
        return FALSE;
    g_string_append_printf(ret, "%d", lost);
    return TRUE;
}

/* A frame that cannot be read is reported. */
enum tolerance { SAME, UNREADABLE_IS_TOLD };

static const struct {
    const char *name;
    Operation run;
    enum session_mode mode;
    enum tolerance tolerance;
    gboolean appends; /* repeated, it does more than once */
} operations[] = {
    {"open", use_nothing, SESSION_READ, SAME, FALSE},
    {"open-for-capture", use_nothing, SESSION_CAPTURE, SAME, FALSE},
    {"grid", use_grid, SESSION_READ, SAME, FALSE},
    {"directions", use_directions, SESSION_READ, SAME, FALSE},
    {"shots", use_shots, SESSION_READ, SAME, FALSE},
    {"frames", use_frames, SESSION_READ, SAME, FALSE},
    {"events", use_events, SESSION_READ, SAME, FALSE},
    {"values", use_values, SESSION_READ, SAME, FALSE},
    {"products", use_products, SESSION_READ, SAME, FALSE},
    {"damage", use_damage, SESSION_READ, UNREADABLE_IS_TOLD, FALSE},
    {"btf", use_btf, SESSION_READ, UNREADABLE_IS_TOLD, FALSE},
    {"product-by-path", use_product_by_path, SESSION_READ, UNREADABLE_IS_TOLD, FALSE},
    {"outputs", use_outputs, SESSION_READ, SAME, FALSE},
    {"made-with", use_made_with, SESSION_READ, SAME, FALSE},
    {"commit", use_commit, SESSION_CAPTURE, SAME, FALSE},
    {"event", use_event, SESSION_CAPTURE, SAME, TRUE},
    {"set", use_set, SESSION_CAPTURE, SAME, FALSE},
    {"note", use_note, SESSION_PRODUCTS, SAME, FALSE},
    {"add-product", use_add_product, SESSION_PRODUCTS, SAME, TRUE},
    {"store-output", use_store_output, SESSION_CAPTURE, SAME, FALSE},
    {"made-with-own", use_made_with_own, SESSION_PRODUCTS, SAME, FALSE},
    {"made-with-third", use_made_with_third, SESSION_PRODUCTS, SAME, FALSE},
    {"made-with-end", use_made_with_end, SESSION_PRODUCTS, SAME, FALSE},
    {"verify", use_verify, SESSION_CAPTURE, SAME, FALSE},
    {"verify-thorough", use_verify_thorough, SESSION_CAPTURE, SAME, FALSE},
};

/* Another program writes what is there already, undisturbed: a connection that has read the whole
 * database when it was opened has to read it again. */
static void write_beside(const char *path) {
    int calls[DISK_COUNTS];
    const int n_faults = disk->n_faults;
    const gint allocations = g_atomic_int_get(&allocations_left);
    g_autofree char *file = g_build_filename(path, "session.db", NULL);
    sqlite3 *db = NULL;
    memcpy(calls, disk->calls, sizeof calls);
    disk->n_faults = 0;
    g_atomic_int_set(&allocations_left, -1);
    g_assert_cmpint(sqlite3_open(file, &db), ==, SQLITE_OK);
    g_assert_cmpint(
        sqlite3_exec(db, "INSERT OR REPLACE INTO value VALUES ('other', 'here')", NULL, NULL, NULL),
        ==, SQLITE_OK);
    sqlite3_close(db);
    g_atomic_int_set(&allocations_left, allocations);
    memcpy(disk->calls, calls, sizeof calls);
    disk->n_faults = n_faults;
}

/* Opens the session and runs the operation. */
static gboolean run_in(const char *path, gsize k, GString *ret, GError **error) {
    g_autoptr(Session) session = session_open(path, operations[k].mode, error);
    if (session)
        write_beside(path);
    return session && operations[k].run(session, ret, error);
}

/* Every row of the database, read by SQLite only. */
static char *dump(const char *path) {
    static const char *const tables[] = {"session",
                                         "text",
                                         "grid",
                                         "direction",
                                         "shot",
                                         "frame",
                                         "event",
                                         "value ORDER BY key",
                                         "product ORDER BY path"};
    g_autofree char *file = g_build_filename(path, "session.db", NULL);
    GString *text = g_string_new(NULL);
    sqlite3 *db = NULL;
    g_assert_cmpint(sqlite3_open(file, &db), ==, SQLITE_OK);
    for (gsize i = 0; i < G_N_ELEMENTS(tables); i++) {
        g_autofree char *sql = g_strdup_printf("SELECT * FROM %s", tables[i]);
        sqlite3_stmt *statement = NULL;
        int rc;
        g_assert_cmpint(sqlite3_prepare_v2(db, sql, -1, &statement, NULL), ==, SQLITE_OK);
        while ((rc = sqlite3_step(statement)) == SQLITE_ROW) {
            for (int c = 0; c < sqlite3_column_count(statement); c++)
                g_string_append_printf(text, "%s|", (char *)sqlite3_column_text(statement, c));
            g_string_append_c(text, '\n');
        }
        g_assert_cmpint(rc, ==, SQLITE_DONE);
        sqlite3_finalize(statement);
    }
    sqlite3_close(db);
    return g_string_free(text, FALSE);
}

/* Two views, a frame, a damaged note, products made with another calibration, lamps' outputs. */
static void make_session(const char *path) {
    static const struct session_texts texts = {"rig", "session", "own", "/rig.conf", NULL, 0};
    static const struct session_direction directions[] = {
        {0, 0, 30, 10, 20, NULL}, {1, 1, 50, 20, 30, (char *)"moved: 3° → 4°"}};
    static const struct session_shot shots[] = {
        {1, SHOT_DARK, 0, 10, 20, -1, -1, {{1}}, 0, 0, 0, SHOT_PLANNED, NULL},
        {2, SHOT_LAMP, 0, 10, 20, 0, 0, {{1}}, 0, 0, 0, SHOT_PLANNED, (char *)"moved"},
        {3, SHOT_LAMP, 1, 30, 20, 1, 0, {{1}}, 0, 0, 0, SHOT_PLANNED, NULL},
        {4, SHOT_SWEEP, 1, 30, 20, 0, 0, {{1}}, -5, 5, 9, SHOT_SKIPPED, (char *)"in the way"},
    };
    const struct session_plan plan = {.grid = {4, 4, 10, 10, 0, 1},
                                      .views = directions,
                                      .lights = directions,
                                      .lasers = directions,
                                      .n_views = 2,
                                      .n_lights = 2,
                                      .n_lasers = 1,
                                      .shots = shots,
                                      .n_shots = 4};
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_create(path, "Loden", &texts, &plan, &error);
    g_assert_no_error(error);
    text_file_write(path, FRAME, "frame");
    text_file_write(path, "frames/000002_cam.exr", "second");
    text_file_write(path, PRODUCT, "view");
    text_file_write(path, "products/mdf.exr", "mdf");
    g_autofree char *sha256 = g_compute_checksum_for_string(G_CHECKSUM_SHA256, "frame", 5);
    const struct session_frame frame = {
        .shot = 1, .path = (char *)FRAME, .sha256 = sha256, .bytes = 5};
    g_assert_true(session_commit_shot(session, 1, SHOT_DONE, &frame, 1, NULL, &error));
    g_assert_true(session_set_value(session, "state", "running", &error));
    g_assert_true(session_set_value(session, "clock_s", "12.5", &error));
    g_assert_true(session_set_value(session, "other", "here", &error));
    g_assert_true(session_set_value(session, "calibration", "/begun.conf", &error));
    g_assert_true(outputs_store(session, 3, "cam", 0.99, 0.001, &error));
    g_assert_true(session_add_product(session, PRODUCT, "hash", &error));
    g_assert_true(made_with_begin(session, "/other.conf", "other", &error));
    g_assert_true(ok(session_add_event(session, 1, "warning", "session", "begun", ERR)));
}

static const char *const files[] = {
    "session.db", "session.db-wal",   FRAME,         "frames/000002_cam.exr",
    PRODUCT,      "products/mdf.exr", "capture.lock"};

/* Files that are not there are not copied. */
static void copy_session(const char *from, const char *to) {
    static const char *const folders[] = {"", "frames", "laser", "products", "products/btf"};
    disk->n_journal = 0;
    disk_remove_tree(to);
    for (gsize i = 0; i < G_N_ELEMENTS(folders); i++) {
        g_autofree char *path = g_build_filename(to, folders[i], NULL);
        g_assert_cmpint(g_mkdir(path, 0777), ==, 0);
    }
    for (gsize i = 0; i < G_N_ELEMENTS(files); i++) {
        g_autofree char *path = g_build_filename(from, files[i], NULL), *text = NULL;
        g_autofree char *copy = g_build_filename(to, files[i], NULL);
        gsize n = 0;
        if (!g_file_get_contents(path, &text, &n, NULL))
            continue;
        FILE *file = g_fopen(copy, "wb"); /* without the syncing of g_file_set_contents() */
        g_assert_cmpuint(fwrite(text, 1, n, file), ==, n);
        g_assert_cmpint(fclose(file), ==, 0);
    }
}

/* As a killed program leaves a session: the last rows are in the write-ahead log only. */
static char *make_killed(const char *whole) {
    char *killed = g_build_filename(folder, "killed.session", NULL);
    g_autofree char *used = g_build_filename(folder, "used.session", NULL);
    copy_session(whole, used);
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(used, SESSION_CAPTURE, &error);
    g_assert_no_error(error);
    g_assert_true(session_set_value(session, "saturated_retakes", "3 4000", &error));
    copy_session(used, killed);
    return killed;
}

struct truth { /* of one operation on one session */
    char *result, *before, *after;
};

static void truth_find(struct truth *truth, const char *from, gsize k) {
    g_autoptr(GString) result = g_string_new(NULL);
    copy_session(from, session_dir);
    truth->before = dump(session_dir);
    copy_session(from, session_dir);
    g_assert_true(ok(run_in(session_dir, k, result, ERR)));
    truth->after = dump(session_dir);
    truth->result = g_string_free(g_steal_pointer(&result), FALSE);
}

static void truth_clear(struct truth *truth) {
    g_free(truth->result);
    g_free(truth->before);
    g_free(truth->after);
}

static gboolean tells_unreadable(gsize k, const char *said) {
    return operations[k].tolerance == UNREADABLE_IS_TOLD &&
           (strstr(said, "Input/output error") || strstr(said, "cannot be read"));
}

/* Runs an operation with whatever fault is set, removes the fault, and checks what is left.
 * Returns whether it was refused. */
static gboolean disturb(const char *from, gsize k, const struct truth *truth, const char *what) {
    g_autoptr(GString) result = g_string_new(NULL);
    g_autoptr(GError) error = NULL;
    const gboolean ok = run_in(session_dir, k, result, &error);
    failed_calls = disk->n_failed;
    disk->n_faults = 0;
    g_atomic_int_set(&allocations_left, -1);
    g_autofree char *then = dump(session_dir);
    const char *name = operations[k].name, *said = error ? error->message : "";
    if (ok != (error == NULL))
        g_error("%s, %s: %s", name, what, ok ? "an error although it is done" : "no error");
    if (!ok && (!*said || strstr(said, "backup")))
        g_error("%s, %s: an error of the disk is told as “%s”", name, what, said);
    if (ok && strcmp(result->str, truth->result) != 0 && !tells_unreadable(k, result->str))
        g_error("%s, %s: gives “%s” instead of “%s”", name, what, result->str, truth->result);
    if (ok && strcmp(then, truth->after) != 0)
        g_error("%s, %s: done, but the database has\n%sinstead of\n%s", name, what, then,
                truth->after);
    const gboolean as_before = strcmp(then, truth->before) == 0;
    if (!ok && !as_before && strcmp(then, truth->after) != 0 && !operations[k].appends)
        g_error("%s, %s: refused, but the database has\n%sinstead of\n%s", name, what, then,
                truth->before);
    g_string_truncate(result, 0);
    g_autoptr(GError) again = NULL;
    if (!run_in(session_dir, k, result, &again))
        g_error("%s, %s: not possible afterwards: %s", name, what, again->message);
    g_autofree char *at_last = dump(session_dir);
    if (as_before &&
        (strcmp(at_last, truth->after) != 0 || strcmp(result->str, truth->result) != 0))
        g_error("%s, %s: afterwards the database has\n%sinstead of\n%s", name, what, at_last,
                truth->after);
    return !ok;
}

/* calls: how many calls fail, from the n-th one on. Each n is tried where one fails; where all
 * later ones do, some are left out. */
static void fail_disk(gsize k, const char *from, enum disk_action action, int calls) {
    struct truth truth;
    int refused = 0, n = 0;
    gboolean failed = TRUE;
    truth_find(&truth, from, k);
    for (; failed; n += calls > 1 ? n / 10 : 0) {
        g_autofree char *what = g_strdup_printf("call %d to the disk, action %d", ++n, (int)action);
        copy_session(from, session_dir);
        memset(disk->calls, 0, sizeof disk->calls);
        disk->n_failed = 0;
        disk->faults[0] = (struct disk_fault){DISK_ANY, action, n, calls};
        disk->n_faults = 1;
        refused += disturb(from, k, &truth, what);
        failed = failed_calls > 0;
    }
    g_test_message("%s: %d calls, %d refusals", operations[k].name, n - 1, refused);
    g_assert_cmpint(n, >, 5);
    if (action == DISK_FAILS)
        g_assert_cmpint(refused, >, 0);
    truth_clear(&truth);
}

static void test_disk(gconstpointer data) {
    const gsize k = GPOINTER_TO_SIZE(data);
    g_autofree char *whole = g_build_filename(folder, "whole.session", NULL);
    g_autofree char *killed = g_build_filename(folder, "killed.session", NULL);
    fail_disk(k, whole, DISK_FAILS, 1);
    if (operations[k].mode == SESSION_READ && operations[k].tolerance != SAME)
        return;
    fail_disk(k, killed, DISK_FAILS, 1);
    if (operations[k].mode == SESSION_READ)
        return;
    fail_disk(k, whole, DISK_FAILS, 1 << 20);
    fail_disk(k, whole, DISK_FULL, 1 << 20);
}

/* If the disk fails to find a file, the file may still exist, so no shot is planned again. */
static void test_stat(void) {
    g_autofree char *whole = g_build_filename(folder, "whole.session", NULL);
    for (int n = 1, failed = 1; failed; n++) {
        g_autoptr(GError) error = NULL;
        int lost = -1;
        copy_session(whole, session_dir);
        g_autofree char *before = dump(session_dir);
        g_autoptr(Session) session = session_open(session_dir, SESSION_CAPTURE, &error);
        g_assert_no_error(error);
        memset(disk->calls, 0, sizeof disk->calls);
        disk->n_failed = 0;
        disk->faults[0] = (struct disk_fault){DISK_STAT, DISK_FAILS, n, 1};
        disk->n_faults = 1;
        const gboolean ok = session_verify(session, FALSE, &lost, &error);
        failed = disk->n_failed;
        disk->n_faults = 0;
        g_assert_true(ok == (error == NULL));
        if (n == 1) {
            g_assert_error(error, SESSION_ERROR, SESSION_ERROR_IO);
            g_assert_nonnull(strstr(error->message, FRAME));
        }
        g_autofree char *then = dump(session_dir);
        g_assert_cmpstr(then, ==, before);
        g_assert_true(!ok || lost == 0);
    }
}

/* SQLite allocates hundreds of times: the first are all tried, of later ones every eighth part. */
static void test_memory(gconstpointer data) {
    const gsize k = GPOINTER_TO_SIZE(data);
    g_autofree char *whole = g_build_filename(folder, "whole.session", NULL);
    struct truth truth;
    int refused = 0;
    truth_find(&truth, whole, k);
    allocation_failed = TRUE;
    for (int n = 0; allocation_failed; n += 1 + n / 8) {
        g_autofree char *what = g_strdup_printf("allocation %d", n);
        copy_session(whole, session_dir);
        allocation_failed = FALSE;
        g_atomic_int_set(&allocations_left, n);
        refused += disturb(whole, k, &truth, what);
    }
    g_test_message("%s: %d refusals", operations[k].name, refused);
    g_assert_cmpint(refused, >, 5);
    truth_clear(&truth);
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    sqlite3_config(SQLITE_CONFIG_GETMALLOC, &memory);
    sqlite3_mem_methods faulty = memory;
    faulty.xMalloc = faulty_malloc;
    faulty.xRealloc = faulty_realloc;
    sqlite3_config(SQLITE_CONFIG_MALLOC, &faulty);
    sqlite3_config(SQLITE_CONFIG_LOOKASIDE, 0, 0);
    folder = g_strdup("/dev/shm/mesorig-faults-XXXXXX"); /* thousands of small files are made */
    g_assert_nonnull(g_mkdtemp(folder));
    root = g_build_filename(folder, "disk", NULL);
    session_dir = g_build_filename(root, "s.session", NULL);
    g_assert_cmpint(g_mkdir(root, 0777), ==, 0);
    disk = mmap(NULL, sizeof *disk, PROT_READ | PROT_WRITE,
                MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    g_assert_true(disk != MAP_FAILED);
    g_strlcpy(disk->root, root, sizeof disk->root);
    disk_use(disk);
    disk->active = TRUE;
    g_autofree char *whole = g_build_filename(folder, "whole.session", NULL);
    make_session(whole);
    g_autofree char *killed = make_killed(whole);
    for (gsize k = 0; k < G_N_ELEMENTS(operations); k++) {
        g_autofree char *on_disk = g_strconcat("/faults/disk/", operations[k].name, NULL);
        g_autofree char *in_memory = g_strconcat("/faults/memory/", operations[k].name, NULL);
        g_test_add_data_func(on_disk, GSIZE_TO_POINTER(k), test_disk);
        g_test_add_data_func(in_memory, GSIZE_TO_POINTER(k), test_memory);
    }
    g_test_add_func("/faults/disk/stat", test_stat);
    const int result = g_test_run();
    disk_use(NULL);
    disk_remove_tree(folder);
    munmap(disk, sizeof *disk);
    g_free(session_dir);
    g_free(root);
    g_free(folder);
    return result;
}
