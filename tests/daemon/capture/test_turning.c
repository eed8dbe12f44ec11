/* Sessions with [capture] motion = continuous in the small simulated rig: the contents and metadata
 * of their frames, and the time of a session. Pauses, faults and kills must not change the frames.
 */
#include "capture/capture.h"

#include <math.h>
#include <string.h>

#include "exr/exr.h"
#include "lib/capture_run.h"
#include "lib/capture_steps.h"
#include "lib/test.h"
#include "pipeline/pipeline.h"
#include "plan/adaptive/adaptive.h"
#include "world/truth.h"

/* 8 angles of the turntable and of the arc, two lamps that are slow to warm up: 16 passes of 8
 * shots. */
#define DIRECTIONS                                                                                 \
    {"[views]", "rings = 30:8; 60:8"}, {"[lights]", "rings = 30:8; 60:8"},                         \
        {"[lights]", "offset_deg = 22.5"}, {"[world]", "warm_up_s = 2"}, {                         \
        "[capture]", "exposures_us = 4000"                                                         \
    }
#define TURNING                                                                                    \
    DIRECTIONS, {                                                                                  \
        "[capture]", "motion = continuous"                                                         \
    }
static const struct change standing[] = {DIRECTIONS, {NULL, NULL}};
static const struct change turning[] = {TURNING, {NULL, NULL}};

/* Checksums and angles of all frames, and what the session keeps of shots. */
static char *text_of(const char *path) {
    GString *text = g_string_new(NULL);
    g_autoptr(GPtrArray) shots = run_shots(path), frames = run_frames(path);
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        g_assert_cmpint(shot->state, !=, SHOT_PLANNED);
        g_string_append_printf(text, "%d %d %s\n", (int)shot->id, shot->state,
                               shot->state == SHOT_SKIPPED ? shot->note : "");
    }
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        g_string_append_printf(text, "%s %s %.17g\n", frame->path, frame->sha256,
                               frame->turned ? frame->turntable_deg : NAN);
    }
    return g_string_free(text, FALSE);
}

/* The text of the session turning if nothing happens to it. The session is captured once. */
static const char *undisturbed(void) {
    static char *known;
    if (known)
        return known;
    struct run *run = run_begin(turning);
    run_to_end(run);
    run_check_whole(run->session);
    known = text_of(run->session);
    run_free(run);
    return known;
}

static double clock_of(const char *path) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(path, SESSION_READ, &error);
    g_assert_no_error(error);
    g_autofree char *clock = session_value(session, "clock_s");
    return g_ascii_strtod(clock, NULL);
}

/* It takes as long as was planned, and less than with the table standing; the frames say where the
 * table was, and nothing else of them is another. */
TEST(undisturbed) {
    struct run *still = run_begin(standing), *run = run_begin(turning);
    g_autoptr(GError) error = NULL;
    int n_turned = 0, n_passes = 0;
    g_autoptr(Plan) plan =
        plan_build(&run->conf, &run->devices->geometry, &run->devices->timing, &error);
    g_assert_no_error(error);
    run_to_end(still);
    run_to_end(run);
    run_check_whole(run->session);
    const double still_s = clock_of(still->session), run_s = clock_of(run->session);
    g_test_message("%.1f s, planned %.1f s, standing %.1f s, bound %.1f s", run_s,
                   plan->predicted_s, still_s, plan->lower_bound_s);
    g_assert_cmpfloat_with_epsilon(run_s / plan->predicted_s, 1, 0.01);
    g_assert_cmpfloat_with_epsilon(still_s / plan->standing_s, 1, 0.01);
    g_assert_cmpfloat(run_s, <, 0.75 * still_s);
    g_assert_cmpfloat(plan->lower_bound_s, <=, plan->predicted_s);
    n_passes = plan->n_passes;
    g_assert_cmpint(n_passes, ==, 16);
    g_autoptr(GPtrArray) shots = run_shots(run->session), frames = run_frames(run->session);
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        const struct session_shot *shot = shots->pdata[frame->shot - 1];
        g_autofree char *path = g_build_filename(run->session, frame->path, NULL);
        struct exr_file *file = exr_read_headers(path, &error);
        double deg, speed = 0;
        g_assert_no_error(error);
        const struct exr_part *part = file->parts->pdata[0];
        g_assert_true(exr_get_double(part, "mesorig.turntable_deg", &deg, NULL));
        exr_get_double(part, "mesorig.turning_deg_s", &speed, NULL);
        exr_file_free(file);
        g_assert_cmpfloat(deg, ==, session_frame_turntable_deg(frame, shot));
        g_assert_cmpfloat(speed, ==, frame->turned ? plan->passes.deg_s : 0);
        g_assert_cmpfloat_with_epsilon(deg, shot->turntable_deg, 1e-3);
        g_assert_true(!frame->turned || shot->kind == SHOT_LAMP);
        n_turned += frame->turned;
    }
    g_assert_cmpint(n_turned, ==, 2 * plan->n_passing);
    g_assert_cmpint(n_turned, >=, 200);
    run_free(run);
    run_free(still);
}

