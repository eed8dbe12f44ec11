/*
 * What can happen to a session: killed programs, full disks, and databases that are damaged or from
 * other programs.
 */
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/session_fixture.h"
#include "lib/skip.h"
#include "lib/test.h"

/* Killed at any time while committing: what is there is whole. */
TEST(killed_commit) {
    g_autofree char *path = session_fixture_path("kill");
    GRand *rand = g_rand_new_with_seed(4);

    session_close(session_fixture_create(path, 1, 250));
    for (int round = 0; round < 8; round++) {
        g_autoptr(GError) error = NULL;
        guint done = 0;
        int lost = -1;
        pid_t child = fork();

        if (child == 0) {
            Session *own = session_open(path, SESSION_CAPTURE, NULL);

            for (gint64 shot = 1 + round * 30; own && shot <= 250; shot++)
                session_fixture_commit(own, shot, 3, NULL);
            _exit(own ? 0 : 1);
        }
        g_usleep((gulong)g_rand_int_range(rand, 3000, 60000));
        kill(child, SIGKILL);
        session_fixture_wait(child, SIGKILL);
        g_autoptr(Session) session = session_open(path, SESSION_CAPTURE, &error);
        g_assert_no_error(error);
        g_assert_true(session_verify(session, TRUE, &lost, &error));
        g_assert_cmpint(lost, ==, 0);
        g_autoptr(GPtrArray) shots = session_shots(session, &error);
        g_autoptr(GPtrArray) frames = session_frames(session, &error);
        for (guint i = 0; i < shots->len; i++)
            done += ((struct session_shot *)g_ptr_array_index(shots, i))->state == SHOT_DONE;
        g_assert_cmpuint(frames->len, ==, done * 3);
    }
    g_rand_free(rand);
}

/* Killed at any time while being made: there is no session, or a whole one. */
TEST(killed_create) {
    GRand *rand = g_rand_new_with_seed(5);

    for (int round = 0; round < 12; round++) {
        g_autofree char *path = session_fixture_path("born");
        g_autofree struct random_plan *p = session_fixture_random_plan(2, 300);
        pid_t child = fork();

        if (child == 0)
            _exit(session_create(path, "Loden, grün", &texts, &p->plan, NULL) ? 0 : 1);
        g_usleep((gulong)g_rand_int_range(rand, 0, 30000));
        kill(child, SIGKILL);
        session_fixture_wait(child, SIGKILL);
        if (g_file_test(path, G_FILE_TEST_EXISTS)) {
            g_autoptr(GError) error = NULL;
            g_autoptr(Session) session = session_open(path, SESSION_CAPTURE, &error);

            g_assert_no_error(error);
            session_fixture_assert_plan(session, p);
        }
    }
    g_rand_free(rand);
}

static void sql(const char *path, const char *statement) {
    g_autofree char *file = g_build_filename(path, "session.db", NULL);
    sqlite3 *db = NULL;

    g_assert_cmpint(sqlite3_open(file, &db), ==, SQLITE_OK);
    g_assert_cmpint(sqlite3_exec(db, statement, NULL, NULL, NULL), ==, SQLITE_OK);
    sqlite3_close(db);
}

static void assert_not_opened(const char *path, const char *says) {
    for (int mode = SESSION_READ; mode <= SESSION_CAPTURE; mode++) {
        g_autoptr(GError) error = NULL;

        g_assert_null(session_open(path, (enum session_mode)mode, &error));
        g_assert_error(error, SESSION_ERROR, SESSION_ERROR_FORMAT);
        assert_has(error->message, says);
    }
}

