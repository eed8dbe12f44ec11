/* A rig with one laser unit that somebody mounts at one place after another: what its rig file may
 * say, what is planned, and how the session asks for the next place. The pictures must be those of
 * a rig with a unit at each place. */
#include "exr/exr.h"
#include "lib/capture_run.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/test.h"
#include "lib/text_file.h"

#include <glib/gstdio.h>
#include <locale.h>
#include <math.h>
#include <signal.h>
#include <string.h>

#define SMALL   SOURCE_DIR "/tests/small/"
#define DEMO    SOURCE_DIR "/etc/demo/"
#define MESORIG BUILD_DIR "/bin/mesorig"

static char *replaced(const char *text, const char *from, const char *to) {
    g_auto(GStrv) parts = g_strsplit(text, from, -1);
    g_assert_cmpuint(g_strv_length(parts), >, 1);
    return g_strjoinv(to, parts);
}

/* [laser laserN] becomes a mount, and its sweep axis is left out. */
static char *with_mount(const char *text, int theta_deg, const char *unit) {
    g_autofree char *axis = g_strdup_printf("[axis sweep%d]", theta_deg);
    g_autofree char *section =
        g_strdup_printf("driver = sim-laser\nworld = world.conf\nsweep = sweep%d\n", theta_deg);
    g_autofree char *mount = g_strdup_printf("mount_of = %s\n", unit);
    g_autofree char *more = replaced(text, section, mount);
    char *from = strstr(more, axis), *to = strstr(from, "\n[");
    return g_strdup_printf("%.*s%s", (int)(from - more), more, to + 1);
}

/* The small rig with brighter lasers, which are one unit or not. */
static struct run *mounts_new(gboolean one_unit) {
    struct run *run = run_new(NULL);
    g_autofree char *two = text_file_read(SMALL "rig.conf");
    g_autofree char *one = with_mount(two, 60, "laser30");
    g_autofree char *dim = text_file_read(SMALL "world.conf");
    g_autofree char *world = replaced(dim, "width_mm = 6", "width_mm = 6\npower_w = 0.1");
    text_file_write(run->directory, "rig.conf", one_unit ? one : two);
    text_file_write(run->directory, "world.conf", world);
    devices_close(run->devices);
    run_open_devices(run);
    return run;
}

static void spin(void) {
    while (g_main_context_iteration(NULL, FALSE))
        ;
}

TEST(rig_file) {
    struct run *run = mounts_new(TRUE);
    struct devices *devices = run->devices;
    g_assert_cmpint(devices->geometry.n_lasers, ==, 2);
    g_assert_true(devices->lasers[0] == devices->lasers[1]);
    g_assert_true(devices->sweeps[0] == devices->sweeps[1]);
    g_assert_cmphex(devices->timing.mounts[0], ==, 2);
    g_assert_cmpint(rig_laser_unit(&devices->timing, 1), ==, 0);
    double theta_rad, phi_rad;
    rig_angles(devices->geometry.lasers[1].position_mm, &theta_rad, &phi_rad);
    g_assert_cmpfloat_with_epsilon(theta_rad, G_PI / 3, 1e-9);
    g_assert_true(devices_make_safe(devices, NULL));
    spin();
    run_free(run);
    spin();
}

TEST(bad_rig_files) {
    static const struct {
        const char *from, *to, *says;
    } cases[] = {
        {"mount_of = laser30", "mount_of = laser31", "[laser laser31]"},
        {"mount_of = laser30", "mount_of =", "mount_of"},
        {"mount_of = laser30", "mount_of = laser60", "put its section first"},
        {"mount_of = laser30", "mount_of = laser30\ndriver = sim-laser", "driver"},
        {"mount_of = laser30", "mount_of = laser30\nsweep = sweep30", "sweep"},
        {"mount_of = laser30", "mount_of = laser30\npart = laser30", "part"},
        {"[interlock door]",
         "[laser x]\nmount_of = laser60\ntheta_deg = 1\ndistance_mm = 1\n\n[interlock door]",
         "itself only a mount position"},
        {"[laser laser60]", "[laser nowhere]", "\"nowhere\""},
    };
    struct run *run = mounts_new(TRUE);
    g_autofree char *path = g_build_filename(run->directory, "rig.conf", NULL);
    g_autofree char *good = text_file_read(path);
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        g_autofree char *bad = replaced(good, cases[i].from, cases[i].to);
        g_autoptr(GError) error = NULL;
        text_file_write(run->directory, "rig.conf", bad);
        g_assert_null(devices_open(path, &error));
        g_assert_nonnull(error);
        g_test_message("%s", error->message);
        g_assert_true(g_str_has_prefix(error->message, path));
        g_assert_nonnull(strstr(error->message, cases[i].says));
        spin();
    }
    run_free(run);
}

