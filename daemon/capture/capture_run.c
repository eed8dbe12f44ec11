#include "capture_private.h"

#include <math.h>

#include "base/data_error.h"
#include "capture_check.h"

#define CHANGED_MS 100
/* If the mean of a picture above dark is below this part of full scale in all cameras, the lamp
 * gives no light. */
#define LAMP_SIGNAL 0.0005
/* A warning is given if a larger part of the pixels of a picture is saturated in the shortest
 * exposure. */
#define SATURATED_PART 0.001
/* A warning is given if the mean of a dark frame above black is a larger part of full scale. */
#define DARK_PART 0.05

static gboolean notify_changed(gpointer data) {
    Capture *capture = data;
    capture->changed_source = 0;
    capture->changed_at_us = g_get_monotonic_time();
    if (capture->callbacks.changed)
        capture->callbacks.changed(capture, capture->callbacks.data);
    return G_SOURCE_REMOVE;
}

static void changed(Capture *capture) {
    if (capture->changed_source != 0 || !capture->callbacks.changed)
        return;
    gint64 since_ms = (g_get_monotonic_time() - capture->changed_at_us) / 1000;
    guint delay_ms = since_ms >= CHANGED_MS ? 0 : (guint)(CHANGED_MS - since_ms);
    capture->changed_source = g_timeout_add(delay_ms, notify_changed, capture);
}

static void add_event(Capture *capture, const char *level, const char *source,
                      const char *message) {
    capture_session_add_event(&capture->session, level, source, message);
}

static const char *const state_names[] = {
    [CAPTURE_HOMING] = "running", [CAPTURE_RUNNING] = "running", [CAPTURE_PAUSING] = "running",
    [CAPTURE_PAUSED] = "paused",  [CAPTURE_DONE] = "done",       [CAPTURE_ABORTED] = "aborted",
};

void capture_set_state(Capture *capture, enum capture_state state) {
    gboolean kept = state_names[state] == state_names[capture->state];
    capture->state = state;
    if (!kept)
        session_set_value(capture->session.store, "state", state_names[state], NULL);
    changed(capture);
}

void capture_drop_flights(Capture *capture) {
    const struct rig_timing *timing = &capture->session.devices->timing;
    const struct session_shot *under_way = sequencer_last_shot(capture->sequencer);
    if (under_way)
        capture_lasers_note(&capture->lasers, timing, under_way);
    for (guint i = 0; i < flights_n(&capture->flights); i++)
        capture_lasers_note(&capture->lasers, timing, flights_at(&capture->flights, i)->shot);
    intake_discard(capture->intake);
    flights_clear(&capture->flights);
}

static void flush_limits(Capture *capture, struct event_limit *limits, const char *what) {
    const struct rig *rig = &capture->session.devices->geometry;
    for (int c = 0; c < rig->n_cameras; c++)
        event_limit_flush(&limits[c], &capture->session, rig->cameras[c].name, what);
}

/* Ends a run when nothing moves any more. Adds events for the warnings that were only counted,
 * stops the session's clock, and stores the totals and the state. If the session is done, also adds
 * advice about exposures. */
void capture_come_to_rest(Capture *capture, enum capture_state state) {
    flush_limits(capture, capture->retake_limits, "refused or lost and taken again");
    flush_limits(capture, capture->saturated_limits, "saturated");
    run_clock_stop(&capture->session.clock);
    run_totals_save(&capture->totals, &capture->session);
    g_autofree char *advice =
        state == CAPTURE_DONE ? exposure_advice(capture->session.store, 0) : NULL;
    if (advice)
        add_event(capture, "warning", "exposures", advice);
    capture_set_state(capture, state);
}

void capture_pause_for(Capture *capture, enum capture_fault fault, const char *source,
                       const char *reason) {
    capture_drop_flights(capture);
    capture->fault = fault;
    g_free(capture->reason);
    capture->reason = g_strdup(reason);
    session_set_value(capture->session.store, "reason", reason, NULL);
    add_event(capture, fault == CAPTURE_FAULT_NONE ? "info" : "error", source, reason);
    capture_come_to_rest(capture, CAPTURE_PAUSED);
}

/* Makes the rig safe and pauses because of a fault that the sequencer cannot see: a fault of the
 * disk, or one that the frames show. */
