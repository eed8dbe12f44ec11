#include "capture_private.h"

#include <gio/gio.h>
#include <math.h>

#include "capture_calibration.h"
#include "capture_check.h"
#include "intake/intake_darks.h"
#include "intake/intake_write.h"

struct plan *capture_validate(const struct devices *devices, const struct session_conf *conf,
                              const char *directory, GError **error) {
    if (directory && g_file_test(directory, G_FILE_TEST_EXISTS)) {
        g_autofree char *db = g_build_filename(directory, "session.db", NULL);
        g_set_error(error, SESSION_ERROR, SESSION_ERROR_EXISTS, "%s exists already%s", directory,
                    g_file_test(db, G_FILE_TEST_EXISTS)
                        ? "; choose another name, or continue that session with “mesorig resume”"
                        : ", and is not a session; choose another name");
        return NULL;
    }
    struct plan *plan = plan_build(conf, &devices->geometry, &devices->timing, error);
    if (plan && directory && !capture_check_disk(directory, plan->bytes, error))
        g_clear_pointer(&plan, plan_free);
    return plan;
}

/* Returns a camera's last finished dark shot that precedes the first shot that is still to be
 * taken. Returns NULL if there is none. */
static const struct session_shot *dark_before(const GPtrArray *shots, int camera) {
    const struct session_shot *found = NULL;
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        if (shot->kind == SHOT_DARK && shot->state == SHOT_DONE &&
            camera_set_has(shot->cameras, camera))
            found = shot;
        if (shot->state == SHOT_PLANNED)
            break;
    }
    return found;
}

static void on_event(const char *level, const char *source, const char *message, gpointer data) {
    Capture *capture = data;
    if (capture->callbacks.event)
        capture->callbacks.event(capture, level, source, message, capture->callbacks.data);
}

/* Makes the intake and the sequencer, and loads the values that earlier runs have stored. Nothing
 * moves yet. */
static gboolean open_parts(Capture *capture, GError **error) {
    struct capture_session *session = &capture->session;
    struct intake_hooks intake_hooks = capture_intake_hooks;
    struct sequencer_hooks sequencer_hooks = capture_sequencer_hooks;
    intake_hooks.data = sequencer_hooks.data = capture;
    const struct intake_setup setup = {.devices = session->devices,
                                       .conf = &session->conf,
                                       .directory = session_path(session->store),
                                       .calibration = session->calibration};
    capture->intake = intake_new(&setup, &intake_hooks);
    capture->sequencer = sequencer_new(session->devices, &session->conf, &sequencer_hooks);
    return run_totals_load(&capture->totals, session, error) &&
           time_left_load(&capture->time_left, session, error) &&
           capture_bytes_load(&capture->bytes, session, error) &&
           capture_mount_load(&capture->mounts, session, error);
}

static Capture *capture_open(struct devices *devices, const char *directory,
                             const struct capture_callbacks *callbacks, GError **error) {
    Capture *capture = g_new0(Capture, 1);
    struct adaptive_hooks hooks = capture_adaptive_hooks;
    hooks.data = capture;
    if (callbacks)
        capture->callbacks = *callbacks;
    capture->state = CAPTURE_PAUSED;
    capture->session.event = on_event;
    capture->session.event_data = capture;
    if (!capture_session_open(&capture->session, devices, directory, &hooks, error) ||
        !open_parts(capture, error))
        g_clear_pointer(&capture, capture_free);
    return capture;
}