TEST(not_a_session) {
    g_autofree char *none = session_fixture_path("none"), *empty = session_fixture_path("empty"),
                    *text = session_fixture_path("text");
    g_autofree char *foreign = session_fixture_path("foreign"),
                    *fifo = session_fixture_path("fifo");
    g_autofree char *text_db = g_build_filename(text, "session.db", NULL);
    g_autofree char *fifo_db = g_build_filename(fifo, "session.db", NULL);
    g_autofree char *lock = g_build_filename(empty, "capture.lock", NULL);

    assert_not_opened(none, "no session there");
    g_mkdir(empty, 0755);
    assert_not_opened(empty, "no session there");
    g_assert_false(g_file_test(lock, G_FILE_TEST_EXISTS));
    g_mkdir(text, 0755);
    g_assert_true(g_file_set_contents(text_db, "I am no database, I am a long text.", -1, NULL));
    assert_not_opened(text, "not a session's database");
    g_assert_true(g_file_set_contents(text_db, "", 0, NULL));
    assert_not_opened(text, "not of a session");
    g_mkdir(foreign, 0755);
    sql(foreign, "CREATE TABLE shot (id); PRAGMA user_version = 1");
    assert_not_opened(foreign, "not of a session");
    g_mkdir(fifo, 0755);
    g_assert_cmpint(mkfifo(fifo_db, 0600), ==, 0);
    assert_not_opened(fifo, "a FIFO, not a regular file");
}

static void assert_changed(const char *statement, const char *says) {
    g_autofree char *path = session_fixture_path("changed");

    session_close(session_fixture_create(path, 6, 9));
    sql(path, statement);
    assert_not_opened(path, says);
}

TEST(changed_schema) {
    assert_changed("PRAGMA user_version = 2", "newer program");
    assert_changed("PRAGMA user_version = 0", "format 0");
    assert_changed("DROP TABLE event", "damaged");
    assert_changed("ALTER TABLE shot ADD COLUMN evil TEXT", "definition of the table");
    assert_changed("DROP TABLE value; CREATE TABLE value (key, value AS (key || 'x'))",
                   "definition of the table");
    assert_changed("DROP TABLE product; CREATE VIEW product AS SELECT 1", "damaged");
    assert_changed("DELETE FROM session", "no name");
}

/* Comments may differ, as those of other versions do. Nothing hides behind them. */
TEST(changed_comments) {
    static const char change[] = "PRAGMA writable_schema = 1;"
                                 "UPDATE sqlite_schema SET sql = replace(sql, %s)";
    static const char *const others[] = {
        "'-- relative to the session directory', '-- below the session'",
        "'  -- what processing made', '  -- what was made -- of it'",
    };
    static const char *const hiding[] = {
        "'made_by TEXT NOT NULL,', 'made_by TEXT NOT NULL DEFAULT ''--'','",
        "'made_by TEXT NOT NULL,', 'made_by TEXT NOT NULL, -- x' || char(10) || ' evil TEXT,'",
        "'made_by TEXT NOT NULL,', 'made_by TEXT NOT NULL, \"--\" TEXT,'",
    };
    for (gsize i = 0; i < G_N_ELEMENTS(others); i++) {
        g_autofree char *path = session_fixture_path("comments");
        g_autofree char *statement = g_strdup_printf(change, others[i]);

        session_close(session_fixture_create(path, 6, 9));
        sql(path, statement);
        ok(session_close(session_open(path, SESSION_READ, ERR)));
    }
    for (gsize i = 0; i < G_N_ELEMENTS(hiding); i++) {
        g_autofree char *statement = g_strdup_printf(change, hiding[i]);
        assert_changed(statement, "definition of the table");
    }
}

/* Rows that a stranger put in are refused when they are read, triggers never run. */
TEST(changed_rows) {
    static const char *const changes[] = {
        "UPDATE shot SET id = 77 WHERE id = 3",
        "UPDATE shot SET cameras = -1000 WHERE id = 3",
        "UPDATE shot SET sweep_steps = 99999999999 WHERE id = 3",
        "UPDATE shot SET kind = 'lamp', source = 4000 WHERE id = 3",
        "UPDATE shot SET arc_deg = 9e999 WHERE id = 3",
        "PRAGMA ignore_check_constraints = 1; UPDATE shot SET kind = 'bomb' WHERE id = 3",
    };

    for (gsize i = 0; i < G_N_ELEMENTS(changes); i++) {
        g_autofree char *path = session_fixture_path("rows");
        g_autoptr(GError) error = NULL;

        session_close(session_fixture_create(path, 6, 9));
        sql(path, changes[i]);
        g_autoptr(Session) session = session_open(path, SESSION_READ, &error);
        if (session)
            g_assert_null(session_shots(session, &error));
        g_assert_error(error, SESSION_ERROR, SESSION_ERROR_FORMAT);
    }
}