static void stop_for(Capture *capture, enum capture_fault fault, const char *source,
                     const char *reason) {
    g_autoptr(GError) error = NULL;
    gboolean safe = sequencer_stop(capture->sequencer, &error);
    g_autofree char *text =
        safe ? g_strdup(reason)
             : g_strdup_printf(DEVICES_UNSAFE ": %s. Switch it off by hand first. %s",
                               error->message, reason);
    capture_pause_for(capture, safe ? fault : CAPTURE_FAULT_RIG, source, text);
}

static void stop_for_disk(Capture *capture, const GError *error) {
    const char *path = session_path(capture->session.store);
    g_autofree char *size = g_format_size(capture_free_bytes(path));
    g_autofree char *reason =
        capture_is_full(path, error)
            ? g_strdup_printf("The disk is full: %s (%s free at %s). Nothing was lost; free some "
                              "space, then continue.",
                              error_details_what(error), size, path)
            : g_strdup_printf("The session cannot be written: %s. Check the disk, then continue.",
                              error->message);
    stop_for(capture, CAPTURE_FAULT_RIG, "disk", reason);
}

/* Marks the shots that are still to be taken as left out. Returns their number, or −1 with an
 * error. */
static int leave_rest_out(struct capture_session *session, const char *note, GError **error) {
    int n = 0;
    for (guint i = 0; i < session->shots->len; i++) {
        struct session_shot *shot = session->shots->pdata[i];
        if (shot->state != SHOT_PLANNED)
            continue;
        if (!session_commit_shot(session->store, shot->id, SHOT_SKIPPED, NULL, 0, note, error))
            return -1;
        shot->state = SHOT_SKIPPED;
        g_free(shot->note);
        shot->note = g_strdup(note);
        n++;
    }
    return n;
}

void capture_finish_now(Capture *capture) {
    static const char note[] = SESSION_LEFT_OUT " the capture was ended as good enough";
    struct capture_session *session = &capture->session;
    g_autoptr(GError) error = NULL;
    capture_drop_flights(capture);
    capture->finishing = FALSE;
    const int n_left = session_set_value(session->store, CAPTURE_FINISHED_KEY, note, &error)
                           ? leave_rest_out(session, note, &error)
                           : -1;
    if (n_left < 0) {
        stop_for_disk(capture, error);
        return;
    }
    capture_session_count(session);
    g_clear_pointer(&capture->reason, g_free);
    capture->fault = CAPTURE_FAULT_NONE;
    g_autofree char *message = g_strdup_printf(
        "ended as good enough: %d shots are done, and %d are left out", session->n_done, n_left);
    add_event(capture, "info", "capture", message);
    session_remove_unfinished(session->store);
    capture_come_to_rest(capture, CAPTURE_DONE);
}

void capture_rest_for_user(Capture *capture) {
    if (capture->finishing)
        capture_finish_now(capture);
    else
        capture_pause_for(capture, CAPTURE_FAULT_NONE, "capture", "paused by the user");
}

/* Called when all chosen shots are stored. Chooses more shots, or ends the session if there are
 * none. */
static void end_round(Capture *capture) {
    Adaptive *adaptive = capture->session.adaptive;
    if (adaptive && !adaptive_is_over(adaptive)) {
        adaptive_choose(adaptive);
        return;
    }
    add_event(capture, "info", "capture", "all shots are taken");
    session_remove_unfinished(capture->session.store); /* files that a failed disk has left */
    capture_come_to_rest(capture, CAPTURE_DONE);
}

/* Pauses with a prompt for the mounting that the next shot needs. The rig is already safe. */
static void pause_for_mounting(Capture *capture) {
    guint n;
    const char *unit;
    const struct session_shot *const *shots = run_shots_left(&capture->run, &n);
    g_autofree char *prompt =
        capture_mount_ask(&capture->mounts, &capture->session, shots, n, &unit);
    if (prompt)
        capture_pause_for(capture, CAPTURE_FAULT_NONE, unit, prompt);
}

