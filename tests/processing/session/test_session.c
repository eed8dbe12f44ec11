/*
 * The session directory: a plan is read back bit for bit, and a commit is complete or has no
 * effect.
 */
#include "lib/assert_error.h"
#include "lib/ok.h"
#include "lib/session_fixture.h"
#include "lib/test.h"

#include <gio/gio.h>
#include <sys/stat.h>

TEST(plan) {
    for (guint32 seed = 1; seed <= 12; seed++) {
        g_autofree char *path = session_fixture_path("plan");
        g_autofree struct random_plan *p = session_fixture_random_plan(seed, (int)seed * 25);
        Session *session = session_fixture_create(path, seed, (int)seed * 25);

        session_fixture_assert_plan(session, p);
        session_close(session);
        for (int mode = SESSION_READ; mode <= SESSION_CAPTURE; mode++) {
            g_autoptr(GError) error = NULL;
            g_autoptr(Session) again = session_open(path, (enum session_mode)mode, &error);

            g_assert_no_error(error);
            session_fixture_assert_plan(again, p);
            g_assert_cmpstr(session_path(again), ==, path);
        }
    }
}

static void assert_refused(const struct session_plan *plan) {
    g_autofree char *path = session_fixture_path("refused");
    g_autoptr(GError) error = NULL;

    g_assert_null(session_create(path, "x", &texts, plan, &error));
    g_assert_error(error, SESSION_ERROR, SESSION_ERROR_FORMAT);
    g_assert_false(g_file_test(path, G_FILE_TEST_EXISTS));
}

/* Values that a session is made with are there as soon as it has its name; one that is not set is
 * no error, and differs from one that cannot be read. */
TEST(first_values) {
    static const char *const values[][2] = {{"calibration", "nominal"}, {"chosen", NULL}};
    g_autofree struct random_plan *p = session_fixture_random_plan(3, 5);
    g_autofree char *path = session_fixture_path("values"), *found = NULL, *none = NULL;
    g_autoptr(GError) error = NULL;
    struct session_texts with = texts;
    with.values = values;
    with.n_values = G_N_ELEMENTS(values);
    Session *session = ok(session_create(path, "x", &with, &p->plan, ERR));
    g_assert_true(session_read_value(session, "calibration", &found, &error));
    g_assert_cmpstr(found, ==, "nominal");
    g_assert_true(session_read_value(session, "chosen", &none, &error));
    g_assert_null(none);
    session_close(session);
    g_clear_pointer(&found, g_free);
    /* The table goes while the session is open. */
    g_autofree char *file = g_build_filename(path, "session.db", NULL);
    sqlite3 *db = NULL;
    session = ok(session_open(path, SESSION_READ, ERR));
    g_assert_cmpint(sqlite3_open(file, &db), ==, SQLITE_OK);
    g_assert_cmpint(sqlite3_exec(db, "DROP TABLE value", NULL, NULL, NULL), ==, SQLITE_OK);
    sqlite3_close(db);
    g_assert_false(session_read_value(session, "calibration", &found, &error));
    g_assert_nonnull(error);
    g_assert_null(found);
    g_assert_null(session_value(session, "calibration"));
    session_close(session);
}