TEST(trigger) {
    g_autofree char *path = session_fixture_path("trigger");
    g_autoptr(GError) error = NULL;

    session_close(session_fixture_create(path, 6, 9));
    sql(path, "CREATE TRIGGER t AFTER INSERT ON event BEGIN"
              " INSERT INTO value VALUES ('evil', 'yes'); END;"
              "INSERT INTO frame VALUES (1, 0, '../../etc/passwd', 'x', 1, 0, 0)");
    g_autoptr(Session) session = session_open(path, SESSION_PRODUCTS, &error);
    g_assert_no_error(error);
    g_assert_true(session_add_event(session, 0, "info", "a", "b", &error));
    g_assert_null(session_value(session, "evil"));
    g_assert_null(session_frames(session, &error));
    g_assert_error(error, SESSION_ERROR, SESSION_ERROR_FORMAT);
}

static void read_everything(const char *path, enum session_mode mode) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(path, mode, &error);
    GPtrArray *(*const readers[])(Session *, GError **) = {session_views,  session_lights,
                                                           session_lasers, session_shots,
                                                           session_frames, session_events};
    struct session_grid grid;

    g_assert_true((session != NULL) == (error == NULL));
    if (!session)
        return;
    for (gsize i = 0; i < G_N_ELEMENTS(readers); i++) {
        g_autoptr(GError) own = NULL;
        g_autoptr(GPtrArray) rows = readers[i](session, &own);

        g_assert_true((rows != NULL) == (own == NULL));
    }
    session_grid(session, &grid, NULL);
    g_free(session_text(session, "rig.conf", NULL));
    if (mode == SESSION_CAPTURE) {
        session_commit_shot(session, 2, SHOT_SKIPPED, NULL, 0, "x", NULL);
        session_add_event(session, 0, "info", "x", "y", NULL);
        session_verify(session, FALSE, NULL, NULL);
    }
}

TEST(mutated) {
    g_autofree char *path = session_fixture_path("mutated"), *bytes = NULL;
    g_autofree char *file = g_build_filename(path, "session.db", NULL);
    g_autofree char *wal = g_strconcat(file, "-wal", NULL), *shm = g_strconcat(file, "-shm", NULL);
    const char *wanted = g_getenv("MESORIG_FUZZ");
    GRand *rand = g_rand_new_with_seed(wanted ? g_random_int() : 7);
    Session *session = session_fixture_create(path, 6, 40);
    gsize length;

    for (gint64 shot = 1; shot <= 20; shot++)
        g_assert_true(session_fixture_commit(session, shot, 2, NULL));
    session_close(session);
    g_assert_true(g_file_get_contents(file, &bytes, &length, NULL));
    for (int i = 0; i < (wanted ? atoi(wanted) : 400); i++) {
        g_autofree char *copy = g_memdup2(bytes, length);
        int n = g_rand_int_range(rand, 1, 8);
        int fd;

        for (int k = 0; k < n; k++) {
            /* Half of them where pages begin, since there is their structure. */
            gsize at = (gsize)g_rand_int_range(rand, 0, (int)length);

            at = g_rand_boolean(rand) ? at : at / 4096 * 4096 + at % 64;
            copy[at] = (char)g_rand_int(rand);
        }
        fd = open(file, O_WRONLY | O_TRUNC);
        g_assert_cmpint(write(fd, copy, i % 5 ? length : length * (gsize)(i % 7) / 7), >=, 0);
        close(fd);
        g_unlink(wal);
        g_unlink(shm);
        read_everything(path, i % 2 ? SESSION_READ : SESSION_CAPTURE);
    }
    g_rand_free(rand);
}

/* In a name space of its own, so that it ends with the child. */
static gboolean mount_small(const char *where, const char *options) {
    return unshare(CLONE_NEWNS | (getuid() ? CLONE_NEWUSER : 0)) == 0 &&
           mount("none", "/", NULL, MS_REC | MS_PRIVATE, NULL) == 0 &&
           mount("tmpfs", where, "tmpfs", 0, options) == 0;
}

