#include "capture_private.h"

#include <math.h>
#include <string.h>
#include <sys/resource.h>

#include "base/data_error.h"
#include "capture_bytes.h"
#include "capture_check.h"
#include "capture_lasers.h"
#include "capture_marks.h"
#include "capture_mount.h"

#define CHANGED_MS 100
/* Events of a camera's retakes and saturated pictures are rate-limited. */
#define EVENT_INTERVAL_S 60
#define SAVE_CLOCK_S     10
/* Minimum mean above dark, as a part of full scale, that a lamp must produce in at least one
 * camera. */
#define LAMP_SIGNAL 0.0005
/* Maximum part of a picture that may be saturated in the shortest exposure without a warning. */
#define SATURATED_PART 0.001
/* Maximum mean of a dark frame above black, as a part of full scale. */
#define DARK_PART 0.05

static double session_clock_s(const Capture *capture, gint64 at_us) {
    if (capture->since_us < 0)
        return capture->clock_base_s;
    return capture->clock_base_s + (at_us - capture->since_us) * 1e-6;
}

double capture_now_s(const Capture *capture) {
    return session_clock_s(capture, clock_now_us(capture->devices->clock));
}

void capture_start_clock(Capture *capture) {
    capture->since_us = clock_now_us(capture->devices->clock);
}

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

/* Also stores the event in the session, unless the disk fails. */
void capture_add_event(Capture *capture, const char *level, const char *source,
                       const char *message) {
    session_add_event(capture->session, capture_now_s(capture), level, source, message, NULL);
    if (capture->callbacks.event)
        capture->callbacks.event(capture, level, source, message, capture->callbacks.data);
}

static void report_rate_limited(Capture *capture, struct event_limit *limit, const char *source,
                                const char *message) {
    if (limit->reported && capture_now_s(capture) < limit->reported_s + EVENT_INTERVAL_S) {
        limit->suppressed++;
        return;
    }
    g_autofree char *text =
        limit->suppressed == 0
            ? g_strdup(message)
            : g_strdup_printf("%s (and %d more since the last report)", message, limit->suppressed);
    *limit = (struct event_limit){.reported = TRUE, .reported_s = capture_now_s(capture)};
    capture_add_event(capture, "warning", source, text);
}

static void report_suppressed(Capture *capture, struct event_limit *limits, const char *what) {
    for (int c = 0; c < capture->devices->geometry.n_cameras; c++) {
        if (limits[c].suppressed > 0) {
            g_autofree char *text =
                limits[c].suppressed == 1
                    ? g_strdup_printf("1 more frame was %s", what)
                    : g_strdup_printf("%d more frames were %s", limits[c].suppressed, what);
            capture_add_event(capture, "warning", capture->devices->geometry.cameras[c].name, text);
        }
        limits[c] = (struct event_limit){0};
    }
}

void capture_save_value(Session *session, const char *key, double value) {
    char text[G_ASCII_DTOSTR_BUF_SIZE];
    session_set_value(session, key, g_ascii_dtostr(text, sizeof text, value), NULL);
}

/* Stores totals of the whole session for the report, including runs before a resume. */
static void save_clock(Capture *capture) {
    double real_s = (double)(g_get_monotonic_time() - capture->begun_us) * 1e-6;
    struct rusage usage;
    getrusage(RUSAGE_SELF, &usage);
    capture->clock_saved_s = capture_now_s(capture);
    capture_save_value(capture->session, "clock_s", capture->clock_saved_s);
    capture_save_value(capture->session, "real_s", capture->real_base_s + real_s);
    capture_save_value(capture->session, "frames", capture->frames_base + (double)capture->frames);
    capture_save_value(capture->session, "retakes",
                       capture->retakes_base + (double)capture->retakes);
    exposure_advice_save(&capture->exposures, capture->session);
    capture_save_value(capture->session, "capture_peak_memory_mib", (double)usage.ru_maxrss / 1024);
}

static const char *const state_names[] = {
    [CAPTURE_HOMING] = "running", [CAPTURE_RUNNING] = "running", [CAPTURE_PAUSING] = "running",
    [CAPTURE_PAUSED] = "paused",  [CAPTURE_DONE] = "done",       [CAPTURE_ABORTED] = "aborted",
};

void capture_set_state(Capture *capture, enum capture_state state) {
    gboolean kept = state_names[state] == state_names[capture->state];
    capture->state = state;
    if (!kept)
        session_set_value(capture->session, "state", state_names[state], NULL);
    changed(capture);
}