/* The sets of cameras in the database: the bits of an integer, or a list among the values. */
TEST(cameras) {
    static const struct {
        int camera;
        const char *column;
    } cases[] = {{0, "1"},
                 {30, "1073741824"},
                 {31, "2147483648"},
                 {32, "4294967296"},
                 {62, "4611686018427387904"},
                 {63, "-1"},
                 {64, "-2"},
                 {255, "-3"},
                 {63, "-1"}};
    const int n = G_N_ELEMENTS(cases);
    g_autofree struct random_plan *p = session_fixture_random_plan(4, n);
    g_autofree char *path = session_fixture_path("cameras");
    g_autofree char *file = g_build_filename(path, "session.db", NULL);
    sqlite3 *db = NULL;
    sqlite3_stmt *rows = NULL;
    for (int i = 0; i < n; i++)
        p->shots[i].cameras = camera_set_of(cases[i].camera);
    Session *session = ok(session_create(path, "Loden, grün", &texts, &p->plan, ERR));
    session_fixture_assert_plan(session, p);
    session_close(session);
    g_assert_cmpint(sqlite3_open(file, &db), ==, SQLITE_OK);
    sqlite3_prepare_v2(db, "SELECT cameras FROM shot ORDER BY id", -1, &rows, NULL);
    for (int i = 0; i < n; i++) {
        g_assert_cmpint(sqlite3_step(rows), ==, SQLITE_ROW);
        g_assert_cmpstr((const char *)sqlite3_column_text(rows, 0), ==, cases[i].column);
    }
    sqlite3_finalize(rows);
    sqlite3_prepare_v2(db, "SELECT value FROM value WHERE key = 'cameras/3'", -1, &rows, NULL);
    g_assert_cmpint(sqlite3_step(rows), ==, SQLITE_ROW);
    g_assert_cmpstr((const char *)sqlite3_column_text(rows, 0), ==, "255");
    sqlite3_finalize(rows);
    sqlite3_close(db);
}

/* A plan that somebody has edited in the database is refused when it is read, with a reason. */
TEST(edited) {
    static const char *const edits[] = {
        "UPDATE grid SET width = 0",
        "UPDATE grid SET width = 16385",
        "UPDATE grid SET height = -1",
        "UPDATE grid SET height = 99999999999",
        "UPDATE grid SET width_mm = 0",
        "UPDATE grid SET width_mm = 9e999",
        "UPDATE grid SET height_mm = -1",
        "UPDATE grid SET height_mm = 9e999",
        "UPDATE grid SET reference_mm = 9e999",
        "UPDATE grid SET depth_mm = -1",
        "UPDATE grid SET depth_mm = 9e999",
        "DELETE FROM grid",
        "DELETE FROM session",
        "UPDATE direction SET idx = 999 WHERE kind = 'view' AND idx = 0",
        "UPDATE direction SET device = -1 WHERE kind = 'light'",
        "UPDATE direction SET device = 1000001 WHERE kind = 'laser'",
        "UPDATE direction SET theta_deg = 9e999 WHERE kind = 'view'",
        "UPDATE direction SET phi_deg = 9e999 WHERE kind = 'view'",
        "UPDATE direction SET turntable_deg = -9e999 WHERE kind = 'view'",
        "UPDATE direction SET note = CAST (x'ff' AS TEXT) WHERE kind = 'view'",
        "UPDATE shot SET id = 99 WHERE id = 5",
        "UPDATE shot SET kind = 'other' WHERE id = 2",
        "UPDATE shot SET state = 'other' WHERE id = 2",
        "UPDATE shot SET kind = 'lamp', source = 99 WHERE id = 2",
        "UPDATE shot SET kind = 'sweep', source = -1 WHERE id = 2",
        "UPDATE shot SET kind = 'dark', source = 0 WHERE id = 2",
        "UPDATE shot SET device = -2 WHERE id = 2",
        "UPDATE shot SET device = 1000001 WHERE id = 2",
        "UPDATE shot SET pose = -1 WHERE id = 2",
        "UPDATE shot SET pose = 99999999999 WHERE id = 2",
        "UPDATE shot SET sweep_steps = -1 WHERE id = 2",
        "UPDATE shot SET sweep_steps = 1000001 WHERE id = 2",
        "UPDATE shot SET turntable_deg = 9e999 WHERE id = 2",
        "UPDATE shot SET arc_deg = 9e999 WHERE id = 2",
        "UPDATE shot SET sweep_from_deg = 9e999 WHERE id = 2",
        "UPDATE shot SET sweep_to_deg = 9e999 WHERE id = 2",
        "UPDATE shot SET note = CAST (x'ff' AS TEXT) WHERE id = 2",
        "UPDATE shot SET cameras = -1000 WHERE id = 2", /* a set that is not stored */
        "UPDATE shot SET cameras = -9223372036854775808 WHERE id = 2",
        "UPDATE value SET value = '' WHERE key = 'cameras/1'",
        "UPDATE value SET value = '0 256' WHERE key = 'cameras/1'",
        "UPDATE value SET value = '70 3' WHERE key = 'cameras/1'",
        "INSERT INTO frame VALUES (1, 0, '../a.exr', '', 1, 0, 0)",
        "INSERT INTO frame VALUES (1, 0, '/a.exr', '', 1, 0, 0)",
        "INSERT INTO frame VALUES (1, -1, 'a.exr', '', 1, 0, 0)",
        "INSERT INTO frame VALUES (1, 256, 'a.exr', '', 1, 0, 0)",
        "INSERT INTO frame VALUES (1, 0, 'a.exr', '', -1, 0, 0)",
    };
    g_autofree char *path = session_fixture_path("edited");
    g_autofree char *file = g_build_filename(path, "session.db", NULL);
    session_close(session_fixture_create(path, 7, 12));
    g_autofree char *whole = NULL;
    gsize n = 0;
    g_assert_true(g_file_get_contents(file, &whole, &n, NULL));
    for (gsize i = 0; i < G_N_ELEMENTS(edits); i++) {
        sqlite3 *db = NULL;
        g_autoptr(GError) error = NULL;
        struct session_grid grid;
        g_assert_cmpint(sqlite3_open(file, &db), ==, SQLITE_OK);
        sqlite3_exec(db, "PRAGMA ignore_check_constraints = ON", NULL, NULL, NULL);
        if (sqlite3_exec(db, edits[i], NULL, NULL, NULL) != SQLITE_OK)
            g_error("%s: %s", edits[i], sqlite3_errmsg(db));
        g_assert_cmpint(sqlite3_changes(db), >, 0);
        sqlite3_close(db);
        g_autofree char *program = NULL, *created = NULL;
        g_autoptr(Session) session = session_open(path, SESSION_READ, &error);
        typedef GPtrArray *(*Read)(Session *, GError **);
        static const Read reads[] = {session_views, session_lights, session_lasers, session_shots,
                                     session_frames};
        gboolean ok = session && session_grid(session, &grid, &error) &&
                      session_origin(session, &program, &created, &error);
        for (gsize k = 0; ok && k < G_N_ELEMENTS(reads); k++) {
            g_autoptr(GPtrArray) rows = reads[k](session, &error);
            ok = rows != NULL;
        }
        if (ok)
            g_error("accepted: %s", edits[i]);
        g_assert_error(error, SESSION_ERROR, SESSION_ERROR_FORMAT);
        g_clear_pointer(&session, session_close);
        g_assert_true(g_file_set_contents(file, whole, (gssize)n, NULL));
    }
}