/* The demo's rig as it was read, and its lasers units and mounts in whatever way. */
static void demo_plan(struct session_conf *conf, struct rig *rig, struct rig_timing *timing) {
    struct devices *devices = ok(devices_open(DEMO "rig.conf", ERR));
    *rig = devices->geometry;
    *timing = devices->timing;
    devices_close(devices);
    spin();
    g_assert_true(ok(session_conf_load(conf, DEMO "session.conf", ERR)));
}

static struct plan *build(const struct session_conf *conf, const struct rig *rig,
                          const struct rig_timing *timing) {
    struct plan *plan = ok(plan_build(conf, rig, timing, ERR));
    return plan;
}

/* Every unit with mounts is at each place that is needed once, in the order of the rig file: less
 * often cannot be. Returns how many places that are. */
static int check_blocks(const struct plan *plan, const struct rig_timing *timing) {
    int at[RIG_MAX_LASERS], n = 0;
    guint32 needed = 0;
    memset(at, -1, sizeof(at));
    for (int i = 0; i < plan->session.n_shots; i++) {
        const struct session_shot *shot = &plan->session.shots[i];
        int unit = 0;
        if (shot->kind != SHOT_SWEEP || shot->state != SHOT_PLANNED)
            continue;
        while (unit < shot->device && !(timing->mounts[unit] & 1u << shot->device))
            unit++;
        if (!timing->mounts[unit])
            continue;
        needed |= 1u << shot->device;
        g_assert_cmpint(shot->device, >=, at[unit]);
        n += shot->device != at[unit];
        at[unit] = shot->device;
    }
    g_assert_cmpint(n, ==, __builtin_popcount(needed));
    g_assert_cmpint(plan->n_mounts, ==, n);
    g_assert_cmpfloat(plan->predicted_s, >=, plan->lower_bound_s - 1e-6);
    g_assert_cmpfloat(plan->predicted_s, <=, plan->nested_s + 1e-6);
    return n;
}

/* All that a rig with five units takes is taken, and with one unit it takes little longer. */
TEST(plan_demo) {
    g_auto(SessionConf) conf = {0};
    struct rig rig;
    struct rig_timing timing;
    demo_plan(&conf, &rig, &timing);
    g_autoptr(Plan) five = build(&conf, &rig, &timing);
    g_assert_cmpint(five->n_mounts, ==, 0);
    timing.mounts[0] = 0x1e;
    g_autoptr(Plan) one = build(&conf, &rig, &timing);
    g_assert_cmpint(check_blocks(one, &timing), ==, 5);
    g_assert_cmpint(one->session.n_shots, ==, five->session.n_shots);
    g_assert_cmpint(one->n_frames, ==, five->n_frames);
    g_assert_cmpfloat_with_epsilon(one->lower_bound_s, five->lower_bound_s, 1e-6);
    g_test_message("one unit %.0f s, five %.0f s, lower bound %.0f s", one->predicted_s,
                   five->predicted_s, one->lower_bound_s);
    g_assert_cmpfloat(one->predicted_s, <, 1.15 * five->predicted_s);
}

static void random_conf(GRand *rand, struct session_conf *conf) {
    conf->n_views = g_rand_int_range(rand, 1, 3);
    conf->n_lights = g_rand_int_range(rand, 0, 3);
    conf->n_lasers = g_rand_int_range(rand, 1, 6);
    for (int i = 0; i < 5; i++) {
        conf->views[i].count = g_rand_int_range(rand, 1, 5);
        conf->lights[i].count = g_rand_int_range(rand, 1, 5);
        conf->lasers[i] = (struct ring){15 + 15 * g_rand_int_range(rand, 0, 5), i + 0.5,
                                        g_rand_int_range(rand, 1, 5)};
    }
}

/* Any lasers mounts of any that stand before them. */
static void random_mounts(GRand *rand, struct rig_timing *timing) {
    gboolean is_mount[5] = {FALSE};
    memset(timing->mounts, 0, sizeof(timing->mounts));
    for (int i = 1; i < 5; i++) {
        int unit = g_rand_int_range(rand, 0, i + 1);
        if (unit == i || is_mount[unit])
            continue;
        is_mount[i] = TRUE;
        timing->mounts[unit] |= 1u << i;
    }
}

