/* The simulated disk: what POSIX promises of it after a power cut, and no more; and the calls that
 * it makes fail; a session on it. A file's contents are compared with what was written, not with
 * the model. */
#include <errno.h>
#include <fcntl.h>
#include <gio/gio.h>
#include <glib/gstdio.h>
#include <sqlite3.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "disk_model.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "session/session.h"

struct bench {
    char *folder, *root;
    struct disk *disk;
    DiskModel *model;
};

static struct bench *bench_new(void) {
    struct bench *bench = g_new0(struct bench, 1);
    g_autofree char *made = g_dir_make_tmp("mesorig-disk-XXXXXX", NULL);
    bench->folder = g_steal_pointer(&made);
    bench->root = g_build_filename(bench->folder, "disk", NULL);
    g_assert_cmpint(g_mkdir(bench->root, 0777), ==, 0);
    bench->disk = mmap(NULL, sizeof *bench->disk, PROT_READ | PROT_WRITE,
                       MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    g_assert_true(bench->disk != MAP_FAILED);
    g_strlcpy(bench->disk->root, bench->root, sizeof bench->disk->root);
    bench->model = disk_model_new(bench->root);
    disk_use(bench->disk);
    bench->disk->active = TRUE;
    return bench;
}

static void bench_free(struct bench *bench) {
    disk_use(NULL);
    munmap(bench->disk, sizeof *bench->disk);
    disk_model_free(bench->model);
    disk_remove_tree(bench->folder);
    g_free(bench->folder);
    g_free(bench->root);
    g_free(bench);
}

/* The power fails: the folder is what the medium has. */
static void bench_cut(struct bench *bench, enum cut_mode mode, guint32 seed) {
    g_autoptr(GRand) random = g_rand_new_with_seed(seed);
    bench->disk->active = FALSE;
    disk_model_read(bench->model, bench->disk);
    g_autofree char *missed = disk_model_check(bench->model);
    g_assert_cmpstr(missed, ==, NULL);
    g_free(disk_model_cut(bench->model, mode, FALSE, random));
    disk_use(bench->disk);
    bench->disk->active = TRUE;
}

static char *bench_path(const struct bench *bench, const char *name) {
    return g_build_filename(bench->root, name, NULL);
}

static void bench_write(const struct bench *bench, const char *name, const char *text,
                        gboolean sync) {
    g_autofree char *path = bench_path(bench, name);
    const int fd = g_open(path, O_WRONLY | O_CREAT | O_TRUNC, 0666);
    g_assert_cmpint(fd, >=, 0);
    g_assert_cmpint(write(fd, text, strlen(text)), ==, strlen(text));
    if (sync)
        g_assert_cmpint(fsync(fd), ==, 0);
    close(fd);
}

static int bench_sync_folder(const struct bench *bench) {
    const int fd = g_open(bench->root, O_RDONLY | O_DIRECTORY, 0);
    const int result = fsync(fd);
    close(fd);
    return result;
}

/* "": no such file. */
static char *bench_read(const struct bench *bench, const char *name) {
    g_autofree char *path = bench_path(bench, name);
    char *text = NULL;
    return g_file_get_contents(path, &text, NULL, NULL) ? text : g_strdup("");
}

static void assert_file(const struct bench *bench, const char *name, const char *expected) {
    g_autofree char *text = bench_read(bench, name);
    g_assert_cmpstr(text, ==, expected);
}

/* Contents need fsync() of the file, its name that of the folder. */
TEST(sync) {
    struct bench *bench = bench_new();
    bench_write(bench, "named", "1", FALSE);
    bench_sync_folder(bench);
    bench_write(bench, "both", "2", TRUE);
    bench_sync_folder(bench);
    bench_write(bench, "nameless", "3", TRUE);
    bench_cut(bench, CUT_LOSES, 1);
    assert_file(bench, "named", "");
    g_autofree char *named = bench_path(bench, "named");
    g_assert_true(g_file_test(named, G_FILE_TEST_EXISTS));
    assert_file(bench, "both", "2");
    g_autofree char *nameless = bench_path(bench, "nameless");
    g_assert_false(g_file_test(nameless, G_FILE_TEST_EXISTS));
    bench_write(bench, "kept", "4", FALSE);
    bench_cut(bench, CUT_KEEPS, 1);
    assert_file(bench, "kept", "4");
    bench_free(bench);
}

/* A renaming is one change: there is always the old file or the new one. */
TEST(rename) {
    int n_new = 0;
    for (guint32 seed = 0; seed < 40; seed++) {
        struct bench *bench = bench_new();
        g_autofree char *from = bench_path(bench, "new"), *to = bench_path(bench, "file");
        bench_write(bench, "file", "old", TRUE);
        bench_sync_folder(bench);
        bench_write(bench, "new", "new", TRUE);
        g_assert_cmpint(g_rename(from, to), ==, 0);
        bench_cut(bench, CUT_EACH, seed);
        g_autofree char *text = bench_read(bench, "file");
        g_assert_true(strcmp(text, "old") == 0 || strcmp(text, "new") == 0);
        n_new += strcmp(text, "new") == 0;
        bench_free(bench);
    }
    g_assert_cmpint(n_new, >, 4);
    g_assert_cmpint(n_new, <, 36);
}

/* What one fsync() failed to write no later one writes. */
TEST(failed_sync) {
    struct bench *bench = bench_new();
    g_autofree char *path = bench_path(bench, "file");
    bench_write(bench, "file", "aa", TRUE);
    bench_sync_folder(bench);
    const int fd = g_open(path, O_WRONLY, 0);
    g_assert_cmpint(pwrite(fd, "b", 1, 0), ==, 1);
    bench->disk->faults[0] =
        (struct disk_fault){DISK_SYNC, DISK_FAILS, bench->disk->calls[DISK_SYNC] + 1, 1};
    bench->disk->n_faults = 1;
    g_assert_cmpint(fsync(fd), ==, -1);
    g_assert_cmpint(errno, ==, EIO);
    g_assert_cmpint(pwrite(fd, "c", 1, 1), ==, 1);
    g_assert_cmpint(fsync(fd), ==, 0);
    close(fd);
    assert_file(bench, "file", "bc");
    bench_cut(bench, CUT_KEEPS, 1);
    assert_file(bench, "file", "ac");
    bench_free(bench);
}

/* Each unsynced write is kept, lost, or torn between sectors. */
TEST(torn) {
    gboolean kept = FALSE, lost = FALSE, torn = FALSE;
    for (guint32 seed = 0; seed < 100; seed++) {
        struct bench *bench = bench_new();
        g_autofree char *text = g_strnfill(4096, 'x');
        bench_write(bench, "file", text, FALSE);
        bench_sync_folder(bench);
        bench_cut(bench, CUT_EACH, seed);
        g_autofree char *left = bench_read(bench, "file");
        const gsize n = strlen(left);
        g_assert_cmpuint(n % 512, ==, 0);
        g_assert_cmpuint(strspn(left, "x"), ==, n);
        lost |= n == 0;
        torn |= n > 0 && n < 4096;
        kept |= n == 4096;
        bench_free(bench);
    }
    g_assert_true(kept && lost && torn);
}

/* Calls that take space fail while the disk is full; a short write does half. */
TEST(faults) {
    struct bench *bench = bench_new();
    g_autofree char *path = bench_path(bench, "file"), *other = bench_path(bench, "other");
    const int fd = g_open(path, O_WRONLY | O_CREAT, 0666);
    bench->disk->faults[0] = (struct disk_fault){DISK_WRITE, DISK_SHORT, 1, 1};
    bench->disk->faults[1] = (struct disk_fault){DISK_WRITE, DISK_FULL, 2, 2};
    bench->disk->n_faults = 2;
    g_assert_cmpint(write(fd, "1234", 4), ==, 2);
    for (int i = 0; i < 2; i++) {
        g_assert_cmpint(write(fd, "3", 1), ==, -1);
        g_assert_cmpint(errno, ==, ENOSPC);
    }
    g_assert_cmpint(write(fd, "3", 1), ==, 1);
    close(fd);
    assert_file(bench, "file", "123");
    g_assert_cmpint(bench->disk->n_failed, ==, 3);
    bench->disk->faults[0] =
        (struct disk_fault){DISK_OPEN, DISK_FAILS, bench->disk->calls[DISK_OPEN] + 1, 1};
    g_assert_cmpint(g_open(other, O_WRONLY | O_CREAT, 0666), ==, -1);
    g_assert_cmpint(errno, ==, EIO);
    bench_free(bench);
}

static void run_sql(sqlite3 *db, const char *sql) {
    g_assert_cmpint(sqlite3_exec(db, sql, NULL, NULL, NULL), ==, SQLITE_OK);
}

static int count_rows(const char *path) {
    sqlite3 *db = NULL;
    sqlite3_stmt *statement = NULL;
    g_assert_cmpint(sqlite3_open(path, &db), ==, SQLITE_OK);
    g_assert_cmpint(sqlite3_prepare_v2(db, "SELECT count(*) FROM t", -1, &statement, NULL), ==,
                    SQLITE_OK);
    g_assert_cmpint(sqlite3_step(statement), ==, SQLITE_ROW);
    const int n = sqlite3_column_int(statement, 0);
    sqlite3_finalize(statement);
    sqlite3_close(db);
    return n;
}

/* SQLite goes through the simulated disk: what it says is committed survives any power cut with
 * synchronous = FULL; with OFF some cuts lose it. */
TEST(sqlite) {
    int lost[2] = {0};
    for (guint32 seed = 0; seed < 20; seed++)
        for (int full = 0; full < 2; full++) {
            struct bench *bench = bench_new();
            g_autofree char *path = bench_path(bench, "t.db");
            sqlite3 *db = NULL;
            g_assert_cmpint(sqlite3_open(path, &db), ==, SQLITE_OK);
            run_sql(db, "PRAGMA synchronous = FULL");
            run_sql(db, "PRAGMA journal_mode = WAL");
            run_sql(db, "CREATE TABLE t (i INTEGER)");
            run_sql(db, full ? "PRAGMA synchronous = FULL" : "PRAGMA synchronous = OFF");
            for (int i = 0; i < 5; i++)
                run_sql(db, "INSERT INTO t VALUES (1)");
            const int calls = bench->disk->calls[DISK_ANY];
            g_assert_cmpint(calls, >, 10);
            bench_sync_folder(bench);
            bench->disk->active = FALSE; /* the daemon is dead: closing changes nothing more */
            disk_model_read(bench->model, bench->disk);
            g_autoptr(GRand) random = g_rand_new_with_seed(seed);
            g_free(disk_model_cut(bench->model, CUT_EACH, FALSE, random));
            lost[full] += count_rows(path) < 5;
            sqlite3_close(db);
            bench_free(bench);
        }
    g_assert_cmpint(lost[1], ==, 0);
    g_assert_cmpint(lost[0], >, 0);
}

/* Whichever fsync() fails while a session is made: if it is there nevertheless, and is opened to go
 * on with it, it survives a power cut. */
TEST(session) {
    int left = 0;
    gboolean failed = TRUE;
    for (int k = 1; failed; k++) {
        static const struct session_texts texts = {"", "", "", NULL};
        const struct session_plan plan = {
            .grid = {.width = 4, .height = 4, .width_mm = 10, .height_mm = 10, .depth_mm = 1}};
        struct bench *bench = bench_new();
        g_autofree char *path = bench_path(bench, "s.session");
        bench->disk->faults[0] = (struct disk_fault){DISK_SYNC, DISK_FAILS, k, 1};
        bench->disk->n_faults = 1;
        Session *session = session_create(path, "s", &texts, &plan, NULL);
        const gboolean made = session != NULL;
        failed = bench->disk->n_failed > 0;
        session_close(session);
        g_assert_true(made || failed);
        if (!made && g_file_test(path, G_FILE_TEST_EXISTS)) {
            session = ok(session_open(path, SESSION_CAPTURE, ERR));
            session_close(session);
            bench_cut(bench, CUT_LOSES, 1);
            g_assert_true(g_file_test(path, G_FILE_TEST_EXISTS));
            left++;
        }
        bench_free(bench);
    }
    g_assert_cmpint(left, >, 0);
}

/* Whichever call fails while a session is made, the error is the disk's: there is no session yet
 * that a backup could have. */
TEST(new_session) {
    static const struct session_texts texts = {"", "", "", NULL};
    const struct session_plan plan = {
        .grid = {.width = 4, .height = 4, .width_mm = 10, .height_mm = 10, .depth_mm = 1}};
    for (int kind = 0; kind < DISK_KINDS; kind++) {
        int refused = 0;
        gboolean failed = TRUE;
        for (int k = 1; failed; k++) {
            struct bench *bench = bench_new();
            g_autofree char *path = bench_path(bench, "s.session");
            g_autoptr(GError) error = NULL;
            bench->disk->faults[0] = (struct disk_fault){(enum disk_kind)kind, DISK_FAILS, k, 1};
            bench->disk->n_faults = 1;
            g_autoptr(Session) session = session_create(path, "s", &texts, &plan, &error);
            failed = bench->disk->n_failed > 0;
            g_assert_true((session != NULL) == (error == NULL));
            if (error) {
                refused++;
                g_test_message("%s %d: %s", schedule_disk_kind((enum disk_kind)kind), k,
                               error->message);
                g_assert_error(error, SESSION_ERROR, SESSION_ERROR_IO);
                g_assert_null(strstr(error->message, "backup"));
                g_assert_nonnull(strstr(error->message, bench->root));
            }
            disk_use(NULL);
            g_clear_pointer(&session, session_close);
            bench_free(bench);
        }
        if (kind == DISK_READ || kind == DISK_WRITE || kind == DISK_SYNC)
            g_assert_cmpint(refused, >, 0);
    }
}

/* Opens one value of a session while the k-th call to open, and five more, fail, and every fsync()
 * from the j-th on that follows the write: SQLite copies its log into the database and cannot sync
 * that. Then the power fails. Whether the value was stored by then. */
static gboolean store_before_a_cut(struct bench *bench, const char *path, int k, int j) {
    g_autoptr(GError) error = NULL;
    const int *calls = bench->disk->calls;
    bench->disk->faults[0] = (struct disk_fault){DISK_OPEN, DISK_FAILS, calls[DISK_OPEN] + k, 6};
    bench->disk->n_faults = 1;
    Session *session = session_open(path, SESSION_PRODUCTS, &error);
    const gboolean stored = session && session_set_value(session, "key", "value", &error);
    bench->disk->faults[1] = (struct disk_fault){DISK_SYNC, DISK_FAILS, calls[DISK_SYNC] + j, 1000};
    bench->disk->n_faults = 2;
    session_close(session);
    bench->disk->n_faults = 0;
    return stored;
}

/* The write-ahead log has its name before anything is in it, or the session is not opened: SQLite
 * goes on when it cannot open the folder to sync that name. */
TEST(log_has_its_name) {
    static const struct session_texts texts = {"", "", "", NULL};
    const struct session_plan plan = {
        .grid = {.width = 4, .height = 4, .width_mm = 10, .height_mm = 10, .depth_mm = 1}};
    int stored = 0;
    for (int k = 1; k <= 12; k++)
        for (int j = 1; j <= 3; j++)
            for (guint32 seed = 1; seed <= 8; seed++) {
                struct bench *bench = bench_new();
                g_autofree char *path = bench_path(bench, "s.session");
                Session *session = ok(session_create(path, "s", &texts, &plan, ERR));
                session_close(session);
                const gboolean has = store_before_a_cut(bench, path, k, j);
                bench_cut(bench, CUT_EACH, seed);
                session = ok(session_open(path, SESSION_CAPTURE, ERR));
                g_autofree char *value = session_value(session, "key");
                g_assert_true(!has || g_strcmp0(value, "value") == 0);
                stored += has;
                session_close(session);
                bench_free(bench);
            }
    g_test_message("stored %d times", stored);
    g_assert_cmpint(stored, >, 0);
}

/* An error and no result, or the other way round; an error of the disk is not told as damage. */
static void expect_told(gboolean ok, GError **error, int *ret_refused) {
    g_assert_true(ok == (*error == NULL));
    if (*error) {
        (*ret_refused)++;
        if (strstr((*error)->message, "backup"))
            g_error("an error of the disk is told as damage: %s", (*error)->message);
    }
    g_clear_error(error);
}

static void expect_array(GPtrArray *array, GError **error, int *ret_refused) {
    expect_told(array != NULL, error, ret_refused);
    if (array)
        g_ptr_array_unref(array);
}

static void use_session(Session *session, int *ret_refused) {
    GError *error = NULL;
    int n = 0;
    g_autofree char *frame = g_strdup("frames/a.exr");
    g_autofree char *file = session_file(session, frame);
    g_autofree char *sha256 = g_compute_checksum_for_string(G_CHECKSUM_SHA256, "f", 1);
    const struct session_frame row = {.shot = 1, .path = frame, .sha256 = sha256, .bytes = 1};
    expect_array(session_views(session, &error), &error, ret_refused);
    expect_array(session_shots(session, &error), &error, ret_refused);
    expect_array(session_frames(session, &error), &error, ret_refused);
    expect_array(session_events(session, &error), &error, ret_refused);
    if (g_file_set_contents(file, "f", 1, NULL))
        expect_told(session_commit_shot(session, 1, SHOT_DONE, &row, 1, NULL, &error), &error,
                    ret_refused);
    expect_told(session_add_event(session, 1, "info", "axis", "homed", &error), &error,
                ret_refused);
    expect_told(session_set_value(session, "state", "done", &error), &error, ret_refused);
    expect_told(session_verify(session, TRUE, &n, &error), &error, ret_refused);
    expect_array(session_find_damage(session, SESSION_FRAMES, NULL, NULL, &n, &error), &error,
                 ret_refused);
    expect_array(session_list_products(session, &error), &error, ret_refused);
}

/* Whichever call fails while a session is opened, read and written: an error says so, and without
 * the fault the session is whole. */
TEST(session_in_use) {
    static const struct session_texts texts = {"", "", "", NULL};
    const struct session_shot shot = {
        .id = 1, .kind = SHOT_DARK, .source = -1, .device = -1, .cameras = {{1}}};
    const struct session_plan plan = {
        .grid = {.width = 4, .height = 4, .width_mm = 10, .height_mm = 10, .depth_mm = 1},
        .shots = &shot,
        .n_shots = 1};
    for (int kind = 0; kind < DISK_KINDS; kind++) {
        int refused = 0;
        gboolean failed = TRUE;
        for (int k = 1; failed; k++) {
            struct bench *bench = bench_new();
            g_autofree char *path = bench_path(bench, "s.session");
            GError *error = NULL;
            Session *session = ok(session_create(path, "s", &texts, &plan, ERR));
            session_close(session);
            const int before = bench->disk->calls[kind];
            bench->disk->faults[0] =
                (struct disk_fault){(enum disk_kind)kind, DISK_FAILS, before + k, 1};
            bench->disk->n_faults = 1;
            session = session_open(path, SESSION_CAPTURE, &error);
            expect_told(session != NULL, &error, &refused);
            if (session)
                use_session(session, &refused);
            session_close(session);
            failed = bench->disk->n_failed > 0;
            bench->disk->n_faults = 0;
            session = ok(session_open(path, SESSION_CAPTURE, ERR));
            int again = 0;
            use_session(session, &again);
            g_assert_cmpint(again, ==, 0);
            session_close(session);
            bench_free(bench);
        }
        g_test_message("%s: %d refusals", schedule_disk_kind((enum disk_kind)kind), refused);
        if (kind == DISK_READ || kind == DISK_WRITE || kind == DISK_SYNC || kind == DISK_OPEN)
            g_assert_cmpint(refused, >, 0);
    }
}
