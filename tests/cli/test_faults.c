/* What the operator sees: mesorig runs sessions of the small rig with every fault that the rig can
 * have, says what is wrong, and continues when the fault has been removed. The products are the
 * same as those of a session without faults. */
#include <gio/gio.h>
#include <glib/gstdio.h>
#include <string.h>

#include "base/json.h"
#include "lib/ok.h"
#include "lib/operator.h"
#include "lib/process.h"
#include "lib/test.h"
#include "session/session.h"

#define DAEMON BUILD_DIR "/bin/mesorigd"

#define MAX_CHANGES 5

static gboolean has_event(const char *path, const char *level, const char *source,
                          const char *message) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(path, SESSION_READ, &error);
    g_assert_no_error(error);
    g_autoptr(GPtrArray) events = session_events(session, &error);
    g_assert_no_error(error);
    for (guint i = 0; i < events->len; i++) {
        const struct session_event *event = events->pdata[i];
        if (g_str_equal(event->level, level) && g_str_equal(event->source, source) &&
            g_str_equal(event->message, message))
            return TRUE;
    }
    return FALSE;
}

static char *between(const char *text, const char *from, const char *to) {
    const char *at = strstr(text, from);
    g_assert_nonnull(at);
    at += strlen(from);
    g_assert_nonnull(strstr(at, to));
    return g_strndup(at, (gsize)(strstr(at, to) - at));
}

/* Checks after a capture that ended with a fault that the terminal, the session's state, its events
 * and the answers of the commands all say the same. */
static void check_told(struct operation *run, const char *device, const char *happened,
                       const char *to_do) {
    g_autofree char *told = g_strdup_printf("error: %s: ", device);
    g_autofree char *go_on = g_strdup_printf("to go on: mesorig resume %s\n", run->session);
    assert_has(run->out, told);
    assert_has(run->err, go_on);
    g_autofree char *reason = between(run->err, "mesorig: paused", "\n");
    const gboolean is_safe = g_str_has_prefix(reason, ", the rig is being made safe: ");
    memmove(reason, strstr(reason, ": ") + 2, strlen(strstr(reason, ": ") + 2) + 1);
    g_assert_true(is_safe == !strstr(reason, "THE RIG COULD NOT BE MADE SAFE"));
    assert_has(reason, device);
    assert_has(reason, happened);
    assert_has(reason, to_do);
    assert_has(reason, "then continue.");
    g_assert_true(has_event(run->session, "error", device, reason));
    g_autoptr(GString) json = g_string_new("\"state\": \"paused\", \"reason\": ");
    json_append_string(json, reason);
    const char *in_json = json->str;
    operator_does(run, 0, "status", "--json", run->session, NULL);
    assert_has(run->out, in_json);
    operator_does(run, 0, "info", "--json", run->session, NULL);
    assert_has(run->out, in_json);
    operator_does(run, 0, "status", run->session, NULL);
    assert_has(run->out, "state      paused\n");
    assert_has(run->out, reason);
    assert_has(run->out, "mesorig resume");
    operator_does(run, 1, "process", run->session, NULL);
    assert_has(run->err, "4 views lack some of their frames, because ");
    assert_has(run->err, " of 13 shots are still to be taken");
    assert_has(run->err, "mesorig resume");
}

struct fault {
    const char *name;    /* of the test */
    const char *changes; /* of the rig file, as in "[lamps bank] fault_dead = lamp60; …" */
    const char *device, *happened, *to_do;
    gboolean lasts; /* as long as it is not mended, a resumed session is paused too */
};