static void when_all_is_committed(Capture *capture) {
    const struct run_shots *run = &capture->run;
    /* After a pause, some shots are held in flight until the lasers are checked (capture_lasers.h).
     * If a further pause has postponed a sweep that checks a laser, the held shots cannot be stored
     * now, and the capture does not wait for them. */
    const gboolean held = run->n_committed < run->n_held && flights_are_back(&capture->flights);
    if (!capture->all_taken || !(flights_n(&capture->flights) == 0 || held))
        return;
    capture->all_taken = FALSE;
    if (run->n_committed == run->list->len)
        end_round(capture);
    else if (run->n_committed == run->leg->len && !capture->finishing)
        pause_for_mounting(capture);
    else
        capture_rest_for_user(capture);
}

/* Stores a shot in the session. If this fails, the capture is paused, no shot is in flight any
 * more, and the result is FALSE. */
static gboolean commit(Capture *capture, const struct flight *flight) {
    struct capture_session *session = &capture->session;
    const struct rig *rig = &session->devices->geometry;
    struct run_shots *run = &capture->run;
    struct session_frame frames[RIG_MAX_CAMERAS];
    g_autoptr(GString) note = g_string_new(flight->shot->note);
    g_autoptr(GError) error = NULL;
    gboolean any = FALSE;
    int n = 0;
    for (int c = 0; c < rig->n_cameras; c++) {
        if (camera_set_has(flight->shot->cameras, c))
            frames[n++] = flight->frames[c];
        if (flight->saturated[c] == 0)
            continue;
        g_string_append(note, any ? ", " : note->len > 0 ? "; saturated: " : "saturated: ");
        g_string_append_printf(note, "%s %" G_GINT64_FORMAT " px", rig->cameras[c].name,
                               flight->saturated[c]);
        any = TRUE;
    }
    if (!session_commit_shot(session->store, flight->shot->id, SHOT_DONE, frames, n,
                             note->len > 0 ? note->str : NULL, &error)) {
        stop_for_disk(capture, error);
        return FALSE;
    }
    ((struct session_shot *)flight->shot)->state = SHOT_DONE;
    if (session->adaptive)
        adaptive_take(session->adaptive, flight->shot, frames, n);
    capture_lasers_clear(&capture->lasers, &session->devices->timing, flight->shot);
    session->n_done++;
    run->n_committed++;
    capture_bytes_add(&capture->bytes, session, flight->shot, frames, n, run->n_committed,
                      run->n_committed == run->list->len);
    run_totals_save_if_due(&capture->totals, session);
    return TRUE;
}

/* Returns a camera whose picture was taken again and shows no more than min_dn above dark, or −1 if
 * there is none. The lamp may have failed before that picture. A camera whose first picture is dark
 * is not returned, because it may see a black object. */
static int find_blind(const struct flight *flight, int n_cameras, double min_dn) {
    for (int c = 0; c < n_cameras; c++)
        if (camera_set_has(flight->shot->cameras, c) && flight->frames[c].retakes > 0 &&
            !(flight->signals_dn[c] > min_dn))
            return c;
    return -1;
}

/* If the lamp of a shot gave no light, pauses and returns TRUE. Otherwise returns FALSE. */
static gboolean stop_if_dark(Capture *capture, const struct flight *flight) {
    int bits = 16;
    for (int c = 0; c < capture->session.devices->geometry.n_cameras; c++)
        if (camera_set_has(flight->shot->cameras, c))
            bits = MIN(bits, capture->session.devices->cameras[c]->format.bits);
    const struct rig *rig = &capture->session.devices->geometry;
    const double min_dn = LAMP_SIGNAL * ((1 << bits) - 1);
    const gboolean lit = flight->signal_dn > min_dn;
    const int blind = lit ? find_blind(flight, rig->n_cameras, min_dn) : -1;
    if (flight->shot->kind != SHOT_LAMP || (lit && blind < 0))
        return FALSE;
    const char *lamp = rig->lamps[flight->shot->device].name;
    g_autofree char *seen =
        lit ? g_strdup_printf("camera %s saw no more than its dark level in a picture that "
                              "was taken again",
                              rig->cameras[blind].name)
            : g_strdup("no camera saw more than its dark level");
    g_autofree char *reason = g_strdup_printf(
        "lamp %s gives no light: %s. Check the lamp, its fuse and its relay, then continue.", lamp,
        seen);
    stop_for(capture, CAPTURE_FAULT_SESSION, lamp, reason);
    return TRUE;
}

/* Stores shots whose results have returned from all cameras. They are stored in the planned order,
 * so a shot waits for the earlier ones even if its own results are complete. */