static Session *create_session(const struct devices *devices, const struct session_conf *conf,
                               const char *directory, const struct plan *plan,
                               const struct calibration *calibration, GError **error) {
    g_autofree char *text = calibration_to_text(calibration);
    g_autofree char *reference = laser_reference_to_text(&conf->reference);
    g_autofree char *sweeps = adaptive_first_round(conf, plan, SHOT_SWEEP);
    g_autofree char *lamps = adaptive_first_round(conf, plan, SHOT_LAMP);
    gboolean calibrated = FALSE;
    for (int i = 0; i < CALIBRATION_PARTS; i++)
        calibrated |= calibration->parts[i].done;
    /* These values are needed by the capture or the processing. They are stored in one step with
     * the session, because the daemon may be killed right after the session has been made. */
    const char *const values[][2] = {
        {LASER_REFERENCE_KEY, conf->reference.radius_mm > 0 ? reference : NULL},
        {"chosen", conf->chosen},
        {ADAPTIVE_LASER_ROUNDS "1", sweeps},
        {ADAPTIVE_LIGHT_ROUNDS "1", lamps},
        /* The session contains the calibration itself. This value is the path of the file from
         * which the calibration was read, or "nominal". */
        {"calibration", calibrated ? devices->calibration_path : "nominal"},
    };
    struct session_texts texts = {
        .rig_conf = devices->text,
        .session_conf = conf->text,
        .calibration = text,
        .rig_path = devices->path,
        .values = values,
        .n_values = G_N_ELEMENTS(values),
    };
    return session_create(directory, conf->name, &texts, &plan->session, error);
}

static void note(Session *session, const char *level, const char *source,
                 const GPtrArray *messages) {
    for (guint i = 0; messages && i < messages->len; i++)
        session_add_event(session, 0, level, source, messages->pdata[i], NULL);
}

gboolean capture_create(const struct devices *devices, const struct session_conf *conf,
                        const char *directory, GError **error) {
    g_autoptr(Plan) plan = session_conf_check_chosen(conf, error)
                               ? capture_validate(devices, conf, directory, error)
                               : NULL;
    if (!plan)
        return FALSE;
    g_autoptr(GPtrArray) warnings = NULL;
    g_autoptr(Calibration) calibration = capture_calibration(devices, &warnings, error);
    g_autoptr(Session) session =
        calibration ? create_session(devices, conf, directory, plan, calibration, error) : NULL;
    if (session) {
        g_autofree char *line =
            calibration_line(calibration, devices->calibration_path, CAPTURE_CALIBRATION_HOW);
        capture_session_save(session, "predicted_s", plan->predicted_s);
        capture_session_save(session, "lower_bound_s", plan->lower_bound_s);
        capture_session_save(session, "predicted_bytes", (double)plan->bytes);
        note(session, "info", "plan", plan->notes);
        if (conf->chosen) {
            g_autofree char *said = g_strdup_printf("chosen from test shots: %s", conf->chosen);
            session_add_event(session, 0, "info", "exposures", said, NULL);
        }
        session_add_event(session, 0, "info", "calibration", line, NULL);
        note(session, "warning", "calibration", warnings);
    }
    return session != NULL;
}

Capture *capture_begin(struct devices *devices, const char *directory,
                       const struct capture_callbacks *callbacks, GError **error) {
    Capture *capture = capture_open(devices, directory, callbacks, error);
    if (!capture)
        return NULL;
    g_autofree char *answered = capture_check_devices_text(devices);
    g_autoptr(GPtrArray) events =
        session_set_value(capture->session.store, CAPTURE_DEVICES_KEY, answered, error)
            ? session_events(capture->session.store, error)
            : NULL;
    if (!events) {
        capture_free(capture);
        return NULL;
    }
    /* Passes on the events that were stored when the session was made. */
    for (guint i = 0; i < events->len && capture->callbacks.event; i++) {
        const struct session_event *event = events->pdata[i];
        capture->callbacks.event(capture, event->level, event->source, event->message,
                                 capture->callbacks.data);
    }
    capture_begin_soon(capture);
    return capture;
}

/* Returns whether every dark frame that the remaining shots need can be read. */
static gboolean can_read_darks(Session *session, const GPtrArray *shots,
                               const struct session_conf *conf, const struct rig *rig) {
    gint64 exposures[SHOT_MAX_DARKS];
    const int n = shot_dark_exposures(conf, exposures);
    for (int c = 0; c < rig->n_cameras; c++) {
        if (!devices_is_unit(rig, c))
            continue; /* the first stop of a camera on an arm has the dark frames for all stops */
        const struct camera_format format = {.width = rig->cameras[c].width,
                                             .height = rig->cameras[c].height};
        const struct session_shot *shot = dark_before(shots, c);
        for (int i = 0; shot && i < n; i++) {
            g_autofree float *pixels = intake_read_dark(
                session_path(session), shot, rig->cameras[c].name, &format, exposures[i], NULL);
            if (!pixels)
                return FALSE;
        }
    }
    return TRUE;
}