/* Who may write is for the umask to say, and whose group it is for the folder it is made in. */
TEST(permissions) {
    static const struct {
        const char *name;
        mode_t mode;
    } made[] = {{"", 02770}, {"frames", 02770}, {"products", 02770}, {"session.db", 0660}};
    g_autofree char *path = session_fixture_path("permissions");
    g_autofree char *parent = g_path_get_dirname(path);
    struct stat before, now;

    g_assert_cmpint(stat(parent, &before), ==, 0);
    g_assert_cmpint(chmod(parent, 02700), ==, 0);
    const mode_t mask = umask(0007);
    session_close(session_fixture_create(path, 1, 10));
    umask(mask);
    for (gsize i = 0; i < G_N_ELEMENTS(made); i++) {
        g_autofree char *file = g_build_filename(path, made[i].name, NULL);

        g_assert_cmpint(stat(file, &now), ==, 0);
        g_assert_cmpint(now.st_mode & 07777, ==, made[i].mode);
    }
    g_assert_cmpint(chmod(parent, before.st_mode & 07777), ==, 0);
}

TEST(bad_plan) {
    static const double bad[] = {NAN, INFINITY, -INFINITY};
    static const struct session_texts latin = {
        .rig_conf = "\xfc", .session_conf = "", .calibration = ""};
    g_autofree struct random_plan *p = session_fixture_random_plan(3, 50);
    g_autofree char *path = session_fixture_path("refused");
    g_autoptr(GError) error = NULL;

    for (gsize i = 0; i < G_N_ELEMENTS(bad); i++) {
        g_autofree struct random_plan *q = session_fixture_random_plan(3, 50);

        q->shots[49].arc_deg = bad[i];
        assert_refused(&q->plan);
        q->shots[49].arc_deg = 0;
        q->plan.grid.reference_mm = bad[i];
        assert_refused(&q->plan);
        q->plan.grid.reference_mm = 0;
        q->plan.n_lights = 1;
        q->lights[0].theta_deg = bad[i];
        assert_refused(&q->plan);
    }
    p->plan.grid.width = 0;
    assert_refused(&p->plan);
    p->plan.grid.width = 10;
    p->shots[7].id = 7;
    assert_refused(&p->plan);
    p->shots[7].id = 8;
    p->shots[7].kind = SHOT_LAMP;
    p->shots[7].source = p->plan.n_lights;
    assert_refused(&p->plan);
    p->plan.n_shots = 0;
    g_assert_null(session_create(path, "x", &latin, &p->plan, &error));
    g_assert_error(error, SESSION_ERROR, SESSION_ERROR_FORMAT);
}

