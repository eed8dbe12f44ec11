#include "capture_run.h"

#include <glib/gstdio.h>
#include <string.h>

#include "exr/exr.h"
#include "lib/capture_steps.h"
#include "lib/ok.h"
#include "remove_tree.h"

static char *top; /* the temporary folder that contains all files */
static int n_made;

void run_open_devices(struct run *run) {
    g_autofree char *rig = g_build_filename(run->directory, "rig.conf", NULL);
    run->devices = ok(devices_open(rig, ERR));
}

void run_change_rig(struct run *run, const struct change *changes) {
    devices_close(run->devices);
    small_rig_write(run->directory, "rig.conf", changes);
    small_rig_write(run->directory, "world.conf", changes);
    run_open_devices(run);
}

struct run *run_new(const struct change *changes) {
    struct run *run = g_new0(struct run, 1);
    run->directory = g_strdup_printf("%s/%d", top, n_made++);
    run->session = g_build_filename(run->directory, "small.session", NULL);
    run->told = g_string_new(NULL);
    run->least_gap_us = G_MAXINT64;
    g_mkdir(run->directory, 0777);
    small_rig_write(run->directory, "rig.conf", changes);
    small_rig_write(run->directory, "world.conf", changes);
    small_rig_write(run->directory, "session.conf", changes);
    run_open_devices(run);
    g_autofree char *conf = g_build_filename(run->directory, "session.conf", NULL);
    g_assert_true(ok(session_conf_load(&run->conf, conf, ERR)));
    return run;
}

void run_free(struct run *run) {
    capture_free(run->capture);
    devices_close(run->devices);
    session_conf_clear(&run->conf);
    remove_tree(run->directory);
    g_free(run->directory);
    g_free(run->session);
    g_string_free(run->told, TRUE);
    g_free(run);
}

static void on_changed(Capture *capture, gpointer data) {
    struct run *run = data;
    gint64 now = g_get_monotonic_time();
    if (run->n_changed++ > 0)
        run->least_gap_us = MIN(run->least_gap_us, now - run->changed_us);
    run->changed_us = now;
}

static void on_event(Capture *capture, const char *level, const char *source, const char *message,
                     gpointer data) {
    struct run *run = data;
    run->n_told++;
    g_string_append_printf(run->told, "%s %s: %s\n", level, source, message);
}

static struct capture_callbacks callbacks_of(struct run *run) {
    return (struct capture_callbacks){on_changed, on_event, run};
}

void run_start(struct run *run) {
    struct capture_callbacks callbacks = callbacks_of(run);
    run->capture = ok(capture_start(run->devices, &run->conf, run->session, &callbacks, ERR));
}

struct run *run_begin(const struct change *changes) {
    struct run *run = run_new(changes);
    run_start(run);
    return run;
}

void run_resume(struct run *run) {
    struct capture_callbacks callbacks = callbacks_of(run);
    g_clear_pointer(&run->capture, capture_free);
    run->capture = ok(capture_resume(run->devices, run->session, &callbacks, ERR));
}

void run_continue(struct run *run) {
    g_assert_true(ok(capture_continue(run->capture, ERR)));
}

struct capture_status run_status(struct run *run) {
    struct capture_status status;
    capture_get_status(run->capture, &status);
    return status;
}

static gboolean too_late(gpointer data) {
    g_error("nothing more happens; told so far:\n%s", ((struct run *)data)->told->str);
    return G_SOURCE_REMOVE;
}

enum capture_state run_until(struct run *run, gint64 frames) {
    guint guard = g_timeout_add_seconds(120, too_late, run);
    struct capture_status status = run_status(run);
    while (status.state < CAPTURE_PAUSED && (frames == 0 || status.frames < frames)) {
        g_main_context_iteration(NULL, TRUE);
        status = run_status(run);
    }
    g_source_remove(guard);
    return status.state;
}

void run_to_end(struct run *run) {
    if (run_until(run, 0) != CAPTURE_DONE)
        g_error("not done: %s", run_status(run).reason);
    g_clear_pointer(&run->capture, capture_free);
}

void run_to_pause(struct run *run, const char *reason) {
    g_assert_cmpint(run_until(run, 0), ==, CAPTURE_PAUSED);
    if (!strstr(run_status(run).reason, reason))
        g_error("paused for \"%s\", not \"%s\"", run_status(run).reason, reason);
    /* The pause is reported, with a reason that says what to do. */
    g_assert_nonnull(strstr(run->told->str, run_status(run).reason));
}

static void count_down(gpointer data) {
    (*(int *)data)--;
}

