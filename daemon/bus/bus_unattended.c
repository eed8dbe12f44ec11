#include "bus_unattended.h"

#include <gio/gio.h>
#include <string.h>

#include "bus_errors.h"
#include "bus_safety.h"
#include "bus_trial.h"

/* Maximum number of times that a session is begun, if this program has ended unexpectedly after
 * each of them. */
#define MAX_STARTS 3
/* If this number of sessions in a row have stopped, the rig is assumed to have a fault. */
#define MAX_STOPPED 2

/* States of a capture. Clients are told when the state changes. */
enum moment { MOMENT_NONE, MOMENT_RUNS, MOMENT_PAUSED, MOMENT_HANDS, MOMENT_FAULT, MOMENT_ENDED };

struct bus_unattended {
    struct bus_rig *rig;
    struct bus_run *run;
    struct bus_jobs *jobs;
    Queue *queue; /* NULL if this daemon keeps no queue */
    /* Item in the state QUEUE_HANDS, QUEUE_TRYING or QUEUE_BEGUN, which is called the present item.
     * NULL if there is none. */
    struct queue_item *item;
    struct bus_trial *trial;
    guint step_id;
    guint stopped_in_row;
    gboolean has_worked; /* a session of the queue has run since the axes were last parked */
    guint n_parking;     /* number of axes that are being parked */
    /* After the queue became empty: the state in which the rig was left. Without a queue: the
     * reason why this daemon has none. Otherwise NULL. */
    char *rest;
    GString *not_parked;    /* axes that could not be parked, and the reasons */
    gboolean held_by_fault; /* the queue is paused because its session is paused by a fault */
    enum moment told;
};

static gint64 now_s(void) {
    return g_get_real_time() / G_USEC_PER_SEC;
}

static guint count_waiting(const struct bus_unattended *at) {
    const GPtrArray *items = queue_items(at->queue);
    guint n = 0;
    for (guint i = 0; i < items->len; i++)
        n += ((const struct queue_item *)items->pdata[i])->state < QUEUE_BEGUN;
    return n;
}

static const char *state_of(const struct bus_unattended *at) {
    if (!at->queue)
        return "none";
    if (queue_paused(at->queue))
        return "paused";
    if (at->item)
        return at->item->state == QUEUE_HANDS ? "hands" : "working";
    return queue_next(at->queue) ? "waiting" : "empty";
}

static GVariant *show_item(const struct queue_item *item) {
    GVariantBuilder to;
    const struct {
        const char *key, *text;
    } texts[] = {{"state", queue_state_names[item->state]},
                 {"name", item->name},
                 {"session_path", item->session_path},
                 {"directory", item->directory},
                 {"prompt", item->prompt},
                 {"message", item->message}};
    g_variant_builder_init(&to, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&to, "{sv}", "number", g_variant_new_uint32(item->id));
    for (gsize i = 0; i < G_N_ELEMENTS(texts); i++)
        g_variant_builder_add(&to, "{sv}", texts[i].key, g_variant_new_string(texts[i].text));
    g_variant_builder_add(&to, "{sv}", "predicted_s", g_variant_new_double(item->predicted_s));
    g_variant_builder_add(&to, "{sv}", "bytes", g_variant_new_uint64(item->bytes));
    g_variant_builder_add(&to, "{sv}", "process", g_variant_new_boolean(item->process));
    g_variant_builder_add(&to, "{sv}", "yes", g_variant_new_boolean(item->yes));
    g_variant_builder_add(&to, "{sv}", "begun_at", g_variant_new_int64(item->begun_at_s));
    g_variant_builder_add(&to, "{sv}", "ended_at", g_variant_new_int64(item->ended_at_s));
    return g_variant_builder_end(&to);
}

static void show_queue(struct bus_unattended *at) {
    GVariantBuilder list;
    const char *state = state_of(at);
    const char *paused = at->queue ? queue_paused(at->queue) : NULL;
    const gboolean rests = !at->queue || strcmp(state, "empty") == 0;
    const char *reason = paused ? paused : rests ? at->rest : NULL;
    g_variant_builder_init(&list, G_VARIANT_TYPE("aa{sv}"));
    for (guint i = 0; at->queue && i < queue_items(at->queue)->len; i++)
        g_variant_builder_add_value(&list, show_item(queue_items(at->queue)->pdata[i]));
    g_object_set(at->rig->object, "queue", g_variant_builder_end(&list), "queue-state", state,
                 "queue-reason", reason ? reason : "", NULL);
    if (!at->run->capture)
        bus_rig1_set_prompt(at->rig->object,
                            at->item && at->item->state == QUEUE_HANDS ? at->item->prompt : "");
}