TEST(exists) {
    g_autofree char *path = session_fixture_path("exists"),
                    *nowhere = g_build_filename(path, "a/b", NULL);
    g_autofree struct random_plan *p = session_fixture_random_plan(1, 1);
    g_autoptr(GError) error = NULL;

    g_assert_cmpint(g_mkdir(path, 0755), ==, 0); /* empty, which rename() would replace */
    g_assert_null(session_create(path, "x", &texts, &p->plan, &error));
    assert_error_clear(&error, SESSION_ERROR, SESSION_ERROR_EXISTS);
    g_assert_null(session_create(nowhere, "x", &texts, &p->plan, &error));
    g_assert_error(error, SESSION_ERROR, SESSION_ERROR_IO);
    g_autoptr(GDir) dir = g_dir_open(session_fixture_folder, 0, NULL);
    for (const char *name; (name = g_dir_read_name(dir));)
        g_assert_true(*name != '.'); /* nothing half made is left */
}

TEST(commit) {
    g_autofree char *path = session_fixture_path("commit");
    g_autoptr(Session) session = session_fixture_create(path, 1, 10);
    g_autoptr(GError) error = NULL;

    g_assert_true(session_fixture_commit(session, 3, 2, &error));
    g_assert_true(session_fixture_commit(session, 2, 3, &error));
    g_assert_true(session_fixture_commit(session, 3, 1, &error)); /* retaken: replaces */
    g_assert_no_error(error);
    g_autoptr(GPtrArray) frames = session_frames(session, &error);
    g_assert_cmpuint(frames->len, ==, 4);
    const struct session_frame *frame = g_ptr_array_index(frames, 2);
    g_assert_cmpint(frame->shot, ==, 2);
    g_assert_cmpint(frame->camera, ==, 2);
    g_assert_cmpint(frame->retakes, ==, 2);
    g_assert_cmpstr(frame->path, ==, "frames/000002_cam_2.exr");
    g_assert_cmpfloat(frame->captured_s, ==, 2 + 2 / 3.0);
    g_assert_cmpint(session_fixture_state(session, 3), ==, SHOT_DONE);
    g_assert_true(session_commit_shot(session, 5, SHOT_SKIPPED, NULL, 0, "lamp is broken", &error));
    g_assert_cmpint(session_fixture_state(session, 5), ==, SHOT_SKIPPED);
}

static void assert_commit_fails(Session *session, gint64 shot, const struct session_frame *frames,
                                int n, int code) {
    g_autoptr(GError) error = NULL;
    g_autoptr(GPtrArray) before = session_frames(session, NULL);

    g_assert_false(session_commit_shot(session, shot, SHOT_DONE, frames, n, NULL, &error));
    g_assert_error(error, SESSION_ERROR, code);
    g_autoptr(GPtrArray) after = session_frames(session, NULL);
    g_assert_cmpuint(after->len, ==, before->len);
}