static void compare_text(struct run *run, const char *expected) {
    run_check_whole(run->session);
    g_autofree char *text = text_of(run->session);
    g_assert_cmpstr(text, ==, expected);
}

/* Aborts and resumes the session after this number of frames each time. expected is the text of
 * the session if nothing happens to it. */
static void check_resume(const struct change *with, const char *expected, const int *every,
                         gsize n_every) {
    for (gsize k = 0; k < n_every; k++) {
        struct run *run = run_begin(with);
        int n = 0;
        while (run_until(run, every[k]) != CAPTURE_DONE) {
            capture_abort(run->capture);
            run_check_safe(run);
            run_resume(run);
            g_assert_cmpint(++n, <, 400);
        }
        g_assert_cmpint(n, >, 0);
        g_clear_pointer(&run->capture, capture_free);
        compare_text(run, expected);
        run_free(run);
    }
}

TEST(resume) {
    static const int every[] = {83, 190};
    check_resume(turning, undisturbed(), every, G_N_ELEMENTS(every));
}

/* Rounds of lamps, each with passes of its own, and of sweeps. */
TEST(rounds) {
    static const struct change rounds[] = {TURNING,
                                           {"[lights]", "sampling = adaptive"},
                                           {"[lights]", "first = 1"},
                                           {"[lights]", "error_pct = 1"},
                                           {"[lights]", "budget_min = 1.2"},
                                           {"[lasers]", "stop = covered"},
                                           {NULL, NULL}};
    static const int every[] = {141};
    struct run *run = run_begin(rounds);
    int n_turned = 0, n_taken = 0, n_left_out = 0;
    run_to_end(run);
    run_check_whole(run->session);
    g_autofree char *expected = text_of(run->session);
    g_autoptr(GPtrArray) shots = run_shots(run->session), frames = run_frames(run->session);
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        n_taken += shot->kind == SHOT_LAMP && shot->state == SHOT_DONE;
        n_left_out += shot->kind == SHOT_LAMP && shot->state == SHOT_SKIPPED;
    }
    for (guint i = 0; i < frames->len; i++)
        n_turned += ((const struct session_frame *)frames->pdata[i])->turned;
    g_test_message("%d shots taken, %d left out, %d frames of %s", n_taken, n_left_out, n_turned,
                   "passes");
    g_assert_cmpint(n_left_out, >, 0);
    g_assert_cmpint(n_turned, >, 0);
    run_free(run);
    check_resume(rounds, expected, every, G_N_ELEMENTS(every));
}

/* A pause does not wait for the end of a turn. */
TEST(pause) {
    const char *expected = undisturbed();
    struct run *run = run_begin(turning);
    int n = 0, moving = 0;
    for (gint64 frames = 35; run_until(run, frames) != CAPTURE_DONE; frames += 37) {
        const double before_s = run_status(run).elapsed_s;
        moving += axis_is_moving(run->devices->turntable);
        capture_pause(run->capture);
        if (run_until(run, 0) == CAPTURE_DONE) /* it was the last shot */
            break;
        run_to_pause(run, "by the user");
        g_assert_cmpfloat(run_status(run).elapsed_s - before_s, <, 5);
        g_assert_null(strstr(run->told->str, "error"));
        run_check_safe(run);
        run_continue(run);
        g_assert_cmpint(++n, <, 30);
    }
    g_assert_cmpint(n, >=, 3);
    g_assert_cmpint(moving, >=, 1);
    g_clear_pointer(&run->capture, capture_free);
    compare_text(run, expected);
    run_free(run);
}

