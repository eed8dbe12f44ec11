/*
 * The daemon is killed with SIGKILL at random moments of a small session and resumed, until it was
 * killed forty times; the products are bit for bit those of an undisturbed run.
 *
 * MESORIG_KILLS sets another number. The same with sweeps in rounds, until the surface is known:
 * the rounds, what they leave out, and all frames are those of an undisturbed run, after five kills
 * or MESORIG_ADAPTIVE_KILLS.
 */
#include <gio/gio.h>
#include <glib/gstdio.h>
#include <sqlite3.h>

#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>

#include "lib/ok.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/small_rig.h"
#include "lib/test.h"
#include "session/session.h"

#define RIG     SOURCE_DIR "/tests/small/rig.conf"
#define SESSION SOURCE_DIR "/tests/small/session.conf"
#define MESORIG BUILD_DIR "/bin/mesorig"

static const char *const products[] = {"products/mdf.exr", "products/eigenmaps.exr",
                                       "products/btf/view_0000.exr"};

static GPid spawn(const char *const *argv, const char *mark) {
    g_auto(GStrv) environment = g_environ_setenv(g_get_environ(), "MESORIG_TEST_MARK", mark, TRUE);
    GPid pid = 0;
    ok(g_spawn_async(NULL, (char **)argv, environment,
                     G_SPAWN_DO_NOT_REAP_CHILD | G_SPAWN_STDOUT_TO_DEV_NULL |
                         G_SPAWN_STDERR_TO_DEV_NULL,
                     NULL, NULL, &pid, ERR));
    return pid;
}

/* Client and daemon, whatever groups and sessions they have put themselves into. */
static void kill_all(const char *mark) {
    g_autofree char *word = g_strconcat("MESORIG_TEST_MARK=", mark, NULL);
    g_autoptr(GArray) pids = process_find("environ", word);
    for (guint i = 0; i < pids->len; i++)
        kill(g_array_index(pids, pid_t, i), SIGKILL);
}

/* Waits until it ends or a deadline; TRUE if it ended by itself, with success. */
static gboolean wait_until(GPid pid, gint64 deadline_us, gboolean *ret_ended) {
    int status = 0;
    *ret_ended = FALSE;
    while (g_get_monotonic_time() < deadline_us) {
        if (waitpid(pid, &status, WNOHANG) == pid) {
            *ret_ended = TRUE;
            return WIFEXITED(status) && WEXITSTATUS(status) == 0;
        }
        g_usleep(2000);
    }
    return FALSE;
}

static void run_whole(const char *const *argv, const char *mark) {
    gboolean ended = FALSE;
    GPid pid = spawn(argv, mark);
    const gboolean ok = wait_until(pid, g_get_monotonic_time() + 240 * G_USEC_PER_SEC, &ended);
    if (!ended) {
        kill_all(mark);
        waitpid(pid, NULL, 0);
    }
    if (!ok)
        g_test_message("failed: %s %s", argv[0], argv[1]);
    g_assert_true(ok);
}

static char *checksum(const char *session, const char *product) {
    g_autofree char *path = g_build_filename(session, product, NULL);
    g_autofree char *data = NULL;
    gsize length = 0;
    ok(g_file_get_contents(path, &data, &length, ERR));
    return g_compute_checksum_for_data(G_CHECKSUM_SHA256, (guint8 *)data, length);
}

static int files_of(const char *session) {
    int n = 0;
    for (int i = 0; i < 2; i++) {
        g_autofree char *path = g_build_filename(session, i ? "laser" : "frames", NULL);
        g_autoptr(GDir) dir = g_dir_open(path, 0, NULL);
        while (dir && g_dir_read_name(dir))
            n++;
    }
    return n;
}

/* Shots that are done and that are still to be taken. */
static void count_shots(const char *path, int *ret_done, int *ret_planned) {
    g_autoptr(Session) session = session_open(path, SESSION_READ, NULL);
    g_autoptr(GPtrArray) shots = session ? session_shots(session, NULL) : NULL;
    *ret_done = *ret_planned = 0;
    for (guint i = 0; shots && i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        *ret_done += shot->state == SHOT_DONE;
        *ret_planned += shot->state == SHOT_PLANNED;
    }
}

/* Waits for a random number of files, and a moment more; how long a start takes differs too much
 * from machine to machine for times only to hit what is between. */
static gboolean wait_for_moment(GPid pid, const char *session, GRand *random, gboolean *ret_ended) {
    const int wanted = files_of(session) + g_rand_int_range(random, -2, 12);
    const gint64 latest = g_get_monotonic_time() + 240 * G_USEC_PER_SEC;
    int status = 0;
    *ret_ended = FALSE;
    while (files_of(session) < wanted && g_get_monotonic_time() < latest) {
        if (waitpid(pid, &status, WNOHANG) == pid) {
            *ret_ended = TRUE;
            return WIFEXITED(status) && WEXITSTATUS(status) == 0;
        }
        g_usleep(500);
    }
    const double moment_s = g_rand_double(random) * (wanted <= 0 ? 0.1 : 0.005);
    return wait_until(pid, g_get_monotonic_time() + (gint64)(moment_s * 1e6), ret_ended);
}

/* One session, killed at random moments until it is done or enough were killed. Adds to *ret_amid
 * the kills that came between the first shot and the last. */
