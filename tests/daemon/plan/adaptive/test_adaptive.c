/* Sessions with [lasers] stop = covered and [lights] sampling = adaptive in the small simulated
 * rig: the session says what it left out, and after an abort, damage or a kill at any moment it
 * continues to the same result. */
#include "plan/adaptive/adaptive.h"
#include "plan/adaptive/expected.h"

#include <string.h>

#include "lib/capture_run.h"
#include "lib/capture_steps.h"
#include "lib/ok.h"
#include "lib/test.h"

static const struct change changes[] = {
    {"[lasers]", "rings = 30:4; 60:4"},
    {"[lasers]", "stop = covered"},
    {"[lasers]", "first = 2"},
    {"[lasers]", "gain_pct = 1"},
    {NULL, NULL},
};

/* 4 turntable angles; 32 shots of lamps, 8 of them in the first round. */
#define LAMPS                                                                                      \
    {"[views]", "rings = 30:4; 60:4"}, {"[lights]", "rings = 30:4; 60:4"},                         \
        {"[lights]", "sampling = adaptive"}, {                                                     \
        "[lights]", "first = 2"                                                                    \
    }
static const struct change lamps[] = {LAMPS, {"[lights]", "error_pct = 4"}, {NULL, NULL}};
static const struct change both[] = {LAMPS,
                                     {"[lights]", "error_pct = 4"},
                                     {"[lasers]", "stop = covered"},
                                     {"[lasers]", "first = 1"},
                                     {"[lasers]", "gain_pct = 1"},
                                     {NULL, NULL}};

struct outcome { /* what must be the same, however it came about */
    GString *text;
    int done, left_out, planned, rounds; /* sweeps */
    int lamps_done, lamps_left_out, lamp_rounds;
    double error_pct;
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
                            g_str_has_prefix(shot->note, SESSION_LEFT_OUT);
        outcome.lamps_done += shot->kind == SHOT_LAMP && shot->state == SHOT_DONE;
        outcome.lamps_left_out += shot->kind == SHOT_LAMP && shot->state == SHOT_SKIPPED &&
                                  shot->note && g_str_has_prefix(shot->note, SESSION_LEFT_OUT);
        g_string_append_printf(outcome.text, "%d %d %s\n", (int)shot->id, shot->state,
                               shot->state == SHOT_SKIPPED ? shot->note : "");
    }
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        g_string_append_printf(outcome.text, "%s %s\n", frame->path, frame->sha256);
    }
    g_autoptr(Session) session = session_open(path, SESSION_READ, &error);
    g_assert_no_error(error);
    g_autoptr(GHashTable) values = session_values(session, "l", &error);
    g_assert_no_error(error);
    g_autofree char **names = (char **)g_hash_table_get_keys_as_array(values, NULL);
    const guint n = g_hash_table_size(values);
    qsort(names, n, sizeof *names, outcome_by_name);
    for (guint i = 0; i < n; i++) {
        const char *value = g_hash_table_lookup(values, names[i]);
        if (!g_str_has_prefix(names[i], "lasers.") && !g_str_has_prefix(names[i], "lights."))
            continue;
        outcome.rounds += g_str_has_prefix(names[i], "lasers.round.");
        outcome.lamp_rounds += g_str_has_prefix(names[i], "lights.round.");
        if (g_str_equal(names[i], ADAPTIVE_ERROR_PCT))
            outcome.error_pct = g_ascii_strtod(value, NULL);
        g_string_append_printf(outcome.text, "%s=%s\n", names[i], value);
    }
    return outcome;
}

/* Captures a session that nothing happens to. ret_told: its events; g_free(). */
static struct outcome capture(const struct change *with, char **ret_told) {
    struct run *run = run_begin(with);
    run_to_end(run);
    run_check_whole(run->session);
    struct outcome outcome = outcome_of(run->session);
    *ret_told = g_strdup(run->told->str);
    run_free(run);
    return outcome;
}