/* Refused as a whole: neither state nor frames have changed. */
TEST(commit_refused) {
    g_autofree char *path = session_fixture_path("refuse");
    g_autoptr(Session) session = session_fixture_create(path, 1, 10);
    g_autoptr(GError) error = NULL;
    struct session_frame frames[2];

    g_assert_true(session_fixture_commit(session, 2, 2, NULL));
    frames[0] = session_fixture_frame(session, 4, 0);
    frames[1] = session_fixture_frame(session, 4, 1);
    struct session_frame twice[2] = {frames[0], frames[1]}, longer[2] = {frames[0], frames[1]};
    struct session_frame outside = frames[1], none = frames[1];
    twice[1].camera = 0;
    longer[1].bytes++;
    outside.path = (char *)"../000004_cam_1.exr";
    none.path = (char *)"frames/none.exr";
    assert_commit_fails(session, 4, twice, 2, SESSION_ERROR_FORMAT);
    assert_commit_fails(session, 4, longer, 2, SESSION_ERROR_IO);
    assert_commit_fails(session, 4, &outside, 1, SESSION_ERROR_IO);
    assert_commit_fails(session, 4, &none, 1, SESSION_ERROR_IO);
    assert_commit_fails(session, 5, frames, 2, SESSION_ERROR_IO);    /* of another shot */
    assert_commit_fails(session, 99, NULL, 0, SESSION_ERROR_FORMAT); /* not in the plan */
    g_assert_cmpint(session_fixture_state(session, 4), ==, SHOT_PLANNED);
    g_assert_true(session_commit_shot(session, 4, SHOT_DONE, frames, 2, NULL, &error));
    session_fixture_clear_frame(&frames[0]);
    session_fixture_clear_frame(&frames[1]);
}

static void assert_turned(Session *session, guint n, const double *deg) {
    g_autoptr(GError) error = NULL;
    g_autoptr(GPtrArray) rows = session_frames(session, &error);
    g_assert_no_error(error);
    g_assert_cmpuint(rows->len, ==, n);
    for (guint i = 0; i < n; i++) {
        const struct session_frame *row = rows->pdata[i];
        g_assert_cmpint(row->turned, ==, isfinite(deg[i]));
        g_assert_cmpfloat(row->turntable_deg, ==, row->turned ? deg[i] : 0);
    }
}

/* Where the table was, bit by bit; a later take, and one of another shot, replaces nothing else. */
TEST(turned) {
    g_autofree char *path = session_fixture_path("turned");
    g_autoptr(Session) session = session_fixture_create(path, 1, 40);
    g_autoptr(GError) error = NULL;
    for (int shot = 3; shot < 40; shot += 30) { /* 3, 33 */
        struct session_frame frames[2] = {session_fixture_frame(session, shot, 0),
                                          session_fixture_frame(session, shot, 1)};
        frames[0].turned = TRUE;
        frames[0].turntable_deg = shot / 3.0;
        g_assert_true(ok(session_commit_shot(session, shot, SHOT_DONE, frames, 2, NULL, ERR)));
        frames[0].turntable_deg = NAN;
        g_assert_false(session_commit_shot(session, shot, SHOT_DONE, frames, 2, NULL, &error));
        assert_error_clear(&error, SESSION_ERROR, SESSION_ERROR_IO);
        session_fixture_clear_frame(&frames[0]);
        session_fixture_clear_frame(&frames[1]);
    }
    assert_turned(session, 4, (double[]){1, NAN, 11, NAN});
    struct session_frame again = session_fixture_frame(session, 3, 1);
    again.turned = TRUE;
    again.turntable_deg = -0.1;
    g_assert_true(session_commit_shot(session, 3, SHOT_DONE, &again, 1, NULL, &error));
    assert_turned(session, 3, (double[]){-0.1, 11, NAN});
    session_fixture_clear_frame(&again);
    struct session_shot shot = {.turntable_deg = 30};
    g_assert_cmpfloat(session_frame_turntable_deg(&again, &shot), ==, -0.1);
    again.turned = FALSE;
    g_assert_cmpfloat(session_frame_turntable_deg(&again, &shot), ==, 30);

    g_assert_true(session_set_value(session, "turned/33/0", "north", &error));
    g_assert_null(session_frames(session, &error));
    assert_error_clear(&error, SESSION_ERROR, SESSION_ERROR_FORMAT);
}

