/* The program that processes frames during and after a capture: it is found next to the daemon or
 * in PATH, runs with a low priority, is reported if it fails, and ends with the daemon in any case.
 * Scripts replace this program. */
#include "base/program.h"
#include "capture/followers.h"

#include <glib/gstdio.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>

#include "lib/beside.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "lib/wait.h"

static char *note_path(void) {
    return g_build_filename(beside_write("none", NULL), "note", NULL);
}

/* Waits until a script has written this line, and returns all that it has written; g_free(). */
static char *wait_for_note(const char *line) {
    g_autofree char *path = note_path();
    char *text = NULL;
    UNTIL (text &&strstr(text, line)) {
        g_main_context_iteration(NULL, FALSE);
        g_usleep(2000);
        g_clear_pointer(&text, g_free);
        g_file_get_contents(path, &text, NULL, NULL);
    }
    g_unlink(path);
    return text;
}

static int n_changes;
static char *failed_directory;

static void on_changed(gpointer data) {
    g_assert_true(data == &n_changes);
    n_changes++;
}

static void on_failed(const char *directory, gpointer data) {
    g_assert_true(data == &n_changes);
    g_assert_null(failed_directory);
    failed_directory = g_strdup(directory);
}

static Followers *new_followers(void) {
    n_changes = 0;
    g_clear_pointer(&failed_directory, g_free);
    return followers_new(on_changed, on_failed, &n_changes);
}

static void start(Followers *followers, const char *directory, const char *script) {
    g_autofree char *note = note_path();
    g_autofree char *text = g_strdup_printf("note='%s'\n%s", note, script);
    beside_write("mesorig", text);
    ok(followers_start(followers, directory, ERR));
}

/* Checks that exactly these sessions are processed: their directories with blanks between. */
static void assert_processed(const Followers *followers, const char *expected) {
    g_autofree const char **directories = followers_directories(followers);
    g_autofree char *found = g_strjoinv(" ", (char **)directories);
    g_assert_cmpstr(found, ==, expected);
}

static void refused(const char *words) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Followers) followers = new_followers();
    g_assert_false(followers_start(followers, "/a/small.session", &error));
    g_assert_nonnull(error);
    assert_has(error->message, words);
    assert_processed(followers, "");
}

TEST(find__subprocess) {
    g_autoptr(GError) error = NULL;
    g_assert_null(program_find("mesorig-none", &error));
    g_assert_error(error, G_FILE_ERROR, G_FILE_ERROR_NOENT);
    assert_has(error->message, "mesorig-none is neither in the folder of this program, nor in "
                               "../libexec/mesorig relative to it, nor in PATH");
    g_clear_error(&error);
    beside_write("mesorig", NULL);
    g_autofree char *all = g_strdup(g_getenv("PATH"));
    g_setenv("PATH", "/no/such/folder", TRUE);
    refused("mesorig is neither in the folder");
    g_setenv("PATH", all, TRUE);

    beside_write_in_path("mesorig", "exit 0");
    g_autofree char *in_path = ok(program_find("mesorig", ERR));
    g_assert_true(g_str_has_suffix(in_path, "/in-path/mesorig"));
    const char *folder = beside_write("mesorig", "exit 0");
    g_autofree char *beside = ok(program_find("mesorig", ERR));
    g_autofree char *expected = g_build_filename(folder, "mesorig", NULL);
    g_assert_cmpstr(beside, ==, expected);

    beside_write_raw("mesorig", "#!/no/such/interpreter");
    refused(expected);
}

