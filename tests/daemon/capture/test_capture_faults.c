/* Every fault of the small simulated rig during a capture: what is taken again, and what pauses the
 * capture. In the end the session is identical, bit for bit, to one without faults. */
#include <gio/gio.h>
#include <glib/gstdio.h>
#include <string.h>

#include "lib/capture_run.h"
#include "lib/test.h"

static const struct retakes {
    const char *path, *told;
    struct change changes[8];
} retakes[] = {
    {"/fault/stale-old",
     "it is an old frame",
     {{"[camera cam30]", "fault_stale = 0.2"},
      {"[camera cam60]", "fault_stale = 0.05"},
      {"[capture]", "retries = 20"}}},
    {"/fault/stale-relabelled",
     "repeats",
     {{"[camera cam30]", "fault_stale = 0.2"},
      {"[camera cam30]", "fault_stale_kind = relabelled"},
      {"[camera cam60]", "fault_stale = 0.1"},
      {"[camera cam60]", "fault_stale_kind = relabelled"},
      {"[camera cam60]", "fault_seed = 5"},
      {"[capture]", "retries = 20"}}},
    {"/fault/lost",
     "no frame",
     {{"[camera cam60]", "fault_lost = 0.1"}, {"[capture]", "retries = 20"}}},
};

/* Pictures that are refused or lost are taken again until they are good; nothing else changes. */
static void test_retakes(gconstpointer data) {
    const struct retakes *expected = data;
    struct run *run = run_begin(expected->changes);
    g_assert_cmpint(run_until(run, 0), ==, CAPTURE_DONE);
    g_assert_cmpint(run_status(run).retakes, >, 5);
    g_assert_nonnull(strstr(run->told->str, expected->told));
    g_assert_nonnull(strstr(run->told->str, "taken again"));
    /* Not each of them: at most one a camera and minute, and the rest at the end. */
    g_assert_cmpint(run->n_told, <, 3 + 2 * (2 + run_status(run).elapsed_s / 60));
    g_autoptr(GPtrArray) frames = run_frames(run->session);
    int retakes_stored = 0;
    for (guint i = 0; i < frames->len; i++)
        retakes_stored += ((const struct session_frame *)frames->pdata[i])->retakes;
    g_assert_cmpint(retakes_stored, >, 5);
    run_finish(run);
}

TEST(slow) {
    struct run *run =
        run_begin((const struct change[]){{"[camera cam30]", "fault_slow_ms = 300"}, {0}});
    g_assert_cmpint(run_until(run, 0), ==, CAPTURE_DONE);
    g_assert_cmpint(run_status(run).retakes, ==, 0);
    run_check_same(run);
    run_free(run);
}

/* Never in time: that ends, in words. */
TEST(too_slow) {
    struct run *run =
        run_begin((const struct change[]){{"[camera cam30]", "fault_slow_ms = 60000"}, {0}});
    run_to_pause(run, "cam30");
    g_assert_nonnull(strstr(run_status(run).reason, "4 attempts"));
    g_assert_cmpint(run_status(run).retakes, ==, 3);
    run_check_safe(run);
    run_free(run);
}

/* The capture waits for a camera that comes back by itself. */
TEST(disconnect) {
    struct run *run =
        run_begin((const struct change[]){{"[camera cam60]", "fault_disconnect_after = 30"}, {0}});
    run_to_end(run);
    g_assert_nonnull(strstr(run->told->str, "cam60"));
    run_check_same(run);
    run_free(run);
}

TEST(disconnect_for_long) {
    struct run *run =
        run_begin((const struct change[]){{"[camera cam60]", "fault_disconnect_after = 30"},
                                          {"[camera cam60]", "fault_reconnect_s = 3000"},
                                          {0}});
    run_to_pause(run, "cam60");
    g_assert_nonnull(strstr(run_status(run).reason, "disconnected"));
    run_check_safe(run);
    double elapsed_s = run_status(run).elapsed_s;
    run_continue(run);
    run_to_pause(run, "cam60");
    run_pass_time(run, 3000);
    g_assert_cmpfloat(run_status(run).elapsed_s, <, elapsed_s + 100); /* pauses do not count */
    run_continue(run);
    run_finish(run);
}

static void check_stall(const char *head, const char *kind, const char *line) {
    struct run *run = run_begin((const struct change[]){{head, kind}, {head, line}, {0}});
    g_autofree char *name = g_strndup(head + 6, strlen(head) - 7);
    run_to_pause(run, name);
    run_check_safe(run);
    run_continue(run);
    run_finish(run);
}