TEST(plan_random) {
    g_autoptr(GRand) rand = g_rand_new_with_seed(11);
    g_auto(SessionConf) conf = {0};
    struct rig rig;
    struct rig_timing timing;
    int most = 0;
    demo_plan(&conf, &rig, &timing);
    for (int round = 0; round < 25; round++) {
        random_mounts(rand, &timing);
        random_conf(rand, &conf);
        g_autoptr(Plan) plan = build(&conf, &rig, &timing);
        most = MAX(most, check_blocks(plan, &timing));
    }
    g_assert_cmpint(most, >, 2);
}

/* How often an operator was asked for a mounting; nothing went wrong. */
static int times_asked(struct run *run) {
    int n = 0;
    if (g_str_has_prefix(run->told->str, "error ") || strstr(run->told->str, "\nerror "))
        g_error("%s", run->told->str);
    for (const char *at = run->told->str; (at = strstr(at, ": mount laser unit")); at++)
        n++;
    return n;
}

static struct run *begin(gboolean one_unit) {
    struct run *run = mounts_new(one_unit);
    run_start(run);
    return run;
}

/* As after a kill: everything is opened anew. */
static void begin_again(struct run *run) {
    g_clear_pointer(&run->capture, capture_free);
    devices_close(run->devices);
    spin();
    run_open_devices(run);
    run_resume(run);
}

static void to_prompt(struct run *run, const char *prompt) {
    run_to_pause(run, prompt);
    g_assert_cmpstr(run_status(run).prompt, ==, prompt);
    g_assert_cmpstr(run_status(run).reason, ==, prompt);
}

static void to_end(struct run *run) {
    g_assert_cmpint(run_until(run, 0), ==, CAPTURE_DONE);
    g_assert_null(run_status(run).prompt);
}

/* However long the operator takes, nothing happens. */
static void check_safe(struct run *run) {
    double elapsed_s = run_status(run).elapsed_s;
    run_pass_time(run, 3600);
    g_assert_cmpint(run_status(run).state, ==, CAPTURE_PAUSED);
    g_assert_cmpfloat(run_status(run).elapsed_s, ==, elapsed_s);
    run_check_safe(run);
    for (int i = 0; i < 2; i++)
        g_assert_false(axis_is_moving(run->devices->sweeps[i]));
}

/* How many sweeps from a laser's place are done; all of them if whole. */
static int sweeps_done(const char *path, int laser, gboolean whole) {
    g_autoptr(GPtrArray) shots = run_shots(path);
    int n = 0;
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        if (shot->kind != SHOT_SWEEP || shot->device != laser)
            continue;
        n += shot->state == SHOT_DONE;
        g_assert_true(!whole || shot->state == SHOT_DONE);
    }
    return n;
}

/* When the line passed each pixel, and how bright: the same but for noise. A line that came from
 * the other place, or was swept elsewhere, would be steps away. */
static void check_same_peaks(const char *a_path, const char *b_path) {
    g_autoptr(GError) error = NULL;
    struct exr_part *a = exr_read_part(a_path, "sweep", &error);
    struct exr_part *b = ok(exr_read_part(b_path, "sweep", ERR));
    const float *peak_a = exr_part_plane(a, "peak"), *peak_b = exr_part_plane(b, "peak");
    const float *light_a = exr_part_plane(a, "intensity"),
                *light_b = exr_part_plane(b, "intensity");
    double light = 0, of_b = 0;
    int seen = 0, n = a->width * a->height;
    for (int i = 0; i < n; i++) {
        if (peak_a[i] < 0 || peak_b[i] < 0)
            continue;
        g_assert_cmpfloat(fabsf(peak_a[i] - peak_b[i]), <, 0.25F);
        light += light_a[i];
        of_b += light_b[i];
        seen++;
    }
    g_assert_cmpint(seen, >, n / 4);
    g_assert_cmpfloat_with_epsilon(light / of_b, 1, 0.01);
    exr_part_free(a);
    exr_part_free(b);
}

static void check_same_shot(const char *a, const struct session_shot *of_a, const char *b,
                            const struct session_shot *of_b) {
    static const char *const cameras[] = {"cam30", "cam60"};
    for (int c = 0; c < 2; c++) {
        if (!camera_set_has(of_a->cameras, c))
            continue;
        g_autofree char *a_name = session_frame_path(of_a, cameras[c]);
        g_autofree char *b_name = session_frame_path(of_b, cameras[c]);
        g_autofree char *a_path = g_build_filename(a, a_name, NULL);
        g_autofree char *b_path = g_build_filename(b, b_name, NULL);
        check_same_peaks(a_path, b_path);
    }
}

