#include "life.h"

#include <fcntl.h>
#include <gio/gio.h>
#include <glib/gstdio.h>
#include <math.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "exposures.h"
#include "lib/capture_steps.h"
#include "pipeline/pipeline.h"
#include "rig_watch.h"
#include "session/session.h"

#define PAUSE_US   (10 * G_USEC_PER_SEC) /* an operator's, before a paused session goes on */
#define LONGEST_US (G_GINT64_CONSTANT(3600) * G_USEC_PER_SEC) /* of a life, on the rig's clock */
#define HANG_S     60 /* of a life, really: SIGALRM ends it */

/* With ./run coverage, what this process has run is counted. */
void __gcov_dump(void) __attribute__((weak));

static G_NORETURN void life_over(int status) {
    if (__gcov_dump)
        __gcov_dump();
    _exit(status);
}

struct lifetime {
    struct scene *scene;
    const struct life *life;
    struct devices *devices;
    struct session_conf conf;
    Capture *capture;
    struct rig_watch watch;
    GString *told;
    enum capture_state state;
    int patience;
    gboolean decides; /* what follows a rest is due */
    gboolean ends;
};

struct due_call { /* of the schedule */
    struct lifetime *lifetime;
    const struct call *call;
};

static struct disk *disk_of(struct lifetime *lifetime) {
    return &lifetime->scene->disk;
}

static void life_finish(struct scene *scene, enum life_end end, const char *message) {
    disk_say(&scene->disk, "end: %s", message);
    scene->end = end;
    g_strlcpy(scene->message, message, sizeof scene->message);
    if (!*message)
        scene_break(scene, "stops are told", "the life ended without a message");
}

static void life_on_event(Capture *capture, const char *level, const char *source,
                          const char *message, gpointer data) {
    struct lifetime *lifetime = data;
    disk_say(disk_of(lifetime), "%s: %s: %s", level, source, message);
    g_string_append_printf(lifetime->told, "%s\n", message);
    lifetime->watch.unsafe_told |= strstr(message, DEVICES_UNSAFE) != NULL;
}

/* Makes the session or resumes it; FALSE: it was refused. */
static gboolean life_begin(struct lifetime *lifetime) {
    struct scene *scene = lifetime->scene;
    const struct capture_callbacks callbacks = {.event = life_on_event, .data = lifetime};
    const gboolean exists = g_file_test(scene->session, G_FILE_TEST_EXISTS);
    g_autoptr(GError) error = NULL;
    disk_say(&scene->disk, exists ? "resumes" : "begins");
    lifetime->capture =
        exists
            ? capture_resume(lifetime->devices, scene->session, &callbacks, &error)
            : capture_start(lifetime->devices, &lifetime->conf, scene->session, &callbacks, &error);
    lifetime->state = CAPTURE_HOMING;
    if (lifetime->capture) {
        scene->begun = TRUE;
        return TRUE;
    }
    life_finish(scene, LIFE_REFUSED, error ? error->message : "");
    return FALSE;
}

static void life_continue(struct lifetime *lifetime) {
    g_autoptr(GError) error = NULL;
    if (capture_continue(lifetime->capture, &error))
        return;
    disk_say(disk_of(lifetime), "not continued: %s", error ? error->message : "");
    if (!error || !*error->message)
        scene_break(lifetime->scene, "stops are told", "capture_continue() refuses without a word");
}

/* What an operator does with a paused session: he continues it, a limited number of times. */
static void life_decide(gpointer data) {
    struct lifetime *lifetime = data;
    lifetime->decides = FALSE;
    if (!lifetime->capture || lifetime->state < CAPTURE_PAUSED)
        return;
    if (lifetime->state != CAPTURE_PAUSED || lifetime->patience-- <= 0) {
        lifetime->ends = TRUE;
        return;
    }
    life_continue(lifetime);
}

static void check_stop(struct lifetime *lifetime, const struct capture_status *status) {
    if (status->state != CAPTURE_PAUSED)
        return;
    if (!status->reason || !*status->reason)
        scene_break(lifetime->scene, "stops are told", "it is paused without a reason");
    else if (!strstr(lifetime->told->str, status->reason))
        scene_break(lifetime->scene, "stops are told", "no event tells the reason: %s",
                    status->reason);
}

