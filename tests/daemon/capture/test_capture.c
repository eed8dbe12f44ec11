/* Sessions of the small simulated rig, captured, paused, killed and resumed. */
#include <glib/gstdio.h>
#include <math.h>
#include <signal.h>
#include <string.h>
#include <sys/resource.h>

#include "calibration/calibration.h"
#include "capture/exposure_advice.h"
#include "exr/exr.h"
#include "lib/capture_run.h"
#include "lib/capture_steps.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/test.h"

/* What a folder takes on disk, in blocks of 4 KiB. */
static gint64 disk_bytes(const char *path) {
    GStatBuf info;
    gint64 sum = 0;
    g_assert_cmpint(g_lstat(path, &info), ==, 0);
    if (!S_ISDIR(info.st_mode))
        return (info.st_size + 4095) / 4096 * 4096;
    g_autoptr(GDir) dir = g_dir_open(path, 0, NULL);
    for (const char *name; (name = g_dir_read_name(dir));) {
        g_autofree char *child = g_build_filename(path, name, NULL);
        sum += disk_bytes(child);
    }
    return sum;
}

/* The plan says what a session takes on disk. */
TEST(disk_space) {
    static const struct change plain[] = {{0}},
                               lasers[] = {{"[capture]", "keep_laser_frames = yes"},
                                           {"[capture]", "laser_short_us = 250"},
                                           {0}},
                               exposures[] = {{"[capture]", "keep_exposures = yes"},
                                              {"[capture]", "exposures_us = 1000; 4000; 16000"},
                                              {0}};
    const struct change *const all[] = {plain, lasers, exposures};
    for (gsize i = 0; i < G_N_ELEMENTS(all); i++) {
        struct run *run = run_new(all[i]);
        struct plan *plan = ok(capture_validate(run->devices, &run->conf, run->session, ERR));
        run_start(run);
        run_to_end(run);
        const double is = (double)disk_bytes(run->session), said = (double)plan->bytes;
        g_test_message("takes %.0f bytes on disk, predicted %.0f: %+.2f %%", is, said,
                       100 * (said / is - 1));
        g_assert_cmpfloat(fabs(said / is - 1), <, 0.05);
        plan_free(plan);
        run_free(run);
    }
}

/* Larger pictures are compressed. The plan knows what is lit in them, not what it looks like: with
 * a line that hardly a pixel sees, what it takes lies within the range that the plan tells. The
 * capture knows by its frames. */
static void compressed_space(const char *threshold, const char *exposure, gboolean seen) {
    const struct change steps[] = {
        {"[capture]", "sweep_steps = 64"}, {"[capture]", threshold}, {"[capture]", exposure}, {0}};
    static const struct change larger[] = {
        {"[sample]", "kind = weave"},          {"[camera cam30]", "width = 320"},
        {"[camera cam30]", "height = 288"},    {"[camera cam30]", "focal_px = 2600"},
        {"[camera cam60]", "width = 640"},     {"[camera cam60]", "height = 400"},
        {"[camera cam60]", "focal_px = 4000"}, {0}};
    g_autoptr(GError) error = NULL;
    struct run *run = run_new(steps);
    run_change_rig(run, larger);
    g_autoptr(Plan) plan = capture_validate(run->devices, &run->conf, run->session, &error);
    g_assert_no_error(error);
    run_start(run);
    g_assert_cmpuint(run_status(run).bytes_stored, ==, 0);
    g_assert_cmpuint(run_status(run).bytes_expected, ==, plan->bytes);
    g_assert_cmpint(run_until(run, 0), ==, CAPTURE_DONE);
    const struct capture_status status = run_status(run);
    capture_free(g_steal_pointer(&run->capture)); /* the database is whole then */
    const double is = (double)disk_bytes(run->session);
    const double said = (double)plan->bytes;
    const double told = (double)status.bytes_expected;
    g_test_message("takes %.0f bytes on disk, predicted %.0f: %+.2f %%, told %+.2f %%", is, said,
                   100 * (said / is - 1), 100 * (told / is - 1));
    if (seen)
        g_assert_cmpfloat(fabs(said / is - 1), <, 0.05);
    else
        g_assert_cmpfloat(said / is - 1, >, 0.25);
    g_assert_cmpfloat((double)plan->bytes_least, <, is);
    g_assert_cmpfloat(fabs(told / is - 1), <, 0.01);
    g_assert_cmpuint(status.bytes_stored, >, 0);
    g_assert_cmpuint(status.bytes_stored, <, status.bytes_expected);
    g_assert_cmpfloat((double)plan->bytes_least, <, 0.8 * (double)plan->bytes);
    run_free(run);
}