static void check_same_sweeps(const char *a, const char *b) {
    g_autoptr(GPtrArray) of_a = run_shots(a), of_b = run_shots(b);
    int n = 0, matched = 0;
    g_assert_cmpuint(of_a->len, ==, of_b->len);
    for (guint i = 0; i < of_a->len; i++) {
        const struct session_shot *s = of_a->pdata[i];
        n += s->kind == SHOT_SWEEP;
        for (guint k = 0; s->kind == SHOT_SWEEP && k < of_b->len; k++) {
            const struct session_shot *t = of_b->pdata[k];
            if (t->kind != SHOT_SWEEP || t->source != s->source ||
                !camera_set_equal(t->cameras, s->cameras) || t->turntable_deg != s->turntable_deg)
                continue;
            check_same_shot(a, s, b, t);
            matched++;
        }
    }
    g_assert_cmpint(n, >, 0);
    g_assert_cmpint(matched, ==, n);
}

#define AT_30 "mount laser unit laser30 at 30° (laser30), then continue"
#define AT_60 "mount laser unit laser30 at 60° (laser60), then continue"

TEST(capture) {
    struct run *two = begin(FALSE), *one = begin(TRUE);
    to_end(two);
    g_assert_cmpint(times_asked(two), ==, 0);
    to_prompt(one, AT_30);
    g_assert_false(axis_is_homed(one->devices->arc)); /* nothing has moved */
    g_assert_cmpint(run_status(one).frames, ==, 0);
    check_safe(one);
    run_continue(one);
    g_assert_null(run_status(one).prompt);
    to_prompt(one, AT_60);
    check_safe(one);
    g_assert_cmpint(sweeps_done(one->session, 0, TRUE), >, 0);
    g_assert_cmpint(sweeps_done(one->session, 1, FALSE), ==, 0);
    capture_pause(one->capture); /* it is paused already */
    g_assert_cmpstr(run_status(one).prompt, ==, AT_60);
    run_continue(one);
    to_end(one);
    g_assert_cmpint(times_asked(one), ==, 2);
    g_assert_cmpint(sweeps_done(one->session, 1, TRUE), >, 0);
    check_same_sweeps(one->session, two->session);
    run_free(one);
    run_free(two);
}

/* A pause by the user is not an answer and needs none; killed while it asks, it asks again; what
 * was answered it does not. */
TEST(resume) {
    struct run *run = begin(TRUE);
    to_prompt(run, AT_30);
    begin_again(run);
    to_prompt(run, AT_30);
    run_continue(run);
    run_until(run, 10);
    capture_pause(run->capture);
    g_assert_cmpint(run_until(run, 0), ==, CAPTURE_PAUSED);
    g_assert_null(run_status(run).prompt);
    run_continue(run);
    run_until(run, 20);
    begin_again(run);
    to_prompt(run, AT_60);
    int asked = times_asked(run);
    begin_again(run);
    to_prompt(run, AT_60);
    g_assert_cmpint(times_asked(run), ==, asked + 1);
    capture_abort(run->capture);
    g_assert_null(run_status(run).prompt);
    begin_again(run);
    to_prompt(run, AT_60);
    run_continue(run);
    run_until(run, 1);
    begin_again(run);
    to_end(run);
    g_assert_cmpint(times_asked(run), ==, asked + 2);
    run_free(run);
}

static void lose_sweeps(const char *path, int laser) {
    g_autoptr(GPtrArray) shots = run_shots(path);
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        if (shot->kind != SHOT_SWEEP || shot->device != laser)
            continue;
        g_autofree char *name =
            session_frame_path(shot, camera_set_has(shot->cameras, 0) ? "cam30" : "cam60");
        g_autofree char *file = g_build_filename(path, name, NULL);
        g_assert_cmpint(g_remove(file), ==, 0);
    }
}