/* Sends the signal Milestone with the name `what`. item is the session of the queue that the signal
 * is about. If item is NULL, the signal is about the capture under way, if there is one. */
static void tell(struct bus_unattended *at, const char *what, const struct queue_item *item,
                 const char *message) {
    GVariantBuilder details;
    g_autofree char *valid = g_utf8_make_valid(message ? message : "", -1);
    const char *directory = item ? item->directory : at->run->capture ? at->run->directory : "";
    g_autofree char *base = *directory ? g_path_get_basename(directory) : g_strdup("");
    if (g_str_has_suffix(base, ".session"))
        base[strlen(base) - strlen(".session")] = '\0';
    g_variant_builder_init(&details, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&details, "{sv}", "session", g_variant_new_string(directory));
    g_variant_builder_add(&details, "{sv}", "name", g_variant_new_string(item ? item->name : base));
    g_variant_builder_add(&details, "{sv}", "message", g_variant_new_string(valid));
    g_variant_builder_add(&details, "{sv}", "number", g_variant_new_uint32(item ? item->id : 0));
    g_variant_builder_add(&details, "{sv}", "waiting",
                          g_variant_new_uint32(at->queue ? count_waiting(at) : 0));
    bus_rig1_emit_milestone(at->rig->object, what, g_variant_builder_end(&details));
}

static void set_item(struct bus_unattended *at, struct queue_item *item, enum queue_state state,
                     const char *message) {
    g_autoptr(GError) error = NULL;
    if (state == QUEUE_DONE || state == QUEUE_STOPPED)
        item->ended_at_s = now_s();
    if (!queue_set(at->queue, item, state, message, &error))
        bus_rig_report(at->rig, "warning", "queue", error->message);
}

static void pause_queue(struct bus_unattended *at, const char *why) {
    g_autoptr(GError) error = NULL;
    if (queue_paused(at->queue))
        return;
    if (!queue_pause(at->queue, why, &error))
        bus_rig_report(at->rig, "warning", "queue", error->message);
    bus_rig_report(at->rig, "warning", "queue", why);
    tell(at, "queue-paused", NULL, why);
}

/* Ends the test shots of the present item. If the capture of the item has not begun, the item waits
 * again, at the same place of the queue. */
static void put_back(struct bus_unattended *at) {
    g_clear_pointer(&at->trial, bus_trial_free);
    if (at->item && at->item->state != QUEUE_BEGUN) {
        set_item(at, at->item, QUEUE_WAITING, NULL);
        at->item = NULL;
    }
}

/* Marks the present item as stopped, because it could not begin or could not be finished. rig is
 * TRUE if the reason is a fault of the rig. The queue is then paused, because the next item would
 * also stop. */
static void stop_item(struct bus_unattended *at, const char *message, gboolean rig) {
    struct queue_item *item = g_steal_pointer(&at->item);
    set_item(at, item, QUEUE_STOPPED, message);
    bus_rig_report(at->rig, "error", "queue", message);
    tell(at, "fault", item, message);
    at->stopped_in_row++;
    if (rig) {
        pause_queue(at, message);
    } else if (at->stopped_in_row >= MAX_STOPPED) {
        g_autofree char *why =
            g_strdup_printf("%u sessions in a row have stopped, the last one, number %u, because "
                            "%s: look at the rig, then mesorig queue resume",
                            at->stopped_in_row, item->id, message);
        pause_queue(at, why);
    }
    show_queue(at);
    bus_unattended_poke(at);
}

/* Puts the present item back into the queue, and pauses the queue. Use this if the item could not
 * begin for another reason than its session: the rig, the file of the queue or a cancelled call. */
static void keep_for_later(struct bus_unattended *at, const char *why) {
    struct queue_item *item = g_steal_pointer(&at->item);
    g_autofree char *text = g_strdup_printf("session %u could not begin: %s", item->id, why);
    set_item(at, item, QUEUE_WAITING, NULL);
    pause_queue(at, text);
    show_queue(at);
}