gboolean capture_examine(const struct devices *devices, const char *directory, char **ret_warning,
                         GError **error) {
    g_autoptr(Session) session = session_open(directory, SESSION_CAPTURE, error);
    g_auto(SessionConf) conf = {0};
    *ret_warning = NULL;
    if (!session || !session_verify(session, FALSE, NULL, error))
        return FALSE;
    g_autofree char *text = session_text(session, "session.conf", error);
    if (!text || !session_conf_parse(&conf, text, session_path(session), error))
        return FALSE;
    g_autoptr(GPtrArray) shots = session_shots(session, error);
    if (!shots || !capture_check_rig(session, shots, devices, error))
        return FALSE;
    /* If a dark frame cannot be read, the checksums of all frames are verified. The dark frame then
     * fails its check, and its shot is planned again. */
    if (!can_read_darks(session, shots, &conf, &devices->geometry) &&
        !session_verify(session, TRUE, NULL, error))
        return FALSE;
    g_autofree char *options = capture_check_options(session, devices);
    g_autofree char *calibration = capture_check_calibration(session, devices);
    *ret_warning = options && calibration ? g_strconcat(options, " ", calibration, NULL)
                   : options              ? g_steal_pointer(&options)
                                          : g_steal_pointer(&calibration);
    return TRUE;
}

/* Checks that the session fits the rig and the disk. Loads from earlier runs the time of the
 * session's clock, the sizes of the stored frames and the dark frames. */
static gboolean prepare_resumed(Capture *capture, GError **error) {
    struct capture_session *session = &capture->session;
    const struct rig *rig = &session->devices->geometry;
    if (!capture_check_rig(session->store, session->shots, session->devices, error))
        return FALSE;
    g_autoptr(GPtrArray) frames = session_frames(session->store, error);
    if (!frames)
        return FALSE;
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        if (isfinite(frame->captured_s))
            session->clock.base_s = MAX(session->clock.base_s, frame->captured_s);
    }
    capture_bytes_begin(&capture->bytes, session, frames);
    const double bytes = capture->bytes.expected - capture->bytes.stored;
    if (session->n_done < session->n_shots &&
        !capture_check_disk(session_path(session->store), (guint64)MAX(bytes, 0), error))
        return FALSE;
    for (int c = 0; c < rig->n_cameras; c++) {
        const struct session_shot *shot = dark_before(session->shots, c);
        if (shot && devices_is_unit(rig, c) && !intake_load_dark(capture->intake, shot, c, error))
            return FALSE;
    }
    return TRUE;
}

Capture *capture_go_on(struct devices *devices, const char *directory, const char *warning,
                       const struct capture_callbacks *callbacks, GError **error) {
    Capture *capture = capture_open(devices, directory, callbacks, error);
    if (!capture || !prepare_resumed(capture, error)) {
        capture_free(capture);
        return NULL;
    }
    g_autofree char *others = capture_check_devices(capture->session.store, devices);
    const char *const warnings[] = {warning, others};
    for (gsize i = 0; i < G_N_ELEMENTS(warnings); i++) {
        if (!warnings[i])
            continue;
        capture_session_add_event(&capture->session, "warning", "rig", warnings[i]);
        if (!session_suspect(capture->session.store, warnings[i], error)) {
            capture_free(capture);
            return NULL;
        }
    }
    g_autofree char *message = g_strdup_printf("resumed: %d of %d shots are done",
                                               capture->session.n_done, capture->session.n_shots);
    capture_session_add_event(&capture->session, "info", "capture", message);
    capture_lasers_note_all(&capture->lasers);
    capture_begin_soon(capture);
    return capture;
}