static const struct fault faults[] = {
    {"stale-old", "[camera cam60] fault_stale = 1", "cam60",
     "no good frame in 4 attempts; the last time: frame refused: it is an old frame",
     "Switch it off and on again", TRUE},
    {"stale-relabelled",
     "[camera cam30] fault_stale = 1; [camera cam30] fault_stale_kind = relabelled", "cam30",
     "it repeats the frame of shot", "Switch it off and on again", TRUE},
    {"lost", "[camera cam60] fault_lost = 1", "cam60",
     "no frame has arrived 2.1 s after the trigger", "check the camera's cable", TRUE},
    {"slow", "[camera cam30] fault_slow_ms = 60000", "cam30", "4 attempts",
     "check the camera's cable", TRUE},
    {"gone", "[camera cam60] fault_disconnect_after = 30; [camera cam60] fault_reconnect_s = 3000",
     "cam60", "the camera is disconnected", "check the camera's cable", FALSE},
    {"turntable-stalls", "[axis turntable] fault_stall_at = 2", "turntable", "stalled at",
     "check what blocks the axis", FALSE},
    {"turntable-is-silent",
     "[axis turntable] fault_stall_at = 1; [axis turntable] fault_stall_kind = silent", "turntable",
     "still moving at its deadline", "check drive and cable", FALSE},
    {"arc-stalls", "[axis arc] fault_stall_at = 1", "arc", "stalled at",
     "check what blocks the axis", TRUE},
    {"arc-is-silent", "[axis arc] fault_stall_at = 2; [axis arc] fault_stall_kind = silent", "arc",
     "still moving at its deadline", "check drive and cable", FALSE},
    {"sweep-stalls", "[axis sweep60] fault_stall_at = 7", "sweep60", "stalled at",
     "check what blocks the axis", FALSE},
    {"sweep-is-silent",
     "[axis sweep30] fault_stall_at = 9; [axis sweep30] fault_stall_kind = silent", "sweep30",
     "still moving at its deadline", "check drive and cable", FALSE},
    {"lamp-is-dead", "[lamps bank] fault_dead = lamp60", "lamp60", "gives no light",
     "Check the lamp, its fuse and its relay", TRUE},
    {"lamp-dies", "[lamps bank] fault_dead = lamp30; [lamps bank] fault_dead_after = 2", "lamp30",
     "gives no light", "Check the lamp, its fuse and its relay", FALSE},
    {"laser-stays-on", "[laser laser30] fault_stays_on = yes", "laser30", "stays on",
     "Cut the power of the laser, check its relay", TRUE},
    {"laser-is-deaf", "[laser laser60] fault_deaf = 1000", "laser60",
     "THE RIG COULD NOT BE MADE SAFE: laser laser60: did not answer to \"off\"",
     "it may still shine: cut its power by hand", TRUE},
    {"door-opens-while-homing", "[interlock door] open_after_s = 1", "door",
     "is open: laser and motion are forbidden", "Close it", TRUE},
    {"door-opens", "[interlock door] open_after_s = 9", "door",
     "is open: laser and motion are forbidden", "Close it", FALSE},
};

static struct operation *new_with(const char *text) {
    g_auto(GStrv) items = g_strsplit(text, "; ", MAX_CHANGES);
    struct change changes[MAX_CHANGES + 1] = {0};
    for (int i = 0; items[i]; i++) {
        char *line = strstr(items[i], "] ") + 1;
        *line = '\0';
        changes[i] = (struct change){items[i], line + 1};
    }
    return operator_new(changes);
}

/* Every earlier frame is unchanged. A session that continues may take a later sweep first, so new
 * frames may be listed between the earlier ones. */
static void check_kept(const char *before, const char *after) {
    g_auto(GStrv) kept = g_strsplit(before, "\n", -1), now = g_strsplit(after, "\n", -1);
    for (int i = 0; kept[i]; i++)
        g_assert_true(g_strv_contains((const char *const *)now, kept[i]));
}

static void test_fault(gconstpointer data) {
    const struct fault *fault = data;
    struct operation *run = new_with(fault->changes);
    operator_captures(run, 1);
    check_told(run, fault->device, fault->happened, fault->to_do);
    g_autofree char *before = operator_frames(run->session);
    if (fault->lasts) {
        operator_does(run, 1, "resume", run->session, NULL);
        check_told(run, fault->device, fault->happened, fault->to_do);
    }
    g_autofree char *still = operator_frames(run->session);
    check_kept(before, still);
    small_rig_write(run->directory, "rig.conf", NULL); /* mended */
    if (fault->lasts) {
        g_autofree char *mended = g_build_filename(run->directory, "mended.conf", NULL);
        g_assert_cmpint(g_rename(run->rig, mended), ==, 0);
        operator_does(run, 0, "resume", "--rig", mended, run->session, NULL);
    } else {
        operator_does(run, 0, "resume", run->session, NULL);
    }
    assert_has(run->out, "done: 13 of 13 shots");
    g_autofree char *after = operator_frames(run->session);
    check_kept(still, after);
    operator_does(run, 0, "status", "--json", run->session, NULL);
    assert_has(run->out, "\"state\": \"done\", \"reason\": \"\"");
    operator_check_products(run);
    operator_free(run);
}