TEST(compressed_space) {
    compressed_space("laser_threshold_dn = 40", "laser_exposure_us = 4000", TRUE);
}

TEST(unseen_space) {
    compressed_space("laser_threshold_dn = 4000", "laser_exposure_us = 100", FALSE);
}

/* Sessions of different shapes: time and disk space within 5 % of the plan's, and the time left
 * within a quarter of what it was, from a tenth of the time to 19 twentieths of it. */
TEST(predictions) {
    static const struct change small[] = {{0}}, lasers[] = {{"[lights]", NULL}, {0}},
                               lights[] = {{"[lasers]", NULL}, {0}},
                               one_view[] = {{"[views]", "rings = 30:1"},
                                             {"[lights]", "rings = 30:12; 60:12"},
                                             {"[lasers]", NULL},
                                             {0}},
                               views[] = {{"[capture]", "order = views"}, {0}},
                               longer[] = {{"[capture]", "exposures_us = 4000; 900000"}, {0}};
    const struct change *const all[] = {small, lasers, lights, one_view, views, longer};
    for (gsize i = 0; i < G_N_ELEMENTS(all); i++) {
        g_autoptr(GError) error = NULL;
        g_autoptr(GArray) seen = g_array_new(FALSE, FALSE, sizeof(struct capture_status));
        struct run *run = run_new(all[i]);
        g_autoptr(Plan) plan = capture_validate(run->devices, &run->conf, run->session, &error);
        g_assert_no_error(error);
        run_start(run);
        struct capture_status status = run_status(run);
        while (status.state != CAPTURE_DONE) {
            g_main_context_iteration(NULL, TRUE);
            status = run_status(run);
            g_array_append_val(seen, status);
        }
        const double total_s = status.elapsed_s;
        double worst = 0;
        int n = 0;
        for (guint k = 0; k < seen->len; k++) {
            const struct capture_status *at = &g_array_index(seen, struct capture_status, k);
            if (at->elapsed_s < 0.1 * total_s || at->elapsed_s > 0.95 * total_s)
                continue;
            worst = MAX(worst, fabs(at->left_s / (total_s - at->elapsed_s) - 1));
            n++;
        }
        capture_free(g_steal_pointer(&run->capture)); /* the database is whole then */
        const double bytes = (double)disk_bytes(run->session);
        g_test_message("%.1f s, predicted %+.2f %%; disk %+.2f %%; left %.1f %% at worst of %d",
                       total_s, 100 * (plan->predicted_s / total_s - 1),
                       100 * ((double)plan->bytes / bytes - 1), 100 * worst, n);
        g_assert_cmpfloat(fabs(plan->predicted_s / total_s - 1), <, 0.05);
        g_assert_cmpfloat(fabs((double)plan->bytes / bytes - 1), <, 0.05);
        g_assert_cmpint(n, >, 20);
        g_assert_cmpfloat(worst, <, 0.25);
        run_free(run);
    }
}