/* The outcome of a session that nothing happens to and that tells said. It is captured once. */
static const struct outcome *undisturbed(const struct change *with, const char *said) {
    static struct {
        const struct change *with;
        struct outcome outcome;
        char *told;
    } known[8];
    gsize k = 0;
    while (known[k].with && known[k].with != with)
        g_assert_cmpuint(++k, <, G_N_ELEMENTS(known));
    if (!known[k].with) {
        known[k].outcome = capture(with, &known[k].told);
        known[k].with = with;
    }
    g_assert_nonnull(strstr(known[k].told, said));
    return &known[k].outcome;
}

#define COVERED "no further sweep is expected to add to that"

TEST(rounds) {
    const struct outcome *outcome = undisturbed(changes, COVERED);
    g_autofree char *told = NULL;
    g_test_message("%d sweeps taken, %d left out, %d rounds", outcome->done, outcome->left_out,
                   outcome->rounds);
    /* 2 turntable angles × 8 positions; 2 of each in the first round. */
    g_assert_cmpint(outcome->done + outcome->left_out, ==, 16);
    g_assert_cmpint(outcome->done, >=, 4);
    g_assert_cmpint(outcome->left_out, >, 0);
    g_assert_cmpint(outcome->planned, ==, 0);
    g_assert_cmpint(outcome->rounds, >=, 2); /* the last one is empty */
    struct outcome again = capture(changes, &told);
    g_assert_cmpstr(outcome->text->str, ==, again.text->str);
    outcome_clear(&again);
}

/* Aborts and resumes the session after this number of frames each time. */
static void check_resume(const struct change *with, const char *said, const int *every,
                         gsize n_every) {
    const struct outcome *expected = undisturbed(with, said);
    for (gsize k = 0; k < n_every; k++) {
        struct run *run = run_begin(with);
        int n = 0;
        while (run_until(run, every[k]) != CAPTURE_DONE) {
            capture_abort(run->capture);
            run_resume(run);
            g_assert_cmpint(++n, <, 400);
        }
        g_clear_pointer(&run->capture, capture_free);
        run_check_whole(run->session);
        struct outcome outcome = outcome_of(run->session);
        g_assert_cmpstr(outcome.text->str, ==, expected->text->str);
        outcome_clear(&outcome);
        run_free(run);
    }
}

TEST(resume) {
    static const int every[] = {60, 95, 150, 210};
    check_resume(changes, COVERED, every, G_N_ELEMENTS(every));
}

/* The flat matt sample is predicted to within the error asked for from a part of the pictures: more
 * than the first round, since that is sparse, and fewer than all. */
TEST(lamps) {
    const struct outcome *outcome = undisturbed(lamps, "error_pct = 4 asks for no more");
    g_test_message("%d shots taken, %d left out, %d rounds, %.2f %%", outcome->lamps_done,
                   outcome->lamps_left_out, outcome->lamp_rounds, outcome->error_pct);
    g_assert_cmpint(outcome->lamps_done + outcome->lamps_left_out, ==, 32);
    g_assert_cmpint(outcome->lamps_done, >, 8);
    g_assert_cmpint(outcome->lamps_left_out, >, 0);
    g_assert_cmpint(outcome->planned, ==, 0);
    g_assert_cmpint(outcome->lamp_rounds, >=, 3); /* the last one is empty */
    g_assert_cmpfloat(outcome->error_pct, <=, 4);
    g_assert_cmpfloat(outcome->error_pct, >, 0);
    g_assert_cmpint(outcome->rounds, ==, 0);
}

/* Lamps and sweeps in rounds together. Numbers of shots differ from those of a session in which the
 * sweeps do not come in rounds, and with them noise and what is chosen. */