TEST(stall) {
    check_stall("[axis turntable]", "fault_stall_kind = reported", "fault_stall_at = 2");
    check_stall("[axis arc]", "fault_stall_kind = silent", "fault_stall_at = 2");
    check_stall("[axis sweep60]", "fault_stall_kind = reported", "fault_stall_at = 7");
    check_stall("[axis sweep30]", "fault_stall_kind = silent", "fault_stall_at = 9");
}

TEST(dead_lamp) {
    struct run *run = run_begin((const struct change[]){
        {"[lamps bank]", "fault_dead = lamp60"}, {"[lamps bank]", "fault_dead_after = 2"}, {0}});
    run_to_pause(run, "lamp lamp60 gives no light");
    run_check_safe(run);
    run_continue(run);
    run_to_pause(run, "lamp lamp60 gives no light");
    g_clear_pointer(&run->capture, capture_free);
    run_change_rig(run, NULL); /* a new lamp */
    run_resume(run);
    run_finish(run);
}

/* A lamp that dies while one camera's only picture is taken again: the other one has seen it. */
TEST(lamp_dies_before_retake) {
    struct run *run = run_begin((const struct change[]){{"[capture]", "exposures_us = 16000"},
                                                        {"[lamps bank]", "fault_dead = lamp30"},
                                                        {"[lamps bank]", "fault_dead_after = 1"},
                                                        {"[camera cam60]", "fault_lost = 0.1"},
                                                        {"[camera cam60]", "fault_seed = 17"},
                                                        {0}});
    run_to_pause(run, "camera cam60 saw no more than its dark level in a picture that was taken "
                      "again");
    run_check_safe(run);
    g_clear_pointer(&run->capture, capture_free);
    run_change_rig(run, NULL);
    run_resume(run);
    run_to_end(run);
    run_check_whole(run->session);
    run_free(run);
}

TEST(laser_stays_on) {
    struct run *run =
        run_begin((const struct change[]){{"[laser laser30]", "fault_stays_on = yes"}, {0}});
    run_to_pause(run, "laser laser30 stays on");
    g_clear_pointer(&run->capture, capture_free);
    run_change_rig(run, NULL);
    run_resume(run);
    run_finish(run);
}

/* The same, while pictures of the shot before the sweep are lost: none of them, taken again, shows
 * the laser. */
TEST(laser_stays_on_and_lost) {
    struct run *run = run_begin((const struct change[]){{"[laser laser30]", "fault_stays_on = yes"},
                                                        {"[camera cam30]", "fault_lost = 0.297"},
                                                        {"[camera cam30]", "fault_seed = 665"},
                                                        {0}});
    run_to_pause(run, "laser laser30 stays on");
    g_assert_cmpint(run_status(run).retakes, >, 5);
    g_clear_pointer(&run->capture, capture_free);
    run_change_rig(run, NULL);
    run_resume(run);
    run_finish(run);
}

/* A session whose first sweep stalled while its laser stays on, closed; shots before that sweep are
 * stored as far as they had been written: two or more. */
static struct run *stall_in_sweep(int *ret_n_stored) {
    for (int attempt = 0; attempt < 50; attempt++) {
        struct run *run =
            run_begin((const struct change[]){{"[laser laser30]", "fault_stays_on = yes"},
                                              {"[axis sweep30]", "fault_stall_at = 9"},
                                              {0}});
        run_to_pause(run, "sweep30");
        *ret_n_stored = run_status(run).shots_done;
        g_clear_pointer(&run->capture, capture_free);
        if (*ret_n_stored >= 2)
            return run;
        run_free(run);
    }
    g_error("no session was paused with two shots stored");
}

/* The picture that shows the laser was not taken. The last picture that was taken before the sweep,
 * or the first, a dark frame, is to be taken again, and the laser would light it: the sweep comes
 * first, or next to the dark frame, which it needs, and nothing is stored. */
static void test_laser_stays_on_in_a_pause(gconstpointer dark) {
    int n_stored;
    struct run *run = stall_in_sweep(&n_stored);
    g_autoptr(GPtrArray) frames = run_frames(run->session);
    const struct session_frame *lost = frames->pdata[dark ? 0 : frames->len - 1];
    g_autofree char *path = g_build_filename(run->session, lost->path, NULL);
    g_assert_cmpint(g_unlink(path), ==, 0);
    run_resume(run);
    for (int pauses = 0; pauses < 2; pauses++) {
        if (pauses > 0)
            run_continue(run);
        run_to_pause(run, "laser laser30 stays on");
        g_assert_cmpint(run_status(run).shots_done, ==, n_stored - 1);
    }
    g_clear_pointer(&run->capture, capture_free);
    run_change_rig(run, NULL);
    run_resume(run);
    run_finish(run);
}