/* Cameras that take longer than they say: the time left learns it from the shots taken. */
TEST(left_learns) {
    static const struct change changes[] = {{"[camera cam30]", "fault_slow_ms = 400"},
                                            {"[camera cam60]", "fault_slow_ms = 400"},
                                            {"[lasers]", "rings = 30:3; 60:3"},
                                            {0}};
    g_autoptr(GArray) seen = g_array_new(FALSE, FALSE, sizeof(struct capture_status));
    struct run *run = run_begin(changes);
    struct capture_status status = run_status(run);
    const double predicted_s = status.predicted_s;
    while (status.state != CAPTURE_DONE) {
        g_main_context_iteration(NULL, TRUE);
        status = run_status(run);
        g_array_append_val(seen, status);
    }
    const double total_s = status.elapsed_s;
    double worst = 0;
    for (guint k = 0; k < seen->len; k++) {
        const struct capture_status *at = &g_array_index(seen, struct capture_status, k);
        if (at->elapsed_s > 0.6 * total_s && at->elapsed_s < 0.9 * total_s)
            worst = MAX(worst, fabs(at->left_s / (total_s - at->elapsed_s) - 1));
    }
    g_test_message("predicted %.1f s, took %.1f s; left %.1f %% at worst", predicted_s, total_s,
                   100 * worst);
    g_assert_cmpfloat(total_s, >, 1.5 * predicted_s);
    g_assert_cmpfloat(worst, <, 0.25);
    run_free(run);
}

/* All is taken, in the time that the plan says. */
static void run_as_planned(struct run *run) {
    struct plan *plan = ok(capture_validate(run->devices, &run->conf, run->session, ERR));
    run_start(run);
    while (run_status(run).state == CAPTURE_HOMING)
        g_main_context_iteration(NULL, TRUE);
    /* Homed: both axes stand at 0. */
    double predicted_s = run_status(run).elapsed_s + run_status(run).left_s;
    g_assert_cmpfloat(fabs(predicted_s / plan->predicted_s - 1), <, 0.005);
    g_assert_cmpint(run_until(run, 0), ==, CAPTURE_DONE);
    struct capture_status status = run_status(run);
    g_assert_cmpint(status.shots, ==, plan->session.n_shots);
    g_assert_cmpint(status.shots_done, ==, status.shots);
    g_assert_cmpint(status.frames, ==, plan->n_frames);
    g_assert_cmpint(status.retakes, ==, 0);
    g_assert_cmpfloat(status.left_s, ==, 0);
    double took_s = status.elapsed_s;
    g_test_message("took %.2f s, predicted %.2f s, lower bound %.2f s", took_s, predicted_s,
                   plan->lower_bound_s);
    g_assert_cmpfloat(fabs(took_s / predicted_s - 1), <, 0.02);
    g_assert_cmpfloat(took_s, >=, plan->lower_bound_s * (1 - 1e-6));
    plan_free(plan);
}

TEST(whole) {
    struct run *run = run_new(NULL);
    run_as_planned(run);
    g_assert_cmpint(run->least_gap_us, >=, 95000);
    const struct capture_thumbnail *thumbnail = capture_thumbnail(run->capture, 1);
    g_assert_nonnull(thumbnail);
    g_assert_cmpint(thumbnail->width, ==, 16);
    g_assert_null(capture_thumbnail(run->capture, 2));
    run_check_safe(run);
    g_clear_pointer(&run->capture, capture_free);
    run_check_whole(run->session);
    run_check_same(run);
    run_free(run);
}

static struct exr_part *radiance_of(const char *path, const struct session_shot *shot) {
    g_autofree char *relative = session_frame_path(shot, "cam30");
    g_autofree char *file = g_build_filename(path, relative, NULL);
    struct exr_part *part = ok(exr_read_part(file, "radiance", ERR));
    return part;
}

/* The picture under each lamp is what the lamp's distance and angle say, within the sample's. */
TEST(radiance) {
    g_autoptr(GPtrArray) shots = run_shots(run_undisturbed());
    double mean[2] = {0};
    int n[2] = {0};
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        if (shot->kind != SHOT_LAMP || !camera_set_has(shot->cameras, 0))
            continue;
        struct exr_part *part = radiance_of(run_undisturbed(), shot);
        mean[shot->device] += exr_part_plane(part, "Y")[16 * 32 + 16];
        n[shot->device]++;
        exr_part_free(part);
    }
    g_assert_cmpint(n[0], >, 0);
    g_assert_cmpint(n[1], >, 0);
    /* A matt sample at the aim of both lamps: cos 30° to cos 60°. */
    double ratio = mean[0] / n[0] / (mean[1] / n[1]);
    g_assert_cmpfloat_with_epsilon(ratio, sqrt(3), 0.1);
}