void capture_flight_free(gpointer data) {
    struct flight *flight = data;
    for (int c = 0; c < RIG_MAX_CAMERAS; c++) {
        g_free(flight->frames[c].path);
        g_free(flight->frames[c].sha256);
    }
    if (flight->marks)
        g_array_unref(flight->marks);
    g_free(flight);
}

void capture_clear_flights(Capture *capture) {
    capture_lasers_note(capture);
    intake_discard(capture->intake);
    g_queue_clear_full(&capture->flights, capture_flight_free);
}

/* Sets and stores the state when nothing moves any more. */
void capture_come_to_rest(Capture *capture, enum capture_state state) {
    report_suppressed(capture, capture->retake_limits, "refused or lost and taken again");
    report_suppressed(capture, capture->saturated_limits, "saturated");
    capture->clock_base_s = capture_now_s(capture); /* the clock is stopped from now on */
    capture->since_us = -1;
    save_clock(capture);
    g_autofree char *advice = state == CAPTURE_DONE ? exposure_advice(capture->session, 0) : NULL;
    if (advice)
        capture_add_event(capture, "warning", "exposures", advice);
    capture_set_state(capture, state);
}

void capture_pause_for(Capture *capture, enum capture_fault fault, const char *source,
                       const char *reason) {
    capture_clear_flights(capture);
    capture->fault = fault;
    g_free(capture->reason);
    capture->reason = g_strdup(reason);
    session_set_value(capture->session, "reason", reason, NULL);
    capture_add_event(capture, fault == CAPTURE_FAULT_NONE ? "info" : "error", source, reason);
    capture_come_to_rest(capture, CAPTURE_PAUSED);
}

/* Stops for a fault of the intake or the disk, which the sequencer has not noticed. */
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
    const char *path = session_path(capture->session);
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

/* All chosen shots are taken: chooses more, or finishes the session. */
static void end_round(Capture *capture) {
    if (capture->adaptive && !adaptive_is_over(capture->adaptive)) {
        adaptive_choose(capture->adaptive);
        return;
    }
    capture_add_event(capture, "info", "capture", "all shots are taken");
    session_remove_unfinished(capture->session); /* files that a failed disk has left */
    capture_come_to_rest(capture, CAPTURE_DONE);
}

static gboolean is_back(const struct flight *flight) {
    return flight->back == flight->shot->cameras;
}

/* Returns whether the shots in flight have returned and wait for other shots, which a pause has
 * postponed. */
static gboolean are_held(const Capture *capture) {
    for (const GList *at = capture->flights.head; at; at = at->next)
        if (!is_back(at->data))
            return FALSE;
    return capture->committed < capture->n_held;
}

static void when_all_is_committed(Capture *capture) {
    if (!capture->all_taken || !(g_queue_is_empty(&capture->flights) || are_held(capture)))
        return;
    capture->all_taken = FALSE;
    if (capture->committed == capture->remaining->len) {
        end_round(capture);
    } else if (capture->committed == capture->leg->len) {
        capture_mount_ask(capture);
    } else {
        capture_pause_for(capture, CAPTURE_FAULT_NONE, "capture", "paused by the user");
    }
}

/* Returns FALSE after a fault; nothing is in flight then. */
static gboolean commit(Capture *capture, struct flight *flight) {
    struct session_frame frames[RIG_MAX_CAMERAS];
    g_autoptr(GString) note = g_string_new(flight->shot->note);
    g_autoptr(GError) error = NULL;
    gboolean any = FALSE;
    int n = 0;
    for (int c = 0; c < capture->devices->geometry.n_cameras; c++) {
        if (flight->shot->cameras & 1u << c)
            frames[n++] = flight->frames[c];
        if (flight->saturated[c] == 0)
            continue;
        g_string_append(note, any ? ", " : note->len > 0 ? "; saturated: " : "saturated: ");
        g_string_append_printf(note, "%s %" G_GINT64_FORMAT " px",
                               capture->devices->geometry.cameras[c].name, flight->saturated[c]);
        any = TRUE;
    }
    if (!session_commit_shot(capture->session, flight->shot->id, SHOT_DONE, frames, n,
                             note->len > 0 ? note->str : NULL, &error)) {
        stop_for_disk(capture, error);
        return FALSE;
    }
    ((struct session_shot *)flight->shot)->state = SHOT_DONE;
    if (capture->adaptive)
        adaptive_take(capture->adaptive, flight->shot, frames, n);
    capture_lasers_clear(capture, flight->shot);
    capture->n_done++;
    capture->committed++;
    capture_bytes_add(capture, flight->shot, frames, n);
    if (capture_now_s(capture) > capture->clock_saved_s + SAVE_CLOCK_S)
        save_clock(capture);
    return TRUE;
}