/* What is lost is taken again from where the unit is before it is asked for elsewhere. */
TEST(lost) {
    struct run *run = begin(TRUE);
    to_prompt(run, AT_30);
    run_continue(run);
    to_prompt(run, AT_60);
    run_continue(run);
    to_end(run);
    lose_sweeps(run->session, 0);
    lose_sweeps(run->session, 1);
    g_string_truncate(run->told, 0);
    begin_again(run);
    to_prompt(run, AT_30);
    g_assert_cmpint(sweeps_done(run->session, 0, FALSE), ==, 0);
    g_assert_cmpint(sweeps_done(run->session, 1, TRUE), >, 0);
    run_continue(run);
    to_end(run);
    g_assert_cmpint(times_asked(run), ==, 1);
    sweeps_done(run->session, 0, TRUE);
    run_free(run);
}

/* Runs mesorig, NULL-terminated; what it prints is to have the words. */
static void tells(const char *const *argv, const char *words) {
    g_autofree char *text = process_text(0, argv);
    assert_has(text, words);
}

TEST(cli) {
    struct run *run = mounts_new(TRUE);
    g_autofree char *rig = g_build_filename(run->directory, "rig.conf", NULL);
    g_autofree char *session = g_build_filename(run->directory, "session.conf", NULL);
    const char *output = run->session;
    tells((const char *[]){MESORIG, "plan", rig, session, NULL}, "laser mounts    2 by hand");
    tells((const char *[]){MESORIG, "plan", "--json", rig, session, NULL}, "\"mounts\": 2");
    tells((const char *[]){MESORIG, "drivers", "laser", NULL}, "mount_of");
    tells((const char *[]){MESORIG, "capture", "--yes", rig, session, "-o", output, NULL},
          "is mounted at 60° (laser60)");
    tells((const char *[]){MESORIG, "info", output, NULL}, "state      done");
    run_free(run);
}

static void wait_for_status(const char *session, const char *words) {
    const gint64 until = g_get_monotonic_time() + 60 * G_USEC_PER_SEC;
    for (;;) {
        g_autofree char *out = NULL, *err = NULL;
        process_run((const char *[]){MESORIG, "status", "--json", session, NULL}, &out, &err);
        if (strstr(out, words))
            return;
        g_assert_cmpint(g_get_monotonic_time(), <, until);
        g_usleep(50 * 1000);
    }
}

/* Asked in one terminal, killed there, asked again after a resume, and answered in another. */
TEST(cli_continue) {
    struct run *run = mounts_new(TRUE);
    g_autofree char *rig = g_build_filename(run->directory, "rig.conf", NULL);
    g_autofree char *conf = g_build_filename(run->directory, "session.conf", NULL);
    const char *session = run->session;
    const char *const go_on[] = {MESORIG, "continue", session, NULL};
    g_autoptr(GError) error = NULL;
    g_autoptr(GSubprocess) killed =
        g_subprocess_new(G_SUBPROCESS_FLAGS_STDOUT_SILENCE | G_SUBPROCESS_FLAGS_STDERR_SILENCE,
                         &error, MESORIG, "capture", rig, conf, "-o", session, NULL);
    g_assert_no_error(error);
    wait_for_status(session, "\"prompt\": \"" AT_30 "\"");
    tells((const char *[]){MESORIG, "status", session, NULL}, "to do      " AT_30);
    tells(go_on, "going on");
    wait_for_status(session, "\"prompt\": \"" AT_60 "\"");
    g_subprocess_send_signal(killed, SIGKILL);
    g_subprocess_wait(killed, NULL, NULL);

    g_autofree char *out = NULL;
    wait_for_status(session, "\"kind\": \"session\""); /* the daemon ends with its client */
    g_autoptr(GSubprocess) resumed =
        g_subprocess_new(G_SUBPROCESS_FLAGS_STDOUT_PIPE, &error, MESORIG, "resume", session, NULL);
    g_assert_no_error(error);
    wait_for_status(session, "\"prompt\": \"" AT_60 "\"");
    tells(go_on, "going on");
    ok(g_subprocess_communicate_utf8(resumed, NULL, NULL, &out, NULL, ERR));
    g_assert_cmpint(g_subprocess_get_exit_status(resumed), ==, 0);
    g_assert_nonnull(strstr(out, AT_60));
    g_assert_null(strstr(out, AT_30));
    run_free(run);
}

TESTS_RUN_BY(run_tests);

BEFORE_TESTS {
    setlocale(LC_ALL, "");
    g_setenv("LC_ALL", "C.UTF-8", TRUE);
    g_setenv("DBUS_SYSTEM_BUS_ADDRESS", "unix:path=/no/such", TRUE);
    g_setenv("DBUS_SESSION_BUS_ADDRESS", "unix:path=/no/such", TRUE);
}