TEST(pause) {
    struct run *run = run_new(NULL);
    g_autoptr(GError) error = NULL;
    run_start(run);
    g_assert_false(capture_continue(run->capture, &error));
    g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_BUSY);
    capture_pause(run->capture); /* before anything moved */
    run_to_pause(run, "by the user");
    for (gint64 frames = 5; frames < 60; frames += 9) {
        run_continue(run);
        run_until(run, frames);
        int before = run_status(run).shots_done;
        capture_pause(run->capture);
        run_to_pause(run, "by the user");
        g_assert_cmpint(run_status(run).shots_done, >=, before);
        g_assert_null(strstr(run->told->str, "error"));
        run_check_safe(run);
    }
    run_continue(run);
    run_finish(run);
}

/* What is left in a pause contains that the axes are homed again, and so does what is left from the
 * first moment after it, also in another process: it is as long as that takes. */
TEST(left_after_pause) {
    for (int resumed = 0; resumed < 2; resumed++) {
        struct run *run = run_begin(NULL);
        /* Threads that work slowly on a loaded computer cost no simulated time. */
        clock_set_lockstep(run->devices->clock);
        run_until(run, 40);
        if (resumed) {
            capture_abort(run->capture);
        } else {
            capture_pause(run->capture);
            run_to_pause(run, "by the user");
        }
        const struct capture_status rests = run_status(run);
        g_assert_cmpint(rests.shots_done, >, 0);
        g_assert_cmpfloat(rests.left_s, <, rests.predicted_s);
        if (resumed)
            run_resume(run);
        else
            run_continue(run);
        const struct capture_status begins = run_status(run);
        g_assert_cmpint(begins.state, ==, CAPTURE_HOMING);
        g_assert_cmpfloat_with_epsilon(begins.left_s, rests.left_s, 1e-6);
        gboolean named = FALSE;
        while (run_status(run).state == CAPTURE_HOMING) {
            named |= strstr(run_status(run).doing, "homing turntable") != NULL;
            g_main_context_iteration(NULL, FALSE);
        }
        g_assert_true(named);
        run_until(run, 0);
        const double took_s = run_status(run).elapsed_s - rests.elapsed_s;
        g_test_message("%.2f s left, took %.2f s", rests.left_s, took_s);
        g_assert_cmpfloat_with_epsilon(rests.left_s / took_s, 1, 0.05);

        g_autoptr(GError) error = NULL;
        g_autoptr(Session) session = session_open(run->session, SESSION_READ, &error);
        g_assert_no_error(error);
        g_autoptr(GPtrArray) events = session_events(session, &error);
        int homed = 0;
        for (guint i = 0; i < events->len; i++) {
            const struct session_event *event = events->pdata[i];
            if (!g_str_equal(event->message, SESSION_EVENT_HOMED))
                continue;
            homed++;
            g_assert_true(homed == 1 || event->time_s > rests.elapsed_s);
            g_assert_true(homed == 2 || event->time_s < rests.elapsed_s);
        }
        g_assert_cmpint(homed, ==, 2);
        run_free(run);
    }
}

TEST(abort) {
    struct run *run = run_new(NULL);
    g_autoptr(GError) error = NULL;
    run_start(run);
    run_until(run, 25);
    capture_abort(run->capture);
    g_assert_cmpint(run_status(run).state, ==, CAPTURE_ABORTED);
    run_check_safe(run);
    g_assert_false(capture_continue(run->capture, &error));
    g_assert_nonnull(strstr(error->message, "resume"));
    run_resume(run);
    run_to_end(run);
    run_check_same(run);
    run_resume(run); /* of what is done already */
    g_assert_cmpint(run_until(run, 0), ==, CAPTURE_DONE);
    g_assert_cmpint(run_status(run).frames, ==, 0);
    run_free(run);
}

