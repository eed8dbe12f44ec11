/* The program that processes frames during a capture: it is found next to the daemon or in PATH,
 * runs with a low priority, is reported if it fails, and ends with the capture in any case. Scripts
 * replace this program. */
#include "base/program.h"
#include "capture/follower.h"

#include <glib/gstdio.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>

#include "lib/beside.h"
#include "lib/ok.h"
#include "lib/process.h"
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

static Follower *start(const char *script) {
    g_autofree char *note = note_path();
    g_autofree char *text = g_strdup_printf("note='%s'\n%s", note, script);
    beside_write("mesorig", text);
    Follower *follower = ok(follower_start("/a/small.session", ERR));
    return follower;
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
    g_assert_null(follower_start("/a/small.session", &error));
    assert_has(error->message, "mesorig is neither in the folder");
    g_setenv("PATH", all, TRUE);
    g_clear_error(&error);

    beside_write_in_path("mesorig", "exit 0");
    g_autofree char *in_path = ok(program_find("mesorig", ERR));
    g_assert_true(g_str_has_suffix(in_path, "/in-path/mesorig"));
    const char *folder = beside_write("mesorig", "exit 0");
    g_autofree char *beside = ok(program_find("mesorig", ERR));
    g_autofree char *expected = g_build_filename(folder, "mesorig", NULL);
    g_assert_cmpstr(beside, ==, expected);

    beside_write_raw("mesorig", "#!/no/such/interpreter");
    g_assert_null(follower_start("/a/small.session", &error));
    g_assert_nonnull(error);
    assert_has(error->message, expected);
}

/* Waits until the process has ended and the follower has heard of it. */
static void wait_for_end(pid_t pid) {
    UNTIL (kill(pid, 0) != 0)
        wait_ms(5);
    wait_ms(200); /* the process is reaped before the main loop calls the follower */
}

TEST(end__subprocess) {
    follower_free(NULL);
    Follower *follower = start("echo \"$$ $* at $(nice) done\" >\"$note\"");
    g_autofree char *note = wait_for_note("done");
    assert_has(note, "process /a/small.session --follow at ");
    g_assert_cmpint(atoi(strstr(note, " at ") + strlen(" at ")), >=, 10);
    wait_for_end(atoi(note));
    follower_free(follower);
    g_printerr("one has succeeded\n");

    follower = start("echo \"$$ done\" >\"$note\"; exit 3");
    g_autofree char *failed = wait_for_note("done");
    wait_for_end(atoi(failed));
    follower_free(follower);
    g_printerr("one has failed\n");
}

/* Frees a follower that runs. It is gone then. Returns how long that took, in ms. */
static double free_running(const char *script) {
    Follower *follower = start(script);
    g_autofree char *note = wait_for_note("\n");
    const pid_t pid = atoi(note);
    g_assert_cmpint(pid, >, 0);
    g_assert_cmpint(kill(pid, 0), ==, 0);
    const gint64 begun_us = g_get_monotonic_time();
    follower_free(follower);
    const double ms = (double)(g_get_monotonic_time() - begun_us) * 1e-3;
    g_assert_cmpint(kill(pid, 0), !=, 0);
    wait_ms(20); /* its end is not reported */
    return ms;
}

TEST(free__subprocess) {
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

/* Of two programs that end, only the one that fails is reported. */
TEST(end) {
    static const char told[] = "processing during the capture has failed: run `mesorig process`";
    g_autofree char *said = beside_run("/follower/end/subprocess");
    const char *at = strstr(said, told);
    g_assert_nonnull(at);
    g_assert_true(g_strrstr(said, told) == at);
    g_assert_nonnull(strstr(at, "one has failed"));
    g_assert_null(strstr(at, "one has succeeded"));
}

BEFORE_TESTS {
    g_test_add_data_func("/follower/find", "/follower/find/subprocess", test_copy);
    g_test_add_data_func("/follower/free", "/follower/free/subprocess", test_copy);
}