static void commit_what_is_back(Capture *capture) {
    struct flights *flights = &capture->flights;
    const struct flight *flight;
    guint n;
    while ((flight = flights_at(flights, 0)) &&
           flights_first_are_back(flights, n = run_shots_n_together(&capture->run))) {
        for (guint i = 0; i < n; i++)
            if (stop_if_dark(capture, flights_at(flights, i)))
                return;
        g_autoptr(GError) error = NULL;
        g_autofree char *moved = capture_marks_check(&capture->marks, &capture->session,
                                                     flight->shot, flight->marks, &error);
        if (error) {
            stop_for_disk(capture, error);
            return;
        }
        if (moved) {
            stop_for(capture, CAPTURE_FAULT_RIG, "fiducials", moved);
            return;
        }
        if (!commit(capture, flight))
            return;
        flights_drop_first(flights);
    }
    changed(capture);
    when_all_is_committed(capture);
}

static void note_saturated(Capture *capture, struct flight *flight,
                           const struct intake_result *result) {
    const struct rig_camera *camera =
        &capture->session.devices->geometry.cameras[result->frame.camera];
    if (result->saturated <= SATURATED_PART * camera->width * camera->height)
        return;
    flight->saturated[result->frame.camera] = result->saturated;
    g_autofree char *message = g_strdup_printf(
        "%" G_GINT64_FORMAT " pixels are saturated in the shortest exposure under lamp %s; a "
        "shorter exposure in [capture] exposures_us would show them",
        result->saturated, capture->session.devices->geometry.lamps[result->shot->device].name);
    event_limit_warn(&capture->saturated_limits[result->frame.camera], &capture->session,
                     camera->name, message);
}

static void warn_of_light(Capture *capture, const struct intake_result *result) {
    const struct camera_format *format =
        &capture->session.devices->cameras[result->frame.camera]->format;
    double above = result->dark_dn - format->black_level;
    if (above <= DARK_PART * ((1 << format->bits) - 1))
        return;
    g_autofree char *message = g_strdup_printf("the dark frames are not dark: %.0f DN above black "
                                               "on average; keep light from outside away, or "
                                               "correct the camera's black level",
                                               above);
    add_event(capture, "warning",
              capture->session.devices->geometry.cameras[result->frame.camera].name, message);
}

static void on_result(const struct intake_result *result, gpointer data) {
    Capture *capture = data;
    int camera = result->frame.camera;
    struct flight *flight = flights_find(&capture->flights, result->shot);
    if (!flight)
        return;
    if (result->error) {
        stop_for_disk(capture, result->error);
        return;
    }
    if (result->laser_seen) {
        const char *laser = capture->session.devices->geometry.lasers[result->shot->device].name;
        g_autofree char *reason = g_strdup_printf(
            "laser %s stays on: camera %s still saw its light after it was switched "
            "off. Cut the power of the laser, check its relay, then continue.",
            laser, capture->session.devices->geometry.cameras[camera].name);
        stop_for(capture, CAPTURE_FAULT_RIG, laser, reason);
        return;
    }
    if (result->uneven) {
        const char *lamp = capture->session.devices->geometry.lamps[result->shot->device].name;
        g_autofree char *reason =
            g_strdup_printf("lamp %s was not equally bright in all exposures of a shot, according "
                            "to camera %s. Check the lamp, its fuse and its relay, then continue.",
                            lamp, capture->session.devices->geometry.cameras[camera].name);
        stop_for(capture, CAPTURE_FAULT_SESSION, lamp, reason);
        return;
    }
    flight_take(flight, result);
    if (result->shot->kind == SHOT_LAMP)
        note_saturated(capture, flight, result);
    if (result->shot->kind == SHOT_DARK)
        warn_of_light(capture, result);
    commit_what_is_back(capture);
}

static void on_room(gpointer data) {
    Capture *capture = data;
    sequencer_poke(capture->sequencer);
}

static void on_homed(gpointer data) {
    Capture *capture = data;
    const struct capture_session *session = &capture->session;
    time_left_predict(&capture->time_left, 0, capture_session_now_s(session));
    /* “mesorig info --history” reads this event. The time between the previous event and this one
     * was used for homing. */
    session_add_event(session->store, capture_session_now_s(session), "info", "capture",
                      SESSION_EVENT_HOMED, NULL);
    if (capture->state == CAPTURE_HOMING)
        capture_set_state(capture, CAPTURE_RUNNING);
}