/* Killed at any moment: a new process finds what was committed and takes the rest. What it takes
 * first is stored at the same time, when the lasers are checked: the dark frames and a sweep of
 * each laser, 64 frames here. It comes that far again and again only if some lives are longer. */
/* Checks a session that was ended as good enough: it is done, every planned shot is either stored
 * or left out, and nothing is left for a resume. */
static void check_finished(struct run *run, int least_done) {
    g_autoptr(GPtrArray) shots = run_shots(run->session);
    int done = 0, left_out = 0;
    run_check_whole(run->session);
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        g_assert_cmpint(shot->state, !=, SHOT_PLANNED);
        done += shot->state == SHOT_DONE;
        if (shot->state != SHOT_SKIPPED)
            continue;
        g_assert_true(g_str_has_prefix(shot->note, SESSION_LEFT_OUT));
        left_out++;
    }
    g_test_message("%d shots done, %d left out", done, left_out);
    g_assert_cmpint(done, >=, least_done);
    g_assert_cmpint(left_out, >, 0);
    assert_has(run->told->str, "ended as good enough");
    run_resume(run);
    g_assert_cmpint(run_until(run, 0), ==, CAPTURE_DONE);
    run_free(run);
}

/* A capture ends early, with everything stored: while it runs, while it is paused, before its first
 * shot, and after the daemon was killed in the middle of leaving shots out. */
TEST(finish) {
    for (int way = 0; way < 4; way++) {
        g_autoptr(GError) error = NULL;
        struct run *run = run_begin(NULL);
        if (way != 2)
            run_until(run, 30);
        if (way == 1) {
            capture_pause(run->capture);
            run_to_pause(run, "by the user");
        }
        const int before = run_status(run).shots_done;
        if (way == 3) {
            capture_abort(run->capture);
            g_assert_false(capture_finish(run->capture, &error));
            g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_BUSY);
            g_clear_pointer(&run->capture, capture_free);
            g_autoptr(Session) session = ok(session_open(run->session, SESSION_CAPTURE, ERR));
            g_autoptr(GPtrArray) shots = ok(session_shots(session, ERR));
            const struct session_shot *last = shots->pdata[shots->len - 1];
            ok(session_set_value(session, CAPTURE_FINISHED_KEY, SESSION_LEFT_OUT " x", ERR));
            ok(session_commit_shot(session, last->id, SHOT_SKIPPED, NULL, 0, SESSION_LEFT_OUT " x",
                                   ERR));
            g_clear_pointer(&session, session_close);
            run_resume(run);
        } else {
            ok(capture_finish(run->capture, ERR));
        }
        g_assert_cmpint(run_until(run, 0), ==, CAPTURE_DONE);
        g_clear_error(&error);
        g_assert_false(capture_finish(run->capture, &error));
        run_check_safe(run);
        run_to_end(run);
        check_finished(run, before);
    }
}

TEST(resume) {
    struct run *run = run_begin(NULL);
    gint64 frames = g_test_rand_int_range(1, 20);
    while (run_until(run, frames) < CAPTURE_PAUSED) {
        for (int i = g_test_rand_int_range(0, 30); i > 0; i--)
            g_main_context_iteration(NULL, FALSE);
        double before_s = run_status(run).elapsed_s;
        int done = run_status(run).shots_done;
        g_clear_pointer(&run->capture, capture_free);
        devices_close(run->devices);
        run_open_devices(run);
        run_resume(run);
        g_assert_cmpint(run_status(run).shots_done, ==, done);
        g_assert_cmpfloat_with_epsilon(run_status(run).elapsed_s, before_s, 1e-3);
        frames = g_test_rand_int_range(5, 120);
    }
    g_assert_cmpint(run_status(run).state, ==, CAPTURE_DONE);
    g_clear_pointer(&run->capture, capture_free);
    run_check_whole(run->session);
    run_check_same(run);
    run_free(run);
}