/* Returns a camera whose picture was repeated, possibly after the lamp had died, and which saw
 * nothing while other cameras saw light; −1 if there is none. A camera whose first picture shows
 * nothing may see a black object. */
static int find_blind(const struct flight *flight, int n_cameras, double min_dn) {
    for (int c = 0; c < n_cameras; c++)
        if (flight->shot->cameras & 1u << c && flight->frames[c].retakes > 0 &&
            !(flight->signals_dn[c] > min_dn))
            return c;
    return -1;
}

/* Pauses if the lamp of a shot that has returned gives no light. */
static gboolean stop_if_dark(Capture *capture, const struct flight *flight) {
    int bits = 16;
    for (int c = 0; c < capture->devices->geometry.n_cameras; c++)
        if (flight->shot->cameras & 1u << c)
            bits = MIN(bits, capture->devices->cameras[c]->format.bits);
    const struct rig *rig = &capture->devices->geometry;
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

/* Returns the number of shots that are stored together with the first shot in flight: only this
 * shot, or all shots that are held until the lasers are checked. */
static int n_together(const Capture *capture) {
    if (capture->committed < capture->n_held)
        return (int)(capture->n_held - capture->committed);
    return 1;
}

static gboolean are_back(Capture *capture) {
    for (int i = 0; i < n_together(capture); i++) {
        const struct flight *flight = g_queue_peek_nth(&capture->flights, (guint)i);
        if (!flight || !is_back(flight))
            return FALSE;
    }
    return TRUE;
}

/* Commits in the planned order, even if the worker of a later shot was faster. */
static void commit_what_is_back(Capture *capture) {
    struct flight *flight;
    while ((flight = g_queue_peek_head(&capture->flights)) && are_back(capture)) {
        for (int i = 0, n = n_together(capture); i < n; i++)
            if (stop_if_dark(capture, g_queue_peek_nth(&capture->flights, (guint)i)))
                return;
        g_autoptr(GError) error = NULL;
        g_autofree char *moved = capture_marks_check(capture, flight, &error);
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
        capture_flight_free(g_queue_pop_head(&capture->flights));
    }
    changed(capture);
    when_all_is_committed(capture);
}

static void note_saturated(Capture *capture, struct flight *flight,
                           const struct intake_result *result) {
    const struct rig_camera *camera = &capture->devices->geometry.cameras[result->frame.camera];
    if (result->saturated <= SATURATED_PART * camera->width * camera->height)
        return;
    flight->saturated[result->frame.camera] = result->saturated;
    g_autofree char *message = g_strdup_printf(
        "%" G_GINT64_FORMAT " pixels are saturated in the shortest exposure under lamp %s; a "
        "shorter one in exposures_us would show them",
        result->saturated, capture->devices->geometry.lamps[result->shot->device].name);
    report_rate_limited(capture, &capture->saturated_limits[result->frame.camera], camera->name,
                        message);
}

static void warn_of_light(Capture *capture, const struct intake_result *result) {
    const struct camera_format *format = &capture->devices->cameras[result->frame.camera]->format;
    double above = result->dark_dn - format->black_level;
    if (above <= DARK_PART * ((1 << format->bits) - 1))
        return;
    g_autofree char *message = g_strdup_printf(
        "the dark frames are not dark: %.0f DN above black on average; light enters from outside",
        above);
    capture_add_event(capture, "warning",
                      capture->devices->geometry.cameras[result->frame.camera].name, message);
}

/* Returns NULL if none of its frames has been given to the intake. */
static struct flight *find_flight(Capture *capture, const struct session_shot *shot) {
    for (const GList *at = capture->flights.tail; at; at = at->prev)
        if (((struct flight *)at->data)->shot == shot)
            return at->data;
    return NULL;
}

static void on_result(const struct intake_result *result, gpointer data) {
    Capture *capture = data;
    int camera = result->frame.camera;
    struct flight *flight = find_flight(capture, result->shot);
    if (!flight)
        return;
    if (result->error) {
        stop_for_disk(capture, result->error);
        return;
    }
    if (result->laser_seen) {
        const char *laser = capture->devices->geometry.lasers[result->shot->device].name;
        g_autofree char *reason =
            g_strdup_printf("laser %s stays on: camera %s still saw it after it was switched off. "
                            "Cut its power, check its relay, then continue.",
                            laser, capture->devices->geometry.cameras[camera].name);
        stop_for(capture, CAPTURE_FAULT_RIG, laser, reason);
        return;
    }
    if (result->uneven) {
        const char *lamp = capture->devices->geometry.lamps[result->shot->device].name;
        g_autofree char *reason =
            g_strdup_printf("lamp %s was not equally bright in all exposures of a shot, according "
                            "to camera %s. Check the lamp, its fuse and its relay, then continue.",
                            lamp, capture->devices->geometry.cameras[camera].name);
        stop_for(capture, CAPTURE_FAULT_SESSION, lamp, reason);
        return;
    }
    flight->back |= 1u << camera;
    flight->frames[camera] = result->frame;
    flight->frames[camera].path = g_strdup(result->frame.path);
    flight->frames[camera].sha256 = g_strdup(result->frame.sha256);
    flight->signals_dn[camera] = result->signal_dn;
    flight->signal_dn = MAX(flight->signal_dn, result->signal_dn);
    if (result->marks) {
        if (!flight->marks)
            flight->marks = g_array_new(FALSE, FALSE, sizeof(struct fiducial_seen));
        g_array_append_vals(flight->marks, result->marks->data, result->marks->len);
    }
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

/* Notes the time left, counted from the moment when the first n of the remaining shots had been
 * exposed. */
static void note_left(Capture *capture, guint n, double at_s) {
    capture->left_n = n;
    capture->left_at_s = at_s;
    capture->left_s = capture_left_s(capture, &capture->plan_left[n]);
    capture->left_least_s =
        capture_left_s(capture, &capture->plan_left[MIN(n + 1, capture->remaining->len)]);
}

/* Counts the time since that was last noted as spent on the shot that was exposed. Each further
 * camera that ends the same shot counts what it took longer. */
static void learn(Capture *capture, guint n, double at_s) {
    const struct session_shot *shot = capture->remaining->pdata[n - 1];
    const struct shots_left *left = capture->plan_left;
    capture->learnt[shot->kind].late_s +=
        at_s - capture->left_at_s - (left[capture->left_n].planned_s - left[n].planned_s);
    capture->learnt[shot->kind].n += (int)(n - capture->left_n);
}

static void on_homed(gpointer data) {
    Capture *capture = data;
    note_left(capture, 0, capture_now_s(capture));
    /* For the history: since the last shot, or the beginning, only axes have been homed. */
    session_add_event(capture->session, capture_now_s(capture), "info", "capture",
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
    const struct session_shot *shot = taken->shot;
    struct taken_frame timed = *taken;
    if (!find_flight(capture, shot)) {
        struct flight *flight = g_new0(struct flight, 1);
        flight->shot = shot;
        flight->signal_dn = -HUGE_VAL;
        g_queue_push_tail(&capture->flights, flight);
    }
    const double time_s = session_clock_s(capture, taken->frame->exposure_end_us);
    timed.row.captured_s = time_s;
    intake_take(capture->intake, &timed);
    capture->frames++;
    if (taken->sub + 1 == shot_n_frames(&capture->conf, shot)) {
        const guint n = capture->committed + capture->flights.length;
        learn(capture, n, time_s);
        note_left(capture, n, time_s);
    }
    if (shot->kind != SHOT_DARK &&
        (shot->kind != SHOT_SWEEP ||
         shot_sweep_step(&capture->conf, shot, taken->sub) < shot->sweep_steps)) {
        struct latest_picture *latest = &capture->latest[taken->row.camera];
        frame_unref(latest->frame);
        latest->frame = frame_ref(taken->frame);
        latest->time_s = time_s;
        latest->fresh = FALSE;
    }
    changed(capture);
}

static void on_retake(int camera, const char *why, gint64 shortened_us, gpointer data) {
    Capture *capture = data;
    capture->retakes++;
    exposure_advice_count(&capture->exposures, shortened_us);
    g_autofree char *message = g_strdup_printf("frame taken again: %s", why);
    report_rate_limited(capture, &capture->retake_limits[camera],
                        capture->devices->geometry.cameras[camera].name, message);
}

static void on_finished(gpointer data) {
    Capture *capture = data;
    capture->all_taken = TRUE;
    when_all_is_committed(capture);
}

static void on_fault(const char *source, const char *reason, gboolean rig, gpointer data) {
    capture_pause_for(data, rig ? CAPTURE_FAULT_RIG : CAPTURE_FAULT_SESSION, source, reason);
}

/* Reports this even if no shots are being taken, and adds it to the reason for the pause, which is
 * read later. */
static void on_unsafe(const char *source, const char *reason, gpointer data) {
    Capture *capture = data;
    if (capture->reason && strstr(capture->reason, reason))
        return;
    capture_add_event(capture, "error", source, reason);
    if (capture->state != CAPTURE_PAUSED)
        return;
    capture->fault = CAPTURE_FAULT_RIG;
    char *both = g_strdup_printf("%s %s", capture->reason, reason);
    g_free(capture->reason);
    capture->reason = both;
    session_set_value(capture->session, "reason", both, NULL);
    changed(capture);
}

/* Lists the remaining shots of a round in its order, and sets their passes. The passes are computed
 * from all shots of the round, done or not, so that the same pictures are taken as without an
 * interruption. Returns the number of the last pass. */
static int list_round(Capture *capture, int round, int number) {
    const struct devices *devices = capture->devices;
    g_autoptr(GPtrArray) shots = g_ptr_array_new();
    for (guint i = 0; i < capture->shots->len; i++) {
        struct session_shot *shot = capture->shots->pdata[i];
        if (shot->state != SHOT_SKIPPED &&
            (!capture->adaptive || adaptive_round_of(capture->adaptive, shot) == round))
            g_ptr_array_add(shots, shot);
    }
    struct session_shot **list = (struct session_shot **)shots->pdata;
    /* The plan's order contains the first round, and all shots that may follow it. */
    if (round > 1)
        plan_order_left(list, (int)shots->len, &capture->conf, &devices->geometry,
                        &devices->timing);
    number = passes_set(list, (int)shots->len, &capture->conf, &devices->geometry, &devices->timing,
                        number);
    for (guint i = 0; i < shots->len; i++)
        if (list[i]->state == SHOT_PLANNED)
            g_ptr_array_add(capture->remaining, list[i]);
    return number;
}

/* Lists the shots that this run takes, and predicts their time, including homing. */
static void note_remaining(Capture *capture) {
    const struct devices *devices = capture->devices;
    capture_count(capture);
    g_clear_pointer(&capture->remaining, g_ptr_array_unref);
    capture->remaining = g_ptr_array_new();
    capture->committed = 0;
    const int rounds = capture->adaptive ? adaptive_rounds(capture->adaptive) : 1;
    for (int round = 1, number = 0; round <= rounds; round++)
        number = list_round(capture, round, number);
    capture_lasers_put_first(capture);
    g_free(capture->plan_left);
    capture->plan_left =
        capture_plan_left(capture, (const struct session_shot *const *)capture->remaining->pdata,
                          capture->remaining->len);
    note_left(capture, 0, capture_now_s(capture));
    capture->left_least_s = capture->left_s;
    capture->left_s += plan_homing_s(&devices->geometry, &devices->timing);
}

static void begin(gpointer data) {
    Capture *capture = data;
    capture->starter = 0;
    capture->all_taken = FALSE;
    capture_start_clock(capture);
    if (capture->remaining->len == 0) {
        if (capture->adaptive && !adaptive_is_over(capture->adaptive))
            adaptive_choose(capture->adaptive);
        else
            capture_come_to_rest(capture, CAPTURE_DONE);
        return;
    }
    guint n = capture_mount_reach(capture);
    g_clear_pointer(&capture->leg, g_ptr_array_unref);
    capture->leg = g_ptr_array_sized_new(n);
    for (guint i = 0; i < n; i++)
        g_ptr_array_add(capture->leg, capture->remaining->pdata[i]);
    if (n == 0)
        capture_mount_ask(capture);
    else
        sequencer_start(capture->sequencer, capture->leg);
}

/* Starts from the main loop, because the caller does not expect events before it has returned. */
void capture_begin_soon(Capture *capture) {
    g_clear_pointer(&capture->reason, g_free);
    note_remaining(capture);
    capture_set_state(capture, CAPTURE_HOMING);
    capture->starter = clock_call_in(capture->devices->clock, 0, begin, capture);
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

/* If the session was aborted or paused in the meantime, the choice is made when it is resumed. */
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
    capture_count(capture);
    if (of_lasers)
        capture_add_event(capture, "info", "lasers", of_lasers);
    if (of_lights)
        capture_add_event(capture, "info", "lights", of_lights);
    if (pausing)
        capture_pause_for(capture, CAPTURE_FAULT_NONE, "capture", "paused by the user");
    else if (n > 0) {
        /* begin() starts the clock again */
        capture->clock_base_s = capture_now_s(capture);
        capture->since_us = -1;
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