static gboolean has_begun(const struct queue_item *item) {
    g_autofree char *database = g_build_filename(item->directory, "session.db", NULL);
    return item->begun_at_s > 0 && g_file_test(database, G_FILE_TEST_EXISTS);
}

/* A session of the queue that a child makes or examines. */
struct beginning {
    struct bus_unattended *at;
    char *directory;
    gboolean resumes, process;
};

static void beginning_free(gpointer data) {
    struct beginning *beginning = data;
    g_free(beginning->directory);
    g_free(beginning);
}

static void on_prepared(GDBusMethodInvocation *invocation, GVariant *result, GError *failed,
                        gpointer data) {
    const struct beginning *beginning = data;
    struct bus_unattended *at = beginning->at;
    g_autoptr(GError) error = failed;
    const char *warning = result ? g_variant_get_string(result, NULL) : "";
    if (result && bus_run_begin(at->run, beginning->directory, beginning->resumes,
                                *warning ? warning : NULL, beginning->process, &error)) {
        bus_rig_flush(at->rig);
        /* bus_unattended_begun() was called within bus_run_begin(), and has reported that the
         * capture began */
        return;
    }
    if (!at->item)
        return;
    at->item->starts--;
    if (g_error_matches(error, BUS_ERROR, BUS_ERROR_CANCELLED))
        keep_for_later(at, error->message);
    else
        stop_item(at, error->message, FALSE);
}

/* Makes or examines a session of the queue in a child process, as Start and Resume do. */
static void start_job(struct bus_unattended *at, const struct queue_item *item, gboolean resumes) {
    struct bus_caller caller = {.uid = item->uid};
    caller.n_groups = (int)MIN(item->groups->len, BUS_CALLER_GROUPS);
    for (int i = 0; i < caller.n_groups; i++)
        caller.groups[i] = g_array_index(item->groups, guint32, i);
    struct preparer_request request = {
        .task = resumes ? PREPARER_EXAMINE : PREPARER_BEGIN,
        .session_path = item->session_path,
        .session_text = item->session_text,
        .directory = item->directory,
        .calibration = *item->calibration && !resumes ? item->calibration : NULL,
        .calibration_text = resumes ? NULL : item->calibration_text,
        .chosen = *item->chosen ? item->chosen : NULL,
        .caller = item->has_caller ? &caller : NULL};
    struct beginning *beginning = g_new(struct beginning, 1);
    *beginning = (struct beginning){at, g_strdup(item->directory), resumes, item->process};
    bus_jobs_start(at->jobs, &request, NULL, on_prepared, beginning, beginning_free);
}

/* Makes the present item's session, or resumes the session if it exists. Before the capture begins,
 * the state "begun" is written to disk. The members begun_at_s and starts therefore survive if this
 * program is killed. */
static void begin_item(struct bus_unattended *at) {
    struct queue_item *item = at->item;
    const gboolean resumes = has_begun(item);
    g_autoptr(GError) error = NULL;
    if (item->starts >= MAX_STARTS) {
        g_autofree char *why =
            g_strdup_printf("mesorigd has ended unexpectedly %d times while it captured this "
                            "session: see journalctl -u mesorigd, then mesorig resume %s",
                            item->starts, item->directory);
        stop_item(at, why, FALSE);
        return;
    }
    item->starts++;
    item->begun_at_s = item->begun_at_s ? item->begun_at_s : now_s();
    if (!queue_set(at->queue, item, QUEUE_BEGUN, NULL, &error)) {
        item->starts--;
        item->begun_at_s = resumes ? item->begun_at_s : 0;
        keep_for_later(at, error->message);
        return;
    }
    show_queue(at);
    start_job(at, item, resumes);
}

static void on_trial(const char *chosen, const char *said, enum bus_trial_end end, gpointer data) {
    struct bus_unattended *at = data;
    struct queue_item *item = at->item;
    g_clear_pointer(&at->trial, bus_trial_free);
    if (end == BUS_TRIAL_DONE) {
        if (*said)
            bus_rig_report(at->rig, "warning", "queue", said);
        g_free(item->chosen);
        item->chosen = g_strdup(chosen);
        begin_item(at);
    } else if (end == BUS_TRIAL_RIG || bus_rig_open_interlock(at->rig)) {
        keep_for_later(at, said);
    } else {
        stop_item(at, said, FALSE);
    }
}