void capture_free(Capture *capture) {
    if (!capture)
        return;
    struct capture_session *session = &capture->session;
    clock_cancel(session->devices->clock, &capture->starter);
    if (capture->sequencer)
        sequencer_stop(capture->sequencer, NULL);
    if (session->clock.since_us >= 0)
        capture_session_save(session->store, "clock_s", capture_session_now_s(session));
    intake_free(capture->intake);
    flights_clear(&capture->flights);
    sequencer_free(capture->sequencer);
    capture_session_close(session);
    capture_marks_forget(&capture->marks);
    for (int c = 0; c < RIG_MAX_CAMERAS; c++)
        latest_picture_clear(&capture->latest[c]);
    g_clear_handle_id(&capture->changed_source, g_source_remove);
    run_shots_clear(&capture->run);
    time_left_clear(&capture->time_left);
    capture_bytes_clear(&capture->bytes);
    g_free(capture->reason);
    g_free(capture->doing);
    g_free(capture);
}

void capture_pause(Capture *capture) {
    if (capture->state != CAPTURE_RUNNING && capture->state != CAPTURE_HOMING)
        return;
    capture_set_state(capture, CAPTURE_PAUSING);
    if (capture->starter != 0) {
        clock_cancel(capture->session.devices->clock, &capture->starter);
        run_clock_start(&capture->session.clock);
        capture_rest_for_user(capture);
        return;
    }
    sequencer_pause(capture->sequencer);
}

gboolean capture_finish(Capture *capture, GError **error) {
    if (capture->state == CAPTURE_DONE || capture->state == CAPTURE_ABORTED)
        return device_error_set(
            error, DEVICE_ERROR_BUSY, NULL, "the session has ended already%s",
            capture->state == CAPTURE_ABORTED ? "; resume it first (mesorig resume)" : "");
    if (capture->state == CAPTURE_PAUSED) {
        capture_finish_now(capture);
        return TRUE;
    }
    capture->finishing = TRUE;
    capture_pause(capture);
    return TRUE;
}

gboolean capture_continue(Capture *capture, GError **error) {
    const Interlock *open = sequencer_open_interlock(capture->sequencer);
    if (capture->state != CAPTURE_PAUSED) {
        device_error_set(error, DEVICE_ERROR_BUSY, NULL, "the session is not paused%s",
                         capture->state == CAPTURE_ABORTED ? " but aborted: resume it" : "");
        return FALSE;
    }
    if (open) {
        const gboolean lost = interlock_is_lost(open);
        return device_error_set(error, DEVICE_ERROR_INTERLOCK, NULL,
                                "interlock %s %s" ERROR_ADVICE "%s", open->device.name,
                                lost ? "does not answer, so it counts as open" : "is open",
                                lost ? "check its board and cables first" : "close it first");
    }
    if (!capture_mount_answer(&capture->mounts, &capture->session, error))
        return FALSE;
    capture_marks_accept(&capture->marks, &capture->session);
    capture->finishing = FALSE;
    capture_session_add_event(&capture->session, "info", "capture", "continued");
    capture_begin_soon(capture);
    return TRUE;
}

void capture_abort(Capture *capture) {
    if (capture->state == CAPTURE_DONE || capture->state == CAPTURE_ABORTED)
        return;
    g_autoptr(GError) error = NULL;
    clock_cancel(capture->session.devices->clock, &capture->starter);
    if (!sequencer_stop(capture->sequencer, &error))
        capture_session_add_event(&capture->session, "error", "rig", error->message);
    capture_drop_flights(capture);
    capture_session_add_event(
        &capture->session, "info", "capture",
        "aborted; all stored frames are kept, and the session can be resumed");
    capture_come_to_rest(capture, CAPTURE_ABORTED);
}

static double time_left_s(const Capture *capture) {
    const struct time_left *left = &capture->time_left;
    const struct capture_session *session = &capture->session;
    if (capture->state == CAPTURE_DONE || !left->plan)
        return capture->state == CAPTURE_DONE ? 0 : left->predicted_s;
    if (capture->state == CAPTURE_PAUSED || capture->state == CAPTURE_ABORTED) {
        guint n;
        const struct session_shot *const *shots = run_shots_left(&capture->run, &n);
        /* After a pause, the same run continues, and the times that it has measured are used. After
         * an abort, a new run takes the shots, and it has measured no times yet. */
        return time_left_of_new_run_s(left, session, shots, n, capture->state == CAPTURE_PAUSED);
    }
    return time_left_at_s(left, capture_session_now_s(session));
}

static gboolean waits_for_somebody(const Capture *capture) {
    return capture->state == CAPTURE_PAUSED && capture->mounts.wanted >= 0;
}