/* Frames that are lost, or old ones again: another turn takes them, and they are the same. */
TEST(lost_frames) {
    static const struct change lost[] = {TURNING, {"[camera cam30]", "fault_lost = 0.1"}, {0}};
    static const struct change stale[] = {TURNING,
                                          {"[camera cam60]", "fault_stale = 0.1"},
                                          {"[camera cam60]", "fault_seed = 3"},
                                          {0}};
    static const struct change gone[] = {
        TURNING, {"[camera cam60]", "fault_disconnect_after = 40"}, {0}};
    const struct change *const all[] = {lost, stale, gone};
    const char *expected = undisturbed();
    for (gsize i = 0; i < G_N_ELEMENTS(all); i++) {
        struct run *run = run_begin(all[i]);
        g_assert_cmpint(run_until(run, 0), ==, CAPTURE_DONE);
        g_assert_nonnull(strstr(run->told->str, "frame taken again"));
        g_clear_pointer(&run->capture, capture_free);
        compare_text(run, expected);
        run_free(run);
    }
}

/* Of the simulated world. */
static double table_deg(const struct run *run) {
    g_autofree char *path = g_build_filename(run->directory, "world.conf", NULL);
    g_autoptr(World) world = world_get(path, NULL);
    struct world_state state;
    world_snapshot(world, clock_now_us(run->devices->clock), 1, &state);
    return state.turntable_deg;
}

/* The turntable stalls during a turn: everything stops, and then the session continues. */
TEST(stall) {
    const char *expected = undisturbed();
    for (int at = 2; at < 8; at++) {
        g_autofree char *line = g_strdup_printf("fault_stall_at = %d", at);
        const struct change stall[] = {TURNING, {"[axis turntable]", line}, {0}};
        struct run *run = run_begin(stall);
        run_to_pause(run, "axis turntable: stalled");
        run_check_safe(run);
        const double stalled_deg = table_deg(run);
        run_pass_time(run, 1);
        g_assert_cmpfloat(table_deg(run), ==, stalled_deg);
        run_continue(run);
        run_to_end(run);
        compare_text(run, expected);
        run_free(run);
    }
}

/* What is saturated is taken again in another turn, with a quarter of the exposure. */
TEST(saturated) {
    static const struct change bright[] = {TURNING, {"[capture]", "exposures_us = 60000"}, {0}};
    static const int every[] = {83};
    struct run *run = run_begin(bright);
    g_assert_cmpint(run_until(run, 0), ==, CAPTURE_DONE);
    g_assert_nonnull(strstr(run->told->str, "saturated at 60000"));
    g_clear_pointer(&run->capture, capture_free);
    run_check_whole(run->session);
    g_autofree char *expected = text_of(run->session);
    g_autoptr(GPtrArray) frames = run_frames(run->session);
    int shortened = 0, turned = 0;
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        g_autofree char *path = g_build_filename(run->session, frame->path, NULL);
        const char *exposures = NULL;
        struct exr_file *file = exr_read_headers(path, NULL);
        const struct exr_part *part = file->parts->pdata[0];
        g_assert_true(exr_get_string(part, "mesorig.exposures_us", &exposures, NULL));
        shortened += frame->turned && g_str_equal(exposures, "15000");
        turned += frame->turned;
        exr_file_free(file);
    }
    g_assert_cmpint(turned, >, 0);
    g_assert_cmpint(shortened, >, 0);
    run_free(run);
    check_resume(bright, expected, every, 1);
}

/* An axis that does not report its position cannot capture while it turns. */
TEST(refused) {
    static const struct change silent[] = {TURNING, {"[axis turntable]", "report_ms = 0"}, {0}};
    g_autoptr(GError) error = NULL;
    struct run *run = run_new(silent);
    g_assert_null(capture_start(run->devices, &run->conf, run->session, NULL, &error));
    g_assert_error(error, PLAN_ERROR, PLAN_ERROR_LIMITS);
    g_assert_nonnull(strstr(error->message, "[capture] motion: continuous: the driver of"));
    run_free(run);
}

TESTS_RUN_BY(run_tests);