static int capture_with_kills(const char *conf, const char *session, int most, GRand *random,
                              int *ret_amid) {
    const char *const capture[] = {MESORIG, "capture", RIG, conf, "-o", session, NULL};
    const char *const resume[] = {MESORIG, "resume", session, NULL};
    g_autofree char *database = g_build_filename(session, "session.db", NULL);
    for (int kills = 0;; kills++) {
        const gboolean begun = g_file_test(database, G_FILE_TEST_EXISTS);
        g_autofree char *mark = g_strdup_printf("%s-%d", session, kills);
        GPid pid = spawn(begun ? resume : capture, mark);
        gboolean ended = FALSE;
        int done, planned;
        const gboolean ok =
            kills < most ? wait_for_moment(pid, session, random, &ended)
                         : wait_until(pid, g_get_monotonic_time() + 240 * G_USEC_PER_SEC, &ended);
        if (ended) {
            g_assert_true(ok);
            return kills;
        }
        g_assert_cmpint(kills, <, most);
        kill_all(mark);
        waitpid(pid, NULL, 0);
        count_shots(session, &done, &planned);
        *ret_amid += done > 0 && planned > 0;
    }
}

/* Makes the products of a session, which must be those of the reference. */
static void process_as(const char *session, const char *reference) {
    run_whole((const char *[]){MESORIG, "process", session, NULL}, "process");
    for (gsize i = 0; i < G_N_ELEMENTS(products); i++) {
        g_autofree char *expected = checksum(reference, products[i]);
        g_autofree char *found = checksum(session, products[i]);
        g_assert_cmpstr(found, ==, expected);
    }
}

TEST(products_are_bit_identical) {
    const char *asked = g_getenv("MESORIG_KILLS");
    const int wanted = asked ? atoi(asked) : 40;
    g_autoptr(GRand) random = g_rand_new_with_seed(20);
    g_autofree char *folder = ok(g_dir_make_tmp("mesorig-kill-XXXXXX", ERR));
    g_autofree char *reference = g_build_filename(folder, "reference.session", NULL);

    const char *const capture[] = {MESORIG, "capture", RIG, SESSION, "-o", reference, NULL};
    run_whole(capture, "reference");
    run_whole((const char *[]){MESORIG, "process", reference, NULL}, "reference");

    int kills = 0, amid = 0;
    for (int run = 0; kills < wanted; run++) {
        g_autofree char *session = g_strdup_printf("%s/run%d.session", folder, run);
        kills += capture_with_kills(SESSION, session, wanted - kills, random, &amid);
        process_as(session, reference);
        remove_tree(session);
    }
    g_test_message("%d kills, %d between first and last shot", kills, amid);
    g_assert_cmpint(amid, >=, wanted / 4);
    remove_tree(folder);
}

/* Every shot's state and note, every frame's checksum, and the values of the rounds. */
static char *content_of(const char *path) {
    static const char *const queries[] = {
        "SELECT id || ' ' || state || ' ' || coalesce(note, '') FROM shot ORDER BY id",
        "SELECT path || ' ' || sha256 FROM frame ORDER BY path",
        "SELECT key || '=' || value FROM value WHERE key LIKE 'lasers.%' OR key LIKE 'lights.%' "
        "ORDER BY key"};
    g_autofree char *file = g_build_filename(path, "session.db", NULL);
    GString *text = g_string_new(NULL);
    sqlite3 *db = NULL;
    g_assert_cmpint(sqlite3_open_v2(file, &db, SQLITE_OPEN_READONLY, NULL), ==, SQLITE_OK);
    for (gsize i = 0; i < G_N_ELEMENTS(queries); i++) {
        sqlite3_stmt *rows = NULL;
        g_assert_cmpint(sqlite3_prepare_v2(db, queries[i], -1, &rows, NULL), ==, SQLITE_OK);
        while (sqlite3_step(rows) == SQLITE_ROW)
            g_string_append_printf(text, "%s\n", (const char *)sqlite3_column_text(rows, 0));
        sqlite3_finalize(rows);
    }
    sqlite3_close(db);
    return g_string_free(text, FALSE);
}

TEST(adaptive) {
    static const struct change changes[] = {
        {"[lasers]", "rings = 30:4; 60:4"},  {"[lasers]", "stop = covered"},
        {"[lasers]", "first = 2"},           {"[lasers]", "gain_pct = 1"},
        {"[lights]", "sampling = adaptive"}, {"[lights]", "first = 1"},
        {"[lights]", "error_pct = 8"},       {NULL, NULL}};
    g_autofree char *folder = ok(g_dir_make_tmp("mesorig-kill-XXXXXX", ERR));
    g_autofree char *reference = g_build_filename(folder, "reference.session", NULL);
    g_autofree char *conf = g_build_filename(folder, "session.conf", NULL);
    small_rig_write(folder, "session.conf", changes);
    run_whole((const char *[]){MESORIG, "capture", RIG, conf, "-o", reference, NULL}, "reference");
    g_autofree char *expected = content_of(reference);
    g_assert_nonnull(strstr(expected, "lasers.round.2="));
    g_assert_nonnull(strstr(expected, "lights.round.2="));
    g_assert_nonnull(strstr(expected, " skipped "));

    const char *asked = g_getenv("MESORIG_ADAPTIVE_KILLS");
    const int wanted = asked ? atoi(asked) : 5;
    g_autoptr(GRand) random = g_rand_new_with_seed(21);
    int kills = 0, amid = 0, runs = 0;
    for (; kills < wanted; runs++) {
        g_autofree char *session = g_strdup_printf("%s/run%d.session", folder, runs);
        kills += capture_with_kills(conf, session, wanted - kills, random, &amid);
        g_autofree char *content = content_of(session);
        g_assert_cmpstr(content, ==, expected);
        remove_tree(session);
    }
    g_test_message("%d kills in %d sessions, %d between first and last shot", kills, runs, amid);
    g_assert_cmpint(amid, >=, wanted / 2);
    remove_tree(folder);
}
