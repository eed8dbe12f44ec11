/* Another program takes the test shots of a session of the queue: how it is called, and what its
 * answers, its failures and its silence mean. Scripts replace this program. */
#include "bus/bus_trial.h"
#include "lib/ok.h"
#include "lib/wait.h"

#include <stdlib.h>
#include <string.h>

#include "lib/beside.h"
#include "lib/process.h"

#define ADDRESS "unix:path=/no/such/socket"
#define WAIT_US (120 * G_USEC_PER_SEC)

static struct answer { /* the last */
    int n;
    char *chosen, *said;
    enum bus_trial_end end;
} answer;

static void on_answer(const char *chosen, const char *said, enum bus_trial_end end, gpointer data) {
    g_free(answer.chosen);
    g_free(answer.said);
    answer = (struct answer){answer.n + 1, g_strdup(chosen), g_strdup(said), end};
}

static struct bus_trial *start(const char *address, const char *script, GError **error) {
    g_autoptr(QueueItem) item = queue_item_new();
    g_free(item->session_path);
    item->session_path = g_strdup("/a/small.conf");
    g_free(item->session_text);
    item->session_text = g_strdup("[session]\nname = small\n");
    item->yes = TRUE;
    beside_write("mesorig", script);
    return bus_trial_start(address, item, on_answer, NULL, error);
}

static void expect(const char *address, const char *script, enum bus_trial_end end,
                   const char *chosen, const char *said) {
    const int before = answer.n;
    const gint64 until = g_get_monotonic_time() + WAIT_US;
    struct bus_trial *trial = ok(start(address, script, ERR));
    while (answer.n == before) {
        g_assert_cmpint(g_get_monotonic_time(), <, until);
        g_main_context_iteration(NULL, TRUE);
    }
    bus_trial_free(trial);
    wait_ms(20);
    g_assert_cmpint(answer.n, ==, before + 1);
    g_test_message("%s: “%s”, “%s”", script, answer.chosen, answer.said);
    g_assert_cmpint(answer.end, ==, end);
    g_assert_cmpstr(answer.chosen, ==, chosen);
    if (said)
        g_assert_cmpstr(answer.said, ==, said);
}

static void test_answers_inside(void) {
    const char *no_message = "“mesorig queue try”, which takes the test shots, ended without a "
                             "message";
    /* It gets what cli/captures/queue_try.c reads. */
    expect(ADDRESS, "cat >&2; echo \"$*\" >&2; printf 'cam30 4000'", BUS_TRIAL_DONE, "cam30 4000",
           NULL);
    static const char *const asked[] = {"[try]",
                                        "session=/a/small.conf",
                                        "session_text=[session]\\nname = small\\n",
                                        "calibration=",
                                        "yes=true",
                                        "queue try --address " ADDRESS};
    for (gsize i = 0; i < G_N_ELEMENTS(asked); i++)
        assert_has(answer.said, asked[i]);
    /* These do not read it, and are heard all the same. The program's name before a line says
     * nothing here; empty lines neither. */
    expect(ADDRESS, "printf 'mesorig: one\\n\\nmesorig: two\\nthree\\n' >&2; exit 1",
           BUS_TRIAL_SESSION, "", "one\ntwo\nthree");
    expect(ADDRESS, "echo mesorig: the lamp is out >&2; exit 3", BUS_TRIAL_RIG, "",
           "the lamp is out");
    expect(ADDRESS, "exit 0", BUS_TRIAL_DONE, "", "");
    expect(ADDRESS, "exit 2", BUS_TRIAL_SESSION, "", no_message);
    expect(ADDRESS, "kill -9 $$", BUS_TRIAL_SESSION, "", no_message);
    expect(ADDRESS, "printf '\\377'", BUS_TRIAL_SESSION, "", NULL);
    assert_has(answer.said, "ended without a message: ");
}

/* On the system's bus, or the session's, it looks for the daemon there. */
static void test_bus_inside(void) {
    static const char *const names[] = {"system", "session"};
    for (gsize i = 0; i < G_N_ELEMENTS(names); i++) {
        g_autofree char *asked = g_strdup_printf("queue try --bus %s", names[i]);
        expect(names[i], "echo \"$*\" >&2", BUS_TRIAL_DONE, "", asked);
    }
}

static void test_none_inside(void) {
    g_autoptr(GError) error = NULL;
    g_setenv("PATH", "/no/such/folder", TRUE);
    g_assert_null(start(ADDRESS, NULL, &error));
    assert_has(error->message, "nor in ../libexec/mesorig relative to it, nor in PATH");
    g_clear_error(&error);
    beside_write_raw("mesorig", "#!/no/such/interpreter");
    g_autoptr(QueueItem) item = queue_item_new();
    g_assert_null(bus_trial_start(ADDRESS, item, on_answer, NULL, &error));
    g_assert_nonnull(error);
}

/* If the trial is freed while the program runs, the program is killed and its answer is ignored. */
static void test_free_inside(void) {
    const int before = answer.n;
    const char *folder = beside_write("none", NULL);
    g_autofree char *note = g_build_filename(folder, "note", NULL), *text = NULL;
    g_autofree char *script = g_strdup_printf("trap '' TERM; echo $$ >'%s'; exec sleep 600", note);
    struct bus_trial *trial = ok(start(ADDRESS, script, ERR));
    for (int i = 0; i < 4000 && (!text || !strchr(text, '\n')); i++) {
        g_clear_pointer(&text, g_free);
        wait_ms(5);
        g_file_get_contents(note, &text, NULL, NULL);
    }
    g_assert_nonnull(text);
    g_autofree char *process = g_strdup_printf("/proc/%d", atoi(text));
    g_assert_true(g_file_test(process, G_FILE_TEST_EXISTS));
    bus_trial_free(trial);
    bus_trial_free(NULL);
    for (int i = 0; i < 4000 && g_file_test(process, G_FILE_TEST_EXISTS); i++)
        wait_ms(5);
    g_assert_false(g_file_test(process, G_FILE_TEST_EXISTS));
    g_assert_cmpint(answer.n, ==, before);
}

static void test_copy(gconstpointer path) {
    g_free(beside_run(path));
}

#define ADD(name, func)                                                                            \
    g_test_add_data_func("/trial/" name, "/trial/" name "/subprocess", test_copy);                 \
    g_test_add_func("/trial/" name "/subprocess", func)

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    ADD("answers", test_answers_inside);
    ADD("bus", test_bus_inside);
    ADD("none", test_none_inside);
    ADD("free", test_free_inside);
    return g_test_run();
}