TEST(both) {
    static const int every[] = {50, 121};
    const struct outcome *outcome = undisturbed(both, "error_pct = 4 asks for no more");
    g_assert_cmpint(outcome->lamps_done, >, 8);
    g_assert_cmpint(outcome->lamps_left_out, >, 0);
    g_assert_cmpint(outcome->lamp_rounds, >=, 3);
    g_assert_cmpint(outcome->rounds, >=, 2);
    check_resume(both, COVERED, every, G_N_ELEMENTS(every));
}

static void flip_a_bit(const struct run *run, const struct session_frame *frame) {
    g_autofree char *path = g_build_filename(run->session, frame->path, NULL), *bytes = NULL;
    gsize n = 0;
    g_assert_true(g_file_get_contents(path, &bytes, &n, NULL));
    bytes[n / 2] ^= 4;
    g_assert_true(g_file_set_contents(path, bytes, (gssize)n, NULL));
}

/* Returns a bit for each kind of shot that has a frame in the session. */
static int kinds_stored(const char *session) {
    g_autoptr(GPtrArray) shots = run_shots(session), frames = run_frames(session);
    int kinds = 0;
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        kinds |= 1 << ((const struct session_shot *)shots->pdata[frame->shot - 1])->kind;
    }
    return kinds;
}

/* Frames that are damaged, one of a lamp and one of a sweep: nothing is chosen without them,
 * however often the session is told to go on; resumed, it takes them again, and chooses as if
 * nothing had happened. */
TEST(damaged) {
    const struct outcome *expected = undisturbed(both, "error_pct = 4 asks for no more");
    struct run *run = run_begin(both);
    const int both_kinds = 1 << SHOT_LAMP | 1 << SHOT_SWEEP;
    for (gint64 n = 121; (kinds_stored(run->session) & both_kinds) != both_kinds; n++)
        g_assert_cmpint(run_until(run, n), <, CAPTURE_PAUSED);
    g_clear_pointer(&run->capture, capture_free);
    g_autoptr(GPtrArray) shots = run_shots(run->session), frames = run_frames(run->session);
    int flipped = 0;
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        const struct session_shot *shot = shots->pdata[frame->shot - 1];
        if (shot->kind != SHOT_DARK && !(flipped & 1 << shot->kind)) {
            flip_a_bit(run, frame);
            flipped |= 1 << shot->kind;
        }
    }
    g_assert_cmpint(flipped, ==, both_kinds);
    run_resume(run);
    for (int i = 0; i < 3; i++) {
        run_to_pause(run, "The next shots cannot be chosen");
        g_assert_nonnull(strstr(run_status(run).reason, "Abort the session, then resume it"));
        run_continue(run);
    }
    run_to_pause(run, "The next shots cannot be chosen");
    run_resume(run);
    run_to_end(run);
    run_check_whole(run->session);
    struct outcome outcome = outcome_of(run->session);
    g_assert_cmpstr(outcome.text->str, ==, expected->text->str);
    outcome_clear(&outcome);
    run_free(run);
}

/* An error that nothing reaches: all are taken, as they are with a budget that suffices for them. A
 * budget for little more than the first round ends it, and the lamps take no longer. */
TEST(lamp_bounds) {
    static const struct change all[] = {LAMPS, {"[lights]", "error_pct = 0"}, {NULL, NULL}};
    static const struct change budget[] = {
        LAMPS, {"[lights]", "error_pct = 0"}, {"[lights]", "budget_min = 0.6"}, {NULL, NULL}};
    const struct outcome *outcome = undisturbed(all, "no shot is left");
    g_assert_cmpint(outcome->lamps_done, ==, 32);
    g_assert_cmpfloat(outcome->error_pct, ==, 0);
    outcome = undisturbed(budget, "budget_min = 0.6 has no time for a further shot");
    g_test_message("%d shots in 0.6 min", outcome->lamps_done);
    g_assert_cmpint(outcome->lamps_done, >=, 8);
    g_assert_cmpint(outcome->lamps_done, <, 32);
}