static gboolean on_may_trigger(gpointer data) {
    Capture *capture = data;
    return !intake_is_full(capture->intake);
}

static void on_frame(const struct taken_frame *taken, gpointer data) {
    Capture *capture = data;
    const struct session_conf *conf = &capture->session.conf;
    const struct session_shot *shot = taken->shot;
    const double time_s = run_clock_at_s(&capture->session.clock, taken->frame->exposure_end_us);
    struct taken_frame timed = *taken;
    timed.row.captured_s = time_s;
    flights_add(&capture->flights, shot);
    intake_take(capture->intake, &timed);
    capture->totals.frames++;
    if (taken->sub + 1 == shot_n_frames(conf, shot)) {
        const guint n = capture->run.n_committed + flights_n(&capture->flights);
        const struct session_shot *exposed = capture->run.list->pdata[n - 1];
        time_left_learn(&capture->time_left, exposed->kind, n, time_s);
        time_left_predict(&capture->time_left, n, time_s);
    }
    if (shot->kind != SHOT_DARK &&
        (shot->kind != SHOT_SWEEP || shot_sweep_step(conf, shot, taken->sub) < shot->sweep_steps))
        latest_picture_set(&capture->latest[taken->row.camera], taken->frame, time_s);
    changed(capture);
}

static void on_retake(int camera, const char *why, gint64 shortened_us, gpointer data) {
    Capture *capture = data;
    capture->totals.retakes++;
    exposure_advice_count(&capture->totals.exposures, shortened_us);
    g_autofree char *message = g_strdup_printf("frame taken again: %s", why);
    event_limit_warn(&capture->retake_limits[camera], &capture->session,
                     capture->session.devices->geometry.cameras[camera].name, message);
}

static void on_finished(gpointer data) {
    Capture *capture = data;
    capture->all_taken = TRUE;
    when_all_is_committed(capture);
}

static void on_fault(const char *source, const char *reason, gboolean rig, gpointer data) {
    capture_pause_for(data, rig ? CAPTURE_FAULT_RIG : CAPTURE_FAULT_SESSION, source, reason);
}

/* Reports an unsafe device, even if no shots are being taken, unless the reason for the pause says
 * so already. If the session is paused, the report is also added to the reason for the pause, so
 * that a user who looks later sees it. */
static void on_unsafe(const char *source, const char *reason, gpointer data) {
    Capture *capture = data;
    if (capture->reason && strstr(capture->reason, reason))
        return;
    add_event(capture, "error", source, reason);
    if (capture->state != CAPTURE_PAUSED)
        return;
    capture->fault = CAPTURE_FAULT_RIG;
    char *both = g_strdup_printf("%s %s", capture->reason, reason);
    g_free(capture->reason);
    capture->reason = both;
    session_set_value(capture->session.store, "reason", both, NULL);
    changed(capture);
}

/* Adds the remaining shots of a round to the run's list, in the order of the round, and sets their
 * passes. The passes are computed from all shots of the round, including those that are done. The
 * pictures are therefore the same as without an interruption. Passes are numbered from number + 1.
 * Returns the number of the last pass. */
static int list_round(Capture *capture, int round, int number) {
    const struct capture_session *session = &capture->session;
    const struct rig *rig = &session->devices->geometry;
    const struct rig_timing *timing = &session->devices->timing;
    g_autoptr(GPtrArray) shots = g_ptr_array_new();
    for (guint i = 0; i < session->shots->len; i++) {
        struct session_shot *shot = session->shots->pdata[i];
        if (shot->state != SHOT_SKIPPED &&
            (!session->adaptive || adaptive_round_of(session->adaptive, shot) == round))
            g_ptr_array_add(shots, shot);
    }
    struct session_shot **list = (struct session_shot **)shots->pdata;
    /* The first round has the order of the plan. The shots of a later round are scattered over the
     * plan, so they are ordered anew. */
    if (round > 1)
        plan_order_left(list, (int)shots->len, &session->conf, rig, timing);
    number = passes_set(list, (int)shots->len, &session->conf, rig, timing, number);
    for (guint i = 0; i < shots->len; i++)
        if (list[i]->state == SHOT_PLANNED)
            g_ptr_array_add(capture->run.list, list[i]);
    return number;
}