/* A frame's file that is gone is taken again; a dark frame's that cannot be read as well. */
TEST(lost_files) {
    struct run *run = run_begin(NULL);
    run_to_end(run);
    g_autoptr(GPtrArray) frames = run_frames(run->session);
    const struct session_frame *dark = frames->pdata[0], *last = frames->pdata[frames->len - 1];
    g_autofree char *gone = g_build_filename(run->session, last->path, NULL);
    g_autofree char *spoilt = g_build_filename(run->session, dark->path, NULL);
    g_assert_cmpint(g_remove(gone), ==, 0);
    g_autofree char *zeros = g_malloc0((gsize)dark->bytes);
    g_assert_true(g_file_set_contents(spoilt, zeros, dark->bytes, NULL));
    run_resume(run);
    g_assert_cmpint(run_status(run).shots_done, ==, run_status(run).shots - 2);
    run_finish(run);
}

TEST(locked) {
    struct run *run = run_new(NULL);
    g_autoptr(GError) error = NULL;
    run_start(run);
    run_until(run, 10);
    g_assert_null(capture_resume(run->devices, run->session, NULL, &error));
    g_assert_error(error, SESSION_ERROR, SESSION_ERROR_LOCKED);
    g_clear_error(&error);
    g_assert_null(capture_start(run->devices, &run->conf, run->session, NULL, &error));
    g_assert_error(error, SESSION_ERROR, SESSION_ERROR_EXISTS);
    run_finish(run);
}

/* The same from another process. */
TEST(locked_elsewhere) {
    struct run *run = run_begin(NULL);
    run_until(run, 10);
    const char *const argv[] = {"/proc/self/exe", "--resume", run->directory, NULL};
    g_autofree char *out = NULL;
    g_assert_cmpint(process_run(argv, &out, NULL), ==, 1);
    g_assert_nonnull(strstr(out, "locked"));
    run_free(run);
}

static int resume_in_child(const char *directory) {
    g_autofree char *rig = g_build_filename(directory, "rig.conf", NULL);
    g_autofree char *session = g_build_filename(directory, "small.session", NULL);
    g_autoptr(GError) error = NULL;
    struct devices *devices = devices_open(rig, &error);
    Capture *capture = devices ? capture_resume(devices, session, NULL, &error) : NULL;
    gboolean locked = g_error_matches(error, SESSION_ERROR, SESSION_ERROR_LOCKED);
    g_print("%s\n", locked ? "locked" : error ? error->message : "taken");
    capture_free(capture);
    devices_close(devices);
    return capture ? 0 : 1;
}

TEST(other_rig) {
    struct run *run = run_new(NULL);
    g_autoptr(GError) error = NULL;
    run_start(run);
    run_until(run, 10);
    g_clear_pointer(&run->capture, capture_free);
    run_change_rig(run, (const struct change[]){{"[rig]", "id = another"}, {0}});
    g_assert_null(capture_resume(run->devices, run->session, NULL, &error));
    g_assert_nonnull(strstr(error->message, "another"));
    g_assert_nonnull(strstr(error->message, "small"));
    g_clear_error(&error);
    run_change_rig(run, (const struct change[]){{"[camera cam60]", "width = 64"}, {0}});
    g_assert_null(capture_resume(run->devices, run->session, NULL, &error));
    g_assert_nonnull(strstr(error->message, "cam60"));
    run_change_rig(run, (const struct change[]){{"[camera cam30]", "distance_mm = 651"}, {0}});
    run_resume(run);
    g_assert_nonnull(strstr(run->told->str, "geometry"));
    run_free(run);
}

TEST(refused) {
    struct run *run = run_new(NULL);
    g_autoptr(GError) error = NULL;
    run->conf.exposures_us[1] = 70e6; /* more than any camera can */
    g_assert_null(capture_validate(run->devices, &run->conf, run->session, &error));
    g_assert_error(error, PLAN_ERROR, PLAN_ERROR_LIMITS);
    g_assert_false(g_file_test(run->session, G_FILE_TEST_EXISTS));
    g_clear_error(&error);
    g_assert_null(capture_resume(run->devices, run->session, NULL, &error));
    g_assert_nonnull(error);
    run_free(run);
}

/* A process may write no file beyond a kilobyte: no frame's file can be written, nor the database
 * much. */
