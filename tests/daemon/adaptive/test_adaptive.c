/* Sessions with [lasers] stop = covered in the small simulated rig: what is left out is said, and a
 * session that is aborted, damaged or killed anywhere goes on to the same one. */
#include "adaptive/adaptive.h"

#include <string.h>

#include "lib/capture_run.h"

static const struct change changes[] = {
    {"[lasers]", "rings = 30:4; 60:4"},
    {"[lasers]", "stop = covered"},
    {"[lasers]", "first = 2"},
    {"[lasers]", "gain_pct = 1"},
    {NULL, NULL},
};

struct outcome { /* what must be the same, however it came about */
    GString *text;
    int done, left_out, planned, rounds;
};

static void outcome_clear(struct outcome *outcome) {
    g_string_free(outcome->text, TRUE);
}

static int outcome_by_name(gconstpointer a, gconstpointer b) {
    return strcmp(*(char *const *)a, *(char *const *)b);
}

/* Shots with their states and notes, rounds, and the checksums of all frames. */
static struct outcome outcome_of(const char *path) {
    struct outcome outcome = {.text = g_string_new(NULL)};
    g_autoptr(GError) error = NULL;
    g_autoptr(GPtrArray) shots = run_shots(path), frames = run_frames(path);
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        const gboolean sweep = shot->kind == SHOT_SWEEP;
        outcome.done += sweep && shot->state == SHOT_DONE;
        outcome.planned += shot->state == SHOT_PLANNED;
        outcome.left_out += sweep && shot->state == SHOT_SKIPPED && shot->note &&
                            g_str_has_prefix(shot->note, ADAPTIVE_LEFT_OUT);
        g_string_append_printf(outcome.text, "%d %d %s\n", (int)shot->id, shot->state,
                               shot->state == SHOT_SKIPPED ? shot->note : "");
    }
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        g_string_append_printf(outcome.text, "%s %s\n", frame->path, frame->sha256);
    }
    g_autoptr(Session) session = session_open(path, SESSION_READ, &error);
    g_assert_no_error(error);
    g_autoptr(GHashTable) values = session_values(session, "lasers.", &error);
    g_assert_no_error(error);
    g_autofree char **names = (char **)g_hash_table_get_keys_as_array(values, NULL);
    const guint n = g_hash_table_size(values);
    qsort(names, n, sizeof *names, outcome_by_name);
    for (guint i = 0; i < n; i++) {
        outcome.rounds += g_str_has_prefix(names[i], "lasers.round.");
        g_string_append_printf(outcome.text, "%s=%s\n", names[i],
                               (const char *)g_hash_table_lookup(values, names[i]));
    }
    return outcome;
}

static struct outcome undisturbed(void) {
    struct run *run = run_begin(changes);
    run_to_end(run);
    run_check_whole(run->session);
    struct outcome outcome = outcome_of(run->session);
    g_assert_nonnull(strstr(run->told->str, "no further sweep is expected to add to that"));
    run_free(run);
    return outcome;
}

static void test_rounds(void) {
    struct outcome outcome = undisturbed();
    g_test_message("%d sweeps taken, %d left out, %d rounds", outcome.done, outcome.left_out,
                   outcome.rounds);
    /* 2 turntable angles × 8 positions; 2 of each in the first round. */
    g_assert_cmpint(outcome.done + outcome.left_out, ==, 16);
    g_assert_cmpint(outcome.done, >=, 4);
    g_assert_cmpint(outcome.left_out, >, 0);
    g_assert_cmpint(outcome.planned, ==, 0);
    g_assert_cmpint(outcome.rounds, >=, 2); /* the last one is empty */
    struct outcome again = undisturbed();
    g_assert_cmpstr(outcome.text->str, ==, again.text->str);
    outcome_clear(&outcome);
    outcome_clear(&again);
}

/* Aborted and resumed after so many frames each time. */
static void test_resume(void) {
    static const int every[] = {60, 95, 150, 210};
    struct outcome expected = undisturbed();
    for (gsize k = 0; k < G_N_ELEMENTS(every); k++) {
        struct run *run = run_begin(changes);
        int n = 0;
        while (run_until(run, every[k]) != CAPTURE_DONE) {
            capture_abort(run->capture);
            run_resume(run);
            g_assert_cmpint(++n, <, 400);
        }
        g_clear_pointer(&run->capture, capture_free);
        run_check_whole(run->session);
        struct outcome outcome = outcome_of(run->session);
        g_assert_cmpstr(outcome.text->str, ==, expected.text->str);
        outcome_clear(&outcome);
        run_free(run);
    }
    outcome_clear(&expected);
}

/* With a bound that nothing reaches, the first round is all; with none, all may be taken, and with
 * the default everything is. */
static void test_bounds(void) {
    static const struct change none[] = {{"[lasers]", "rings = 30:4; 60:4"},
                                         {"[lasers]", "stop = covered"},
                                         {"[lasers]", "first = 2"},
                                         {"[lasers]", "gain_pct = 100"},
                                         {NULL, NULL}};
    static const struct change all[] = {{"[lasers]", "rings = 30:4; 60:4"}, {NULL, NULL}};
    const struct change *const cases[] = {none, all};
    static const int done[] = {4, 16};
    for (gsize k = 0; k < G_N_ELEMENTS(cases); k++) {
        struct run *run = run_begin(cases[k]);
        run_to_end(run);
        struct outcome outcome = outcome_of(run->session);
        g_assert_cmpint(outcome.done, ==, done[k]);
        g_assert_cmpint(outcome.rounds, ==, k == 0 ? 2 : 0);
        outcome_clear(&outcome);
        run_free(run);
    }
}

/* A value that names a shot that there is not. */
static void test_values(void) {
    g_autoptr(GError) error = NULL;
    struct run *run = run_begin(changes);
    run_until(run, 20);
    capture_abort(run->capture);
    g_clear_pointer(&run->capture, capture_free);
    Session *session = session_open(run->session, SESSION_CAPTURE, &error);
    g_assert_no_error(error);
    g_assert_true(session_set_value(session, "lasers.round.1", "3 4711", &error));
    session_close(session);
    g_assert_null(capture_resume(run->devices, run->session, NULL, &error));
    g_assert_nonnull(error);
    g_assert_nonnull(strstr(error->message, "4711"));
    run_free(run);
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/adaptive/rounds", test_rounds);
    g_test_add_func("/adaptive/resume", test_resume);
    g_test_add_func("/adaptive/bounds", test_bounds);
    g_test_add_func("/adaptive/values", test_values);
    return run_tests();
}