static void try_item(struct bus_unattended *at) {
    g_autoptr(GError) error = NULL;
    if (has_begun(at->item)) {
        begin_item(at);
        return;
    }
    at->trial = bus_trial_start(at->run->address, at->item, on_trial, at, &error);
    if (!at->trial) {
        keep_for_later(at, error->message);
        return;
    }
    set_item(at, at->item, QUEUE_TRYING, NULL);
    show_queue(at);
}

static void rest_now(struct bus_unattended *at) {
    enum device_safety safety;
    g_variant_unref(g_variant_ref_sink(devices_safety(at->rig->devices, &safety)));
    const gboolean safe = safety == DEVICE_SAFE;
    g_free(at->rest);
    at->rest = g_strdup_printf("%s%s%s",
                               safe ? "lamps and lasers are off"
                                    : "NOT every lamp and laser has confirmed that it is off: look "
                                      "at the rig",
                               at->not_parked->len ? "; "
                               : safe              ? ", the axes are parked"
                                                   : "; the axes are parked",
                               at->not_parked->str);
    bus_rig_report(at->rig, safe && !at->not_parked->len ? "info" : "warning", "queue", at->rest);
    tell(at, "queue-empty", NULL, at->rest);
    show_queue(at);
}

static void note_not_parked(struct bus_unattended *at, const GError *error) {
    g_string_append_printf(at->not_parked, "%s%s",
                           at->not_parked->len ? "; " : "not parked: ", error->message);
}

static void on_parked(gpointer data, const GError *error) {
    struct bus_unattended *at = data;
    if (error)
        note_not_parked(at, error);
    if (--at->n_parking == 0)
        rest_now(at);
}

/* Parks the rig when the queue is empty: switches lights off, and moves all axes to their parking
 * positions. Axes that sweep lasers are not moved. */
static void park(struct bus_unattended *at) {
    g_autoptr(GError) error = NULL;
    at->has_worked = FALSE;
    g_string_truncate(at->not_parked, 0);
    if (!devices_make_safe(at->rig->devices, &error))
        bus_rig_report(at->rig, "error", "queue", error->message);
    /* While the axes are started, n_parking is one too large, so that it does not become 0 before
     * all axes have started. */
    at->n_parking = 1;
    for (int i = 0; i < DEVICES_POSITIONERS; i++) {
        Axis *axis = devices_positioner(at->rig->devices, i);
        g_autoptr(GError) why = NULL;
        if (axis && bus_hands_park(at->run->hands, axis, on_parked, at, &why))
            at->n_parking++;
        else if (axis)
            note_not_parked(at, why);
    }
    if (--at->n_parking == 0)
        rest_now(at);
}

/* Returns TRUE if a session of the queue may begin. The open rig must be the one for which the
 * session was added, the rig file must not have changed since the rig was opened, and all devices
 * must be safe. Otherwise pauses the queue and returns FALSE. */
static gboolean check_rig(struct bus_unattended *at, const struct queue_item *item) {
    g_autofree char *why = NULL;
    g_autoptr(GError) error = NULL;
    if (strcmp(item->rig, at->rig->path) != 0)
        why = g_strdup_printf("session %u was added for the rig %s, but %s is open: open that rig, "
                              "or remove the session (mesorig queue remove %u)",
                              item->id, item->rig, at->rig->path, item->id);
    else if (!devices_check_file(at->rig->devices, &error) || !bus_safety_need(at->rig, &error))
        why = g_strdup_printf("%s; then mesorig queue resume", error->message);
    if (why)
        pause_queue(at, why);
    return !why;
}

static gboolean step(gpointer data) {
    struct bus_unattended *at = data;
    at->step_id = 0;
    show_queue(at);
    if (!bus_safety_is_free(at->rig) || bus_jobs_beginning(at->jobs) || at->item || at->n_parking ||
        queue_paused(at->queue))
        return G_SOURCE_REMOVE;
    struct queue_item *item = queue_next(at->queue);
    if (!item) {
        if (at->has_worked)
            park(at);
        return G_SOURCE_REMOVE;
    }
    if (!check_rig(at, item)) {
        show_queue(at);
        return G_SOURCE_REMOVE;
    }
    at->item = item;
    if (*item->prompt && !has_begun(item)) {
        set_item(at, item, QUEUE_HANDS, NULL);
        tell(at, "hands", item, item->prompt);
        bus_rig_report(at->rig, "info", "queue", item->prompt);
        show_queue(at);
    } else {
        try_item(at);
    }
    return G_SOURCE_REMOVE;
}