static void lose_first_frame(const struct run *run) {
    g_autoptr(GPtrArray) frames = run_frames(run->session);
    const struct session_frame *dark = frames->pdata[0];
    g_autofree char *path = g_build_filename(run->session, dark->path, NULL);
    g_assert_cmpint(g_unlink(path), ==, 0);
}

/* The other laser stays on: the dark frame and the first laser's sweep, which it may have lit, are
 * not stored. */
TEST(other_laser_stays_on) {
    int n_stored;
    struct run *run = stall_in_sweep(&n_stored);
    lose_first_frame(run);
    run_change_rig(run, (const struct change[]){{"[laser laser60]", "fault_stays_on = yes"}, {0}});
    run_resume(run);
    run_to_pause(run, "laser laser60 stays on");
    g_assert_cmpint(run_status(run).shots_done, ==, n_stored - 1);
    g_clear_pointer(&run->capture, capture_free);
    run_change_rig(run, NULL);
    run_resume(run);
    run_finish(run);
}

/* What waits until the lasers are checked does not hold up a pause; it is taken again. */
TEST(pause_before_check) {
    int n_stored;
    struct run *run = stall_in_sweep(&n_stored);
    lose_first_frame(run);
    run_change_rig(run, NULL);
    run_resume(run);
    run_until(run, run_status(run).frames + 1);
    capture_pause(run->capture);
    run_to_pause(run, "paused by the user");
    g_assert_cmpint(run_status(run).shots_done, ==, n_stored - 1);
    run_continue(run);
    run_finish(run);
}

/* A file that a failing disk neither wrote nor removed is gone when the session is done. */
TEST(left_over) {
    struct run *run = run_begin(NULL);
    g_autofree char *left =
        g_build_filename(run->session, "frames", "000007_cam60.exr.0123abcd.part", NULL);
    run_until(run, 3);
    g_assert_true(g_file_set_contents(left, "x", 1, NULL));
    g_assert_cmpint(run_until(run, 0), ==, CAPTURE_DONE);
    g_assert_false(g_file_test(left, G_FILE_TEST_EXISTS));
    run_finish(run);
}

/* A laser that does not answer to "off": this is reported each time, and the capture continues only
 * when the laser is off. The class of lasers repeats "off" by itself. */
TEST(deaf_laser) {
    struct run *run =
        run_begin((const struct change[]){{"[laser laser30]", "fault_deaf = 12"}, {0}});
    run_to_pause(run, "THE RIG COULD NOT BE MADE SAFE: laser laser30");
    g_assert_nonnull(strstr(run_status(run).reason, "cut its power by hand"));
    g_auto(GStrv) told_once = g_strsplit(run->told->str, "error laser30: THE RIG", -1);
    g_assert_cmpuint(g_strv_length(told_once), ==, 1 + 1);
    run_pass_time(run, 10); /* the rig was made safe, or was it? */
    g_assert_cmpint(laser_light(run->devices->lasers[0]), ==, LIGHT_UNSAFE);
    run_continue(run); /* it still is */
    run_to_pause(run, "THE RIG COULD NOT BE MADE SAFE: laser laser30");
    g_auto(GStrv) told_twice = g_strsplit(run->told->str, "error laser30: THE RIG", -1);
    g_assert_cmpuint(g_strv_length(told_twice), ==, 2 + 1);
    run_pass_time(run, 30);
    g_assert_cmpint(laser_light(run->devices->lasers[0]), ==, LIGHT_OFF);
    run_check_safe(run);
    run_continue(run);
    run_finish(run);
}

static void check_interlock(double after_s) {
    g_autofree char *after = g_strdup_printf("open_after_s = %g", after_s);
    g_autoptr(GError) error = NULL;
    struct run *run = run_begin((const struct change[]){
        {"[interlock door]", after}, {"[interlock door]", "open_for_s = 30"}, {0}});
    run_to_pause(run, "interlock door is open");
    run_check_safe(run);
    g_assert_false(capture_continue(run->capture, &error));
    g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_INTERLOCK);
    g_assert_cmpint(run_status(run).state, ==, CAPTURE_PAUSED);
    run_pass_time(run, 31);
    run_continue(run);
    run_finish(run);
}

TEST(interlock) {
    check_interlock(1); /* while homing */
    for (int i = 0; i < 3; i++)
        check_interlock(g_test_rand_double_range(3, 22));
}

TESTS_RUN_BY(run_tests);

BEFORE_TESTS {
    for (gsize i = 0; i < G_N_ELEMENTS(retakes); i++)
        g_test_add_data_func(retakes[i].path, &retakes[i], test_retakes);
    g_test_add_data_func("/fault/laser-stays-on-in-a-pause", NULL, test_laser_stays_on_in_a_pause);
    g_test_add_data_func("/fault/laser-stays-on-without-dark", "dark",
                         test_laser_stays_on_in_a_pause);
}