/* A capture until the disk is full, then some is freed and it goes on with nothing lost. */
static int capture_until_full(const char *where) {
    g_autofree char *path = g_build_filename(where, "full.session", NULL);
    g_autofree char *ballast = g_build_filename(where, "ballast", NULL);
    static const char block[4096];
    g_autoptr(GError) error = NULL;
    gint64 shot = 1;
    int lost;

    if (!mount_small(where, "size=1400k"))
        return 77;
    g_autoptr(Session) session = session_fixture_create(path, 1, 250);
    struct session_frame frame = session_fixture_frame(session, 1, 0);
    if (!session_commit_shot(session, 1, SHOT_DONE, &frame, 1, NULL, NULL))
        return 1;
    int fd = open(ballast, O_WRONLY | O_CREAT, 0600);
    while (write(fd, block, sizeof block) > 0)
        ;
    close(fd);
    do
        shot++;
    while (shot < 250 &&
           session_commit_shot(session, shot, SHOT_SKIPPED, NULL, 0, "no frames", &error));
    if (!g_error_matches(error, SESSION_ERROR, SESSION_ERROR_FULL))
        return 2;
    g_clear_error(&error);
    if (session_add_event(session, 0, "error", "disk", "full", &error) ||
        !g_error_matches(error, SESSION_ERROR, SESSION_ERROR_FULL))
        return 3;
    g_clear_error(&error);
    if (session_fixture_state(session, shot) != SHOT_PLANNED ||
        session_fixture_state(session, shot - 1) == SHOT_PLANNED)
        return 4;
    g_unlink(ballast);
    if (!session_commit_shot(session, shot, SHOT_SKIPPED, NULL, 0, NULL, &error) ||
        !session_verify(session, TRUE, &lost, &error) || lost != 0)
        return 5;
    g_autoptr(GPtrArray) frames = session_frames(session, &error);
    return frames && frames->len == 1 ? 0 : 6;
}

static int create_when_full(const char *where) {
    g_autofree char *path = g_build_filename(where, "full.session", NULL);
    g_autofree struct random_plan *p = session_fixture_random_plan(1, 300);
    g_autoptr(GError) error = NULL;

    if (!mount_small(where, "size=40k"))
        return 77;
    if (session_create(path, "x", &texts, &p->plan, &error) ||
        !g_error_matches(error, SESSION_ERROR, SESSION_ERROR_FULL))
        return 1;
    g_autoptr(GDir) dir = g_dir_open(where, 0, NULL);
    return g_dir_read_name(dir) == NULL ? 0 : 2;
}

static int read_only_medium(const char *where) {
    g_autofree char *path = g_build_filename(where, "still.session", NULL);
    g_autofree struct random_plan *p = session_fixture_random_plan(1, 30);
    g_autoptr(GError) error = NULL;

    if (!mount_small(where, "size=4m"))
        return 77;
    session_close(session_fixture_create(path, 1, 30));
    if (mount("none", where, NULL, MS_REMOUNT | MS_RDONLY, NULL) != 0)
        return 77;
    g_autoptr(Session) session = session_open(path, SESSION_READ, &error);
    if (!session)
        return 1;
    session_fixture_assert_plan(session, p);
    return 0;
}

struct name_space {
    int (*run)(const char *where); /* 77: may not mount, else an exit code */
    const char *folder;
};

static void test_in_name_space(gconstpointer data) {
    const struct name_space *space = data;
    g_autofree char *where = g_build_filename(session_fixture_folder, space->folder, NULL);
    pid_t child;
    int status;

    g_mkdir(where, 0755);
    if ((child = fork()) == 0)
        _exit(space->run(where));
    g_assert_cmpint(waitpid(child, &status, 0), ==, child);
    g_assert_true(WIFEXITED(status));
    if (WEXITSTATUS(status) == 77)
        test_skip_or_fail("may not mount a file system of its own");
    else
        g_assert_cmpint(WEXITSTATUS(status), ==, 0);
}

TESTS_RUN_BY(session_fixture_run);

BEFORE_TESTS {
    static const struct name_space small = {capture_until_full, "small"},
                                   smaller = {create_when_full, "smaller"},
                                   read_only = {read_only_medium, "readonly"};
    g_test_add_data_func("/session-damage/disk-full", &small, test_in_name_space);
    g_test_add_data_func("/session-damage/create-full", &smaller, test_in_name_space);
    g_test_add_data_func("/session-damage/read-only-medium", &read_only, test_in_name_space);
}