/* With a bound that nothing reaches, the first round is all; with none, all may be taken, and with
 * the default everything is. */
TEST(bounds) {
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

/* What is made by a process of its own before a capture begins has the first rounds: the daemon's
 * main loop chooses none. */
TEST(first) {
    g_autoptr(GError) error = NULL;
    struct run *run = run_begin(both);
    g_autofree char *path = g_strconcat(run->session, ".second", NULL);
    g_assert_true(ok(capture_create(run->devices, &run->conf, path, ERR)));
    g_autoptr(Session) session = session_open(path, SESSION_READ, &error);
    g_assert_no_error(error);
    const char *const keys[] = {"lasers.round.1", "lights.round.1"};
    const guint expected[] = {4, 8}; /* 4 turntable angles: a sweep, two lamps */
    for (gsize k = 0; k < G_N_ELEMENTS(keys); k++) {
        g_autofree char *value = session_value(session, keys[k]);
        g_assert_nonnull(value);
        g_auto(GStrv) numbers = g_strsplit(value, " ", -1);
        g_assert_cmpuint(g_strv_length(numbers), ==, expected[k]);
    }
    run_free(run);
}

/* A value that names a shot that does not exist. */
TEST(values) {
    g_autoptr(GError) error = NULL;
    struct run *run = run_begin(changes);
    run_until(run, 20);
    capture_abort(run->capture);
    g_clear_pointer(&run->capture, capture_free);
    Session *session = ok(session_open(run->session, SESSION_CAPTURE, ERR));
    g_assert_true(session_set_value(session, "lasers.round.1", "3 4711", &error));
    session_close(session);
    g_assert_null(capture_resume(run->devices, run->session, NULL, &error));
    g_assert_nonnull(error);
    g_assert_nonnull(strstr(error->message, "4711"));
    run_free(run);
}

/* What is expected of a session, before it begins, of a material like that of an earlier one: more
 * shots take longer, and leave a smaller error. */
TEST(expected) {
    g_autoptr(GError) error = NULL;
    struct run *run = run_begin(lamps);
    run_to_end(run);
    g_autoptr(Plan) plan =
        plan_build(&run->conf, &run->devices->geometry, &run->devices->timing, &error);
    g_assert_no_error(error);
    const char *const likes[] = {run->session, NULL};
    for (gsize k = 0; k < G_N_ELEMENTS(likes); k++) {
        g_autoptr(GArray) points =
            expected_curve(&run->conf, &run->devices->geometry, &run->devices->timing, plan,
                           likes[k], NULL, &error);
        g_assert_no_error(error);
        g_assert_cmpint(points->len, >=, 2);
        const struct expected_point *p = (const struct expected_point *)(gpointer)points->data;
        for (guint i = 0; i < points->len; i++) {
            g_test_message("%d shots, %.1f s, %.2f %%", p[i].shots, p[i].time_s, p[i].error_pct);
            g_assert_cmpint(p[i].shots, <=, 16);
            g_assert_true(i == 0 || (p[i].shots > p[i - 1].shots && p[i].time_s > p[i - 1].time_s));
        }
        g_assert_cmpint(p[0].shots, ==, 8);
        g_assert_cmpfloat(p[points->len - 1].error_pct, <, p[0].error_pct);
        g_assert_cmpfloat(p[points->len - 1].error_pct, >, 0);
    }
    run_free(run);

    run = run_begin(lamps); /* nothing is taken yet */
    run_until(run, 1);
    capture_abort(run->capture);
    g_clear_pointer(&run->capture, capture_free);
    g_assert_null(expected_curve(&run->conf, &run->devices->geometry, &run->devices->timing, plan,
                                 run->session, NULL, &error));
    g_assert_nonnull(error);
    g_assert_nonnull(strstr(error->message, "the session has no picture under a lamp"));
    run_free(run);
}

TESTS_RUN_BY(run_tests);