TEST(modes) {
    g_autofree char *path = session_fixture_path("modes");
    g_autoptr(GError) error = NULL;
    int lost;

    session_close(session_fixture_create(path, 1, 3));
    g_autoptr(Session) reader = session_open(path, SESSION_READ, &error);
    g_autoptr(Session) maker = session_open(path, SESSION_PRODUCTS, &error);
    g_assert_no_error(error);
    g_assert_false(session_set_value(reader, "a", "b", &error));
    assert_error_clear(&error, SESSION_ERROR, SESSION_ERROR_IO);
    g_assert_false(session_add_event(reader, 0, "info", "x", "y", &error));
    g_clear_error(&error);
    g_assert_false(session_verify(maker, FALSE, &lost, &error));
    g_clear_error(&error);
    g_assert_false(session_commit_shot(maker, 1, SHOT_DONE, NULL, 0, NULL, &error));
    assert_error_clear(&error, SESSION_ERROR, SESSION_ERROR_IO);
    g_assert_true(session_set_value(maker, "a", "b", &error));
}

TEST(facts) {
    g_autofree char *path = session_fixture_path("facts");
    g_autoptr(Session) session = session_fixture_create(path, 1, 3);
    g_autoptr(GError) error = NULL;
    g_autofree char *rig = session_value(session, "rig_path");

    g_assert_cmpstr(rig, ==, "/etc/mesorig/rig.conf");
    g_assert_null(session_value(session, "state"));
    g_assert_true(session_set_value(session, "state", "running", &error));
    g_assert_true(session_set_value(session, "state", "done", &error));
    g_autofree char *value = session_value(session, "state");
    g_assert_cmpstr(value, ==, "done");
    g_assert_true(session_set_value(session, "state", NULL, &error));
    g_assert_null(session_value(session, "state"));
    g_assert_true(session_add_event(session, 1.5, "warning", "lamps", "dim\xff", &error));
    g_assert_true(session_add_event(session, NAN, "info", "x", "second", &error));
    g_autoptr(GPtrArray) events = session_events(session, &error);
    g_assert_cmpuint(events->len, ==, 2);
    const struct session_event *event = g_ptr_array_index(events, 0);
    g_assert_cmpfloat(event->time_s, ==, 1.5);
    g_assert_cmpstr(event->level, ==, "warning");
    g_assert_cmpstr(event->message, ==, "dim\xef\xbf\xbd");
    g_autofree char *file = session_file(session, "products/mdf.exr");
    g_assert_true(g_file_set_contents(file, "abc", 3, NULL));
    g_assert_true(session_add_product(session, "products/mdf.exr", "mesorig", &error));
    g_assert_true(ok(session_add_product(session, "products/mdf.exr", "mesorig again", ERR)));
    g_assert_false(session_add_product(session, "products/no.exr", "mesorig", &error));
    g_clear_error(&error);
    g_assert_false(session_add_product(session, "../x", "mesorig", &error));
    assert_error_clear(&error, SESSION_ERROR, SESSION_ERROR_IO);
    g_assert_null(session_text(session, "nothing", &error));
    g_assert_error(error, SESSION_ERROR, SESSION_ERROR_FORMAT);
}