/* Temporary faults: the session ends without an operator. */
static const struct fault passing[] = {
    {"some-stale-old",
     "[camera cam30] fault_stale = 0.05; [camera cam60] fault_stale = 0.05; [camera cam60] "
     "fault_seed = 7",
     "cam60", "it is an old frame", NULL, FALSE},
    {"some-stale-relabelled",
     "[camera cam30] fault_stale = 0.05; [camera cam30] fault_stale_kind = relabelled; [camera "
     "cam60] fault_stale = 0.05; [camera cam60] fault_stale_kind = relabelled; [camera cam60] "
     "fault_seed = 7",
     "cam60", "it repeats the frame", NULL, FALSE},
    {"some-lost", "[camera cam60] fault_lost = 0.05", "cam60",
     "no frame has arrived 2.1 s after the trigger", NULL, FALSE},
    {"gone-for-a-moment", "[camera cam60] fault_disconnect_after = 30", "cam60",
     "the camera is disconnected; check the camera's cable", NULL, FALSE},
    {"rather-slow", "[camera cam30] fault_slow_ms = 300", NULL, NULL, NULL, FALSE},
};

static void test_passing(gconstpointer data) {
    const struct fault *fault = data;
    struct operation *run = new_with(fault->changes);
    operator_captures(run, 0);
    assert_has(run->out, "done: 13 of 13 shots");
    if (fault->device) {
        g_autofree char *told = g_strdup_printf("warning: %s: frame taken again: ", fault->device);
        assert_has(run->out, told);
        assert_has(run->out, fault->happened);
        g_assert_null(strstr(run->out, "done, no retakes"));
        operator_does(run, 0, "info", "--json", run->session, NULL);
        g_assert_null(strstr(run->out, "\"retakes\": 0,"));
        assert_has(run->out, fault->happened);
    } else {
        assert_has(run->out, "no retakes");
    }
    operator_check_products(run);
    operator_free(run);
}

/* The door of a rig is open while the daemon runs: the daemon reports it each time, refuses to
 * continue while the door is open, and continues when it is closed. */
TEST(daemon_stays) {
    struct operation *run = operator_new((const struct change[]){
        {"[interlock door]", "open_after_s = 9"}, {"[interlock door]", "open_for_s = 60"}, {0}});
    g_autofree char *socket = g_build_filename(run->directory, "bus", NULL);
    g_autofree char *listen = g_strdup_printf("unix:path=%s", socket);
    g_autofree char *address = g_strdup_printf("--address=%s", listen);
    g_autoptr(GSubprocess) daemon =
        process_start_ready(G_SUBPROCESS_FLAGS_STDERR_SILENCE, NULL,
                            (const char *[]){DAEMON, "--listen", listen, NULL});
    operator_does(run, 1, "capture", address, run->rig, run->conf, "-o", run->session, NULL);
    assert_has(run->out, "error: door: interlock door is open");
    assert_has(run->err, "mesorig: paused, the rig is being made safe: interlock door is open");
    assert_has(run->err, "to go on: mesorig continue ");
    operator_does(run, 0, "status", "--json", address, NULL);
    assert_has(run->out, "\"state\": \"paused\", \"reason\": \"interlock door is open");
    assert_has(run->out, "[\"interlock\", \"door\", \"sim-interlock\", ");
    operator_does(run, 0, "status", address, NULL);
    assert_has(run->out, "reason     interlock door is open");
    /* Simulated minutes take a moment. */
    g_usleep(100000);
    operator_does(run, 0, "continue", run->session, NULL);
    operator_does(run, 0, "watch", address, NULL);
    operator_does(run, 0, "status", "--json", run->session, NULL);
    assert_has(run->out, "\"state\": \"done\"");
    g_subprocess_send_signal(daemon, SIGTERM);
    g_assert_true(ok(g_subprocess_wait_check(daemon, NULL, ERR)));
    operator_check_products(run);
    operator_free(run);
}

static void add_faults(const char *prefix, const struct fault *list, gsize n,
                       GTestDataFunc function) {
    for (gsize i = 0; i < n; i++) {
        g_autofree char *name = g_strconcat(prefix, list[i].name, NULL);
        g_test_add_data_func(name, &list[i], function);
    }
}

TESTS_RUN_BY(operator_tests);

BEFORE_TESTS {
    add_faults("/faults/", faults, G_N_ELEMENTS(faults), test_fault);
    add_faults("/faults/", passing, G_N_ELEMENTS(passing), test_passing);
}