TEST(disk_full) {
    struct run *run = run_new(NULL);
    struct rlimit before, none;
    run_start(run);
    run_until(run, 20);
    capture_pause(run->capture); /* so that it is a frame that does not fit first */
    run_to_pause(run, "by the user");
    run_continue(run);
    signal(SIGXFSZ, SIG_IGN);
    g_assert_cmpint(getrlimit(RLIMIT_FSIZE, &before), ==, 0);
    none = (struct rlimit){.rlim_cur = 1000, .rlim_max = before.rlim_max};
    g_assert_cmpint(setrlimit(RLIMIT_FSIZE, &none), ==, 0);
    g_assert_cmpint(run_until(run, 0), ==, CAPTURE_PAUSED);
    g_assert_cmpint(setrlimit(RLIMIT_FSIZE, &before), ==, 0);
    g_assert_nonnull(strstr(run_status(run).reason, "disk is full"));
    run_check_safe(run);
    run_continue(run);
    run_finish(run);
}

/* One frame of each sweep is among those that are kept on request, with this exposure. Returns how
 * many sweeps there are. */
static int check_laser_frames(struct run *run, const char *name, double exposure_us) {
    g_autoptr(GPtrArray) frames = run_frames(run->session);
    g_autoptr(GError) error = NULL;
    int n = 0;
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        if (!g_str_has_prefix(frame->path, "laser/"))
            continue;
        g_autofree char *stem = g_strndup(frame->path, strlen(frame->path) - 4);
        g_autofree char *file = g_build_filename(run->session, stem, name, NULL);
        struct exr_part *part = exr_read_part(file, "frame", &error);
        double us = 0;
        g_assert_no_error(error);
        g_assert_true(exr_get_double(part, "mesorig.exposure_us", &us, NULL));
        g_assert_cmpfloat(us, ==, exposure_us);
        exr_part_free(part);
        n++;
    }
    return n;
}

/* Frames of a sweep are kept on request; the frames' pixels are those the analysis is made of. */
TEST(keep_laser_frames) {
    struct run *run =
        run_begin((const struct change[]){{"[capture]", "keep_laser_frames = yes"}, {0}});
    run_to_end(run);
    run_check_same(run);
    g_assert_cmpint(check_laser_frames(run, "0011.exr", 4000), >, 0);
    run_free(run);
}

/* Two frames at each step of a sweep; the time is predicted as it comes. */
TEST(short_laser) {
    struct run *run = run_new((const struct change[]){
        {"[capture]", "keep_laser_frames = yes"}, {"[capture]", "laser_short_us = 250"}, {0}});
    run_as_planned(run);
    g_clear_pointer(&run->capture, capture_free);
    run_check_whole(run->session);
    g_assert_cmpint(check_laser_frames(run, "0011.exr", 4000), >, 0);
    g_assert_cmpint(check_laser_frames(run, "0011_short.exr", 250), >, 0);
    run_free(run);
}

/* How much more radiance the first picture shows. */
static double radiance_ratio(const char *a_path, const char *b_path,
                             const struct session_shot *shot) {
    struct exr_part *a = radiance_of(a_path, shot), *b = radiance_of(b_path, shot);
    double sums[2] = {0};
    for (int i = 0; i < a->width * a->height; i++) {
        sums[0] += exr_part_plane(a, "Y")[i];
        sums[1] += exr_part_plane(b, "Y")[i];
    }
    exr_part_free(a);
    exr_part_free(b);
    return sums[0] / sums[1];
}

/* A bracket far too long: each picture is taken again with shorter exposures until it holds, and
 * says the same as one that was well exposed at the same time. */