TEST(end__subprocess) {
    g_autoptr(Followers) followers = new_followers();
    start(followers, "/a/small.session", "echo \"$$ $* at $(nice) done\" >\"$note\"");
    assert_processed(followers, "/a/small.session");
    g_assert_cmpint(n_changes, ==, 1);
    g_autofree char *note = wait_for_note("done");
    assert_has(note, "process /a/small.session --follow at ");
    g_assert_cmpint(atoi(strstr(note, " at ") + strlen(" at ")), >=, 10);
    UNTIL (n_changes == 2)
        g_main_context_iteration(NULL, FALSE);
    assert_processed(followers, "");
    g_assert_null(failed_directory);

    start(followers, "/a/small.session", "exit 3");
    UNTIL (n_changes == 4)
        g_main_context_iteration(NULL, FALSE);
    assert_processed(followers, "");
    g_assert_cmpstr(failed_directory, ==, "/a/small.session");
}

/* The processing of a session goes on while the next one is captured. A session that is captured
 * again is processed from its beginning. */
TEST(two__subprocess) {
    static const char waits[] = "echo $$ >\"$note\"; while ! [ -e \"$2/end\" ]; do sleep 0.1; done";
    g_autofree char *a = g_dir_make_tmp("mesorig-follow-XXXXXX", NULL);
    g_autofree char *b = g_dir_make_tmp("mesorig-follow-XXXXXX", NULL);
    g_autofree char *both = g_strdup_printf("%s %s", a, b), *end = g_build_filename(a, "end", NULL);
    g_autoptr(Followers) followers = new_followers();
    start(followers, a, waits);
    g_autofree char *first = wait_for_note("\n");
    start(followers, b, waits);
    g_autofree char *second = wait_for_note("\n");
    assert_processed(followers, both);
    g_assert_cmpint(kill(atoi(first), 0), ==, 0);
    start(followers, b, waits);
    g_autofree char *again = wait_for_note("\n");
    assert_processed(followers, both);
    g_assert_cmpint(kill(atoi(second), 0), !=, 0);
    g_assert_cmpint(n_changes, ==, 3);
    ok(g_file_set_contents(end, "", 0, ERR));
    UNTIL (n_changes == 4)
        g_main_context_iteration(NULL, FALSE);
    assert_processed(followers, b);
    g_assert_null(failed_directory);
    g_assert_cmpint(kill(atoi(again), 0), ==, 0);
    remove_tree(a);
    remove_tree(b);
}

/* Frees followers with a child that runs. It is gone then. Returns how long that took, in ms. */
static double free_running(const char *script) {
    Followers *followers = new_followers();
    start(followers, "/a/small.session", script);
    g_autofree char *note = wait_for_note("\n");
    const pid_t pid = atoi(note);
    g_assert_cmpint(pid, >, 0);
    g_assert_cmpint(kill(pid, 0), ==, 0);
    const gint64 begun_us = g_get_monotonic_time();
    followers_free(followers);
    const double ms = (double)(g_get_monotonic_time() - begun_us) * 1e-3;
    g_assert_cmpint(kill(pid, 0), !=, 0);
    wait_ms(20); /* its end is not reported */
    g_assert_cmpint(n_changes, ==, 1);
    return ms;
}

TEST(free__subprocess) {
    followers_free(NULL);
    free_running("trap 'echo obeyed >\"$note\"; exit' TERM\necho $$ >\"$note\"\n"
                 "while :; do sleep 0.1; done");
    g_free(wait_for_note("obeyed"));
    const double ignores_ms =
        free_running("trap '' TERM; echo $$ >\"$note\"; while :; do sleep 0.2; done");
    g_test_message("one that ignores SIGTERM ended after %.0f ms", ignores_ms);
    g_assert_cmpfloat(ignores_ms, >=, 2900);
}

static void test_copy(gconstpointer path) {
    g_free(beside_run(path));
}

BEFORE_TESTS {
    g_test_add_data_func("/followers/find", "/followers/find/subprocess", test_copy);
    g_test_add_data_func("/followers/end", "/followers/end/subprocess", test_copy);
    g_test_add_data_func("/followers/two", "/followers/two/subprocess", test_copy);
    g_test_add_data_func("/followers/free", "/followers/free/subprocess", test_copy);
}