void run_pass_time(struct run *run, int seconds) {
    int left = 1;
    clock_call_in(run->devices->clock, (gint64)seconds * G_USEC_PER_SEC, count_down, &left);
    while (left > 0)
        g_main_context_iteration(NULL, TRUE);
}

void run_check_safe(struct run *run) {
    run_pass_time(run, 5); /* axes need time to stop */
    for (int i = 0; i < run->devices->geometry.n_lamps; i++)
        g_assert_false(lamps_is_on(run->devices->lamps[i].bank, run->devices->lamps[i].index));
    for (int i = 0; i < run->devices->geometry.n_lasers; i++)
        g_assert_false(laser_is_on(run->devices->lasers[i]));
    g_assert_false(axis_is_moving(run->devices->turntable));
    g_assert_false(axis_is_moving(run->devices->arc));
}

GPtrArray *run_frames(const char *session_path) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(session_path, SESSION_READ, &error);
    g_assert_no_error(error);
    GPtrArray *frames = ok(session_frames(session, ERR));
    return frames;
}

GPtrArray *run_shots(const char *session_path) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(session_path, SESSION_READ, &error);
    g_assert_no_error(error);
    GPtrArray *shots = ok(session_shots(session, ERR));
    return shots;
}

static void check_same_part(const char *path, const struct exr_part *a, const struct exr_part *b) {
    g_assert_cmpstr(a->name, ==, b->name);
    g_assert_cmpint(a->n_channels, ==, b->n_channels);
    gsize bytes = (gsize)a->width * a->height * sizeof(float);
    for (int c = 0; c < a->n_channels; c++) {
        if (memcmp(a->planes[c], b->planes[c], bytes) != 0)
            g_error("%s: channel %s differs from an undisturbed session's", path, a->channels[c]);
    }
}

void run_check_same_file(const char *a_session, const char *b_session, const char *relative) {
    g_autofree char *a_path = g_build_filename(a_session, relative, NULL);
    g_autofree char *b_path = g_build_filename(b_session, relative, NULL);
    struct exr_file *a = ok(exr_read(a_path, ERR));
    struct exr_file *b = ok(exr_read(b_path, ERR));
    g_assert_cmpint(a->parts->len, ==, b->parts->len);
    for (guint i = 0; i < a->parts->len; i++)
        check_same_part(a_path, a->parts->pdata[i], b->parts->pdata[i]);
    exr_file_free(a);
    exr_file_free(b);
}

const char *run_undisturbed(void) {
    static char *path;
    if (path)
        return path;
    struct run *run = run_begin(NULL);
    run_to_end(run);
    path = g_build_filename(top, "undisturbed.session", NULL);
    g_assert_cmpint(g_rename(run->session, path), ==, 0);
    run_free(run);
    return path;
}

void run_check_same_frames(const char *expected_path, const char *session_path) {
    g_autoptr(GPtrArray) expected = run_frames(expected_path);
    g_autoptr(GPtrArray) frames = run_frames(session_path);
    g_assert_cmpint(frames->len, ==, expected->len);
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *a = expected->pdata[i], *b = frames->pdata[i];
        g_assert_cmpint(a->shot, ==, b->shot);
        g_assert_cmpint(a->camera, ==, b->camera);
        g_assert_cmpstr(a->path, ==, b->path);
        run_check_same_file(expected_path, session_path, a->path);
    }
}

void run_check_same(struct run *run) {
    run_check_same_frames(run_undisturbed(), run->session);
}

void run_check_whole(const char *path) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(path, SESSION_CAPTURE, &error);
    g_assert_no_error(error);
    int lost = -1, expected = 0;
    g_assert_true(session_verify(session, TRUE, &lost, &error));
    g_assert_cmpint(lost, ==, 0);
    g_autoptr(GPtrArray) shots = session_shots(session, &error);
    g_autoptr(GPtrArray) frames = session_frames(session, &error);
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        g_assert_cmpint(shot->state, !=, SHOT_PLANNED);
        if (shot->state == SHOT_DONE)
            expected += camera_set_count(shot->cameras);
    }
    g_assert_cmpint(frames->len, ==, expected);
    g_autofree char *state = session_value(session, "state");
    g_assert_cmpstr(state, ==, "done");
}

void run_finish(struct run *run) {
    run_to_end(run);
    run_check_whole(run->session);
    run_check_same(run);
    run_free(run);
}

int run_tests(void) {
    top = g_dir_make_tmp("mesorig-capture-XXXXXX", NULL);
    int result = g_test_run();
    remove_tree(top);
    g_clear_pointer(&top, g_free);
    return result;
}