TEST(verify) {
    g_autofree char *path = session_fixture_path("verify");
    g_autoptr(Session) session = session_fixture_create(path, 1, 10);
    g_autofree char *gone = session_file(session, "frames/000001_cam_0.exr");
    g_autofree char *shorter = session_file(session, "frames/000002_cam_1.exr");
    g_autofree char *changed = session_file(session, "frames/000003_cam_0.exr");
    g_autoptr(GError) error = NULL;
    int lost = -1;

    for (gint64 shot = 1; shot <= 5; shot++)
        g_assert_true(session_fixture_commit(session, shot, 2, NULL));
    g_assert_true(session_verify(session, TRUE, &lost, &error) && lost == 0);
    g_unlink(gone);
    g_assert_cmpint(truncate(shorter, 3), ==, 0);
    g_assert_true(g_file_set_contents(changed, "pixels 9 0", -1, NULL)); /* as long as before */
    g_assert_true(session_verify(session, FALSE, &lost, &error));
    g_assert_cmpint(lost, ==, 2);
    g_assert_cmpint(session_fixture_state(session, 1), ==, SHOT_PLANNED);
    g_assert_cmpint(session_fixture_state(session, 2), ==, SHOT_PLANNED);
    g_assert_cmpint(session_fixture_state(session, 3), ==, SHOT_DONE);
    g_assert_true(session_verify(session, TRUE, &lost, &error));
    g_assert_cmpint(lost, ==, 1);
    g_assert_cmpint(session_fixture_state(session, 3), ==, SHOT_PLANNED);
    g_autoptr(GPtrArray) frames = session_frames(session, &error);
    g_assert_cmpuint(frames->len, ==, 4);
    g_autoptr(GPtrArray) events = session_events(session, &error);
    g_assert_cmpuint(events->len, ==, 3);
    g_assert_nonnull(strstr(((struct session_event *)g_ptr_array_index(events, 0))->message,
                            "frames/000001_cam_0.exr is gone"));
}

TEST(lock) {
    g_autofree char *path = session_fixture_path("lock");
    g_autoptr(GError) error = NULL;
    int ready[2];
    char byte;
    pid_t child;

    session_close(session_fixture_create(path, 1, 3));
    g_assert_cmpint(pipe(ready), ==, 0);
    if ((child = fork()) == 0) {
        if (session_open(path, SESSION_CAPTURE, NULL))
            (void)!write(ready[1], "x", 1);
        for (;;)
            pause();
    }
    g_assert_cmpint(read(ready[0], &byte, 1), ==, 1);
    g_assert_null(session_open(path, SESSION_CAPTURE, &error));
    assert_error_clear(&error, SESSION_ERROR, SESSION_ERROR_LOCKED);
    g_autoptr(Session) reader = session_open(path, SESSION_READ, &error);
    g_assert_no_error(error);
    kill(child, SIGKILL);
    session_fixture_wait(child, SIGKILL);
    g_autoptr(Session) again = session_open(path, SESSION_CAPTURE, &error);
    g_assert_no_error(error);
    g_assert_nonnull(again);
    close(ready[0]);
    close(ready[1]);
}

/* One process commits two frames a shot, another counts: it never sees half a shot, nor fewer. */
TEST(concurrent) {
    g_autofree char *path = session_fixture_path("two");
    g_autoptr(GError) error = NULL;
    guint seen = 0, reads = 0;
    pid_t child;
    int status;

    session_close(session_fixture_create(path, 1, 200));
    if ((child = fork()) == 0) {
        Session *session = session_open(path, SESSION_CAPTURE, NULL);
        gboolean ok = session != NULL;

        for (gint64 shot = 1; ok && shot <= 200; shot++)
            ok = session_fixture_commit(session, shot, 2, NULL);
        session_close(session);
        _exit(ok ? 0 : 1);
    }
    g_autoptr(Session) reader = session_open(path, SESSION_PRODUCTS, &error);
    while (waitpid(child, &status, WNOHANG) == 0) {
        g_autoptr(GPtrArray) frames = session_frames(reader, &error);

        g_assert_no_error(error);
        g_assert_cmpuint(frames->len % 2, ==, 0);
        g_assert_cmpuint(frames->len, >=, seen);
        seen = frames->len;
        if (reads++ % 16 == 0)
            g_assert_true(session_add_event(reader, reads, "info", "reader", "I was here", &error));
        g_assert_no_error(error);
    }
    g_assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 0);
    seen = 0;
    g_ptr_array_unref(session_frames(reader, &error));
    g_assert_cmpuint(reads, >, 0);
}

TESTS_RUN_BY(session_fixture_run);