void bus_unattended_poke(struct bus_unattended *at) {
    if (at && at->queue && !at->step_id)
        at->step_id = g_idle_add(step, at);
}

void bus_unattended_begun(struct bus_unattended *at) {
    const gboolean ours = at->item && at->item->state == QUEUE_BEGUN;
    at->told = MOMENT_RUNS;
    at->has_worked |= ours;
    at->held_by_fault = FALSE;
    if (at->queue)
        g_clear_pointer(&at->rest, g_free);
    tell(at, "begun", ours ? at->item : NULL, "");
}

/* Handles a fault that has paused the present item's session. If it is a fault of the rig, the
 * queue is paused. If it is a fault of the session, the session is marked as stopped and
 * aborted. */
static void take_fault(struct bus_unattended *at, const struct capture_status *status) {
    if (status->fault == CAPTURE_FAULT_RIG) {
        /* The session stays paused. When the user has repaired the rig, the user continues the
         * session. */
        g_autofree char *why =
            g_strdup_printf("session %u is paused by a fault: %s", at->item->id, status->reason);
        tell(at, "fault", at->item, status->reason);
        at->held_by_fault = !queue_paused(at->queue);
        pause_queue(at, why);
        show_queue(at);
        return;
    }
    g_autofree char *reason = g_strdup_printf("%s To continue it: mesorig resume %s",
                                              status->reason, at->item->directory);
    stop_item(at, reason, FALSE);
    capture_abort(at->run->capture);
}

static void take_end(struct bus_unattended *at, gboolean done) {
    struct queue_item *item = g_steal_pointer(&at->item);
    if (done) {
        at->stopped_in_row = 0;
        set_item(at, item, QUEUE_DONE, NULL);
        tell(at, "done", item, "");
    } else {
        g_autofree char *message = g_strdup_printf(
            "the capture was aborted, and its frames are kept; to continue it: mesorig resume %s",
            item->directory);
        g_autofree char *why = g_strdup_printf("session %u was aborted", item->id);
        set_item(at, item, QUEUE_STOPPED, message);
        tell(at, "aborted", item, message);
        pause_queue(at, why);
    }
    show_queue(at);
}

static enum moment moment_of(const struct capture_status *status) {
    if (status->state == CAPTURE_DONE || status->state == CAPTURE_ABORTED)
        return MOMENT_ENDED;
    if (status->state != CAPTURE_PAUSED)
        return MOMENT_RUNS;
    if (status->fault != CAPTURE_FAULT_NONE)
        return MOMENT_FAULT;
    return status->prompt ? MOMENT_HANDS : MOMENT_PAUSED;
}

void bus_unattended_changed(struct bus_unattended *at, const struct capture_status *status) {
    const enum moment moment = moment_of(status);
    const gboolean ours = at->item && at->item->state == QUEUE_BEGUN;
    if (moment == at->told)
        return;
    at->told = moment;
    if (moment == MOMENT_HANDS)
        tell(at, "hands", ours ? at->item : NULL, status->prompt);
    if (moment == MOMENT_RUNS && at->held_by_fault) {
        at->held_by_fault = FALSE;
        if (!queue_pause(at->queue, NULL, NULL))
            bus_rig_report(at->rig, "warning", "queue",
                           "the queue stays paused, because its file cannot be written: check the "
                           "free space and the rights of its folder, then mesorig queue resume");
        show_queue(at);
    }
    if (ours && moment == MOMENT_FAULT)
        take_fault(at, status);
    else if (ours && moment == MOMENT_ENDED)
        take_end(at, status->state == CAPTURE_DONE);
    else if (moment == MOMENT_FAULT)
        tell(at, "fault", NULL, status->reason);
    else if (moment == MOMENT_ENDED)
        tell(at, status->state == CAPTURE_DONE ? "done" : "aborted", NULL, "");
}

void bus_unattended_stop(struct bus_unattended *at, const char *why) {
    if (!at->queue)
        return;
    put_back(at);
    if (why && (at->item || queue_next(at->queue)))
        pause_queue(at, why);
    if (!why && at->item) {
        /* The capture is closed in an orderly way and can be resumed, so earlier starts do not
         * count. */
        at->item->starts = 0;
        set_item(at, at->item, QUEUE_WAITING, NULL);
        at->item = NULL;
    }
    show_queue(at);
}