/* After each event of the main loop. */
static void life_look(struct lifetime *lifetime) {
    static const char *const names[] = {"homing", "running", "pausing",
                                        "paused", "done",    "aborted"};
    struct capture_status status = {.state = CAPTURE_ABORTED};
    if (lifetime->capture) {
        capture_get_status(lifetime->capture, &status);
        lifetime->scene->shots_done = status.shots_done;
    }
    const gboolean rests = status.state >= CAPTURE_PAUSED;
    if (lifetime->capture && status.state != lifetime->state) {
        disk_say(disk_of(lifetime), "%s, %d of %d shots", names[status.state], status.shots_done,
                 status.shots);
        lifetime->state = status.state;
        check_stop(lifetime, &status);
    }
    rig_watch_look(&lifetime->watch, rests);
    if (rests && lifetime->capture && !lifetime->decides && !lifetime->ends) {
        lifetime->decides = TRUE;
        clock_call_in(lifetime->devices->clock, PAUSE_US, life_decide, lifetime);
    }
}

/* Where nothing else is waited for, time jumps here. */
static void life_too_long(gpointer data) {
    struct lifetime *lifetime = data;
    scene_break(lifetime->scene, "ends", "nothing has ended after an hour on the rig's clock");
    lifetime->ends = TRUE;
}

static void life_run_main_loop(struct lifetime *lifetime) {
    while (!lifetime->ends) {
        g_main_context_iteration(NULL, TRUE);
        life_look(lifetime);
    }
}

static void call_status(struct lifetime *lifetime) {
    struct capture_status status;
    capture_get_status(lifetime->capture, &status);
    if (!status.doing || !*status.doing || status.shots_done > status.shots || status.frames < 0 ||
        !(isfinite(status.left_s) && status.left_s >= 0) ||
        !(isfinite(status.elapsed_s) && status.elapsed_s >= 0))
        scene_break(lifetime->scene, "status",
                    "\"%s\", %d of %d shots, %g s since it began, %g s left",
                    status.doing ? status.doing : "", status.shots_done, status.shots,
                    status.elapsed_s, status.left_s);
}

/* Another program looks at the session while it is captured. */
static void call_read(struct lifetime *lifetime) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(lifetime->scene->session, SESSION_READ, &error);
    g_autoptr(GPtrArray) frames = session ? session_frames(session, &error) : NULL;
    g_autoptr(GPtrArray) shots = frames ? session_shots(session, &error) : NULL;
    if (!shots) {
        disk_say(disk_of(lifetime), "the session cannot be read: %s", error->message);
        if (disk_of(lifetime)->n_failed == 0)
            scene_break(lifetime->scene, "readers", "%s", error->message);
        return;
    }
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        g_autofree char *path = session_file(session, frame->path);
        if (!g_file_test(path, G_FILE_TEST_IS_REGULAR) && disk_of(lifetime)->n_failed == 0)
            scene_break(lifetime->scene, "row has its file",
                        "a reader sees the row of %s, but "
                        "not the file",
                        frame->path);
    }
}

static void call_reopen(struct lifetime *lifetime) {
    g_clear_pointer(&lifetime->capture, capture_free);
    if (!life_begin(lifetime))
        lifetime->ends = TRUE;
}

/* Waits until the second daemon, which the supervisor starts, has ended. */
static void call_second(struct lifetime *lifetime) {
    char word = '2';
    if (write(lifetime->scene->asks, &word, 1) != 1 ||
        read(lifetime->scene->answers, &word, 1) != 1)
        g_error("simulate: the supervisor does not answer");
}

static void on_due_call(gpointer data) {
    g_autofree struct due_call *due = data;
    struct lifetime *lifetime = due->lifetime;
    struct scene *scene = lifetime->scene;
    if (!lifetime->capture || lifetime->ends)
        return;
    disk_say(&scene->disk, "call: %s", schedule_call_kind(due->call->kind));
    switch (due->call->kind) {
    case CALL_PAUSE:
        capture_pause(lifetime->capture);
        break;
    case CALL_CONTINUE:
        life_continue(lifetime);
        break;
    case CALL_ABORT:
        capture_abort(lifetime->capture);
        break;
    case CALL_SAFE: /* as bus_make_safe() */
        capture_abort(lifetime->capture);
        devices_make_safe(lifetime->devices, NULL);
        break;
    case CALL_STATUS:
        call_status(lifetime);
        break;
    case CALL_THUMBNAIL:
        for (int c = 0; c < lifetime->devices->geometry.n_cameras; c++)
            capture_thumbnail(lifetime->capture, c);
        break;
    case CALL_READ:
        call_read(lifetime);
        break;
    case CALL_REOPEN:
        call_reopen(lifetime);
        break;
    case CALL_SECOND:
        call_second(lifetime);
        break;
    case CALL_STEP:
        scene->disk.step_s += due->call->step_s;
        break;
    default:
        disk_kill(&scene->disk, due->call->kind == CALL_CUT);
    }
}