/* Returns a text such as "homing sweep30, sweep60 (2 of 4 axes are done)". */
static char *homing_text(const Capture *capture) {
    const struct devices *devices = capture->session.devices;
    const Axis *axes[DEVICES_POSITIONERS + RIG_MAX_LASERS];
    g_autoptr(GString) left = g_string_new(NULL);
    int n = 0, done = 0;
    for (int i = 0; i < DEVICES_POSITIONERS; i++)
        axes[i] = devices_positioner(devices, i);
    const int n_lasers = devices->geometry.n_lasers;
    for (int i = 0; i < n_lasers; i++)
        axes[DEVICES_POSITIONERS + i] =
            rig_laser_unit(&devices->timing, i) == i ? devices->sweeps[i] : NULL;
    for (int i = 0; i < DEVICES_POSITIONERS + n_lasers; i++) {
        if (!axes[i])
            continue;
        n++;
        done += axis_is_homed(axes[i]);
        if (!axis_is_homed(axes[i]))
            g_string_append_printf(left, "%s%s", left->len ? ", " : "", axes[i]->device.name);
    }
    return left->len ? g_strdup_printf("homing %s (%d of %d axes are done)", left->str, done, n)
                     : g_strdup("homing the axes");
}

static char *doing_now(const Capture *capture) {
    int sub, n;
    const struct rig *rig = &capture->session.devices->geometry;
    const struct session_shot *shot = sequencer_shot(capture->sequencer, &sub, &n);
    if (capture->state == CAPTURE_HOMING)
        return homing_text(capture);
    if (waits_for_somebody(capture))
        return g_strdup("waiting for a laser to be mounted");
    if (!shot)
        return g_strdup(capture->state == CAPTURE_DONE      ? "done"
                        : capture->state == CAPTURE_PAUSED  ? "paused"
                        : capture->state == CAPTURE_ABORTED ? "aborted"
                                                            : "writing the last frames");
    if (shot->kind == SHOT_DARK)
        return g_strdup_printf("dark frames, %d of %d", sub + 1, n);
    const char *source =
        shot->kind == SHOT_LAMP ? rig->lamps[shot->device].name : rig->lasers[shot->device].name;
    g_autofree char *arm = capture->session.devices->arm
                               ? g_strdup_printf(", arm %g°", rig_arm_deg(rig, shot->cameras))
                               : g_strdup("");
    return g_strdup_printf("%s at turntable %g°, arc %g°%s: %s %d of %d", source,
                           shot->turntable_deg, shot->arc_deg, arm,
                           shot->kind == SHOT_LAMP ? "exposure" : "step", sub + 1, n);
}

void capture_get_status(Capture *capture, struct capture_status *ret) {
    g_free(capture->doing);
    capture->doing = doing_now(capture);
    *ret = (struct capture_status){
        .state = capture->state,
        .shot = sequencer_last_shot(capture->sequencer),
        .fault = capture->state == CAPTURE_PAUSED ? capture->fault : CAPTURE_FAULT_NONE,
        .reason = capture->state == CAPTURE_PAUSED ? capture->reason : NULL,
        .prompt = waits_for_somebody(capture) ? capture->reason : NULL,
        .doing = capture->doing,
        .shots = capture->session.n_shots,
        .shots_done = capture->session.n_done,
        .frames = capture->totals.frames,
        .retakes = capture->totals.retakes,
        .elapsed_s = capture_session_now_s(&capture->session),
        .left_s = time_left_s(capture),
        .bytes_stored = (guint64)capture->bytes.stored,
        .bytes_expected = (guint64)MAX(capture->bytes.expected, 0),
        .predicted_s = capture->time_left.predicted_s,
        .lower_bound_s = capture->time_left.lower_bound_s,
    };
}

const struct capture_thumbnail *capture_thumbnail(Capture *capture, int camera) {
    if (camera < 0 || camera >= capture->session.devices->geometry.n_cameras)
        return NULL;
    return latest_picture_thumbnail(&capture->latest[camera]);
}

double capture_picture_time_s(const Capture *capture, int camera) {
    const struct latest_picture *latest = &capture->latest[camera];
    return latest->frame ? latest->time_s : -1;
}