TEST(too_bright) {
    struct run *run =
        run_begin((const struct change[]){{"[capture]", "exposures_us = 100000"}, {0}});
    run_to_end(run);
    g_assert_nonnull(strstr(run->told->str, "taken again at 25000 µs"));
    g_assert_null(strstr(run->told->str, "saturated in the shortest exposure"));
    g_assert_nonnull(strstr(run->told->str, "exposures: too long: saturated pictures"));
    g_autofree char *advice = NULL;
    g_autoptr(Session) session = session_open(run->session, SESSION_READ, NULL);
    g_assert_nonnull(advice = exposure_advice(session, 0));
    g_autoptr(Session) well = session_open(run_undisturbed(), SESSION_READ, NULL);
    g_assert_null(exposure_advice(well, 0.4));
    g_autofree char *bracket = exposure_advice(well, 0.6);
    g_assert_nonnull(strstr(bracket, "leave it out"));
    g_autoptr(GPtrArray) shots = run_shots(run->session);
    int shorter = 0;
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        if (shot->kind != SHOT_LAMP || !camera_set_has(shot->cameras, 0))
            continue;
        struct exr_part *part = radiance_of(run->session, shot);
        const char *exposures = NULL;
        g_assert_true(exr_get_string(part, "mesorig.exposures_us", &exposures, NULL));
        shorter += !g_str_equal(exposures, "100000");
        exr_part_free(part);
        g_assert_cmpfloat_with_epsilon(radiance_ratio(run->session, run_undisturbed(), shot), 1,
                                       0.02);
    }
    g_assert_cmpint(shorter, >, 0);
    run_free(run);
}

/* If retaking is switched off, the picture is kept and reported. */
TEST(saturated) {
    struct run *run = run_begin(
        (const struct change[]){{"[capture]", "exposures_us = 400000\nsaturated_pct = 100"}, {0}});
    run_to_end(run);
    g_assert_nonnull(strstr(run->told->str, "saturated in the shortest exposure"));
    g_autoptr(GPtrArray) shots = run_shots(run->session);
    int noted = 0;
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        noted += shot->note && strstr(shot->note, "saturated: cam30");
    }
    g_assert_cmpint(noted, >, 0);
    run_free(run);
}

/* Captures with a camera that shows a fifth less than it should where it is full; with a
 * calibration that knows of it, or none. Returns the most that a picture lacks of what it should
 * show. */
static double lacks_of_bent_camera(gboolean known) {
    struct run *run = run_new(NULL);
    g_autofree char *world = g_build_filename(run->directory, "world.conf", NULL);
    g_autofree char *calibrated = g_build_filename(run->directory, "bent.calibration", NULL);
    g_autofree char *text = NULL;
    g_autoptr(GError) error = NULL;
    g_autoptr(Calibration) calibration = calibration_new(&run->devices->geometry);
    calibration->noise[0].known = known;
    calibration->noise[0].transfer = (struct transfer){
        .black_dn = 64, .curvature = 0.2, .curvature_error = 0.001, .gain_dn_e = 0.27};
    g_assert_true(calibration_write(calibration, calibrated, &error));
    run_change_rig(run, (const struct change[]){{"[rig]", "calibration = bent.calibration"}, {0}});
    devices_close(run->devices);
    g_assert_true(g_file_get_contents(world, &text, NULL, NULL));
    const struct change bent = {"[camera cam30]", "curvature = 0.2"};
    g_autofree char *changed = small_rig_changed(text, &bent);
    g_assert_true(g_file_set_contents(world, changed, -1, NULL));
    run_open_devices(run);
    run_start(run);
    run_to_end(run);
    g_autoptr(GPtrArray) shots = run_shots(run->session);
    double lacks = 0;
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        if (shot->kind == SHOT_LAMP && camera_set_has(shot->cameras, 0))
            lacks = MAX(lacks, 1 - radiance_ratio(run->session, run_undisturbed(), shot));
    }
    run_free(run);
    return lacks;
}

TEST(bent_camera) {
    const double unknown = lacks_of_bent_camera(FALSE), known = lacks_of_bent_camera(TRUE);
    g_test_message("lacks %.4f, or %.4f when it is known", unknown, known);
    g_assert_cmpfloat(unknown, >, 0.02);
    g_assert_cmpfloat(known, <, 0.002);
}

TESTS_RUN_BY(run_tests);

int main(int argc, char **argv) {
    if (argc == 3 && g_str_equal(argv[1], "--resume"))
        return resume_in_child(argv[2]);
    return tests_run(argc, argv);
}