gboolean bus_unattended_is_beginning(const struct bus_unattended *at) {
    return at->item && at->item->state == QUEUE_TRYING;
}

gboolean bus_unattended_need_free(struct bus_unattended *at, GError **error) {
    if (!bus_unattended_is_beginning(at))
        return TRUE;
    g_set_error(error, BUS_ERROR, BUS_ERROR_BUSY,
                "session %u of the queue is about to begin: mesorig queue pause prevents that",
                at->item->id);
    return FALSE;
}

gboolean bus_unattended_need_queue(struct bus_unattended *at, GError **error) {
    if (!at->queue)
        g_set_error(error, BUS_ERROR, BUS_ERROR_FAILED, "this mesorigd keeps no queue: %s",
                    at->rest ? at->rest : "start it with --queue FILE");
    return at->queue != NULL;
}

guint bus_unattended_add(struct bus_unattended *at, struct queue_item *item, GError **error) {
    if (!queue_add(at->queue, item, error))
        return 0;
    g_clear_pointer(&at->rest, g_free);
    show_queue(at);
    bus_unattended_poke(at);
    return item->id;
}

gboolean bus_unattended_remove(struct bus_unattended *at, guint number, GError **error) {
    if (!bus_unattended_need_queue(at, error))
        return FALSE;
    struct queue_item *item = queue_find(at->queue, number, error);
    if (!item || !queue_remove(at->queue, number, error))
        return FALSE;
    if (at->item == item)
        at->item = NULL;
    show_queue(at);
    bus_unattended_poke(at);
    return TRUE;
}

gboolean bus_unattended_move(struct bus_unattended *at, guint number, guint place, GError **error) {
    if (!bus_unattended_need_queue(at, error) || !queue_move(at->queue, number, place, error))
        return FALSE;
    if (at->item && at->item->state == QUEUE_HANDS && queue_next(at->queue) != at->item)
        put_back(at);
    show_queue(at);
    bus_unattended_poke(at);
    return TRUE;
}

gboolean bus_unattended_pause(struct bus_unattended *at, GError **error) {
    if (!bus_unattended_need_queue(at, error) ||
        (!queue_paused(at->queue) && !queue_pause(at->queue, "paused by hand", error)))
        return FALSE;
    put_back(at);
    show_queue(at);
    return TRUE;
}

gboolean bus_unattended_resume(struct bus_unattended *at, GError **error) {
    struct capture_status status;
    if (!bus_unattended_need_queue(at, error))
        return FALSE;
    if (at->run->capture && at->item) {
        capture_get_status(at->run->capture, &status);
        if (status.state == CAPTURE_PAUSED && !status.prompt) {
            if (!capture_continue(at->run->capture, error))
                return FALSE;
            g_hash_table_remove_all(at->rig->faults);
        }
    }
    if (queue_paused(at->queue) && !queue_pause(at->queue, NULL, error))
        return FALSE;
    at->stopped_in_row = 0;
    show_queue(at);
    bus_unattended_poke(at);
    return TRUE;
}

gboolean bus_unattended_answer(struct bus_unattended *at) {
    if (!at->item || at->item->state != QUEUE_HANDS || !bus_safety_is_free(at->rig))
        return FALSE;
    try_item(at);
    return TRUE;
}

void bus_unattended_keep(struct bus_unattended *at, const char *path) {
    g_autoptr(GError) error = NULL;
    at->queue = queue_open(path, &error);
    if (error) {
        at->rest = g_strdup(error->message);
        g_warning("there is no queue of sessions: %s", error->message);
    } else if (queue_paused(at->queue)) {
        g_message("the queue is paused: %s", queue_paused(at->queue));
    }
    show_queue(at);
    bus_unattended_poke(at);
}

struct bus_unattended *bus_unattended_new(struct bus_run *run, struct bus_jobs *jobs) {
    struct bus_unattended *at = g_new0(struct bus_unattended, 1);
    at->rig = run->rig;
    at->run = run;
    at->jobs = jobs;
    at->not_parked = g_string_new(NULL);
    show_queue(at);
    return at;
}

void bus_unattended_free(struct bus_unattended *at) {
    g_clear_handle_id(&at->step_id, g_source_remove);
    g_clear_pointer(&at->trial, bus_trial_free);
    queue_free(at->queue);
    g_string_free(at->not_parked, TRUE);
    g_free(at->rest);
    g_free(at);
}