/* What happens before the first call of the C library that a schedule counts. */
static struct devices *open_devices(struct scene *scene) {
    g_autofree char *rig = g_build_filename(scene->folder, "rig.conf", NULL);
    g_autoptr(GError) error = NULL;
    struct devices *devices = devices_open(rig, &error);
    if (!devices)
        g_error("simulate: %s", error->message);
    clock_set_lockstep(devices->clock);
    disk_set_clock(devices->clock);
    return devices;
}

/* As mesorigd ends: the session is closed, and every device must confirm that it is safe. */
static void life_end(struct lifetime *lifetime) {
    g_autoptr(GError) error = NULL;
    g_clear_pointer(&lifetime->capture, capture_free);
    if (!devices_secure(lifetime->devices, &error)) {
        lifetime->watch.unsafe_told = TRUE;
        disk_say(disk_of(lifetime), "not safe: %s", error->message);
        if (lifetime->life->n_devices == 0)
            scene_break(lifetime->scene, "safe", "%s", error->message);
    }
    rig_watch_end(&lifetime->watch, "after the daemon's end");
    disk_of(lifetime)->ended_us = clock_now_us(lifetime->devices->clock);
}

void life_capture(struct scene *scene, const struct life *life) {
    struct lifetime lifetime = {.scene = scene,
                                .life = life,
                                .devices = open_devices(scene),
                                .told = g_string_new(NULL),
                                .patience = life->patience};
    g_autofree char *conf = g_build_filename(scene->folder, "session.conf", NULL);
    g_autoptr(GError) error = NULL;
    alarm(HANG_S);
    if (!session_conf_load(&lifetime.conf, conf, &error) ||
        !rig_watch_begin(&lifetime.watch, scene, life, lifetime.devices))
        g_error("simulate: %s", error ? error->message : "there is no world");
    exposures_note(scene);
    disk_use(&scene->disk);
    scene->disk.active = TRUE;
    if (!life_begin(&lifetime))
        life_over(0);
    for (int i = 0; i < life->n_calls; i++) {
        struct due_call *due = g_new(struct due_call, 1);
        *due = (struct due_call){&lifetime, &life->calls[i]};
        clock_call_at(lifetime.devices->clock, life->calls[i].at_us, on_due_call, due);
    }
    clock_call_at(lifetime.devices->clock, LONGEST_US, life_too_long, &lifetime);
    life_run_main_loop(&lifetime);
    if (lifetime.capture) {
        struct capture_status status;
        capture_get_status(lifetime.capture, &status);
        const enum life_end end = status.state == CAPTURE_DONE      ? LIFE_DONE
                                  : status.state == CAPTURE_ABORTED ? LIFE_ABORTED
                                                                    : LIFE_PAUSED;
        life_finish(scene, end,
                    status.reason                  ? status.reason
                    : status.state == CAPTURE_DONE ? "done"
                                                   : "aborted");
    }
    life_end(&lifetime);
    life_over(0);
}

void life_process(struct scene *scene) {
    const struct pipeline_options options = {.n_eigenmaps = 4, .work.n_threads = 1};
    struct pipeline_result result;
    g_autoptr(GError) error = NULL;
    alarm(HANG_S);
    disk_use(&scene->disk);
    scene->disk.active = TRUE;
    disk_say(&scene->disk, "makes products");
    if (pipeline_run(scene->session, &options, &result, &error))
        life_finish(scene, LIFE_PROCESSED, "products are made");
    else
        life_finish(scene, LIFE_FAILED, error->message);
    life_over(0);
}

void life_second(struct scene *scene) {
    struct devices *devices = open_devices(scene);
    g_autoptr(GError) error = NULL;
    alarm(HANG_S);
    disk_use(&scene->disk);
    Capture *capture = capture_resume(devices, scene->session, NULL, &error);
    disk_say(&scene->disk, "the second daemon: %s", capture ? "captures, too" : error->message);
    if (capture)
        life_over(1);
    life_over(g_error_matches(error, SESSION_ERROR, SESSION_ERROR_LOCKED) ? 0 : 2);
}