/* Lists the shots that this run takes, and predicts their time, including homing. */
static void list_remaining(Capture *capture) {
    struct capture_session *session = &capture->session;
    struct run_shots *run = &capture->run;
    capture_session_count(session);
    run_shots_begin(run);
    const int rounds = session->adaptive ? adaptive_rounds(session->adaptive) : 1;
    for (int round = 1, number = 0; round <= rounds; round++)
        number = list_round(capture, round, number);
    run->n_held = capture_lasers_put_first(&capture->lasers, &capture->mounts,
                                           &session->devices->timing, run->list);
    guint n;
    const struct session_shot *const *shots = run_shots_left(run, &n);
    time_left_begin(&capture->time_left, session, shots, n);
}

static void begin(gpointer data) {
    Capture *capture = data;
    struct capture_session *session = &capture->session;
    struct run_shots *run = &capture->run;
    capture->starter = 0;
    capture->all_taken = FALSE;
    run_clock_start(&session->clock);
    g_autofree char *finished = session_value(session->store, CAPTURE_FINISHED_KEY);
    if (finished) { /* if the daemon was killed while it left shots out, some of them remain */
        if (run->list->len > 0)
            capture_finish_now(capture);
        else
            capture_come_to_rest(capture, CAPTURE_DONE);
        return;
    }
    if (run->list->len == 0) {
        if (session->adaptive && !adaptive_is_over(session->adaptive))
            adaptive_choose(session->adaptive);
        else
            capture_come_to_rest(capture, CAPTURE_DONE);
        return;
    }
    const guint n = capture_mount_reach(&capture->mounts, &session->devices->timing, run->list);
    run_shots_set_leg(run, n);
    if (n == 0)
        pause_for_mounting(capture);
    else
        sequencer_start(capture->sequencer, run->leg);
}

/* The run starts later, from the main loop, because the caller does not expect events before this
 * function has returned. */
void capture_begin_soon(Capture *capture) {
    g_clear_pointer(&capture->reason, g_free);
    list_remaining(capture);
    capture_set_state(capture, CAPTURE_HOMING);
    capture->starter = clock_call_in(capture->session.devices->clock, 0, begin, capture);
}

static void stop_for_choice(Capture *capture, const GError *error) {
    if (!g_error_matches(error, DATA_ERROR, DATA_ERROR_INVALID)) {
        stop_for_disk(capture, error);
        return;
    }
    g_autofree char *reason = g_strdup_printf("The next shots cannot be chosen: %s. Abort the "
                                              "session, then resume it.",
                                              error->message);
    stop_for(capture, CAPTURE_FAULT_SESSION, "disk", reason);
}

/* Called when the next shots were chosen. If the session was aborted or paused meanwhile, nothing
 * is done. The shots are then chosen again when the session is continued. */
static void on_chosen(int n, const char *of_lasers, const char *of_lights, const GError *error,
                      gpointer data) {
    Capture *capture = data;
    const gboolean pausing = capture->state == CAPTURE_PAUSING;
    if (capture->state != CAPTURE_RUNNING && capture->state != CAPTURE_HOMING && !pausing)
        return;
    if (error) {
        stop_for_choice(capture, error);
        return;
    }
    capture_session_count(&capture->session);
    if (of_lasers)
        add_event(capture, "info", "lasers", of_lasers);
    if (of_lights)
        add_event(capture, "info", "lights", of_lights);
    if (pausing)
        capture_rest_for_user(capture);
    else if (n > 0) {
        /* begin() starts the clock again */
        run_clock_stop(&capture->session.clock);
        capture_begin_soon(capture);
    } else
        end_round(capture);
}

const struct adaptive_hooks capture_adaptive_hooks = {.chosen = on_chosen};
const struct intake_hooks capture_intake_hooks = {.result = on_result, .room = on_room};
const struct sequencer_hooks capture_sequencer_hooks = {
    .homed = on_homed,
    .may_trigger = on_may_trigger,
    .frame = on_frame,
    .retake = on_retake,
    .finished = on_finished,
    .fault = on_fault,
    .unsafe = on_unsafe,
};
